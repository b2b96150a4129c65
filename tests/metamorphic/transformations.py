"""All ways to say a scene differently, by name; and when two runs are equal."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sidtool.formats.sid import Array

from . import continued, descriptions, rewritten_bodies, space, worlds
from .case import Case, Values
from .ingredients import Random
from .said import Said, kind

Transformation = Callable[[Case, Random], Said | None]

TRANSFORMATIONS: dict[str, Transformation] = {
    "forces recorded or not": descriptions.recorded,
    "energy balance recorded": descriptions.balanced,
    "joints kept": descriptions.kept_joints,
    "reordered": descriptions.reordered,
    "renamed": descriptions.renamed,
    "markers exchanged": descriptions.exchanged,
    "world turned": worlds.turned_world,
    "world shifted": worlds.shifted_world,
    "mirrored": worlds.mirrored,
    "boosted and falling": worlds.boosted,
    "later": worlds.later,
    "units": worlds.in_units,
    "plane as space": space.in_space,
    "rigid bodies split": rewritten_bodies.split_bodies,
    "frames of rigid bodies": rewritten_bodies.moved_frames,
    "rigid bodies as SIDs": rewritten_bodies.as_sids,
    "tool out of the FE model": rewritten_bodies.tools,
    "SIDs turned": rewritten_bodies.turned_sids,
    "SIDs re-referenced": rewritten_bodies.rereferenced,
    "elastic coordinates mixed": rewritten_bodies.mixed_coordinates,
    "other joints": descriptions.other_joints,
    "functions as callables": descriptions.callables,
    "functions as polynomials": descriptions.polynomials,
    "springs as actuators and tables": descriptions.springs,
    "forces halved": descriptions.halved_forces,
    "continued": continued.continued,
}
#: Requests that two equal runs may differ by: positions, coordinates; rates; forces.
BOUNDS = {"v": 100.0, "w": 100.0, "vq": 100.0, "f": 1000.0, "m": 1000.0}
WITHIN = 10.0


def said(name: str, case: Case, seed: int) -> Said | None:
    """A case said differently in the way of this name; None if it has nothing such."""
    number = list(TRANSFORMATIONS).index(name)
    return TRANSFORMATIONS[name](case, np.random.default_rng([14, seed, number]))


def difference(found: Values, exact: Values, first: int) -> tuple[float, str]:
    """Largest difference of two runs, and in what; weighted by `BOUNDS`.

    Relative to how much the vector varies over the run.
    """
    worst, where = 0.0, ""
    for name in found.keys() & exact.keys():
        size = variation(name, exact)
        gap = float(np.abs(found[name] - exact[name][first:]).max())
        weighted = gap / size / (BOUNDS.get(kind(name), WITHIN) / WITHIN)
        if not weighted <= worst:
            worst, where = weighted, name
    return worst, where


def variation(name: str, exact: Values) -> float:
    """How much a measure varies, and at least a trace of the largest of its kind."""

    def of(value: Array) -> float:
        return float(np.ptp(value, axis=0).max())

    largest = max(of(v) for k, v in exact.items() if kind(k) == kind(name))
    return max(1e-6, 1e-3 * largest, of(exact[name]))
