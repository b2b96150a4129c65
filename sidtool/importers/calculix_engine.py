"""CalculiX as an engine: matrices and expanded mesh of a deck's free body.

CalculiX makes solids of shells and beams. It writes the matrices of the independent
degrees of freedom (``*FREQUENCY, SOLVER=MATRIXSTORAGE``: .sti, .mas, .dof), and the
solids with their nodes to six digits (.frd).
"""

import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.storage.operating_system import processors

from ..mesh.mesh import ElementBlock
from .calculix_deck import centre_nodes, without_layers

Indices = NDArray[np.int64]

#: Steps without supports and loads: what writes matrices, and what writes the mesh.
_MATRICES = "*STEP\n*FREQUENCY, SOLVER=MATRIXSTORAGE\n*END STEP\n"
_MESH = "*STEP\n*NO ANALYSIS\n*NODE FILE, OUTPUT=3D\nU\n*END STEP\n"
#: Number of an element type in .frd -> our name and its number of nodes.
_KINDS = {
    1: ("hex8", 8),
    2: ("wedge6", 6),
    3: ("tet4", 4),
    4: ("hex20", 20),
    5: ("wedge15", 15),
    6: ("tet10", 10),
}
#: .frd has the upright edges before those of the top.
_ORDERS = {
    "hex20": (*range(12), *range(16, 20), *range(12, 16)),
    "wedge15": (*range(9), *range(12, 15), *range(9, 12)),
}
#: Ending of what a job writes -> its name.
_PRODUCTS = {".dof": "matrices", ".frd": "mesh"}
#: Seconds between two reports of a job.
_REPORT_INTERVAL = 10.0
_PROBLEM = re.compile(
    r"^ *\*(ERROR|WARNING)(.*(?:(?<=:)\n.*)?(?:\n {6,}\S.*)*)", re.MULTILINE
)


@dataclass(frozen=True, eq=False)
class CalculixResult:
    """Results of CalculiX for a deck, in the units of the deck.

    Attributes
    ----------
    stiffness, mass : (ndof, ndof) sparse
    dofs : (ndof, 2) node of the deck that a row belongs to, or was expanded from, and
        the direction; nodes of internal modes have numbers beyond those of the deck
    nodes : numbers of the nodes of the expanded mesh, in the order of `positions`
    positions : (n, 3) relative to `centre`, to six digits
    centre : (3,) of the nodes of the deck
    blocks : the solids, by rows of `positions`
    warnings : warnings of CalculiX, each once
    """

    stiffness: sp.csr_matrix
    mass: sp.csr_matrix
    dofs: Indices
    nodes: Indices
    positions: Array
    centre: Array
    blocks: tuple[ElementBlock, ...]
    warnings: tuple[str, ...]


def is_installed() -> bool:
    """Whether there is CalculiX (``ccx``)."""
    return shutil.which("ccx") is not None


def run_calculix(
    lines: list[str], source: Path, report: Callable[[str], None] = lambda _: None
) -> CalculixResult:
    """Compute matrices and mesh of a deck's free body by CalculiX (``ccx``).

    Parameters
    ----------
    lines : lines of the deck, without steps
    source : file that messages name
    report : called from time to time with what CalculiX does

    Raises
    ------
    InputError : CalculiX is not installed, or refuses the deck.
    """
    if not is_installed():
        raise InputError(
            "CalculiX (ccx) is not installed",
            place="geometry.engine",
            expected="ccx on the path: apt install calculix-ccx, or from calculix.de",
        )
    moved, centre = centre_nodes(lines)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        jobs = (
            ("body", [*lines, _MATRICES], ".dof"),
            ("mesh", [*without_layers(moved), _MESH], ".frd"),
        )
        messages, _ = (
            _run_job(folder, job, text, source, product, report)
            for job, text, product in jobs
        )
        report("reading the matrices of CalculiX")
        dofs = np.array(
            [
                line.split(".")
                for line in (folder / "body.dof").read_text(encoding="utf-8").split()
            ],
            np.int64,
        ).reshape(-1, 2)
        nodes, positions, blocks = read_frd(folder / "mesh.frd")
        return CalculixResult(
            _read_matrix(folder / "body.sti", len(dofs)),
            _read_matrix(folder / "body.mas", len(dofs)),
            dofs,
            nodes,
            positions + centre,
            centre,
            blocks,
            messages,
        )


