"""Forces of a scene as rows of the kernels' table; bushings become several.

A row acts on one scalar measure of the motion of two markers (`Element`), or is given
as a function of time. One entry in `_COMPILERS` adds a kind.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
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
    marker_names,
    marker_reference,
)

from ...functions.laws import Law as GivenLaw
from ...functions.native import Native
from ...functions.pool import Pool
from ...functions.table import FunctionTable
from ...space import layout as at
from ...space.layout import IntTable
from ..ingredients import Reference
from ..joints import joint_parts
from .force_laws import NOTHING, Law, characteristic, powers


@dataclass(frozen=True, eq=False)
class Programmed:
    """The law of a row of the table of forces.

    reads : (which of its measures, 1 for its rate) of all outputs that it reads
    natives : callables in it, whose addresses its code holds
    """

    reads: Mapping[str, tuple[int, int]]
    natives: tuple[Native, ...]


@dataclass(frozen=True, eq=False)
class Element:
    """One row of the force table.

    kind : see `space.layout`
    a, b : markers; a given force has no `a`
    data : direction or components
    function : row of its function of time, -1 for none
    coordinate : joint and coordinate that are its measure, if they are
    turn : entry of Work.turn that is its measure, -1 for none, see `turns`
    code : instructions of its law, see `kernels.forces.programs`; empty for none
    programmed : what is known of that law
    rates : of a drive, how many rows behind it those of its two derivatives are
    is_read : no force, but a measure for the next row that has a law
    sampled : time between samples of its law [s], 0 for one that acts all the time
    """

    name: str
    kind: int
    a: Reference | None
    b: Reference
    data: tuple[float, ...]
    law: Law
    function: int = -1
    coordinate: tuple[str, str] | None = None
    turn: int = -1
    code: tuple[float, ...] = ()
    programmed: Programmed | None = None
    rates: tuple[int, int] | None = None
    is_read: bool = False
    sampled: float = 0.0

    @property
    def acts(self) -> bool:
        """Whether it is a force on bodies; else a measure, or a law of a state or a
        drive."""
        return not self.is_read and self.kind < at.COORDINATE


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


def joint_coordinate(scene: SceneFile, joint: str, coordinate: str) -> Element:
    """What measures a coordinate of a joint, without a force."""
    connects = scene.joints[joint]
    parts = joint_parts(connects, scene.dimension == "planar")
    part = parts.coordinates[coordinate]
    a, b = (marker_reference(text) for text in marker_names(connects))
    if part.swapped:
        a, b = b, a
    data, key = tuple(map(float, part.data)), (joint, coordinate)
    return Element(joint, _MEASURES[part.kind], a, b, data, Law(), coordinate=key)


#: The measure that is the coordinate of a primitive constraint.
_MEASURES = {at.ANGLE: at.TWIST, at.ALONG: at.SLIDE, at.DISTANCE: at.SPAN}


def _bushing(force: Bushing, context: _Context) -> list[Element]:
    a, b = (marker_reference(text) for text in force.markers)
    damping = force.damping or (0.0,) * len(force.stiffness)
    measures: list[tuple[int, tuple[float, ...]]]
    if context.planar:
        measures = [(at.SLIDE, (0.0,)), (at.SLIDE, (0.5 * math.pi,))]
        measures.append((at.TWIST, (0.0,)))
    else:
        measures = [(at.SLIDE, e) for e in _AXES]
        measures += _about_shaft(force.shaft) if force.shaft else _about_axes()
    return [
        Element(
            context.name,
            kind,
            a,
            b,
            data,
            Law(stiffness=powers((k,)), damping=powers((d,))),
        )
        for (kind, data), k, d in zip(measures, force.stiffness, damping, strict=True)
        if k != 0.0 or d != 0.0
    ]


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


def force_table(
    elements: tuple[Element, ...],
    markers: dict[Reference, int],
    order: Sequence[str],
    pool: Pool,
) -> IntTable:
    """The table of forces, without their rows in Newton matrices.

    order : names of bodies, as in their table
    """
    table = np.full((len(elements), at.N_FORCE), -1, np.int64)
    for k, (row, element) in enumerate(zip(table, elements, strict=True)):
        row[at.F_KIND], row[at.F_SAMPLED] = element.kind, 0
        if element.kind == at.COORDINATE:
            row[at.F_B] = order.index(element.b[0])
            row[at.F_DATA] = int(element.data[0])
        elif element.kind == at.PRESCRIBED:
            row[[at.F_A, at.F_B]] = k + np.array(element.rates or (0, 0))
        else:
            row[at.F_A] = -1 if element.a is None else markers[element.a]
            row[at.F_B] = markers[element.b]
            row[at.F_DATA] = pool.add(element.data)
        row[at.F_LAW] = pool.add(element.law.packed())
        row[at.F_TIME] = element.function
        row[at.F_TURN] = element.turn
        if element.code:
            row[at.F_CODE] = pool.add(element.code)
            read = int(element.code[0])
            table[k - read : k, at.F_OWNER] = k
            row[at.F_SAMPLED] = int(element.sampled > 0.0)
    return table


def most_read(elements: Sequence[Element]) -> int:
    """The largest number of measures that a law reads."""
    return max((int(e.code[0]) for e in elements if e.code), default=0)
