"""Markers at single points of continua, whose compliance grows with the mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.model import ModelFile
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import with_code

from ..beams import beam_data

#: Young's modulus times thickness.
STIFFNESS = beam_data()["material"]["youngs_modulus"] * 0.01


def tip_deflection(cells: int, tie: bool) -> tuple[float, list[Diagnostic]]:
    """Return the axial compliance of the end of a clamped strip, and the notes."""
    data: dict[str, Any] = beam_data({"type": "q4", "elements": [4 * cells, cells]})
    corners = [[[x, -0.5], [x, 0.5]] for x in (0.0, 4.0)]
    data["geometry"] |= {"control_points": corners}
    data["reduction"] = {"method": "attachment", "modes": 1, "interfaces": ["tip"]}
    if tie:
        spread = {"type": "distributing", "to": "right"}
        data["markers"]["tip"] = {"node": 2, "tie": spread}
    sid = sid_from_model(ModelFile.model_validate(data))
    along: Array = sid.nodes[1].phi.m0[0]
    compliance = float(along @ np.linalg.solve(sid.Ke.m0, along))
    return compliance, with_code(sid, "N163")


def test_a_marker_whose_compliance_diverges_is_noted_and_a_tied_one_is_not() -> None:
    """Flamant: each halving adds 2 ln 2 / (pi E t) to the compliance of an edge."""
    for tie, meshes in ((False, (4, 8, 16)), (True, (4, 8))):
        found = [tip_deflection(cells, tie) for cells in meshes]
        compliances = np.array([compliance for compliance, _ in found])
        expected = 0.0 if tie else 2.0 * np.log(2.0) / (np.pi * STIFFNESS)
        assert np.diff(compliances) == pytest.approx(expected, rel=0.1, abs=1e-12)
        for _, notes in found:
            assert [note.subject for note in notes] == ([] if tie else ["tip"])
