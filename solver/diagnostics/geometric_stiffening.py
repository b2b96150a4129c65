"""Change of the stiffness and of the inertia of a body by its loads and deformation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sidtool.formats.base.sid import SID, Array, symmetric_3x3
from sidtool.formats.geometric_stiffening import (
    LoadStiffening,
    elastic_basis,
    has_second_order_field,
    has_stiffening,
    rotation_products,
    unit_stiffness,
)
from sidtool.formats.sid_mass import body_size
from sidtool.formats.storage.cache import cached_by_identity

from ..output.samples import Samples
from ..spatial import system_arrays as at
from ..system.sid_packing import symmetrise
from ..system.sid_terms import ge
from ..system.system import System
from ..system.work_arrays import evaluate, new_work_arrays

#: Instants whose eigenvalues are computed together.
BATCH_SIZE = 8
#: Changes of an eigenvalue below this part of it are rounding.
ROUNDING = 1e-12
#: A rate of growth counts as none below this part of the fastest frequency.
GROWTH_TOLERANCE = 1e-7
#: A body turns about its long axis when its radius of gyration about that axis is below
#: this part of its length: centrifugal forces do not pull on it.
SLENDERNESS = 0.1
#: Two deformations are a pair that whirls when the squares of their frequencies differ
#: by less than this factor, and Coriolis forces undo more than this part of the
#: softening; so many pairs of a shaft are looked at.
_PAIR_FACTOR, _CORIOLIS_FRACTION, _MAX_PAIRS = 10.0, 0.9, 8
_UNITS = {
    "rotation": "rad/s",
    "acceleration": "m/s2",
    "angular acceleration": "rad/s2",
    "force": "N",
    "moment": "N m",
}

#: Deformations that move less than this part of the largest moved mass move none.
MIN_MASS = 1e-12


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads of one body in its frame, one row (3,) per instant; see `load_stiffness`.

    Attributes
    ----------
    forces, moments
        Node id -> (nt, 3).
    """

    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array
    forces: Mapping[str, Array] = field(default_factory=dict)
    moments: Mapping[str, Array] = field(default_factory=dict)


def largest_stiffening(
    sid: SID, loads: Loads, times: Array, least: float = 0.0
) -> LoadStiffening:
    """The instant at which loads change the stiffness most.

    Parameters
    ----------
    times : (nt,)
        The loads [s].
    least
        Smaller changes than this part of the stiffness need not be found, unless
        deformations grow.
    """
    nothing = LoadStiffening(
        carried=has_stiffening(sid), from_matrices=sid.from_matrices
    )
    columns, matrices, owners = _load_columns(sid, loads)
    basis = elastic_basis(sid)
    if len(columns) == 0 or not columns.any() or basis.size == 0:
        return nothing
    reduced = basis.T @ matrices @ basis
    softening = _largest_eigenvalue(columns, -reduced, signed=True, least=1.0)
    diverges = softening.ratio >= 1.0 and _is_unstable(
        sid,
        loads.angular_velocity[softening.row],
        np.tensordot(columns[softening.row], matrices, 1),
    )
    if diverges:
        worst = replace(softening, ratio=-softening.ratio)
    else:
        loading = _LoadStiffness(columns, reduced, tuple(owners))
        loading, worst = _without_whirl_softening(sid, loads, loading, least)
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
        load=_load_text(main, loads, i) if shape.any() else "",
        diverges=bool(diverges),
        time=float(times[i]),
        axial=main == "rotation"
        and (_rotates_about_long_axis(sid, w) or _is_whirl_pair(sid, w, basis @ shape)),
        alone=_largest_eigenvalue(of_main, reduced).ratio if others else worst.ratio,
    )


@dataclass(frozen=True, eq=False)
class _LoadStiffness:
    """Loads (nt, n), the stiffness (n, r, r) that each adds, on deformations of elastic
    energy 1/2, and the names of the loads."""

    columns: Array
    reduced: Array
    owners: tuple[str, ...]


