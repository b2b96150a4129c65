"""CalculiX as an engine: matrices and expanded mesh of a deck's free body.

CalculiX makes solids of shells and beams. It writes the matrices of the independent
degrees of freedom (``*FREQUENCY, SOLVER=MATRIXSTORAGE``: .sti, .mas, .dof), and the
solids with their nodes to six digits (.frd).
The free body of a deck has no steps, supports, loads and point masses.
"""

import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import real_of_text
from sidtool.formats.base.sid import Array
from sidtool.formats.storage.operating_system import processors

from ..mesh.deck_text import (
    IncludedFiles,
    RefusalCollector,
    named_file,
    parse_numbers,
    read_lines,
)
from ..mesh.imported_mesh import ONLY_NODES
from ..mesh.mesh import ElementBlock
from .abaqus.deck import POINTS, Namespace
from .abaqus.input_file import read_deck

#: Supports, which the frame of the model file replaces, and point masses, which are
#: added to the matrices: CalculiX would couple them to shells and beams by equations.
_LEFT_OUT = ("BOUNDARY", "BOUNDARYF", "SUBMODEL", "MASS", "ROTARYINERTIA")
#: Numbers of an element in its first line.
_PER_LINE = 12
#: Characters of a number that CalculiX reads.
_MAX_NUMBER_LENGTH = 20
#: Generation that CalculiX does not have, and its replacement.
_GENERATION = ("NGEN", "NFILL", "NCOPY", "ELGEN", "ELCOPY")
_NAMING = ("NODE", "SYSTEM", "ELEMENT", "NSET", "ELSET", *_GENERATION)
#: What ends the keywords of a material.
_AFTER_MATERIALS = (
    *("MATERIAL", "SOLIDSECTION", "SHELLSECTION", "BEAMSECTION", "MEMBRANESECTION"),
    *("NODE", "ELEMENT", "NSET", "ELSET", "ORIENTATION", "STEP", "SURFACE", "MASS"),
    *("AMPLITUDE", "BEAMGENERALSECTION", "EQUATION", "MPC", "TRANSFORM", "TIE"),
    *("NODALTHICKNESS", "NORMAL", "RIGIDBODY", "COUPLING", "PHYSICALCONSTANTS"),
)
#: Keywords with which a deck is not one free, linear body.
_REFUSED = {
    "CONTACTPAIR": "one body without contact",
    "CYCLICSYMMETRYMODEL": "a mesh of the whole body",
    "PRE-TENSIONSECTION": "a deck without bolts under tension",
    "DISTRIBUTING": "a marker with a distributing tie: CalculiX couples forces alone",
    "GAP": "one body without contact",
    "PART": "a flat deck, as CalculiX reads it",
    "INSTANCE": "a flat deck, as CalculiX reads it",
    "USERMATERIAL": "a linear elastic material",
}


def free_deck(path: Path, ignored: frozenset[str] = frozenset()) -> list[str]:
    """Return the lines of a deck with its included files, without steps, supports,
    masses.

    Parameters
    ----------
    ignored : keywords that are ignored on purpose, in capitals

    Raises
    ------
    InputError : a file cannot be read, or a keyword makes it more than one body.
    """
    dropped = {"".join(word.split()) for word in (*_LEFT_OUT, *ignored)}
    lines = list(_deck_lines(path, IncludedFiles()))
    result: list[str] = []
    if any(_is_generation(text) for text, _ in lines):
        dropped |= set(_NAMING)
        body = read_deck(path, frozenset((ONLY_NODES,))).assembly
        result += [_shorten_line(text) for text in _explicit_lines(body)]
    stops, keep, in_step = RefusalCollector(), True, False
    for text, place in lines:
        if text.startswith("**"):
            continue
        if text.startswith("*"):
            keyword = _keyword_of(text)
            in_step = keyword == "STEP" or (in_step and keyword != "ENDSTEP")
            keep = not in_step and keyword != "ENDSTEP" and keyword not in dropped
            keep = keep and not _is_mass_element(text)
            if keep and keyword in _REFUSED:
                name = text[1:].split(",")[0].strip().upper()
                error = InputError(
                    f"*{name} is not supported",
                    source=path,
                    place=place,
                    expected=_REFUSED[keyword],
                )
                stops.add(error, name)
        if keep:
            result.append(text if text.startswith("*") else _shorten_line(text))
    stops.check()
    return result


def _explicit_lines(body: Namespace) -> Iterator[str]:
    """The nodes, elements and sets of a deck without generation."""
    yield "*NODE"
    yield from (f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in body.nodes.items())
    for element in body.elements.values():
        if element.given in POINTS:
            continue
        yield f"*ELEMENT, TYPE={element.given}"
        words = [str(n) for n in (element.label, *element.nodes)]
        yield ", ".join(words[:_PER_LINE]) + ("," if words[_PER_LINE:] else "")
        yield from [", ".join(words[_PER_LINE:])] if words[_PER_LINE:] else []
    for kind, sets in (("NSET", body.nsets), ("ELSET", body.elsets)):
        for name, group in sets.items():
            yield f"*{kind}, {kind}={name}"
            yield from (f"{label}," for _, label in dict.fromkeys(group))


