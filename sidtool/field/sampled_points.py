"""Points of a discretised body and their motion, and the cross-sections of beams."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.taylor import Array
from sidtool.formats.sid_mass import skew

from ..elements.finite_element_model import BeamOutline

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SampledPoints:
    """Points of a body and their motion for given degrees of freedom.

    Attributes
    ----------
    positions : (n, 3) in the axes of the model [m]
    triangles : (m, 3) the outer surface
    displacement : from fields (ndof, k) to (n, 3, k)
    cells : kind of element -> (ne, nodes)
    thickness : of a plane body [m]
    stress : from fields (ndof, k) to (n, 6, k) [Pa]; None where it is not known
    transverse : (n,) stress zz per xx + yy of a uniform stress in the plane
    """

    positions: Array
    triangles: Indices
    displacement: Callable[[Array], Array]
    cells: Mapping[str, Indices] = field(default_factory=dict)
    thickness: float = 0.0
    stress: Callable[[Array], Array] | None = None
    transverse: Array = field(default_factory=lambda: np.zeros(0))


def concatenate_points(parts: Iterable[SampledPoints]) -> SampledPoints:
    """Several parts of one body as one; points are not shared."""
    parts = list(parts)
    if len(parts) == 1:
        return parts[0]
    starts = np.cumsum([0, *(len(part.positions) for part in parts)])
    cells: dict[str, list[Indices]] = {}
    for part, start in zip(parts, starts, strict=False):
        for kind, nodes in part.cells.items():
            cells.setdefault(kind, []).append(nodes + start)
    stresses = [part.stress for part in parts]

    def stress(fields: Array) -> Array:
        return np.concatenate([one(fields) for one in stresses if one is not None])

    return SampledPoints(
        positions=np.concatenate([part.positions for part in parts]),
        triangles=np.concatenate(
            [part.triangles + s for part, s in zip(parts, starts, strict=False)]
        ),
        displacement=lambda fields: np.concatenate(
            [part.displacement(fields) for part in parts]
        ),
        cells={
            kind: np.concatenate(parts_of_kind) for kind, parts_of_kind in cells.items()
        },
        thickness=parts[0].thickness,
        stress=None if None in stresses else stress,
        transverse=np.concatenate([part.transverse for part in parts]),
    )


CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)


def beam_field(outline: BeamOutline) -> SampledPoints:
    """Four corners of every cross-section, which turn with it."""
    arms = (outline.halves[:, None] * CORNERS) @ outline.axes
    n = len(arms)
    turning = -skew(arms.reshape(-1, 3)).reshape(n, 4, 3, 3)

    def displacement(fields: Array) -> Array:
        motion = (outline.motion @ fields).reshape(n, 6, -1)
        own = np.einsum("ncab,nbk->ncak", turning, motion[:, 3:])
        return (motion[:, None, :3] + own).reshape(4 * n, 3, -1)

    return SampledPoints(
        positions=(outline.places[:, None] + arms).reshape(-1, 3),
        triangles=tube(n),
        displacement=displacement,
        transverse=np.zeros(4 * n),
    )


def tube(sections: int) -> NDArray[np.int64]:
    """Triangles of the sides and ends of a row of sections with four corners each."""
    triangles = [(0, 2, 1), (0, 3, 2)]
    for i in range(sections - 1):
        for c in range(4):
            a, b = 4 * i + c, 4 * i + (c + 1) % 4
            triangles += [(a, b, b + 4), (a, b + 4, a + 4)]
    last = 4 * (sections - 1)
    triangles += [(last, last + 1, last + 2), (last, last + 2, last + 3)]
    return np.array(triangles, np.int64)
