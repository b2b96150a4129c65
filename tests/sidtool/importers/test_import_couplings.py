"""Rigid and mean couplings, point masses and coordinate systems of decks."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

from sidtool.cli.main import cli
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import J_INDICES, SID
from sidtool.importers.mesh_files import read_mesh
from sidtool.mesh.reference_elements import reference_element
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.report import input_files
from tests.codes import only

from .decks import STEEL, Block, deck, frequencies

COUNTS, SIZE = (6, 2, 2), (0.6, 0.04, 0.05)
REFERENCE = 9000


def bulk(*cards: str, block: Block | None = None, rho: float = STEEL["rho"]) -> str:
    """A block as Nastran has it; the face x = 0 is SPC1 7."""
    block = block or Block(COUNTS, SIZE)
    lines = ["BEGIN BULK"]
    lines += [
        f"GRID,{i},," + ",".join(repr(x) for x in point)
        for i, point in enumerate(block.points, 1)
    ]
    for i, nodes in enumerate(block.elements, 1):
        first = ",".join(map(str, nodes[:6]))
        lines += [f"CHEXA,{i},1,{first}", f",{nodes[6]},{nodes[7]}"]
    lines += [f"SPC1,7,123,{n}" for n in block.left]
    lines += ["PSOLID,1,1", f"MAT1,1,{STEEL['e']!r},,{STEEL['nu']!r},{rho!r}"]
    return "\n".join([*lines, *cards, "ENDDATA", ""])


def body(
    folder: Path, text: str, *, held: bool = False, file: str = "part.bdf", **more: Any
) -> SID:
    (folder / file).write_text(text, encoding="utf-8")
    frame: dict[str, Any] = {"type": "buckens"}
    markers = {"root": {"node": 1, "mesh_node": 1}, **more.pop("markers", {})}
    if held:
        frame = {
            "type": "tangent",
            "marker": "root",
            "clamp": more.pop("clamp", "SPC7"),
        }
    data = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "mesh", "file": file},
        "discretisation": {"type": "mesh", "formulation": "incompatible_modes"},
        "frame": frame,
        "markers": markers,
        "reduction": {"method": "modal", "modes": 4},
        **more,
    }
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return sid_from_model(folder / "model.json")


def rigid(block: Block, at: tuple[float, float, float]) -> list[str]:
    place = ",".join(map(repr, at))
    nodes = ",".join(map(str, block.right[:5]))
    rest = ",".join(map(str, block.right[5:]))
    return [
        f"GRID,{REFERENCE},,{place}",
        f"RBE2,1,{REFERENCE},123456,{nodes}",
        f",{rest}",
    ]


def test_a_mass_at_a_rigid_coupling(tmp_path: Path) -> None:
    """Mass, centre and inertia of a bar and a body beside it, by Steiner's theorem."""
    block = Block(COUNTS, SIZE)
    at, offset = np.array([0.7, 0.03, 0.01]), np.array([0.02, -0.05, 0.04])
    xx, yy, zz, xy, xz, yz = 0.3, 0.4, 0.5, 0.05, -0.02, 0.03
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    card = [
        f"CONM2,5,{REFERENCE},,6.5,{','.join(map(repr, offset.tolist()))}",
        f",{xx!r},{-xy!r},{yy!r},{-xz!r},{-yz!r},{zz!r}",
    ]
    sid = body(tmp_path, bulk(*rigid(block, tuple(at.tolist())), *card))
    a, b, c = SIZE
    bar = STEEL["rho"] * a * b * c
    boxed = bar / 12 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])
    total = bar + 6.5
    middle, extra = np.array(SIZE) / 2, at + offset
    centre = (bar * middle + 6.5 * extra) / total
    expected = boxed + own
    for mass, place in ((bar, middle - centre), (6.5, extra - centre)):
        expected = expected + mass * (
            place @ place * np.eye(3) - np.outer(place, place)
        )
    assert sid.mass == pytest.approx(total, rel=1e-9)
    assert_allclose(sid.mdCM.m0[:, 0], 0, atol=1e-8)
    wanted = [expected[pair] for pair in J_INDICES]
    assert_allclose(sid.J.m0[:, 0], wanted, rtol=1e-8, atol=1e-9)