def _without_whirl_softening(
    sid: SID, loads: Loads, loading: _LoadStiffness, least: float
) -> tuple[_LoadStiffness, _ExtremeEigenvalue]:
    """The loading without the softening of whirl by rotation, and its extreme.

    The shape functions of a shaft that rotates about its axis are softened in the frame
    that rotates with it, and Coriolis forces between the two of a pair undo it: in axes
    at rest its frequencies are those without rotation (whirl of Jeffcott's rotor).
    """
    basis = elastic_basis(sid)
    units = basis.T @ unit_stiffness(sid)["rotation"] @ basis
    axes: list[Array] = []
    corrections: list[Array] = []
    rounding = 0.0
    while True:
        extreme = _largest_eigenvalue(
            loading.columns, loading.reduced, least=least, rounding=rounding
        )
        rounding = rounding or ROUNDING * abs(extreme.ratio)
        w = loads.angular_velocity[extreme.row]
        if not extreme.shape.any() or not w.any() or len(axes) == _MAX_PAIRS:
            return loading, extreme
        main = _main_load(
            loading.columns[extreme.row], loading.reduced, loading.owners, extreme.shape
        )
        x = basis @ extreme.shape
        if main != "rotation" or not _is_whirl_pair(sid, w, x):
            return loading, extreme
        axis = w / np.linalg.norm(w)
        softening = np.tensordot(rotation_products(axis), units, 1)
        for other, change in zip(axes, corrections, strict=True):
            softening = softening + (axis @ other) ** 2 * change
        pair = np.column_stack([x, _coriolis_partner(sid, axis, x)])
        Q = np.linalg.qr(basis.T @ symmetrise(sid.Ke.m0) @ pair)[0]
        P = np.eye(len(Q)) - Q @ Q.T
        axes.append(axis)
        corrections.append(P @ softening @ P - softening)
        loading = _LoadStiffness(
            np.column_stack([loading.columns, (loads.angular_velocity @ axis) ** 2]),
            np.concatenate([loading.reduced, corrections[-1:]]),
            (*loading.owners, "rotation"),
        )


@cached_by_identity
def softening_bound(sid: SID, planar: bool) -> float:
    """Bound of |ratio| of `largest_stiffening` over the square of the angular velocity
    [s2/rad2]; infinite if other loads change the stiffness as well.

    With the Frobenius norm |K| of the stiffness by rotation on deformations of elastic
    energy 1/2: |K| bounds its eigenvalues. P K P of a projection P has at most this
    norm, and K - P K P as well. So whirl about one axis adds nothing to the bound, and
    about each other axis it doubles it at most.
    """
    units = unit_stiffness(sid)
    others = units["acceleration"], units["angular acceleration"]
    if has_second_order_field(sid) or any(matrix.any() for matrix in others):
        return np.inf
    basis, rotation = elastic_basis(sid), units["rotation"]
    if planar:
        return float(np.linalg.norm(basis.T @ rotation[2] @ basis))
    return 2.0**_MAX_PAIRS * float(np.linalg.norm(basis.T @ rotation @ basis))


def _coriolis_partner(sid: SID, w: Array, x: Array) -> Array:
    """The deformation that Coriolis forces couple with x (nq,): M^-1 G x / 2."""
    gyroscopic = np.einsum("akl,a->kl", ge(sid), w)
    return np.asarray(_inverse_mass(sid) @ gyroscopic @ x / 2)


@cached_by_identity
def _inverse_mass(sid: SID) -> Array:
    return np.asarray(np.linalg.pinv(symmetrise(sid.Me.m0), hermitian=True))


def _is_whirl_pair(sid: SID, w: Array, x: Array) -> bool:
    """Do Coriolis forces of a rotation w undo what it takes from the stiffness of x?

    For sections that whirl as they are, they couple x with a deformation y of the same
    stiffness about; its kinetic energy is what centrifugal forces take from x.
    """
    M, K = symmetrise(sid.Me.m0), symmetrise(sid.Ke.m0)
    oe = unit_stiffness(sid)["rotation"]
    softening = -float(x @ np.tensordot(rotation_products(w), oe, 1) @ x)
    y = _coriolis_partner(sid, w, x)
    kinetic = float(y @ M @ y)
    if not softening > 0.0 or not kinetic > _CORIOLIS_FRACTION * softening:
        return False
    return float(y @ K @ y) * float(x @ M @ x) <= _PAIR_FACTOR * kinetic * float(
        x @ K @ x
    )


