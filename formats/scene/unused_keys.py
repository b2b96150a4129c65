"""Keys of a scene that are given and have no effect."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ..diagnostics import Diagnostic, diagnose
from ..toml.tables import Table
from .bodies import SidBody
from .tables import SceneTables

#: Keys of a flexible body, and of its start, that only count for its deformation.
_DEFORMATION = (
    "shape_functions",
    "quadratic_inertia",
    "geometric_stiffening",
    "damping",
)
_ELASTIC = ("elastic", "elastic_velocity")


def unused_keys(
    scene: SceneTables, *, fixed_step: bool, spectral_radius: bool
) -> Iterator[Diagnostic]:
    """Yield N244 for each reason why given keys have no effect.

    A key that has its default value is not mentioned.

    Parameters
    ----------
    fixed_step : whether the run has steps of one size
    spectral_radius : whether its integrator has a spectral radius
    """
    given = set(_changed_keys(scene.accuracy, ("rtol", "spectral_radius")))
    if fixed_step and "rtol" in given:
        yield diagnose("N244", "accuracy.rtol", reason="the step is fixed")
    if not spectral_radius and "spectral_radius" in given:
        reason = "it is for generalised_alpha"
        yield diagnose("N244", "accuracy.spectral_radius", reason=reason)
    for name, body in scene.sid_bodies.items():
        idle = list(_idle_keys(body)) if body.rigid else []
        if idle:
            listed = ", ".join(f"bodies.{name}.{key}" for key in idle)
            yield diagnose("N244", listed, reason=f"{name} is rigid")


def _idle_keys(body: SidBody) -> Iterator[str]:
    yield from _changed_keys(body, _DEFORMATION)
    for key in _changed_keys(body.initial, _ELASTIC):
        yield f"initial.{key}"


def _changed_keys(table: Table, keys: Iterable[str]) -> Iterator[str]:
    """Yield the keys whose values are not the default."""
    fields: Any = type(table).model_fields
    for key in keys:
        if getattr(table, key) != fields[key].default:
            yield key
