"""Decks whose numbers no body can have are refused; unusual ones get a warning."""

from __future__ import annotations

from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import WARNING
from tests.codes import only

from .decks import STEEL, Block, body, deck
from .test_density import converted

BLOCK = Block((4, 1, 1), (0.4, 0.1, 0.1))
#: Two bars at a right angle, each 1 m long, of section 1e-4 m2.
FRAME = """BEGIN BULK
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,1.,1.,0.
CBAR,1,1,1,2,0.,0.,1.
CBAR,2,1,2,3,0.,0.,1.
PBAR,1,1,1.-4,1.-9,1.-9,1.-9
MAT1,1,{e},,.3,{rho}
CONM2,9,3,,{mass}
ENDDATA
"""


def frame(folder: Path, e: str, rho: str, mass: str = "0.") -> SID:
    text = FRAME.format(e=e, rho=rho, mass=mass)
    return converted(folder, "part.bdf", text)


@pytest.mark.parametrize(
    ("e", "rho"),
    [
        ("2.1-293", "7.85-301"),
        ("2.1+293", "7.85+283"),
        ("1.-90", "7850."),
        ("1.+90", "7850."),
    ],
)
def test_bodies_of_meaningless_numbers_are_refused(
    tmp_path: Path, e: str, rho: str
) -> None:
    with pytest.raises(InputError) as error:
        frame(tmp_path, e, rho)
    assert "consistent units" in str(error.value.expected)


@pytest.mark.parametrize("word", ["1e200", "1.+200"])
def test_positions_whose_squares_overflow_are_refused(
    tmp_path: Path, word: str
) -> None:
    """Without warnings of overflow."""
    text = FRAME.format(e="2.1+11", rho="7850.", mass="0.")
    with pytest.raises(InputError, match="at most 1e\\+50"):
        converted(tmp_path, "part.bdf", text.replace("1.,1.,0.", f"{word},1.,0."))


def test_a_stiffness_below_all_rounding_is_refused(tmp_path: Path) -> None:
    """LAPACK returns no eigenvectors for such matrices, and no error."""
    text = deck(Block((2, 1, 1), (0.2, 0.1, 0.1)), "C3D8")
    with pytest.raises(InputError, match="the eigenproblem has no solution"):
        body(tmp_path, text.replace(f"{STEEL['e']!r}", "1e-308"))


def test_units_of_other_systems_are_no_reason_to_refuse(tmp_path: Path) -> None:
    """The frame in N, mm, t, read as SI."""
    sid = frame(tmp_path, "2.1+5", "7.85-9")
    assert_allclose(sid.mass, 2e-4 * 7.85e-9, rtol=1e-12)


def test_masses_below_zero_are_added_and_warned_of(tmp_path: Path) -> None:
    sid = frame(tmp_path, "2.1+11", "7850.", "-0.1")
    assert_allclose(sid.mass, 2e-4 * 7850 - 0.1, rtol=1e-12)
    note = only(sid, "N146")
    assert note.severity == WARNING
    assert note.data["count"] == 1
    assert_allclose(note.data["total"], -0.1)


def test_masses_below_zero_of_solids_are_warned_of(tmp_path: Path) -> None:
    mass = "*ELEMENT, TYPE=MASS, ELSET=P\n99, 1\n*MASS, ELSET=P\n-0.5\n"
    sid = body(tmp_path, deck(BLOCK, "C3D8I") + mass)
    assert_allclose(sid.mass, 0.4 * 0.1 * 0.1 * STEEL["rho"] - 0.5, rtol=1e-9)
    assert_allclose(only(sid, "N146").data["total"], -0.5)


def test_more_mass_is_taken_away_than_there_is(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        frame(tmp_path, "2.1+11", "7850.", "-5.")
    assert "negative" in error.value.problem
