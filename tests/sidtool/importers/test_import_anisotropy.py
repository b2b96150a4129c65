"""Orthotropic and anisotropic materials of decks, with their axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sidtool.discretisation.registry import finite_element_model
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import read_model
from sidtool.importers.mesh_files import read_mesh
from sidtool.mesh.materials import orthotropic_law
from sidtool.reduction.admissible_space import constrained_space
from sidtool.reduction.body_frames import Frame

from .decks import Block, body, calculix, deck, deck_file, frequencies

#: Spruce, nearly: E1, E2, E3, nu12, nu13, nu23, G12, G13, G23.
WOOD = (1.1e10, 9.0e8, 5.0e8, 0.38, 0.45, 0.5, 7.5e8, 7.0e8, 4.0e7)
SIZE, COUNTS = (0.6, 0.05, 0.04), (6, 2, 2)
#: Points on x and in the plane x y of axes that are turned every way.
TURN = Rotation.from_euler("zyx", [33.0, -21.0, 57.0], degrees=True).as_matrix()


def words(values: object) -> str:
    numbers = [repr(float(x)) for x in np.ravel(values)]
    rows = [numbers[i : i + 8] for i in range(0, len(numbers), 8)]
    return "".join(", ".join(row) + "\n" for row in rows)


def orientation(axes: np.ndarray, further: str = "") -> str:
    points = np.concatenate([3 * axes[0], axes[1] - 0.4 * axes[0]])
    return f"*ORIENTATION, NAME=O\n{words(points)}{further}"


def wooden(
    law: str, axes: str = "", *, kind: str = "C3D8I", block: Block | None = None
) -> str:
    text = deck(block or Block(COUNTS, SIZE), kind)
    head, tail = text.split("*MATERIAL")
    density = f"*DENSITY\n{450.0!r}\n"
    section = tail[tail.index("*SOLID") :]
    if axes:
        section = section.replace("MATERIAL=S", "MATERIAL=S, ORIENTATION=O")
    return f"{head}*MATERIAL, NAME=S\n{law}{density}{axes}{section}"


CONSTANTS = "*ELASTIC, TYPE=ENGINEERING CONSTANTS\n" + words(WOOD)


def strain_of(stress: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Hooke's law of WOOD written out in its own axes, (3, 3) tensors."""
    e1, e2, e3, n12, n13, n23, g12, g13, g23 = WOOD
    s = axes @ stress @ axes.T
    own = np.diag(
        [
            s[0, 0] / e1 - n12 / e1 * s[1, 1] - n13 / e1 * s[2, 2],
            s[1, 1] / e2 - n12 / e1 * s[0, 0] - n23 / e2 * s[2, 2],
            s[2, 2] / e3 - n13 / e1 * s[0, 0] - n23 / e2 * s[1, 1],
        ]
    )
    for (i, j), g in (((0, 1), g12), ((0, 2), g13), ((1, 2), g23)):
        own[i, j] = own[j, i] = s[i, j] / (2 * g)
    return axes.T @ own @ axes


@pytest.mark.parametrize("kind", ["C3D8I", "C3D8"])
@pytest.mark.parametrize("axes", [np.eye(3), TURN.T])
def test_a_rotated_bar_under_tension_follows_hookes_law(
    axes: np.ndarray, kind: str, tmp_path: Path
) -> None:
    """Exact: uniform stress, and shear that couples to tension in turned axes."""
    text = wooden(CONSTANTS, orientation(axes), kind=kind)
    ends = Block(COUNTS, SIZE)
    text += "*NSET, NSET=END\n" + "".join(f"{n},\n" for n in ends.right)
    model = finite_element_model(read_model(deck_file(tmp_path, text)))
    x = model.positions
    loads = np.zeros((model.ndof, 1))
    for at, sign in ((0.0, -1.0), (SIZE[0], 1.0)):
        nodes = np.flatnonzero(np.abs(x[:, 0] - at) < 1e-9)
        surface = model.surface(("END",) if sign > 0 else ("LEFT",))
        assert surface is not None
        weights = np.asarray(surface.mass.sum(axis=0)).ravel()
        loads[3 * nodes, 0] = sign * weights[nodes]
    space = constrained_space(model, Frame(np.zeros(3), np.zeros(model.ndof, bool)))
    found = space.static(loads)[:, 0]
    exact = (x @ strain_of(np.diag([1.0, 0, 0]), axes)).ravel()
    rigid = model.rigid_body_modes()
    exact -= rigid @ np.linalg.lstsq(rigid, exact - found, rcond=None)[0]
    assert_allclose(found, exact, atol=1e-9 * np.abs(exact).max())


