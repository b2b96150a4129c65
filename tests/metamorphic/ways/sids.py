"""The same flexible body: in other axes, in other elastic coordinates, elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.base.sid import (
    J_INDICES,
    OE_INDICES,
    SID,
    Array,
    Node,
    Taylor,
    axis_major,
    by_mode,
    symmetric_3x3,
)


def _mapped(term: Taylor, change) -> Taylor:  # type: ignore[no-untyped-def]
    return Taylor(change(term.m0), None if term.m1 is None else change(term.m1))


def in_axes(sid: SID, Q: Array) -> SID:
    """The body with its frame's axes turned, or mirrored: components are Q times."""
    det = float(np.linalg.det(Q))
    nq = sid.nq

    def vectors(rows: Array, sign: float = 1.0) -> Array:
        return sign * rows @ Q.T

    def columns(m: Array, sign: float = 1.0) -> Array:
        return sign * np.einsum("ab,...bc->...ac", Q, m)

    def tensor(m: Array) -> Array:
        return np.asarray(Q @ m @ Q.T)

    def inertia(m: Array) -> Array:
        full = tensor(symmetric_3x3(m[..., 0]))
        return np.stack([full[..., a, b] for a, b in J_INDICES], axis=-1)[..., None]

    def gr(m: Array) -> Array:
        new = tensor(by_mode(m, nq))
        return np.moveaxis(new, -3, -1).reshape(m.shape)

    def ge(m: Array) -> Array:
        parts = m.reshape(*m.shape[:-1], 3, nq)
        return det * np.einsum("ab,...bl->...al", Q, parts).reshape(m.shape)

    def oe(m: Array) -> Array:
        form = np.zeros((*m.shape[:-1], 3, 3))
        for k, (a, b) in enumerate(OE_INDICES):
            form[..., a, b] += 0.5 * m[..., k]
            form[..., b, a] += 0.5 * m[..., k]
        new = tensor(form)
        return np.stack(
            [new[..., a, b] * (1.0 if a == b else 2.0) for a, b in OE_INDICES], axis=-1
        )

    def node(n: Node) -> Node:
        return replace(
            n,
            origin=_mapped(n.origin, columns),
            phi=_mapped(n.phi, columns),
            psi=_mapped(n.psi, lambda m: columns(m, det)),
            AP=_mapped(n.AP, tensor),
        )

    return replace(
        sid,
        nodes=tuple(node(n) for n in sid.nodes),
        mdCM=_mapped(sid.mdCM, columns),
        J=_mapped(sid.J, inertia),
        Ct=_mapped(sid.Ct, vectors),
        Cr=_mapped(sid.Cr, lambda m: vectors(m, det)),
        Gr=_mapped(sid.Gr, gr),
        Ge=_mapped(sid.Ge, ge),
        Oe=_mapped(sid.Oe, oe),
    )


def mixed(sid: SID, T: Array) -> SID:
    """The body in elastic coordinates q' with q = T q'."""

    def first(m1: Array | None) -> Array | None:
        return None if m1 is None else np.einsum("lk,l...->k...", T, m1)

    def body(term: Taylor) -> Taylor:
        return Taylor(term.m0, first(term.m1))

    def rows(term: Taylor) -> Taylor:
        m1 = first(term.m1)
        return Taylor(T.T @ term.m0, None if m1 is None else T.T @ m1)

    def both(term: Taylor) -> Taylor:
        m1 = first(term.m1)
        return Taylor(T.T @ term.m0 @ T, None if m1 is None else T.T @ m1 @ T)

    def columns(term: Taylor) -> Taylor:
        m1 = first(term.m1)
        return Taylor(term.m0 @ T, None if m1 is None else m1 @ T)

    def axes(m: Array) -> Array:
        return axis_major(np.einsum("lk,lab->kab", T, by_mode(m, sid.nq)))

    assert sid.Gr.m1 is None and sid.Ge.m1 is None
    nodes = tuple(
        replace(
            n,
            origin=body(n.origin),
            phi=columns(n.phi),
            psi=columns(n.psi),
            AP=body(n.AP),
        )
        for n in sid.nodes
    )
    return replace(
        sid,
        nodes=nodes,
        mdCM=body(sid.mdCM),
        J=body(sid.J),
        Ct=rows(sid.Ct),
        Cr=rows(sid.Cr),
        Me=both(sid.Me),
        Gr=Taylor(axes(sid.Gr.m0)),
        Ge=Taylor(axes(T.T @ sid.Ge.m0)),
        Oe=rows(sid.Oe),
        ksigma=rows(sid.ksigma),
        Ke=both(sid.Ke),
        De=both(sid.De),
    )
