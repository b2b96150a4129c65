"""Checks of mass, stiffness and damping matrices: I13 to I17.

Identities I18 to I21: orientations, empty blocks, signs, higher orders.
"""

from collections.abc import Iterator

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    SID,
    Array,
    Node,
    Taylor,
    orientation_deviation,
    orientation_fault,
)
from sidtool.formats.sid_mass import (
    IN_PLANE,
    SPATIAL,
    central_inertia,
    free_motion,
    plane_of_motion,
    skew,
)
from sidtool.solver.system.sid_terms import (
    SYMMETRY_ROUNDING,
    check_first_order,
    non_potential_fraction,
)

from .frequencies import (
    free_modes,
    held_modes,
    label_hertz,
    sign_correlation,
    symmetric_part,
    to_hertz,
)
from .identity import (
    Finding,
    identity,
    max_magnitude,
    modal_blocks,
    relative_difference,
    transpose_modes,
)

# Eigenvalues of a printed matrix (12 digits) may be off by its size times this.
_PRINT = 1e-10

#: A rotation to this, and its first order: what single precision prints.
ROTATION_TOLERANCE = 1e-6


@identity("I13", bound=1e-11, of_shapes=True)
def modal_matrix_deviation(sid: SID) -> Finding:
    """Largest asymmetry; definiteness is decided by eigenvalues."""
    blocks = {"Me": sid.Me.m0, "Ke": sid.Ke.m0, "De": sid.De.m0}
    asymmetry, size = max(
        (relative_difference(m - m.T, m), max_magnitude(m)) for m in blocks.values()
    )
    broken = [
        f"{name} is not positive {'definite' if name == 'Me' else 'semidefinite'}"
        for name, matrix in blocks.items()
        if not _is_definite(matrix, strictly=name == "Me")
    ]
    detail = "; ".join(broken) or "all definite"
    return Finding(asymmetry, detail, broken=bool(broken), size=size, terms=2)


@identity("I14", bound=0.0)
def coupled_mass_deviation(sid: SID) -> Finding:
    """The deviation is the negative of the smallest relative eigenvalue, if negative.

    A body whose data are planar is judged in its plane; it must not leave it.
    """
    space = free_motion(sid, SPATIAL)
    if space.possible:
        return Finding(0.0, f"smallest relative eigenvalue {space.smallest:.2e}")
    axis = plane_of_motion(sid)
    plane = None if axis is None else free_motion(sid, IN_PLANE[axis])
    if axis is not None and plane is not None and plane.possible:
        return Finding(
            0.0,
            f"planar body: smallest relative eigenvalue {plane.smallest:.2e} in its "
            f"plane; it cannot leave it, since {space.reason}",
        )
    detail = f"{space.reason} (smallest relative eigenvalue {space.smallest:.2e})"
    return Finding(max(0.0, -space.smallest), detail, broken=True)


@identity("I15", bound=1e-3)
def frequency_deviation(sid: SID) -> Finding:
    """Held frame or free body, whichever is closer; label digits count as unknown."""
    label_frequencies = label_hertz(sid)
    if label_frequencies is None:
        return Finding(None, "no frequencies in the labels")
    if not _is_definite(sid.Me.m0, strictly=True):
        return Finding(None, "Me is not positive definite")
    order = np.argsort(label_frequencies[0])
    labels, digits = label_frequencies[0][order], label_frequencies[1][order]
    candidates = [("(Ke, Me)", to_hertz(held_modes(sid)[0]))]
    rigid = _free_coordinates(sid)
    if rigid is not None:
        candidates.append(("free body", to_hertz(free_modes(sid, rigid)[0])))
    size = np.maximum(labels, digits)
    deviations = [
        (float((np.abs(f - labels) / size).max()), name) for name, f in candidates
    ]
    detail = "; ".join(f"{name} {deviation:.1e}" for deviation, name in deviations)
    bound = max(1e-3, float((digits / size).max()))
    return Finding(min(deviations)[0], detail, bound=bound)


@identity("I16", bound=1e-6)
def inertia_tensor_deviation(sid: SID) -> Finding:
    """Relative to the largest principal moment; FEMBS prints J to about 6 digits."""
    if not sid.mass > 0.0:
        return Finding(0.0, "the mass is not positive", broken=True)
    space, axis = free_motion(sid), plane_of_motion(sid)
    planar = axis is not None and not space.possible
    if planar and axis is not None and free_motion(sid, IN_PLANE[axis]).possible:
        return Finding(None, "planar body, only one moment of inertia is known")
    moments: Array = np.linalg.eigvalsh(central_inertia(sid)).astype(np.float64)
    size = max_magnitude(moments)
    if size == 0.0:
        return Finding(0.0, "point mass")
    excess = max(-moments[0], moments[2] - moments[0] - moments[1], 0.0)
    parts = ", ".join(f"{value:.5g}" for value in moments)
    return Finding(float(excess / size), f"principal moments {parts}")