def _run_job(
    folder: Path,
    job: str,
    lines: list[str],
    source: Path,
    product: str,
    report: Callable[[str], None],
) -> tuple[str, ...]:
    """Run a job and return its warnings."""
    text = "\n".join(lines)
    (folder / f"{job}.inp").write_text(text, "latin-1", errors="replace")
    with (
        (folder / f"{job}.out").open("wb") as output,
        subprocess.Popen(
            ["ccx", job],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, "OMP_NUM_THREADS": str(processors())},
        ) as process,
    ):
        _wait(process, f"CalculiX writes the {_PRODUCTS[product]}", report)
    text = (folder / f"{job}.out").read_text("latin-1")
    problems = _PROBLEM.findall(text)
    messages = [(kind, " ".join(message.split())) for kind, message in problems]
    errors = [message for kind, message in messages if kind == "ERROR"]
    result = folder / f"{job}{product}"
    if (
        errors
        or process.returncode < 0
        or not result.exists()
        or not result.stat().st_size
    ):
        says = errors[0] if errors else "nothing, and ended early"
        raise InputError(
            f"CalculiX says: {says}",
            source=source,
            expected="*DENSITY of all materials, or geometry.density"
            if "no density" in says
            else "a deck that CalculiX solves",
        )
    return tuple(dict.fromkeys(m for kind, m in messages if kind == "WARNING"))


def _wait(
    process: subprocess.Popen[bytes], what: str, report: Callable[[str], None]
) -> None:
    """Wait for a process, which an interruption ends, too."""
    begin = time.monotonic()
    try:
        while True:
            try:
                process.wait(_REPORT_INTERVAL)
            except subprocess.TimeoutExpired:
                report(f"{what}, for {time.monotonic() - begin:.0f} s now")
            else:
                return
    except BaseException:
        process.kill()
        raise


def _read_matrix(path: Path, size: int) -> sp.csr_matrix:
    """A symmetric matrix from its upper triangle: lines of row, column, value."""
    table = np.fromfile(path, sep=" ").reshape(-1, 3)
    i, j = table[:, :2].astype(np.int64).T - 1
    half = sp.csr_matrix((table[:, 2], (i, j)), shape=(size, size))
    return sp.csr_matrix(half + half.T - sp.diags_array(half.diagonal()))


def read_frd(path: Path) -> tuple[Indices, Array, tuple[ElementBlock, ...]]:
    """Read node numbers, positions and solids of the mesh of a .frd file.

    Only nodes of solids are returned.

    Raises
    ------
    InputError : an element has a node without a position.
    """
    places: dict[int, list[float]] = {}
    kinds: dict[str, list[list[int]]] = {}
    labels: dict[str, list[int]] = {}
    reading, wanted = "", 0
    nodes: list[int] = []
    for line in path.read_text("latin-1").splitlines():
        key = line[:6].strip()
        if key in ("2C", "3C"):
            reading = key
        elif line.startswith(" -3"):
            reading = ""
        elif reading == "2C":
            places[int(line[3:13])] = [
                float(line[k : k + 12]) for k in range(13, 49, 12)
            ]
        elif reading == "3C" and line.startswith(" -1"):
            kind, wanted = _KINDS.get(int(line[13:18]), ("", 0))
            nodes = []
            if kind:
                kinds.setdefault(kind, []).append(nodes)
                labels.setdefault(kind, []).append(int(line[3:13]))
        elif reading == "3C" and len(nodes) < wanted:
            nodes += [int(line[k : k + 10]) for k in range(3, len(line.rstrip()), 10)]
    used = sorted({n for rows in kinds.values() for row in rows for n in row})
    if undefined := [n for n in used if n not in places]:
        raise InputError(
            f"CalculiX writes an element of node {undefined[0]}, which has no position",
            expected="elements of defined nodes",
        )
    row = {n: i for i, n in enumerate(used)}
    blocks = []
    for kind, listed in kinds.items():
        order = _ORDERS.get(kind, tuple(range(len(listed[0]))))
        blocks.append(
            ElementBlock(
                kind,
                np.array([[row[e[k]] for k in order] for e in listed], np.int64),
                np.array(labels[kind], np.int64),
            )
        )
    positions = np.array([places[n] for n in used]).reshape(-1, 3)
    return np.array(used, np.int64), positions, tuple(blocks)
