"""Identities between the inertia blocks of one displacement field: I4 to I12.

Each holds because both sides are the same integral over the body; see O. Wallrapp,
"Standardization of flexible body modeling in multibody system codes, Part I", 1994.

Identities of the exported nodes and of the counts in the file: I1 to I3.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import eigvalsh

from sidtool.formats.base.sid import SID, Array, by_mode
from sidtool.formats.geometric_stiffening import (
    has_second_order_field,
    stiffens_by_turning,
)
from sidtool.formats.sid_mass import IN_PLANE, free_motion, plane_of_motion, skew

from .identity import (
    Finding,
    finding_of_difference,
    identity,
    modal_blocks,
    modal_scale,
    relative_difference,
    rotation_scale,
    translation_scale,
    transpose_modes,
)

#: Rounding of shares of the kinetic energy, and a small share.
_ROUNDING, _SMALL = 1e-6, 0.1


@identity("I1", bound=0.0)
def count_contradictions(sid: SID) -> Finding:
    """Number of counts that contradict the contents, as the reader noted them."""
    wrong = [each.message for each in sid.diagnostics if each.code == "N842"]
    detail = "; ".join(wrong) or f"{len(sid.nodes)} nodes, {sid.nq} modes"
    return Finding(float(len(wrong)), detail)


@identity("I2", bound=1e-11)
def origin_deviation(sid: SID) -> Finding:
    """Derivative of the node's position against its shape functions."""
    if not sid.nodes or sid.nq == 0:
        return Finding(None, "no shape functions at any node")
    first = np.stack([node.origin.first_order(sid.nq)[:, :, 0] for node in sid.nodes])
    shapes = np.stack([node.phi.m0.T for node in sid.nodes])
    difference = np.abs(first - shapes)
    worst = sid.nodes[int(difference.max(axis=(1, 2)).argmax())].id
    return finding_of_difference(
        difference, first, shapes, detail=f"largest at node {worst}"
    )


@identity("I3", bound=1e-11)
def rotation_deviation(sid: SID) -> Finding:
    """Derivative of the node's orientation against its rotational shape functions."""
    if not sid.nodes or sid.nq == 0:
        return Finding(None, "no shape functions at any node")
    first = np.stack([node.AP.first_order(sid.nq) for node in sid.nodes])
    turned = np.stack([skew(node.psi.m0.T) @ node.AP.m0 for node in sid.nodes])
    difference = np.abs(first - turned)
    worst = sid.nodes[int(difference.max(axis=(1, 2, 3)).argmax())].id
    return finding_of_difference(
        difference, first, turned, detail=f"largest at node {worst}"
    )


# A print of 12 digits is off by at most 5e-12 of the entry; two to four printed numbers
# meet in each identity below, so 1e-11 (2e-11 for the sum of four) is exact.


@identity("I4", bound=1e-11, of_shapes=True)
def first_moment_deviation(sid: SID) -> Finding:
    """Both are the integral of the shape functions over the mass."""
    first = sid.mdCM.first_order(sid.nq)[:, :, 0]
    return finding_of_difference(
        first - sid.Ct.m0, first, sid.Ct.m0, natural=translation_scale(sid)
    )


@identity("I5", bound=1e-11, of_shapes=True)
def centrifugal_deviation(sid: SID) -> Finding:
    """Note the order: Oe has yz before xz, J has xz before yz."""
    six = sid.J.first_order(sid.nq)[:, :, 0]
    implied = -six[:, [0, 1, 2, 3, 5, 4]] * [0.5, 0.5, 0.5, 1.0, 1.0, 1.0]
    exchanged = implied[:, [0, 1, 2, 3, 5, 4]]
    other = relative_difference(sid.Oe.m0 - exchanged, sid.Oe.m0, implied)
    detail = f"with yz and xz exchanged {other:.1e}"
    return finding_of_difference(
        sid.Oe.m0 - implied,
        sid.Oe.m0,
        implied,
        natural=rotation_scale(sid),
        detail=detail,
    )


@identity("I6", bound=2e-11, of_shapes=True)
def gyroscopic_rotation_deviation(sid: SID) -> Finding:
    """The symmetric part of Gr is the rate of the inertia tensor."""
    modes = modal_blocks(sid)
    layout = sid.dialect.gr_layout
    other = _gr_deviation(_other_layout(sid.Gr.m0, sid.nq, layout), modes.J1)
    difference = modes.Gr + modes.Gr.swapaxes(1, 2) - 2.0 * modes.J1
    return finding_of_difference(
        difference,
        modes.Gr,
        2.0 * modes.J1,
        natural=rotation_scale(sid),
        bound=2e-11,
        terms=4,
        detail=_layout_in_words(layout, other, sid.nq),
    )


@identity("I7", bound=1e-11, of_shapes=True)
def gyroscopic_elastic_deviation(sid: SID) -> Finding:
    """The second form is the exact one; it alone allows for geometric stiffening.

    The symmetric part that stiffening adds to Cr1 leaves its rounding in the second.
    """
    modes = modal_blocks(sid)
    layout = sid.dialect.ge_layout
    deviation, form = min(_ge_deviations(modes.Ge, modes.Cr1))
    other = min(_ge_deviations(_other_layout(sid.Ge.m0, sid.nq, layout), modes.Cr1))
    detail = f"Ge = {form}; {_layout_in_words(layout, other[0], sid.nq)}"
    if deviation <= 1e-11:
        return Finding(deviation, detail)
    forms = {
        "2 Cr1": 2.0 * modes.Cr1,
        "Cr1 - Cr1^T": modes.Cr1 - transpose_modes(modes.Cr1),
    }
    return finding_of_difference(
        modes.Ge - forms[form],
        modes.Ge,
        modes.Cr1,
        natural=modal_scale(sid),
        detail=detail,
        terms=3,
    )


