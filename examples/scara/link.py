"""Writes link.bdf: a tapering beam of solid elements (CHEXA), bolted at both ends.

In the place of your own deck. RBE2 makes each end a rigid flange with a node in its
centre, 1001 at the elbow and 1002 at the tool.
"""

import numpy as np

LENGTH, WIDTH, ROOT, TIP = 0.25, 0.04, 0.02, 0.01  # m; height at both ends
CELLS = (10, 2, 2)
ELBOW, TOOL = 1001, 1002

CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
MIDDLES = [(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0)]
# The order of CHEXA: corners below and above, edges below, upright and above.
NODES = [
    *CORNERS,
    *((i, j, 2) for i, j, _ in CORNERS),
    *MIDDLES,
    *((i, j, 1) for i, j, _ in CORNERS),
    *((i, j, 2) for i, j, _ in MIDDLES),
]

numbers: dict[tuple[int, int, int], int] = {}
elements = []
for cell in np.ndindex(*CELLS):
    places = [
        tuple(2 * c + a for c, a in zip(cell, node, strict=True)) for node in NODES
    ]
    elements.append([numbers.setdefault(p, len(numbers) + 1) for p in places])


def card(*fields: object) -> str:
    """A card of free fields, eight to a line."""
    name, *rest = map(str, fields)
    rows = [",".join(rest[i : i + 8]) for i in range(0, len(rest), 8)]
    return f"{name},{rows[0]}" + "".join(f"\n+,{row}" for row in rows[1:])


def place(i: int, j: int, k: int) -> tuple[str, str, str]:
    """Coordinates of a point of the grid."""
    x = LENGTH * i / (2 * CELLS[0])
    height = ROOT + (TIP - ROOT) * x / LENGTH
    y = WIDTH * (j / (2 * CELLS[1]) - 0.5)
    return f"{x:.6f}", f"{y:.6f}", f"{height * (k / (2 * CELLS[2]) - 0.5):.7f}"


with open("link.bdf", "w", encoding="utf-8") as file:
    print("BEGIN BULK", file=file)
    for at, number in numbers.items():
        print(card("GRID", number, "", *place(*at)), file=file)
    for node, x, end in ((ELBOW, 0.0, 0), (TOOL, LENGTH, 2 * CELLS[0])):
        print(card("GRID", node, "", x, 0.0, 0.0), file=file)
        held = [number for at, number in numbers.items() if at[0] == end]
        print(card("RBE2", node + 9000, node, 123456, *held), file=file)
    for number, nodes in enumerate(elements, start=1):
        print(card("CHEXA", number, 1, *nodes), file=file)
    print(card("PSOLID", 1, 1), file=file)
    print(card("MAT1", 1, "7.0E10", "", "0.33", "2700."), file=file)
    print("ENDDATA", file=file)
print(f"link.bdf: {len(numbers)} nodes, {len(elements)} elements")
