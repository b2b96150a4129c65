"""The forces of joints that a scene was cut down by, from the motion of the cut one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.sid import Array

from ..equations.pointers import kernels
from ..integrators.recording import RUB_FORCE
from ..linear import carried_joints
from ..space import layout as at
from ..start.carried import keep_frame
from ..start.freer_joints import TURNING
from ..start.overconstraint import complete
from ..system.bodies.embedded import embedded
from ..system.kernel_calls import go_on
from ..system.scene import Row, System
from ..system.storage import new_work
from .sampling import Samples


def whole_motion(
    system: System, times: Array, samples: Samples
) -> tuple[System, Samples]:
    """The scene with all of its joints, in the motion of the cut one; itself if it is
    not cut, or if no force of a joint is asked for."""
    whole = system.whole
    if whole is None:
        return complete(system), samples
    z, v, acc = (
        np.zeros((len(times), n))
        for n in (whole.n_positions, whole.n_velocities, whole.n_velocities)
    )
    z[:, whole.n_positions - whole.n_turns :] = samples.z[
        :, system.n_positions - system.n_turns :
    ]
    for b in range(len(system.bodies)):
        _expand(system, whole, b, samples, (z, v, acc))
    whole = complete(whole)
    multipliers = _multipliers(system, whole, times, samples, (z, v, acc))
    found = replace(samples, z=z, v=v, accelerations=acc, multipliers=multipliers)
    return whole, replace(found, undetermined=())


def _expand(
    system: System,
    whole: System,
    b: int,
    samples: Samples,
    states: tuple[Array, Array, Array],
) -> None:
    """Coordinates of one body in the whole scene, with two derivatives."""
    z, v, acc = states
    cut, row = system.arrays.body[b], whole.arrays.body[b]
    for target, source, at_, size in (
        (z, samples.z, at.POS, at.NP),
        (v, samples.v, at.VEL, at.NV),
        (acc, samples.accelerations, at.VEL, at.NV),
    ):
        count, end = int(cut[size]), int(row[at_] + row[size])
        target[:, end - count : end] = source[:, cut[at_] : cut[at_] + count]
    if cut[at.RD] == row[at.RD]:
        return
    u, rigid, frames = int(row[at.VEL]), int(row[at.RD]), samples.frames[:, b]
    keep_frame(whole, b, frames, z, v)
    acc[:, u : u + rigid] = _rates(whole, frames)[:, :rigid]


def _rates(system: System, frames: Array) -> Array:
    """Derivatives of the body-resolved velocities: a = dv/dt + w x v, (nt, .)."""
    of = system.frames(frames)
    carried = np.cross(embedded(of["w"]), embedded(of["v"]))
    linear = of["a"] - carried[:, : of["a"].shape[1]]
    return np.concatenate([linear, of["al"]], axis=1)


def _multipliers(
    system: System,
    whole: System,
    times: Array,
    samples: Samples,
    states: tuple[Array, Array, Array],
) -> Array:
    """Those of the cut scene, and what the joints of carried bodies transmit."""
    rows = _same_rows(system.rows, whole.rows)
    known, source = np.array(rows, np.int64).reshape(-1, 2).T
    multipliers = np.zeros((len(times), whole.n_rows))
    multipliers[:, known] = samples.multipliers[:, source]
    z, v, acc = states
    carried_joints.forces_of_carriers(
        kernels(whole.planar),
        whole.arrays,
        new_work(whole),
        _held(system, whole, np.setdiff1d(np.arange(whole.n_rows), known)),
        np.ascontiguousarray(times),
        system.clocks(times),
        z,
        v,
        acc,
        np.ascontiguousarray(samples.friction[:, :, RUB_FORCE]),
        multipliers,
        np.zeros((carried_joints.MOST_ROWS + 1, carried_joints.MOST_ROWS)),
        np.zeros(carried_joints.MOST_ROWS, np.int64),
    )
    go_on(whole)
    return multipliers


def _held(system: System, whole: System, wanted: Array) -> at.IntTable:
    """Carried bodies, each behind its base, with the rows of their joints.

    A body that does not turn feels no row of rotations.
    """
    rows = {data.name: list[int]() for data in whole.bodies}
    held = whole.arrays.constraint
    turning = set(held[np.isin(held[:, at.KIND], TURNING), at.ROW])
    for row in whole.rows:
        part = set(range(row.first, row.first + row.count)).intersection(wanted)
        if part:
            rows[system.eliminated[row.name]] += sorted(part)
    table = []
    bodies = zip(whole.bodies, system.arrays.body, whole.arrays.body, strict=True)
    for b, (data, cut, row) in enumerate(bodies):
        if cut[at.RD] == row[at.RD]:
            continue
        own = rows[data.name]
        if len(own) > row[at.RD]:
            own = [r for r in own if r not in turning]
        empty = [-1] * (carried_joints.MOST_ROWS - len(own))
        table.append([b, *own, *empty])
    return np.array(table, np.int64).reshape(-1, carried_joints.N_HELD)


def _same_rows(cut: tuple[Row, ...], whole: tuple[Row, ...]) -> list[tuple[int, int]]:
    """Rows of the whole scene with those of the cut one, joint by joint."""
    left: dict[str, list[Row]] = {}
    for row in cut:
        left.setdefault(row.name, []).append(row)
    pairs = []
    for row in whole:
        if row.name in left:
            other = left[row.name].pop(0)
            pairs += [(row.first + k, other.first + k) for k in range(row.count)]
    return pairs