def _main_load(
    loads: Array, reduced: Array, owners: Sequence[str], shape: Array
) -> str:
    """The load (n,) with the largest part of the stiffness that all add to a shape."""
    shares = loads * np.einsum("a,jab,b->j", shape, reduced, shape)
    sums: dict[str, float] = {}
    for owner, share in zip(owners, shares, strict=True):
        sums[owner] = sums.get(owner, 0.0) + float(share)
    return max(sums, key=lambda name: abs(sums[name]))


def _rotates_about_long_axis(sid: SID, w: Array) -> bool:
    """Does so little of the body lie beside the axis that nothing pulls on it?

    The radius of gyration about the parallel axis through the centre of mass beside the
    length of the body: what the axis itself lies off bends the body only.
    """
    speed = np.linalg.norm(w)
    if speed == 0.0 or sid.mass == 0.0:
        return False
    axis, centre = w / speed, sid.mdCM.m0[:, 0] / sid.mass
    off = sid.mass * float(np.sum(np.cross(axis, centre) ** 2))
    about_origin = float(axis @ symmetric_3x3(sid.J.m0[:, 0]) @ axis)
    moment = max(0.0, about_origin - off)
    return bool(np.sqrt(moment / sid.mass) < SLENDERNESS * body_size(sid))


def _load_columns(sid: SID, loads: Loads) -> tuple[Array, Array, list[str]]:
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
class _ExtremeEigenvalue:
    """Instant, eigenvalue and eigenvector."""

    row: int
    ratio: float
    shape: Array


def _largest_eigenvalue(
    columns: Array,
    reduced: Array,
    signed: bool = False,
    least: float = 0.0,
    rounding: float = 0.0,
) -> _ExtremeEigenvalue:
    """The largest eigenvalue over all instants, in magnitude unless `signed`.

    The Frobenius norm is cheap and bounds the eigenvalues: instants are looked at from
    the largest norm on, until none can be larger than what was found. What is below
    `least` need not be found. By Weyl's inequality eigenvalues change by no more than
    the norm of the change: instants with the same loads but for rounding are left out.

    Parameters
    ----------
    rounding
        Error of the eigenvalues, where they are less than others that were removed.
    """
    least = max(least, rounding)
    gram = np.einsum("iab,jab->ij", reduced, reduced)
    norms = np.sqrt(np.maximum(np.einsum("ti,ij,tj->t", columns, gram, columns), 0.0))
    order = np.argsort(-norms, kind="stable")
    extreme = _ExtremeEigenvalue(int(order[0]), 0.0, np.zeros(reduced.shape[1]))
    while len(order) and norms[order[0]] > max(abs(extreme.ratio), least):
        rows, order = np.split(order, [BATCH_SIZE])
        matrices = np.tensordot(columns[rows], reduced, 1)
        if _eigenvalue_bound(matrices) <= max(abs(extreme.ratio), least):
            continue
        values, vectors = np.linalg.eigh(matrices)
        sizes = values if signed else np.abs(values)
        k, mode = np.unravel_index(sizes.argmax(), values.shape)
        if sizes[k, mode] > abs(extreme.ratio):
            row, shape = int(rows[k]), vectors[k, :, mode]
            extreme = _ExtremeEigenvalue(row, float(values[k, mode]), shape)
            change = np.abs(columns[order] - columns[row]) @ np.sqrt(np.diag(gram))
            order = order[change > max(rounding, ROUNDING * abs(extreme.ratio))]
    return extreme


def _eigenvalue_bound(matrices: Array) -> float:
    """Bound of the magnitude of all eigenvalues of symmetric matrices (nt, n, n).

    |A^8|^(1/8) of the Frobenius norm |A| is at most n^(1/16) times the largest one.
    """
    norms = np.linalg.norm(matrices, axis=(1, 2))
    powers = matrices / np.maximum(norms, np.finfo(float).tiny)[:, None, None]
    for _ in range(3):
        powers = powers @ powers
    bounds = norms * np.linalg.norm(powers, axis=(1, 2)) ** 0.125
    return float(bounds.max()) * (1.0 + 1e-9)  # whatever rounding takes away


