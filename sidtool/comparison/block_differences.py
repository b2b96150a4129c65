"""Rows of a comparison, and every block of two SIDs in the basis of the reference.

The elastic coordinates of one are those of the other times a matrix T: natural modes of
both, normalised to unit mass, differ by signs, and for close frequencies by a rotation.
It follows from the shape functions at the nodes and the couplings to the rigid motion
(orthogonal Procrustes problem).

Comparison of two SIDs of one body, independent of the basis of their modes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    BLOCK_SHAPES,
    J_INDICES,
    NODE_SHAPES,
    SID,
    Array,
    Node,
    Taylor,
)
from sidtool.formats.sid_mass import central_inertia, centre_of_mass

from ..conversion.frame_change import FrameChange, apply_frame_change
from ..validate.basis_change import change_basis
from ..validate.body_modes import (
    ModalBody,
    Pairing,
    body_size,
    free_body,
    held_body,
    modal_assurance,
    pair_sids,
    subspace_assurance,
)
from ..validate.frequencies import held_modes, to_hertz
from ..validate.identity import (
    max_magnitude,
    modal_scale,
    rotation_scale,
    translation_scale,
)

Outcome = Literal["passed", "failed", "shown"]

#: Entries below this fraction of the natural size of a block, and deflections below
#: this fraction of the largest, are rounding.
_ROUNDING_SHARE = 1e-9
#: Natural modes this close in frequency may mix; they are compared as one subspace.
_CLOSE_FREQUENCIES = 1e-3
BLOCK_GROUP = "blocks, in the basis of the reference"
_MAX_MARKERS = 4
#: Differences of the MAC below this do not decide which modes belong together.
_EQUAL_ASSURANCE = 1e-3


@dataclass(frozen=True)
class ComparisonRow:
    """One number and its reference.

    Attributes
    ----------
    group : kind of quantity, e.g. "frequencies, frame held [Hz]"
    quantity : which one
    value, reference : number of the SID and of the reference
    deviation : relative; its basis depends on the group
    tolerance : accepted magnitude of the deviation; None if the row is only printed
    source : source of the reference
    """

    group: str
    quantity: str
    value: float
    reference: float
    deviation: float
    tolerance: float | None = None
    source: str = ""

    @property
    def verdict(self) -> Outcome:
        """Passed or failed where a tolerance is given, else only shown."""
        if self.tolerance is None:
            return "shown"
        return "passed" if abs(self.deviation) <= self.tolerance else "failed"


@dataclass(frozen=True)
class Comparison:
    """All rows of a comparison, and notes on what could not be compared and why."""

    rows: tuple[ComparisonRow, ...]
    notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """True when no judged row failed."""
        return not any(row.verdict == "failed" for row in self.rows)

    def group(self, start: str) -> tuple[ComparisonRow, ...]:
        """The rows of all groups whose name starts so."""
        return tuple(row for row in self.rows if row.group.startswith(start))


def block_rows(
    here: SID, reference: SID, common: Pairing, notes: list[str]
) -> Iterator[ComparisonRow]:
    """Compare the largest entry of each term with that of the reference."""
    if not common.held:
        return
    if here.nq != reference.nq:
        notes.append(
            f"{here.nq} and {reference.nq} shape functions: the blocks, also those of "
            "first order, are not compared"
        )
        return
    if common.offset.any():
        none = np.zeros((here.nq, 3))
        here = apply_frame_change(here, FrameChange(-common.offset, none, none))
    numbers = {node.id: i for i, node in enumerate(here.nodes)}
    others = {node.id: i for i, node in enumerate(reference.nodes)}
    first = [numbers[node.id] for node, _ in common.nodes]
    second = [others[node.id] for _, node in common.nodes]
    try:
        T = _basis_transformation(here, reference, first, second)
    except np.linalg.LinAlgError:
        return
    transformed = change_basis(replace(here, extra={}), T, reference.labels)
    sizes = {
        **dict.fromkeys(("mdCM", "Ct"), translation_scale(reference)),
        **dict.fromkeys(("J", "Cr", "Gr"), rotation_scale(reference)),
        **dict.fromkeys(("Me", "Ge", "Oe"), modal_scale(reference)),
    }
    for name in BLOCK_SHAPES:
        yield from _term_rows(
            name,
            getattr(transformed, name),
            getattr(reference, name),
            sizes.get(name, 0.0),
        )
    for name in NODE_SHAPES:
        block, reference_block = (
            _stack_nodes(transformed, name, first),
            _stack_nodes(reference, name, second),
        )
        if block is not None and reference_block is not None:
            yield from _term_rows(name, block, reference_block, 0.0)
        elif block is not reference_block:
            notes.append(f"only one of the bodies has {name}: it is not compared")


def _term_rows(
    name: str, block: Taylor, reference_block: Taylor, natural: float
) -> Iterator[ComparisonRow]:
    for part in ("m0", "m1"):
        value, expected = getattr(block, part), getattr(reference_block, part)
        if value is None and expected is None:
            continue
        value = np.zeros_like(expected) if value is None else value
        expected = np.zeros_like(value) if expected is None else expected
        size = max(max_magnitude(expected), _ROUNDING_SHARE * natural)
        if size == 0.0 and not value.any():
            continue
        difference = max_magnitude(value - expected)
        share = difference / size if size else 1.0
        yield ComparisonRow(
            BLOCK_GROUP,
            f"{name} {part}",
            max_magnitude(value),
            max_magnitude(expected),
            share,
        )


def _basis_transformation(
    here: SID, reference: SID, first: list[int], second: list[int]
) -> Array:
    """T, (nq, nq): q here = T q of the reference."""
    squares, modes = held_modes(reference)
    _, own = held_modes(here)
    signatures = (
        _mode_signature(here, first) @ own,
        _mode_signature(reference, second) @ modes,
    )
    parts = []
    frequencies = np.sqrt(np.clip(squares, 0.0, None))
    starts = np.flatnonzero(
        np.diff(frequencies, prepend=-np.inf) > _CLOSE_FREQUENCIES * frequencies
    )
    for chosen in np.split(np.arange(len(squares)), starts[1:]):
        left, _, right = np.linalg.svd(
            signatures[0][:, chosen].T @ signatures[1][:, chosen]
        )
        parts.append(left @ right)
    return np.asarray(own @ block_diag(*parts) @ np.linalg.inv(modes))


def _mode_signature(sid: SID, nodes: list[int]) -> Array:
    """Return rows that distinguish natural modes: motion of the nodes, couplings."""
    phi, psi = (shapes[nodes].reshape(-1, sid.nq) for shapes in sid.shapes)
    first = sid.J.first_order(sid.nq)[:, :, 0].T
    mass, inertia = abs(sid.mass) or 1.0, max_magnitude(sid.J.m0) or 1.0
    length = np.sqrt(inertia / mass)
    root = np.sqrt(mass)
    rows = [phi * root, psi * root * length, sid.Ct.m0.T / root]
    rows += [sid.Cr.m0.T / np.sqrt(inertia), first / np.sqrt(inertia)]
    return np.vstack(rows)


def _stack_nodes(sid: SID, name: str, nodes: list[int]) -> Taylor | None:
    """Return the entries of several nodes as one expansion; None if one has no
    entry.
    """
    entries = [getattr(sid.nodes[i], name) for i in nodes]
    if not entries or any(entry is None for entry in entries):
        return None
    m1 = None
    if any(entry.m1 is not None for entry in entries):
        m1 = np.concatenate([entry.first_order(sid.nq) for entry in entries], axis=1)
    return Taylor(np.vstack([entry.m0 for entry in entries]), m1)


def compare_sids(
    here: SID,
    reference: SID,
    tolerance: float | None,
    markers: Sequence[str] | None,
) -> Comparison:
    """Mass properties, then frequencies, deflections, responses and shapes."""
    common = pair_sids(here, reference)
    rows = list(_mass_rows(here, reference, common))
    notes = list(common.notes)
    if here.nq and reference.nq:
        loaded = _loaded_nodes(common, markers)
        if 0 < 3 * len(common.nodes) < max(here.nq, reference.nq):
            notes.append("fewer common points than modes: the MAC cannot separate them")
        for support, first, second in _support_cases(here, reference, common, notes):
            rows += _frequency_rows(support, first, second)
            rows += _static_rows(support, first, second, loaded, common, notes)
            rows += _response_rows(support, first, second, loaded, common)
            rows += _shape_rows(support, first, second, common, notes)
        rows += block_rows(here, reference, common, notes)
    elif here.nq or reference.nq:
        notes.append("one of the bodies is rigid: only mass properties are compared")
    return Comparison(
        tuple(_judge_row(row, tolerance) for row in rows), tuple(dict.fromkeys(notes))
    )


def _judge_row(row: ComparisonRow, tolerance: float | None) -> ComparisonRow:
    return ComparisonRow(
        row.group, row.quantity, row.value, row.reference, row.deviation, tolerance
    )


def _support_cases(
    here: SID, reference: SID, common: Pairing, notes: list[str]
) -> Iterator[tuple[str, ModalBody, ModalBody]]:
    first = [node for node, _ in common.nodes]
    second = [node for _, node in common.nodes]
    if common.held:
        try:
            yield "frame held", held_body(here, first), held_body(reference, second)
        except np.linalg.LinAlgError:
            notes.append("a modal mass matrix is not positive definite")
    if common.rigid is not None:
        yield (
            "free body",
            free_body(here, first, common.rigid),
            free_body(reference, second, common.rigid),
        )


def _mass_rows(here: SID, reference: SID, common: Pairing) -> Iterator[ComparisonRow]:
    group = "mass properties"
    yield ComparisonRow(
        group,
        "mass",
        here.mass,
        reference.mass,
        _relative_difference(here.mass - reference.mass, reference.mass),
    )
    if not (here.mass > 0.0 and reference.mass > 0.0):
        return
    size = body_size(reference)
    centres = centre_of_mass(here) + common.offset, centre_of_mass(reference)
    for axis, name in enumerate("xyz"):
        value, expected = float(centres[0][axis]), float(centres[1][axis])
        deviation = _relative_difference(value - expected, size)
        yield ComparisonRow(group, f"centre of mass {name}", value, expected, deviation)
    tensors = central_inertia(here), central_inertia(reference)
    scale = max_magnitude(tensors[1])
    for row, column in J_INDICES:
        value, expected = float(tensors[0][row, column]), float(tensors[1][row, column])
        name = f"central inertia {'xyz'[row]}{'xyz'[column]}"
        yield ComparisonRow(
            group, name, value, expected, _relative_difference(value - expected, scale)
        )


def _frequency_rows(
    support: str, first: ModalBody, second: ModalBody
) -> Iterator[ComparisonRow]:
    pairs = zip(to_hertz(first.squares), to_hertz(second.squares), strict=False)
    for number, (value, expected) in enumerate(pairs, 1):
        yield ComparisonRow(
            f"frequencies, {support} [Hz]",
            f"f{number}",
            float(value),
            float(expected),
            _relative_difference(value - expected, expected),
        )


def _static_rows(
    support: str,
    first: ModalBody,
    second: ModalBody,
    loaded: list[int],
    common: Pairing,
    notes: list[str],
) -> Iterator[ComparisonRow]:
    """Deflection in the direction of a unit force; the deviation is over all nodes."""
    if not (first.has_stiffness and second.has_stiffness):
        notes.append(f"{support}: Ke is singular, there is no static deflection")
        return
    loads = [3 * k + axis for k in loaded for axis in range(3)]
    values, references = first.flexibility(loads), second.flexibility(loads)
    most = second.most_flexible()
    for k, nine, all_nine in zip(
        loaded,
        np.split(values, max(len(loaded), 1), axis=1),
        np.split(references, max(len(loaded), 1), axis=1),
        strict=False,
    ):
        for axis in range(3):
            value, expected = nine[:, axis], all_nine[:, axis]
            if max_magnitude(expected) <= _ROUNDING_SHARE * most:
                continue
            load = 3 * k + axis
            yield ComparisonRow(
                f"static deflection, {support} [length/force]",
                f"node {common.nodes[k][0].id}, unit force along {'xyz'[axis]}",
                float(value[load]),
                float(expected[load]),
                _relative_difference(
                    max_magnitude(value - expected), max_magnitude(expected)
                ),
            )


def _response_rows(
    support: str,
    first: ModalBody,
    second: ModalBody,
    loaded: list[int],
    common: Pairing,
) -> Iterator[ComparisonRow]:
    """Norm of the 3 x 3 receptance of a node; the deviation takes phase along."""
    if not second.has_stiffness:
        return
    for omega in _probe_frequencies(second.squares):
        most = second.receptance_size(omega)
        for k in loaded:
            at = slice(3 * k, 3 * k + 3)
            value, expected = first.receptance(omega, at), second.receptance(omega, at)
            size = float(np.linalg.norm(expected))
            if size <= _ROUNDING_SHARE * most:
                continue
            difference = float(np.linalg.norm(value - expected))
            yield ComparisonRow(
                f"frequency response, {support} [length/force]",
                f"node {common.nodes[k][0].id} at {omega / (2 * np.pi):.5g} Hz",
                float(np.linalg.norm(value)),
                size,
                _relative_difference(difference, size),
            )


def _shape_rows(
    support: str,
    first: ModalBody,
    second: ModalBody,
    common: Pairing,
    notes: list[str],
) -> Iterator[ComparisonRow]:
    """MAC of each mode with its best partner; close modes count as one subspace."""
    if not common.nodes:
        return
    one, other = _shapes_with_rotations(first, second)
    if _shape_rank(other) < other.shape[1]:
        notes.append("too few common nodes for the MAC to separate all modes")
    assurance = modal_assurance(one, other)
    visible, visible_in_reference = _moves_nodes(one), _moves_nodes(other)
    frequencies = np.sqrt(np.clip(second.squares, 0.0, None))
    own = np.sqrt(np.clip(first.squares, 0.0, None))
    for mode, row in enumerate(assurance):
        if not (visible[mode] or visible_in_reference.all()):
            notes.append(f"mode {mode + 1} moves no common node: it has no MAC")
            continue
        best = _best_partner(row, np.abs(frequencies - own[mode]))
        gap = np.abs(frequencies - frequencies[best])
        close = gap <= _CLOSE_FREQUENCIES * frequencies[best]
        value = subspace_assurance(one[:, mode], other[:, close])
        if close.sum() == 1:
            value = float(row[best])
        yield ComparisonRow(
            f"shapes (MAC), {support}",
            f"mode {mode + 1} and mode {best + 1} of the reference",
            value,
            1.0,
            value - 1.0,
        )


def _shapes_with_rotations(first: ModalBody, second: ModalBody) -> tuple[Array, Array]:
    """Return displacements, and rotations times a length if both bodies have them."""
    turns = first.turns, second.turns
    if not all(part.any() for part in turns):
        return first.shapes, second.shapes
    return np.vstack([first.shapes, turns[0]]), np.vstack([second.shapes, turns[1]])


def _moves_nodes(shapes: Array) -> NDArray[np.bool_]:
    """Return a mask of the modes that move a node."""
    sizes = np.linalg.norm(shapes, axis=0)
    return np.asarray(sizes > _ROUNDING_SHARE * sizes.max(initial=0.0))


def _best_partner(assurance: Array, distance: Array) -> int:
    """Return the mode with the largest MAC; of equal ones the nearest in frequency."""
    alike = assurance >= assurance.max() - _EQUAL_ASSURANCE
    return int(np.where(alike, distance, np.inf).argmin())


def _shape_rank(shapes: Array) -> int:
    size = np.linalg.norm(shapes, axis=0)
    return int(
        np.linalg.matrix_rank(shapes / np.where(size > 0.0, size, 1.0), tol=1e-6)
    )


def _loaded_nodes(common: Pairing, markers: Sequence[str] | None) -> list[int]:
    """Indices of the common nodes that take the loads."""
    nodes = [node for node, _ in common.nodes]
    if markers is not None:
        return [_node_index(nodes, marker) for marker in markers]
    size = [np.linalg.norm(other.phi.m0) for _, other in common.nodes]
    order = np.argsort(size, kind="stable")[::-1]
    return sorted(int(k) for k in order[:_MAX_MARKERS])


def _node_index(nodes: list[Node], marker: str) -> int:
    ids = [node.id for node in nodes]
    if str(marker) not in ids:
        raise InputError(
            f"the two SIDs have no common node {marker}",
            expected=f"one of {', '.join(ids[:8]) or 'none at all'}",
        )
    return ids.index(str(marker))


def _probe_frequencies(squares: Array) -> list[float]:
    """Circular frequencies below, near and above the first mode."""
    omega = np.sqrt(squares)
    probes = [0.5 * omega[0], 0.9 * omega[0]]
    if len(omega) > 1:
        probes.append(np.sqrt(omega[0] * omega[1]))
    return [float(value) for value in probes]


def _relative_difference(difference: float, size: float) -> float:
    return float(difference / abs(size)) if size else float(difference)
