"""Questions about springs that hold nothing and loads that throw bodies away.

Both are told at the end of a run, from where it began and where it came to: it is the
motion that shows that a stiffness or a torque was in other units.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sidtool.formats.scene import Actuator, PointForce
from sidtool.formats.sid import SID, Array
from sidtool.formats.sid_mass import central_inertia, centre_of_mass

from ...space import layout as at
from ...system import kernel_calls
from ...system.bodies.embedded import embedded, matrices
from ...system.forces.elements import Element
from ...system.scene import System
from ...system.sizes import extents
from ...system.storage import new_work
from .body_extents import mechanism_extent
from .stiffness import ANGLES, linear

#: A spring lets go what it lets turn by more than a turn, and would let turn by more
#: than this under a steady load [rad].
_TURN, _WOUND = 2.0 * np.pi, 50.0
#: No mechanism gains such a speed [m/s].
_SPEED = 2000.0


@dataclass(frozen=True, eq=False)
class _Moment:
    """Markers and body frames, inertial: (n, 3), R (n, 3, 3)."""

    x: Array
    v: Array
    w: Array
    R: Array
    angle: Array
    frame_v: Array
    frame_w: Array
    frame_x: Array
    frame_R: Array


def carried_away(
    system: System, times: tuple[float, float], z: Array, v: Array
) -> Iterator[str]:
    """One sentence for each spring, and for bodies that became too fast.

    times, z, v : the start and the end of a run
    """
    span = times[1] - times[0]
    if not span > 0.0 or not np.isfinite([*z[1], *v[1]]).all():
        return
    springs = [
        (k, e)
        for k, e in enumerate(system.forces)
        if e.acts and linear(e.law.stiffness)
    ]
    loads = [
        name
        for name, force in system.scene.forces.items()
        if isinstance(force, PointForce | Actuator)
    ]
    if not springs and not loads:
        return
    first, last = (_moment(system, *now) for now in zip(times, z, v, strict=True))
    for k, element in springs:
        yield from _loose(system, k, element, first, last, span)
    if loads:
        yield from _thrown(system, loads, first, last)


def _moment(system: System, t: float, z: Array, v: Array) -> _Moment:
    work = new_work(system)
    kernel_calls.evaluate(system, work, t, z, v)
    point, frame = system.points(work.point), system.frames(work.frame)
    if system.planar:
        angle = np.asarray(point["angle"])
        R = matrices(np.column_stack([np.cos(angle), np.sin(angle)]))
    else:
        angle, R = np.zeros(len(point)), matrices(point["R"])
    return _Moment(
        x=embedded(point["x"]),
        v=embedded(point["v"]),
        w=embedded(point["w"]),
        R=R,
        angle=angle,
        frame_v=embedded(frame["v"]),
        frame_w=embedded(frame["w"]),
        frame_x=embedded(frame["x"]),
        frame_R=matrices(frame["R"]),
    )


def _loose(
    system: System, k: int, element: Element, first: _Moment, last: _Moment, span: float
) -> Iterator[str]:
    """A spring that was stretched beyond the mechanism and pulled back next to nothing.

    The load that it met follows from the speed that it let the bodies gain, with the
    inertia that these have alone; what joints add to it makes the spring looser still.
    """
    stiffness = linear(element.law.stiffness)
    row = system.arrays.force[k]
    a, b = int(row[at.F_A]), int(row[at.F_B])
    turns = element.kind in ANGLES
    axis, moved, gained = _way(system, element, a, b, first, last, span)
    rest = 0.0 if turns else abs(element.law.rest)
    size = mechanism_extent(system)
    reach = _TURN if turns else max(size, rest, _distance(first, a, b))
    inverse = sum(_mobility(system, m, axis, turns, first) for m in (a, b))
    if not (stiffness > 0.0 and inverse > 0.0 and moved > reach):
        return
    inertia = 1.0 / inverse
    sag = abs(gained) / span * inertia / stiffness
    period = _TURN * np.sqrt(inertia / stiffness)
    if period <= span or sag <= (_WOUND if turns else reach):
        return
    unit, far = ("N m/rad", "rad") if turns else ("N/m", "m")
    meant = "kN m/rad or N m/deg" if turns else "N/mm or kN/m"
    yield (
        f"{element.name} holds next to nothing: its ends moved by {moved:.3g} {far} "
        f"and its period of {period:.2g} s is longer than the run: is its stiffness of "
        f"{stiffness:.4g} {unit} in {meant}?"
    )


def _way(
    system: System,
    element: Element,
    a: int,
    b: int,
    first: _Moment,
    last: _Moment,
    span: float,
) -> tuple[Array, float, float]:
    """The direction of a spring, how far it gave way, and the rate that this gained."""
    if element.kind in ANGLES:
        spins = [now.w[b] - now.w[a] for now in (first, last)]
        gained = spins[1] - spins[0]
        size = float(np.linalg.norm(gained))
        axis = gained / size if size else np.array([0.0, 0.0, 1.0])
        turned = 0.5 * span * size
        if system.planar:
            angles = [now.angle[b] - now.angle[a] for now in (first, last)]
            turned = abs(float(angles[1] - angles[0]))
        return axis, turned, size
    gaps = [now.x[b] - now.x[a] for now in (first, last)]
    rates = [now.v[b] - now.v[a] for now in (first, last)]
    if element.kind == at.SPAN:
        lengths = [float(np.linalg.norm(gap)) for gap in gaps]
        ways = [g / n if n else r / max(np.linalg.norm(r), 1e-300)
                for g, n, r in zip(gaps, lengths, rates, strict=True)]  # fmt: skip
    else:
        ways = [_slide(system, element, a, now) for now in (first, last)]
        lengths = [float(w @ g) for w, g in zip(ways, gaps, strict=True)]
    speeds = [float(w @ r) for w, r in zip(ways, rates, strict=True)]
    return ways[0], abs(lengths[1] - lengths[0]), speeds[1] - speeds[0]


def _slide(system: System, element: Element, a: int, now: _Moment) -> Array:
    data = np.array(element.data[:3])
    if system.planar:
        data = np.array([np.cos(data[0]), np.sin(data[0]), 0.0])
    way: Array = now.R[a] @ data
    return way


def _distance(now: _Moment, a: int, b: int) -> float:
    return float(np.linalg.norm(now.x[b] - now.x[a]))


def _mobility(
    system: System, marker: int, axis: Array, turns: bool, now: _Moment
) -> float:
    """Acceleration of a marker under a unit load along or about an axis, of its body
    alone and rigid [1/kg, 1/(kg m2)]."""
    body = next(name for (name, _), m in system.markers.items() if m == marker)
    b = system.index(body)
    sid: SID = system.bodies[b].sid
    if not system.bodies[b].of_scene or not sid.mass:
        return 0.0
    R = now.frame_R[b]
    inertia = R @ central_inertia(sid) @ R.T
    if system.planar:
        inertia = np.diag([0.0, 0.0, inertia[2, 2]])
    arm = now.x[marker] - now.frame_x[b] - R @ centre_of_mass(sid)
    turning = axis if turns else np.cross(arm, axis)
    spun = float(turning @ np.linalg.pinv(inertia) @ turning)
    return spun if turns else 1.0 / sid.mass + spun


def _thrown(
    system: System, loads: list[str], first: _Moment, last: _Moment
) -> Iterator[str]:
    """The body whose speed grew most, if no mechanism gains as much."""
    straight = np.linalg.norm(last.frame_v - first.frame_v, axis=1)
    spun = np.linalg.norm(last.frame_w - first.frame_w, axis=1) * extents(system)
    gained = np.maximum(straight, spun)
    b = int(gained.argmax())
    if gained[b] > _SPEED:
        yield (
            f"{system.bodies[b].name} gained {gained[b]:.2g} m/s, more than any "
            f"mechanism does; loads are {', '.join(loads)}: are they in other units "
            "than N and N m (a torque in N mm)?"
        )
