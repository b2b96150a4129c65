"""Steel bars of 1 m along x, clamped at `root` (node 1) and free at `tip` (node 2)."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from sidtool.conversion.frame_change import change_frame
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model

TANGENT, CHORD, MEAN = FRAMES = ("tangent:1", "chord:1,2", "buckens")


def bar_data(
    width: float = 0.02,
    height: float = 0.02,
    elements: int = 10,
    modes: int = 3,
    **tables: Any,
) -> Any:
    """A model of the bar by its modes, with other tables."""
    data = {
        "format": "sidtool model",
        "version": 1,
        "material": {
            "youngs_modulus": 2.1e11,
            "poissons_ratio": 0.3,
            "density": 7850.0,
        },
        "geometry": {
            "type": "beam",
            "start": [0, 0, 0],
            "end": [1, 0, 0],
            "section": {"shape": "rectangle", "width": width, "height": height},
        },
        "discretisation": {"type": "beam", "elements": elements},
        "frame": {"type": "tangent", "marker": "root", "clamp": "start"},
        "markers": {
            "root": {"node": 1, "parameters": [0]},
            "tip": {"node": 2, "parameters": [1]},
        },
        "reduction": {"method": "modal", "modes": modes},
    }
    return data | tables


def steel_bar(**described: Any) -> SID:
    """The SID of `bar_data`, converted once; it may be stout, of which a conversion
    warns."""
    return _converted(json.dumps(described))


@cache
def _converted(described: str) -> SID:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data = bar_data(**json.loads(described))
        return sid_from_model(validate_data(data, ModelFile))


@cache
def slender_bar(modes: int, frame: str, stiffened: bool = True) -> SID:
    """30 mm wide, 20 mm high, without damping, in any body frame."""
    tables = {"stiffening": {}} if stiffened else {}
    sid = steel_bar(width=0.03, elements=24, modes=modes, **tables)
    undamped = replace(sid, De=Taylor(np.zeros((modes, modes))))
    return change_frame(undamped, frame)
