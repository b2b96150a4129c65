"""Forces of a scene as rows of the kernels' table; bushings become several.

One entry in `_COMPILERS` adds a kind.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import (
    Actuator,
    Bushing,
    Expression,
    Force,
    Friction,
    Given,
    Pid,
    PointForce,
    SceneFile,
    SpringDamper,
    as_3d,
    marker_reference,
)

from ...functions.laws import Law as GivenLaw
from ...functions.table import FunctionTable
from ...space import layout as at
from .elements import Element, joint_coordinate
from .force_laws import NOTHING, Law, characteristic, powers
from .matrix_laws import antisymmetric_part, as_matrix, symmetric_part


def compile_forces(
    scene: SceneFile,
    functions: FunctionTable,
    planar: bool,
    programs: Mapping[str, Any],
    rows_of: Callable[[Element], list[Element]],
) -> tuple[Element, ...]:
    """The elements of all forces of a scene.

    programs : callables and laws that replace the functions of forces
    rows_of : adds to an element that may have a law what belongs to that

    Raises
    ------
    InputError : a callable for a force that does not exist or is no function of time.
    """
    _check_programs(scene, programs)
    found: list[Element] = []
    for name, force in scene.forces.items():
        function, row = getattr(force, "function", None), -1
        program = programs.get(name)
        is_law = isinstance(program or function, Expression | Pid | GivenLaw)
        if not is_law and (function is not None or program is not None):
            place = f"forces.{name}.function"
            row = functions.add(function or Given(type="callable"), place, program)
        context = _Context(name, scene, planar, row)
        for element in _COMPILERS[type(force)](force, context):
            found += rows_of(element)
    return tuple(found)


def force_element(scene: SceneFile, name: str) -> Element:
    """The element of a force along one coordinate, without its function."""
    force, planar = scene.forces[name], scene.dimension == "planar"
    (element,) = _COMPILERS[type(force)](force, _Context(name, scene, planar, -1))
    return element


def _check_programs(scene: SceneFile, programs: Mapping[str, Any]) -> None:
    timed = [name for name, force in scene.forces.items() if hasattr(force, "function")]
    for name in programs:
        if name not in timed:
            known = scene.forces.get(name)
            found = f"there is no force {name!r} for a callable"
            if known is not None:
                found = f"{name} is a {known.type}, which is no function of time"
            raise InputError(
                found,
                place="forces",
                expected=", ".join(timed) or "a force or an actuator in the scene",
            )


@dataclass(frozen=True)
class _Context:
    name: str
    scene: SceneFile
    planar: bool
    function: int


def _point_force(force: PointForce, context: _Context) -> list[Element]:
    components = as_3d(force.force)
    torque = np.zeros(3)
    if force.torque is not None:
        torque[:] = force.torque if isinstance(force.torque, tuple) else 0.0
        if context.planar:
            torque[2] = float(np.ravel(force.torque)[-1])
    data = [*components[:2], torque[2]] if context.planar else [*components, *torque]
    kind = at.GIVEN if force.axes == "inertial" else at.FOLLOWING
    marker = marker_reference(force.marker)
    values = tuple(map(float, data))
    return [Element(context.name, kind, None, marker, values, Law(), context.function)]


def _spring_damper(force: SpringDamper, context: _Context) -> list[Element]:
    stiffness = powers(force.stiffness)
    if force.table is not None:
        stiffness = characteristic(force.table)
    law = Law(rest=force.rest, stiffness=stiffness, damping=powers(force.damping))
    return [_pair(force.markers, force.joint, force.coordinate, law, context)]


def _actuator(force: Actuator, context: _Context) -> list[Element]:
    law = Law(applied=1.0)
    return [_pair(force.markers, force.joint, force.coordinate, law, context)]


def _friction(force: Friction, context: _Context) -> list[Element]:
    viscous = powers((force.viscous,)) if force.viscous else NOTHING
    law = Law(friction=force.force, speed=force.speed, damping=viscous)
    return [_pair(None, force.joint, force.coordinate, law, context)]


def _pair(
    markers: tuple[str, str] | None,
    joint: str | None,
    coordinate: str | None,
    law: Law,
    context: _Context,
) -> Element:
    """A force along the line between two markers, or on the coordinate of a joint."""
    if joint is None:
        assert markers is not None
        a, b = (marker_reference(text) for text in markers)
        return Element(context.name, at.SPAN, a, b, (), law, context.function)
    name = coordinate or context.scene.joints[joint].coordinates[0]
    measure = joint_coordinate(context.scene, joint, name)
    return replace(measure, name=context.name, law=law, function=context.function)


def _bushing(force: Bushing, context: _Context) -> list[Element]:
    a, b = (marker_reference(text) for text in force.markers)
    measures: list[tuple[int, tuple[float, ...]]]
    if context.planar:
        measures = [(at.SLIDE, (0.0,)), (at.SLIDE, (0.5 * math.pi,))]
        measures.append((at.TWIST, (0.0,)))
    else:
        measures = [(at.SLIDE, e) for e in _AXES]
        measures += _about_shaft(force.shaft) if force.shaft else _about_axes()
    each = [Element(context.name, kind, a, b, data, Law()) for kind, data in measures]
    K = as_matrix(force.stiffness)
    D = np.zeros(K.shape) if force.damping is None else as_matrix(force.damping)
    return [*symmetric_part(each, K, D), *antisymmetric_part(each, K, D)]


_AXES = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]


def _about_axes() -> list[tuple[int, tuple[float, ...]]]:
    """Components of the rotation vector."""
    return [(at.TILT, e) for e in _AXES]


def _about_shaft(shaft: str) -> list[tuple[int, tuple[float, ...]]]:
    """The angle about an axis of the first marker, and sines of its tilts about the
    other two: components of the shaft across the axis."""
    k = "xyz".index(shaft)
    i, j = (k + 1) % 3, (k + 2) % 3
    minus_j = tuple(-c for c in _AXES[j])
    found = {
        i: (at.LEAN, (*minus_j, *_AXES[k])),
        j: (at.LEAN, (*_AXES[i], *_AXES[k])),
        k: (at.TWIST, (*_AXES[i], *_AXES[j])),
    }
    return [found[axis] for axis in range(3)]


_COMPILERS: dict[type[Force], Callable[..., list[Element]]] = {
    PointForce: _point_force,
    SpringDamper: _spring_damper,
    Actuator: _actuator,
    Bushing: _bushing,
    Friction: _friction,
}
