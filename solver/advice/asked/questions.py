"""Questions about a scene whose numbers may be in other units than SI and radians."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sidtool.formats.plausible import body_questions, first_frequency
from sidtool.formats.scene import (
    Polynomial,
    RigidBody,
    SmoothStep,
    driven_coordinate,
    marker_names,
    marker_reference,
)
from sidtool.formats.sid_mass import central_inertia

from ...system.scene import System
from ..excitation import ANGLES, drive_history, fastest_rotation
from .body_extents import body_extent, is_dense, marker_extent
from .stiffness import too_fast, too_stiff
from .unlikely import controllers, unlikely

#: Stronger than gravity on any planet or in a lift [m/s2].
_STRONGEST = 100.0
#: Whole multiples of these [deg], more than a turn in radians, may be degrees.
_DEGREES, _TURN = (30.0, 45.0), 2.0 * np.pi
#: Bodies that a joint holds together may differ by as much in size.
_SIZES = 100.0
#: Radii of gyration larger by as much than the body, and speeds [m/s], are no ordinary
#: ones.
_GYRATION, _SPEED = 30.0, 2000.0
#: What the sum of two moments of inertia may lack by rounding.
_ROUNDED = 1e-6
#: A run of a smaller part of the longest period shows no vibration.
_SHORT = 0.01


def questions(system: System) -> Iterator[str]:
    """What to ask the one who wrote a scene, one sentence each."""
    scene = system.scene
    gravity = float(np.linalg.norm(scene.gravity or 0.0))
    if gravity > _STRONGEST:
        yield (
            f"gravity is {gravity:g} m/s2, {gravity / 9.81:.3g} times that of the "
            "earth: is it in mm/s2?"
        )
    for data in system.bodies:
        if data.of_scene and data.sid.nq:
            for text in body_questions(data.sid, gravity or None):
                yield f"{data.name}: {text}"
    yield from _angles(system)
    yield from _sizes(system)
    yield from _inertias(system)
    yield from _forces(system)
    yield from unlikely(system)
    yield from too_stiff(system)
    yield from too_fast(system)
    yield from _span(system)
    rate, drive = fastest_rotation(system, system.once(drive_history))
    if rate * system.length > _SPEED:
        yield (
            f"{drive} turns at {rate:.3g} rad/s, at which {system.length:.3g} m move "
            f"at {rate * system.length:.2g} m/s: is it in revolutions per minute? "
            f"{rate:.3g} 1/min are {rate * np.pi / 30:.3g} rad/s"
        )


def _angles(system: System) -> Iterator[str]:
    """Angles in radians that look like degrees."""
    scene = system.scene
    for name, body in scene.bodies.items():
        yield from _angle(f"bodies.{name}.initial.angle", body.initial.angle)
    for name, drive in scene.drives.items():
        function = drive.function
        if not driven_coordinate(drive, scene.joints).startswith(ANGLES):
            continue
        ends: list[float] = []
        if drive.of != "value":
            ends = [drive.start]
        elif isinstance(function, SmoothStep):
            ends = [function.start, function.end]
        elif isinstance(function, Polynomial):
            ends = [piece.end[0] for piece in function.pieces if piece.end]
            ends += [p.coefficients[0] for p in function.pieces if p.coefficients]
        for value in ends:
            yield from _angle(f"the angle of drive {name}", value)
    for name, law in controllers(scene):
        if law.measured.endswith(".angle") and isinstance(law.reference, float):
            yield from _angle(f"the reference of {name}", law.reference)


def _angle(what: str, value: float | None) -> Iterator[str]:
    if value is None or abs(value) <= _TURN:
        return
    if any(value % degrees == 0.0 for degrees in _DEGREES):
        yield (
            f"{what} is {value:g} rad, {value / _TURN:.3g} turns: is it in degrees? "
            f"{value:g} degrees are {np.radians(value):.4g} rad"
        )


def _sizes(system: System) -> Iterator[str]:
    """Bodies that are joined to much smaller ones."""
    sizes = {data.name: body_extent(system, data.name) for data in system.bodies[1:]}
    told: set[str] = set()
    for name, joint in system.scene.joints.items():
        pair = [marker_reference(text)[0] for text in marker_names(joint)]
        known = sorted((sizes[n], n) for n in pair if sizes.get(n, 0.0) > 0.0)
        if len(known) == 2 and known[1][0] >= _SIZES * known[0][0]:
            (small, one), (large, other) = known
            if not told & {one, other}:
                yield (
                    f"{other} is {large:.3g} m long and {one}, to which {name} joins "
                    f"it, {small:.3g} m: is one of them in mm?"
                )
            told |= {one, other}


def _inertias(system: System) -> Iterator[str]:
    """Rigid bodies whose mass would lie far outside them."""
    for name, body in system.scene.bodies.items():
        if not isinstance(body, RigidBody) or body.inertia is None:
            continue
        sid = system.bodies[system.index(name)].sid
        moments = np.linalg.eigvalsh(central_inertia(sid))
        if not system.planar and moments[2] > (1.0 + _ROUNDED) * moments[:2].sum():
            told = ", ".join(f"{moment:.4g}" for moment in moments)
            yield (
                f"the moments of inertia of {name}, {told} kg m2, are those of no "
                "body: the largest one is more than the sum of the others"
            )
        radius = float(np.sqrt(moments[2] / body.mass))
        extent = marker_extent(sid)
        far = extent > 0.0 and radius > _GYRATION * extent
        if far and not is_dense(sid, radius):
            yield (
                f"the inertia of {name} is that of a mass {radius:.3g} m away from its "
                f"centre, and its markers are {extent:.3g} m apart: is it in kg mm2 or "
                "g mm2, or its mass in tonnes?"
            )


def _forces(system: System) -> Iterator[str]:
    """Springs and dampers that push, and those that can do nothing."""
    for name, force in system.scene.forces.items():
        for key, word in (("stiffness", "spring"), ("damping", "damper")):
            values = np.ravel(getattr(force, key, None) or 0.0)
            if values[0] < 0.0:
                yield (
                    f"{name} has a negative {key}, {values[0]:g}: a {word} that drives "
                    "what it should hold; is its sign meant?"
                )
        pair = getattr(force, "markers", None)
        ends = {marker_reference(text)[0] for text in pair or ()}
        rigid = [n for n in ends if not system.bodies[system.index(n)].sid.nq]
        if len(ends) == 1 and rigid:
            yield (
                f"{name} acts between two markers of {rigid[0]}, which is rigid, and "
                "moves nothing: is one of them on another body?"
            )


def _span(system: System) -> Iterator[str]:
    """A run that ends before anything can vibrate."""
    time = system.scene.time
    periods = {
        data.name: (time.end - time.start) * first_frequency(data.sid)
        for data in system.bodies
        if data.sid.nq
    }
    if periods and 0.0 < max(periods.values()) < _SHORT:
        name = max(periods, key=lambda body: periods[body])
        yield (
            f"the run of {time.end - time.start:g} s lasts {periods[name]:.1g} of the "
            f"first period of {name}: is its end in other units than seconds?"
        )
