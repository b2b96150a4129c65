"""How much the loads of a body change its stiffness, over many instants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
#: Two deformations are a pair that whirls when the squares of their frequencies differ
#: by less than this factor, and Coriolis forces undo more than this part of the
#: softening; so many pairs of a shaft are looked at.
_PAIR, _UNDONE, _PAIRS = 10.0, 0.9, 8
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
    nothing = Stiffening(carried=has_stiffening(sid), from_matrices=sid.from_matrices)
    columns, matrices, owners = _columns(sid, loads)
    basis = elastic_basis(sid)
    if len(columns) == 0 or not columns.any() or basis.size == 0:
        return nothing
    reduced = basis.T @ matrices @ basis
    sinking = _extreme(columns, -reduced, signed=True, least=1.0)
    diverges = sinking.ratio >= 1.0 and _grows(
        sid,
        loads.angular_velocity[sinking.row],
        np.tensordot(columns[sinking.row], matrices, 1),
    )
    if diverges:
        worst = replace(sinking, ratio=-sinking.ratio)
    else:
        loading = _Loading(columns, reduced, tuple(owners))
        loading, worst = _without_whirl(sid, loads, loading, least)
        columns, reduced = loading.columns, loading.reduced
        owners = list(loading.owners)
    i, shape = worst.row, worst.shape
    main = _main_load(columns[i], reduced, owners, shape)
    of_main = np.where([owner == main for owner in owners], columns[[i]], 0.0)
    others = not np.array_equal(of_main, columns[[i]])
    w = loads.angular_velocity[i]
    return replace(
        nothing,
        ratio=worst.ratio,
        load=_in_words(main, loads, i) if shape.any() else "",
        diverges=bool(diverges),
        time=float(times[i]),
        axial=main == "rotation"
        and (_about_long_axis(sid, w) or _whirls(sid, w, basis @ shape)),
        alone=_extreme(of_main, reduced).ratio if others else worst.ratio,
    )


@dataclass(frozen=True, eq=False)
class _Loading:
    """Loads (nt, n), the stiffness (n, r, r) that each adds, on deformations of elastic
    energy 1/2, and the names of the loads."""

    columns: Array
    reduced: Array
    owners: tuple[str, ...]


def _without_whirl(
    sid: SID, loads: Loads, loading: _Loading, least: float
) -> tuple[_Loading, _Extreme]:
    """The loading without the softening of whirl by rotation, and its extreme.

    The shape functions of a shaft that turns about its axis are softened in the frame
    that turns with it, and Coriolis forces between the two of a pair undo it: in axes
    at rest its frequencies are those without rotation (whirl of Jeffcott's rotor).
    """
    basis = elastic_basis(sid)
    units = basis.T @ unit_stiffness(sid)["rotation"] @ basis
    axes: list[Array] = []
    undone: list[Array] = []
    while True:
        found = _extreme(loading.columns, loading.reduced, least=least)
        w = loads.angular_velocity[found.row]
        if not found.shape.any() or not w.any() or len(axes) == _PAIRS:
            return loading, found
        main = _main_load(
            loading.columns[found.row], loading.reduced, loading.owners, found.shape
        )
        x = basis @ found.shape
        if main != "rotation" or not _whirls(sid, w, x):
            return loading, found
        axis = w / np.linalg.norm(w)
        softening = np.tensordot(rotation_products(axis), units, 1)
        for other, change in zip(axes, undone, strict=True):
            softening = softening + (axis @ other) ** 2 * change
        pair = np.column_stack([x, _coriolis_partner(sid, axis, x)])
        Q = np.linalg.qr(basis.T @ symmetric(sid.Ke.m0) @ pair)[0]
        P = np.eye(len(Q)) - Q @ Q.T
        axes.append(axis)
        undone.append(P @ softening @ P - softening)
        loading = _Loading(
            np.column_stack([loading.columns, (loads.angular_velocity @ axis) ** 2]),
            np.concatenate([loading.reduced, undone[-1:]]),
            (*loading.owners, "rotation"),
        )


def _coriolis_partner(sid: SID, w: Array, x: Array) -> Array:
    """The deformation that Coriolis forces couple with x (nq,): M^-1 G x / 2."""
    gyroscopic = np.einsum("akl,a->kl", ge(sid), w)
    inverse = np.linalg.pinv(symmetric(sid.Me.m0), hermitian=True)
    return np.asarray(inverse @ gyroscopic @ x / 2)


def _whirls(sid: SID, w: Array, x: Array) -> bool:
    """Do Coriolis forces of a rotation w undo what it takes from the stiffness of x?

    For sections that whirl as they are, they couple x with a deformation y of the same
    stiffness about; its kinetic energy is what centrifugal forces take from x.
    """
    M, K = symmetric(sid.Me.m0), symmetric(sid.Ke.m0)
    oe = unit_stiffness(sid)["rotation"]
    softening = -float(x @ np.tensordot(rotation_products(w), oe, 1) @ x)
    y = _coriolis_partner(sid, w, x)
    kinetic = float(y @ M @ y)
    if not softening > 0.0 or not kinetic > _UNDONE * softening:
        return False
    return float(y @ K @ y) * float(x @ M @ x) <= _PAIR * kinetic * float(x @ K @ x)


def _main_load(
    loads: Array, reduced: Array, owners: Sequence[str], shape: Array
) -> str:
    """The load (n,) with the largest part of the stiffness that all add to a shape."""
    shares = loads * np.einsum("a,jab,b->j", shape, reduced, shape)
    sums: dict[str, float] = {}
    for owner, share in zip(owners, shares, strict=True):
        sums[owner] = sums.get(owner, 0.0) + float(share)
    return max(sums, key=lambda name: abs(sums[name]))


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