def test_many_rigid_bars_are_one_piece(tmp_path: Path) -> None:
    """RBAR from every node of the end to one, as RBE2."""
    block = Block(COUNTS, SIZE)
    cards = rigid(block, (0.7, 0.03, 0.01))
    mass = f"CONM2,5,{REFERENCE},,6.5"
    expected = body(tmp_path, bulk(*cards, mass), held=True)
    bars = [f"RBAR,{n},{n},{REFERENCE},,123456,123" for n in block.right]
    sid = body(tmp_path, bulk(cards[0], *bars, mass), held=True)
    assert_allclose(sid.J.m0, expected.J.m0, rtol=1e-12)
    assert_allclose(frequencies(sid), frequencies(expected), rtol=1e-9)


@pytest.mark.parametrize("mass", [250.0, 500.0])
def test_a_heavy_mass_at_the_end_of_a_light_bar(tmp_path: Path, mass: float) -> None:
    """Its first frequencies are those of two springs, 3 E I / l^3."""
    length = 2.0
    block = Block((30, 1, 1), (length, 0.02, 0.03))
    cards = [*rigid(block, (length, 0.01, 0.015)), f"CONM2,5,{REFERENCE},,{mass}"]
    text = bulk(*cards, block=block, rho=1e-3)
    sid = body(tmp_path, text, held=True)
    inertias = np.array([0.03 * 0.02**3, 0.02 * 0.03**3]) / 12
    springs = 3 * STEEL["e"] * inertias / length**3
    expected = np.sqrt(springs / mass) / (2 * np.pi)
    assert_allclose(frequencies(sid)[:2], expected, rtol=4e-3)


def test_a_marker_at_a_reference_node_follows_its_coupling(tmp_path: Path) -> None:
    """RBE3: the mean motion of the nodes; RBE2: a rigid piece of them."""
    block = Block(COUNTS, SIZE)
    centre = (SIZE[0], SIZE[1] / 2, SIZE[2] / 2)
    nodes = ",".join(map(str, block.right[:2])), ",".join(map(str, block.right[2:]))
    mean = [
        f"GRID,{REFERENCE},,{','.join(map(repr, centre))}",
        f"RBE3,1,,{REFERENCE},123456,1.0,123,{nodes[0]}",
        f",{nodes[1]}",
    ]
    markers = {f"n{n}": {"node": n + 1, "mesh_node": n} for n in block.right}
    markers["r"] = {"node": 999, "mesh_node": REFERENCE}
    sid = body(tmp_path, bulk(*mean), held=True, markers=markers)
    at = {node.id: node for node in sid.nodes}
    each = np.array([at[str(n + 1)].phi.m0 for n in block.right])
    assert_allclose(at["999"].phi.m0, each.mean(axis=0), atol=1e-12)
    assert np.abs(each - each.mean(axis=0)).max() > 1e-3
    sid = body(tmp_path, bulk(*rigid(block, centre)), held=True, markers=markers)
    at = {node.id: node for node in sid.nodes}
    middle = at["999"]
    for n in block.right:
        arm = np.array(block.points[n - 1]) - centre
        moved = middle.phi.m0 + np.cross(middle.psi.m0.T, arm).T
        assert_allclose(at[str(n + 1)].phi.m0, moved, atol=1e-10)


def test_nodes_in_local_systems(tmp_path: Path) -> None:
    """A block whose nodes are given in cylindrical axes within other axes."""
    block = Block(COUNTS, SIZE)
    (tmp_path / "plain.bdf").write_text(bulk(), encoding="utf-8")
    plain = read_mesh(tmp_path / "plain.bdf").mesh
    turn = np.radians(30)
    origin = np.array([0.3, -0.2, 0.1])
    axes = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0]])
    axes = np.vstack([axes, [0, 0, 1]])
    lines = bulk().splitlines()
    for i, point in enumerate(block.points):
        x, y, z = axes @ (np.array(point) - origin)
        r, angle = np.hypot(x, y), np.degrees(np.arctan2(y, x))
        lines[i + 1] = f"GRID,{i + 1},4,{r!r},{angle!r},{z!r}".replace("np.float64", "")
        lines[i + 1] = lines[i + 1].replace("(", "").replace(")", "")
    far = [
        "CORD2R,3,0,0.3,-0.2,0.1,0.3,-0.2,1.1",
        ",1.3,-0.2,0.1",
        "CORD2C,4,3,0.,0.,0.,0.,0.,1.",
        f",{np.cos(turn):.17g},{np.sin(turn):.17g},0.",
    ]
    (tmp_path / "far.bdf").write_text(
        "\n".join([*lines[:-1], *far, "ENDDATA", ""]), encoding="utf-8"
    )
    far_mesh = read_mesh(tmp_path / "far.bdf").mesh
    assert_allclose(far_mesh.positions, plain.positions, atol=1e-12)
    spherical = "GRID,1,8,2.,60.,45.\nGRID,2,,0.,0.,0.\nGRID,3,,0.,0.,1.\n"
    spherical += "GRID,4,,1.,0.,0.\nCORD1S,8,2,3,4\nCTETRA,1,1,2,4,1,3\n"
    (tmp_path / "ball.bdf").write_text(spherical, encoding="utf-8")
    place = read_mesh(tmp_path / "ball.bdf").mesh.positions[0]
    across = 2 * np.sin(np.pi / 3) * np.sqrt(0.5)
    assert_allclose(place, [across, across, 1.0], atol=1e-14)


