"""Faces of elements as surfaces with parameters, and the nearest points on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .elements.reference import reference_element

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: (dimension of the space, nodes of a face) -> what the face is.
FACE_KINDS = {
    (2, 2): "line2",
    (2, 3): "line3",
    (3, 3): "tri3",
    (3, 4): "quad4",
    (3, 6): "tri6",
    (3, 8): "quad8",
}
_STEPS = 12
#: Faces that are tried for the one that is nearest to a point.
_BESIDE = 4


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces of one kind.

    Attributes
    ----------
    kind : one of `FACE_KINDS`
    nodes : (k, m) rows of the positions
    points : (k, m, d) where these are
    """

    kind: str
    nodes: Indices
    points: Array

    @property
    def corners(self) -> int:
        """Number of the corners of a face."""
        return {"l": 2, "t": 3, "q": 4}[self.kind[0]]

    @property
    def radii(self) -> Array:
        """(k,) how far from its middle a face reaches."""
        arms = self.points - self.points.mean(axis=1, keepdims=True)
        radii: Array = np.linalg.norm(arms, axis=2).max(axis=1)
        return radii

    def at(self, rows: Indices, parameters: Array) -> tuple[Array, Array, Array]:
        """Points (p, d), values (p, m) and tangents (p, d, d - 1) on some faces."""
        values, slopes = functions(self.kind, parameters)
        own = self.points[rows]
        points = np.einsum("pm,pmd->pd", values, own)
        return points, values, np.einsum("pmd,pmk->pdk", own, slopes)

    def nearest(self, rows: Indices, points: Array, *, inside: bool = True) -> Array:
        """(p, d - 1) parameters of the points of some faces nearest to others.

        Parameters
        ----------
        inside : whether they have to lie on the face; else the face goes on beyond
        """
        centre = centre_of(self.kind)
        found = np.tile(centre, (len(rows), 1))
        for _ in range(_STEPS):
            at, _, tangents = self.at(rows, found)
            gram = np.einsum("pda,pdb->pab", tangents, tangents)
            pull = np.einsum("pda,pd->pa", tangents, points - at)
            found = found + np.linalg.solve(gram, pull[..., None])[..., 0]
            found = clamped(self.kind, found) if inside else np.clip(found, -9, 9)
        return found


def functions(kind: str, parameters: Array) -> tuple[Array, Array]:
    """Values (p, m) and slopes (p, m, k) of the functions of a face."""
    if not kind.startswith("line"):
        return reference_element(kind).at(parameters)
    s = parameters[:, 0]
    if kind == "line2":
        values = np.stack([1 - s, s], 1)
        slopes = np.stack([-np.ones_like(s), np.ones_like(s)], 1)
    else:
        values = np.stack([(1 - s) * (1 - 2 * s), s * (2 * s - 1), 4 * s * (1 - s)], 1)
        slopes = np.stack([4 * s - 3, 4 * s - 1, 4 - 8 * s], 1)
    return values, slopes[:, :, None]


def centre_of(kind: str) -> Array:
    """The parameters of the middle of a face."""
    return np.array({"l": [0.5], "t": [1 / 3, 1 / 3], "q": [0.5, 0.5]}[kind[0]])


def clamped(kind: str, parameters: Array) -> Array:
    """Parameters of the face near those outside."""
    inside = np.clip(parameters, 0.0, 1.0)
    if kind.startswith("tri"):
        for _ in range(2):
            beyond = np.maximum(inside.sum(axis=1, keepdims=True) - 1, 0)
            inside = np.clip(inside - beyond / 2, 0.0, 1.0)
    return inside


def nearest_faces(groups: list[Faces], points: Array) -> tuple[Indices, Indices, Array]:
    """For points (p, d) the group, the row and the parameters of the nearest face."""
    from scipy.spatial import cKDTree

    samples, owners = [], []
    for number, group in enumerate(groups):
        for place in _samples(group.kind):
            rows = np.arange(len(group.nodes))
            samples.append(group.at(rows, np.tile(place, (len(rows), 1)))[0])
            owners.append(np.stack([np.full(len(rows), number), rows], 1))
    owner = np.concatenate(owners)
    count = min(_BESIDE, len(owner))
    _, near = cKDTree(np.concatenate(samples)).query(points, count)
    near = near.reshape(len(points), count)
    best = np.full(len(points), np.inf)
    where = np.zeros((len(points), 2), np.int64)
    parameters = np.zeros((len(points), points.shape[1] - 1))
    for column in near.T:
        for number, group in enumerate(groups):
            own = np.flatnonzero(owner[column, 0] == number)
            rows = owner[column[own], 1]
            found = group.nearest(rows, points[own])
            gap = np.linalg.norm(group.at(rows, found)[0] - points[own], axis=1)
            better = gap < best[own]
            chosen = own[better]
            best[chosen], parameters[chosen] = gap[better], found[better]
            where[chosen] = owner[column[chosen]]
    return where[:, 0], where[:, 1], parameters


def _samples(kind: str) -> Array:
    steps = np.linspace(0.05, 0.95, 5)
    if kind.startswith("line"):
        return steps[:, None]
    grid = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    return grid[grid.sum(axis=1) <= 1] if kind.startswith("tri") else grid
