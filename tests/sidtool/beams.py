"""A uniform cantilever on the x axis as a model file, for tests to vary."""

from __future__ import annotations

import copy
from typing import Any

from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data

IGA = {"type": "iga", "degrees": [3, 2], "elements": [24, 1]}
Q4 = {
    "type": "q4",
    "elements": [200, 2],
    "formulation": "incompatible_modes",
}
DISCRETISATIONS = {"q4": Q4, "iga": IGA}


def beam_data(discretisation: dict[str, Any] | None = None, **changes: Any) -> Any:
    """Length, mass and bending stiffness of one; a hundredth as high as long.

    `changes` replace whole tables.
    """
    height, width = 0.01, 0.01
    stiffness = 12 / (width * height**3)
    data = {
        "format": "sidtool model",
        "version": 1,
        "title": "Uniform cantilever",
        "material": {
            "youngs_modulus": stiffness,
            "poissons_ratio": 0.0,
            "density": 1 / (width * height),
        },
        "geometry": {
            "type": "nurbs",
            "degrees": [1, 1],
            "knots": [[0, 0, 1, 1], [0, 0, 1, 1]],
            "control_points": [
                [[0.0, -height / 2], [0.0, height / 2]],
                [[1.0, -height / 2], [1.0, height / 2]],
            ],
            "thickness": width,
        },
        "discretisation": discretisation or IGA,
        "frame": {"type": "tangent", "marker": "root", "clamp": "left"},
        "markers": {
            "root": {"node": 1, "edge": "left", "at": 0.5},
            "tip": {"node": 2, "edge": "right", "at": 0.5},
        },
        "reduction": {"method": "modal", "modes": 1},
    }
    return copy.deepcopy(data | changes)


def beam(discretisation: dict[str, Any] | None = None, **changes: Any) -> ModelFile:
    """The cantilever as a model file."""
    return validate_data(beam_data(discretisation, **changes), ModelFile)


def clamped_beam(
    length: float,
    height_and_width: tuple[float, float],
    elements: int,
    reduction: dict[str, Any],
) -> ModelFile:
    """A rectangular beam in space along x [m], of beam elements, clamped at one end."""
    height, width = height_and_width
    return beam(
        {"type": "beam", "elements": elements},
        geometry={
            "type": "beam",
            "start": [0, 0, 0],
            "end": [length, 0, 0],
            "section": {"shape": "rectangle", "height": height, "width": width},
        },
        markers={
            "root": {"node": 1, "edge": "start"},
            "tip": {"node": 2, "edge": "end"},
        },
        frame={"type": "tangent", "marker": "root", "clamp": "start"},
        reduction=reduction,
    )
