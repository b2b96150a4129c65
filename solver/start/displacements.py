"""What the assembly changed of the start that the scene gives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sidtool.formats.scene import as_3d, rotation
from sidtool.formats.sid import Array

from ..space import layout as at
from ..space.layout import Work
from ..system import kernel_calls
from ..system.bodies.embedded import embedded, matrices
from ..system.bodies.packing import quaternion
from ..system.scene import System
from .stated import Start

#: Bodies that are told of, those that moved most.
MOST = 3


def displacements(system: System, work: Work) -> dict[str, tuple[float, float]]:
    """How far bodies lie from where the scene file puts them, by name: of the origin
    [m], and the angle [rad]; `work` holds the frames."""
    found = {}
    for b, data in enumerate(system.bodies):
        if not data.of_scene:
            continue
        initial = system.scene.initial_of(data.name)
        frame = system.frames(work.frame[b])
        if system.planar:
            angle = abs(frame["angle"] - (initial.angle or 0.0))
        else:
            q = quaternion(rotation(initial).T @ matrices(frame["R"]))
            angle = 2.0 * np.arctan2(np.linalg.norm(q[1:]), q[0])
        way = np.linalg.norm(embedded(frame["x"]) - as_3d(initial.position))
        found[data.name] = float(way), float(angle)
    return found


def told_displacements(
    system: System, work: Work, start: Start, least: float
) -> Iterator[str]:
    """Sentences on bodies that the assembly moved, deformed or gave other velocities.

    least : what counts, relative to the size of the mechanism, and of angles [rad]; of
        velocities what they amount to over the run, and relative to themselves
    """
    bent, hurried = _deformations(system, start)
    yield from position_notes(system, work, start, least, bent)
    changes, relative = _replaced_velocities(system, work, hurried)
    time = system.scene.time
    sizes = {
        name: min(max(v / system.length, w) * (time.end - time.start), relative[name])
        for name, (v, w) in changes.items()
    }
    if changed := _largest(changes, sizes, least, "m/s", "rad/s"):
        yield (
            "joints and drives replace initial velocities that the scene gives: "
            f"{changed}"
        )


def position_notes(
    system: System,
    work: Work,
    start: Start,
    least: float,
    bent: Mapping[str, tuple[float]] | None = None,
) -> Iterator[str]:
    """Sentences on bodies that the assembly moved or deformed.

    Parameters
    ----------
    least : what counts, relative to the size of the mechanism, and of angles [rad]
    bent : largest change of a node's displacement [m], by body, if it is known
    """
    work.clock[0] = 0.5 * (system.scene.time.start + system.breaks[0])
    kernel_calls.evaluate(system, work, system.scene.time.start, start.z, start.v)
    ways = displacements(system, work)
    sizes = {name: max(way / system.length, a) for name, (way, a) in ways.items()}
    if moved := _largest(ways, sizes, least, "m", "rad"):
        yield (
            "the assembly moved bodies from where the scene puts them, to meet joints "
            f"and drives: {moved}"
        )
    bent = _deformations(system, start)[0] if bent is None else bent
    sizes = {name: way / system.length for name, (way,) in bent.items()}
    if deformed := _largest(bent, sizes, least, "m"):
        yield (
            "the assembly deformed bodies otherwise than the scene says, to meet "
            f"joints and drives: {deformed}"
        )


def _deformations(
    system: System, start: Start
) -> tuple[dict[str, tuple[float]], dict[str, tuple[float, float]]]:
    """Largest change of a node's displacement [m], where the scene states none from
    none; of its velocity [m/s] where it states one, and relative to the velocity."""
    bent: dict[str, tuple[float]] = {}
    hurried: dict[str, tuple[float, float]] = {}
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        nq = int(row[at.NQ])
        if not data.of_scene or not nq:
            continue
        initial = system.scene.initial_of(data.name)
        last = int(row[at.POS] + row[at.NP]), int(row[at.VEL] + row[at.NV])
        q, vq = start.z[last[0] - nq : last[0]], start.v[last[1] - nq : last[1]]
        shapes = np.array([node.phi.m0 for node in data.sid.nodes]).reshape(-1, 3, nq)
        stated = getattr(initial, "elastic", None)
        bent[data.name] = (_at_nodes(shapes, q - _vector(stated, nq)),)
        stated = getattr(initial, "elastic_velocity", None)
        if stated is not None:
            change = _at_nodes(shapes, vq - _vector(stated, nq))
            whole = max(_at_nodes(shapes, x) for x in (vq, _vector(stated, nq)))
            hurried[data.name] = change, change / (whole or 1.0)
    return bent, hurried


def _vector(stated: Sequence[float] | None, size: int) -> Array:
    return np.zeros(size) if stated is None else np.asarray(stated, float)


def _at_nodes(shapes: Array, q: Array) -> float:
    """Largest displacement that q gives a node."""
    return float(np.linalg.norm(shapes @ q, axis=1).max(initial=0.0))


def _replaced_velocities(
    system: System, work: Work, hurried: Mapping[str, tuple[float, float]]
) -> tuple[dict[str, tuple[float, float]], dict[str, float]]:
    """Changes of velocities [m/s] and [rad/s] that the scene states, and how large they
    are relative to the velocities.

    hurried : the same of nodes in their body frames
    """
    changes, sizes = {}, {}
    for b, data in enumerate(system.bodies):
        if not data.of_scene:
            continue
        initial = system.scene.initial_of(data.name)
        found = _velocities(system, work.frame[b])
        stated = initial.velocity, initial.angular_velocity
        pairs = [
            (np.zeros(3), 0.0) if given is None else _change(given, now)
            for given, now in zip(stated, found, strict=True)
        ]
        (dv, _), (dw, _) = pairs
        elastic, share = hurried.get(data.name, (0.0, 0.0))
        way = max(float(np.linalg.norm(dv)), elastic)
        changes[data.name] = way, float(np.linalg.norm(dw))
        sizes[data.name] = max(share, *(size for _, size in pairs))
    return changes, sizes


def _velocities(system: System, frame: Array) -> tuple[Array, Array]:
    """Of the origin of a frame and angular, in inertial axes, (3,) each."""
    of = system.frames(frame)
    R = matrices(of["R"])
    return R @ embedded(of["v"]), R @ embedded(of["w"])


def _change(given: object, now: Array) -> tuple[Array, float]:
    """The change of a vector, and its size relative to the larger of the two."""
    values = np.ravel(np.asarray(given, float))
    wanted = np.array([0.0, 0.0, values[0]]) if len(values) == 1 else np.zeros(3)
    if len(values) > 1:
        wanted[: len(values)] = values
    largest = max(np.linalg.norm(wanted), np.linalg.norm(now))
    change = now - wanted
    return change, float(np.linalg.norm(change) / (largest or 1.0))


def _largest(
    told: Mapping[str, tuple[float, ...]],
    sizes: Mapping[str, float],
    least: float,
    *units: str,
) -> str:
    """ "rod by 0.1 m and 0.2 rad, ..." of the bodies whose sizes are above `least`."""
    chosen = sorted((n for n in told if sizes[n] > least), key=lambda n: -sizes[n])
    parts = []
    for name in chosen[:MOST]:
        ways = told[name]
        pairs = [(w, u) for w, u in zip(ways, units, strict=True) if w > 1e-3 * least]
        parts.append(
            f"{name} by " + " and ".join(f"{way:.3g} {unit}" for way, unit in pairs)
        )
    if len(chosen) > MOST:
        parts.append(f"{len(chosen) - MOST} more by less")
    return ", ".join(parts)
