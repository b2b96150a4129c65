"""Loads that geometric stiffening depends on, for each flexible body of a scene.

Before a run: the start, and what drives prescribe. After it: the recorded states, with
the forces of joints and of the scene.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sidtool.formats.sid import SID, Array

from ..recording.motion import frame_motion
from ..recording.told import Told
from ..space import layout as at
from ..system.bodies.embedded import embedded
from ..system.kernel_calls import function_history
from ..system.scene import System
from .prescribed import FrameHistory
from .stiffening import Loads


def recorded_loads(told: Told, body: str) -> Loads:
    """Loads of a flexible body at recorded states."""
    system, samples = told.system, told.samples
    b = system.index(body)
    frame = frame_motion(system, samples, b)
    of = system.frames(samples.frames[:, b])
    a, alpha = embedded(of["a"]), embedded(of["al"])
    a = a - np.einsum("tji,j->ti", frame.R, system.arrays.gravity)
    forces: dict[str, Array] = {}
    moments: dict[str, Array] = {}
    for marker, force, moment in _wrenches(told, body):
        node = system.bodies[b].node(marker)
        for store, vector, m1 in (
            (forces, force, node.phi.m1),
            (moments, moment, node.psi.m1),
        ):
            if m1 is not None and m1.any():
                local = np.einsum("tji,tj->ti", frame.R, vector)
                store[node.id] = store.get(node.id, 0.0) + local
    return Loads(frame.W, a, alpha, forces, moments)


def foreseen_loads(
    system: System, frame: FrameHistory, times: Array, body: str
) -> Loads:
    """Loads of a body by the motion of its frame, gravity and given forces.

    frame : motion at the times (nt,), or at one time that stands for all of them
    """
    acting = list(_foreseen_forces(system, frame, times, body))
    if len(frame.w) == 1 and any(len(force) > 1 for _, force, _ in acting):
        frame = frame.repeated(len(times))
    forces: dict[str, Array] = {}
    moments: dict[str, Array] = {}
    nothing = np.zeros_like(frame.w)
    for node, force, moment in acting:
        forces[node] = forces.get(node, nothing) + force
        moments[node] = moments.get(node, nothing) + moment
    gravity = np.einsum("tji,j->ti", frame.R, system.arrays.gravity)
    return Loads(frame.w, frame.a - gravity, frame.alpha, forces, moments)


def _foreseen_forces(
    system: System, frame: FrameHistory, times: Array, body: str
) -> Iterator[tuple[str, Array, Array]]:
    """Node, force and moment (nt or 1, 3) in body axes of the given forces."""
    for element in system.forces:
        if element.kind > at.FOLLOWING or element.b[0] != body or element.code:
            continue
        node = system.bodies[system.index(body)].node(element.b[1])
        factor = np.ones((1, 1))
        if element.function >= 0:
            factor = _function_values(system, element.function, times)[:, None]
        pair = _components(system.planar, element.data)
        if element.kind == at.FOLLOWING:
            force, moment = (factor * (node.AP.m0 @ vector) for vector in pair)
        else:
            force, moment = (
                factor * np.einsum("tji,j->ti", frame.R, vector) for vector in pair
            )
        yield node.id, force, moment


def _components(planar: bool, data: tuple[float, ...]) -> tuple[Array, Array]:
    """Force and moment, (3,) each, of the data of a given force."""
    if planar:
        return np.array([*data[:2], 0.0]), np.array([0.0, 0.0, data[2]])
    return np.array(data[:3]), np.array(data[3:])


def _function_values(system: System, function: int, times: Array) -> Array:
    """Values (nt,) of a row of the table of functions."""
    return function_history(system, function, system.clocks(times), times)[:, 0]


def stiffened_by_forces(sid: SID) -> bool:
    """Does a node carry stiffening by a force or a moment?"""
    terms = [term.m1 for node in sid.nodes for term in (node.phi, node.psi)]
    return any(m1 is not None and m1.any() for m1 in terms)


def _wrenches(told: Told, body: str) -> Iterator[tuple[str, Array, Array]]:
    """Marker, force and moment in inertial axes, of all that acts on a body."""
    system = told.system
    if not stiffened_by_forces(system.bodies[system.index(body)].sid):
        return
    for (on, marker), m in system.markers.items():
        if on == body:
            total = told.wrench(m)
            yield marker, total[:, :3], total[:, 3:]
