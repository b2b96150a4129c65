"""A basis beside the full mesh: frequencies, and compliance where loads act."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from sidtool.formats.model.reduction import ReductionSettings

from ..frontends.finite_element_model import FiniteElementModel, MarkerRows
from .basis import ReducedBasis, hertz
from .frames import motion_names, motion_rows
from .methods import COMPARED, HELD
from .space import Space

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Full:
    """The full mesh: frequencies [Hz], loads (k, ndof) and their compliances (k,)."""

    frequencies: Array
    names: tuple[str, ...]
    rows: Array
    compliances: Array


@dataclass(frozen=True, eq=False)
class Fidelity:
    """Relative errors of a basis.

    Attributes
    ----------
    frequencies : (n,) of the first ones; positive if too high
    compliances : (k,) displacement along unit loads at markers; positive if too small
    names : k texts
    hertz : (n,) the frequencies of the full mesh
    count : of shape functions
    """

    frequencies: Array
    compliances: Array
    names: tuple[str, ...]
    hertz: Array
    count: int

    @property
    def worst(self) -> float:
        """The largest of all errors."""
        both = np.concatenate([self.frequencies, self.compliances])
        return float(np.abs(both).max(initial=0.0))


def turns(marker: MarkerRows, settings: ReductionSettings) -> bool:
    """Whether moments are loads: as chosen, or where a marker has its own rotation."""
    return bool(getattr(settings, "rotations", marker.gradient is None))


def full_mesh(
    body: FiniteElementModel,
    space: Space,
    markers: list[MarkerRows],
    settings: ReductionSettings,
    count: int,
) -> Full:
    """The first `count` frequencies, and the compliance at some markers."""
    pairs = [(marker, turns(marker, settings)) for marker in markers]
    rows = [motion_rows(body, marker, rotations=turn) for marker, turn in pairs]
    names = [motion_names(body, marker, rotations=turn) for marker, turn in pairs]
    loads = np.vstack([np.zeros((0, body.ndof)), *rows])
    compliances = np.einsum("ij,ji->i", loads, space.static(loads.T))
    flat = np.array([name for group in names for name in group], object)
    turning = np.array([name.rpartition(" ")[2].startswith("r") for name in flat], bool)
    felt = compliances > 0
    for kind in (turning, ~turning):  # what supports hold moves by rounding
        largest = compliances[kind].max(initial=0.0)
        felt &= ~kind | (compliances > HELD * largest)
    squares, _ = space.modes(min(COMPARED, count))
    return Full(hertz(squares), tuple(flat[felt]), loads[felt], compliances[felt])


def measured(
    body: FiniteElementModel, space: Space, basis: ReducedBasis, full: Full
) -> Fidelity:
    """The errors of a basis; rigid motions that are free are known.

    Raises
    ------
    numpy.linalg.LinAlgError : rounding makes the shape functions dependent.
    """
    shapes = basis.shapes
    if space.rigid.shape[1]:
        rigid = space.displacements(space.rigid)
        momenta = body.mass @ rigid
        shapes = shapes - rigid @ np.linalg.solve(momenta.T @ rigid, momenta.T @ shapes)
    stiffness, mass = (shapes.T @ (a @ shapes) for a in (body.stiffness, body.mass))
    squares, vectors = scipy.linalg.eigh(stiffness, mass)
    motions = full.rows @ (shapes @ vectors)
    compliances = (motions**2 / squares).sum(axis=1)
    found = hertz(squares)[: len(full.frequencies)]
    known = full.frequencies[: len(found)]
    return Fidelity(
        found / known - 1,
        1 - compliances / full.compliances,
        full.names,
        known,
        len(squares),
    )