@identity("I8", bound=1e-11, of_shapes=True)
def gyroscopic_exact_deviation(sid: SID) -> Finding:
    """Holds with and without geometric stiffening."""
    modes = modal_blocks(sid)
    exact = modes.Cr1 - transpose_modes(modes.Cr1)
    sizes = (modes.Ge, modes.Cr1)
    return finding_of_difference(
        modes.Ge - exact, *sizes, natural=modal_scale(sid), terms=3
    )


@identity("I9", bound=1e-11, of_shapes=True)
def rotation_coupling_deviation(sid: SID) -> Finding:
    """The symmetric part, if any, is stiffening by angular acceleration (K0r)."""
    Cr1 = modal_blocks(sid).Cr1
    if has_second_order_field(sid) or stiffens_by_turning(sid):
        share = relative_difference(Cr1 + transpose_modes(Cr1), Cr1)
        return Finding(
            None, f"the symmetric part ({share:.1e}) is geometric stiffening"
        )
    return finding_of_difference(
        Cr1 + transpose_modes(Cr1), Cr1, natural=modal_scale(sid)
    )


@identity("I10", bound=0.1, of_shapes=True)
def gyroscopic_antisymmetry(sid: SID) -> Finding:
    """Writers that lump the mass for Gr are off by some per cent: hence the bound."""
    axis = _is_planar(sid)
    if axis is not None:
        return Finding(
            None, f"planar data: entries across {'xyz'[axis]} are not written"
        )
    modes = modal_blocks(sid)
    antisymmetric = 0.5 * (modes.Gr - modes.Gr.swapaxes(1, 2))
    lever = skew(sid.Cr.m0)
    return finding_of_difference(
        antisymmetric + lever, modes.Gr, lever, natural=rotation_scale(sid), bound=0.1
    )


@identity("I11", bound=1e-9, of_shapes=True)
def centrifugal_symmetry(sid: SID) -> Finding:
    """PY_SID stores only one of the two products in the columns xy, yz and xz."""
    Oe1 = modal_blocks(sid).Oe1
    parts = {"xx, yy, zz": Oe1[..., :3], "xy, yz, xz": Oe1[..., 3:]}
    residuals = [
        (
            finding_of_difference(
                part - transpose_modes(part), part, natural=modal_scale(sid), bound=1e-9
            ),
            k,
        )
        for k, part in parts.items()
    ]
    shares = "; ".join(f"{name} {finding.measured:.1e}" for finding, name in residuals)
    worst = max((finding for finding, _ in residuals), key=lambda f: f.measured or 0.0)
    return replace(worst, detail=shares)


@identity("I12", bound=0.1, of_shapes=True)
def centrifugal_trace(sid: SID) -> Finding:
    """Exact for solids; lumped and beam masses are off, see the bound of I10."""
    if has_second_order_field(sid):
        return Finding(None, "Oe m1 holds geometric stiffening")
    trace = modal_blocks(sid).Oe1[..., :3].sum(axis=2)
    if sid.dialect.writer.startswith("sidtool") and _is_rotary_inertia(sid, trace):
        return Finding(None, "Me holds the rotary inertia of beams or shells")
    return finding_of_difference(
        trace + 2.0 * sid.Me.m0, trace, 2.0 * sid.Me.m0, bound=0.1
    )


def _is_rotary_inertia(sid: SID, trace: Array) -> bool:
    """Whether I12 misses rotary inertia, which keeps its trace as sections turn.

    Its shares of Me are those of kinetic energies, 0 to 1: of bending near 0, of
    torsion near 1. Of a wrong Me none is near 0.
    """
    missing = 2.0 * sid.Me.m0 + 0.5 * (trace + trace.T)
    try:
        shares = eigvalsh(missing, sid.Me.m0 + sid.Me.m0.T)
    except np.linalg.LinAlgError:
        return False
    inside = shares[0] > -_ROUNDING and shares[-1] < 1.0 + _ROUNDING
    least = shares[0] < _SMALL or shares[0] > 1.0 - _SMALL
    return bool(inside and least and shares[-1] > _SMALL)


def _is_planar(sid: SID) -> int | None:
    axis = plane_of_motion(sid)
    if axis is None or free_motion(sid).possible:
        return None
    return axis if free_motion(sid, IN_PLANE[axis]).possible else None


def _gr_deviation(Gr: Array, J1: Array) -> float:
    return relative_difference(Gr + Gr.swapaxes(1, 2) - 2.0 * J1, 2.0 * J1, Gr)


def _ge_deviations(Ge: Array, Cr1: Array) -> list[tuple[float, str]]:
    exact = Cr1 - transpose_modes(Cr1)
    return [
        (relative_difference(Ge - 2.0 * Cr1, Ge, 2.0 * Cr1), "2 Cr1"),
        (relative_difference(Ge - exact, Ge, exact), "Cr1 - Cr1^T"),
    ]


def _other_layout(columns: Array, nq: int, layout: str) -> Array:
    """The file's columns read the other way, (nq, rows, 3)."""
    rows = len(columns)
    per_mode = by_mode(columns, nq)
    if layout == "axis":
        return np.moveaxis(columns.reshape(rows, nq, 3), 1, 0)
    return by_mode(np.moveaxis(per_mode, 0, 1).reshape(rows, 3 * nq), nq)


def _layout_in_words(layout: str, other: float, nq: int) -> str:
    if nq == 1:
        return "one mode, both column layouts agree"
    return f"file is {layout}-major; the other layout would give {other:.1e}"
