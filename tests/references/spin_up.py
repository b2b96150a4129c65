"""The spin-up of a cantilever (Kane, Ryan & Banerjee) as a model and a scene.

Source: T. Kane, R. Ryan, A. Banerjee, "Dynamics of a cantilever beam attached to a
moving base", J. Guidance 10 (2), 1987.
"""

from __future__ import annotations

import math
from typing import Any

from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data

LENGTH, AXIAL, BENDING, LINE_MASS = 10.0, 2.8e7, 1.4e4, 1.2
SPEED, DURATION = 6.0, 15.0


def blade(
    discretisation: dict[str, Any], reduction: dict[str, Any], *, stiffened: bool
) -> ModelFile:
    """A plane solid with the stiffnesses and the mass of the beam."""
    height = math.sqrt(12 * BENDING / AXIAL)
    data: dict[str, Any] = {
        "format": "sidtool model",
        "version": 1,
        "title": "Spin-up beam",
        "material": {
            "youngs_modulus": AXIAL / height,
            "poissons_ratio": 0.0,
            "density": LINE_MASS / height,
        },
        "geometry": {
            "type": "nurbs",
            "degrees": [1, 1],
            "knots": [[0, 0, 1, 1], [0, 0, 1, 1]],
            "control_points": [
                [[0.0, -height / 2], [0.0, height / 2]],
                [[LENGTH, -height / 2], [LENGTH, height / 2]],
            ],
            "thickness": 1.0,
        },
        "discretisation": discretisation,
        "frame": {"type": "tangent", "marker": "root", "clamp": "left"},
        "markers": {
            "root": {"node": 1, "edge": "left", "at": 0.5},
            "tip": {"node": 2, "edge": "right", "at": 0.5},
        },
        "reduction": reduction,
    }
    if stiffened:
        data["stiffening"] = {}
    return validate_data(data, ModelFile)


def slender_blade(modes: int, elements: int) -> ModelFile:
    """The same as a beam without rotary inertia, by its bending modes in the plane."""
    e = 1e15
    section = {"shape": "general", "area": 1.0, "iy": 1e-5, "iz": BENDING / e}
    data: dict[str, Any] = {
        "format": "sidtool model",
        "version": 1,
        "title": "Spin-up beam",
        "material": {
            "youngs_modulus": e,
            "poissons_ratio": 0.0,
            "density": LINE_MASS,
        },
        "geometry": {
            "type": "beam",
            "start": [0, 0, 0],
            "end": [LENGTH, 0, 0],
            "section": section,
        },
        "discretisation": {"type": "beam", "elements": elements},
        "frame": {"type": "tangent", "marker": "root", "clamp": "start"},
        "markers": {
            "root": {"node": 1, "parameters": [0]},
            "tip": {"node": 2, "parameters": [1]},
        },
        "reduction": {"method": "modal", "modes": modes},
        "stiffening": {},
    }
    return validate_data(data, ModelFile)


def spin_up(end: float) -> SceneFile:
    """The root turns by theta' = (W/T) (t - T/(2 pi) sin(2 pi t/T)), then by W."""
    starts = range(int(DURATION))
    pieces: list[dict[str, Any]] = [
        {"from": float(s), "to": s + 1.0, "start": angle(s), "end": angle(s + 1.0)}
        for s in starts
    ]
    last = {"from": DURATION, "coefficients": [angle(DURATION)[0], SPEED]}
    data = {
        "format": "sidtool scene",
        "version": 1,
        "title": "Spin-up",
        "dimension": "planar",
        "time": {"end": end, "output_step": 0.01},
        "accuracy": {"rtol": 1e-6},
        "bodies": {"beam": {"sid": "beam.SID_FEM", "markers": {"root": 1, "tip": 2}}},
        "joints": {"hub": {"type": "revolute", "markers": ["ground", "beam.root"]}},
        "drives": {
            "spin": {
                "joint": "hub",
                "function": {"type": "polynomial", "pieces": [*pieces, last]},
            }
        },
        "outputs": {"record": ["beam.q*"]},
    }
    return validate_data(data, SceneFile)


def angle(t: float) -> list[float]:
    """The angle of the root and its first four derivatives, t up to `DURATION`."""
    w = 2 * math.pi / DURATION
    s, c, rate = math.sin(w * t), math.cos(w * t), SPEED / DURATION
    return [
        rate * (t * t / 2 + (c - 1) / w**2),
        rate * (t - s / w),
        rate * (1 - c),
        rate * w * s,
        rate * w * w * c,
    ]
