"""Stiffening of trusses by rotation and acceleration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.codes import only

from .decks import NU, E, body, bulk, grids

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

CORNERS = [[0, 0, 0], [1, 0, 0], [0.3, 0.9, 0], [0.4, 0.3, 0.8]]
PAIRS = ((1, 2), (1, 3), (1, 4), (2, 3), (2, 4), (3, 4))
LIGHT = f"MAT1,1,{E!r},,{NU!r},1.-9"
HEAVY = [f"CONM2,{90 + i},{i},,{3.0 + i}" for i in range(1, 5)]


def test_rods_stiffen_as_bars_that_are_pinned_at_both_ends(tmp_path: Path) -> None:
    """With masses at the nodes both have axial forces alone (terms m1)."""
    ends = list(enumerate(PAIRS, 1))
    rods = [f"CROD,{k},1,{a},{b}" for k, (a, b) in ends]
    pinned = [f"CBAR,{k},1,{a},{b},.3,.2,.9,,\n,456,56" for k, (a, b) in ends]
    sids = [
        body(
            tmp_path,
            bulk(*grids(CORNERS), *elements, section, *HEAVY, LIGHT),
            modes=3,
            stiffening={},
        )
        for elements, section in (
            (rods, "PROD,1,1,1.-4"),
            (pinned, "PBAR,1,1,1.-4,1.-9,1.-9,2.-9"),
        )
    ]
    for name in ("Cr", "Oe"):  # modes have either sign
        found, expected = (np.abs(sid.blocks[name].m1) for sid in sids)
        assert expected.max() > 0.1
        assert_allclose(found, expected, rtol=1e-8, atol=1e-9)
    for sid in sids:
        assert only(sid, "N147").data == {"markers": ("p",), "axes": tuple("xyz")}
