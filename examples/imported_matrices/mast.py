"""Writes mast.npz: matrices of a lattice mast, as another program would export them.

Three longerons and their bracing, of bars that carry tension and compression only. The
arrays are those that sidtool reads: `stiffness` and `mass` as (row, column, value),
`nodes` as (number, x, y, z), `dofs` as (node, direction 1 to 3) of every row, and
`set.NAME` with node numbers.
"""

import numpy as np

BAYS, BAY, RADIUS = 10, 0.4, 0.25  # m
E, AREA, DENSITY = 7.0e10, 1.5e-4, 2700.0  # Pa, m^2, kg/m^3

angles = 2 * np.pi * np.arange(3) / 3
points = np.array(
    [
        [BAY * level, RADIUS * np.cos(a), RADIUS * np.sin(a)]
        for level in range(BAYS + 1)
        for a in angles
    ]
)
bars = []
for level in range(BAYS + 1):
    own, above = 3 * level, 3 * (level + 1)
    for i in range(3):
        bars.append((own + i, own + (i + 1) % 3))
        if level < BAYS:
            bars.append((own + i, above + i))
            bars.append((own + i, above + (i + 1) % 3))
            bars.append((own + i, above + (i + 2) % 3))

K = np.zeros((3 * len(points), 3 * len(points)))
M = np.zeros_like(K)
for a, b in bars:
    along = points[b] - points[a]
    length = np.linalg.norm(along)
    n = along / length
    k = E * AREA / length * np.outer(n, n)
    rows = np.r_[3 * a : 3 * a + 3, 3 * b : 3 * b + 3]
    K[np.ix_(rows, rows)] += np.block([[k, -k], [-k, k]])
    M[rows, rows] += DENSITY * AREA * length / 2


def triplets(matrix: np.ndarray) -> np.ndarray:
    """(entries, 3): row, column, value; a dense matrix would do, too."""
    rows, columns = np.nonzero(matrix)
    return np.column_stack([rows, columns, matrix[rows, columns]])


numbers = np.arange(1, len(points) + 1)
np.savez(
    "mast.npz",
    stiffness=triplets(K),
    mass=triplets(M),
    nodes=np.column_stack([numbers, points]),
    dofs=np.column_stack([np.repeat(numbers, 3), np.tile([1, 2, 3], len(points))]),
    **{"set.foot": numbers[:3], "set.head": numbers[-3:]},
)
print(f"mast.npz: {len(points)} nodes, {len(bars)} bars, {M.sum() / 3:.3f} kg")
