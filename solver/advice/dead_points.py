"""Joints with friction that rest for an instant, since their mechanism stands there so.

At its dead point a mechanism moves such a joint neither way: velocities do not tell in
which sense it slides, nor forces what it holds.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.scene import marker_names, marker_reference
from sidtool.formats.sid import Array

from ..space import layout as at
from ..start.conflicts import LARGEST
from ..start.consistent import State, sliding_directions
from ..start.overconstraint import complete
from ..start.stated import Start
from ..system.scene import System
from ..system.sizes import coordinate_sizes, row_sizes

#: Constraints that follow from others; and how little of what could move a joint does,
#: near a dead point, relative to what the scale of its bodies would.
DEPENDENT, NEAR = 1e-6, 1e-3


def at_dead_points(system: System, t: float, z: Array, v: Array) -> tuple[str, ...]:
    """Joints with friction that the motion of their mechanism leaves at rest.

    The rate is that of the joint beside the motion that its constraints leave; joints
    whose motion drives prescribe are not among them.
    """
    if not system.rubbing or not np.isfinite(z).all():
        return ()
    if system.complete_scene.n_rows > LARGEST:
        return ()
    state = State(complete(system), Start(z, v))
    state.t = t
    state.evaluate()
    scale = coordinate_sizes(system)
    C = state.jacobian() * scale / row_sizes(system)[:, None]
    _, sizes, right = np.linalg.svd(C, full_matrices=True)
    rank = int(np.sum(sizes > DEPENDENT * max(1.0, sizes.max(initial=0.0))))
    free = right[rank:]
    if not len(free):
        return ()
    along = sliding_directions(state.system, state.work.C) * scale
    moved = np.abs(along @ free.T).max(axis=1)
    still = moved <= NEAR * np.abs(along).max(axis=1)
    led = system.arrays.grip[:, at.LED] > 0.0
    names = [rub.joint for rub in system.rubbing]
    return tuple(names[j] for j in np.flatnonzero(still & ~led))


def undecided(system: System, t: float, z: Array, v: Array) -> str:
    """What to know where friction is not decided, since joints are at dead points."""
    names = at_dead_points(system, t, z, v)
    if not names:
        return ""
    joints = [system.scene.joints[name] for name in names]
    ends = [marker_reference(m)[0] for joint in joints for m in marker_names(joint)]
    bodies = dict.fromkeys(end for end in ends if end != "ground")
    one = len(names) == 1
    return (
        f"; the mechanism stands at a dead point of {', '.join(names)} (singular "
        f"configuration): no motion of it moves {', '.join(bodies)} there, so that "
        f"what friction {'it holds' if one else 'they hold'} is not determined; start "
        "beside the dead point or with a larger speed, drive the mechanism, or leave "
        f"{'this joint' if one else 'these joints'} without friction"
    )
