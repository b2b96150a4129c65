"""Points of a discretised body, before its reduction."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Sampled:
    """Points with what they do for given degrees of freedom.

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


def together(parts: Iterable[Sampled]) -> Sampled:
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

    return Sampled(
        positions=np.concatenate([part.positions for part in parts]),
        triangles=np.concatenate(
            [part.triangles + s for part, s in zip(parts, starts, strict=False)]
        ),
        displacement=lambda fields: np.concatenate(
            [part.displacement(fields) for part in parts]
        ),
        cells={kind: np.concatenate(found) for kind, found in cells.items()},
        thickness=parts[0].thickness,
        stress=None if None in stresses else stress,
        transverse=np.concatenate([part.transverse for part in parts]),
    )
