"""Body frames of a run, and the terms that linear theory neglects in them.

The elastic coordinates are the same in every body frame. The motion is also the same,
except for the terms that linear theory neglects: terms of second order in the
deformation, or of third order if a body has geometric stiffening. They are smallest in
the frame in which the body deforms least. The full model is therefore run once more
with each flexible body in the frame in which it deforms most differently from its own.
Bodies without geometric stiffening are put in the frame in which they deform least, if
this changes outputs by more than a small part of the allowed error, but not by so much
that the request could not be met relative to their own frames; theory, section 16.

Outputs in other frames: joints, drives and forces act at nodes of flexible bodies,
which do not change. The former position of the frame becomes a node that no shape
function moves in the old frame; outputs of the frame become outputs of this node.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array, Node, Taylor
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.geometric_stiffening import has_second_order_field
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, expand_names, is_elastic, parse_output
from sidtool.formats.scene.outputs import (
    BODY_QUANTITIES,
    BODY_STRESSES,
    MARKER_QUANTITIES,
    MOMENTA,
)
from sidtool.solver.system.body_data import sid_with_damping

from ..conversion.frame_change import FrameChange, apply_frame_change, frame_change
from ..measurement.candidates import loaded_nodes
from ..measurement.request import Request
from ..measurement.runs import Runs, elastic_coordinates, max_difference
from .reference_run import Reference, make_reference

#: Factor of the neglected terms in an output, relative to its variation, and the share
#: of the allowed error from which on they are examined.
NEGLECT_FACTOR, MIN_NEGLECT_SHARE = 100.0, 0.05
#: Frames are equal if they differ by less than this part of the deformation.
SAME_FRAME_TOLERANCE = 1e-6
#: Shares of the allowed error between which another frame is used.
MIN_CHANGE_SHARE, MAX_CHANGE_SHARE = 0.1, 0.5
#: A frame is better if the deformation in it is smaller by this factor.
BETTER_FRAME_RATIO = 0.8
#: Factor on the difference of two frames for the neglected terms in the better one, and
#: in one that is not known to be better; measured were 1.3 and 2.1 at most.
NEGLECT_SAFETY, NEGLECT_SAFETY_UNKNOWN = 2.0, 3.0

#: Name of the node at the former position of the frame; letters make it unique.
FRAME_NODE_NAME = "frame"
#: Quantities relative to the body frame.
RELATIVE_QUANTITIES = ("ux", "uy", "uz")


@dataclass(frozen=True, eq=False)
class AlternativeFrame:
    """Another body frame, in words and in the notation of `rereferenced`.

    Attributes
    ----------
    share : deformation of the body in this frame, relative to that in its own frame
    lacks_second_order : True if the SID has no displacements of second order
    """

    words: str
    frame: str
    share: float
    lacks_second_order: bool

    @property
    def better(self) -> bool:
        """Check that this frame neglects less; with second-order terms no frame is
        better.
        """
        return self.lacks_second_order and self.share < BETTER_FRAME_RATIO


@dataclass(frozen=True, eq=False)
class FrameSelection:
    """Result of the search for body frames.

    Attributes
    ----------
    theory : (n,) terms neglected by linear theory, zero where they were not measured
    chosen : frames of bodies that were put in other frames
    diagnostics : of frames that were changed, or not compared
    """

    runs: Runs
    reference: Reference
    theory: Array
    chosen: Mapping[str, str] = field(default_factory=dict)
    diagnostics: tuple[Diagnostic, ...] = ()


def select_frames(
    runs: Runs, reference: Reference, request: Request, *, fixed: bool = False
) -> FrameSelection:
    """Select the body frames in which the full model neglects least.

    Parameters
    ----------
    fixed : True where bodies must stay in their own frames
    """
    as_is = FrameSelection(runs, reference, np.zeros(len(runs.names)))
    bodies = [n for n, kept in reference.choice.kept if kept]
    if not bodies:
        return as_is
    expected = {n: neglected_order(n, reference.result) for n in bodies}
    worst = max(expected, key=expected.__getitem__)
    least = float((reference.allowed / np.maximum(reference.variation, 1e-300)).min())
    if NEGLECT_FACTOR * expected[worst] < MIN_NEGLECT_SHARE * least:
        return as_is
    others = dict(_alternative_frames(runs, reference, bodies))
    reason = "the scene refers to its frame, or it has no other"
    as_is = _not_compared(as_is, [n for n in bodies if n not in others], reason)
    if not others:
        return as_is
    errors = _changes_by_frames(runs, reference, others)
    if not np.isfinite(errors[np.isfinite(reference.allowed)]).all():
        reason = "the scene does not run in other frames"
        return _not_compared(as_is, list(others), reason)
    better = {n: o.frame for n, o in others.items() if o.better}
    pinned = [
        n for n in _frame_dependent_outputs(runs) if parse_output(n).owner in better
    ]
    use = reference.used_share(errors)
    if better and not (fixed or pinned) and MIN_CHANGE_SHARE < use <= MAX_CHANGE_SHARE:
        searched = _search_in_frames(runs, reference, request, better, errors)
        changed = diagnose(
            "N608",
            ", ".join(better),
            frames=list(better.values()),
            **reference.largest_error(runs.names, errors).values(),
        )
        return replace(
            searched,
            theory=NEGLECT_SAFETY * errors,
            diagnostics=(*as_is.diagnostics, changed),
        )
    unknown = any(o.better or not o.lacks_second_order for o in others.values())
    safety = NEGLECT_SAFETY_UNKNOWN if unknown else NEGLECT_SAFETY
    return replace(as_is, theory=safety * errors)


def neglected_order(name: str, result: Result) -> float:
    """Return the order of magnitude of the terms that linear theory neglects."""
    sid = result.sids[name]
    body = result.bodies[name]
    size = max(body.deflection, body.rotation)
    return float(size ** (2 if has_second_order_field(sid) else 1))


def _not_compared(
    selection: FrameSelection, bodies: list[str], reason: str
) -> FrameSelection:
    """Return the selection with a diagnostic on bodies whose frame was not compared
    (N603).
    """
    if not bodies:
        return selection
    what = "the effect of its body frame"
    found = diagnose("N603", ", ".join(bodies), what=what, reason=reason, remedy="")
    return replace(selection, diagnostics=(*selection.diagnostics, found))


def _changes_by_frames(
    runs: Runs, reference: Reference, others: dict[str, AlternativeFrame]
) -> Array:
    """Return the changes (n,) by other frames of these bodies; infinite
    without a run.
    """
    nodes = {n: frame_node_name(runs.sids[n]) for n in others}
    own = with_damping_of_scene(runs.scene, runs.sids, others)
    sids = {
        n: sid_in_frame(with_frame_node(own[n]), o.frame) for n, o in others.items()
    }
    names = renamed_outputs(runs.names, nodes)
    again = runs.with_other_sids(sids, names, with_matrix_damping(runs.scene, others))
    choice, setting = reference.choice, reference.setting
    one, other = runs.attempt(choice, setting), again.attempt(choice, setting)
    if one is None or other is None:
        return np.full(len(names), np.inf)
    a, b = runs.columns(choice, one), again.columns(choice, other)
    for row, name in enumerate(runs.names):
        body, marker, quantity = parse_output(name)
        if body in others and quantity in RELATIVE_QUANTITIES:
            a[:, row] = _displacement(runs, body, marker, quantity, one)
            b[:, row] = _displacement(runs, body, marker, quantity, other)
    return max_difference((one.t, a), (other.t, b))


def _displacement(
    runs: Runs, body: str, marker: str, quantity: str, result: Result
) -> Array:
    """(nt,) of first order in the body's own frame, with elastic coordinates of a run
    in any."""
    node = runs.sids[body].node(runs.scene.sid_bodies[body].markers.get(marker, marker))
    q = elastic_coordinates(body, result)
    return np.asarray(q @ node.phi.m0[RELATIVE_QUANTITIES.index(quantity)])


def _search_in_frames(
    runs: Runs,
    reference: Reference,
    request: Request,
    frames: Mapping[str, str],
    errors: Array,
) -> FrameSelection:
    """Repeat the search with bodies in other frames; earlier runs are reused."""
    sids = sids_in_frames(runs.scene, runs.sids, frames)
    again = runs.with_other_sids(
        sids, runs.names, with_matrix_damping(runs.scene, frames)
    )
    new_reference = make_reference(again, reference.choice, request)
    new_reference = replace(
        new_reference, meshes=reference.meshes, digits=reference.digits, frames=errors
    )
    return FrameSelection(again, new_reference, errors, frames)


def _frame_dependent_outputs(runs: Runs) -> list[str]:
    """Return the outputs, recorded or requested, whose meaning depends on the frame."""
    scene = runs.scene
    names = expand_names(scene.outputs.record, scene, runs.sids, "outputs.record")
    both = dict.fromkeys([*names, *runs.names])
    known = scene.sid_bodies
    return [n for n in both if parse_output(n).owner in known and depends_on_frame(n)]


def _alternative_frames(
    runs: Runs, reference: Reference, bodies: list[str]
) -> Iterator[tuple[str, AlternativeFrame]]:
    """Return, for each body, the frame in which it deforms most differently."""
    for name in bodies:
        if can_change_frame(runs.scene, name) and is_known_at_node(name, runs.names):
            frames = list(alternative_frames(name, runs, reference.result))
            if frames:
                yield name, max(frames, key=lambda other: abs(np.log(other.share)))


def alternative_frames(
    name: str, runs: Runs, result: Result
) -> Iterator[AlternativeFrame]:
    """Return the frames of a body that move relative to its own and start with it."""
    sid, q = runs.sids[name], elastic_coordinates(name, result)
    nodes = list(dict.fromkeys(loaded_nodes(runs.scene, name).values()))
    words = {"mean axes": "buckens"} | {
        f"the frame at {n}": f"tangent:{n}" for n in nodes
    }
    if len(nodes) > 1:
        words[f"the chord of {nodes[0]} and {nodes[1]}"] = (
            f"chord:{nodes[0]},{nodes[1]}"
        )
    none = FrameChange(np.zeros(3), np.zeros((sid.nq, 3)), np.zeros((sid.nq, 3)))
    own, lacks_second_order = (
        _max_displacement(sid, none, q),
        not has_second_order_field(sid),
    )
    for words_of_frame, frame in words.items():
        try:
            change = frame_change_to(sid, frame)
        except InputError:
            continue
        moves = np.abs(change.at(np.zeros(3))).max() + np.abs(change.turn).max()
        share = _max_displacement(sid, change, q) / own if own else 0.0
        if moves > SAME_FRAME_TOLERANCE * max(sid.largest_shapes) and share > 0.0:
            yield AlternativeFrame(words_of_frame, frame, share, lacks_second_order)


def _max_displacement(sid: SID, change: FrameChange, q: Array) -> float:
    """The largest displacement of a node [m] where one of the coordinates is so."""
    phi, _ = sid.shapes
    q = q[np.unique(np.abs(q).argmax(axis=0))]
    places = np.array([node.position for node in sid.nodes])
    turned = np.cross(change.turn[None], places[:, None, :])
    phi = phi - np.moveaxis(change.shift[None] + turned, 1, 2)
    return float(np.linalg.norm(phi @ q.T, axis=1).max(initial=0.0))


#: Quantities of a body that do not depend on its frame.
BODY_QUANTITIES_OF_FRAME = (*MOMENTA, *BODY_STRESSES)


def frame_change_to(sid: SID, frame: str) -> FrameChange:
    """Return the change to a frame that starts at the position of the own one, see
    `rereferenced`.
    """
    return replace(frame_change(sid, frame), origin=np.zeros(3))


def sid_in_frame(sid: SID, frame: str) -> SID:
    """Return a SID in another frame, see `rereferenced`."""
    return apply_frame_change(sid, frame_change_to(sid, frame))


def with_frame_node(sid: SID) -> SID:
    """Return a SID with an additional node that is fixed in its frame."""
    zero = Taylor(np.zeros((3, sid.nq)))
    place = Taylor(np.zeros((3, 1)), np.zeros((sid.nq, 3, 1)))
    turned = Taylor(np.eye(3), np.zeros((sid.nq, 3, 3)))
    node = Node(id=frame_node_name(sid), origin=place, phi=zero, psi=zero, AP=turned)
    return replace(sid, nodes=(*sid.nodes, node))


def frame_node_name(sid: SID) -> str:
    """Return the name of the node at the former position of the frame."""
    name, known = FRAME_NODE_NAME, {node.id for node in sid.nodes}
    while name in known:
        name += "_"
    return name


def sids_in_frames(
    scene: SceneFile, sids: Mapping[str, SID], frames: Mapping[str, str]
) -> dict[str, SID]:
    """Return the SIDs with bodies in other frames, for a scene
    `with_matrix_damping`.
    """
    own = with_damping_of_scene(scene, sids, frames)
    return {**own, **{name: sid_in_frame(own[name], f) for name, f in frames.items()}}


def with_damping_of_scene(
    scene: SceneFile, sids: Mapping[str, SID], names: Iterable[str]
) -> dict[str, SID]:
    """Return the SIDs with the damping matrices that the scene defines for some bodies.
    Damping laws apply in the frames of the SIDs: mass matrices and natural modes depend
    on the frame, the damping matrix does not.
    """
    bodies = scene.sid_bodies
    return {
        **sids,
        **{n: sid_with_damping(sids[n], bodies[n].damping, n) for n in names},
    }


def with_matrix_damping(scene: SceneFile, names: Iterable[str]) -> SceneFile:
    """Return the scene in which the damping of some bodies is that of their SIDs."""
    bodies = scene.sid_bodies
    plain = {n: bodies[n].model_copy(update={"damping": None}) for n in names}
    return scene.model_copy(update={"bodies": {**scene.bodies, **plain}})


def renamed_outputs(names: Iterable[str], nodes: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of outputs after the frames of these bodies became nodes."""
    renamed = []
    for name in names:
        owner, _, quantity = parse_output(name)
        there = (
            owner in nodes and is_frame_output(name) and quantity in MARKER_QUANTITIES
        )
        renamed.append(f"{owner}.{nodes[owner]}.{quantity}" if there else name)
    return tuple(renamed)


