"""Parts of quadratic tetrahedra: a reduction beside ten modes by CalculiX.

Gmsh (``pip install gmsh``) makes the meshes, CalculiX is ``ccx`` (Debian package
calculix-ccx). Both read the same deck with one thread. Where PyAMG is installed, larger
meshes follow without factors.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.eigensolvers.factorisation import engine_name

from .machine import describe_machine
from .report import Report, Table

MODES = 10
#: Room around the surfaces that hold a set [m].
SLACK = 1e-6
Box = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Part:
    """A part with the boxes around its surfaces NEAR, which is held, and FAR.

    build : function of `gmsh.model.occ` that returns the tag of the volume
    size : of the elements [m]
    """

    name: str
    build: Callable[[Any], int]
    near: Box
    far: Box
    size: float


def _cut(occ: Any, whole: int, *tools: int) -> int:
    found, _ = occ.cut([(3, whole)], [(3, tool) for tool in tools])
    return int(found[0][1])


def _fuse(occ: Any, first: int, *others: int) -> int:
    found, _ = occ.fuse([(3, first)], [(3, other) for other in others])
    return int(found[0][1])


def _rod(occ: Any) -> int:
    ends = occ.addCylinder(0, 0, 0, 0, 0, 0.02, 0.035)
    small = occ.addCylinder(0.16, 0, 0, 0, 0, 0.02, 0.022)
    web = occ.addBox(0, -0.01, 0.004, 0.16, 0.02, 0.012)
    bores = (
        occ.addCylinder(0, 0, 0, 0, 0, 0.02, 0.022),
        occ.addCylinder(0.16, 0, 0, 0, 0, 0.02, 0.012),
    )
    return _cut(occ, _fuse(occ, ends, small, web), *bores)


def _bracket(occ: Any) -> int:
    foot = occ.addBox(0, 0, 0, 0.12, 0.08, 0.012)
    wall = occ.addBox(0, 0, 0, 0.012, 0.08, 0.1)
    rib = occ.addBox(0, 0.034, 0, 0.06, 0.012, 0.06)
    hole = occ.addCylinder(-0.01, 0.04, 0.08, 0.04, 0, 0, 0.01)
    return _cut(occ, _fuse(occ, foot, wall, rib), hole)


def _arm(occ: Any) -> int:
    outside = occ.addBox(0, 0, 0, 0.6, 0.05, 0.05)
    return _cut(occ, outside, occ.addBox(0, 0.002, 0.002, 0.6, 0.046, 0.046))


def _gear(occ: Any) -> int:
    wheel, teeth = occ.addCylinder(0, 0, 0, 0, 0, 0.02, 0.05), []
    for angle in np.arange(24) * np.pi / 12:
        teeth.append(occ.addBox(0.045, -0.0035, 0, 0.012, 0.007, 0.02))
        occ.rotate([(3, teeth[-1])], 0, 0, 0, 0, 0, 1, angle)
    return _cut(
        occ, _fuse(occ, wheel, *teeth), occ.addCylinder(0, 0, 0, 0, 0, 0.02, 0.012)
    )


def _housing(occ: Any) -> int:
    outside = occ.addBox(0, 0, 0, 0.24, 0.16, 0.12)
    shell = _cut(occ, outside, occ.addBox(0.004, 0.004, 0.004, 0.232, 0.152, 0.116))
    boss = occ.addCylinder(0.236, 0.08, 0.06, 0.02, 0, 0, 0.02)
    return _cut(
        occ,
        _fuse(occ, shell, boss),
        occ.addCylinder(0.23, 0.08, 0.06, 0.04, 0, 0, 0.012),
    )


ROD = Part(
    "connecting rod",
    _rod,
    (-0.022, -0.022, 0, 0.022, 0.022, 0.02),
    (0.148, -0.012, 0, 0.172, 0.012, 0.02),
    0.0031,
)
PARTS = (
    ROD,
    replace(ROD, name="connecting rod, finer", size=0.00195),
    Part(
        "bracket",
        _bracket,
        (0.12, 0, 0, 0.12, 0.08, 0.012),
        (0, 0.03, 0.07, 0.012, 0.05, 0.09),
        0.0044,
    ),
    Part(
        "thin arm", _arm, (0, 0, 0, 0, 0.05, 0.05), (0.6, 0, 0, 0.6, 0.05, 0.05), 0.0085
    ),
    Part(
        "gear",
        _gear,
        (-0.012, -0.012, 0, 0.012, 0.012, 0.02),
        (0.057, -0.0035, 0, 0.057, 0.0035, 0.02),
        0.0043,
    ),
    Part(
        "housing",
        _housing,
        (0, 0, 0, 0.24, 0.16, 0),
        (0.256, 0.06, 0.04, 0.256, 0.1, 0.08),
        0.0088,
    ),
)
#: Meshes for `--engine multigrid`.
WITHOUT_FACTORS = (
    PARTS[1],
    replace(ROD, name="connecting rod, a million", size=0.00129),
)


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure every part; an empty report where a program is not installed."""
    title = "Large parts beside CalculiX"
    try:
        import gmsh  # noqa: F401
    except ImportError:
        return Report(title, [], ["gmsh is not installed."])
    if shutil.which("ccx") is None:
        return Report(title, [], ["ccx is not installed (Debian: calculix-ccx)."])
    rows = []
    for part in PARTS:
        with tempfile.TemporaryDirectory() as place:
            rows.append(_row(part, Path(place)))
        say("  " + ", ".join(rows[-1]))
    header = ["part", "unknowns", "sidtool s", "GB", "CalculiX s", "GB", "time ratio"]
    caption = (
        f"Processor seconds and peak memory, one thread: Craig-Bampton with {MODES} "
        "modes, six static shapes, two rigid ties and the measured errors of the "
        f"basis by {engine_name()}, and {MODES} clamped modes by CalculiX."
    )
    remarks = [f"The same meshes of tet10 by Gmsh; f1 to f{MODES} are not compared."]
    tables = [Table(caption, header, rows, True)]
    if find_spec("pyamg"):
        rows = [_row_without_factors(part, say) for part in WITHOUT_FACTORS]
        header = ["part", "unknowns", "processor s", "s", "GB"]
        caption = "The same by --engine multigrid, on all processors."
        tables.append(Table(caption, header, rows))
    return Report(title, tables, remarks, machine=describe_machine())


