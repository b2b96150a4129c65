"""Bodies whose frame is held where they start, as a fixed joint to the ground.

A SID need not have a node that rests in its frame, so the joint takes one that is added
at the origin of the frame, which no shape function moves.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sidtool.formats.scene import Fixed, Marker, Placement, SceneFile
from sidtool.formats.sid import SID, Node, Taylor

#: Name of the added node.
NODE = "held frame"


def with_held_frames(scene: SceneFile) -> SceneFile:
    """The scene with a fixed joint "NAME held" for each body whose frame is held."""
    markers, joints = dict(scene.ground.markers), dict(scene.joints)
    held = {n: body for n, body in scene.sid_bodies.items() if body.frame == "held"}
    for body, content in held.items():
        name = f"{body} held"
        start = content.initial
        place: dict[str, Any] = {k: getattr(start, k) for k in Placement.model_fields}
        markers[name] = Marker(**place)
        ends = (f"ground.{name}", f"{body}.{NODE}")
        joints[name] = Fixed(type="fixed", markers=ends)
    if not held:
        return scene
    ground = scene.ground.model_copy(update={"markers": markers})
    return scene.model_copy(update={"ground": ground, "joints": joints})


def without_held_frames(scene: SceneFile) -> SceneFile:
    """The scene that became this one, as files hold it."""
    held = {f"{name} held" for name in scene.bodies}
    joints = {n: joint for n, joint in scene.joints.items() if n not in held}
    markers = {n: m for n, m in scene.ground.markers.items() if n not in held}
    ground = scene.ground.model_copy(update={"markers": markers})
    return scene.model_copy(update={"ground": ground, "joints": joints})


def with_frame_node(sid: SID) -> SID:
    """The SID with a node at the origin of its frame."""
    shapes = Taylor(np.zeros((3, sid.nq)))
    origin, AP = Taylor(np.zeros((3, 1))), Taylor(np.eye(3))
    return replace(sid, nodes=(*sid.nodes, Node(NODE, origin, shapes, shapes, AP)))
