"""CPS8R with full integration: the modes of the continuum, and no others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.pipeline.model_to_sid import sid_from_model

from .decks import STEEL, deck_file, frequencies
from .test_calculix_engine import plate_deck, shell

#: Free square in plane stress, nu = 0.3: f L sqrt(rho/E) by a program of its own with
#: 14 x 14 elements of eight nodes and 3 x 3 points.
SQUARE = (0.387173, 0.412372, 0.412372, 0.438530, 0.498418, 0.575974)


@pytest.mark.parametrize(("count", "close"), [(2, 0.05), (4, 3.5e-3), (8, 4e-4)])
def test_a_free_square_has_the_modes_of_the_continuum(
    count: int, close: float, tmp_path: Path
) -> None:
    """CalculiX integrates CPS8R and its mass at 2 x 2 points and has further modes:
    with 2 x 2 elements a fifth at 0.4836, so that its sixth is 0.5027.
    """
    text = plate_deck("S8R", 1.0, shell(0.01), count)
    text = text.replace("TYPE=S8R", "TYPE=CPS8R").replace("*SHELL", "*SOLID")
    path = deck_file(tmp_path, text)
    described = path.read_text(encoding="utf-8").replace('"modes": 4', '"modes": 6')
    path.write_text(described, encoding="utf-8")
    sid = sid_from_model(path)
    found = frequencies(sid) * np.sqrt(STEEL["rho"] / STEEL["e"])
    assert_allclose(found, SQUARE, rtol=close)
    assert sid.mass == pytest.approx(0.01 * STEEL["rho"], rel=1e-12)
