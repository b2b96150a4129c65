"""Materials along the radius and the circumference: rings against exact solutions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sidtool.discretisation.registry import finite_element_model
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.elements.material_points import stress_rows
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import read_model
from sidtool.reduction.admissible_space import constrained_space
from sidtool.reduction.body_frames import Frame

from ..importers.decks import Block, body, calculix, deck_file, frequencies, listed
from .test_internal_modes import stresses

INNER, OUTER, DEPTH = 0.04, 0.06, 0.004
ER, ET = 1.0e10, 4.0e10
#: E1 to E3, nu12, nu13, nu23, G12, G13, G23: no contraction along the axis.
ORTHOTROPIC = f"{ER}, {ET}, 9e9, 0.1, 0., 0., 5e9, 4e9\n3e9\n"
WOOD = "1e10, 4e10, 9e9, 0.1, 0.2, 0.3, 5e9, 4e9\n3e9\n"
ISOTROPIC = ", ".join(["2e11"] * 3 + ["0.25"] * 3 + ["8e10"] * 2) + "\n8e10\n"
STRAIGHT = np.eye(3)
TURN = Rotation.from_euler("zyx", [33.0, -21.0, 57.0], degrees=True).as_matrix()


def ring(
    constants: str,
    kind: str = "C3D8I",
    *,
    counts: tuple[int, int, int] = (4, 12, 1),
    arc: float = np.pi / 2,
    turn: np.ndarray = STRAIGHT,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    further: str = "",
) -> str:
    """A ring, or a part of it, about the third axis of `turn` through `start`."""
    block = Block(counts, (OUTER - INNER, arc, DEPTH))
    nodes, inner = "", []
    for i, (r, angle, z) in enumerate(block.points, 1):
        own = [(INNER + r) * np.cos(angle), (INNER + r) * np.sin(angle), z]
        place = np.asarray(start) + turn.T @ own
        nodes += f"{i}, " + ", ".join(f"{x:.12e}" for x in place) + "\n"
        inner += [i] if r == 0 else []
    root = [i for i, point in enumerate(block.points, 1) if point[1] == 0]
    axis = ", ".join(f"{x:.9e}" for x in [*start, *(start + turn[2])])
    return (
        f"*NODE\n{nodes}*ELEMENT, TYPE={kind}, ELSET=E\n{block.element_lines()}"
        f"{listed('INNER', inner)}{listed('ROOT', root)}*MATERIAL, NAME=M\n"
        f"*ELASTIC, TYPE=ENGINEERING CONSTANTS\n{constants}*DENSITY\n1200.\n"
        f"*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL\n{axis}\n{further}"
        "*SOLID SECTION, ELSET=E, MATERIAL=M, ORIENTATION=O\n"
    )


def model(folder: Path, text: str) -> FiniteElementModel:
    return finite_element_model(read_model(deck_file(folder, text)))


def lekhnitskii(r: np.ndarray, pressure: float) -> tuple[np.ndarray, np.ndarray]:
    """Stresses along radius and circumference under pressure inside.

    S. G. Lekhnitskii, "Anisotropic plates", 1968: curvilinear orthotropy.
    """
    k, c = np.sqrt(ET / ER), INNER / OUTER
    scale = pressure * c ** (k + 1) / (1 - c ** (2 * k))
    rising, falling = (r / OUTER) ** (k - 1), (OUTER / r) ** (k + 1)
    return scale * (rising - falling), scale * k * (rising + falling)


@pytest.mark.parametrize("kind", ["C3D8I", "C3D8"])
def test_a_ring_under_pressure_is_that_of_lekhnitskii(
    kind: str, tmp_path: Path
) -> None:
    """A quarter between walls without friction: errors of the widening of order 2, of
    the stress at all points of order 1."""
    widening, stress, pressure = [], [], 1e6
    for n in (1, 2):
        whole = model(tmp_path, ring(ORTHOTROPIC, kind, counts=(3 * n, 8 * n, 1)))
        x = whole.positions
        surface = whole.surface(("INNER",))
        assert surface is not None
        outward = x * [1, 1, 0] / np.linalg.norm(x[:, :2], axis=1)[:, None]
        load = pressure * (surface.mass @ outward)
        space = constrained_space(whole, Frame(np.zeros(3), (np.abs(x) < 1e-9).ravel()))
        u = space.static(load.reshape(-1, 1))[:, 0]
        radial, around = lekhnitskii(np.array(INNER), pressure)
        exact = INNER * (around / ET - 0.1 * radial / ER)
        inside = np.einsum("nd,nd->n", u.reshape(-1, 3), outward)
        widening.append(abs(inside[whole.node_sets["INNER"]].mean() / exact - 1))
        places, six = stresses(whole, u)
        radii = np.linalg.norm(places[:, :2], axis=1)
        normal = places * [1, 1, 0] / radii[:, None]
        found = _along(six, normal), _along(six, np.cross([0.0, 0.0, 1.0], normal))
        differences = np.abs(np.subtract(found, lekhnitskii(radii, pressure)))
        stress.append(differences.max() / pressure)
    assert widening[1] < 0.28 * widening[0]
    assert widening[1] < 4e-3
    assert stress[1] < 0.55 * stress[0]


def _along(six: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Normal stresses of xx, yy, zz, xy, yz, xz along directions."""
    x, y, z = direction.T
    return np.einsum(
        "pk,kp->p", six, [x * x, y * y, z * z, 2 * x * y, 2 * y * z, 2 * x * z]
    )


