"""What ANSYS archives say beside elements: masses, equations, systems, triangles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.importers.ansys.archive import _READERS
from sidtool.importers.mesh_files import read_mesh
from sidtool.mesh.materials import AnisotropicMaterial, CylindricalMaterial

from .decks import STEEL, Block, frequencies
from .test_decks_said_differently import assert_same
from .test_import_anisotropy import WOOD
from .test_import_couplings import body as body_of

LEFT, RIGHT = Block((2, 2, 2), (0.2, 0.04, 0.05)), Block((2, 2, 2), (0.2, 0.04, 0.05))
WHOLE = Block((4, 2, 2), (0.4, 0.04, 0.05))
SHIFT = 1000
MATERIAL = (
    f"MP,EX,1,{STEEL['e']!r}\nMP,PRXY,1,{STEEL['nu']!r}\nMP,DENS,1,{STEEL['rho']!r}\n"
)
HEAD = "/PREP7\nET,1,185\nKEYOPT,1,2,3\nTYPE,1\nMAT,1\n"


def nodes(block: Block, *, shift: int = 0, x: float = 0.0, angles: str = "") -> str:
    return "".join(
        f"N,{i + shift},{x + a!r},{b!r},{c!r}{angles}\n"
        for i, (a, b, c) in enumerate(block.points, 1)
    )


def elements(block: Block, *, shift: int = 0) -> str:
    return "".join(
        f"EN,{i + shift},{','.join(str(n + shift) for n in nodes)}\n"
        for i, nodes in enumerate(block.elements, 1)
    )


def archive(*lines: str, block: Block = WHOLE, material: str = MATERIAL) -> str:
    """The further lines stand between the nodes and the elements, before TYPE."""
    return HEAD + material + nodes(block) + elements(block) + "\n".join([*lines, ""])


def body(folder: Path, text: str, **more: Any) -> SID:
    return body_of(folder, text, file="part.cdb", **more)


TURN = ",33.,-21.,57."
PAIRS = list(zip(LEFT.right, RIGHT.left, strict=True))
TIES = {
    "CP": [f"CP,{a},ALL,{a},{b + SHIFT}" for a, b in PAIRS],
    "CE": [
        f"CE,{10 * a + i},0,{a},{d},2.,{b + SHIFT},{d},-2."
        for a, b in PAIRS
        for i, d in enumerate(("UX", "UY", "UZ"))
    ],
    "CE of blocks": [
        f"CE,R5.0,DEFI,       2,{10 * a + i:8d},  0.00000000\n"
        f"CE,R5.0,NODE,{a:10d},{d}  ,  1.00000000    ,{b + SHIFT:10d},{d}  , -1.0"
        for a, b in PAIRS
        for i, d in enumerate(("UX", "UY", "UZ"))
    ],
}


def halves(*lines: str, angles: tuple[str, str]) -> str:
    """Two blocks that share no node."""
    return (
        HEAD
        + MATERIAL
        + nodes(LEFT, angles=angles[0])
        + nodes(RIGHT, shift=SHIFT, x=0.2, angles=angles[1])
        + elements(LEFT)
        + elements(RIGHT, shift=SHIFT)
        + "\n".join([*lines, ""])
    )


@pytest.mark.parametrize("angles", [("", ""), (TURN, TURN)])
@pytest.mark.parametrize("name", TIES)
def test_equations_join_halves(
    name: str, angles: tuple[str, str], tmp_path: Path
) -> None:
    """In the directions of their nodes, which may be turned; they were refused."""
    sid = body(tmp_path, halves(*TIES[name], angles=angles))
    assert_same(sid, body(tmp_path, archive()))


def test_directions_of_nodes_are_turned(tmp_path: Path) -> None:
    """By THXY about z, then THYZ about x, then THZX about y; as in its own axes."""
    own = Rotation.from_euler("ZXY", [33.0, -21.0, 57.0], degrees=True).as_matrix().T
    lines = [
        f"CE,{10 * a + i},0,{a},{d},1.,"
        + ",".join(
            f"{b + SHIFT},{other},{-float(x)!r}"
            for other, x in zip(("UX", "UY", "UZ"), own[i], strict=True)
        )
        for a, b in PAIRS
        for i, d in enumerate(("UX", "UY", "UZ"))
    ]
    sid = body(tmp_path, halves(*lines, angles=(TURN, "")))
    assert_same(sid, body(tmp_path, archive()))
    with pytest.raises(InputError, match="resists a rigid motion"):
        body(tmp_path, halves(*TIES["CP"], angles=(TURN, "")))


MASS = "ET,2,21\nKEYOPT,2,3,2\n{constants}\nTYPE,2\nREAL,7\nEN,900,5"
NINE = [f"{x:16.9g}" for x in (1, 0, 0, 0, 0, 0, 1, 2, 3)]
BLOCKED = "\n".join(
    [
        "RLBLOCK,       2,       7,       9,       7\n(2i8,6g16.9)\n(7g16.9)",
        f"{3:8d}{9:8d}" + "".join(NINE[:6]),
        "".join(NINE[6:]),
        f"{7:8d}{1:8d}{2.5:16.9g}",
    ]
)


@pytest.mark.parametrize("constants", ["R,7,2.5", BLOCKED])
def test_point_masses(constants: str, tmp_path: Path) -> None:
    """MASS21 by its real constants."""
    plain = body(tmp_path, archive())
    sid = body(tmp_path, archive(MASS.format(constants=constants)))
    assert sid.mass == pytest.approx(plain.mass + 2.5, rel=1e-12)
    assert (frequencies(sid) < frequencies(plain)).all()
    place = np.array(WHOLE.points[4])
    centre = (plain.mass * np.array([0.2, 0.02, 0.025]) + 2.5 * place) / sid.mass
    origin = np.array(WHOLE.points[0]) - centre
    assert_allclose(sid.node("1").origin.m0[:, 0], origin, atol=1e-9)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("R,7,1.,1.,2.", "KEYOPT {3: 0}"),
        ("R,8,2.5", "real constants none"),
    ],
)
def test_masses_of_their_own_directions(
    line: str, message: str, tmp_path: Path
) -> None:
    text = MASS.format(constants=line).replace("KEYOPT,2,3,2", "KEYOPT,2,3,0")
    (tmp_path / "part.cdb").write_text(archive(text), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "part.cdb")


NAMES = (*("EX", "EY", "EZ"), *("PRXY", "PRXZ", "PRYZ"), *("GXY", "GXZ", "GYZ"))
SPRUCE = "".join(f"MP,{n},1,{x!r}\n" for n, x in zip(NAMES, WOOD, strict=True))
SPRUCE += "MP,DENS,1,450.\n"
LOCALS = {
    "LOCAL,11,0,1.,2.,3.,33.,-21.,57.": (33.0, -21.0, 57.0),
    "LOCAL,R5.0,LOC,11,0,1.,2.,3.\nLOCAL,R5.0,ANG,11,0,33.,-21.,57.": (33, -21, 57),
}


@pytest.mark.parametrize("line", LOCALS)
def test_wood_along_the_system_of_its_elements(line: str, tmp_path: Path) -> None:
    """ESYS was refused."""
    text = archive(material=SPRUCE)
    (tmp_path / "plain.cdb").write_text(text, encoding="utf-8")
    (plain,) = read_mesh(tmp_path / "plain.cdb").materials.values()
    turned = text.replace("TYPE,1\n", f"{line}\nCSYS,0\nTYPE,1\nESYS,11\n")
    (tmp_path / "part.cdb").write_text(turned, encoding="utf-8")
    mesh = read_mesh(tmp_path / "part.cdb")
    (block,) = mesh.mesh.blocks
    own = mesh.materials[str(block.material)]
    axes = Rotation.from_euler("ZXY", LOCALS[line], degrees=True).as_matrix().T
    assert isinstance(plain, AnisotropicMaterial)
    assert isinstance(own, AnisotropicMaterial)
    assert_allclose(own.law, plain.turned(axes).law, rtol=1e-9, atol=1.0)


def test_wood_around_an_axis(tmp_path: Path) -> None:
    text = archive(material=SPRUCE)
    line = "LOCAL,12,1,0.1,0.2,0.3,0.,90.,0.\nCSYS,0\nTYPE,1\nESYS,12\n"
    (tmp_path / "part.cdb").write_text(text.replace("TYPE,1\n", line), encoding="utf-8")
    mesh = read_mesh(tmp_path / "part.cdb").materials["1 along 12"]
    assert isinstance(mesh, CylindricalMaterial)
    assert_allclose(mesh.start, [0.1, 0.2, 0.3])
    assert_allclose(mesh.axis, [0.0, -1.0, 0.0], atol=1e-15)
    ball = text.replace("TYPE,1\n", line.replace("12,1", "12,2"))
    for wrong, message in (
        (ball, "of kind 2"),
        (ball.replace("ESYS,12", "ESYS,9"), "9"),
    ):
        (tmp_path / "part.cdb").write_text(wrong, encoding="utf-8")
        with pytest.raises(InputError, match=message):
            read_mesh(tmp_path / "part.cdb")


#: A square of two triangles, their nodes counted from one corner.
CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
MIDDLES = ((0.5, 0), (1, 0.5), (0.5, 1), (0, 0.5), (0.5, 0.5))
HALVES = ((1, 2, 3, 5, 6, 9), (1, 3, 4, 9, 7, 8))


@pytest.mark.parametrize("collapsed", [True, False])
def test_triangles_of_quadratic_plane_elements(collapsed: bool, tmp_path: Path) -> None:
    """PLANE183 with KEYOPT(1) = 1 or with one corner twice; it "uses a node twice"."""
    lines = ["/PREP7", "ET,1,183", "KEYOPT,1,3,3", "R,1,0.02"]
    lines += [] if collapsed else ["KEYOPT,1,1,1"]
    lines += [f"N,{i},{x},{y}" for i, (x, y) in enumerate((*CORNERS, *MIDDLES), 1)]
    for i, (a, b, c, ab, bc, ca) in enumerate(HALVES, 1):
        row = (a, b, c, c, ab, bc, c, ca) if collapsed else (a, b, c, ab, bc, ca)
        lines.append(f"EN,{i},{','.join(map(str, row))}")
    (tmp_path / "part.cdb").write_text("\n".join([*lines, MATERIAL]), encoding="utf-8")
    mesh = read_mesh(tmp_path / "part.cdb")
    (block,) = mesh.mesh.blocks
    assert block.kind == "tri6" and block.thickness == 0.02
    assert mesh.mesh.labels[block.nodes].tolist() == [list(row) for row in HALVES]


#: Types and KEYOPTs of linear elements, and whether they lock in bending.
TECHNOLOGIES = {
    "ET,1,182\nKEYOPT,1,1,0": True,
    "ET,1,182\nKEYOPT,1,1,2": False,
    "ET,1,182\nKEYOPT,1,1,3": False,
    "ET,1,182,2,,3": False,
    "ET,1,42\nKEYOPT,1,2,0": False,
    "ET,1,42\nKEYOPT,1,2,1": True,
    "ET,1,185,,2": False,
    "ET,1,185\nKEYOPT,1,2,0": True,
    "ET,1,45\nKEYOPT,1,1,0": False,
    "ET,1,45\nKEYOPT,1,1,1": True,
}


@pytest.mark.parametrize("types", TECHNOLOGIES)
def test_keyopts_choose_elements_that_bend(types: str, tmp_path: Path) -> None:
    """The first frequency of a free bar of Euler and Bernoulli, root 4.730041."""
    length, height, width = 0.4, 0.02, 0.05
    plane = types.startswith(("ET,1,182", "ET,1,42"))
    sizes = (length, height) if plane else (length, height, width)
    block = Block((10, 1, 1)[: len(sizes)], sizes)
    head = f"/PREP7\n{types}\nTYPE,1\nMAT,1\n"
    if plane:
        head += f"KEYOPT,1,3,3\nR,1,{width!r}\nREAL,1\n"
    points = "".join(
        f"N,{i},{','.join(map(repr, p))}\n" for i, p in enumerate(block.points, 1)
    )
    text = head + MATERIAL + points + elements(block)
    found = frequencies(body(tmp_path, text, discretisation={"type": "mesh"}))[0]
    wave = (4.730041 / length) ** 2
    slender = wave * height * np.sqrt(STEEL["e"] / STEEL["rho"] / 12) / (2 * np.pi)
    if TECHNOLOGIES[types]:
        assert found > 1.2 * slender
    else:
        assert found == pytest.approx(slender, rel=0.02)


def test_elements_over_several_lines(tmp_path: Path) -> None:
    """EMORE."""
    block = Block((1, 1, 1), (1.0, 1.0, 1.0))
    (tmp_path / "part.cdb").write_text(archive(block=block), encoding="utf-8")
    expected = read_mesh(tmp_path / "part.cdb").mesh.blocks[0].nodes
    text = archive(block=block)
    row = text[text.index("EN,1,") :].splitlines()[0]
    head, tail = row.rsplit(",", 4)[0], row.rsplit(",", 4)[1:]
    more = f"{head}\nEMORE,{','.join(tail)}"
    (tmp_path / "part.cdb").write_text(text.replace(row, more), encoding="utf-8")
    assert (read_mesh(tmp_path / "part.cdb").mesh.blocks[0].nodes == expected).all()


@pytest.mark.parametrize(
    ("kind", "message"), [(174, "contact"), (14, "a spring"), (184, "rigid link")]
)
def test_elements_that_are_no_solids_are_named(
    kind: int, message: str, tmp_path: Path
) -> None:
    (tmp_path / "part.cdb").write_text(
        archive(f"ET,2,{kind}", "TYPE,2", "EN,99,1,2"), encoding="utf-8"
    )
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "part.cdb")


STEEL_OF_WORKBENCH = """MP,ALPX,1,1.2e-05,
MP,C,1,434,
MP,KXX,1,60.5,
MP,RSVX,1,0.00017,
MP,MURX,1,10000,
MP,ALPD,1,0.5
TB,BISO,1,1,2
TBTEMP,0.
TBDATA,,2.5e8,1.45e9"""


def test_what_is_beyond_the_elasticity_changes_nothing(tmp_path: Path) -> None:
    """Structural steel as it comes, resistivity and all, was refused."""
    sid = body(tmp_path, archive(STEEL_OF_WORKBENCH))
    assert_same(sid, body(tmp_path, archive()))
    (tmp_path / "part.cdb").write_text(archive("TB,HYPER,1,1,2,NEO"), encoding="utf-8")
    with pytest.raises(InputError, match="TB, HYPER is not supported"):
        read_mesh(tmp_path / "part.cdb")


@pytest.mark.parametrize("rest", ["", ",", ",1", ",1,2", ",R5.0", ",R5.0,1"])
def test_commands_that_lack_entries_are_refused(rest: str, tmp_path: Path) -> None:
    """Each ends with a message that names it, or is one without effect."""
    known, path = HEAD + MATERIAL, tmp_path / "a.cdb"
    lacking = []
    for name in sorted(_READERS):
        text = f"{known}{nodes(WHOLE)}{elements(WHOLE)}{name}{rest}\n"
        path.write_text(text, encoding="utf-8")
        try:
            read_mesh(path)
        except InputError as error:
            if f"lacks entries of {name}" in error.problem:
                lacking.append(name)
    assert lacking
