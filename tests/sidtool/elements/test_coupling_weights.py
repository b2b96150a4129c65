"""Means of nodes: the weights that a file gives them, or the area that is theirs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.discretisation.registry import finite_element_model
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import read_model
from sidtool.importers.mesh_files import read_mesh
from sidtool.reduction.admissible_space import constrained_space
from sidtool.reduction.body_frames import Frame

from ..importers.decks import STEEL as BAR, Block, deck
from ..importers.mesh_files import mesh_model
from ..importers.test_import_couplings import bulk

SIZE, COUNTS = (0.4, 0.05, 0.03), (3, 3, 2)
STEEL = {"e": 2.1e11, "nu": 0.0, "rho": 7850.0}
REFERENCE = 900


def graded() -> Block:
    """A bar whose nodes crowd at one edge."""
    block = Block(COUNTS, SIZE)
    block.points = [
        (x, y**2 / SIZE[1], z**2 / SIZE[2])  # type: ignore[misc]
        for x, y, z in block.points
    ]
    return block


def shares(block: Block) -> dict[int, float]:
    """The area of the right end that belongs to each of its nodes, of the whole."""
    ys, zs = (np.linspace(0, 1, n + 1) ** 2 for n in COUNTS[1:])
    found = {}
    for (i, j, k), number in block.number.items():
        if i == COUNTS[0]:
            wide = (ys[min(j + 1, COUNTS[1])] - ys[max(j - 1, 0)]) / 2
            found[number] = wide * (zs[min(k + 1, COUNTS[2])] - zs[max(k - 1, 0)]) / 2
    return found


def centre() -> str:
    return f"{REFERENCE}, {SIZE[0]}, {SIZE[1] / 2}, {SIZE[2] / 2}"


def by_surface(method: str = "") -> str:
    block = graded()
    last = [n for n, e in enumerate(block.elements, 1) if e[1] in block.right]
    faces = "".join(f"{n}, S4\n" for n in last)
    return (
        deck(block, "C3D8", material=STEEL)
        + f"*NODE\n{centre()}\n*SURFACE, NAME=END\n{faces}"
        + f"*COUPLING, REF NODE={REFERENCE}, SURFACE=END, CONSTRAINT NAME=C\n"
        + f"*DISTRIBUTING{method}\n1, 6\n"
    )


def by_rbe3() -> str:
    block = graded()
    fields = [
        field
        for node, share in shares(block).items()
        for field in (f"{share:.9f}", "123", str(node))
    ]
    rest = [fields[4:][i : i + 8] for i in range(0, len(fields) - 4, 8)]
    cards = [f"RBE3,60,,{REFERENCE},123456,{','.join(fields[:4])}"]
    cards += ["," + ",".join(row) for row in rest]
    text = bulk("GRID," + centre().replace(",", ",,", 1), *cards, block=block)
    return text.replace(f"{BAR['e']!r},,{BAR['nu']!r}", f"{STEEL['e']!r},,0.")


def model(folder: Path, text: str, file: str) -> FiniteElementModel:
    (folder / file).write_text(text, encoding="utf-8")
    markers = {"end": {"node": 1, "mesh_node": REFERENCE}}
    path = mesh_model(folder, file, frame={"type": "buckens"}, markers=markers)
    data = json.loads(path.read_text(encoding="utf-8"))
    del data["material"]
    path.write_text(json.dumps(data), encoding="utf-8")
    return finite_element_model(read_model(path))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("way", ["surface", "RBE3"])
def test_a_force_is_a_uniform_traction(way: str, tmp_path: Path) -> None:
    """A bar of crowded nodes, without contraction: each node of its end moves alike.

    Where nodes weighed alike, the ends of fine cells moved ahead of those of wide ones.
    """
    text = by_surface() if way == "surface" else by_rbe3()
    body = model(tmp_path, text, "part.inp" if way == "surface" else "part.bdf")
    held = np.zeros(body.ndof, bool)
    left = np.flatnonzero(body.positions[:, 0] == 0)
    held[body.dofs(left)] = True
    pull = body.marker("end").displacement[0].T.toarray()
    u = constrained_space(body, Frame(np.zeros(3), held)).static(pull)
    stretch = body.positions[:, 0] / (STEEL["e"] * SIZE[1] * SIZE[2])
    expected = np.outer(stretch, [1, 0, 0])
    assert_allclose(u.reshape(-1, 3), expected, atol=1e-8 * stretch.max())


def test_weights_that_fall_with_the_distance_are_refused(tmp_path: Path) -> None:
    text = by_surface(", WEIGHTING METHOD=LINEAR")
    with pytest.raises(InputError, match="WEIGHTING METHOD=LINEAR; expected UNIFORM"):
        model(tmp_path, text, "part.inp")


def assembled(row: str) -> str:
    """The bar as an instance, its end a surface of the assembly by these rows."""
    block = graded()
    head, tail = deck(block, "C3D8", material=STEEL).split("*MATERIAL")
    material, section = tail.split("*SOLID")
    last = [str(n) for n, e in enumerate(block.elements, 1) if e[1] in block.right]
    return (
        f"*PART, NAME=P\n{head}*ELSET, ELSET=LAST\n{', '.join(last)}\n*SOLID{section}"
        "*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, PART=P\n*END INSTANCE\n"
        f"*NODE\n{centre()}\n*NSET, NSET=REF\n{REFERENCE}\n*SURFACE, NAME=END\n{row}\n"
        "*COUPLING, REF NODE=REF, SURFACE=END, CONSTRAINT NAME=C\n*DISTRIBUTING\n"
        f"*END ASSEMBLY\n*MATERIAL{material}"
    )


def test_a_surface_of_the_assembly_names_sets_of_instances(tmp_path: Path) -> None:
    """Such a row was left out without a word where others held nodes."""
    (tmp_path / "part.inp").write_text(assembled("I.LAST, S4"), encoding="utf-8")
    (coupling,) = read_mesh(tmp_path / "part.inp").couplings
    assert set(coupling.nodes) == set(graded().right)


def test_sets_of_surfaces_that_are_not_there_are_refused(tmp_path: Path) -> None:
    (tmp_path / "part.inp").write_text(
        assembled("I.LAST, S4\nI.LOST, S4"), encoding="utf-8"
    )
    with pytest.raises(InputError, match="no element set 'I.LOST'"):
        read_mesh(tmp_path / "part.inp")