@pytest.mark.parametrize(
    ("cards", "message"),
    [
        (["RBE2,1,1,12,2,3"], "directions 12"),
        (["RBAR,1,1,2,123,456"], "independent directions 123 and 456"),
        (["RBAR,1,1,2,123456,,,12"], "RBAR 1 holds the directions 12"),
        ([f"GRID,{REFERENCE},,0.,0.,0.", f"CONM2,5,{REFERENCE},,1."], "held by no"),
        (["CONM2,5,1,,1.,0.1"], "does not turn"),
        ([f"GRID,{REFERENCE},9,0.,0.,0."], "system 9 is not defined"),
        (
            [
                "CORD2R,9,9,0.,0.,0.,0.,0.,1.",
                ",1.,0.,0.",
                f"GRID,{REFERENCE},9,0.,0.,0.",
            ],
            "in terms of itself",
        ),
    ],
)
def test_invalid_couplings_are_refused(
    tmp_path: Path, cards: list[str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        body(tmp_path, bulk(*cards))


def flat(block: Block, rest: str) -> str:
    return deck(block, "C3D8I") + rest


def coupling(block: Block, kind: str) -> str:
    face = "".join(f"{n},\n" for n in block.right)
    return {
        "rigid body": f"*NSET, NSET=END\n{face}*RIGIDBODY, NSET=END, REFNODE=9000\n",
        "nodes": f"*SURFACE, NAME=S, TYPE=NODE\n{face}"
        "*COUPLING, CONSTRAINT NAME=C, REF NODE=9000, SURFACE=S\n*KINEMATIC\n",
        "faces": f"*SURFACE, NAME=S\n{faces_at_the_end(block)}"
        "*COUPLING, CONSTRAINT NAME=C, REF NODE=9000, SURFACE=S\n*KINEMATIC\n1, 6\n",
        "kinematic coupling": f"*NSET, NSET=END\n{face}"
        "*KINEMATIC COUPLING, REF NODE=9000\nEND, 1, 3\n",
    }[kind]


def faces_at_the_end(block: Block) -> str:
    """S4 of a hexahedron holds its corners 2, 6, 7, 3: those at larger x."""
    ends = set(block.right)
    rows = [i for i, e in enumerate(block.elements, 1) if {e[1], e[2]} <= ends]
    return "".join(f"{i}, S4\n" for i in rows)


@pytest.mark.parametrize("kind", ["rigid body", "nodes", "faces", "kinematic coupling"])
def test_decks_define_rigid_couplings_by_their_keywords(
    tmp_path: Path, kind: str
) -> None:
    """With a mass at the reference node: frequencies and inertia as from RBE2."""
    block = Block(COUNTS, SIZE)
    cards = [*rigid(block, (0.7, 0.03, 0.01)), f"CONM2,5,{REFERENCE},,6.5"]
    expected = body(tmp_path, bulk(*cards), held=True)
    text = flat(block, f"*NODE\n9000, 0.7, 0.03, 0.01\n{coupling(block, kind)}")
    text += "*ELEMENT, TYPE=MASS, ELSET=M\n9001, 9000\n*ELSET, ELSET=M\n9001\n"
    text += "*MASS, ELSET=M\n6.5\n"
    sid = body(tmp_path, text, held=True, clamp="LEFT", file="part.inp")
    assert only(sid, "N135").data["keywords"] == ("*MASS",)
    assert sid.mass == pytest.approx(expected.mass, rel=1e-12)
    assert_allclose(sid.J.m0, expected.J.m0, rtol=1e-9, atol=1e-12)
    assert_allclose(frequencies(sid), frequencies(expected), rtol=1e-8)
    unconstrained = flat(block, "")
    free = body(tmp_path, unconstrained, held=True, clamp="LEFT", file="part.inp")
    assert (frequencies(free) > 1.2 * frequencies(sid)).all()


def test_means_of_some_directions_leave_the_body_as_it_is(tmp_path: Path) -> None:
    """A reference node that takes a mean motion resists none, unless it has a mass."""
    block = Block(COUNTS, SIZE)
    kind = coupling(block, "faces").replace("*KINEMATIC\n1, 6", "*DISTRIBUTING\n6")
    text = flat(block, f"*NODE\n9000, 0.7, 0.03, 0.01\n{kind}")
    sid = body(tmp_path, text, file="part.inp")
    (note,) = only(sid, "N112").data["keywords"]
    assert note.startswith("directions 6 of C")
    plain = body(tmp_path, flat(block, ""), file="part.inp")
    assert_allclose(frequencies(sid), frequencies(plain), rtol=1e-12)
    text += "*ELEMENT, TYPE=MASS, ELSET=M\n9001, 9000\n*MASS, ELSET=M\n6.5\n"
    with pytest.raises(InputError, match="C holds the directions 6"):
        body(tmp_path, text, file="part.inp")


def test_a_reference_element_takes_a_mean_motion(tmp_path: Path) -> None:
    """DCOUP3D of CalculiX is *DISTRIBUTING of equal weights; MEANROT holds nothing."""
    block = Block(COUNTS, SIZE)
    nodes = "".join(f"{n}, 2.0\n" for n in block.right)
    end = "*NODE\n9000, 0.7, 0.03, 0.01\n"
    text = f"{end}*ELEMENT, TYPE=DCOUP3D, ELSET=R\n9001, 9000\n"
    text += f"*DISTRIBUTING COUPLING, ELSET=R\n{nodes}"
    text += "*MPC\nMEANROT, 1, 1, 1, 2, 2, 2\n0, 3, 3, 3, 9000\n"
    markers = {"p": {"node": 7, "mesh_node": 9000}}
    sid = body(tmp_path, flat(block, text), file="part.inp", markers=markers)
    assert "*MPC MEANROT" in str(only(sid, "N112").data)
    names = "".join(f"{n},\n" for n in block.right)
    text = f"{end}*SURFACE, NAME=S, TYPE=NODE\n{names}*COUPLING, CONSTRAINT NAME=C, "
    text += "REF NODE=9000, SURFACE=S\n*DISTRIBUTING\n"
    same = body(tmp_path, flat(block, text), file="part.inp", markers=markers)
    assert_allclose(sid.nodes[-1].phi.m0, same.nodes[-1].phi.m0, rtol=1e-12, atol=1e-15)
    assert_allclose(sid.nodes[-1].psi.m0, same.nodes[-1].psi.m0, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("*DISTRIBUTING COUPLING, ELSET=R\n1, 2.0\n2, 1.0\n", "2 different weights"),
        ("*DISTRIBUTING COUPLING, ELSET=R\n1\n2\n3\n", "a weight"),
        (
            "*ELSET, ELSET=S1\n1\n*DISTRIBUTING COUPLING, ELSET=S1\n1, 2.0\n",
            "0 elements DCOUP3D",
        ),
        (
            "*MPC\nMEANROT, 1, 1, 1, 2, 2, 2\n0, 3, 3, 3, 9000\nTIE, 5, 6\n"
            "*EQUATION\n2\n9000, 1, 1.0, 20, 1, -1.0\n",
            "node 9000, which stands for a mean rotation",
        ),
    ],
)
def test_reference_elements_that_are_not_understood_are_refused(
    lines: str, message: str, tmp_path: Path
) -> None:
    block = Block(COUNTS, SIZE)
    text = "*NODE\n9000, 0.7, 0.03, 0.01\n*ELEMENT, TYPE=DCOUP3D, ELSET=R\n9001, 9000\n"
    with pytest.raises(InputError, match=message):
        body(tmp_path, flat(block, text + lines), file="part.inp")


def test_a_part_where_its_instance_has_it(tmp_path: Path) -> None:
    """Moved by (1, 2, 3), then turned by 90 degrees about an axis along z."""
    block = Block(COUNTS, SIZE)
    part = flat(block, "").split("*MATERIAL")
    text = (
        f"*PART, NAME=P\n{part[0]}*SOLID SECTION, ELSET=E, MATERIAL=S\n*END PART\n"
        "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, PART=P\n1., 2., 3.\n"
        "1., 2., 0., 1., 2., 1., 90.\n*END INSTANCE\n"
        "*NODE\n1, 1., 2.6, 3.\n*NSET, NSET=POINT\n1,\n"
        "*NSET, NSET=TIP, INSTANCE=I\n"
        + "".join(f"{n},\n" for n in block.right)
        + "*SURFACE, NAME=S, TYPE=NODE\nTIP,\n"
        "*COUPLING, CONSTRAINT NAME=C, REF NODE=POINT, SURFACE=S\n*KINEMATIC\n"
        "*ELEMENT, TYPE=MASS, ELSET=M\n1, 1\n*MASS, ELSET=M\n2.\n*END ASSEMBLY\n"
        "*MATERIAL" + part[1].split("*SOLID")[0]
    )
    sid = body(tmp_path, text, file="part.inp")
    imported = read_mesh(tmp_path / "part.inp")
    x, y, z = np.array(block.points).T
    expected = np.column_stack([1 - y, 2 + x, 3 + z])
    assert_allclose(imported.mesh.positions[: len(expected)], expected, atol=1e-12)
    assert imported.couplings[0].reference == len(expected) + 1
    bar = STEEL["rho"] * np.prod(SIZE)
    assert sid.mass == pytest.approx(bar + 2, rel=1e-9)


def test_surfaces_of_quadratic_elements_hold_their_middle_nodes(tmp_path: Path) -> None:
    """The faces of one element: those of its nodes that lie in a plane."""
    for name, kind in (("C3D20", "hex20"), ("C3D10", "tet10"), ("C3D15", "wedge15")):
        nodes = reference_element(kind).nodes
        corners = {"hex20": 6, "tet10": 4, "wedge15": 5}[kind]
        lines = [f"{i}, " + ", ".join(map(str, p)) for i, p in enumerate(nodes, 1)]
        words = [str(i) for i in range(len(nodes) + 1)]
        words[0] = "1"
        words[1:] = [str(i) for i in range(1, len(nodes) + 1)]
        rows = [", ".join(words[i : i + 8]) for i in range(0, len(words), 8)]
        text = "*NODE\n" + "\n".join(lines) + f"\n*ELEMENT, TYPE={name}, ELSET=E\n"
        text += ",\n".join(rows) + "\n"
        text += "".join(
            f"*SURFACE, NAME=F{k}\n1, S{k}\n" for k in range(1, corners + 1)
        )
        (tmp_path / "one.inp").write_text(text, encoding="utf-8")
        sets = read_mesh(tmp_path / "one.inp").mesh.node_sets
        visible = set()
        for k in range(1, corners + 1):
            own = sets[f"F{k}"]
            points = nodes[own] - nodes[own].mean(axis=0)
            normal = np.linalg.svd(points)[2][-1]
            inside = np.abs((nodes - nodes[own].mean(axis=0)) @ normal) < 1e-9
            assert set(np.flatnonzero(inside)) == set(own)
            visible.add(tuple(own))
        assert len(visible) == corners


def test_info_lists_the_imported_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mass, centre and inertia of the bar, six free motions, its sets and markers."""
    block = Block(COUNTS, SIZE)
    sid = body(tmp_path, bulk(*rigid(block, (0.7, 0.03, 0.01))))
    done = CliRunner().invoke(cli, ["info", str(tmp_path / "model.json")])
    assert done.exit_code == 0, done.output
    rows = dict(re.findall(r"^(.+?)  +(.*)$", done.output, re.MULTILINE))
    a, b, c = SIZE
    bar = STEEL["rho"] * a * b * c
    numbers = re.compile(r"-?\d[\d.e+-]*")

    def read(name: str) -> np.ndarray:
        return np.array([float(x) for x in numbers.findall(rows[name])])

    assert read("mass")[0] == pytest.approx(bar, rel=1e-8)
    assert_allclose(read("centre")[:3], [a / 2, b / 2, c / 2], rtol=1e-5)
    diagonal = bar / 12 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    assert_allclose(read("inertia about it")[:3], diagonal, rtol=1e-5)
    assert read("6 rigid motions")[0] < 0.1
    assert_allclose(read("free frequencies")[:4], frequencies(sid), rtol=1e-5)
    assert read("SPC7")[0] == len(block.left)
    monkeypatch.setattr(input_files, "_MANY_DOFS", 10)  # where these would take minutes
    brief = CliRunner().invoke(cli, ["info", str(tmp_path / "model.json")])
    assert f"left out for {3 * len(block.points)} degrees of freedom" in brief.output
