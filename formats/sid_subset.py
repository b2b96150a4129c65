"""SID with a subset of its shape functions, and static compliance by them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .base.errors import InputError
from .base.sid import (
    BLOCK_SHAPES,
    NODE_SHAPES,
    SID,
    Array,
    ComplianceShares,
    Taylor,
    symmetric_3x3,
)
from .sid_mass import CENTRIFUGAL_PRODUCTS, coupled_mass_matrix, mean_axes_motion, skew
from .storage.cache import cached_by_identity

#: Missing work below this part of the reference is rounding.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class UnitLoadCompliances:
    """Displacements and work of the shape functions under unit loads.

    Attributes
    ----------
    nodes : node id -> (6,) displacements along and rotations about the body axes
        [m/N, rad/(N m)]
    inertia : (12,) work [J] of the inertia of the body under the loads of
        `inertia_load_scales`; a free body has none by accelerations
    reference : mass times the square of a unit acceleration, over the square of the
        lowest natural angular frequency [J]
    """

    nodes: dict[str, Array]
    inertia: Array
    reference: float


@cached_by_identity
def unit_load_compliances(sid: SID, free: bool) -> UnitLoadCompliances:
    """Return the static compliance of the shape functions under unit loads.

    Parameters
    ----------
    free : the loads are balanced by the inertia of a free body, whose displacements
        carry no momentum

    Raises
    ------
    numpy.linalg.LinAlgError : Ke is singular.
    """
    inverse = np.linalg.inv(np.linalg.cholesky(sid.Ke.m0))
    rigid = mean_axes_motion(sid) if free else np.zeros((6, sid.nq))
    mass = coupled_mass_matrix(sid)
    accelerations = 0.0 * rigid if free else mass[:6, 6:]
    rotations = sid.Oe.m0.T - _rotation_wrenches(sid) @ rigid
    inertia = np.vstack([accelerations, rotations])
    inertia *= inertia_load_scales(sid.mass, sid.J.m0[:3, 0])[:, None]
    elastic = inverse @ (mass[6:, 6:] - mass[6:, :6] @ rigid) @ inverse.T
    reference = sid.mass * float(np.linalg.eigvalsh(elastic)[-1])

    def work(rows: Array) -> Array:
        return np.asarray(((rows @ inverse.T) ** 2).sum(axis=1))

    at_nodes = {}
    for node in sid.nodes:
        motion = rigid[:3] - skew(node.position) @ rigid[3:]
        shapes = np.vstack([node.phi.m0 - motion, node.psi.m0 - rigid[3:]])
        at_nodes[node.id] = work(shapes)
    return UnitLoadCompliances(at_nodes, work(inertia), reference)


def _rotation_wrenches(sid: SID) -> Array:
    """Force and moment about the origin of int W_s c dm, (6, 6) by the rows of s."""
    inertia = symmetric_3x3(sid.J.m0[:, 0])
    second = np.trace(inertia) / 2 * np.eye(3) - inertia
    fields = CENTRIFUGAL_PRODUCTS @ second
    moments = [fields[:, b, a] - fields[:, a, b] for a, b in ((1, 2), (2, 0), (0, 1))]
    return np.column_stack([CENTRIFUGAL_PRODUCTS @ sid.mdCM.m0[:, 0], *moments])


def inertia_load_scales(mass: float, moments: Array) -> Array:
    """Units (12,) of the loads by which the inertia of a body is compared.

    Accelerations [m/s2], angular accelerations [rad/s2], squares of angular velocities
    about x, y and z and their products xy, yz and xz [rad2/s2], of about one
    acceleration in the body: 1 and 1 / r with the largest radius of gyration r about
    the origin.

    Parameters
    ----------
    mass, moments : [kg], about axes through the origin (n,) [kg m2]
    """
    largest = float(moments.max(initial=0.0))
    scale = np.sqrt(mass / largest) if largest > 0.0 else 1.0
    return np.repeat([1.0, scale], [3, 9])


def remaining_compliance_shares(sid: SID, small: SID) -> ComplianceShares | None:
    """Return the compliance shares of a SID with fewer shape functions."""
    if sid.carried is None or not small.nq:
        return None
    try:
        before = unit_load_compliances(sid, sid.carried.free)
        after = unit_load_compliances(small, sid.carried.free)
    except np.linalg.LinAlgError:
        return None
    shares = {
        name: tuple(map(_share_product, row, *pairs))
        for name, row in sid.carried.shares.items()
        if name in before.nodes
        for pairs in [(after.nodes[name], before.nodes[name])]
    }
    lost: tuple[float, ...] = ()
    if sid.carried.knows_inertia:
        full = inertia_work_of_full_body(sid.carried.lost, before)
        lost = missing_inertia_shares(full, after.inertia, after.reference)
    return ComplianceShares(sid.carried.free, shares, lost)


def _share_product(share: float | None, after: float, before: float) -> float | None:
    return None if share is None or not before else share * float(after / before)


def inertia_work_of_full_body(
    lost: tuple[float, ...], own: UnitLoadCompliances
) -> Array:
    """The work of inertia (12,) of the full body, of which some is `lost`.

    Older files have nine numbers, over the largest work of the full body; what they
    lack under products of angular velocities is not known and counts as none.
    """
    missing, reference = np.zeros(12), own.reference
    missing[: len(lost)] = lost
    if len(lost) == 9:
        known = own.inertia[:9] / np.maximum(1.0 - missing[:9], 1e-300)
        reference = known.max()
    return np.asarray(own.inertia + missing * reference)


def missing_inertia_shares(
    full: Array, carried: Array, reference: float
) -> tuple[float, ...]:
    """Return the missing work (12,) under own inertia, see `ComplianceShares.lost`."""
    missing = np.clip(full - carried, 0.0, None) / reference
    return tuple(np.where(missing > _ROUNDING, missing, 0.0).tolist())


#: Entries of a matrix that belong to the coordinates `kept` (n,) out of nq.
_ENTRIES = {
    "q": lambda kept, nq: kept,
    "3q": lambda kept, nq: np.concatenate([axis * nq + kept for axis in range(3)]),
}


def selected_indices(
    numbers: Sequence[int] | None, nq: int, place: str
) -> tuple[int, ...]:
    """Indices from 0 of the shape functions with these numbers, all for None.

    Raises
    ------
    InputError : a number is none of 1 to nq.
    """
    if numbers is None:
        return tuple(range(nq))
    for number in numbers:
        if not 1 <= number <= nq:
            raise InputError(
                f"there is no shape function {number}",
                place=place,
                expected=f"numbers from 1 to {nq}" if nq else "a SID that has some",
            )
    return tuple(sorted(number - 1 for number in numbers))


def select_shape_functions(sid: SID, selected: Sequence[int]) -> SID:
    """The body that moves and deforms with these shape functions only, from 0.

    Raises
    ------
    InputError : the SID has terms above the first order, whose meaning is open.
    """
    if len(selected) == sid.nq:
        return sid
    rows = np.array(selected, dtype=int)

    def cut(entry: Taylor, name: str) -> Taylor:
        if entry.mn is not None and entry.mn.any():
            raise InputError(
                "the meaning of terms above the first order for some of the shape "
                "functions is not known",
                place=name,
            )
        shape = BLOCK_SHAPES.get(name) or NODE_SHAPES[name]
        m0, m1 = entry.m0, entry.m1
        m1 = None if m1 is None else m1[rows]
        for axis, size in zip((-2, -1), shape, strict=True):
            if isinstance(size, str):
                entries = _ENTRIES[size](rows, sid.nq)
                m0 = np.take(m0, entries, axis)
                m1 = None if m1 is None else np.take(m1, entries, axis)
        return Taylor(m0, m1, order=entry.order)

    nodes = []
    for node in sid.nodes:
        entries: dict[str, Any] = {
            name: None if entry is None else cut(entry, name)
            for name in NODE_SHAPES
            for entry in [getattr(node, name)]
        }
        nodes.append(replace(node, **entries))
    blocks: dict[str, Any] = {name: cut(b, name) for name, b in sid.blocks.items()}
    labels = tuple(sid.labels[k] for k in selected)
    sections = tuple(
        replace(
            section,
            part=select_shape_functions(
                section.part, [*selected, *range(sid.nq, section.part.nq)]
            ),
        )
        for section in sid.sections
    )
    small = replace(
        sid, labels=labels, nodes=tuple(nodes), extra={}, sections=sections, **blocks
    )
    return replace(small, carried=remaining_compliance_shares(sid, small))
