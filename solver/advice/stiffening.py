"""How much the loads of a body change its stiffness, over many instants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sidtool.formats.sid import SID, Array, symmetric_3x3
from sidtool.formats.sid_mass import body_size
from sidtool.formats.stiffening import (
    Stiffening,
    elastic_basis,
    has_stiffening,
    rotation_products,
    unit_stiffness,
)

from ..system.bodies.blocks import ge
from ..system.bodies.packing import symmetric

#: Instants whose eigenvalues are computed together.
BATCH = 8
#: A rate of growth counts as none below this part of the fastest frequency.
NEUTRAL = 1e-7
#: A body turns about its long axis when its radius of gyration about that axis is below
#: this part of its length: centrifugal forces do not pull on it.
SLENDER = 0.1
_UNITS = {
    "rotation": "rad/s",
    "acceleration": "m/s2",
    "angular acceleration": "rad/s2",
    "force": "N",
    "moment": "N m",
}


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads of one body in its frame, one row (3,) per instant; see `load_stiffness`.

    forces, moments : node id -> (nt, 3)
    """

    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array
    forces: Mapping[str, Array] = field(default_factory=dict)
    moments: Mapping[str, Array] = field(default_factory=dict)


def largest_stiffening(
    sid: SID, loads: Loads, times: Array, least: float = 0.0
) -> Stiffening:
    """The instant at which loads change the stiffness most.

    times : (nt,) of the loads [s]
    least : smaller changes than this part of the stiffness need not be found, unless
        deformations grow
    """
    carried = has_stiffening(sid)
    columns, matrices, owners = _columns(sid, loads)
    basis = elastic_basis(sid)
    if len(columns) == 0 or not columns.any() or basis.size == 0:
        return Stiffening(carried=carried)
    reduced = basis.T @ matrices @ basis
    worst = _extreme(columns, reduced, least=least)
    sinking = _extreme(columns, -reduced, signed=True, least=1.0)
    diverges = sinking.ratio >= 1.0 and _grows(
        sid,
        loads.angular_velocity[sinking.row],
        np.tensordot(columns[sinking.row], matrices, 1),
    )
    if diverges:
        worst = replace(sinking, ratio=-sinking.ratio)
    i, shape = worst.row, worst.shape
    shares = columns[i] * np.einsum("a,jab,b->j", shape, reduced, shape)
    names = list(dict.fromkeys(owners))
    sums = [sum(shares[[owner == name for owner in owners]]) for name in names]
    main = names[int(np.abs(sums).argmax())]
    return Stiffening(
        worst.ratio,
        _in_words(main, loads, i),
        carried,
        bool(diverges),
        float(times[i]),
        axial=main == "rotation" and _about_long_axis(sid, loads.angular_velocity[i]),
    )


def _about_long_axis(sid: SID, w: Array) -> bool:
    """Does so little of the body lie beside the axis that nothing pulls on it?

    The radius of gyration about the parallel axis through the centre of mass beside
    the length of the body: what the axis itself lies off bends the body only.
    """
    speed = np.linalg.norm(w)
    if speed == 0.0 or sid.mass == 0.0:
        return False
    axis, centre = w / speed, sid.mdCM.m0[:, 0] / sid.mass
    off = sid.mass * float(np.sum(np.cross(axis, centre) ** 2))
    about_origin = float(axis @ symmetric_3x3(sid.J.m0[:, 0]) @ axis)
    moment = max(0.0, about_origin - off)
    return bool(np.sqrt(moment / sid.mass) < SLENDER * body_size(sid))


def _columns(sid: SID, loads: Loads) -> tuple[Array, Array, list[str]]:
    """Loads (nt, n) that change the stiffness, its change by each, and their names."""
    values = {
        "rotation": rotation_products(loads.angular_velocity),
        "acceleration": loads.acceleration,
        "angular acceleration": loads.angular_acceleration,
    }
    values |= {f"force {node}": f for node, f in loads.forces.items()}
    values |= {f"moment {node}": m for node, m in loads.moments.items()}
    units = unit_stiffness(sid, tuple({**loads.forces, **loads.moments}))
    columns, matrices, owners = [], [], []
    for name, history in values.items():
        for column, matrix in zip(history.T, units[name], strict=True):
            if matrix.any() and column.any():
                columns.append(column)
                matrices.append(matrix)
                owners.append(name)
    nt, nq = len(loads.angular_velocity), sid.nq
    table = np.array(columns).reshape(-1, nt).T
    finite = np.isfinite(table).all(axis=1)
    return (
        np.where(finite[:, None], table, 0.0),
        np.array(matrices).reshape(-1, nq, nq),
        owners,
    )


@dataclass(frozen=True, eq=False)
class _Extreme:
    """Instant, eigenvalue and eigenvector."""

    row: int
    ratio: float
    shape: Array


def _extreme(
    columns: Array, reduced: Array, signed: bool = False, least: float = 0.0
) -> _Extreme:
    """The largest eigenvalue over all instants, in magnitude unless `signed`.

    The Frobenius norm is cheap and bounds the eigenvalues: instants are looked at from
    the largest norm on, until none can be larger than what was found. What is below
    `least` need not be found.
    """
    gram = np.einsum("iab,jab->ij", reduced, reduced)
    norms = np.sqrt(np.maximum(np.einsum("ti,ij,tj->t", columns, gram, columns), 0.0))
    order = np.argsort(-norms, kind="stable")
    found = _Extreme(int(order[0]), 0.0, np.zeros(reduced.shape[1]))
    for first in range(0, len(order), BATCH):
        rows = order[first : first + BATCH]
        if norms[rows[0]] <= max(abs(found.ratio), least):
            break
        values, vectors = np.linalg.eigh(np.tensordot(columns[rows], reduced, 1))
        sizes = values if signed else np.abs(values)
        k, mode = np.unravel_index(sizes.argmax(), values.shape)
        if sizes[k, mode] > abs(found.ratio):
            row, shape = int(rows[k]), vectors[k, :, mode]
            found = _Extreme(row, float(values[k, mode]), shape)
    return found


def _grows(sid: SID, w: Array, added: Array) -> bool:
    """Do deformations grow in a frame that turns at w? Coriolis forces may hold them.

    Me q'' + Ge(w) q' + (Ke + added) q = 0, without damping.
    """
    n, gyroscopic = sid.nq, np.einsum("akl,a->kl", ge(sid), w)
    stiffness = symmetric(sid.Ke.m0) + added
    inverse = np.linalg.pinv(symmetric(sid.Me.m0))
    below = np.hstack([-inverse @ stiffness, -inverse @ gyroscopic])
    matrix = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), below])
    values = np.linalg.eigvals(matrix)
    return bool(values.real.max() > NEUTRAL * np.abs(values).max())


def _in_words(name: str, loads: Loads, i: int) -> str:
    """ "rotation of 6 rad/s", "a force of 3 N at node 2"."""
    kind, _, node = name.partition(" ")
    if kind in ("force", "moment"):
        acting = loads.forces if kind == "force" else loads.moments
        size = np.linalg.norm(acting[node][i])
        return f"a {kind} of {size:.3g} {_UNITS[kind]} at node {node}"
    history = {"rotation": loads.angular_velocity, "acceleration": loads.acceleration}
    size = np.linalg.norm(history.get(name, loads.angular_acceleration)[i])
    return f"{name} of {size:.3g} {_UNITS[name]}"
