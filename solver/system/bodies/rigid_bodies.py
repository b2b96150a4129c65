"""Bodies with a SID that a scene takes as rigid, to see what their flexibility does."""

from __future__ import annotations

from sidtool.formats.scene import (
    ElasticInitial,
    SceneFile,
    SidBody,
    has_wildcard,
    is_elastic,
    is_stress,
    parse_output,
)
from sidtool.formats.sid import SID, rigid_node, rigid_sid, symmetric_3x3


def is_rigid(scene: SceneFile, name: str) -> bool:
    """Whether a body has a SID of which only the mass counts."""
    body = scene.bodies.get(name)
    return isinstance(body, SidBody) and body.rigid


def elastic_outputs(scene: SceneFile) -> list[str]:
    """Outputs that only the flexibility of rigid bodies would give."""
    found = []
    for text in scene.outputs.record:
        if has_wildcard(text):
            continue
        name = parse_output(text)
        elastic = is_elastic(name.quantity) or is_stress(name.quantity)
        if elastic and is_rigid(scene, name.owner):
            found.append(text)
    return found


def without_elasticity(scene: SceneFile) -> SceneFile:
    """The scene without what is said of the elastic coordinates of rigid bodies."""
    if not any(is_rigid(scene, name) for name in scene.bodies):
        return scene
    bodies = {
        name: body.model_copy(update={"initial": _placed(body), "damping": None})
        if isinstance(body, SidBody) and body.rigid
        else body
        for name, body in scene.bodies.items()
    }
    left = set(elastic_outputs(scene))
    record = tuple(text for text in scene.outputs.record if text not in left)
    outputs = scene.outputs.model_copy(update={"record": record})
    return scene.model_copy(update={"bodies": bodies, "outputs": outputs})


def _placed(body: SidBody) -> ElasticInitial:
    nothing = {"elastic": None, "elastic_velocity": None}
    return body.initial.model_copy(update=nothing)


def rigid_part(sid: SID) -> SID:
    """The same body undeformed: mass, centre, inertia and nodes."""
    centre = sid.mdCM.m0[:, 0] / sid.mass if sid.mass else sid.mdCM.m0[:, 0]
    nodes = tuple(
        rigid_node(node.id, node.origin.m0[:, 0], node.AP.m0) for node in sid.nodes
    )
    return rigid_sid(sid.mass, centre, symmetric_3x3(sid.J.m0[:, 0]), nodes)
