"""Writes arm.inp: a square tube of solid elements (C3D20), its two end faces as sets.

In the place of your own mesh: sidtool reads .inp (Abaqus, CalculiX), .msh (Gmsh), .bdf
(Nastran) and .cdb (ANSYS).
"""

import numpy as np

LENGTH, WIDTH, WALL = 0.8, 0.05, 0.003  # m
CELLS = 12  # along the tube
SIDE = 4  # cells along a side of the section, of which the walls are the outer ones

half = WIDTH / 2
across = np.array([-half, -half + WALL, 0.0, half - WALL, half])
x_lines = np.linspace(0.0, LENGTH, 2 * CELLS + 1)
# Between the lines of corners lie those of the nodes in the middle of edges.
y_lines = np.interp(np.arange(2 * SIDE + 1) / 2, np.arange(SIDE + 1), across)

CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
MIDDLES = [(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0)]
# The order of C3D20: corners below and above, edges below, above, and upright.
NODES = [
    *CORNERS,
    *((i, j, 2) for i, j, _ in CORNERS),
    *MIDDLES,
    *((i, j, 2) for i, j, _ in MIDDLES),
    *((i, j, 1) for i, j, _ in CORNERS),
]

numbers: dict[tuple[int, int, int], int] = {}
elements = []
for i in range(CELLS):
    for j in range(SIDE):
        for k in range(SIDE):
            if 0 < j < SIDE - 1 and 0 < k < SIDE - 1:
                continue  # the hollow
            places = [(2 * i + a, 2 * j + b, 2 * k + c) for a, b, c in NODES]
            elements.append([numbers.setdefault(p, len(numbers) + 1) for p in places])


def lines(numbers: list[int]) -> str:
    """Numbers with commas, sixteen to a line."""
    rows = [numbers[i : i + 16] for i in range(0, len(numbers), 16)]
    return ",\n".join(", ".join(map(str, row)) for row in rows)


with open("arm.inp", "w", encoding="utf-8") as file:
    print("*NODE", file=file)
    for (i, j, k), number in numbers.items():
        print(
            f"{number}, {x_lines[i]:.9g}, {y_lines[j]:.9g}, {y_lines[k]:.9g}", file=file
        )
    print("*ELEMENT, TYPE=C3D20, ELSET=TUBE", file=file)
    for number, nodes in enumerate(elements, start=1):
        print(lines([number, *nodes]), file=file)
    for name, at in (("BASE", 0), ("TIP", 2 * CELLS)):
        print(f"*NSET, NSET={name}", file=file)
        print(
            lines([number for place, number in numbers.items() if place[0] == at]),
            file=file,
        )
    print(
        "*MATERIAL, NAME=ALUMINIUM\n*ELASTIC\n7.0e10, 0.33\n*DENSITY\n2700.", file=file
    )
    print("*SOLID SECTION, ELSET=TUBE, MATERIAL=ALUMINIUM", file=file)
print(f"arm.inp: {len(numbers)} nodes, {len(elements)} elements")
