"""Model files as data, for tests to vary."""

from __future__ import annotations

import copy
import json
from functools import cache
from typing import Any

import numpy as np

from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import read_data, validate_data
from tests.places import SLIDER_CRANK

#: The smallest sensible discretisations of each frontend.
Q4 = {"type": "q4", "elements": [30, 4], "formulation": "full_integration"}
QM6 = {**Q4, "formulation": "incompatible_modes"}
IGA = {"type": "iga", "degrees": [3, 2], "elements": [10, 2]}
DISCRETISATIONS = {"q4": Q4, "qm6": QM6, "iga": IGA}


@cache
def _rod_text() -> str:
    return json.dumps(read_data(SLIDER_CRANK / "rod_q4.toml"))


def rod_data(discretisation: dict[str, Any] | None = None, **changes: Any) -> Any:
    """The piston rod as plain data; `changes` replace whole tables."""
    data = json.loads(_rod_text())
    data["discretisation"] = copy.deepcopy(discretisation or Q4)
    return data | changes


def rod(discretisation: dict[str, Any] | None = None, **changes: Any) -> ModelFile:
    """The piston rod."""
    return validate_data(rod_data(discretisation, **changes), ModelFile)


def annulus(discretisation: dict[str, Any]) -> ModelFile:
    """A quarter annulus, radii 1 and 2 m: exact with rational weights."""
    w = np.sqrt(0.5)
    data = rod_data(discretisation)
    data["geometry"] = {
        "type": "nurbs",
        "degrees": [1, 2],
        "knots": [[0, 0, 1, 1], [0, 0, 0, 1, 1, 1]],
        "control_points": [
            [[1, 0], [1, 1], [0, 1]],
            [[2, 0], [2, 2], [0, 2]],
        ],
        "weights": [[1, w, 1], [1, w, 1]],
        "thickness": 0.1,
        "edges": {"foot": "bottom", "inner": "left"},
    }
    data["frame"] = {"type": "tangent", "marker": "foot", "clamp": "foot"}
    data["markers"] = {
        "foot": {"node": 1, "edge": "foot", "at": 0.5},
        "end": {"node": 2, "edge": "top", "at": 0.5},
    }
    return validate_data(data, ModelFile)


def moved(data: Any, angle: float, shift: tuple[float, float]) -> ModelFile:
    """The same part, turned about the origin and then displaced."""
    data = copy.deepcopy(data)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = np.array(data["geometry"]["control_points"], float) @ turn.T + shift
    data["geometry"]["control_points"] = points.tolist()
    return validate_data(data, ModelFile)