def _is_generation(text: str) -> bool:
    """Return whether a line generates nodes or elements in a way that CalculiX does not
    have.
    """
    if not text.startswith("*"):
        return False
    turned = "SYSTEM=" in "".join(text.upper().split())
    if _keyword_of(text) in ("SYSTEM", *_GENERATION):
        return True
    return _keyword_of(text) == "NODE" and turned


def _is_mass_element(text: str) -> bool:
    """Whether a line is *ELEMENT of point masses."""
    options = "".join(text.upper().split()).split(",")
    types = {f"TYPE={name}" for name in POINTS}
    return options[0] == "*ELEMENT" and not types.isdisjoint(options)


def _keyword_of(text: str) -> str:
    return "".join(text[1:].split(",")[0].upper().split())


def _shorten_line(text: str) -> str:
    """Return a data line with shortened numbers: CalculiX truncates long ones."""
    words = text.split(",")
    if all(len(word.strip()) <= _MAX_NUMBER_LENGTH for word in words):
        return text
    return ",".join(_shorten_number(word.strip()) for word in words)


def _shorten_number(word: str) -> str:
    try:
        long = len(word) > _MAX_NUMBER_LENGTH
        return f"{real_of_text(word):.12e}" if long else word
    except ValueError:
        return word


def with_density(lines: list[str], density: float) -> list[str]:
    """The deck with a density for materials that have none."""
    result: list[str] = []
    lacks_density = False
    for text in [*lines, "*"]:
        keyword = _keyword_of(text) if text.startswith("*") else ""
        if keyword == "DENSITY":
            lacks_density = False
        if lacks_density and (text == "*" or keyword in _AFTER_MATERIALS):
            result += ["*DENSITY", f"{density!r}"]
            lacks_density = False
        if keyword == "MATERIAL":
            lacks_density = True
        result.append(text)
    return result[:-1]


def centre_nodes(lines: list[str]) -> tuple[list[str], Array]:
    """Return the deck with its nodes relative to their centre, and the centre (3,).

    CalculiX writes positions to six digits, which are more exact for small bodies
    there.
    """
    rows = [i for i, line in _data_lines(lines, "NODE")]
    table = np.zeros((len(rows), 3))
    for k, i in enumerate(rows):
        label, *words = (word.strip() for word in lines[i].split(","))
        given = [word or "0" for word in words[:3]]
        table[k, : len(given)] = parse_numbers(given, f"node {label}", "coordinates")
    centre = table.mean(axis=0) if rows else np.zeros(3)
    result = list(lines)
    for i, place in zip(rows, (table - centre).tolist(), strict=True):
        label = lines[i].split(",")[0]
        result[i] = ", ".join([label, *(f"{x:.12e}" for x in place)])
    return result, centre


def _data_lines(lines: list[str], keyword: str) -> Iterator[tuple[int, str]]:
    """The data lines of a keyword, and which lines they are."""
    inside = False
    for i, text in enumerate(lines):
        if text.startswith("*"):
            inside = _keyword_of(text) == keyword
        elif inside:
            yield i, text


def without_layers(lines: list[str]) -> list[str]:
    """Return the deck with the layers of composite shells merged to one. CalculiX
    writes the mesh of the layers of composites; the mesh of one layer has the nodes of
    the matrices.
    """
    result: list[str] = []
    layers: list[list[str]] = []
    for text in [*lines, "*"]:
        if layers and not text.startswith("*"):
            layers.append(text.split(","))
            continue
        if layers:
            head, *rows = layers
            words = [row[0] for row in rows]
            thickness = sum(parse_numbers(words, "*SHELL SECTION", "thicknesses"))
            result += [
                f"{','.join(head)},MATERIAL={rows[0][2].strip()}",
                f"{thickness!r}",
            ]
            layers = []
        options = [word.strip() for word in text.split(",")]
        upper = [word.upper() for word in options]
        if "".join(upper[0].split()) == "*SHELLSECTION" and "COMPOSITE" in upper:
            other_options = [
                w for w, u in zip(options, upper, strict=True) if u != "COMPOSITE"
            ]
            layers = [
                [w for w in other_options if not w.upper().startswith("ORIENTATION")]
            ]
        else:
            result.append(text)
    return result[:-1]


def _deck_lines(path: Path, included: IncludedFiles) -> Iterator[tuple[str, str]]:
    included.enter(path)
    for number, line in enumerate(read_lines(path), start=1):
        text, place = line.strip(), f"line {number}"
        word, _, rest = text.partition(",")
        if "".join(word.upper().split()) == "*INCLUDE":
            yield from _deck_lines(
                named_file(path, _included_file(rest, place)), included
            )
        elif _names_data(word) and "INPUT=" in "".join(rest.upper().split()):
            options = rest.split(",")
            own = [x for x in options if not x.strip().upper().startswith("INPUT")]
            yield ",".join([word, *own]), place
            yield from _deck_lines(
                named_file(path, _included_file(rest, place)), included
            )
        elif text:
            yield text, place
    included.open.pop()


def _names_data(word: str) -> bool:
    """Whether the file that a keyword names continues the deck."""
    return word.startswith("*") and _keyword_of(word) in ("NODE", "ELEMENT")


def _included_file(options: str, place: str) -> str:
    for option in options.split(","):
        name, _, value = option.partition("=")
        if name.strip().upper() == "INPUT" and value.strip():
            return value.strip().strip('"')
    raise InputError("names no file", place=place, expected="INPUT=FILE")


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
