"""Plane stress of materials that are not isotropic."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.discretisation.registry import finite_element_model
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import read_model
from sidtool.reduction.admissible_space import constrained_space
from sidtool.reduction.body_frames import Frame

from ..importers.decks import Block, body, calculix, deck, deck_file, frequencies
from ..importers.test_calculix_twins import plate8

#: E1, E2, nu12, G12, G13, G23; and with E3, nu13 and nu23 between.
LAMINA = (1.4e11, 9e9, 0.3, 5e9, 5e9, 3e9)
SOLID = (1.4e11, 9e9, 8e9, 0.3, 0.2, 0.4, 5e9, 5e9, 3e9)
ANGLE, SIZE, THICKNESS = 0.6, (0.3, 0.1), 0.002


def material(constants: tuple[float, ...], kind: str) -> str:
    c, s = float(np.cos(ANGLE)), float(np.sin(ANGLE))
    words = ", ".join(map(repr, constants[:8]))
    if constants[8:]:
        words += f"\n{constants[8]!r}"
    return (
        f"*MATERIAL, NAME=S\n*ELASTIC, TYPE={kind}\n{words}\n*DENSITY\n1600.\n"
        f"*ORIENTATION, NAME=O\n{c!r}, {s!r}, 0., {-s!r}, {c!r}, 0.\n"
    )


def fibrous(text: str, own: str) -> str:
    head, tail = text.split("*MATERIAL")
    section = tail[tail.index("*SOLID") :]
    return head + own + section.replace("MATERIAL=S", "MATERIAL=S, ORIENTATION=O")


OWN = {
    "LAMINA": material(LAMINA, "LAMINA"),
    "constants": material(SOLID, "ENGINEERING CONSTANTS"),
}


def strain(stress: np.ndarray) -> np.ndarray:
    """Hooke's law of LAMINA written out in its own axes, (2, 2) tensors."""
    e1, e2, nu, g = LAMINA[:4]
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    axes = np.array([[c, s], [-s, c]])
    own = axes @ stress @ axes.T
    xx, yy, xy = own[0, 0], own[1, 1], own[0, 1]
    found = [[xx / e1 - nu / e1 * yy, xy / (2 * g)], [0, yy / e2 - nu / e1 * xx]]
    found[1][0] = found[0][1]
    return axes.T @ np.array(found) @ axes


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("own", OWN)
def test_tension_off_the_fibres_shears(own: str, tmp_path: Path) -> None:
    """Exact: what the third direction has does nothing in plane stress."""
    block = Block((4, 3), SIZE)
    text = fibrous(deck(block, "CPS4", section=f"{THICKNESS}"), OWN[own])
    text += "*NSET, NSET=END\n" + "".join(f"{n},\n" for n in block.right)
    model = finite_element_model(read_model(deck_file(tmp_path, text)))
    x, load = model.positions, np.zeros((model.ndof, 1))
    for name, sign in (("LEFT", -1.0), ("END", 1.0)):
        surface = model.surface((name,))
        assert surface is not None
        weights = np.asarray(surface.mass.sum(axis=0)).ravel()
        load[::2, 0] += sign * THICKNESS * weights / weights.sum() * SIZE[1]
    space = constrained_space(model, Frame(np.zeros(3), np.zeros(model.ndof, bool)))
    found = space.static(load)[:, 0]
    exact = (x @ strain(np.diag([1.0, 0.0]))).ravel()
    rigid = model.rigid_body_modes()
    exact -= rigid @ np.linalg.lstsq(rigid, exact - found, rcond=None)[0]
    assert_allclose(found, exact, atol=1e-9 * np.abs(exact).max())


@pytest.mark.needs("ccx")
@pytest.mark.filterwarnings("ignore")
def test_a_thin_plate_of_fibres_is_that_of_calculix(tmp_path: Path) -> None:
    text = fibrous(plate8(0.001), OWN["constants"])
    found = frequencies(body(tmp_path, text, held="LEFT"))[:3]
    assert_allclose(found, calculix(tmp_path, text, "LEFT")[:3], rtol=2e-4)


@pytest.mark.parametrize(
    ("kind", "own", "message"),
    [
        ("CPE4", "LAMINA", "LAMINA; expected elements of plane stress"),
        ("CPE4", "constants", "plane strain is not isotropic"),
    ],
)
def test_other_states_are_refused(
    kind: str, own: str, message: str, tmp_path: Path
) -> None:
    text = fibrous(deck(Block((4, 3), SIZE), kind, section="0.002"), OWN[own])
    with pytest.raises(InputError, match=message):
        body(tmp_path, text)