@identity("I17", bound=1e-9, of_shapes=True)
def damping_deviation(sid: SID) -> Finding:
    """alpha Me + beta Ke, or 2 zeta sqrt(K M) per mode (of the body or of the file)."""
    if not sid.De.m0.any():
        return Finding(None, "no damping")
    if not _is_definite(sid.Me.m0, strictly=True):
        return Finding(None, "Me is not positive definite")
    squares, modes = held_modes(sid)
    in_modes = modes.T @ symmetric_part(sid.De.m0) @ modes
    as_written = np.diag(sid.Ke.m0), np.diag(sid.Me.m0), sid.De.m0
    laws = [
        _modal_fit(squares, np.ones(sid.nq), in_modes, "mode"),
        _modal_fit(*as_written, "coordinate"),
    ]
    if sid.nq > 1:
        laws.insert(0, _rayleigh_fit(squares, in_modes))
    passing = [law for law in laws if law[0] <= 1e-9]
    deviation, detail = passing[0] if passing else min(laws)
    return Finding(deviation, detail)


def _is_definite(matrix: Array, *, strictly: bool) -> bool:
    """Decided on the matrix scaled to a unit diagonal, so modes of any size count."""
    diagonal = np.diag(matrix)
    if np.any(diagonal < 0.0) or (strictly and np.any(diagonal == 0.0)):
        return False
    size = np.where(
        diagonal > 0.0, np.sqrt(diagonal), max_magnitude(matrix) ** 0.5 or 1.0
    )
    values = np.linalg.eigvalsh(symmetric_part(matrix) / np.outer(size, size))
    return bool(values[0] > _PRINT if strictly else values[0] >= -_PRINT * len(matrix))


def _free_coordinates(sid: SID) -> tuple[int, ...] | None:
    """Rigid coordinates that the body can move in freely, if any."""
    if free_motion(sid).possible:
        return SPATIAL
    axis = plane_of_motion(sid)
    if axis is None or not free_motion(sid, IN_PLANE[axis]).possible:
        return None
    return IN_PLANE[axis]


def _rayleigh_fit(squares: Array, damping: Array) -> tuple[float, str]:
    """d_i = alpha + beta w_i^2, each row weighted by 1/d_i; Me = I in this basis."""
    diagonal = np.diag(damping)
    weight = 1.0 / np.where(diagonal != 0.0, np.abs(diagonal), max_magnitude(damping))
    rows = np.stack([np.ones_like(squares), squares], axis=1) * weight[:, None]
    size = np.abs(rows).max(axis=0)
    columns = np.where(size > 0.0, size, 1.0)
    share = np.linalg.lstsq(rows / columns, diagonal * weight, rcond=None)[0]
    alpha, beta = np.where(np.abs(share) < 1e-9, 0.0, share) / columns
    terms = [(alpha, "Me"), (beta, "Ke")]
    text = " + ".join(f"{factor:.4g} {name}" for factor, name in terms if factor)
    return _scaled_difference(damping, np.diag(alpha + beta * squares)), f"De = {text}"


def _modal_fit(
    stiffness: Array, mass: Array, damping: Array, per: str
) -> tuple[float, str]:
    """Fit 2 zeta_i sqrt(k_i m_i) to the diagonal, any zeta_i, with zeros off the
    diagonal.
    """
    critical = 2.0 * np.sqrt(np.clip(stiffness * mass, 0.0, None))
    diagonal = np.diag(damping)
    ratio = diagonal / np.where(critical > 0.0, critical, 1.0)
    text = f"zeta = {ratio.min():.4g} ... {ratio.max():.4g} per {per}"
    if np.ptp(ratio) <= 1e-9 * np.abs(ratio).max():
        text = f"zeta = {ratio.mean():.4g} for every {per}"
    return _scaled_difference(damping, np.diag(diagonal)), text


def _scaled_difference(damping: Array, law: Array) -> float:
    """Largest difference, each entry relative to the damping of its two modes."""
    size = np.sqrt(np.abs(np.diag(damping)))
    size = np.where(size > 0.0, size, size.max() or max_magnitude(damping) ** 0.5)
    return max_magnitude((damping - law) / np.outer(size, size))


def orientation_error(m0: Array, m1: Array, psi: Array) -> float:
    """How far m1 (nq, 3, 3) is from (psi_l)~ m0, relative to psi (3, nq)."""
    size = max_magnitude(psi)
    difference = m1 - skew(psi.T) @ m0
    return max_magnitude(difference) / size if size else max_magnitude(difference)


