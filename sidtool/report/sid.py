"""What is in a SID, as a person would ask: modes, frame, masses, dialect."""

from __future__ import annotations

from typing import Any

import numpy as np

from sidtool.formats.carried import DIRECTIONS
from sidtool.formats.dead_nodes import dead_nodes
from sidtool.formats.sid import SID
from sidtool.formats.stiffening import has_stiffening
from sidtool.formats.stress import stress_nodes

from .modes import Mode, at_rest, frame_of, modes_of
from .tables import listed, named, plural, table


def describe_sid(sid: SID) -> str:
    """Several lines and tables about a SID."""
    parts = [_overview(sid)]
    modes = modes_of(sid)
    if modes:
        rows = [_mode_row(number, mode, sid) for number, mode in enumerate(modes, 1)]
        header = ["mode", "Hz", "kind", "boundary", "m_eff x %", "y %", "z %"]
        header += ["share %", "label"]
        parts.append(table(header, rows))
    if sid.nodes:
        parts.append(_nodes(sid))
    return "\n\n".join(parts)


def _overview(sid: SID) -> str:
    centre = sid.mdCM.m0[:, 0] / sid.mass if sid.mass else np.zeros(3)
    orders = [
        f"{name} {block.order}"
        for name, block in sid.blocks.items()
        if block.m1 is not None
    ]
    dialect = sid.dialect
    entries = [
        ("title", sid.title or "(none)"),
        ("size", f"{plural(len(sid.nodes), 'node')}, {plural(sid.nq, 'mode')}"),
        ("mass", f"{sid.mass:.10g}"),
        ("centre of mass", listed(centre, _size(sid), " ")),
        (
            "inertia (origin)",
            listed(sid.J.m0[:, 0], between=" ") + "  (xx yy zz xy xz yz)",
        ),
        ("frame", frame_of(sid)),
        ("first-order terms", ", ".join(orders) or "none"),
        *_abilities(sid),
        (
            "written by",
            f"{_writer(sid)}: Gr {dialect.gr_layout}-major, Ge "
            f"{dialect.ge_layout}-major, m1 {dialect.m1_index}, J {dialect.j_shape}",
        ),
        *(("note", note) for note in dialect.notes),
    ]
    return named(entries)


def _abilities(sid: SID) -> list[tuple[str, str]]:
    """Does it deform linearly, stiffen under loads, and tell stresses?"""
    if sid.nq == 0:
        return []
    lacks = "not carried; a simulation tells whether it matters"
    stressed = stress_nodes(sid)
    quadratic = sid.Ke.first_order(sid.nq).any()
    return [
        ("elastic forces", "quadratic in q (Ke m1)" if quadratic else "linear"),
        ("geom. stiffening", "carried" if has_stiffening(sid) else lacks),
        ("carried", _carried(sid)),
        ("stress", f"at {plural(len(stressed), 'node')}" if stressed else "not told"),
    ]


def _writer(sid: SID) -> str:
    """The program that wrote the file, and of which program it had the body."""
    by, first = sid.written_by, sid.dialect.writer
    if not by or first.startswith(by):
        return first
    return by if first.startswith("sidtool") else f"{by} (the body by {first})"


def _carried(sid: SID) -> str:
    """What the shape functions have of the static compliance of the full body."""
    if sid.carried is None:
        return "which part of the static compliance, the file does not tell"
    told = [
        (share, f"{'along' if len(way) == 1 else 'about'} {way[-1]}", node)
        for node, row in sid.carried.shares.items()
        for way, share in zip(DIRECTIONS, row, strict=True)
        if share is not None
    ]
    if not told:
        return "of no node told"
    least, way, node = min(told)
    return (
        f"of the static compliance at least {100 * least:.0f} % ({way} at node {node})"
    )


def _mode_row(number: int, mode: Mode, sid: SID) -> list[str]:
    shares = 100 * mode.effective_mass / (sid.mass or 1.0)
    return [
        str(number),
        f"{mode.frequency:.4f}",
        mode.kind,
        mode.boundary,
        *(f"{share:.2f}" for share in shares),
        f"{100 * mode.contribution:.2f}",
        mode.label,
    ]


def _nodes(sid: SID, most: int = 12) -> str:
    dead = dead_nodes(sid)
    size = _size(sid)
    rows = [
        [
            node.id,
            *listed(node.position, size, " ").split(),
            _node_note(node, sid, dead),
        ]
        for node in sid.nodes[:most]
    ]
    text = table(["node", "x", "y", "z", ""], rows)
    more = len(sid.nodes) - most
    return f"{text}\n... and {more} more" if more > 0 else text


def _size(sid: SID) -> float:
    """How far the body reaches from its frame: its nodes, its radii of inertia [m]."""
    places = [np.abs(node.position).max() for node in sid.nodes]
    spread = np.abs(sid.J.m0).max() / sid.mass if sid.mass > 0 else 0.0
    return float(max([*places, np.sqrt(spread)]))


def _node_note(node: Any, sid: SID, dead: tuple[str, ...]) -> str:
    if node.id in dead:
        return "no shape function moves it"
    return "rests in the frame" if sid.nq and at_rest(node, sid) else ""
