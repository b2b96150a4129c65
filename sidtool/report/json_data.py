"""Data of commands for other programs (JSON)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.formats.result import FlexibleBody, Result, units_in
from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.toml.files import File

if TYPE_CHECKING:
    from sidtool.solver.analyses.static_equilibrium import Equilibrium
    from sidtool.solver.system.errors import SimulationError


#: Entries of an output.
_RANGE = ("unit", "first", "least", "greatest", "last")


def to_json_text(data: Any) -> str:
    """Return JSON text; numbers that are not finite become null."""
    return json.dumps(_json_value(data), indent=1, allow_nan=False)


def write_json(path: str | Path, data: Any) -> None:
    """Write JSON text to a file, as a whole or not at all."""
    with atomic_path(path) as temporary:
        Path(temporary).write_text(to_json_text(data) + "\n", encoding="utf-8")


def content_data(content: Any) -> Any:
    """Return the numbers of a SID or a result, or the content of a scene or model."""
    if isinstance(content, SID):
        return sid_data(content)
    return content.file_data() if isinstance(content, File) else result_data(content)


def sid_data(sid: SID) -> dict[str, Any]:
    """Return sizes, mass properties, modes and nodes of a SID."""
    from .sid import natural_modes  # loads the eigensolvers

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
    result: Result,
    span: tuple[float, float, int] | None = None,
    ranges: Mapping[str, Sequence[float]] | None = None,
) -> dict[str, Any]:
    """How the run went, and of each output its range.

    span : first and last output time [s] and number of output times
    ranges : first, least, greatest and last value of each output; default those of the
        rows in the result
    """
    if span is None:
        t = result.t
        span = (t[0], t[-1], len(t)) if len(t) else (math.nan, math.nan, 0)
    unit = units_in(result)
    if ranges is None:
        columns = zip(result.names, result.values.T, strict=True)
        ranges = {
            name: (column[0], np.min(column), np.max(column), column[-1])
            for name, column in columns
            if len(column)
        }
    outputs = {
        name: dict(zip(_RANGE, (unit(name), *values), strict=True))
        for name, values in ranges.items()
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
        "bodies": {name: _body_data(body) for name, body in result.bodies.items()},
        "outputs": outputs,
        "versions": dict(result.versions),
    }


def _body_data(body: FlexibleBody) -> dict[str, Any]:
    """Return deformation, change of stiffness and frequencies of a flexible body."""
    found = body.found or body.expected
    return {
        "deflection": body.deflection,
        "rotation": body.rotation,
        "stiffness_change": found.ratio,
        "by": found.load,
        "lacks_stiffening": found.lacks_stiffening,
        "highest_frequency": body.highest_frequency,
        "excitation": body.excitation.frequency,
    }


def failure_data(error: SimulationError) -> dict[str, Any]:
    """Return why a run or an analysis without any result stopped."""
    return {
        "completed": False,
        "message": str(error),
        "diagnostics": [each.as_data() for each in error.diagnostics],
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
