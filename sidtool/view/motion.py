"""Motion of the bodies of a result at the times of the pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import report_stage
from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, marker_names, marker_reference
from sidtool.solver.output.body_outputs import frame_motion
from sidtool.solver.output.energies import elastic_coordinates
from sidtool.solver.simulation.replay import Replay, replay
from sidtool.solver.system.system import GROUND_NAME, System

from ..field.body_surfaces import shape_mesh
from .links import BodyMotion, Link, scene_links

#: Rotation between two pictures above which pictures are inserted [rad].
MAX_ROTATION = 0.15
#: Largest number of pictures; with more, times are skipped evenly.
MAX_TIMES = 6000


@dataclass(frozen=True, eq=False)
class SampledJoint:
    """A joint, at its first marker.

    body : name of the body, empty for the ground
    position : (3,) in the body frame, or in space [m]
    shapes : (3, nq)
    """

    name: str
    kind: str
    body: str
    position: Array
    shapes: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledMotion(BodyMotion):
    """Motion of a scene at the times of its pictures.

    Attributes
    ----------
    links : springs, dampers, actuators and rods
    size, centre : extent and centre (3,) of the mechanism over all times [m]
    notes : notes on the times
    """

    scene: SceneFile
    system: System
    joints: tuple[SampledJoint, ...]
    links: tuple[Link, ...]
    size: float
    centre: Array
    notes: tuple[str, ...] = ()


def sample_motion(
    result: Result,
    most: int = MAX_TIMES,
    times: Array | None = None,
    folders: Sequence[Path] = (Path("."),),
) -> SampledMotion:
    """Return the motion of a result; between output times it is interpolated if bodies
    rotate fast, see `Replay.outputs`.

    times : default suitable times for a film
    folders : folders of relative paths of shape files

    Raises
    ------
    InputError : the result holds no motion, or not its scene, or the file of a shape
        cannot be read.
    """
    if not len(result.t):
        raise InputError("holds no output times", expected="a result with a motion")
    report_stage("looking at the motion")
    again = replay(result)
    notes: tuple[str, ...] = ()
    if times is None:
        times, notes = _picture_times(again, most)
    system, samples = again.system, again.samples(times)
    places, turns, elastic = {}, {}, {}
    for b, data in enumerate(system.bodies):
        if data.name != GROUND_NAME:
            motion = frame_motion(system, samples, b)
            places[data.name], turns[data.name] = motion.X, motion.R
            elastic[data.name] = elastic_coordinates(system, samples, b)[0]
    low, high = _scene_extent(
        system, places, turns, _shape_points(system.scene, folders)
    )
    size = float((high - low).max()) or 1.0
    return SampledMotion(
        scene=system.scene,
        system=system,
        t=times,
        places=places,
        turns=turns,
        elastic=elastic,
        joints=tuple(_scene_joints(system)),
        links=scene_links(system, size),
        size=size,
        centre=(low + high) / 2,
        notes=notes,
    )


def _shape_points(scene: SceneFile, folders: Sequence[Path]) -> dict[str, Array]:
    """Return the points of the shapes of rigid bodies, in the body frame."""
    shapes = {n: getattr(body, "shape", None) for n, body in scene.bodies.items()}
    return {
        name: shape_mesh(shape, folders, f"bodies.{name}.shape")[0]
        for name, shape in shapes.items()
        if shape is not None
    }


def _scene_extent(
    system: System,
    places: Mapping[str, Array],
    turns: Mapping[str, Array],
    shapes: Mapping[str, Array],
) -> tuple[Array, Array]:
    """Return the box around all undeformed nodes and shapes at some hundred times."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for data in system.bodies:
        points = np.array([node.position for node in data.sid.nodes]).reshape(-1, 3)
        if data.name in places:
            some = slice(None, None, 1 + len(places[data.name]) // 200)
            more = _corners(shapes[data.name]) if data.name in shapes else points[:0]
            points = np.concatenate([points, np.zeros((1, 3)), more])
            turned = turns[data.name][some] @ points.T
            points = (places[data.name][some, :, None] + turned).swapaxes(1, 2)
        points = points.reshape(-1, 3)
        low = np.minimum(low, points.min(axis=0, initial=np.inf))
        high = np.maximum(high, points.max(axis=0, initial=-np.inf))
    return low, high


def _corners(points: Array) -> Array:
    """Return the corners (8, 3) of the box around points."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array([np.where(pick, high, low) for pick in np.ndindex(2, 2, 2)])


def _picture_times(again: Replay, most: int) -> tuple[Array, tuple[str, ...]]:
    """Return output times, with more where bodies rotate far, or fewer."""
    t = again.t
    if len(t) < 2:
        return t, ()
    if len(t) > most:
        rows = np.round(np.linspace(0, len(t) - 1, most)).astype(int)
        return t[rows], (f"{most} of {len(t)} output times are shown",)
    samples, turned = again.samples(), np.zeros(len(t) - 1)
    for b in range(len(again.system.bodies)):
        motion = frame_motion(again.system, samples, b)
        rate = np.linalg.norm(motion.W, axis=1)
        turned = np.maximum(turned, np.diff(t) * np.maximum(rate[1:], rate[:-1]))
    count = max(1, int(np.ceil(turned.max() / MAX_ROTATION)))
    count = max(1, min(count, most // len(t)))
    shares = np.arange(count) / count
    inner = (t[:-1, None] + np.diff(t)[:, None] * shares).ravel()
    notes: tuple[str, ...] = ()
    if count > 1:
        notes = (f"between output times {count - 1} more are interpolated",)
    return np.append(inner, t[-1]), notes


def _scene_joints(system: System) -> list[SampledJoint]:
    joints = []
    bodies = {data.name: data for data in system.bodies}
    for name, joint in system.scene.joints.items():
        names = marker_names(joint)
        if not names:
            continue
        owner, marker = marker_reference(names[0])
        node = bodies[owner].node(marker)
        body = "" if owner == GROUND_NAME else owner
        joints.append(SampledJoint(name, joint.type, body, node.position, node.phi.m0))
    return joints
