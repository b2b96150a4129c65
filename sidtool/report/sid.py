"""Description of a SID: modes, frame, mass properties, dialect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_matrix

from sidtool.formats.base.sid import DIRECTIONS, SID, Array
from sidtool.formats.base.stress import stress_nodes
from sidtool.formats.diagnostics.entry import per_cent
from sidtool.formats.geometric_stiffening import has_stiffening
from sidtool.formats.motion_kinds import (
    ROTATION_ARM_SHARE,
    ZERO_MOTION_TOLERANCE,
    dead_nodes,
    kind_of_shape,
    long_axis,
    motion_scale,
    node_extent,
)
from sidtool.formats.text import counted_noun, fit_on_screen

from ..eigensolvers.eigenpairs import equal_frequencies, rotation_to_axes
from ..validate.frequencies import held_modes, to_hertz
from .diagnostics import severity_counts
from .tables import (
    format_numbers,
    label_without_frequency,
    named_values,
    text_table,
    title_line,
)

if TYPE_CHECKING:
    from sidtool.formats.model import ModelFile

    from ..pipeline.model_to_sid import ConvertedModel

#: Largest missing share of the compliance that counts as none.
_COMPLETE = 5e-4
#: Number of frequencies in the summary of a conversion.
_LISTED_FREQUENCIES = 5


#: Largest numbers of modes and of nodes in a description.
MAX_MODES, MAX_NODES = 12, 8


def describe_sid(sid: SID, verbose: bool = False) -> str:
    """Describe a SID by lines and tables.

    verbose : all modes and nodes
    """
    overview, modes = _overview_lines(sid), natural_modes(sid)
    rows = [_mode_row(number, mode, sid) for number, mode in enumerate(modes, 1)]
    header = ["mode", "Hz", "kind", "m_eff x %", "y %", "z %", "share %", "label"]
    nodes = _node_rows(sid)

    def description(most: int | None) -> str:
        parts = [overview]
        parts += [text_table(header, rows, most)] if rows else []
        fewer = None if most is None else min(most, MAX_NODES)
        parts += (
            [text_table(["node", "x", "y", "z", ""], nodes, fewer)] if nodes else []
        )
        return "\n\n".join(parts)

    return fit_on_screen(description, MAX_MODES, verbose)


def describe_conversion(
    sid: SID,
    seconds: float,
    files: Sequence[str],
    model: ModelFile | None = None,
    converted: ConvertedModel | None = None,
) -> str:
    """Return the cost of a conversion, its body, shape functions, errors and files.

    Parameters
    ----------
    seconds : duration
    files : what was written, with sizes
    model, converted : of which the SID was made, if not of another SID
    """
    functions = counted_noun(sid.nq, "shape function")
    mass, entries = f"mass {sid.mass:.4g}", []
    if model is not None and converted is not None:
        mass = f"{sid.mass:.4g} kg"
        functions += f" ({model.reduction.method})"
        unknowns = counted_noun(converted.degrees_of_freedom, "degree of freedom")
        entries.append(("mesh", unknowns))
    nodes = counted_noun(len(sid.nodes), "node")
    entries.append(("body", f"{mass}, {nodes}, {frame_kind_of(sid)}"))
    if sid.nq:
        entries.append(("basis", f"{functions}, {_frequency_text(sid)}"))
    entries += [("accuracy", d.line) for d in sid.diagnostics if d.code == "N160"]
    entries.append(("diagnostics", severity_counts(sid.diagnostics)))
    entries.append(("files", ", ".join(files)))
    title = title_line(sid.title, f"finished in {seconds:.1f} s")
    return f"{title}\n{named_values(entries)}"


def _frequency_text(sid: SID) -> str:
    """First and last frequencies of the shape functions."""
    texts = [f"{mode.frequency:.6g}" for mode in natural_modes(sid)]
    if len(texts) > _LISTED_FREQUENCIES:
        texts = [*texts[: _LISTED_FREQUENCIES - 1], "...", texts[-1]]
    return f"{', '.join(texts)} Hz"


def _overview_lines(sid: SID) -> str:
    centre = sid.mdCM.m0[:, 0] / sid.mass if sid.mass else np.zeros(3)
    orders = [
        f"{name} {block.order}"
        for name, block in sid.blocks.items()
        if block.m1 is not None
    ]
    dialect = sid.dialect
    entries = [
        ("title", sid.title or "(none)"),
        (
            "size",
            f"{counted_noun(len(sid.nodes), 'node')}, {counted_noun(sid.nq, 'mode')}",
        ),
        ("mass", f"{sid.mass:.10g}"),
        ("centre of mass", format_numbers(centre, _body_reach(sid), " ")),
        (
            "inertia (origin)",
            format_numbers(sid.J.m0[:, 0], between=" ") + "  (xx yy zz xy xz yz)",
        ),
        ("frame", frame_kind_of(sid)),
        *([("boundary", f"of the modes: {boundary_kind(sid)}")] if sid.nq else []),
        ("first-order terms", ", ".join(orders) or "none"),
        *_capability_text(sid),
        (
            "written by",
            f"{_writer_text(sid)}: Gr {dialect.gr_layout}-major, Ge "
            f"{dialect.ge_layout}-major, m1 {dialect.m1_index}, J {dialect.j_shape}",
        ),
        *((each.severity, each.line) for each in sid.diagnostics),
    ]
    return named_values(entries)


def _capability_text(sid: SID) -> list[tuple[str, str]]:
    """Describe the capabilities of a SID: linear deformation, stiffening, stresses."""
    if sid.nq == 0:
        return []
    lacks = "not carried; a simulation shows whether it matters"
    stressed = stress_nodes(sid)
    quadratic = sid.Ke.first_order(sid.nq).any()
    return [
        ("elastic forces", "quadratic in q (Ke m1)" if quadratic else "linear"),
        ("geom. stiffening", "carried" if has_stiffening(sid) else lacks),
        ("static compliance", _compliance_text(sid)),
        (
            "stress",
            f"at {counted_noun(len(stressed), 'node')}" if stressed else "not given",
        ),
        *([("section forces", _section_text(sid))] if sid.sections else []),
    ]


def _section_text(sid: SID) -> str:
    names = [section.name for section in sid.sections]
    listed = names if len(names) < 6 else [*names[:2], "...", names[-1]]
    return f"N, Vy, Vz, T, My, Mz at {', '.join(listed)}"


def _writer_text(sid: SID) -> str:
    """Return the program that wrote the file, and the program that the body
    came from.
    """
    by, first = sid.written_by, sid.dialect.writer
    if not by or first.startswith(by):
        return first
    return by if first.startswith("sidtool") else f"{by} (the body by {first})"


def _compliance_text(sid: SID) -> str:
    """Describe the shares of the static compliance that the shape functions
    represent.
    """
    if sid.carried is None:
        return "the file does not state what is missing"
    texts = [
        (share, f"{'along' if len(way) == 1 else 'about'} {way[-1]}", node)
        for node, row in sid.carried.shares.items()
        for way, share in zip(DIRECTIONS, row, strict=True)
        if share is not None
    ]
    if not texts:
        return "not known at any node"
    least, way, node = min(texts)
    if 1.0 - least < _COMPLETE:
        return "complete at all nodes"
    missing = per_cent(1.0 - least, ".2g")
    return f"up to {missing} % missing ({way} at node {node})"


def _mode_row(number: int, mode: NaturalMode, sid: SID) -> list[str]:
    shares = 100 * mode.effective_mass / (sid.mass or 1.0)
    return [
        str(number),
        f"{mode.frequency:.4f}",
        mode.kind,
        *(f"{share:.2f}" for share in shares),
        f"{100 * mode.contribution:.2f}",
        label_without_frequency(mode.label, mode.frequency),
    ]


def _node_rows(sid: SID) -> list[list[str]]:
    """Name, position and remark of each node."""
    dead = dead_nodes(sid)
    size = _body_reach(sid)
    return [
        [
            node.id,
            *format_numbers(node.position, size, " ").split(),
            _node_note(node, sid, dead),
        ]
        for node in sid.nodes
    ]


def _body_reach(sid: SID) -> float:
    """Return the extent of the body from its frame, by nodes and radii of
    inertia [m].
    """
    places = [np.abs(node.position).max() for node in sid.nodes]
    spread = np.abs(sid.J.m0).max() / sid.mass if sid.mass > 0 else 0.0
    return float(max([*places, np.sqrt(spread)]))


def _node_note(node: Any, sid: SID, dead: tuple[str, ...]) -> str:
    if node.id in dead:
        return "no shape function moves it"
    return "rests in the frame" if sid.nq and is_at_rest(node, sid) else ""


@dataclass(frozen=True)
class NaturalMode:
    """One natural mode of the body with its frame held.

    Attributes
    ----------
    frequency : [Hz]
    kind : "bending y", "axial x", "torsion x", ...
    effective_mass : (3,) effective modal mass along x, y, z [kg]
    boundary : boundary condition of the mode: "held", "chord", "free" (mean axes),
        "other"
    contribution : share of the mode in the static compliance of all nodes
    label : label of the elastic coordinate, if the mode consists of one
    """

    frequency: float
    kind: str
    effective_mass: Array
    boundary: str
    contribution: float
    label: str


def natural_modes(sid: SID) -> tuple[NaturalMode, ...]:
    """Return the natural modes of (Ke, Me), lowest first; empty for a rigid body.

    The effective mass of mode y is (Ct^T y)^2 / (y^T Me y), by axis. Of equal
    frequencies, the modes are those along the axes, x before y before z.
    """
    if sid.nq == 0:
        return ()
    squares, shapes = _mode_matrix(sid)
    axis = long_axis(sid)
    boundary = boundary_kind(sid)
    shares = _compliance_shares(sid, squares, shapes)
    modes = []
    for square, shape, share in zip(squares, shapes.T, shares, strict=True):
        modal_mass = float(shape @ sid.Me.m0 @ shape)
        coupling = shape @ sid.Ct.m0
        modes.append(
            NaturalMode(
                frequency=float(to_hertz(np.array([square]))[0]),
                kind=kind_of_shape(sid, shape, axis),
                effective_mass=coupling**2 / modal_mass if modal_mass else coupling * 0,
                boundary=boundary,
                contribution=float(share),
                label=_mode_label(sid, shape),
            )
        )
    return tuple(modes)


def frame_kind_of(sid: SID) -> str:
    """Return the kind of body frame, judged by the couplings and the nodes."""
    if sid.nq == 0:
        return "rigid body"
    kind, nodes = _node_frame_kind(sid)
    return {
        "free": "mean axes (Buckens): no coupling to the rigid motion",
        "held": f"tangent frame, fixed to node {nodes} at its origin",
        "held away": f"fixed to node {nodes}, away from its origin",
        "chord": f"chord frame between nodes {nodes}",
        "other": "another frame: coupled, and no node rests in it",
    }[kind]


def boundary_kind(sid: SID) -> str:
    """Return the boundary condition of the modes: "held", "chord", "free" or
    "other".
    """
    return _node_frame_kind(sid)[0].split()[0]


def _node_frame_kind(sid: SID) -> tuple[str, str]:
    scale = np.sqrt(sid.mass * np.abs(np.diag(sid.Me.m0)).max()) or 1.0
    size = max((np.abs(node.position).max() for node in sid.nodes), default=0.0) or 1.0
    if (
        np.abs(sid.Ct.m0).max() <= 1e-6 * scale
        and np.abs(sid.Cr.m0).max() <= 1e-6 * scale * size
    ):
        return "free", ""
    fixed_nodes = [node for node in sid.nodes if is_at_rest(node, sid)]
    turning = [
        node
        for node in fixed_nodes
        if node.psi.m0.any() and not _is_unrotated(node, sid)
    ]
    held = [node for node in fixed_nodes if node not in turning]
    at_origin = [n for n in fixed_nodes if np.abs(n.position).max() <= 1e-9 * size]
    silent = not any(node.psi.m0.any() for node in sid.nodes)
    if at_origin and (at_origin[0] in turning or silent):
        end = _chord_end(sid, at_origin[0])
        if end is not None:
            return "chord", f"{at_origin[0].id} and {end}"
        if not silent:
            return "other", ""
    if at_origin:
        return "held", str(at_origin[0].id)
    if held:
        return "held away", str(held[0].id)
    return "other", ""


def _is_unrotated(node: Any, sid: SID) -> bool:
    scale = sid.largest_shapes[1]
    return bool(np.abs(node.psi.m0).max(initial=0.0) <= ZERO_MOTION_TOLERANCE * scale)


def _chord_end(sid: SID, start: Any) -> str | None:
    """Return the node whose direction from the origin does not change."""
    for node in sid.nodes:
        chord = node.position - start.position
        length = np.linalg.norm(chord)
        if length == 0:
            continue
        across = np.cross(chord / length, node.phi.m0.T)
        if np.abs(across).max() <= ZERO_MOTION_TOLERANCE * motion_scale(sid):
            return str(node.id)
    return None


def _compliance_shares(sid: SID, squares: Array, shapes: Array) -> Array:
    """Return (nq,) sums over nodes of phi^2 / w^2 as shares of the total. Rotations are
    multiplied by a part of the length of the body.
    """
    arm = ROTATION_ARM_SHARE * node_extent(sid)
    phi, psi = sid.shapes
    motion = ((phi @ shapes) ** 2).sum(axis=(0, 1))
    motion = motion + ((arm * psi @ shapes) ** 2).sum(axis=(0, 1))
    soft = motion / np.where(squares > 0, squares, np.inf)
    total = soft.sum()
    return soft / total if total else soft


def is_at_rest(node: Any, sid: SID) -> bool:
    """Return whether no shape function displaces a node."""
    return bool(
        np.abs(node.phi.m0).max(initial=0.0)
        <= ZERO_MOTION_TOLERANCE * motion_scale(sid)
    )


def _mode_matrix(sid: SID) -> tuple[Array, Array]:
    """Return modes in columns; the unit matrix if Me is not a mass matrix."""
    try:
        squares, shapes = held_modes(sid)
    except np.linalg.LinAlgError:
        masses = np.diag(sid.Me.m0)
        safe = np.where(masses > 0, masses, np.inf)
        return np.diag(sid.Ke.m0) / safe, np.eye(sid.nq)
    groups = equal_frequencies(squares, shapes, csr_matrix(sid.Ke.m0))
    motion = sid.shapes[0].reshape(-1, sid.nq) @ shapes
    directions = np.tile([1.0, 2.0, 3.0], len(sid.nodes))
    return squares, shapes @ rotation_to_axes(groups, motion, directions)


def _mode_label(sid: SID, shape: Array) -> str:
    leading = int(np.abs(shape).argmax())
    others = np.delete(np.abs(shape), leading)
    alone = others.max(initial=0.0) <= 1e-3 * abs(shape[leading])
    return " ".join(sid.labels[leading].split()) if alone else ""
