"""Rounding errors of outputs that are zero by symmetry. Such an output is a sum of
terms that cancel except for rounding. The size of the terms is estimated from other
outputs with the same unit, and from products of lengths, rates and forces of the
mechanism: a torque is a force times a length, a velocity a rate times a length.
Deformations are compared with those of their body, whose shape functions are known to
fewer digits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, parse_output as parsed, unit_of
from sidtool.formats.scene.outputs import is_elastic
from sidtool.formats.scene.wildcards import known_outputs

if TYPE_CHECKING:
    from sidtool.solver.system.system import System

#: Relative rounding error of terms that cancel; of deformations relative to other shape
#: functions, and of their loads; and of deformations relative to the size of the
#: mechanism if a body hardly deforms.
ROUNDED, ROUNDED_SHAPES, SMALLEST = 1e-12, 1e-9, 1e-17
_SECOND, _SQUARED = "m/s\N{SUPERSCRIPT TWO}", "kg m\N{SUPERSCRIPT TWO}/s"
#: Units of the other outputs that determine the size of terms, by the unit of an
#: output.
_RATES, _EFFORTS = ("m/s", "rad/s"), ("N", "N m")
_LOADS = (*_EFFORTS, "W", "Pa")
_SOURCES: Mapping[str, tuple[str, ...]] = {
    "m/s": _RATES,
    "rad/s": _RATES,
    _SECOND: (*_RATES, _SECOND),
    "N": _EFFORTS,
    "N m": _EFFORTS,
    "W": (*_RATES, *_EFFORTS, "W"),
    "J": ("J",),
    "Pa": ("Pa",),
    "kg m/s": _RATES,
    _SQUARED: _RATES,
}

_PLACES = (".x", ".y", ".z")


def rounding_levels(result: Result, system: System, names: Sequence[str]) -> Array:
    """Return the effect of rounding on outputs (n,); zero if it is not known.

    Parameters
    ----------
    result : a run
    system : its compiled scene
    names : outputs, recorded or not
    """
    scene = system.scene
    units = [unit_of(name, scene) for name in names]
    sizes = _sizes_of_units(result, system, _largest_by_unit(result, scene, units))
    deformations = _levels_of_deformations(result, system)
    parts = dict.fromkeys(_LOADS, ROUNDED_SHAPES if scene.flexible else ROUNDED)
    levels = np.array([parts.get(u, ROUNDED) * sizes.get(u, 0.0) for u in units])
    for i, name in enumerate(names):
        owner, marker, quantity = parsed(name)
        if is_elastic(quantity):
            levels[i] = deformations.get(name, 0.0)
        elif marker and quantity in ("ux", "uy", "uz"):
            levels[i] = deformations.get(owner, levels[i])
    return levels


def _largest_by_unit(
    result: Result, scene: SceneFile, units: Sequence[str]
) -> dict[str, float]:
    """Return the largest absolute value of all outputs of a scene by unit, for the
    units that some given units depend on.
    """
    from sidtool.solver.output.body_outputs import unavailable_outputs
    from sidtool.solver.simulation.replay import replay

    wanted = {source for unit in units for source in _SOURCES.get(unit, ())}
    names = [
        n for n in known_outputs(scene, result.sids) if unit_of(n, scene) in wanted
    ]
    unavailable = unavailable_outputs(names, scene, result.laws, between=False)
    missing = [
        name for name in names if name not in unavailable and name not in result.names
    ]
    columns = dict(zip(result.names, np.asarray(result.values).T, strict=True))
    if missing:
        with suppress(InputError):
            columns |= replay(result, missing).outputs()
    largest: dict[str, float] = {}
    for name, values in columns.items():
        unit = unit_of(name, scene)
        size = float(np.abs(values).max(initial=0.0))
        largest[unit] = max(largest.get(unit, 0.0), size)
    return largest


def _sizes_of_units(
    result: Result, system: System, largest: Mapping[str, float]
) -> dict[str, float]:
    """Return the size of the terms by the unit of an output."""
    scene = system.scene
    duration = scene.time.end - scene.time.start
    gravity = float(np.linalg.norm(scene.gravity or [0.0]))
    mass = sum(data.sid.mass for data in system.bodies if data.is_scene_body)
    known = largest.get
    positions = [i for i, n in enumerate(result.position_names) if n[-2:] in _PLACES]
    way = float(np.abs(result.positions[:, positions]).max(initial=0.0))
    length = max(system.length, known("m", 0.0), way)
    rate = max(known("rad/s", 0.0), known("m/s", 0.0) / system.length, 1.0 / duration)
    speed = rate * length
    force = max(known("N", 0.0), known("N m", 0.0) / system.length, mass * gravity)
    return {
        "m": length,
        "rad": 1.0,
        "m/s": speed,
        "rad/s": rate,
        _SECOND: max(known(_SECOND, 0.0), speed * rate, gravity),
        f"rad/s{_SECOND[-1]}": rate * rate,
        "N": force,
        "N m": max(known("N m", 0.0), force * length),
        "W": max(known("W", 0.0), force * speed),
        "J": known("J", 0.0),
        "Pa": known("Pa", 0.0),
        "kg m/s": mass * speed,
        _SQUARED: mass * speed * length,
        "m s": length * duration,
        "rad s": duration,
    }


def _levels_of_deformations(result: Result, system: System) -> dict[str, float]:
    """Return the effect of rounding on elastic coordinates, velocities and
    displacements.

    The results are by name, for displacements by body.
    """
    from sidtool.solver.system.characteristic_sizes import coordinate_amplitudes

    amplitudes = coordinate_amplitudes(system)
    columns = dict(zip(result.velocity_names, amplitudes, strict=False))
    duration = system.scene.time.end - system.scene.time.start
    least = SMALLEST * system.length
    tables = (
        ("q", least, result.position_names, result.positions),
        ("vq", least / duration, result.velocity_names, result.velocities),
    )
    levels: dict[str, float] = {}
    for prefix, smallest, names, table in tables:
        bodies: dict[str, list[tuple[str, float, float]]] = {}
        for name, column in zip(names, table.T, strict=True):
            body, _, quantity = name.partition(".")
            if quantity.rstrip("0123456789") != prefix:
                continue
            amplitude = float(columns[f"{body}.v{quantity.removeprefix('v')}"])
            size = float(np.abs(column).max(initial=0.0)) * amplitude
            bodies.setdefault(body, []).append((name, size, amplitude))
        for body, rows in bodies.items():
            level = max(smallest, *(ROUNDED_SHAPES * size for _, size, _ in rows))
            levels |= {name: level / amplitude for name, _, amplitude in rows}
            levels.setdefault(body, level)
    return levels
