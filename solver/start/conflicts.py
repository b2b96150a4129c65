"""Which joints and drives contradict each other, and how near their markers come.

A joint or drive has a part in a contradiction if all the others can be met without it.
Bodies count as undeformed: shape functions could stretch them to any length.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.scene import marker_names, marker_reference
from sidtool.formats.sid import Array

from ..space import layout as at
from ..space.coordinates import retract
from ..system import kernel_calls
from ..system.scene import System
from ..system.sizes import coordinate_sizes
from ..system.storage import new_work
from .carried import keep_frame
from .consistent import State, close
from .displacements import displacements
from .least_open import least_open, left_of_rates
from .stated import Start, guess

#: Constraints that are open by more, relative to their sizes, are not met.
OPEN = 1e-7
#: Joints and drives that are tried one by one, in scenes of up to so many constraints,
#: and in larger ones, where that part of what is open counts.
MOST, LARGEST = 60, 200
FEW, PART = 12, 1e-4
#: Names that are listed of many.
LISTED = 4
#: What joints that are met weigh against the one that is not, where their markers are
#: nearest, one weight after the other.
WEIGHTS = (3.0, 30.0, 300.0, 1e4)
#: Places from which the nearest one is sought, and how far they lie beside, relative.
PLACES, NEARBY = 3, 0.05
#: Parts of the time span after which drives are asked what they demand next.
SOON = (1e-3, 1e-2, 5e-2)
#: Markers that come as near, relative to the size of the mechanism, meet.
MEET = 1e-4
FITTING = "lengths, drives and joints that fit together"
#: Joints that hold two points together.
MEETING = ("revolute", "spherical", "universal", "fixed", "coincident")


def conflict_at_start(system: System) -> tuple[str, str]:
    """Why the start position is not reached, and what would do, in words; both are
    empty where that is not known."""
    whole = system.complete_scene
    state = State(whole, guess(whole))
    names, met = _names_and_test(state)
    why = _in_words(whole, names)
    apart = _nearest(state, met, names)
    if apart is None:
        return why, FITTING if names else ""
    if apart.gap > MEET * whole.length:
        return f"{why}; {apart}", FITTING
    return (
        "the way from the initial positions to where joints and drives are met was not "
        "found",
        f"initial positions near a start that meets them, such as {_places(state)}",
    )


def conflict_soon(system: System, t: float, z: Array, v: Array) -> str:
    """What cannot be met a little after a time t [s] of a run in the state z, v."""
    span = system.scene.time
    for share in SOON:
        when = min(t + share * (span.end - span.start), span.end)
        state = undeformed(system, when, z, v)
        names, met = _names_and_test(state)
        apart = _nearest(state, met, names) if names else None
        if names and (apart is None or apart.gap > MEET * system.length):
            return f"at t = {when:.4g} s {_in_words(state.system, names)}"
    return ""


def conflict_of_rates(system: System, t: float, z: Array, v: Array) -> str:
    """Why no velocities meet all joints and drives in a state at a time t [s]."""
    state = undeformed(system, t, z, v)
    state.ignored[:] = False
    state.evaluate()
    rates = state.work.row[:, at.C_RATE].copy()
    size = max(1.0 / state.duration, state.relative(rates))

    def can_move() -> bool:
        if _is_large(state):
            return float(np.abs(left_of_rates(state, rates)).max()) <= OPEN * size
        left = state.smallest(np.where(state.ignored, 0.0, -rates))[1]
        return state.relative(left) <= OPEN * size

    if can_move():
        return ""
    names = _suspects(state, left_of_rates(state, rates))
    return _in_words(state.system, _contradicting(state, names, can_move))


def undeformed(system: System, t: float, z: Array, v: Array) -> State:
    """The scene with all of its joints at a time t, its bodies where a run has them."""
    work, whole = new_work(system), system.complete_scene
    work.clock[0] = float(system.clocks(np.array([t]))[0])
    kernel_calls.evaluate(system, work, t, z, v)
    start = guess(whole)
    for b, body in enumerate(whole.bodies):
        if not body.of_scene:
            continue
        frame = work.frame[system.index(body.name)]
        keep_frame(whole, b, frame, start.z, start.v)
    if whole.n_turns == system.n_turns:
        start.z[len(start.z) - whole.n_turns :] = z[len(z) - whole.n_turns :]
    state = State(whole, Start(start.z, start.v))
    state.t = t
    state.work.clock[0] = work.clock[0]
    return state


def _is_large(state: State) -> bool:
    return state.system.n_rows > LARGEST


def _suspects(state: State, left: Array) -> list[str]:
    """Joints and drives that may have a part in a contradiction.

    left : (rows,) residuals where they are least, relative to sizes; in large scenes
        only what is open there has a part
    """
    rows, drives = state.system.rows, state.system.scene.drives
    if not _is_large(state):
        return list(dict.fromkeys(row.name for row in rows))
    open_ = np.abs(left) > PART * np.abs(left).max()
    found = [r.name for r in rows if open_[r.first : r.first + r.count].any()]
    return sorted(dict.fromkeys(found), key=lambda name: name not in drives)


def _contradicting(
    state: State, names: list[str], holds: Callable[[], bool]
) -> list[str]:
    """Those of some joints and drives without each of which something holds.

    All of them where they are too many to be tried.
    """
    if _is_large(state) and len(names) > FEW:
        return names
    before, found = state.ignored.copy(), []
    for name in names[:MOST]:
        state.ignored[_rows_of(state.system, name)] = True
        if holds():
            found.append(name)
        state.ignored[:] = before
    return found


def _in_words(system: System, names: list[str]) -> str:
    if system.n_rows > LARGEST and len(names) > FEW:
        more = len(names) - LISTED
        return f"{', '.join(names[:LISTED])} and {more} others contradict each other"
    return _listed(names) + _still(system, names)


def _still(system: System, names: list[str]) -> str:
    """Point masses whose angle a drive of one of the joints or drives prescribes."""
    scene = system.scene
    driven = [d.joint for n, d in scene.drives.items() if n in names and d.joint]
    ends = {
        marker_reference(text)[0]
        for joint in driven
        if scene.joints[joint].type == "revolute"
        for text in marker_names(scene.joints[joint])
    }
    masses = [d.name for d in system.bodies if d.name in ends and not d.rotates]
    masses = [name for name in masses if name in scene.bodies]
    return f"; {masses[0]} is a point mass, which does not rotate" if masses else ""


def _listed(names: list[str]) -> str:
    """ "a, b and c contradict each other ..."; empty without names."""
    if not names:
        return ""
    if len(names) == 1:
        return f"{names[0]} cannot be met, which all the others can without it"
    return (
        f"{', '.join(names[:-1])} and {names[-1]} contradict each other (without any "
        "one of them the rest can be met)"
    )


def _names_and_test(state: State) -> tuple[list[str], Callable[[], bool]]:
    """What contradicts what, empty if all can be met; and the test of what is met, from
    where the state is now."""
    make_rigid(state)
    z = state.z.copy()

    def met() -> bool:
        state.z[:] = z
        state.evaluate()
        if _is_large(state):
            least_open(state, 1.0 / state.sizes)
            return state.opening <= OPEN
        return close(state) <= OPEN

    if met():
        return [], met
    names = _suspects(state, state.residual / state.sizes)
    return _contradicting(state, names, met), met


def make_rigid(state: State) -> None:
    """Takes the deformation from a state, and from what may move it."""
    for row in state.system.arrays.body:
        nq = int(row[at.NQ])
        if nq:
            last, end = int(row[at.VEL] + row[at.NV]), int(row[at.POS] + row[at.NP])
            state.free[last - nq : last] = False
            state.z[end - nq : end] = 0.0
    state.evaluate()


def _rows_of(system: System, name: str) -> NDArray[np.bool_]:
    """(rows,) true for those of a joint or a drive."""
    mask = np.zeros(system.n_rows, bool)
    for row in system.rows:
        if row.name == name:
            mask[row.first : row.first + row.count] = True
    return mask


@dataclass(frozen=True)
class Apart:
    """How far the markers of a joint stay apart when all the others are met [m]."""

    name: str
    markers: tuple[str, str]
    gap: float

    def __str__(self) -> str:
        a, b = self.markers
        return f"{a} and {b} ({self.name}) come no nearer than {self.gap:.3g} m"


def _nearest(state: State, met: Callable[[], bool], names: list[str]) -> Apart | None:
    """Of joints that contradict each other, the last that holds points together.

    Ends in the state where its markers are nearest.
    """
    joints = state.system.scene.joints
    for name in reversed([row.name for row in state.system.rows]):
        joint = joints.get(name)
        if joint is None or joint.type not in MEETING or name not in names:
            continue
        mask = _rows_of(state.system, name)
        state.ignored[mask] = True
        alone = met()
        state.ignored[mask] = False
        if alone:
            a, b = marker_names(joint)
            return Apart(name, (a, b), _least_gap(state, mask, a, b))
    return None


def _places(state: State) -> str:
    """Where the bodies are that lie elsewhere than the scene puts them, in words."""
    system = state.system
    ways = displacements(system, state.work)
    far = [
        n for n, (way, turn) in ways.items() if max(way / system.length, turn) > MEET
    ]
    texts = []
    for name in far[:3]:
        row = system.arrays.body[system.index(name)]
        p, axes = int(row[at.POS]), 2 if system.planar else 3
        place = state.z[p : p + axes]
        place = np.where(np.abs(place) > MEET * system.length, place, 0.0)
        text = ", ".join(f"{x:.4g}" for x in place)
        text = f"{name}.initial.position = [{text}]"
        if system.planar and row[at.NP] - row[at.NQ] > axes:
            text += f" and angle = {state.z[p + 2]:.4g}"
        texts.append(text)
    return ", ".join(texts)


def _least_gap(state: State, part: NDArray[np.bool_], a: str, b: str) -> float:
    """Distance of two markers where they are nearest, sought from some places."""
    z, random = state.z.copy(), np.random.default_rng(0)
    least, best = np.inf, z
    for _ in range(1 if _is_large(state) else PLACES):
        state.z[:] = z
        state.evaluate()
        step = NEARBY * random.standard_normal(len(state.v)) * state.free
        step *= coordinate_sizes(state.system)
        retract(state.system.arrays, state.work.frame.copy(), state.z, step)
        state.evaluate()
        _approach(state, part)
        gap = _distance(state, a, b)
        if gap < least:
            least, best = gap, state.z.copy()
    state.z[:] = best
    state.evaluate()
    return least


def _distance(state: State, a: str, b: str) -> float:
    axes = 2 if state.system.planar else 3
    ends = [
        state.work.point[state.system.markers[marker_reference(text)]][:axes]
        for text in (a, b)
    ]
    return float(np.linalg.norm(ends[1] - ends[0]))


def _approach(state: State, part: NDArray[np.bool_]) -> None:
    """Moves the state to where some rows are least open while the others are met."""
    for heavy in WEIGHTS:
        least_open(state, np.where(part, 1.0, heavy) / state.sizes)
