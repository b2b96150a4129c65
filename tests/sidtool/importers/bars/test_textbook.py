"""Frames of bars have the matrices of the textbook.

Reference: element matrices of J. S. Przemieniecki, Theory of Matrix Structural
Analysis, 1968.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from tests.sidtool.importers.bars.decks import (
    AREA,
    IY,
    IZ,
    LEGS,
    MATERIAL,
    PBAR,
    PLACES,
    RHO,
    TORSION,
    UP,
    E,
    G,
    body,
    bulk,
    frame,
    grids,
)
from tests.sidtool.importers.decks import frequencies


def textbook(length: float, extra: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass (12, 12) of a bar on the x axis, ends u, v, w, rotations.

    extra : mass per length that has no rotary inertia
    """
    k, m = np.zeros((2, 12, 12))
    pair = np.array([[1, -1], [-1, 1]])
    even = np.array([[2, 1], [1, 2]]) / 6
    for i, share, inertia in (
        (0, E * AREA, RHO * AREA + extra),
        (3, G * TORSION, RHO * (IY + IZ)),
    ):
        at = np.ix_([i, i + 6], [i, i + 6])
        k[at] = share / length * pair
        m[at] = inertia * length * even
    le = length
    bend = np.array(
        [
            [12, 6 * le, -12, 6 * le],
            [6 * le, 4 * le**2, -6 * le, 2 * le**2],
            [-12, -6 * le, 12, -6 * le],
            [6 * le, 2 * le**2, -6 * le, 4 * le**2],
        ]
    )
    sway = np.array(
        [
            [156, 22 * le, 54, -13 * le],
            [22 * le, 4 * le**2, 13 * le, -3 * le**2],
            [54, 13 * le, 156, -22 * le],
            [-13 * le, -3 * le**2, -22 * le, 4 * le**2],
        ]
    )
    rotary = np.array(
        [
            [36, 3 * le, -36, 3 * le],
            [3 * le, 4 * le**2, -3 * le, -(le**2)],
            [-36, -3 * le, 36, -3 * le],
            [3 * le, -(le**2), -3 * le, 4 * le**2],
        ]
    )
    for dofs, i, signs in (
        ([1, 5, 7, 11], IZ, [1, 1, 1, 1]),
        ([2, 4, 8, 10], IY, [1, -1, 1, -1]),
    ):
        turn = np.outer(signs, signs)
        k[np.ix_(dofs, dofs)] += E * i / le**3 * bend * turn
        m[np.ix_(dofs, dofs)] += (RHO * AREA + extra) * le / 420 * sway * turn
        m[np.ix_(dofs, dofs)] += RHO * i / (30 * le) * rotary * turn
    return k, m