def _row_without_factors(part: Part, say: Callable[[str], None]) -> list[str]:
    with tempfile.TemporaryDirectory() as place:
        count = _write_deck(part, Path(place))
        start = time.perf_counter()
        seconds, memory = _cost(_conversion(Path(place), "multigrid"), Path(place))
        elapsed = time.perf_counter() - start
    row = [part.name, str(3 * count), f"{seconds:.0f}", f"{elapsed:.0f}"]
    row.append(f"{memory:.1f}")
    say("  " + ", ".join(row))
    return row


def _conversion(place: Path, *engine: str) -> list[str]:
    """The command that reduces part.inp, whose model it writes."""
    (place / "part.json").write_text(json.dumps(_model()), encoding="utf-8")
    command = [sys.executable, "-m", "sidtool", "convert", "part.json", "-o", "part.h5"]
    return [*command, *(f"--engine={name}" for name in engine)]


def _row(part: Part, place: Path) -> list[str]:
    count = _write_deck(part, place)
    mine, theirs = _cost(_conversion(place), place), _cost(["ccx", "part"], place)
    cells = [part.name, str(3 * count)]
    for seconds, memory in (mine, theirs):
        cells += [f"{seconds:.1f}", f"{memory:.2f}"]
    return [*cells, f"{theirs[0] / mine[0]:.2f}"]


