"""Checks of forces: what they act on exists, and has as many components as they."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from ..forces import Bushing, Characteristic, Force, Friction, PointForce, SpringDamper
from ..values import check_length
from .failures import fail, known_names
from .functions import check_function
from .references import check_reference

if TYPE_CHECKING:
    from ..file import SceneFile


def check_force(force: Force, place: str, scene: SceneFile) -> None:
    """Raise what does not fit in a force as `InputError` with its key."""
    if isinstance(force, PointForce):
        check_reference(force.marker, f"{place}.marker", scene)
        _check_components(force, place, scene)
    elif isinstance(force, Friction):
        _check_joint(force.joint, force.coordinate, place, scene)
    else:
        _check_pair(force, place, scene)
    if isinstance(force, SpringDamper):
        _check_spring(force, place)
    if isinstance(force, Bushing):
        _check_bushing(force, place, scene)
    function = getattr(force, "function", None)
    if function is not None:
        check_function(function, f"{place}.function", scene.time)


def _check_components(force: PointForce, place: str, scene: SceneFile) -> None:
    if force.force is None and force.torque is None:
        fail(place, "has neither force nor torque", "components of one of them")
    check_length(force.force, f"{place}.force", scene.dimension)
    spatial = isinstance(force.torque, tuple)
    if force.torque is not None and spatial != (scene.dimension == "spatial"):
        wanted = "three numbers" if scene.dimension == "spatial" else "a number"
        fail(f"{place}.torque", f"does not fit a {scene.dimension} scene", wanted)


def _check_pair(force: Force, place: str, scene: SceneFile) -> None:
    markers, joint = getattr(force, "markers", None), getattr(force, "joint", None)
    if (markers is None) == (joint is None):
        found = "both are given" if joint is not None else "neither is given"
        fail(place, found, "one of markers and joint")
    if joint is not None:
        _check_joint(joint, getattr(force, "coordinate", None), place, scene)
        return
    assert markers is not None
    for index, text in enumerate(markers):
        check_reference(text, f"{place}.markers[{index}]", scene)
    if markers[0] == markers[1]:
        fail(f"{place}.markers", "are the same", "two different markers")


def _check_joint(
    name: str, coordinate: str | None, place: str, scene: SceneFile
) -> None:
    joint = scene.joints.get(name)
    if joint is None:
        expected = known_names(name, scene.joints, "joint")
        fail(f"{place}.joint", f"there is no joint {name!r}", expected)
    if not joint.coordinates:
        found = f"{name} is of type {joint.type}"
        expected = "a joint with a coordinate, such as revolute or prismatic"
        fail(f"{place}.joint", found, expected)
    if coordinate is not None and coordinate not in joint.coordinates:
        found = f"{name} has no coordinate {coordinate!r}"
        fail(f"{place}.coordinate", found, " or ".join(joint.coordinates))


def _check_spring(force: SpringDamper, place: str) -> None:
    if force.stiffness is not None and force.table is not None:
        fail(f"{place}.table", "stands beside stiffness", "one of them")
    if force.table is not None:
        _check_table(force.table, f"{place}.table")
    elif force.stiffness is None and force.damping is None:
        fail(place, "does nothing", "stiffness, table or damping")


def _check_table(table: Characteristic, place: str) -> None:
    if len(table.force) != len(table.deflection):
        found = f"has {len(table.force)} values for {len(table.deflection)}"
        fail(f"{place}.force", found, "one value for each deflection")
    for earlier, later in pairwise(table.deflection):
        if not later > earlier:
            found = f"{later} follows {earlier}"
            fail(f"{place}.deflection", found, "growing values")


def _check_bushing(force: Bushing, place: str, scene: SceneFile) -> None:
    count = 3 if scene.dimension == "planar" else 6
    if force.shaft and count == 3:
        fail(
            f"{place}.shaft", "found in a planar scene", "a bushing that turns about z"
        )
    for key in ("stiffness", "damping"):
        values = getattr(force, key)
        if values is None:
            continue
        what = f"{count} values or a {count} x {count} matrix"
        expected = f"{what} in a {scene.dimension} scene"
        if len(values) != count:
            fail(f"{place}.{key}", f"found {len(values)} values", expected)
        for row in values:
            if isinstance(row, tuple) and len(row) != count:
                found = f"found a row of {len(row)} values"
                fail(f"{place}.{key}", found, expected)
