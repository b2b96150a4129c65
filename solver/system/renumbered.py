"""A system with other numbers of bodies and drives: only what they fill is made anew.

All tables but the array of numbers stay what they are, as long as masses, places,
initial values and functions of time are all that changes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from functools import partial

from sidtool.formats.scene import Body, Drive, RigidBody, SceneFile, SidBody, rotation
from sidtool.formats.sid import SID, Array
from sidtool.formats.toml.tables import Table

from ..functions.features import Features, together
from ..functions.pool import Pool
from ..functions.table import with_other_numbers
from ..space import layout as at
from .bodies.body_tables import free_orientation, packed_marker
from .bodies.data import BodyData, rigid_body, rigid_nodes
from .bodies.packing import pack
from .building import build_system
from .ingredients import Ingredients
from .scene import System
from .sizes import mechanism_size

#: What may change of each kind of body, and of a drive.
NUMBERS: dict[type[Table], set[str]] = {
    RigidBody: {"mass", "inertia", "centre_of_mass", "markers", "initial"},
    SidBody: {"initial"},
    Drive: {"function"},
}
#: Where in the pool numbers begin, and they.
Filled = list[tuple[int, Array]]


def renumbered(
    before: System, scene: SceneFile, sids: Mapping[str, SID]
) -> System | None:
    """The system of a scene that differs from another one in numbers of bodies and of
    functions of drives.

    before : of a scene without programs, as it was built with or without all joints

    None where more changes, or where numbers of the kind that changed may decide on
    tables: orientations beside point masses and places of these, flexible bodies that
    are held or taken as rigid, other breaks, and any beside laws or at static
    equilibrium.
    """
    was = before.source
    if was is None or not _same_but_parts(was, scene) or not _plain(before, sids):
        return None
    data = _other_bodies(before, was, scene)
    functions = _other_functions(before, was, scene)
    if data is None or functions is None:
        return None
    return _with_numbers(before, scene, data, *functions)


def _same_but_parts(was: SceneFile, scene: SceneFile) -> bool:
    """Whether all other tables are the same objects."""
    if (*was.bodies, *was.drives) != (*scene.bodies, *scene.drives):
        return False
    others = type(scene).model_fields.keys() - {"bodies", "drives"}
    return all(getattr(was, name) is getattr(scene, name) for name in others)


def _plain(before: System, sids: Mapping[str, SID]) -> bool:
    """Whether tables follow from the structure of the scene and numbers alone."""
    same = all(sid is before.sids.get(name) for name, sid in sids.items())
    states = any(not data.of_scene for data in before.bodies[1:])
    laws = any(element.programmed is not None for element in before.forces)
    static = before.scene.initial.state == "static"
    return same and not (static or laws or states or before.led or before.unsampled)


def _is_alike(was: Body | Drive, part: Body | Drive) -> bool:
    """Whether only numbers differ that change no table."""
    if type(was) is not type(part):
        return False
    if isinstance(part, SidBody) and (part.rigid or part.frame == "held"):
        return False
    fixed = type(part).model_fields.keys() - NUMBERS[type(part)]
    return all(getattr(was, name) == getattr(part, name) for name in fixed)


def _other_bodies(
    before: System, was: SceneFile, scene: SceneFile
) -> dict[str, BodyData] | None:
    """The data of the bodies that changed; None where they change tables."""
    known = {data.name: data for data in before.bodies}
    has_points = any(one.of_scene and not one.rotates for one in before.bodies)
    found = {}
    for name, body in scene.bodies.items():
        old, data = was.bodies[name], known[name]
        if body is old:
            continue
        if not _is_alike(old, body) or list(old.markers) != list(body.markers):
            return None
        if has_points and not _keeps_points(old, body, data):
            return None
        if isinstance(body, RigidBody):
            same = body.markers == old.markers
            nodes = data.sid.nodes if same else rigid_nodes(body.markers)
            found[name] = rigid_body(name, body, nodes)
        else:
            found[name] = data
        if found[name].rotates != data.rotates:
            return None
    return found


def _keeps_points(was: Body, body: Body, data: BodyData) -> bool:
    """Whether point masses, which have no orientation, stay where joints take them
    for places or for prescribed frames."""
    if not data.rotates:
        turned = (rotation(was.initial) != rotation(body.initial)).any()
        return was.markers == body.markers and not turned
    if isinstance(was, SidBody) or isinstance(body, SidBody):
        return True
    pairs = zip(was.markers.values(), body.markers.values(), strict=True)
    return all(a is b or (rotation(a) == rotation(b)).all() for a, b in pairs)


def _other_functions(
    before: System, was: SceneFile, scene: SceneFile
) -> tuple[Filled, dict[str, Features]] | None:
    """What functions of drives fill, and their features; None where they change more.

    They are the first rows of their table, in the order of the drives.
    """
    span = scene.time.start, scene.time.end
    filled, features = [], dict(before.features)
    for row, (name, drive) in zip(
        before.arrays.drive, scene.drives.items(), strict=False
    ):
        old = was.drives[name]
        if drive is old:
            continue
        place = f"drives.{name}.function"
        if name in scene.forces or not _is_alike(old, drive):
            return None
        found = with_other_numbers(old.function, drive.function, span, place, 2)
        if found is None:
            return None
        filled.append((int(row[at.D_DATA]), found.data))
        features[name] = together([found.features])
    return filled, features


def _with_numbers(
    before: System,
    scene: SceneFile,
    data: Mapping[str, BodyData],
    filled: Filled,
    features: Mapping[str, Features],
) -> System:
    """data : of the bodies that changed
    filled : what is known of the pool of `before`, of which that of `before.whole` is
        a continuation
    """
    new = {name: scene.bodies[name] for name in data}
    parts = {"bodies": {**before.scene.bodies, **new}, "drives": scene.drives}
    told = before.scene.model_copy(update=parts)
    bodies = {one.name: data.get(one.name, one) for one in before.bodies}
    named = Ingredients(told, bodies, {}, tuple(bodies), {}, {}, Pool())
    filled = [*filled, *_filled(before, named, data)]
    pool = before.arrays.pool.copy()
    for first, values in filled:
        pool[first : first + len(values)] = values
    whole, every = before.whole, None
    if before.every_joint is not None:
        every = partial(build_system, scene, before.sids, keep_joints=True)
    return before.with_numbers(
        scene=told,
        source=scene,
        arrays=before.arrays.replaced(pool=pool),
        bodies=tuple(bodies.values()),
        features=features,
        length=mechanism_size(told, bodies, before.markers) if data else before.length,
        whole=whole and _with_numbers(whole, scene, data, filled, features),
        every_joint=every,
    )


def _filled(
    before: System, parts: Ingredients, changed: Collection[str]
) -> Iterator[tuple[int, Array]]:
    """What the numbers of some bodies fill."""
    for name in changed:
        row = before.arrays.body[before.index(name)]
        if not parts.data[name].sid.nq:
            yield row[at.DATA], pack(parts.data[name].sid, parts.planar)
        if row[at.MOTION] == at.FREE:
            yield row[at.FRAME], free_orientation(parts, name)
    for reference, i in before.markers.items():
        if reference[0] in changed and not parts.data[reference[0]].sid.nq:
            yield before.arrays.marker[i, at.M_DATA], packed_marker(parts, reference)
