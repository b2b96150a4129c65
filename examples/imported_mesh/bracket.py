"""Writes one part as a deck of each program: bracket.inp, .msh, .bdf and .cdb.

In the place of your own file. A quarter of a ring of solid elements, with two sets of
nodes: CLAMP, the end at the wall, and END, where the load hangs.
"""

import numpy as np

RADIUS, HEIGHT, WIDTH = 0.1, 0.02, 0.02  # m, of the centre line and the section
CELLS = (24, 4, 2)  # along, across, through
E, NU, DENSITY = 2.1e11, 0.3, 7850.0

points, numbers = [], {}
for i, j, k in np.ndindex(*(n + 1 for n in CELLS)):
    angle, r = np.pi / 2 * i / CELLS[0], RADIUS + HEIGHT * (j / CELLS[1] - 0.5)
    z = WIDTH * (k / CELLS[2] - 0.5)
    numbers[i, j, k] = len(points) + 1
    points.append((r * np.cos(angle), r * np.sin(angle), z))
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
bricks = [
    [numbers[i + a, j + b, k + c] for c in (0, 1) for b, a in SQUARE]
    for i, j, k in np.ndindex(*CELLS)
]
faces = {
    name: [
        [numbers[i, j + a, k + b] for a, b in SQUARE] for j, k in np.ndindex(*CELLS[1:])
    ]
    for name, i in (("END", 0), ("CLAMP", CELLS[0]))
}
sets = {name: sorted({n for face in own for n in face}) for name, own in faces.items()}


def lines(*parts: object) -> str:
    """Text of parts, each a line or a sequence of lines."""
    out = []
    for part in parts:
        out += [part] if isinstance(part, str) else list(part)
    return "\n".join(out) + "\n"


def joined(values: object) -> str:
    return ", ".join(f"{value:.9g}" for value in values)


def abaqus() -> str:
    return lines(
        "*NODE",
        (f"{n}, {joined(p)}" for n, p in enumerate(points, 1)),
        "*ELEMENT, TYPE=C3D8I, ELSET=PART",
        (f"{n}, {joined(b)}" for n, b in enumerate(bricks, 1)),
        *(
            part
            for name, own in sets.items()
            for part in (f"*NSET, NSET={name}", map(str, own))
        ),
        "*MATERIAL, NAME=STEEL",
        f"*ELASTIC\n{E:g}, {NU:g}\n*DENSITY\n{DENSITY:g}",
        "*SOLID SECTION, ELSET=PART, MATERIAL=STEEL",
    )


def gmsh() -> str:
    """Version 2.2; sets are physical groups of quadrangles (3); bricks are type 5."""
    elements = [f"5 2 1 1 {joined(b)}" for b in bricks]
    for tag, own in ((2, faces["END"]), (3, faces["CLAMP"])):
        elements += [f"3 2 {tag} {tag} {joined(face)}" for face in own]
    return lines(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n3",
        '3 1 "PART"\n2 2 "END"\n2 3 "CLAMP"\n$EndPhysicalNames',
        f"$Nodes\n{len(points)}",
        (f"{n} {joined(p)}" for n, p in enumerate(points, 1)),
        f"$EndNodes\n$Elements\n{len(elements)}",
        (f"{n} {each}" for n, each in enumerate(elements, 1)),
        "$EndElements",
    ).replace(", ", " ")


def nastran() -> str:
    """Sets are surfaces of CQUAD4 whose properties, 2 and 3, are not defined."""
    shells = [(tag, f) for tag, own in ((2, "END"), (3, "CLAMP")) for f in faces[own]]
    return lines(
        "BEGIN BULK",
        (f"GRID,{n},,{joined(p)}" for n, p in enumerate(points, 1)),
        (
            f"CHEXA,{n},1,{joined(b[:6])},\n,{joined(b[6:])}"
            for n, b in enumerate(bricks, 1)
        ),
        (f"CQUAD4,{n},{tag},{joined(f)}" for n, (tag, f) in enumerate(shells, 1001)),
        f"PSOLID,1,1\nMAT1,1,{E:.1e},,{NU:g},{DENSITY:.1f}\nENDDATA",
    )


def ansys() -> str:
    """Fixed columns, as CDWRITE has them; sets are components of nodes."""
    rows = []
    for name, own in sets.items():
        rows.append(f"CMBLOCK,{name:8},NODE,{len(own):8}\n(8i10)")
        rows += [
            "".join(f"{n:10}" for n in own[i : i + 8]) for i in range(0, len(own), 8)
        ]
    bricks_ = (
        "".join(f"{v:9}" for v in (1, 1, 1, 1, 0, 0, 0, 0, 8, 0, n, *b))
        for n, b in enumerate(bricks, 1)
    )
    return lines(
        "/PREP7\nET,1,185\nKEYOPT,1,2,2",
        f"NBLOCK,6,SOLID,{len(points)},{len(points)}\n(3i9,6e21.13e3)",
        (
            f"{n:9}{0:9}{0:9}" + "".join(f"{x:21.13E}" for x in p)
            for n, p in enumerate(points, 1)
        ),
        "N,R5.3,LOC,-1,",
        f"EBLOCK,19,SOLID,{len(bricks)},{len(bricks)}\n(19i9)",
        bricks_,
        "-1",
        f"MP,EX,1,{E:g}\nMP,NUXY,1,{NU:g}\nMP,DENS,1,{DENSITY:g}",
        rows,
        "FINISH",
    )


for ending, deck in (("inp", abaqus), ("msh", gmsh), ("bdf", nastran), ("cdb", ansys)):
    with open(f"bracket.{ending}", "w", encoding="utf-8") as file:
        file.write(deck())
print(f"{len(points)} nodes, {len(bricks)} elements")