@pytest.mark.parametrize("kind", ["C3D8I", "C3D8"])
def test_equal_moduli_know_no_axes(kind: str, tmp_path: Path) -> None:
    """Matrices and markers, with internal modes, are those of the isotropic ring."""
    turned = model(tmp_path, ring(ISOTROPIC, kind, turn=TURN, start=(0.1, 0.2, 0.3)))
    text = ring(ISOTROPIC, kind, turn=TURN, start=(0.1, 0.2, 0.3))
    text = text.replace(", ORIENTATION=O", "")
    plain = model(tmp_path, text)
    for name in ("stiffness", "mass"):
        a, b = (getattr(m, name) for m in (turned, plain))
        assert abs(a - b).max() < 1e-9 * abs(b).max()
    a, b = (
        stress_rows(m.markers[0].gradient, m.continua[0], m.markers[0].position)
        for m in (turned, plain)
    )
    assert abs(a - b).max() < 1e-9 * abs(b).max()


@pytest.mark.needs("ccx")
def test_a_tilted_arc_is_that_of_calculix(tmp_path: Path) -> None:
    """The axes at every point of the quadrature, as there."""
    text = ring(WOOD, "C3D8", turn=TURN, start=(0.1, 0.2, 0.3))
    found = frequencies(body(tmp_path, text, held="ROOT"))
    assert_allclose(found, calculix(tmp_path, text, "ROOT"), rtol=1e-6)


def test_a_further_turn(tmp_path: Path) -> None:
    """By a right angle about the axis it changes radius and circumference."""
    swapped = "4e10, 1e10, 9e9, 0.4, 0.3, 0.2, 5e9, 3e9\n4e9\n"
    turned = body(tmp_path, ring(WOOD, further="3, 90.\n"), held="ROOT")
    direct = body(tmp_path, ring(swapped), held="ROOT")
    assert_allclose(frequencies(turned), frequencies(direct), rtol=1e-7)


def test_other_units_of_length(tmp_path: Path) -> None:
    """The axis is in the unit of the file."""
    text = ring(WOOD, turn=TURN, start=(0.1, 0.2, 0.3))
    found = frequencies(body(tmp_path, text, held="ROOT", unit=0.5))
    direct = frequencies(body(tmp_path, text, held="ROOT"))
    assert_allclose(found / found[0], direct / direct[0], rtol=1e-7)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("SYSTEM=CYLINDRICAL", "SYSTEM=SPHERICAL", "neither a rectangular nor"),
        ("SYSTEM=CYLINDRICAL", "SYSTEM=Z RECTANGULAR", "neither a rectangular nor"),
    ],
)
def test_other_systems_are_refused(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        body(tmp_path, ring(WOOD).replace(old, new))
