"""MPC and MAT9 of Nastran bulk data: tied halves, and bars that are not isotropic."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.importers.mesh_files import read_mesh
from sidtool.mesh.materials import orthotropic_law
from tests.codes import only, with_code

from .decks import Block, calculix, frequencies
from .test_import_anisotropy import TURN, WOOD, orientation, strain_of, wooden
from .test_import_couplings import body, bulk

HALF = Block((3, 2, 2), (0.3, 0.05, 0.04))
APART = 500


def halves(*cards: str, before: str = "", turned: int = 0) -> str:
    """Two halves of a bar; the nodes of the second count in the system `turned`."""
    second = [
        f"GRID,{i + APART},,{x + 0.3!r},{y!r},{z!r},{turned}"
        for i, (x, y, z) in enumerate(HALF.points, 1)
    ]
    for i, nodes in enumerate(HALF.elements, 1):
        n = [str(a + APART) for a in nodes]
        second += [f"CHEXA,{i + APART},1,{','.join(n[:6])}", f",{n[6]},{n[7]}"]
    first = [
        line
        for i, point in enumerate(HALF.points, 1)
        if turned and point[0] == 0.3
        for line in [f"GRID,{i},,{point[0]!r},{point[1]!r},{point[2]!r}"]
    ]
    text = bulk(*second, *cards, block=HALF)
    for line in first:
        text = text.replace(f"{line}\n", f"{line},{turned}\n")
    return before + text


def ties(label: int = 4) -> list[str]:
    """Every node of the seam to its twin, in all directions."""
    pairs = zip(HALF.right, HALF.left, strict=True)
    return [
        f"MPC,{label},{a},{i},2.5,{b + APART},{i},-2.5"
        for a, b in pairs
        for i in (1, 2, 3)
    ]


SYSTEM = "CORD2C,6,,-0.1,0.4,0.3,-0.4,0.9,0.6\n,0.2,0.5,-0.6"
BALL = SYSTEM.replace("CORD2C", "CORD2S")
SKEW = SYSTEM.replace("CORD2C", "CORD2R")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (halves(*ties()), ""),
        (halves(*ties(), before="CEND\nMPC = 4\n"), ""),
        (halves(*ties(), "MPC,5,1,1,1.", before="SOL 103\nCEND\nMPC=4\n"), "sets of"),
        (halves(*ties(), "MPCADD,9,4", before="CEND\n MPC = 9\n"), ""),
        (halves(*ties(), SYSTEM, turned=6), ""),
        (halves(*ties(), BALL, turned=6), ""),
        (halves(*ties(), SKEW, turned=6), ""),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_halves_that_mpc_ties_are_the_whole_bar(
    text: str, message: str, tmp_path: Path
) -> None:
    """Ties of all directions are the same in any axes at the seam."""
    whole = frequencies(body(tmp_path, bulk(block=Block((6, 2, 2), (0.6, 0.05, 0.04)))))
    assert_allclose(frequencies(body(tmp_path, text)), whole, rtol=1e-9)
    unread = with_code(read_mesh(tmp_path / "part.bdf"), "N112")
    assert message in " ".join(note.message for note in unread)


@pytest.mark.parametrize(
    ("system", "axis"),
    [
        (SYSTEM, lambda r, z: np.cross(z, r)),
        (BALL, lambda r, z: np.cross(np.cross(z, r), r)),
        (SKEW, None),
    ],
)
def test_directions_are_those_of_the_nodes(
    system: str, axis: Any, tmp_path: Path
) -> None:
    """Direction 2 of a node, from the points of its system written out."""
    words = [float(w or 0) for w in system.replace("\n", "").split(",")[3:]]
    a, b, c = np.array(words).reshape(3, 3)
    z = (b - a) / np.linalg.norm(b - a)
    label = HALF.left[2] + APART
    arm = np.array(HALF.points[HALF.left[2] - 1]) + [0.3, 0, 0] - a
    expected = np.cross(z, c - a) if axis is None else axis(arm, z)
    expected = expected / np.linalg.norm(expected)
    text = halves(f"MPC,4,{label},2,3.,1,1,-1.", system, turned=6)
    (tmp_path / "part.bdf").write_text(text, encoding="utf-8")
    (equation,) = read_mesh(tmp_path / "part.bdf").equations
    assert_allclose(equation.terms[0][1], 3 * expected, atol=1e-12)
    assert equation.terms[1] == (1, (-1.0, 0.0, 0.0))


def test_long_cards_hold_every_term(tmp_path: Path) -> None:
    text = bulk("MPC,4,1,1,1.,2,1,2.", ",,3,1,3.,4,2,4.", ",,5,3,5.", block=HALF)
    (tmp_path / "part.bdf").write_text(text, encoding="utf-8")
    (equation,) = read_mesh(tmp_path / "part.bdf").equations
    assert [sum(shares) for _, shares in equation.terms] == [1, 2, 3, 4, 5]
    wide = text.replace("MPC,4,1,1,1.,2,1,2.", "MPC*,4,1,1,1.\n*,2,1,2.")
    (tmp_path / "part.bdf").write_text(wide, encoding="utf-8")
    assert read_mesh(tmp_path / "part.bdf").equations[0].terms == equation.terms


@pytest.mark.parametrize(
    ("cards", "before", "message"),
    [
        (["MPC,4,1,1,1.,77,1,-1."], "", "direction 1 of 77"),
        (["MPC,4,1,4,1.,2,1,-1."], "", "direction 4 of 1"),
        (["MPC,4,1,1,1.,2,1,-1.,8"], "", "holds 8"),
        (["MPC,4,1,1,1.", "MPC,5,2,1,1."], "", "sets of MPC 4, 5"),
        (["MPC,4,1,1,1."], "CEND\nSUBCASE 1\nMPC=4\nSUBCASE 2\nMPC=5\n", "MPC 4, 5"),
        (["MPC,4,1,1,1."], "CEND\nMPC = 3\n", "3, which is not defined"),
        (["MPC,4,1,1,1.", "MPCADD,9,4,6"], "CEND\nMPC=9\n", "set 6, which is not"),
    ],
)
def test_unsupported_multi_point_constraints_are_refused(
    cards: list[str], before: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "part.bdf").write_text(
        before + bulk(*cards, block=HALF), encoding="utf-8"
    )
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "part.bdf")


def test_sets_that_case_control_does_not_name_do_nothing(tmp_path: Path) -> None:
    text = "CEND\nSUBCASE 1\n SPC = 7\n" + bulk("MPC,4,1,1,1.", block=HALF)
    (tmp_path / "part.bdf").write_text(text, encoding="utf-8")
    mesh = read_mesh(tmp_path / "part.bdf")
    assert not mesh.equations
    assert "case control does not name" in only(mesh, "N112").message


@pytest.mark.parametrize(
    "head",
    ["CEND\n", "CEND\nTITLE = a part\nSUBCASE 1\n  SPC = 7\n", "BEGIN BULK $ here\n"],
)
def test_bulk_data_begin_in_many_ways(head: str, tmp_path: Path) -> None:
    plain = bulk(block=HALF).replace("BEGIN BULK\n", "")
    (tmp_path / "part.bdf").write_text(head + plain, encoding="utf-8")
    assert len(read_mesh(tmp_path / "part.bdf").mesh.labels) == len(HALF.points)


def mat9(law: np.ndarray, rho: float = 450.0) -> list[str]:
    words = ["3", *(repr(float(x)) for x in law[np.triu_indices(6)]), repr(rho)]
    rows = [words[i : i + 8] for i in range(0, len(words), 8)]
    return ["MAT9," + ",".join(rows[0]), *("," + ",".join(r) for r in rows[1:])]


def wood(*, system: str = "") -> str:
    """A bar of WOOD, its axes those of a system, which is the turned one."""
    block = Block((6, 2, 2), (0.6, 0.05, 0.04))
    x, _, z = TURN.T
    numbers = [0.0, 0.0, 0.0, *z.tolist(), *x.tolist()]
    words = [repr(n) for n in numbers]
    cord = [f"CORD2R,8,,{','.join(words[:6])}", f",{','.join(words[6:])}"]
    text = bulk(*mat9(orthotropic_law(WOOD)), *cord, block=block)
    return text.replace("PSOLID,1,1", f"PSOLID,1,3,{system}")


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("system", ["", "8"])
@pytest.mark.filterwarnings("ignore")
def test_wood_has_the_frequencies_of_calculix(system: str, tmp_path: Path) -> None:
    """The same bar as CalculiX has it, by its own cards of material and axes."""
    axes = orientation(TURN.T) if system else ""
    constants = "*ELASTIC, TYPE=ENGINEERING CONSTANTS\n" + "".join(
        ", ".join(repr(v) for v in WOOD[i : i + 8]) + "\n" for i in (0, 8)
    )
    deck = wooden(
        constants, axes, kind="C3D8", block=Block((6, 2, 2), (0.6, 0.05, 0.04))
    )
    form = {"type": "mesh", "formulation": "full_integration"}
    found = frequencies(body(tmp_path, wood(system=system), discretisation=form))
    assert_allclose(found, calculix(tmp_path, deck, None), rtol=2e-6)


@pytest.mark.needs("ccx")
@pytest.mark.filterwarnings("ignore")
def test_rings_of_growth_are_those_of_calculix(tmp_path: Path) -> None:
    """Material axes along r, theta and z of a CORD2C beside the bar."""
    start, end = [0.1, -0.05, 0.02], [0.4, -0.06, 0.3]
    numbers = [repr(x) for x in (*start, *end, 1.0, 0.3, 0.0)]
    text, block = wood(system="8"), Block((6, 2, 2), (0.6, 0.05, 0.04))
    first, last = text.index("CORD2R,8"), text.index("\n,", text.index("CORD2R,8"))
    last = text.index("\n", last + 1)
    cord = f"CORD2C,8,,{','.join(numbers[:6])}\n,{','.join(numbers[6:])}"
    axes = f"*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL\n{', '.join(numbers[:6])}\n"
    constants = "*ELASTIC, TYPE=ENGINEERING CONSTANTS\n" + "".join(
        ", ".join(repr(v) for v in WOOD[i : i + 8]) + "\n" for i in (0, 8)
    )
    form = {"type": "mesh", "formulation": "full_integration"}
    turned = text[:first] + cord + text[last:]
    found = frequencies(body(tmp_path, turned, discretisation=form))
    deck = wooden(constants, axes, kind="C3D8", block=block)
    assert_allclose(found, calculix(tmp_path, deck, None), rtol=2e-6)


def test_the_law_of_wood_is_hookes(tmp_path: Path) -> None:
    """Every unit stress strains as the constants say, in the axes of the system."""
    (tmp_path / "part.bdf").write_text(wood(system="8"), encoding="utf-8")
    imported = read_mesh(tmp_path / "part.bdf")
    (name,) = {block.material for block in imported.mesh.blocks}
    assert name is not None
    law = imported.materials[name].law  # type: ignore[union-attr]
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
    for row, (i, j) in enumerate(pairs):
        stress = np.zeros((3, 3))
        stress[i, j] = stress[j, i] = 1.0
        strain = strain_of(stress, TURN.T)
        six = [strain[a, b] * (1 + (a != b)) for a, b in pairs]
        assert_allclose(law @ six, np.eye(6)[row], atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("CORD2R,8", "CORD2S,8", "of elements or of a sphere"),
        ("PSOLID,1,3,8", "PSOLID,1,3,-1", "of elements or of a sphere"),
        ("PSOLID,1,3,8", "PSOLID,1,3,9", "system 9 is not defined"),
        ("PSOLID,1,3,8", "PSOLID,1,3,8,,,,PFLUID", "is PFLUID"),
        ("MAT9,3,", "MAT9,3,-", "takes no energy"),
        ("PSOLID,1,3,8", "PSOLID,1,3,8\nMAT1,3,1.+9,,.3,900.", "3 is defined twice"),
    ],
)
def test_other_wood_is_refused(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    text = wood(system="8")
    assert old in text
    (tmp_path / "part.bdf").write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "part.bdf")
