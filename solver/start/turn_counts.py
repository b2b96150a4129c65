"""Counted rotations of a state: where they start, and where a run loses them."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array

from ..equations.drives import drive_value
from ..integrators import projection, stepping
from ..space import layout as at
from ..space.layout import Work
from ..system.scene import System


def starting_turns(system: System) -> Array:
    """What counted rotations are nearest to at the start, (n_turns,) [rad]."""
    t, found = system.scene.time.start, []
    clock = 0.5 * (t + system.breaks[0])
    for turn in system.turns:
        rest = turn.rest
        if turn.drive >= 0:
            rest = drive_value.py_func(system.arrays, turn.drive, clock, t)[0]
        counted = system.scene.initial.rotations or {}
        found += [counted.get(name, rest) for name in turn.angles]
    return np.array(found[: system.n_turns])


def keep_turns(system: System, work: Work, z: Array) -> None:
    """Lets z say how far its markers turned, as evaluated last."""
    z[len(z) - system.n_turns :] = work.turn[: system.n_turns, at.TURNED]


def lost_turn(system: System, work: Work, control: stepping.Control) -> str:
    """Why the last step could not be counted; empty if it could."""
    fixed = control.fixed_step == 1
    n, h = system.n_turns, control.step if fixed else 0.0
    known, reached = control.z[len(control.z) - n :], work.turn[:n]
    way = abs(reached[:, at.TURNED] - known)
    way = np.maximum(way, h * abs(reached[:, at.TURN_RATE]))
    for turn in system.turns:
        part = slice(turn.entry, turn.entry + len(turn.angles))
        if not turn.counted or not way[part].max() > projection.LARGEST_TURN:
            continue
        name = turn.name.split(".")[0]
        if np.linalg.norm(known[part]) > np.pi and turn.kind == at.TILT:
            return (
                f"{name} is nearly a full turn away from rest, beyond which a bushing "
                "does not know its torque; `shaft` names an axis to turn about"
            )
        return (
            f"{name} turns by more than {projection.LARGEST_TURN} rad in a step, which "
            "cannot be told from less"
            f"{'; a smaller fixed step may help' if fixed else ''}"
        )
    return ""
