"""What small deformations leave out, seen by saying a body in another frame.

The elastic coordinates are the same in every body frame, and so is the motion, but for
what the theory of small deformations leaves out: terms of second order in them, of
third where a body has geometric stiffening. They are smallest in the frame in which the
body deforms least. So the richest model is run once more with each flexible body in
another frame, that of mean axes or at its loaded nodes, where a body deforms so much
that this could be seen; theory, section 16.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID, Array
from sidtool.formats.stiffening import has_second_order_field

from ..conversion.rereference import FrameChange, changed, frame_change
from ..study.plan import comparable
from .candidates import holds_frame, loaded_nodes
from .outside import elastic_coordinates, elastic_rotation
from .reference import Reference
from .runs import Runs

#: How many times what is left out may change an output, relative to its variation, and
#: from which share of what is allowed on that is looked at.
FACTOR, LOOKED_AT = 100.0, 0.05
#: Frames are the same if they move by less than this part of what the body deforms.
SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Other:
    """A body in another frame, in words, and how far it deforms there [m]."""

    words: str
    sid: SID
    deforms: float


@dataclass(frozen=True, eq=False)
class Frames:
    """What other frames change, (n,), nothing where it was not measured; in words."""

    errors: Array
    sentences: tuple[str, ...]


def measured(runs: Runs, reference: Reference) -> Frames:
    """How far the richest model in other frames is from the reference."""
    nothing = np.zeros(len(runs.names))
    bodies = [n for n, kept in reference.choice.kept if kept]
    expected = {n: left_out(n, reference.result) for n in bodies}
    if not bodies:
        return Frames(nothing, ())
    worst = max(expected, key=expected.__getitem__)
    least = float((reference.allowed / np.maximum(reference.variation, 1e-300)).min())
    if FACTOR * expected[worst] < LOOKED_AT * least:
        told = f"{worst} deforms so little that others change {expected[worst]:.0e}"
        return Frames(nothing, (f"frames: not searched, as {told} of the outputs",))
    others = dict(_others(runs, reference, bodies))
    names, _ = comparable(runs.names, runs.scene, ("frame",), named=True)
    if not others or not names:
        told = "other frames would change what bodies and outputs mean"
        return Frames(nothing, (f"frames: not searched, as {told}",))
    sids = {name: other.sid for name, other in others.items()}
    changes = runs.changed_by(sids, reference.choice, reference.setting)
    errors = np.where(np.isin(runs.names, names), changes, 0.0)
    counts = np.isfinite(reference.allowed)
    if not np.isfinite(errors[counts]).all():
        told = "the scene does not run in others"
        return Frames(nothing, (f"frames: not searched, as {told}",))
    row = reference.worst(errors)
    seen = f"{errors[row]:.1e} {reference.units[row]}".rstrip()
    listed = ", ".join(f"{other.words} of {n}" for n, other in others.items())
    return Frames(
        errors,
        (
            f"frames: {seen} in {runs.names[row]} with {listed}; that is what small "
            f"deformations leave out, {_verdict(errors[row], reference, row, others)}",
        ),
    )


def left_out(name: str, result: Result) -> float:
    """What small deformations leave out of what deformations do: its order."""
    sid = result.sids[name]
    size = max(result.bodies[name].deflection, elastic_rotation(name, result))
    return float(size ** (2 if has_second_order_field(sid) else 1))


def _verdict(
    error: float, reference: Reference, row: int, others: dict[str, Other]
) -> str:
    if error <= reference.allowed[row]:
        return "and no part of the errors, which are those against this theory"
    bare = [n for n, other in others.items() if not has_second_order_field(other.sid)]
    less = "bodies cut into several by joints of type fixed leave"
    if bare:
        less = f"a SID of {', '.join(bare)} with geometric stiffening leaves"
    return (
        "more than was asked for: the errors are those against this theory, of which "
        f"{less} less out"
    )


def _others(
    runs: Runs, reference: Reference, bodies: list[str]
) -> Iterator[tuple[str, Other]]:
    for name in bodies:
        if is_free(runs.scene, name):
            found = list(other_frames(name, runs, reference.result))
            if found:
                yield name, min(found, key=lambda other: other.deforms)


def is_free(scene: SceneFile, name: str) -> bool:
    """Whether another frame of a body changes nothing of what a scene says."""
    body = scene.sid_bodies[name]
    start = body.initial.elastic, body.initial.elastic_velocity
    return (
        body.frame != "held" and start == (None, None) and not holds_frame(scene, name)
    )


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
    for told, frame in words.items():
        try:
            change = replace(frame_change(sid, frame), origin=np.zeros(3))
            moves = np.abs(change.at(np.zeros(3))).max() + np.abs(change.turn).max()
            if moves > SAME * max(sid.largest_shapes):
                yield Other(told, changed(sid, change), _deforms(sid, change, q))
        except InputError:
            continue


def _deforms(sid: SID, change: FrameChange, q: Array) -> float:
    """The largest displacement of a node [m] where one of the coordinates is so."""
    phi, _ = sid.shapes
    q = q[np.unique(np.abs(q).argmax(axis=0))]
    places = np.array([node.position for node in sid.nodes])
    turned = np.cross(change.turn[None], places[:, None, :])
    phi = phi - np.moveaxis(change.shift[None] + turned, 1, 2)
    return float(np.linalg.norm(phi @ q.T, axis=1).max(initial=0.0))