def arm(r: np.ndarray) -> np.ndarray:
    """(6, 6) motion at r from a point by the motion of that point."""
    x, y, z = r
    result = np.eye(6)
    result[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return result


def by_textbook(
    offsets: dict[int, np.ndarray],
    masses: dict[int, np.ndarray],
    extra: float = 0.0,
) -> np.ndarray:
    """Elastic frequencies [Hz] of the frame.

    offsets : offsets (2, 3) of the ends of a leg from their nodes, by leg
    masses : mass matrix (6, 6) by node
    """
    k, m = np.zeros((2, 24, 24))
    for number, (a, b) in enumerate(LEGS):
        shift = offsets.get(number, np.zeros((2, 3)))
        x, y = PLACES[a] + shift[0], PLACES[b] + shift[1]
        length = float(np.linalg.norm(y - x))
        e1 = (y - x) / length
        e3 = np.cross(e1, UP) / np.linalg.norm(np.cross(e1, UP))
        turn = np.kron(np.eye(4), np.array([e1, np.cross(e3, e1), e3]))
        turn = turn @ scipy.linalg.block_diag(arm(shift[0]), arm(shift[1]))
        dofs = [*range(6 * a, 6 * a + 6), *range(6 * b, 6 * b + 6)]
        for total, part in zip((k, m), textbook(length, extra), strict=True):
            total[np.ix_(dofs, dofs)] += turn.T @ part @ turn
    for node, inertia in masses.items():
        m[6 * node : 6 * node + 6, 6 * node : 6 * node + 6] += inertia
    values = scipy.linalg.eigh(k, m, eigvals_only=True)
    return np.sqrt(values[6:12]) / (2 * np.pi)


@pytest.mark.filterwarnings("ignore")
def test_a_frame_has_the_matrices_of_the_textbook(tmp_path: Path) -> None:
    found = frequencies(body(tmp_path, frame(PBAR)))
    assert_allclose(found, by_textbook({}, {}), rtol=1e-8)


PBEAM = f"PBEAM,1,1,{AREA!r},{IZ!r},{IY!r},,{TORSION!r}"


@pytest.mark.parametrize("card", [PBEAM + ",,NO\n,,,,,,,,\n,0.,0.", PBEAM])
@pytest.mark.filterwarnings("ignore")
def test_a_beam_is_the_same(card: str, tmp_path: Path) -> None:
    """K1 = K2 = 1 of a beam: shear is small in slender ones."""
    card = PBEAM + "\n,\n,NO,1.0\n,0.,0." if "NO" in card else card
    found = frequencies(body(tmp_path, frame(card, card="CBEAM")))
    assert_allclose(found, by_textbook({}, {}), rtol=1e-5)


SHIFT = np.array([[0.01, 0.03, -0.02], [-0.02, 0.05, 0.04]])


@pytest.mark.filterwarnings("ignore")
def test_a_hub_on_the_axis_of_its_directions_has_that_of_the_axis(
    tmp_path: Path,
) -> None:
    """Spokes whose y axes are along z of cylindrical directions of their hub."""
    around = [(np.cos(x), np.sin(x), 0.0) for x in (0.0, 2.0, 4.0)]
    spokes = [f"CBAR,{k},1,1,{k + 1},0.,0.,1." for k in (1, 2, 3)]
    plain = bulk(*grids([(0.0, 0.0, 0.0), *around]), *spokes, PBAR, MATERIAL)
    system = "GRDSET,,,,,,5\nCORD2C,5,,0.,0.,0.,0.,0.,1.\n,1.,0.,0."
    turned = plain.replace("BEGIN BULK", f"BEGIN BULK\n{system}")
    expected, found = (frequencies(body(tmp_path, text)) for text in (plain, turned))
    assert_allclose(found, expected, rtol=1e-12)
    with pytest.raises(InputError, match="on the axis"):
        body(tmp_path, turned.replace("CBAR,1,1,1,2,0.,0.,1.", "CBAR,1,1,1,2,0.,1.,1."))


def test_offsets_and_rigid_couplings_are_arms(tmp_path: Path) -> None:
    """The middle leg aside of its nodes, by offsets, and by nodes of its own."""
    words = ",".join(map(repr, SHIFT.ravel().tolist()))
    text = frame(PBAR)
    lines = text.splitlines()
    middle = next(i for i, line in enumerate(lines) if line.startswith("CBAR,2,"))
    lines[middle] += f"\n,,,{words}"
    expected = by_textbook({1: SHIFT}, {})
    assert_allclose(frequencies(body(tmp_path, "\n".join(lines))), expected, rtol=1e-8)
    own = [
        f"GRID,{i},,{','.join(map(repr, (PLACES[k] + s).tolist()))}"
        for i, k, s in ((8, 1, SHIFT[0]), (9, 2, SHIFT[1]))
    ]
    held = [*own, "RBE2,70,2,123456,8", "RBE2,71,3,123456,9"]
    text = frame(PBAR, *held).replace("CBAR,2,1,2,3,", "CBAR,2,1,8,9,")
    assert_allclose(frequencies(body(tmp_path, text)), expected, rtol=1e-8)
    for bar in ("RBAR,71,3,9,123456", "RBAR,71,9,3,,123456,123456"):
        other = text.replace("RBE2,71,3,123456,9", bar)
        assert_allclose(frequencies(body(tmp_path, other)), expected, rtol=1e-8)
    chain = ["GRID,7,,0.3,0.3,0.3", "RBE2,72,7,123456,2,8"]
    text = text.replace("RBE2,70,2,123456,8", "\n".join(chain))
    assert_allclose(frequencies(body(tmp_path, text)), expected, rtol=1e-8)


@pytest.mark.filterwarnings("ignore")
def test_masses_and_their_inertia(tmp_path: Path) -> None:
    """CONM2 beside its node, and further mass along the bars."""
    r, own = np.array([0.02, -0.03, 0.01]), np.diag([2e-5, 3e-5, 4e-5])
    whole = scipy.linalg.block_diag(0.02 * np.eye(3), own)
    inertia = arm(r).T @ whole @ arm(r)
    offset = ",".join(map(repr, r.tolist()))
    card = f"CONM2,60,3,,0.02,{offset}\n,2.-5,,3.-5,,,4.-5"
    found = frequencies(body(tmp_path, frame(PBAR, card)))
    assert_allclose(found, by_textbook({}, {2: inertia}), rtol=1e-8)
    sid = body(tmp_path, frame(f"{PBAR},{RHO * AREA!r}"))
    assert_allclose(frequencies(sid), by_textbook({}, {}, RHO * AREA), rtol=1e-8)
    length = sum(np.linalg.norm(PLACES[b] - PLACES[a]) for a, b in LEGS)
    assert sid.mass == pytest.approx(2 * RHO * AREA * length, rel=1e-12)
