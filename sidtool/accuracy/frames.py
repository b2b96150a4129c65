"""The frames of bodies: which are used, and what small deformations leave out.

The elastic coordinates are the same in every body frame, and so is the motion, but for
what the theory of small deformations leaves out: terms of second order in them, of
third where a body has geometric stiffening. They are smallest in the frame in which the
body deforms least. So the richest model is run once more with each flexible body in the
frame in which it deforms most differently from its own. Bodies without geometric
stiffening are put in the frame in which they deform least where that changes more than
a small part of what is allowed, and not so much that the request could not be kept
against their own frames; theory, section 16.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.scene import expanded, parse_output
from sidtool.formats.sid import SID, Array
from sidtool.formats.stiffening import has_second_order_field

from ..conversion.rereference import FrameChange
from .candidates import loaded_nodes
from .elsewhere import (
    RELATIVE,
    by_matrices,
    change_to,
    depends_on_frame,
    in_frame,
    in_frames,
    is_free,
    is_told_there,
    named_there,
    node_of,
    with_damping,
    with_node,
)
from .outside import elastic_coordinates
from .reference import Reference, make_reference
from .runs import Runs, apart
from .wanted import Request

#: How many times what is left out may change an output, relative to its variation, and
#: from which share of what is allowed on that is looked at.
FACTOR, LOOKED_AT = 100.0, 0.05
#: Frames are the same if they move by less than this part of what the body deforms.
SAME = 1e-6
#: Of what is allowed: from which share on another frame is used, and up to which.
CHOSEN, TOO_MUCH = 0.1, 0.5
#: A frame is better in which bodies deform by less than this part of what they do.
BETTER = 0.8
#: Over the difference of two frames, what may be left out in the better one, and in one
#: that is not known to be better; measured were 1.3 and 2.1 at most.
SAFETY, UNKNOWN = 2.0, 3.0


@dataclass(frozen=True, eq=False)
class Other:
    """A body in another frame, in words and as `rereferenced` takes it.

    share : how far the body deforms there, of how far it does in its own frame
    bare : whether it has no displacements of second order
    """

    words: str
    frame: str
    share: float
    bare: bool

    @property
    def better(self) -> bool:
        """Whether less is left out there; with terms of second order none is better."""
        return self.bare and self.share < BETTER


@dataclass(frozen=True, eq=False)
class Frames:
    """The search in the frames that are used.

    theory : (n,) what small deformations leave out, zero where that was not measured
    chosen : other frames that bodies were put in
    sentences : reasons
    """

    runs: Runs
    reference: Reference
    theory: Array
    chosen: Mapping[str, str] = field(default_factory=dict)
    sentences: tuple[str, ...] = ()


def with_frames(
    runs: Runs, reference: Reference, request: Request, *, fixed: bool = False
) -> Frames:
    """The richest model in the frames in which its bodies leave least out.

    Parameters
    ----------
    fixed : True where bodies must stay in their own frames
    """
    as_is = Frames(runs, reference, np.zeros(len(runs.names)))
    bodies = [n for n, kept in reference.choice.kept if kept]
    if not bodies:
        return as_is
    expected = {n: left_out(n, reference.result) for n in bodies}
    worst = max(expected, key=expected.__getitem__)
    least = float((reference.allowed / np.maximum(reference.variation, 1e-300)).min())
    if FACTOR * expected[worst] < LOOKED_AT * least:
        told = f"{worst} deforms so little that others change {expected[worst]:.0e}"
        return _told(as_is, f"their own, not searched, as {told} of the outputs")
    others = dict(_others(runs, reference, bodies))
    missing = ", ".join(n for n in bodies if n not in others)
    more = f"; those of {missing} belong to what the scene says" if missing else ""
    if not others:
        return _told(as_is, f"not judged{more}")
    errors = _changes(runs, reference, others)
    if not np.isfinite(errors[np.isfinite(reference.allowed)]).all():
        return _told(as_is, f"not judged, as the scene does not run in others{more}")
    better = {n: o.frame for n, o in others.items() if o.better}
    pinned = [n for n in _of_frames(runs) if parse_output(n).owner in better]
    use, seen = reference.use(errors), _seen(errors, runs, reference)
    if better and not (fixed or pinned) and CHOSEN < use <= TOO_MUCH:
        words = " and ".join(f"{others[n].words} of {n}" for n in better)
        found = _moved(runs, reference, request, better, errors)
        told = f"{words}, in which bodies deform least; that changes {seen}; places "
        told += (
            "and displacements of these bodies that are not recorded are those there"
        )
        return replace(_told(found, f"{told}{more}"), theory=SAFETY * errors)
    unknown = any(o.better or not o.bare for o in others.values())
    found = replace(as_is, theory=(UNKNOWN if unknown else SAFETY) * errors)
    words = " and ".join(f"{o.words} of {n}" for n, o in others.items())
    means = f" and what {pinned[0]} means" if pinned else ""
    remedy = _remedy(others) if reference.use(found.theory) > 1.0 else ""
    return _told(found, f"their own; {words} would change {seen}{means}{remedy}{more}")


def left_out(name: str, result: Result) -> float:
    """What small deformations leave out of what deformations do: its order."""
    sid = result.sids[name]
    body = result.bodies[name]
    size = max(body.deflection, body.rotation)
    return float(size ** (2 if has_second_order_field(sid) else 1))


def _told(found: Frames, text: str) -> Frames:
    return replace(found, sentences=(f"frames: {text}",))


def _seen(errors: Array, runs: Runs, reference: Reference) -> str:
    """The output that sees most of it."""
    row = reference.worst(errors)
    seen = f"{errors[row]:.1e} {reference.units[row]}".rstrip()
    return f"{seen} in {runs.names[row]}"


def _remedy(others: dict[str, Other]) -> str:
    """What to do where small deformations leave out more than was asked for."""
    bare = [n for n, other in others.items() if other.bare]
    less = "bodies cut into several by joints of type fixed leave"
    if bare:
        less = f"a SID of {', '.join(bare)} with geometric stiffening leaves"
    better = " and ".join(f"{o.words} of {n}" for n, o in others.items() if o.better)
    also = f", {better} too" if better else ""
    return (
        ". Errors are those against small deformations in the frames that the SIDs "
        f"have, which leave out more than was asked for; {less} less out{also}"
    )


def _changes(runs: Runs, reference: Reference, others: dict[str, Other]) -> Array:
    """What other frames of these bodies change (n,); infinite where there is no run."""
    nodes = {n: node_of(runs.sids[n]) for n in others}
    own = with_damping(runs.scene, runs.sids, others)
    sids = {n: in_frame(with_node(own[n]), o.frame) for n, o in others.items()}
    names = named_there(runs.names, nodes)
    again = runs.elsewhere(sids, names, by_matrices(runs.scene, others))
    choice, setting = reference.choice, reference.setting
    one, other = runs.attempt(choice, setting), again.attempt(choice, setting)
    if one is None or other is None:
        return np.full(len(names), np.inf)
    a, b = runs.columns(choice, one), again.columns(choice, other)
    for row, name in enumerate(runs.names):
        body, marker, quantity = parse_output(name)
        if body in others and quantity in RELATIVE:
            a[:, row] = _displacement(runs, body, marker, quantity, one)
            b[:, row] = _displacement(runs, body, marker, quantity, other)
    return apart((one.t, a), (other.t, b))


def _displacement(
    runs: Runs, body: str, marker: str, quantity: str, result: Result
) -> Array:
    """(nt,) of first order in the body's own frame, with elastic coordinates of a run
    in any."""
    node = runs.sids[body].node(runs.scene.sid_bodies[body].markers.get(marker, marker))
    q = elastic_coordinates(body, result)
    return np.asarray(q @ node.phi.m0[RELATIVE.index(quantity)])


def _moved(
    runs: Runs,
    reference: Reference,
    request: Request,
    frames: Mapping[str, str],
    errors: Array,
) -> Frames:
    """The search with bodies in other frames; what was seen before stays known."""
    sids = in_frames(runs.scene, runs.sids, frames)
    again = runs.elsewhere(sids, runs.names, by_matrices(runs.scene, frames))
    found = make_reference(again, reference.choice, request)
    found = replace(
        found, meshes=reference.meshes, digits=reference.digits, frames=errors
    )
    return Frames(again, found, errors, frames)


def _of_frames(runs: Runs) -> list[str]:
    """Outputs, recorded or asked for, that mean something else in other frames."""
    scene = runs.scene
    names = expanded(scene.outputs.record, scene, runs.sids, "outputs.record")
    both = dict.fromkeys([*names, *runs.names])
    known = scene.sid_bodies
    return [n for n in both if parse_output(n).owner in known and depends_on_frame(n)]


def _others(
    runs: Runs, reference: Reference, bodies: list[str]
) -> Iterator[tuple[str, Other]]:
    """Each body in the frame in which it deforms most differently from its own."""
    for name in bodies:
        if is_free(runs.scene, name) and is_told_there(name, runs.names):
            found = list(other_frames(name, runs, reference.result))
            if found:
                yield name, max(found, key=lambda other: abs(np.log(other.share)))


def other_frames(name: str, runs: Runs, result: Result) -> Iterator[Other]:
    """The body in each frame that moves against its own and starts where that does."""
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
    own, bare = _deforms(sid, none, q), not has_second_order_field(sid)
    for told, frame in words.items():
        try:
            change = change_to(sid, frame)
        except InputError:
            continue
        moves = np.abs(change.at(np.zeros(3))).max() + np.abs(change.turn).max()
        share = _deforms(sid, change, q) / own if own else 0.0
        if moves > SAME * max(sid.largest_shapes) and share > 0.0:
            yield Other(told, frame, share, bare)


def _deforms(sid: SID, change: FrameChange, q: Array) -> float:
    """The largest displacement of a node [m] where one of the coordinates is so."""
    phi, _ = sid.shapes
    q = q[np.unique(np.abs(q).argmax(axis=0))]
    places = np.array([node.position for node in sid.nodes])
    turned = np.cross(change.turn[None], places[:, None, :])
    phi = phi - np.moveaxis(change.shift[None] + turned, 1, 2)
    return float(np.linalg.norm(phi @ q.T, axis=1).max(initial=0.0))
