"""CONM1, CMASS1 and CMASS2 beside textbook matrices and CONM2."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from tests.sidtool.importers.bars.decks import PBAR, body, frame
from tests.sidtool.importers.bars.test_textbook import arm, by_textbook
from tests.sidtool.importers.decks import frequencies

#: Axes x, y, z of system 5 are y, z, x of the basic system.
SYSTEM = "CORD2R,5,,0.,0.,0.,1.,0.,0.\n,0.,1.,0."
TO_BASIC = [2, 0, 1]
MASS, (IX, IY, IZ) = 0.02, (2e-5, 3e-5, 4e-5)
INERTIA = np.array([IX, IY, IZ])


def test_masses_of_single_directions_are_those_of_one_particle(tmp_path: Path) -> None:
    """Directions 1 to 6 are those of the system of the node (CD)."""
    cards = [f"PMASS,1,{MASS!r},2,{IX!r},3,{IY!r},4,{IZ!r}"]
    cards += [f"CMASS1,{60 + k},1,4,{k}" for k in (1, 2)]
    cards += [f"CMASS2,63,{MASS!r},,,4,3", "CMASS2,69,0.,3,1,4,1"]
    cards += [f"CMASS1,{60 + k},{k - 2},4,{k}" for k in (4, 5, 6)]
    text = frame(PBAR, SYSTEM, *cards)
    text = text.replace("GRID,4,,0.1,0.5,0.7", "GRID,4,,0.1,0.5,0.7,5")
    rotary = np.diag(INERTIA[TO_BASIC])
    expected = by_textbook({}, {3: scipy.linalg.block_diag(MASS * np.eye(3), rotary)})
    assert_allclose(frequencies(body(tmp_path, text)), expected, rtol=1e-8)


def test_a_mass_matrix_of_a_rigid_body_is_read(tmp_path: Path) -> None:
    """CONM1 in a system: J at the node, m r x, and m in its lower triangle."""
    r = np.array([0.02, -0.03, 0.01])
    whole = scipy.linalg.block_diag(MASS * np.eye(3), np.diag(INERTIA))
    at_node = arm(r).T @ whole @ arm(r)
    values = [f"{x:.12e}" for x in at_node[np.tril_indices(6)].tolist()]
    lines = [values[5 + 8 * k : 13 + 8 * k] for k in range(2)]
    card = ",".join(["CONM1,60,3,5", *values[:5]])
    text = frame(PBAR, SYSTEM, *[card, *["," + ",".join(line) for line in lines]])
    own = scipy.linalg.block_diag(MASS * np.eye(3), np.diag(INERTIA[TO_BASIC]))
    expected = by_textbook({}, {2: arm(r[TO_BASIC]).T @ own @ arm(r[TO_BASIC])})
    assert_allclose(frequencies(body(tmp_path, text)), expected, rtol=1e-8)


@pytest.mark.parametrize(
    ("cards", "problem"),
    [
        ("CMASS2,60,5.,3,1\nCMASS2,61,5.,3,2\nCMASS2,62,4.,3,3", "are 5, 5, 4"),
        ("CMASS2,60,5.,3,1,4,1", "between the nodes 3 and 4"),
        ("CMASS2,60,5.,3", "component 0 of 3"),
        ("CMASS2,60,5.", "is at no node"),
        ("CMASS1,60,1,3,1\nPMASS,1,2.\nPMASS,1,3.", "defined twice"),
        ("CONM1,60,3,,5.,,5.\n,,,5.", "are 5, 5, 0"),
        ("CONM1,60,3,,5.,0.1,5.,,\n,5.", "not the one of a rigid body"),
        ("CONM1,60,3,,,,,,\n,,0.3", "not the one of a rigid body"),
    ],
)
def test_what_no_rigid_mass_has_is_refused(
    tmp_path: Path, cards: str, problem: str
) -> None:
    with pytest.raises(InputError, match=problem):
        body(tmp_path, frame(PBAR, cards))


def test_springs_without_mass_are_refused(tmp_path: Path) -> None:
    cards = ["GRID,1,,0.,0.,0.", "GRID,2,,1.,0.,0.", "PBUSH,1,K,1.,1.,1.,1.,1.,1."]
    text = "\n".join(["BEGIN BULK", *cards, "CBUSH,1,1,1,2,,,,0", "ENDDATA", ""])
    with pytest.raises(InputError, match="without any mass"):
        body(tmp_path, text)
