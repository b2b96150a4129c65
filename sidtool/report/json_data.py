"""Data of commands for other programs (JSON)."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.formats.result import Result, units_in
from sidtool.formats.toml.files import File

from .sid import natural_modes

if TYPE_CHECKING:
    from sidtool.solver.analyses.static_equilibrium import Equilibrium


def to_json_text(data: Any) -> str:
    """Return JSON text; numbers that are not finite become null."""
    return json.dumps(_json_value(data), indent=1, allow_nan=False)


def content_data(content: Any) -> Any:
    """Return the numbers of a SID or a result, or the content of a scene or model."""
    if isinstance(content, SID):
        return sid_data(content)
    return content.file_data() if isinstance(content, File) else result_data(content)


def sid_data(sid: SID) -> dict[str, Any]:
    """Return sizes, mass properties, modes and nodes of a SID."""
    return {
        "title": sid.title,
        "written_by": sid.written_by or None,
        "mass": sid.mass,
        "centre_of_mass": sid.mdCM.m0[:, 0] / sid.mass if sid.mass else None,
        "inertia": sid.J.m0[:, 0],
        "modes": [
            {"frequency": mode.frequency, "label": label.strip()}
            for mode, label in zip(natural_modes(sid), sid.labels, strict=False)
        ],
        "nodes": {node.id: node.position for node in sid.nodes},
        "diagnostics": [each.as_data() for each in sid.diagnostics],
    }


def result_data(
    result: Result, span: tuple[float, float, int] | None = None
) -> dict[str, Any]:
    """How the run went, and of each output its range.

    span : first and last output time [s] and number of output times
    """
    if span is None:
        t = result.t
        span = (t[0], t[-1], len(t)) if len(t) else (math.nan, math.nan, 0)
    unit = units_in(result)
    outputs = {
        name: {
            "unit": unit(name),
            "first": column[0],
            "least": np.min(column),
            "greatest": np.max(column),
            "last": column[-1],
        }
        for name, column in zip(result.names, result.values.T, strict=True)
        if len(column)
    }
    return {
        "title": result.title,
        "completed": result.completed,
        "message": result.message,
        "times": dict(zip(("first", "last", "count"), span, strict=True)),
        "settings": dict(result.settings),
        "counters": dict(result.counters),
        "drift": dict(result.drift),
        "error": result.error,
        "accuracy": None
        if result.accuracy is None
        else result.accuracy.model_dump(mode="json"),
        "diagnostics": [each.as_data() for each in result.diagnostics],
        "events": [{"name": e.name, "kind": e.kind, "t": e.t} for e in result.events],
        "bodies": {name: body.after for name, body in result.bodies.items()},
        "outputs": outputs,
        "versions": dict(result.versions),
    }


def equilibrium_data(equilibrium: Equilibrium) -> dict[str, Any]:
    """Return outputs and forces of joints and drives in equilibrium."""
    result = equilibrium.result()
    outputs = dict(zip(result.names, result.values[0], strict=True))
    forces = result.multiplier_names, result.multipliers[0]
    return {
        "iterations": equilibrium.iterations,
        "residual": equilibrium.residual,
        "outputs": outputs,
        "forces": dict(zip(*forces, strict=True)),
        "diagnostics": [each.as_data() for each in result.diagnostics],
    }


def _json_value(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _json_value(part) for key, part in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _json_value(value.tolist())
    if isinstance(value, list | tuple):
        return [_json_value(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
