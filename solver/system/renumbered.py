"""A system with other numbers of its bodies: only what they fill is made anew.

All tables but the array of numbers stay what they are, as long as masses, places and
initial values are all that changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

from sidtool.formats.scene import Body, RigidBody, SceneFile, SidBody, rotation
from sidtool.formats.sid import SID, Array
from sidtool.formats.toml.tables import Table

from ..functions.pool import Pool
from ..space import layout as at
from .bodies.body_tables import free_orientation, packed_marker
from .bodies.data import BodyData, body_data
from .bodies.packing import flags, pack
from .building import build_system
from .ingredients import Ingredients
from .scene import System
from .sizes import mechanism_size

#: What may change of each kind of body.
NUMBERS: dict[type[Table], set[str]] = {
    RigidBody: {"mass", "inertia", "centre_of_mass", "markers", "initial"},
    SidBody: {"initial"},
}


def renumbered(
    before: System, scene: SceneFile, sids: Mapping[str, SID]
) -> System | None:
    """The system of a scene that differs from another one in numbers of bodies.

    before : of a scene without programs, as it was built with or without all joints

    None where more changes, or where numbers of the kind that changed may decide on
    tables: places beside point masses, flexible bodies that are held or taken as
    rigid, and any beside laws or at static equilibrium.
    """
    was = before.source
    if was is None or not _same_but_bodies(was, scene) or not _plain(before, sids):
        return None
    changed = [
        name for name in scene.bodies if scene.bodies[name] is not was.bodies[name]
    ]
    known = {data.name: data for data in before.bodies}
    data = dict(known)
    for name in changed:
        body, old = scene.bodies[name], was.bodies[name]
        if not _is_alike(old, body) or not _keeps_points(old, body, known, name):
            return None
        if isinstance(body, RigidBody):
            data[name] = body_data(name, body, sids, before.planar)
            if _kind(data[name]) != _kind(known[name]):
                return None
    found = _with_bodies(before, scene, changed, data)
    every = partial(build_system, scene, sids, keep_joints=True)
    return replace(found, every_joint=every if before.every_joint else None)


def _same_but_bodies(was: SceneFile, scene: SceneFile) -> bool:
    """Whether all other tables are the same objects."""
    if list(was.bodies) != list(scene.bodies):
        return False
    others = set(type(scene).model_fields) - {"bodies"}
    return all(getattr(was, name) is getattr(scene, name) for name in others)


def _plain(before: System, sids: Mapping[str, SID]) -> bool:
    """Whether tables follow from the structure of the scene and numbers alone."""
    same = all(sid is before.sids.get(name) for name, sid in sids.items())
    states = any(not data.of_scene for data in before.bodies[1:])
    laws = any(element.programmed is not None for element in before.forces)
    static = before.scene.initial.state == "static"
    return same and not (static or laws or states or before.led or before.unsampled)


def _is_alike(was: Body, body: Body) -> bool:
    """Whether only numbers differ that change no table."""
    if type(was) is not type(body):
        return False
    if isinstance(body, SidBody) and (body.rigid or body.frame == "held"):
        return False
    fixed = set(type(body).model_fields) - NUMBERS[type(body)]
    if any(getattr(was, name) != getattr(body, name) for name in fixed):
        return False
    return list(was.markers) == list(body.markers)


def _keeps_points(
    was: Body, body: Body, known: Mapping[str, BodyData], name: str
) -> bool:
    """Whether point masses, which have no orientation, stay where joints take them
    for places or for prescribed frames."""
    points = [one.name for one in known.values() if one.of_scene and not one.rotates]
    if points and was.markers != body.markers:
        return False
    turned = (rotation(was.initial) != rotation(body.initial)).any()
    return not (name in points and turned)


def _kind(data: BodyData) -> tuple[bool, int]:
    return data.rotates, flags(data.sid, data.quadratic_inertia)


def _with_bodies(
    before: System,
    scene: SceneFile,
    changed: list[str],
    data: Mapping[str, BodyData],
    filled: Sequence[tuple[int, Array]] = (),
) -> System:
    """filled : what tables fill that stand in the pool before those of `before`"""
    new = {name: scene.bodies[name] for name in changed}
    told = before.scene.model_copy(update={"bodies": {**before.scene.bodies, **new}})
    order = tuple(one.name for one in before.bodies)
    parts = Ingredients(told, data, {}, order, {}, {}, Pool())
    pool = before.arrays.pool.copy()
    filled = [*filled, *_filled(before, parts, changed)]
    for first, values in filled:
        pool[first : first + len(values)] = values
    whole = before.whole
    return replace(
        before,
        scene=told,
        source=scene,
        arrays=before.arrays.replaced(pool=pool),
        bodies=tuple(data.values()),
        length=mechanism_size(told, data, before.markers),
        whole=whole and _with_bodies(whole, scene, changed, data, filled),
    )


def _filled(
    before: System, parts: Ingredients, changed: list[str]
) -> Iterator[tuple[int, Array]]:
    """What the numbers of some bodies fill: where in the pool it begins, and with
    what."""
    for name in changed:
        row = before.arrays.body[before.index(name)]
        if not parts.data[name].sid.nq:
            yield row[at.DATA], pack(parts.data[name].sid, parts.planar)
        if row[at.MOTION] == at.FREE:
            yield row[at.FRAME], free_orientation(parts, name)
    for reference, i in before.markers.items():
        if reference[0] in changed and not parts.data[reference[0]].sid.nq:
            yield before.arrays.marker[i, at.M_DATA], packed_marker(parts, reference)
