"""Straight beams and their scenes as files, for reference problems."""

from __future__ import annotations

from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model

#: Frames by what holds the body in them.
CLAMPED = {"type": "tangent", "marker": "start", "clamp": "start"}
AT_START = {"type": "tangent", "marker": "start"}
AT_END = {"type": "tangent", "marker": "end"}
BOTH_ENDS = {"type": "chord", "markers": ["start", "end"]}


def beam(
    length: float,
    section: dict[str, float],
    material: tuple[float, float, float],
    elements: int,
    tables: dict[str, Any],
    masses: tuple[dict[str, Any], ...] = (),
    **discretisation: str,
) -> SID:
    """A beam on x with markers at both ends.

    Parameters
    ----------
    material : Young's modulus, Poisson's ratio, density
    tables : `frame`, `reduction`, `stiffening` as in a model file
    """
    names = ("youngs_modulus", "poissons_ratio", "density")
    return sid_from_model(
        validate_data(
            {
                "format": "sidtool model",
                "version": 1,
                "material": dict(zip(names, material, strict=True)),
                "geometry": {
                    "type": "beam",
                    "start": [0.0, 0.0, 0.0],
                    "end": [length, 0.0, 0.0],
                    "section": {"shape": "general", **section},
                    "masses": list(masses),
                },
                "discretisation": {
                    "type": "beam",
                    "elements": elements,
                    **discretisation,
                },
                "markers": {
                    "start": {"node": 1, "parameters": [0.0]},
                    "end": {"node": 2, "parameters": [1.0]},
                },
                **tables,
            },
            ModelFile,
        )
    )


def hertz(sid: SID) -> Array:
    """Frequencies of a body whose shape functions are its natural modes [Hz]."""
    values = np.diag(sid.Ke.m0) / np.diag(sid.Me.m0)
    return np.asarray(np.sqrt(values) / (2 * np.pi))


def scene(length: float, **tables: Any) -> SceneFile:
    """A spatial scene of the body `beam`, ground markers where its ends are."""
    body = {"sid": "-", "markers": {"start": 1, "end": 2}, **tables.pop("body", {})}
    ends = {"start": {"position": [0, 0, 0]}, "end": {"position": [length, 0, 0]}}
    return validate_data(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial",
            "time": {"end": 1.0, "output_step": 0.5},
            "ground": {"markers": ends},
            "bodies": {"beam": body},
            "outputs": {"record": ["beam.x"]},
            **tables,
        },
        SceneFile,
    )
