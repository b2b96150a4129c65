"""Keys of a scene that are given and have no effect."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from ..diagnostics import Diagnostic, diagnose
from ..toml.expressions import output_names
from ..toml.files import unread_names
from ..toml.tables import Table
from .bodies import RigidBody, SidBody
from .functions import Given, InputFunction
from .laws import Expression
from .outputs import INPUTS
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
    used = set(_used_inputs(scene))
    for name in scene.inputs:
        if name not in used:
            reason = "no force, drive or formula takes it"
            yield diagnose("N244", f"inputs.{name}", reason=reason)
    for key in _unread_keys(scene):
        yield diagnose("N244", key, reason="no formula reads it")
    for name, body in scene.bodies.items():
        is_point_mass = isinstance(body, RigidBody) and body.inertia is None
        if is_point_mass and any(np.ravel(body.initial.angular_velocity or 0.0)):
            key = f"bodies.{name}.initial.angular_velocity"
            yield diagnose("N244", key, reason=f"{name} is a point mass")
    for name, body in scene.sid_bodies.items():
        idle = list(_idle_keys(body)) if body.rigid else []
        if idle:
            listed = ", ".join(f"bodies.{name}.{key}" for key in idle)
            yield diagnose("N244", listed, reason=f"{name} is rigid")


def _unread_keys(scene: SceneTables) -> Iterator[str]:
    """Yield parameters, tables and terms that no formula names."""
    given = [f"parameters.{name}" for name in scene.unread_names(scene.parameters)]
    yield from given + [f"tables.{name}" for name in scene.unread_names(scene.tables)]
    for key in ("forces", "drives"):
        for owner, part in getattr(scene, key).items():
            law = getattr(part, "function", None)
            if isinstance(law, Expression):
                data = law.file_data()
                for table in ("parameters", "terms"):
                    for name in unread_names(getattr(law, table), data):
                        yield f"{key}.{owner}.function.{table}.{name}"


def _used_inputs(scene: SceneTables) -> Iterator[str]:
    """Yield the inputs that forces and drives take; all of them if a program gives
    one of their laws, which may read any."""
    for owner in (*scene.forces.values(), *scene.drives.values()):
        function = getattr(owner, "function", None)
        reference = getattr(function, "reference", None)
        for part in (function, reference, *getattr(function, "parts", ())):
            if isinstance(part, InputFunction):
                yield part.name
        if isinstance(function, Expression):
            states = function.states.values()
            texts = (text for state in states for text in (state.rate, state.next))
            for text in (function.value, *texts):
                for name in output_names(function.parse(text or "0")):
                    yield name.removeprefix(f"{INPUTS}.")
        if isinstance(function, Given) and not function.terms:
            yield from scene.inputs


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
