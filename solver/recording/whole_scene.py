"""The forces of joints that a scene was cut down by, from the motion of the cut one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.sid import Array

from ..integrators.recording import RUB_FORCE
from ..space import layout as at
from ..space.layout import Work
from ..start.carried import keep_frame
from ..start.consistent import dense_jacobian
from ..start.minimum_norm import minimum_norm
from ..start.overconstraint import complete
from ..system import kernel_calls
from ..system.bodies.embedded import embedded
from ..system.scene import Row, System
from ..system.storage import new_work
from .sampling import Samples

#: Joint forces below this part of the largest are what dependent rows leave open.
RANK_TOLERANCE = 1e-9


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
    work, solver = new_work(whole), _JointForces(system, whole)
    multipliers = np.zeros((len(times), whole.n_rows))
    multipliers[:, solver.known] = samples.multipliers[:, solver.source]
    for i, (t, clock) in enumerate(zip(times, system.clocks(times), strict=True)):
        work.clock[0] = clock
        kernel_calls.evaluate(whole, work, t, z[i], v[i])
        forces = samples.friction[i, :, RUB_FORCE]
        multipliers[i] = solver.complete(work, acc[i], multipliers[i], forces)
    rows: tuple[int, ...] = ()
    if whole.redundant:
        multipliers, rows = minimum_norm(whole, work, times, z, v, multipliers)
    found = replace(samples, z=z, v=v, accelerations=acc, multipliers=multipliers)
    return whole, replace(found, undetermined=rows)


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
    u, rigid = int(row[at.VEL]), int(row[at.RD])
    for i, frame in enumerate(samples.frames[:, b]):
        keep_frame(whole, b, frame, z[i], v[i])
        acc[i, u : u + rigid] = _rates(whole, frame)[:rigid]


def _rates(system: System, frame: Array) -> Array:
    """Derivatives of the body-resolved velocities: a = dv/dt + w x v."""
    of = system.frames(frame)
    carried = np.cross(embedded(of["w"]), embedded(of["v"]))
    return np.append(of["a"] - carried[: len(of["a"])], of["al"])


class _JointForces:
    """Multipliers of eliminated joints, from the equations of the bodies they carry.

    known : rows of the whole scene that the cut one has as well
    source : their rows there
    """

    def __init__(self, system: System, whole: System) -> None:
        self.whole = whole
        pairs = _same_rows(system.rows, whole.rows)
        self.known = np.array([a for a, _ in pairs], int)
        self.source = np.array([b for _, b in pairs], int)
        self.wanted = np.setdiff1d(np.arange(whole.n_rows), self.known)
        columns = [
            np.arange(row[at.VEL], row[at.VEL] + row[at.RD])
            for cut, row in zip(system.arrays.body, whole.arrays.body, strict=True)
            if cut[at.RD] != row[at.RD]
        ]
        self.columns = np.concatenate(columns)

    def complete(
        self, work: Work, acceleration: Array, multipliers: Array, friction: Array
    ) -> Array:
        """All multipliers, of M z_II' = f + C^T lambda as evaluated in `work`.

        friction : (frictions,) forces of friction, which are a part of f
        """
        C = dense_jacobian(self.whole, work.C)
        left = -work.f - C.T @ multipliers
        for j, b, o in self.whole.arrays.sliding.segment:
            n, u = self.whole.arrays.body[b, [at.NV, at.VEL]]
            left[u : u + n] -= friction[j] * work.C[o : o + n]
        for row in self.whole.arrays.body:
            n, o, u = row[at.NV], row[at.BLOCK], row[at.VEL]
            block = work.M[o : o + n * n].reshape(n, n)
            left[u : u + n] += block @ acceleration[u : u + n]
        found = multipliers.copy()
        held = C[self.wanted][:, self.columns].T
        found[self.wanted] = np.linalg.lstsq(
            held, left[self.columns], rcond=RANK_TOLERANCE
        )[0]
        return found


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
