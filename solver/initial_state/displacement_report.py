"""Changes of the given initial state by the assembly, as diagnostics."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import as_3d, orientation_matrix

from ..spatial import system_arrays as at
from ..spatial.system_arrays import WorkArrays
from ..system import work_arrays
from ..system.rotated_markers import to_3d, to_rotation_matrices
from ..system.sid_packing import quaternion
from ..system.system import System
from .given_state import StateVectors

#: Bodies that are reported, those that moved most.
MAX_LISTED = 3


def displacements(system: System, work: WorkArrays) -> dict[str, tuple[float, float]]:
    """How far bodies lie from where the scene file puts them, by name: of the origin
    [m], and the angle [rad]; `work` holds the frames."""
    result = {}
    for b, data in enumerate(system.bodies):
        if not data.is_scene_body:
            continue
        initial = system.scene.initial_of(data.name)
        frame = system.frames(work.frame[b])
        if system.planar:
            angle = abs(frame["angle"] - (initial.angle or 0.0))
        else:
            q = quaternion(
                orientation_matrix(initial).T @ to_rotation_matrices(frame["R"])
            )
            angle = 2.0 * np.arctan2(np.linalg.norm(q[1:]), q[0])
        displacement = np.linalg.norm(to_3d(frame["x"]) - as_3d(initial.position))
        result[data.name] = float(displacement), float(angle)
    return result


def displacement_notes(
    system: System, work: WorkArrays, start: StateVectors, least: float
) -> Iterator[Diagnostic]:
    """Bodies that the assembly moved, deformed or gave other velocities (N221 to N223).

    Parameters
    ----------
    least
        What counts, relative to the size of the mechanism, and of angles [rad]; of
        velocities what they amount to over the run, and relative to themselves.
    """
    deformations, velocity_changes = _deformation_changes(system, start)
    yield from position_notes(system, work, start, least, deformations)
    changes, relative = _velocity_changes(system, work, velocity_changes)
    time = system.scene.time
    sizes = {
        name: min(max(v / system.length, w) * (time.end - time.start), relative[name])
        for name, (v, w) in changes.items()
    }
    yield from _report_changes("N223", changes, sizes, least, "m/s", "rad/s")


def position_notes(
    system: System,
    work: WorkArrays,
    start: StateVectors,
    least: float,
    deformations: Mapping[str, tuple[float]] | None = None,
) -> Iterator[Diagnostic]:
    """Bodies that the assembly moved or deformed (N221, N222).

    Parameters
    ----------
    least
        What counts, relative to the size of the mechanism, and of angles [rad].
    deformations
        Largest change of a node's displacement [m], by body, if it is known.
    """
    work.interval_time[0] = 0.5 * (system.scene.time.start + system.breaks[0])
    work_arrays.evaluate(system, work, system.scene.time.start, start.z, start.v)
    displacements_ = displacements(system, work)
    sizes = {
        name: max(way / system.length, a) for name, (way, a) in displacements_.items()
    }
    yield from _report_changes("N221", displacements_, sizes, least, "m", "rad")
    deformations = (
        _deformation_changes(system, start)[0] if deformations is None else deformations
    )
    sizes = {name: way / system.length for name, (way,) in deformations.items()}
    yield from _report_changes("N222", deformations, sizes, least, "m")


def _deformation_changes(
    system: System, start: StateVectors
) -> tuple[dict[str, tuple[float]], dict[str, tuple[float, float]]]:
    """Largest change of a node's displacement [m], where the scene states none from
    none; of its velocity [m/s] where it states one, and relative to the velocity."""
    deformations: dict[str, tuple[float]] = {}
    velocity_changes: dict[str, tuple[float, float]] = {}
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        nq = int(row[at.NQ])
        if not data.is_scene_body or not nq:
            continue
        initial = system.scene.initial_of(data.name)
        last = int(row[at.POS] + row[at.NP]), int(row[at.VEL] + row[at.NV])
        q, vq = start.z[last[0] - nq : last[0]], start.v[last[1] - nq : last[1]]
        shapes = np.array([node.phi.m0 for node in data.sid.nodes]).reshape(-1, 3, nq)
        specified = getattr(initial, "elastic", None)
        deformations[data.name] = (
            _largest_node_displacement(shapes, q - _vector(specified, nq)),
        )
        specified = getattr(initial, "elastic_velocity", None)
        if specified is not None:
            change = _largest_node_displacement(shapes, vq - _vector(specified, nq))
            body_size = max(
                _largest_node_displacement(shapes, x)
                for x in (vq, _vector(specified, nq))
            )
            velocity_changes[data.name] = change, change / (body_size or 1.0)
    return deformations, velocity_changes


def _vector(specified: Sequence[float] | None, size: int) -> Array:
    return np.zeros(size) if specified is None else np.asarray(specified, float)


def _largest_node_displacement(shapes: Array, q: Array) -> float:
    """Largest displacement that q gives a node."""
    return float(np.linalg.norm(shapes @ q, axis=1).max(initial=0.0))


def _velocity_changes(
    system: System,
    work: WorkArrays,
    velocity_changes: Mapping[str, tuple[float, float]],
) -> tuple[dict[str, tuple[float, float]], dict[str, float]]:
    """Changes of velocities [m/s] and [rad/s] that the scene states, and how large they
    are relative to the velocities.

    Parameters
    ----------
    velocity_changes
        The same of nodes in their body frames.
    """
    changes, sizes = {}, {}
    for b, data in enumerate(system.bodies):
        if not data.is_scene_body:
            continue
        initial = system.scene.initial_of(data.name)
        velocities = _frame_velocities(system, work.frame[b])
        turning = initial.angular_velocity if data.rotates else None
        specified = initial.velocity, turning
        pairs = [
            (np.zeros(3), 0.0) if given is None else _vector_change(given, now)
            for given, now in zip(specified, velocities, strict=True)
        ]
        (dv, _), (dw, _) = pairs
        elastic, share = velocity_changes.get(data.name, (0.0, 0.0))
        displacement = max(float(np.linalg.norm(dv)), elastic)
        changes[data.name] = displacement, float(np.linalg.norm(dw))
        sizes[data.name] = max(share, *(size for _, size in pairs))
    return changes, sizes


def _frame_velocities(system: System, frame: Array) -> tuple[Array, Array]:
    """Of the origin of a frame and angular, in inertial axes, (3,) each."""
    of = system.frames(frame)
    R = to_rotation_matrices(of["R"])
    return R @ to_3d(of["v"]), R @ to_3d(of["w"])


def _vector_change(specified_value: object, now: Array) -> tuple[Array, float]:
    """The change of a vector, and its size relative to the larger of the two."""
    values = np.ravel(np.asarray(specified_value, float))
    specified = np.array([0.0, 0.0, values[0]]) if len(values) == 1 else np.zeros(3)
    if len(values) > 1:
        specified[: len(values)] = values
    largest = max(np.linalg.norm(specified), np.linalg.norm(now))
    change = now - specified
    return change, float(np.linalg.norm(change) / (largest or 1.0))


def _report_changes(
    code: str,
    changes: Mapping[str, tuple[float, ...]],
    sizes: Mapping[str, float],
    least: float,
    *units: str,
) -> Iterator[Diagnostic]:
    """The diagnostic of the bodies whose sizes are above `least`, largest first.

    Its data are their names, their changes as sentences and, for each unit, as numbers.
    """
    listed = sorted((n for n in changes if sizes[n] > least), key=lambda n: -sizes[n])
    if not listed:
        return
    texts = []
    for name in listed[:MAX_LISTED]:
        pairs = zip(changes[name], units, strict=True)
        parts = [f"{way:.3g} {unit}" for way, unit in pairs if way > 1e-3 * least]
        texts.append(f"{name} by " + " and ".join(parts))
    if len(listed) > MAX_LISTED:
        texts.append(f"{len(listed) - MAX_LISTED} more by less")
    linear = [changes[name][0] for name in listed]
    if len(units) == 1:
        yield diagnose(code, changes=texts, bodies=listed, linear=linear)
        return
    angular = [changes[name][1] for name in listed]
    yield diagnose(code, changes=texts, bodies=listed, linear=linear, angular=angular)