def corrected_orientation(node: Node, nq: int) -> tuple[Taylor, str] | None:
    """Return the orientation that the rest of the node implies, and why; None if
    correct.

    If AP m1 is given, it and psi determine AP m0, since AP m1_l = (psi_l)~ AP0;
    so transposed, reflected and lost orientations are recovered.
    """
    m0, m1, psi = node.AP.m0, node.AP.first_order(nq), node.psi.m0
    if (
        not orientation_fault(m0)
        and orientation_error(m0, m1, psi) <= ROTATION_TOLERANCE
    ):
        return None
    candidates = (
        (m0.T, np.swapaxes(m1, 1, 2), "AP was written as its transpose"),
        (m0.T, m1, "AP m0 was written as its transpose"),
    )
    for candidate, rate, why in candidates:
        if (
            not orientation_fault(candidate)
            and orientation_error(candidate, rate, psi) <= ROTATION_TOLERANCE
        ):
            return Taylor(candidate, rate), why
    candidate, why = m0, "AP m1_l = (psi_l)~ AP0"
    implied = _implied_orientation(m1, psi)
    if implied is not None:
        candidate, why = implied, "AP0 follows from AP m1_l = (psi_l)~ AP0"
    elif not m0.any():
        candidate, why = np.eye(3), "AP was empty: the axes of the body frame"
    if orientation_fault(candidate):
        return None
    return Taylor(candidate, skew(psi.T) @ candidate if nq else None), why


def _implied_orientation(m1: Array, psi: Array) -> Array | None:
    """Return AP0 from its first order by least squares; None if that is no rotation."""
    if not m1.any():
        return None
    turns = skew(psi.T).reshape(-1, 3)
    solved, _, rank, _ = np.linalg.lstsq(turns, m1.reshape(-1, 3), rcond=1e-9)
    orientation = np.asarray(solved, np.float64)
    if (
        rank < 3
        or orientation_fault(orientation)
        or orientation_error(orientation, m1, psi) > ROTATION_TOLERANCE
    ):
        return None
    left, _, right = np.linalg.svd(orientation)
    return np.asarray(left @ right)


@identity("I18", bound=1e-5)
def node_orientation_deviation(sid: SID) -> Finding:
    """Return the largest entry of AP^T AP - I; a reflected or empty AP always fails."""
    if not sid.nodes:
        return Finding(None, "no nodes")
    wrong = [(node.id, orientation_fault(node.AP.m0)) for node in sid.nodes]
    wrong = [(name, text) for name, text in wrong if text]
    worst = max(orientation_deviation(node.AP.m0) for node in sid.nodes)
    if not wrong:
        return Finding(worst, size=1.0, terms=6)
    name, text = wrong[0]
    more = f" and at {len(wrong) - 1} more" if len(wrong) > 1 else ""
    return Finding(worst, f"{text} at node {name}{more}", broken=True)


@identity("I19", bound=0.0, of_shapes=True)
def placeholder_count(sid: SID) -> Finding:
    """Return the number of blocks that are zero although others imply non-zero
    values.
    """
    empty = list(_empty_blocks(sid))
    return Finding(float(len(empty)), "empty: " + ", ".join(empty) if empty else "")


def _empty_blocks(sid: SID) -> Iterator[str]:
    modes = modal_blocks(sid)
    static = sid.mdCM.first_order(sid.nq)
    moved = any(node.phi.m0.any() for node in sid.nodes)
    no_inertia = sid.mass > 0.0 and sid.J.is_zero
    if no_inertia:
        yield "J"
    elif not modes.J1.any() and sid.Oe.m0.any():
        yield "J m1"
    if not static.any() and sid.Ct.m0.any():
        yield "mdCM m1"
    if not sid.Ct.m0.any() and static.any():
        yield "Ct m0"
    if sid.Gr.is_zero and (modes.J1.any() or sid.Cr.m0.any()):
        yield "Gr"
    if sid.Ge.is_zero and (modes.Cr1 - transpose_modes(modes.Cr1)).any():
        yield "Ge"
    if (sid.Oe.is_zero and no_inertia and moved) or (
        not sid.Oe.m0.any() and modes.J1.any()
    ):
        yield "Oe"
    if no_inertia and moved and sid.Ct.is_zero and sid.Cr.is_zero:
        yield "perhaps Ct, Cr, Gr and Ge, unless the axes are mean ones"


@identity("I20", bound=0.5)
def stiffening_sign_deviation(sid: SID) -> Finding:
    """Return minus the correlation with the centrifugal stiffening, if it is
    determined.
    """
    correlations = sign_correlation(sid)
    if not correlations:
        return Finding(None, "no such terms, or mass on all sides of the origin")
    texts = [f"{name} m1 {value:+.2f}" for name, value in correlations.items()]
    worst = max(0.0, -min(correlations.values()))
    return Finding(worst, "correlation " + ", ".join(texts))


@identity("I21", bound=SYMMETRY_ROUNDING, of_shapes=True)
def energy_free_part(sid: SID) -> Finding:
    """The part of the elastic force of first order that has no energy."""
    measured = non_potential_fraction(sid)
    try:
        check_first_order(sid, "the SID", "")
    except InputError as refused:
        return Finding(measured, refused.problem, broken=True)
    if sid.Ke.first_order(sid.nq).any():
        detail = "elastic forces are quadratic in q (Ke m1), with an energy"
        return Finding(measured, detail)
    return Finding(measured, "elastic forces are linear")