def test_constants_of_other_forms_are_the_same_material(tmp_path: Path) -> None:
    """The matrix of the engineering constants, as 9 and as 21 numbers."""
    law = orthotropic_law(WOOD)[np.ix_([0, 1, 2, 3, 5, 4], [0, 1, 2, 3, 5, 4])]
    nine = [law[i] for i in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
    nine += [law[i, i] for i in (3, 4, 5)]
    every = [law[i, j] for j in range(6) for i in range(j + 1)]
    texts = [
        CONSTANTS,
        "*ELASTIC, TYPE=ORTHOTROPIC\n" + words(nine),
        "*ELASTIC, TYPE=ORTHO\n" + words(nine),
        "*ELASTIC, TYPE=ANISOTROPIC\n" + words(every),
    ]
    found = [frequencies(body(tmp_path, wooden(t, orientation(TURN.T)))) for t in texts]
    for other in found[1:]:
        assert_allclose(other, found[0], rtol=1e-9)


def test_a_further_angle_turns_about_an_axis_of_the_system(tmp_path: Path) -> None:
    for axis, vector in ((1, TURN[:, 0]), (2, TURN[:, 1]), (3, TURN[:, 2])):
        turned = Rotation.from_rotvec(np.radians(35.0) * vector).as_matrix() @ TURN
        text = wooden(CONSTANTS, orientation(TURN.T, f"{axis}, 35.\n"))
        found = frequencies(body(tmp_path, text))
        direct = frequencies(body(tmp_path, wooden(CONSTANTS, orientation(turned.T))))
        assert_allclose(found, direct, rtol=1e-9)


@pytest.mark.needs("ccx")
def test_frequencies_are_those_of_calculix(tmp_path: Path) -> None:
    text = wooden(CONSTANTS, orientation(TURN.T), kind="C3D8")
    found = frequencies(body(tmp_path, text))
    assert_allclose(found, calculix(tmp_path, text, None), rtol=2e-6)


def test_a_body_may_turn_with_its_material(tmp_path: Path) -> None:
    """All nodes and the axes turned alike: the same frequencies."""
    block = Block(COUNTS, SIZE)
    straight = frequencies(body(tmp_path, wooden(CONSTANTS, orientation(np.eye(3)))))
    block.points = [tuple((TURN @ p).tolist()) for p in block.points]
    text = wooden(CONSTANTS, orientation(TURN.T), block=block)
    assert_allclose(frequencies(body(tmp_path, text)), straight, rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ENGINEERING CONSTANTS", "COUPLED", "COUPLED is not supported"),
        ("11000000000.0", "-1.", "not above zero"),
        ("0.38", "6.0", "takes no energy"),
        (", 700000000.0\n", "\n", "8 constants"),
        ("*ORIENTATION, NAME=O", "*ORIENTATION, NAME=Q", "orientation 'O'"),
        ("*ORIENTATION,", "*ORIENTATION, SYSTEM=SPHERICAL,", "rectangular nor"),
    ],
)
def test_other_materials_are_refused(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    text = wooden(CONSTANTS, orientation(np.eye(3)))
    assert old in text
    with pytest.raises(InputError, match=message):
        body(tmp_path, text.replace(old, new))


def assembled(part: str, *instances: str) -> str:
    """A deck whose instances place its part."""
    head, tail = part.split("*MATERIAL")
    material, section = tail.split("*ORIENTATION")
    own, rest = section.split("*SOLID SECTION")
    placed = "".join(
        f"*INSTANCE, NAME=I-{k}, PART=P\n{lines}*END INSTANCE\n"
        for k, lines in enumerate(instances, 1)
    )
    return (
        f"*PART, NAME=P\n{head}*ORIENTATION{own}*SOLID SECTION{rest}*END PART\n"
        f"*ASSEMBLY, NAME=A\n{placed}*END ASSEMBLY\n*MATERIAL{material}"
    )


@pytest.mark.parametrize("system", ["RECTANGULAR", "CYLINDRICAL"])
def test_axes_move_with_their_instance(system: str, tmp_path: Path) -> None:
    """The same deck with nodes and axes in global coordinates."""
    points = np.array([[0.1, -0.3, 0.2], [0.2, -0.35, 1.0]])
    move, turn = np.array([0.3, -0.2, 0.7]), Rotation.from_rotvec([0.4, 0.0, 0.3])
    angle = np.degrees(np.linalg.norm(turn.as_rotvec()))
    there = [turn.apply(x + move).tolist() for x in (*points, np.zeros(3))]

    def text(block: Block, drawn: object, origin: object = ()) -> str:
        rows = words([*np.ravel(drawn), *np.ravel(origin)]).replace("\n", ", ")
        axes = f"*ORIENTATION, NAME=O, SYSTEM={system}\n{rows}\n"
        return wooden(CONSTANTS, axes, block=block)

    block = Block(COUNTS, SIZE)
    lines = words(move) + words([0, 0, 0, *turn.as_rotvec(), angle])
    found = frequencies(body(tmp_path, assembled(text(block, points), lines)))
    block.points = [
        tuple(turn.apply(np.array(p) + move).tolist()) for p in block.points
    ]
    origin = there[2] if system == "RECTANGULAR" else ()
    expected = frequencies(body(tmp_path, text(block, there[:2], origin)))
    assert_allclose(found, expected, rtol=1e-9)


def test_every_instance_has_its_axes(tmp_path: Path) -> None:
    """A quarter of a turn about z makes x of y."""
    text = wooden(CONSTANTS, orientation(np.eye(3)))
    quarter = "5., 0., 0.\n5., 0., 0., 5., 0., 1., 90.\n"
    (tmp_path / "part.inp").write_text(assembled(text, "", quarter), encoding="utf-8")
    laws = [own.law for own in read_mesh(tmp_path / "part.inp").materials.values()]
    swapped = [1, 0, 2, 3, 5, 4]
    assert len(laws) == 2
    assert_allclose(laws[0], orthotropic_law(WOOD), rtol=1e-12)
    assert_allclose(laws[1], laws[0][np.ix_(swapped, swapped)], atol=1e-3)


def test_a_turned_instance_takes_axes(tmp_path: Path) -> None:
    text = wooden(CONSTANTS, orientation(np.eye(3))).replace(", ORIENTATION=O", "")
    (tmp_path / "part.inp").write_text(
        assembled(text, "0., 0., 0.\n0., 0., 0., 0., 0., 1., 90.\n"), encoding="utf-8"
    )
    with pytest.raises(InputError, match="has no axes in an instance that is turned"):
        read_mesh(tmp_path / "part.inp")