def is_known_at_node(body: str, names: Iterable[str]) -> bool:
    """Return whether an output of the frame also exists for a node."""
    parsed = [parse_output(n) for n in names if is_frame_output(n)]
    return all(p.quantity in MARKER_QUANTITIES for p in parsed if p.owner == body)


def is_frame_output(name: str) -> bool:
    """Return whether an output of a flexible body belongs to its frame."""
    _, marker, quantity = parse_output(name)
    return (
        not marker
        and not is_elastic(quantity)
        and quantity not in BODY_QUANTITIES_OF_FRAME
    )


def depends_on_frame(name: str) -> bool:
    """Return whether an output of a flexible body depends on the choice of its
    frame.
    """
    return is_frame_output(name) or parse_output(name).quantity in RELATIVE_QUANTITIES


def can_change_frame(scene: SceneFile, name: str) -> bool:
    """Return whether a body can be put in another frame without other changes. The
    frame must not be constrained, the body must start undeformed, and no law and no
    event may depend on the frame.
    """
    body = scene.sid_bodies[name]
    start = body.initial.elastic, body.initial.elastic_velocity
    parts = scene.model_dump_json(include={"forces", "drives", "events"})
    relative, own = "|".join(RELATIVE_QUANTITIES), "|".join(BODY_QUANTITIES)
    pattern = rf"\b{re.escape(name)}\.([\w-]+\.({relative})|{own})\b(?!\.)"
    return (
        body.frame != "held" and start == (None, None) and not re.search(pattern, parts)
    )
