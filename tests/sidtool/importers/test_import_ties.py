"""*EQUATION, *MPC and *TIE of decks: meshes that move as one body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

from sidtool.cli.main import cli
from sidtool.discretisation.registry import finite_element_model
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import WARNING
from sidtool.formats.model import read_model
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.reduction.admissible_space import constrained_space
from sidtool.reduction.body_frames import buckens_frame
from tests.codes import only, with_code

from .decks import MATERIAL, STEEL, Block, body, calculix, deck, deck_file, frequencies

SIZE = (0.3, 0.05, 0.04)
SECTIONS = "*SOLID SECTION, ELSET=E, MATERIAL=S\n\n"
AWAY = 1000


class Part:
    """A block that is moved, turned in its numbers, and its faces at both ends in x."""

    def __init__(
        self,
        counts: tuple[int, int, int],
        start: float,
        first: int,
        size: tuple[float, float, float] = SIZE,
    ) -> None:
        self.block = Block(counts, size)
        self.first, self.counts = first, counts
        self.points = [(x + start, y, z) for x, y, z in self.block.points]
        rows = range(len(self.block.elements))
        across = counts[1] * counts[2]
        self.low = [i + first + 1 for i in rows if i < across]
        self.high = [i + first + 1 for i in rows if i >= len(rows) - across]
        self.left = [n + first for n in sorted(self.block.left)]
        self.right = [n + first for n in sorted(self.block.right)]

    def text(self, kind: str = "C3D8I") -> str:
        nodes = [
            f"{i + self.first}, " + ", ".join(map(repr, p))
            for i, p in enumerate(self.points, 1)
        ]
        elements = [
            f"{i + self.first}, " + ", ".join(str(n + self.first) for n in e)
            for i, e in enumerate(self.block.elements, 1)
        ]
        head = f"*ELEMENT, TYPE={kind}, ELSET=E"
        return "\n".join(["*NODE", *nodes, head, *elements, ""])

    def surface(self, name: str, elements: list[int], face: str) -> str:
        lines = [f"{element}, {face}" for element in elements]
        return "\n".join([f"*SURFACE, NAME={name}", *lines, ""])


def two(left: tuple[int, int, int], right: tuple[int, int, int]) -> tuple[Part, Part]:
    return Part(left, 0.0, 0), Part(right, SIZE[0], AWAY)


def whole(parts: tuple[Part, Part], *tied: str, kind: str = "C3D8I") -> str:
    head = "".join(part.text(kind) for part in parts)
    return head + "".join(tied) + MATERIAL.format(**STEEL) + SECTIONS


def surface_tie(parts: tuple[Part, Part], *, slave: int = 0, options: str = "") -> str:
    """The right end of the first on the left end of the second, by surfaces.

    x runs through the faces S4 and S6 of an element in this numbering: 2-3 and 4-1.
    """
    first = parts[0].surface("A", parts[0].high, "S4")
    second = parts[1].surface("B", parts[1].low, "S6")
    names = "A, B" if slave == 0 else "B, A"
    return first + second + f"*TIE, NAME=T{options}\n{names}\n"


def pairs(parts: tuple[Part, Part]) -> list[tuple[int, int]]:
    return list(zip(parts[0].right, parts[1].left, strict=True))


def equation_tie(parts: tuple[Part, Part]) -> str:
    lines = ["*EQUATION"]
    for a, b in pairs(parts):
        for i in (1, 2, 3):
            lines += ["2", f"{a}, {i}, 2.5, {b}, {i}, -2.5"]
    return "\n".join([*lines, ""])


def through_free_nodes(parts: tuple[Part, Part]) -> str:
    """Every pair follows a node of its own that no element uses."""
    lines, extra = ["*EQUATION"], ["*NODE"]
    for k, (a, b) in enumerate(pairs(parts)):
        node = 9 * AWAY + k
        extra.append(f"{node}, 7., {k}., -3.")
        for i in (1, 2, 3):
            lines += ["2", f"{a}, {i}, 1., {node}, {i}, -0.5"]
            lines += ["2", f"{node}, {i}, -3., {b}, {i}, 6."]
    return "\n".join([*extra, *lines, ""])


def in_turned_axes(parts: tuple[Part, Part]) -> str:
    """Equations of all three directions of axes that turn from node to node."""
    held = sorted({*parts[0].right, *parts[1].left})
    rows = "\n".join(f"{n}," for n in held)
    head = f"*NSET, NSET=BOTH\n{rows}\n*TRANSFORM, NSET=BOTH, TYPE=C\n"
    return head + "0.1, -0.2, 0.5, 0.9, 0.4, 0.1\n" + equation_tie(parts)


def multi_point(parts: tuple[Part, Part]) -> str:
    rows = "".join(f"TIE, {a}, {b}\n" for a, b in pairs(parts))
    return "*MPC\n" + rows


@pytest.fixture(scope="module")
def merged(tmp_path_factory: pytest.TempPathFactory) -> SID:
    """Two parts whose elements have common nodes."""
    parts = two((3, 2, 2), (4, 2, 2))
    text = whole(parts)
    for a, b in pairs(parts):
        text = _renumbered(text, b, a)
    return body(tmp_path_factory.mktemp("merged"), text)


@pytest.mark.parametrize(
    "tied",
    [equation_tie, through_free_nodes, in_turned_axes, multi_point, surface_tie],
)
def test_matching_meshes_that_are_tied_are_one_mesh(
    tied, tmp_path: Path, merged: SID
) -> None:
    """Reference: the same elements with common nodes."""
    parts = two((3, 2, 2), (4, 2, 2))
    sid = body(tmp_path, whole(parts, tied(parts)))
    assert_allclose(frequencies(sid), frequencies(merged), rtol=1e-7)
    assert_allclose(sid.mass, merged.mass, rtol=1e-12)
    assert_allclose(sid.J.m0, merged.J.m0, rtol=1e-9, atol=1e-12)


def _renumbered(text: str, old: int, new: int) -> str:
    """The deck with one node instead of another, which is left out."""
    lines = []
    for line in text.splitlines():
        words = line.split(", ")
        if words[0] == str(old) and "." in line:
            continue
        if line[:1].isdecimal() and "." not in line:
            words[1:] = [str(new) if word == str(old) else word for word in words[1:]]
        lines.append(", ".join(words))
    return "\n".join([*lines, ""])


def discretised(folder: Path, text: str, **more: object) -> FiniteElementModel:
    return finite_element_model(read_model(deck_file(folder, text, **more)))


def stretched(model: FiniteElementModel) -> tuple[np.ndarray, np.ndarray]:
    """Displacements under unit tension along x, and the exact ones, free of motion."""
    space = constrained_space(model, buckens_frame(model, _Buckens()))
    x = model.positions[:, 0]
    loads = np.zeros((model.ndof, 1))
    for end, sign in ((x.min(), -1.0), (x.max(), 1.0)):
        nodes = np.flatnonzero(np.abs(x - end) < 1e-9)
        surface = model.surface(("END",) if sign > 0 else ("START",))
        assert surface is not None
        weights = np.asarray(surface.mass.sum(axis=0)).ravel()
        loads[3 * nodes, 0] = sign * weights[nodes]
    found = space.static(loads)[:, 0].reshape(-1, 3)
    exact = model.positions * np.array([1.0, -STEEL["nu"], -STEEL["nu"]]) / STEEL["e"]
    rigid = model.rigid_body_modes()
    shares = np.linalg.lstsq(rigid, (found - exact).ravel(), rcond=None)[0]
    return found, exact + (rigid @ shares).reshape(-1, 3)


class _Buckens:
    marker = None


def ends(parts: tuple[Part, Part]) -> str:
    sets = {"START": parts[0].left, "END": parts[1].right}
    return "".join(
        f"*NSET, NSET={name}\n" + "\n".join(f"{n}," for n in nodes) + "\n"
        for name, nodes in sets.items()
    )


@pytest.mark.parametrize("slave", [0, 1])
@pytest.mark.parametrize(
    "counts", [((2, 2, 2), (3, 3, 3)), ((1, 1, 3), (2, 4, 1)), ((2, 3, 2), (1, 5, 7))]
)
def test_a_uniform_stress_passes_a_tie_of_other_meshes(
    counts, slave: int, tmp_path: Path
) -> None:
    parts = two(*counts)
    text = whole(parts, surface_tie(parts, slave=slave), ends(parts))
    found, exact = stretched(discretised(tmp_path, text))
    assert_allclose(found, exact, atol=1e-9 * np.abs(exact).max())


def tied_bar() -> str:
    parts = two((8, 2, 3), (8, 3, 2))
    return whole(parts, surface_tie(parts))


def test_a_tied_bar_is_as_stiff_as_a_whole_one(tmp_path: Path) -> None:
    """Reference: the bar of one mesh, as fine along it."""
    found = frequencies(body(tmp_path, tied_bar()))
    one = Block((16, 3, 3), (2 * SIZE[0], *SIZE[1:]))
    exact = frequencies(body(tmp_path, deck(one, "C3D8I")))
    assert_allclose(found, exact, rtol=5e-3)


def bars_tied_by_nodes() -> tuple[str, str]:
    """Fine on coarse, node by node, and the same with surfaces that are tied."""
    parts = two((8, 4, 4), (8, 2, 3))
    sides = surface_tie(parts)
    ends = (*parts[0].right, *parts[0].left)
    nodes = "*NSET, NSET=N\n" + "".join(f"{n},\n" for n in ends)
    nodes += "*SURFACE, NAME=NODES, TYPE=NODE\nN,\n"
    by_nodes = whole(parts, nodes + sides.replace("\nA, B\n", "\nNODES, B\n"))
    return by_nodes, whole(parts, sides)


def test_nodes_that_are_tied_one_by_one(tmp_path: Path) -> None:
    """Nodes of the slave side that are far from the master stay free."""
    sids = [body(tmp_path, text) for text in bars_tied_by_nodes()]
    by_nodes, surfaces = map(frequencies, sids)
    assert_allclose(by_nodes, surfaces, rtol=1e-2)
    free = only(sids[0], "N124")
    assert (free.severity, free.subject) == (WARNING, "tie T")
    assert free.data["count"] == 25 and not with_code(sids[1], "N124")


@pytest.mark.needs("ccx")
@pytest.mark.parametrize(
    "text", [tied_bar(), bars_tied_by_nodes()[0]], ids=["surfaces", "nodes"]
)
def test_ties_are_those_of_calculix(text: str, tmp_path: Path) -> None:
    """It holds nodes on faces, which makes the tie of surfaces softer."""
    found = frequencies(body(tmp_path, text))
    assert_allclose(found, calculix(tmp_path, text, None), rtol=2e-2)


def test_a_tie_across_a_gap_does_not_hold_the_body(tmp_path: Path) -> None:
    """Sides that are 1.5 mm apart: six rigid motions, and the bar's own bending."""
    parts = Part((6, 2, 2), 0.0, 0), Part((6, 3, 3), SIZE[0] + 1.5e-3, AWAY)
    tie = surface_tie(parts, options=", POSITION TOLERANCE=0.002, ADJUST=NO")
    model = discretised(tmp_path, whole(parts, tie))
    space = constrained_space(model, buckens_frame(model, _Buckens()))
    energy = space.rigid.T @ (space.stiffness @ space.rigid)
    size = np.abs(space.stiffness.diagonal()).max()
    assert space.rigid.shape[1] == 6
    assert np.abs(energy).max() < 1e-9 * size
    assert_allclose(
        space.displacements(space.rigid),
        _projected(model.rigid_body_modes(), space.displacements(space.rigid)),
        atol=1e-9,
    )
    found = frequencies(body(tmp_path, whole(parts, tie)))
    close = two((6, 2, 2), (6, 3, 3))
    exact = frequencies(body(tmp_path, whole(close, surface_tie(close))))
    assert_allclose(found, exact, rtol=2e-2)