def _is_unstable(sid: SID, w: Array, added: Array) -> bool:
    """Do deformations grow in a frame that turns at w? Coriolis forces may hold them.

    Me q'' + Ge(w) q' + (Ke + added) q = 0, without damping.
    """
    n, gyroscopic = sid.nq, np.einsum("akl,a->kl", ge(sid), w)
    stiffness = symmetrise(sid.Ke.m0) + added
    inverse = _inverse_mass(sid)
    accelerations = np.hstack([-inverse @ stiffness, -inverse @ gyroscopic])
    matrix = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), accelerations])
    values = np.linalg.eigvals(matrix)
    return bool(values.real.max() > GROWTH_TOLERANCE * np.abs(values).max())


def _load_text(name: str, loads: Loads, i: int) -> str:
    """ "rotation of 6 rad/s", "a force of 3 N at node 2"."""
    kind, _, node = name.partition(" ")
    if kind in ("force", "moment"):
        acting = loads.forces if kind == "force" else loads.moments
        size = np.linalg.norm(acting[node][i])
        return f"a {kind} of {size:.3g} {_UNITS[kind]} at node {node}"
    history = {"rotation": loads.angular_velocity, "acceleration": loads.acceleration}
    size = np.linalg.norm(history.get(name, loads.angular_acceleration)[i])
    return f"{name} of {size:.3g} {_UNITS[name]}"


def has_stiffened_inertia(system: System, b: int) -> bool:
    """Does the body move by the inertia of stiffened bodies (theory, section 12)?"""
    return bool(system.arrays.body[b, at.FLAGS] & at.STIFFENED)


def rows_of_new_maxima(q: Array, largest: Array) -> Array:
    """Rows of q (nt, nq) where a coordinate is larger than all before, `largest`."""
    sizes = np.nan_to_num(np.abs(q))
    rows = sizes.argmax(axis=0)
    return np.unique(rows[sizes.max(axis=0) > largest])


def changes_of_inertia(
    system: System, rows: Mapping[str, Array], samples: Samples, times: Array
) -> dict[str, float]:
    """Largest change of the kinetic energy of each body, over all elastic velocities.

    The eigenvalue of (Mee(q) - Me, Me) that is largest in magnitude, where Mee is the
    elastic block of the mass matrix in some states.

    Parameters
    ----------
    rows
        States to look at, by body.
    """
    changes = dict.fromkeys(rows, 0.0)
    states = set[int]().union(*(states.tolist() for states in rows.values()))
    if not states:
        return changes
    work = new_work_arrays(system)
    bodies = {name: system.index(name) for name in rows if len(rows[name])}
    bases = {
        name: _mass_normalised_basis(system.bodies[b].sid) for name, b in bodies.items()
    }
    for k in sorted(states):
        evaluate(system, work, float(times[k]), samples.z[k], samples.v[k])
        for name, b in bodies.items():
            if k in rows[name]:
                change = _elastic_block(system, work.M, b)
                change = change - symmetrise(system.bodies[b].sid.Me.m0)
                share = _largest_inertia(bases[name].T @ change @ bases[name])
                changes[name] = max(changes[name], share)
    return changes


def _mass_normalised_basis(sid: SID) -> Array:
    """(nq, n) rates of deformations of kinetic energy 1/2 each."""
    values, vectors = np.linalg.eigh(symmetrise(sid.Me.m0))
    has_mass = values > MIN_MASS * values.max(initial=0.0)
    return np.asarray(vectors[:, has_mass] / np.sqrt(values[has_mass]))


def _elastic_block(system: System, M: Array, b: int) -> Array:
    row = system.arrays.body[b]
    n, first, rigid = int(row[at.NV]), int(row[at.BLOCK]), int(row[at.RD])
    return symmetrise(M[first : first + n * n].reshape(n, n)[rigid:, rigid:])


def _largest_inertia(matrix: Array) -> float:
    if not np.isfinite(matrix).all():
        return np.inf
    return float(np.abs(np.linalg.eigvalsh(matrix)).max(initial=0.0))
