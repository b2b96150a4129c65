"""The piston rod in three dimensions and as a beam, as model files for tests."""

from __future__ import annotations

from typing import Any

from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data

from .models import rod_data

WIDTH = 0.01
SOLIDS = {
    "hex8": {
        "type": "hex8",
        "elements": [60, 4, 1],
        "formulation": "incompatible_modes",
    },
    "hex20": {"type": "hex20", "elements": [20, 2, 1]},
    "tet10": {"type": "tet10", "elements": [30, 2, 1]},
    "iga": {"type": "iga", "degrees": [4, 3, 2], "elements": [10, 1, 1]},
}
BEAMS = {
    "beam": {"type": "beam", "elements": 30},
    "timoshenko": {"type": "beam", "elements": 30, "theory": "timoshenko"},
    "lumped": {
        "type": "beam",
        "elements": 60,
        "theory": "timoshenko",
        "mass": "lumped",
    },
}


def volume_geometry() -> dict[str, Any]:
    """The rod's outline, extruded about the plane z = 0."""
    columns = rod_data()["geometry"]["control_points"]
    points = [
        [[[*p, -WIDTH / 2], [*p, WIDTH / 2]] for p in column] for column in columns
    ]
    return {
        "type": "nurbs_volume",
        "degrees": [2, 1, 1],
        "knots": [[0, 0, 0, 1, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1]],
        "control_points": points,
    }


def volume_data(discretisation: dict[str, Any], modes: int = 9) -> dict[str, Any]:
    """The rod as a solid, as plain data."""
    data = rod_data(discretisation)
    data["geometry"] = volume_geometry()
    data["markers"] = {
        "crank_pin": {"node": 1, "edge": "left", "at": [0.5, 0.5]},
        "piston_pin": {"node": 2, "edge": "right", "at": [0.5, 0.5]},
    }
    data["reduction"]["modes"] = modes
    return dict(data)


def beam_data(discretisation: dict[str, Any], modes: int = 9) -> dict[str, Any]:
    """The rod as a beam of parabolic height, as plain data."""
    data = rod_data(discretisation)
    data["geometry"] = {
        "type": "beam",
        "start": [0, 0, 0],
        "end": [1, 0, 0],
        "section": {
            "shape": "rectangle",
            "height": [0.06, 0.03, 0.06],
            "width": WIDTH,
        },
        "interpolation": "polynomial",
    }
    data["frame"] = {"type": "tangent", "marker": "crank_pin", "clamp": "start"}
    data["markers"] = {
        "crank_pin": {"node": 1, "parameters": [0]},
        "piston_pin": {"node": 2, "parameters": [1]},
    }
    data["reduction"]["modes"] = modes
    return dict(data)


def volume(discretisation: dict[str, Any], modes: int = 9) -> ModelFile:
    """The rod as a solid."""
    return validate_data(volume_data(discretisation, modes), ModelFile)


def beam(discretisation: dict[str, Any], modes: int = 9) -> ModelFile:
    """The rod as a beam."""
    return validate_data(beam_data(discretisation, modes), ModelFile)