def _projected(basis: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return basis @ np.linalg.lstsq(basis, vectors, rcond=None)[0]


@pytest.mark.parametrize("slave", ["low", "high"])
def test_a_clamp_may_lie_on_a_tied_side(slave: str, tmp_path: Path) -> None:
    """Both sides held: each part has the frequencies that it has alone."""
    parts = Part((4, 2, 2), 0.0, 0), Part((3, 3, 3), -0.2, AWAY, (0.2, 0.05, 0.04))
    sides = parts[0].surface("LOW", parts[0].low, "S6")
    sides += parts[1].surface("HIGH", parts[1].high, "S4")
    tie = "*TIE\nLOW, HIGH\n" if slave == "low" else "*TIE\nHIGH, LOW\n"
    held = "".join(f"{n},\n" for n in (*parts[0].left, *parts[1].right))
    text = whole(parts, sides, tie, f"*NSET, NSET=MID\n{held}")
    found = frequencies(body(tmp_path, text, held="MID"))
    long = frequencies(body(tmp_path, deck(parts[0].block, "C3D8I"), held="LEFT"))
    short = frequencies(body(tmp_path, deck(parts[1].block, "C3D8I"), held="LEFT"))
    assert_allclose(found, np.sort([*long, *short])[:4], rtol=1e-7)


@pytest.mark.parametrize(
    ("tied", "message"),
    [
        ("*EQUATION\n2\n1, 1, 1., 5, 1, -1.\n", "resists a rigid motion"),
        ("*EQUATION\n1\n1, 2, 1.\n", "resists a rigid motion"),
        ("*EQUATION\n2\n1, 4, 1., 3, 4, -1.\n", "direction 4"),
        ("*EQUATION\n2\n1, 1, 1.\n", "terms"),
        ("*EQUATION\n2\n1, 1, 1., 3, 1\n", "entries"),
        ("*EQUATION\n2\n1, 1, 1., 77, 1, -1.\n", "77"),
        ("*MPC\nSTRAIGHT, 1, 2, 3\n", "STRAIGHT"),
        ("*MPC\nTIE, 1, 3\n", "resists a rigid motion"),
        ("*TIE, NAME=T\nNO, B\n", "names the surface 'NO'"),
        ("*TIE, NAME=T, CYCLIC SYMMETRY\nNO, B\n", "cyclic symmetry"),
    ],
)
def test_invalid_ties_are_refused(tied: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        body(tmp_path, deck(Block((3, 1, 1), SIZE), "C3D8I") + tied)


def test_parts_that_are_too_far_for_their_tie_are_refused(tmp_path: Path) -> None:
    parts = Part((3, 2, 2), 0.0, 0), Part((3, 3, 3), SIZE[0] + 0.01, AWAY)
    with pytest.raises(InputError, match="holds no node"):
        body(tmp_path, whole(parts, surface_tie(parts)))


def test_convert_reports_the_nodes_of_a_tie(tmp_path: Path) -> None:
    parts = two((3, 2, 2), (4, 3, 3))
    path = deck_file(tmp_path, whole(parts, surface_tie(parts)))
    result = CliRunner().invoke(
        cli, ["convert", str(path), "-o", str(tmp_path / "a.sid"), "-v"]
    )
    assert result.exit_code == 0, result.output
    tie = only(sid_from_model(path), "N122")
    assert tie.line in " ".join(result.output.split())
    assert tie.subject == "tie T" and tie.units["gap"] == "m"
    assert (tie.data["nodes"], tie.data["faces"]) == (9, 9)
    assert tie.data["gap"] == pytest.approx(0.0, abs=1e-9)
