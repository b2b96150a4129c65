"""Signals that control laws read, and times at which sampled laws read them.

A signal is the measure of a row of the force table, or the rate of that measure.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    FRICTION_QUANTITIES,
    OutputName,
    OutputTimes,
    RigidBody,
    SceneFile,
    Time,
    coordinate_of,
    is_elastic,
    is_joint_output,
    is_rate,
    is_section_force,
    parse_output,
)
from sidtool.formats.scene.connections import owner_table
from sidtool.formats.scene.outputs import MEASURES

from ..dynamics.equations_of_motion import law_value_at
from ..spatial import system_arrays as at
from .body_data import BodyData
from .force_rows import ForceLaw, ForceRow, joint_coordinate
from .force_table import force_element
from .system import System

GROUND_MARKER = ("ground", "")
_ROTATION, _ANGULAR_VELOCITY = (
    ("rotation_x", "rotation_y", "rotation_z"),
    ("wx", "wy", "wz"),
)
#: Names of accelerations, which control laws cannot read.
_ACCELERATION = re.compile(r"accel|_acc$|_rate_rate$|_ddot$|^(al|alpha)[xyz]?$|^aq\d+$")
_EXPECTED = (
    "an output that is a position or a velocity: JOINT.angle, JOINT.angle_rate and "
    "other coordinates, BODY.MARKER.x, .vx and, of rotation, .angle and .wz (in space "
    ".rotation_x and .wx), the same of a rigid body, "
    "BODY.q1, BODY.vq1, length, deflection and rate of a spring or an actuator, force "
    "and power of those, or a state FORCE.state.NAME"
)

#: A sample is at a break that is nearer than this part of the sample time.
SAMPLE_TOLERANCE = 1e-6


class SensorSignal(NamedTuple):
    """The measure of an element less a constant, or (order 1) its rate."""

    element: ForceRow
    order: int
    constant: float = 0.0


def sensor_signal(
    name: str, scene: SceneFile, data: Mapping[str, BodyData], place: str
) -> SensorSignal:
    """What measures an output, for a law.

    Raises
    ------
    InputError
        There is no such output, or it depends on accelerations or forces, which follow
        from the forces.
    """
    found_ = _force_signal(name, scene)
    if found_ is not None:
        return found_
    _refuse_accelerations(name, place)
    try:
        owner, marker, quantity = parse_output(name)
    except InputError:
        raise InputError(
            f"there is nothing to read of the name {name!r}",
            place=place,
            expected=_EXPECTED,
        ) from None
    coordinate = coordinate_of(quantity)
    if owner in scene.joints and not marker and coordinate:
        if coordinate not in scene.joints[owner].coordinates:
            problem = f"{owner} has no coordinate {coordinate}"
            listed = " or ".join(scene.joints[owner].coordinates) or "another joint"
            raise InputError(problem, place=place, expected=listed)
        element = joint_coordinate(scene, owner, coordinate)
        return SensorSignal(element, int(is_rate(quantity)))
    if owner in scene.bodies and is_elastic(quantity) and not marker:
        return _elastic_signal(name, owner, quantity, data[owner], place)
    if owner in scene.bodies:
        found_ = _marker_signal(owner, marker, quantity, scene, data[owner])
        if found_ is not None:
            return found_
    raise InputError(f"a law cannot read {name!r}", place=place, expected=_EXPECTED)


def _force_signal(name: str, scene: SceneFile) -> SensorSignal | None:
    """What a force measures along its coordinate; None for other outputs."""
    owner, _, quantity = name.rpartition(".")
    if quantity not in MEASURES or owner_table(owner, quantity, scene) != "forces":
        return None
    element = force_element(scene, owner)
    constant = element.law.rest if quantity == "deflection" else 0.0
    measure = replace(element, law=ForceLaw())
    return SensorSignal(measure, int(quantity == "rate"), constant)


def _refuse_accelerations(name: str, place: str) -> None:
    """Raises accelerations and forces, which a law would change by reading them."""
    place_of_output, _, quantity = name.rpartition(".")
    owner, _, marker = place_of_output.partition(".")
    if (
        is_joint_output(quantity)
        or quantity in FRICTION_QUANTITIES
        or is_section_force(OutputName(owner, marker, quantity))
    ):
        raise InputError(
            f"a law cannot read {name!r}: it is a force, which follows from all forces "
            "at the same instant, that of the law among them",
            place=place,
            expected=_EXPECTED,
        )
    if quantity in ("ax", "ay", "az") or _ACCELERATION.search(quantity):
        raise InputError(
            f"a law cannot read {name!r}: it is an acceleration, which follows from "
            "the forces at the same instant, that of the law among them",
            place=place,
            expected="a velocity, whose acceleration a state follows with a lag: with "
            'rate = "(elbow.angle_rate - slow)/0.01" of a state slow, that rate is the '
            "acceleration of elbow.angle, 0.01 s late",
        )


def _elastic_signal(
    name: str, owner: str, quantity: str, data: BodyData, place: str
) -> SensorSignal:
    if quantity.endswith("*"):
        raise InputError(
            f"a law cannot read {name!r}, which is all of them",
            place=place,
            expected="one elastic coordinate",
        )
    index = data.coordinate_numbers.index(data.elastic_number(quantity, place))
    return SensorSignal(elastic_coordinate_row(owner, index), int(quantity[0] == "v"))


def elastic_coordinate_row(body: str, index: int) -> ForceRow:
    """What measures an elastic coordinate, counted from 0."""
    return ForceRow(
        body, at.COORDINATE_MEASURE, None, (body, ""), (float(index),), ForceLaw()
    )


def _rotation_signal(
    end: tuple[str, str], quantity: str, planar: bool
) -> SensorSignal | None:
    """Angle or angular velocity of a body or marker, deformation included; in space a
    component of the rotation vector, or of the angular velocity."""
    if planar:
        if quantity not in ("angle", "wz"):
            return None
        element = ForceRow(
            end[0], at.ANGLE_MEASURE, GROUND_MARKER, end, (0.0,), ForceLaw()
        )
        return SensorSignal(element, int(quantity == "wz"))
    if quantity not in (*_ROTATION, *_ANGULAR_VELOCITY):
        return None
    order = int(quantity in _ANGULAR_VELOCITY)
    along = tuple(float(axis == quantity[-1]) for axis in "xyz")
    data = (*along, 0.0, 0.0, 0.0) if order else along
    kind = at.ANGULAR_VELOCITY_MEASURE if order else at.ROTATION_VECTOR_MEASURE
    return SensorSignal(
        ForceRow(end[0], kind, GROUND_MARKER, end, data, ForceLaw()), order
    )


def _marker_signal(
    owner: str, marker: str, quantity: str, scene: SceneFile, data: BodyData
) -> SensorSignal | None:
    """Along an inertial axis, of a marker or of a rigid body; None for what is not."""
    planar = scene.dimension == "planar"
    if not marker and not isinstance(scene.bodies[owner], RigidBody):
        return None
    if marker:
        data.node(marker)
    rotation_signal = _rotation_signal((owner, marker), quantity, planar)
    if rotation_signal is not None:
        return rotation_signal
    order = len(quantity) - 1
    if quantity[-1] not in ("xy" if planar else "xyz") or order > 1:
        return None
    if order == 1 and quantity[0] != "v":
        return None
    axis = "xyz".index(quantity[-1])
    along: tuple[float, ...] = (0.5 * math.pi * axis,)
    if not planar:
        along = tuple(float(i == axis) for i in range(3))
    element = ForceRow(
        owner,
        at.DISPLACEMENT_MEASURE,
        GROUND_MARKER,
        (owner, marker),
        along,
        ForceLaw(),
    )
    return SensorSignal(element, order)


def add_sample_times(
    breaks: tuple[float, ...], elements: tuple[ForceRow, ...], time: Time
) -> tuple[float, ...]:
    """Breaks of functions and the samples of all laws inside the span, growing."""
    times = np.array(breaks)
    for period in sorted({e.sample_period for e in elements if e.sample_period}):
        count = int(np.ceil((time.end - time.start) / period))
        samples = time.start + period * np.arange(1, count)
        near = np.searchsorted(times, samples)
        distances = [
            np.abs(times[np.clip(near - side, 0, len(times) - 1)] - samples)
            for side in (0, 1)
        ]
        new = samples[np.minimum(*distances) > SAMPLE_TOLERANCE * period]
        new = new[new < time.end - SAMPLE_TOLERANCE * period]
        times = np.sort(np.concatenate([times, new]))
    return tuple(float(t) for t in times)


class OutputTimesAtSamples(OutputTimes):
    """Output times, of which those at a sample are at the break that it is.

    What is recorded there holds just before the sample, in the step that ends at the
    break. Numbers of files have some digits only: an output time may lie by 1e-11 s
    behind the sample that it is meant to be at.
    """

    def __init__(self, system: System) -> None:
        super().__init__(system.scene)
        periods = [
            element.sample_period for element in system.forces if element.sample_period
        ]
        self._instants = np.array(system.breaks if periods else ())
        start, shortest = system.scene.time.start, np.full(len(self._instants), np.inf)
        for period in periods:
            due = _is_sample_time(self._instants - start, period)
            shortest[due] = np.minimum(shortest[due], period)
        self._instants = self._instants[np.isfinite(shortest)]
        self._near = SAMPLE_TOLERANCE * shortest[np.isfinite(shortest)]

    def __getitem__(self, part: slice) -> Array:
        times = np.array(super().__getitem__(part))
        if len(self._instants):
            after = np.searchsorted(self._instants, times)
            for side in (0, 1):
                k = np.clip(after - side, 0, len(self._instants) - 1)
                at_sample = np.abs(times - self._instants[k]) <= self._near[k]
                times[at_sample] = self._instants[k][at_sample]
        return times


def _is_sample_time(elapsed: Array, period: float) -> Array:
    """True if a law is sampled a time (n,) after the start."""
    counts = np.asarray(elapsed) / period
    return np.asarray(np.abs(counts - np.round(counts)) <= SAMPLE_TOLERANCE)


class SampledLaws:
    """The sampled laws of a system, as rows of its force table.

    Attributes
    ----------
    last_time : time of the last samples [s]
    """

    def __init__(self, system: System) -> None:
        self._system, self.last_time = system, -np.inf
        self._rows = [k for k, e in enumerate(system.forces) if e.sample_period]

    def take_samples(self, work: at.WorkArrays, t: float, v: Array) -> bool:
        """Sets the states in v of the laws that are sampled at t, from the state that
        was just evaluated, once at each time; whether there are any."""
        if t == self.last_time:
            return False
        start, self.last_time = self._system.scene.time.start, t
        due = []
        for k in self._rows:
            if _is_sample_time(
                np.array(t - start), self._system.forces[k].sample_period
            ):
                due.append(k)
        arrays = self._system.arrays
        values = [law_value_at(arrays, work, k, t) for k in due]
        for k, value in zip(due, values, strict=True):
            v[arrays.body[arrays.force[k, at.F_B], at.VEL]] = value
        return bool(due)
