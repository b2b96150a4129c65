"""All ways to say a scene differently, by name."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.metamorphic.generator.case import Case, Values, run
from tests.metamorphic.generator.differences import WITHIN, Sizes, difference, variation
from tests.metamorphic.generator.ingredients import Random
from tests.metamorphic.generator.said import Said
from tests.metamorphic.ways import (
    continued,
    damping,
    default_keys,
    descriptions,
    rereferenced,
    rewritten_bodies,
    signal_files,
    space,
    units,
    worlds,
)

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
    "units": units.in_units,
    "plane as space": space.in_space,
    "rigid bodies split": rewritten_bodies.split_bodies,
    "frames of rigid bodies": rewritten_bodies.moved_frames,
    "rigid bodies as SIDs": rewritten_bodies.as_sids,
    "tool out of the FE model": rewritten_bodies.tools,
    "SIDs turned": rewritten_bodies.turned_sids,
    "SIDs re-referenced, at the start": rereferenced.at_the_start,
    "SIDs re-referenced, small motion": rereferenced.small_motion,
    "elastic coordinates mixed": rewritten_bodies.mixed_coordinates,
    "other joints": descriptions.other_joints,
    "functions as callables": descriptions.callables,
    "functions as polynomials": descriptions.polynomials,
    "springs as actuators and tables": descriptions.springs,
    "forces halved": descriptions.halved_forces,
    "continued": continued.continued,
    "couplings as gears": descriptions.couplings,
    "dampings as matrices": damping.in_sids,
    "optional keys left out": default_keys.keys_left_out,
    "signals from files and formulas": signal_files.signals,
}


def said(name: str, case: Case, seed: int) -> Said | None:
    """A case said differently in the way of this name; None if it has nothing such."""
    number = list(TRANSFORMATIONS).index(name)
    return TRANSFORMATIONS[name](case, np.random.default_rng([14, seed, number]))


def compared(
    name: str,
    case: Case,
    exact: Values,
    seed: int,
    rtol: float,
    sizes: Sizes = variation,
) -> tuple[float, float, str] | None:
    """Difference of a run that is said differently, what is allowed, and in what.

    None if the scene has nothing that could be said so.

    sizes : what differences are relative to, where the way has no sizes of its own
    """
    other = said(name, case, seed)
    if other is None:
        return None
    if other.base is not None:
        exact = run(other.base, rtol=rtol)
    found = other.back(run(other.case, rtol=rtol, **other.settings))
    sizes = sizes if other.sizes is variation else other.sizes
    error, where = difference(found, exact, sizes, other.first)
    return error, WITHIN * rtol + other.slack(exact), where
