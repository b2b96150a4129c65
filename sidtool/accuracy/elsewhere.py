"""Bodies in other frames, and what outputs are called there.

Elastic coordinates are the same in every frame. Parts of a scene act at nodes of
flexible bodies, which stay where they are. Where a frame was stays in sight as a node
that no shape function moves in the old frame: outputs of the frame are those of it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from sidtool.formats.scene import SceneFile, is_elastic, parse_output
from sidtool.formats.scene.outputs import (
    BODY_QUANTITIES,
    MARKER_QUANTITIES,
    MOMENTA,
    PEAK_STRESS,
)
from sidtool.formats.sid import SID, Node, Taylor
from sidtool.solver.system.bodies.damping import damped

from ..conversion.rereference import FrameChange, changed, frame_change

#: The node where the frame was; letters are added until no other has this name.
NODE = "frame"
#: Displacements from the body frame, in its axes.
RELATIVE = ("ux", "uy", "uz")
#: Quantities of a body that do not depend on where its frame is.
OF_THE_BODY = (*MOMENTA, PEAK_STRESS)


def change_to(sid: SID, frame: str) -> FrameChange:
    """The change to a frame, see `rereferenced`, that starts where the own one does."""
    return replace(frame_change(sid, frame), origin=np.zeros(3))


def in_frame(sid: SID, frame: str) -> SID:
    """A SID in another frame, see `rereferenced`."""
    return changed(sid, change_to(sid, frame))


def with_node(sid: SID) -> SID:
    """A SID with a node that stays where its frame is."""
    zero = Taylor(np.zeros((3, sid.nq)))
    place = Taylor(np.zeros((3, 1)), np.zeros((sid.nq, 3, 1)))
    turned = Taylor(np.eye(3), np.zeros((sid.nq, 3, 3)))
    node = Node(id=node_of(sid), origin=place, phi=zero, psi=zero, AP=turned)
    return replace(sid, nodes=(*sid.nodes, node))


def node_of(sid: SID) -> str:
    """What the node is called where the frame was."""
    name, known = NODE, {node.id for node in sid.nodes}
    while name in known:
        name += "_"
    return name


def in_frames(
    scene: SceneFile, sids: Mapping[str, SID], frames: Mapping[str, str]
) -> dict[str, SID]:
    """The SIDs with these bodies in other frames, for a scene `by_matrices`."""
    own = with_damping(scene, sids, frames)
    return {**own, **{name: in_frame(own[name], f) for name, f in frames.items()}}


def with_damping(
    scene: SceneFile, sids: Mapping[str, SID], names: Iterable[str]
) -> dict[str, SID]:
    """The SIDs with the damping matrices that a scene means for some bodies.

    Its laws hold in the frames of the SIDs: mass matrices and natural modes are others
    in other frames, the damping is not.
    """
    bodies = scene.sid_bodies
    return {**sids, **{n: damped(sids[n], bodies[n].damping, n) for n in names}}


def by_matrices(scene: SceneFile, names: Iterable[str]) -> SceneFile:
    """The scene with the damping of some bodies as their SIDs have it."""
    bodies = scene.sid_bodies
    plain = {n: bodies[n].model_copy(update={"damping": None}) for n in names}
    return scene.model_copy(update={"bodies": {**scene.bodies, **plain}})


def named_there(names: Iterable[str], nodes: Mapping[str, str]) -> tuple[str, ...]:
    """What outputs are called where the frames of these bodies are nodes."""
    found = []
    for name in names:
        owner, _, quantity = parse_output(name)
        there = owner in nodes and is_of_frame(name) and quantity in MARKER_QUANTITIES
        found.append(f"{owner}.{nodes[owner]}.{quantity}" if there else name)
    return tuple(found)


def is_told_there(body: str, names: Iterable[str]) -> bool:
    """Whether outputs of the frame of a body are those of a node, too."""
    parsed = [parse_output(n) for n in names if is_of_frame(n)]
    return all(p.quantity in MARKER_QUANTITIES for p in parsed if p.owner == body)


def is_of_frame(name: str) -> bool:
    """Whether an output of a flexible body is one of its frame."""
    _, marker, quantity = parse_output(name)
    return not marker and not is_elastic(quantity) and quantity not in OF_THE_BODY


def depends_on_frame(name: str) -> bool:
    """Whether an output of a flexible body means something else in another frame."""
    return is_of_frame(name) or parse_output(name).quantity in RELATIVE


def is_free(scene: SceneFile, name: str) -> bool:
    """Whether a body can be put in another frame and the scene says the same.

    Its frame must not be held, it must not start deformed, and no law nor event may see
    what depends on the frame.
    """
    body = scene.sid_bodies[name]
    start = body.initial.elastic, body.initial.elastic_velocity
    parts = scene.model_dump_json(include={"forces", "drives", "events"})
    relative, own = "|".join(RELATIVE), "|".join(BODY_QUANTITIES)
    seen = rf"\b{re.escape(name)}\.([\w-]+\.({relative})|{own})\b(?!\.)"
    return body.frame != "held" and start == (None, None) and not re.search(seen, parts)
