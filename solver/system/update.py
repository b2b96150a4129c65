"""Update of a compiled scene with other parameters of bodies and drives.

Tables other than the real data stay the same as long as only masses, positions, initial
values and functions of time change.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.scene import (
    Body,
    Drive,
    RigidBody,
    SceneFile,
    SidBody,
    orientation_matrix,
)
from sidtool.formats.toml.tables import Table

from ..functions.function_table import RealData, replacement_entry
from ..functions.piecewise import Features, merge_features
from ..spatial import system_arrays as at
from .body_data import BodyData, rigid_body, rigid_nodes, with_held_frames
from .body_table import constant_orientation, pack_marker
from .build import build_system
from .build_inputs import BuildInputs
from .characteristic_sizes import mechanism_size
from .rotated_markers import find_rotations, marker_rotations
from .sid_packing import pack_sid
from .system import System

#: What may change of each kind of body, and of a drive.
CHANGEABLE_FIELDS: dict[type[Table], set[str]] = {
    RigidBody: {"mass", "inertia", "centre_of_mass", "markers", "initial"},
    SidBody: {"initial"},
    Drive: {"function"},
}
#: Where in the pool numbers begin, and they.
RealDataEntries = list[tuple[int, Array]]


def updated_system(
    before: System, scene: SceneFile, sids: Mapping[str, SID]
) -> System | None:
    """The system of a scene that differs from another one in numbers of bodies and of
    functions of drives.

    None where more changes, or where numbers of the kind that changed may decide on
    tables: orientations beside point masses and places of these, orientations that
    rotate markers of joints, flexible bodies that are held or taken as rigid, other
    breaks, and any beside laws or at static equilibrium.

    Parameters
    ----------
    before
        Of a scene without programs, as it was built with or without all joints.
    """
    previous = before.source
    if (
        previous is None
        or not _differs_in_parts_only(previous, scene)
        or not _depends_on_numbers_only(before, sids)
    ):
        return None
    data = _changed_bodies(before, previous, scene)
    functions = _changed_functions(before, previous, scene)
    if data is None or functions is None:
        return None
    if data and not _rotates_markers_as_before(before, scene, data):
        return None
    return _with_changed_numbers(before, scene, data, *functions)


def _differs_in_parts_only(previous: SceneFile, scene: SceneFile) -> bool:
    """True if all other tables are the same objects."""
    if (*previous.bodies, *previous.drives) != (*scene.bodies, *scene.drives):
        return False
    others = type(scene).model_fields.keys() - {"bodies", "drives"}
    return all(getattr(previous, name) is getattr(scene, name) for name in others)


def _depends_on_numbers_only(before: System, sids: Mapping[str, SID]) -> bool:
    """True if tables follow from the structure of the scene and numbers alone."""
    same = all(sid is before.sids.get(name) for name, sid in sids.items())
    states = any(not data.is_scene_body for data in before.bodies[1:])
    laws = any(element.control is not None for element in before.forces)
    static = before.scene.initial.state == "static"
    return same and not (
        static or laws or states or before.drive_law_rows or before.make_continuous
    )


def _rotates_markers_as_before(
    before: System, scene: SceneFile, changed: Mapping[str, BodyData]
) -> bool:
    """True if the second markers of joints are rotated as before."""
    bodies = {one.name: changed.get(one.name, one) for one in before.bodies}
    known = marker_rotations(before.scene, before.bodies)
    found = dict(find_rotations(with_held_frames(scene), bodies))
    return known.keys() == found.keys() and all(
        np.array_equal(rotation, known[name]) for name, rotation in found.items()
    )


def _has_same_structure(previous: Body | Drive, part: Body | Drive) -> bool:
    """True if only numbers differ that change no table."""
    if type(previous) is not type(part):
        return False
    if isinstance(part, SidBody) and (part.rigid or part.frame == "held"):
        return False
    fixed = type(part).model_fields.keys() - CHANGEABLE_FIELDS[type(part)]
    return all(getattr(previous, name) == getattr(part, name) for name in fixed)


def _changed_bodies(
    before: System, previous: SceneFile, scene: SceneFile
) -> dict[str, BodyData] | None:
    """The data of the bodies that changed; None where they change tables."""
    known = {data.name: data for data in before.bodies}
    has_points = any(one.is_scene_body and not one.rotates for one in before.bodies)
    bodies = {}
    for name, body in scene.bodies.items():
        old, data = previous.bodies[name], known[name]
        if body is old:
            continue
        if not _has_same_structure(old, body) or list(old.markers) != list(
            body.markers
        ):
            return None
        if has_points and not _has_same_point_masses(old, body, data):
            return None
        if isinstance(body, RigidBody):
            same = body.markers == old.markers
            nodes = data.sid.nodes if same else rigid_nodes(body.markers)
            bodies[name] = replace(
                rigid_body(name, body, nodes), rotated_markers=data.rotated_markers
            )
        else:
            bodies[name] = data
        if bodies[name].rotates != data.rotates:
            return None
    return bodies


def _has_same_point_masses(previous: Body, body: Body, data: BodyData) -> bool:
    """True if point masses, which have no orientation, stay where joints take them for
    places or for prescribed frames.
    """
    if not data.rotates:
        has_changed = (
            orientation_matrix(previous.initial) != orientation_matrix(body.initial)
        ).any()
        return previous.markers == body.markers and not has_changed
    if isinstance(previous, SidBody) or isinstance(body, SidBody):
        return True
    pairs = zip(previous.markers.values(), body.markers.values(), strict=True)
    return all(
        a is b or (orientation_matrix(a) == orientation_matrix(b)).all()
        for a, b in pairs
    )


def _changed_functions(
    before: System, previous: SceneFile, scene: SceneFile
) -> tuple[RealDataEntries, dict[str, Features]] | None:
    """What functions of drives fill, and their features; None where they change more.

    They are the first rows of their table, in the order of the drives.
    """
    span = scene.time.start, scene.time.end
    entries, features = [], dict(before.features)
    for row, (name, drive) in zip(
        before.arrays.drive, scene.drives.items(), strict=False
    ):
        old = previous.drives[name]
        if drive is old:
            continue
        place = f"drives.{name}.function"
        if name in scene.forces or not _has_same_structure(old, drive):
            return None
        entry = replacement_entry(old.function, drive.function, span, place, 2)
        if entry is None:
            return None
        entries.append((int(row[at.D_DATA]), entry.data))
        features[name] = merge_features([entry.features])
    return entries, features


def _with_changed_numbers(
    before: System,
    scene: SceneFile,
    data: Mapping[str, BodyData],
    entries: RealDataEntries,
    features: Mapping[str, Features],
) -> System:
    """Parameters
    ----------
    data
        Of the bodies that changed.
    entries
        What is known of the real data of `before`, of which that of `before.whole` is a
        continuation.
    """
    new = {name: scene.bodies[name] for name in data}
    parts = {"bodies": {**before.scene.bodies, **new}, "drives": scene.drives}
    scene_of_tables = before.scene.model_copy(update=parts)
    bodies = {one.name: data.get(one.name, one) for one in before.bodies}
    named = BuildInputs(scene_of_tables, bodies, {}, tuple(bodies), {}, {}, RealData())
    entries = [*entries, *_body_entries(before, named, data)]
    real_data = before.arrays.real_data.copy()
    for first, values in entries:
        real_data[first : first + len(values)] = values
    full, make_full_system = before.full_system, None
    if before.make_full_system is not None:
        make_full_system = partial(build_system, scene, before.sids, keep_joints=True)
    return before.with_numbers(
        scene=scene_of_tables,
        source=scene,
        arrays=before.arrays.replaced(real_data=real_data),
        bodies=tuple(bodies.values()),
        features=features,
        length=mechanism_size(scene_of_tables, bodies, before.markers)
        if data
        else before.length,
        full_system=full
        and _with_changed_numbers(full, scene, data, entries, features),
        make_full_system=make_full_system,
    )


def _body_entries(
    before: System, parts: BuildInputs, changed: Collection[str]
) -> Iterator[tuple[int, Array]]:
    """What the numbers of some bodies fill."""
    for name in changed:
        row = before.arrays.body[before.index(name)]
        if not parts.data[name].sid.nq:
            yield row[at.DATA], pack_sid(parts.data[name].sid, parts.planar)
        if row[at.MOTION] == at.FREE:
            yield row[at.FRAME], constant_orientation(parts, name)
    for reference, i in before.markers.items():
        if reference[0] in changed and not parts.data[reference[0]].sid.nq:
            yield before.arrays.marker[i, at.M_DATA], pack_marker(parts, reference)