def _cost(command: Sequence[str], place: Path) -> tuple[float, float]:
    """Processor seconds and peak gigabytes of a program and all that it starts."""
    one = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    code = (
        "import json, resource, subprocess, sys\n"
        "done = subprocess.run(sys.argv[1:], capture_output=True)\n"
        "used = resource.getrusage(resource.RUSAGE_CHILDREN)\n"
        "print(json.dumps([done.returncode, used.ru_utime + used.ru_stime, "
        "used.ru_maxrss]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *command],
        cwd=place,
        env=os.environ | one,
        capture_output=True,
        check=True,
    )
    status, seconds, kilobytes = json.loads(done.stdout)
    if status != 0:
        raise RuntimeError(f"{command[0]} ended with status {status}")
    return float(seconds), kilobytes / 1e6


def _model() -> dict[str, Any]:
    def marker(node: int, name: str) -> dict[str, Any]:
        return {"node": node, "tie": {"type": "rigid", "to": name}}

    return {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "mesh", "file": "part.inp"},
        "discretisation": {"type": "mesh"},
        "frame": {"type": "tangent", "marker": "near", "clamp": "NEAR"},
        "markers": {"near": marker(1, "NEAR"), "far": marker(2, "FAR")},
        "reduction": {
            "method": "craig_bampton",
            "interfaces": ["far"],
            "modes": MODES,
        },
    }


def _write_deck(part: Part, place: Path) -> int:
    """Write part.inp, which both programs read; the number of nodes."""
    import gmsh

    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        part.build(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", part.size)
        gmsh.option.setNumber("Mesh.MeshSizeMin", part.size)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        tags, places, _ = gmsh.model.mesh.getNodes()
        number = np.zeros(int(tags.max()) + 1, int)
        (_,), (elements,), (nodes,) = gmsh.model.mesh.getElements(3)
        used = np.unique(nodes)
        number[used] = np.arange(1, len(used) + 1)
        positions = np.zeros((int(tags.max()) + 1, 3))
        positions[tags] = places.reshape(-1, 3)
        # Gmsh counts the last two nodes in the middle of edges in the other order.
        corners = number[nodes.reshape(len(elements), 10)]
        corners = corners[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]
        sets = {
            name: number[_nodes_of_surfaces(gmsh, box)]
            for name, box in (("NEAR", part.near), ("FAR", part.far))
        }
    finally:
        gmsh.finalize()
    with (place / "part.inp").open("w", encoding="utf-8") as file:
        file.write("*NODE, NSET=ALL\n")
        for label, (x, y, z) in enumerate(positions[used].tolist(), 1):
            file.write(f"{label}, {x:.12g}, {y:.12g}, {z:.12g}\n")
        file.write("*ELEMENT, TYPE=C3D10, ELSET=PART\n")
        for label, row in enumerate(corners.tolist(), 1):
            file.write(f"{label}, {', '.join(map(str, row))}\n")
        for name, members in sets.items():
            file.write(f"*NSET, NSET={name}\n")
            file.writelines(f"{member},\n" for member in members.tolist())
        file.write(
            "*MATERIAL, NAME=STEEL\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7850.\n"
            "*SOLID SECTION, ELSET=PART, MATERIAL=STEEL\n*BOUNDARY\nNEAR, 1, 3\n"
            f"*STEP\n*FREQUENCY\n{MODES}\n*END STEP\n"
        )
    return len(used)


def _nodes_of_surfaces(gmsh: Any, box: Box) -> Any:
    """Tags of all nodes of the surfaces in a box."""
    low, high = (np.array(end) for end in (box[:3], box[3:]))
    inside = gmsh.model.getEntitiesInBoundingBox(*(low - SLACK), *(high + SLACK), 2)
    found = [
        gmsh.model.mesh.getNodes(2, tag, includeBoundary=True)[0] for _, tag in inside
    ]
    return np.unique(np.concatenate(found)).astype(int)
