"""Models and scenes of studies: a unit cantilever, and a bar that turns in space."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sidtool.formats.scene import SceneFile
from sidtool.study import Setting

from ..accuracy.arms import swinging

IGA = {"type": "iga", "degrees": [3, 2], "elements": [8, 1]}


Q4 = {"type": "q4", "elements": [20, 2], "formulation": "incompatible_modes"}


ONE = (Setting("radau9", rtol=1e-6),)


def written(folder: Path) -> Path:
    path = folder / "scene.json"
    content = swinging(0.3).model_dump(mode="json", by_alias=True, exclude_none=True)
    content["bodies"]["arm"] |= {"model": "iga.json"}
    del content["bodies"]["arm"]["sid"]
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def bar(elements: int = 8, method: str = "modal") -> dict[str, Any]:
    """Bends in two directions and twists; clamped at its root."""
    reduction: dict[str, Any] = {"method": method, "modes": 4}
    if method != "modal":
        reduction["interfaces"] = ["tip"]
    return {
        "format": "sidtool model",
        "version": 1,
        "material": {
            "youngs_modulus": 2e9,
            "poissons_ratio": 0.3,
            "density": 2000.0,
        },
        "geometry": {
            "type": "beam",
            "start": [0.0, 0.0, 0.0],
            "end": [0.5, 0.0, 0.0],
            "section": {"shape": "rectangle", "height": 0.02, "width": 0.01},
        },
        "discretisation": {"type": "beam", "elements": elements},
        "frame": {"type": "tangent", "marker": "root", "clamp": "start"},
        "markers": {
            "root": {"node": 1, "parameters": [0.0]},
            "tip": {"node": 2, "parameters": [1.0]},
        },
        "reduction": reduction,
        "damping": {"type": "rayleigh", "beta": 1e-4},
    }


def turning_bar() -> SceneFile:
    """A body on a hinge across both bending axes, released from the horizontal."""
    hinge = {"type": "revolute", "markers": ["ground", "bar.root"]}
    return SceneFile.model_validate(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial",
            "gravity": [0.0, 0.0, -9.81],
            "time": {"end": 0.1, "output_step": 0.01},
            "bodies": {"bar": {"sid": "bar", "markers": {"root": 1, "tip": 2}}},
            "joints": {"hinge": hinge | {"axis": [0.0, 1.0, 0.3]}},
            "outputs": {"record": ["bar.tip.x", "bar.tip.y", "bar.tip.z"]},
        }
    )
