"""Loads that geometric stiffening depends on, for each flexible body of a scene.

Before a run: the start, and what drives prescribe. After it: the recorded states, with
the forces of joints and of the scene.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sidtool.formats.scene import marker_names, marker_reference
from sidtool.formats.sid import SID, Array

from ..kernels import layout as at
from ..kernels import planar_columns as planar
from ..kernels import spatial_columns as spatial
from ..recording.force_measures import function_values
from ..recording.force_wrenches import Wrench, between, components, given, motion_of
from ..recording.joint_forces import wrench
from ..recording.motion import frame_motion
from ..recording.sampling import Samples
from ..system.scene import System
from .prescribed import FrameHistory
from .stiffening import Loads


def recorded_loads(system: System, samples: Samples, times: Array, body: str) -> Loads:
    """Loads of a flexible body at recorded states."""
    b = system.index(body)
    frame = frame_motion(system, samples, b)
    a, alpha = _accelerations(system, samples, b)
    a = a - np.einsum("tji,j->ti", frame.R, system.arrays.gravity)
    forces: dict[str, Array] = {}
    moments: dict[str, Array] = {}
    for marker, (force, moment) in _wrenches(system, samples, times, body):
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
            factor = function_values(system, element.function, times)[:, None]
        pair = components(system, element.data)
        if element.kind == at.FOLLOWING:
            force, moment = (factor * (node.AP.m0 @ vector) for vector in pair)
        else:
            force, moment = (
                factor * np.einsum("tji,j->ti", frame.R, vector) for vector in pair
            )
        yield node.id, force, moment


def turning_loads(rate: float, planar: bool) -> Loads:
    """Rotation at one rate about z, or about each axis."""
    w = np.diag([rate] * 3)[2 if planar else 0 :]
    return Loads(w, 0.0 * w, 0.0 * w)


def stiffened_by_forces(sid: SID) -> bool:
    """Does a node carry stiffening by a force or a moment?"""
    terms = [term.m1 for node in sid.nodes for term in (node.phi, node.psi)]
    return any(m1 is not None and m1.any() for m1 in terms)


def _accelerations(system: System, samples: Samples, b: int) -> tuple[Array, Array]:
    """Of a frame, (nt, 3) each in body axes: of its origin, and angular."""
    frame = samples.frames[:, b]
    if not system.planar:
        return (
            frame[:, spatial.A : spatial.A + 3],
            frame[:, spatial.ALPHA : spatial.ALPHA + 3],
        )
    a, alpha = np.zeros((2, len(frame), 3))
    a[:, :2], alpha[:, 2] = frame[:, [planar.AX, planar.AY]], frame[:, planar.AL]
    return a, alpha


def _wrenches(
    system: System, samples: Samples, times: Array, body: str
) -> Iterator[tuple[str, Wrench]]:
    """Marker, force and moment in inertial axes, of all that acts on a body."""
    if not stiffened_by_forces(system.bodies[system.index(body)].sid):
        return
    yield from _of_joints(system, samples, body)
    for k, element in enumerate(system.forces):
        if not element.acts:
            continue
        if element.kind <= at.FOLLOWING:
            if element.b[0] == body:
                yield element.b[1], given(system, samples, k)
            continue
        for marker, pair in zip(
            (element.a, element.b), between(system, samples, k), strict=True
        ):
            if marker is not None and marker[0] == body:
                yield marker[1], pair


def _of_joints(
    system: System, samples: Samples, body: str
) -> Iterator[tuple[str, Wrench]]:
    for owner in dict.fromkeys(row.name for row in system.rows):
        ends = _ends(system, owner)
        if body not in [name for name, _ in ends]:
            continue
        total = wrench(system, samples, owner)
        force, moment = total[:, :3], total[:, 3:]
        (first, a), (second, b) = ends
        if second == body:
            yield b, (force, moment)
        if first == body:
            A, B = (motion_of(system, samples, end) for end in ends)
            yield a, (-force, -moment - np.cross(B.x - A.x, force))


def _ends(system: System, owner: str) -> list[tuple[str, str]]:
    """Both markers of a joint or a drive; none of a coupling."""
    drive = system.scene.drives.get(owner)
    if drive is not None and drive.marker is not None:
        texts: tuple[str, ...] = (drive.reference, drive.marker)
    else:
        name = owner if drive is None else drive.joint or ""
        texts = marker_names(system.scene.joints[name])
    return [marker_reference(text) for text in texts]
