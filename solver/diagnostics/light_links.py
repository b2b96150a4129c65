"""Links so light that rounding exceeds their inertia.

Forces that pass through a link accelerate it by their difference over its inertia, and
the rounding of these forces is that of the heavy bodies. A four-bar linkage whose
coupler has 1e-12 of the mass of the rocker takes at most 1.1 times the steps; with
6e-13 it takes up to 20 times as many, and with 2e-13 it does not finish. A link
without inertia is a joint.

Sizes of bodies, for the detection of wrong units.

Markers and the centre of mass may lie much closer together than the body is large, as
those of an eccentric disc. Its inertia gives a size, unless it has a wrong unit itself.
"""

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.scene import Joint, marker_names, marker_reference
from sidtool.formats.sid_mass import body_size, central_inertia
from sidtool.formats.storage.cache import cached_by_identity

from ..initial_state.assembly import StateVectors
from ..initial_state.constraint_jacobian import jacobian_entries
from ..spatial import system_arrays as at
from ..system import work_arrays
from ..system.body_data import BodyData
from ..system.characteristic_sizes import diameter
from ..system.system import GROUND_NAME, System
from ..system.work_arrays import new_work_arrays

#: No body is thinner [kg/m3]: its mass over the cube of its size. A bicycle wheel has
#: 5, a satellite 30; inertia in kg mm2 instead of kg m2 gives 1e-6 of what is right.
_MIN_DENSITY = 0.1

#: Of the inertia of a body that it is joined to; a link below it is refused.
MIN_INERTIA_RATIO = 2e-12
#: What is advised is more than the limit by this factor.
_RECOMMENDED_FACTOR = 1.1
#: Constraints of a link are independent above this part of the largest one.
_INDEPENDENCE = 1e-8
#: Joints that hold a point of two bodies together and let them turn.
_PINS = {"planar": ("revolute", "coincident"), "spatial": ("spherical",)}


def body_extent(system: System, name: str) -> float:
    """The size of a body [m]: between its markers and its centre of mass, or what its
    inertia gives if that is more."""
    sid = system.bodies[system.index(name)].sid
    size = body_size(sid)
    return max(marker_extent(sid), size if is_dense(sid, size) else 0.0)


@cached_by_identity
def marker_extent(sid: SID) -> float:
    """The largest distance between nodes and the centre of mass [m]."""
    points: list[Array] = [node.position for node in sid.nodes]
    return diameter(np.array([*points, sid.mdCM.m0[:, 0] / (sid.mass or 1.0)]))


def is_dense(sid: SID, size: float) -> bool:
    """True if a body of this size [m] can have the mass."""
    return bool(size > 0.0 and sid.mass / size / size / size >= _MIN_DENSITY)


def mechanism_extent(system: System) -> float:
    """The size of the mechanism [m], and of its largest body."""
    sizes = (body_extent(system, d.name) for d in system.bodies if d.is_scene_body)
    return max(system.length, *sizes, 0.0)


@dataclass(frozen=True)
class _AttachedJoint:
    """A joint of a link: its name, the marker on the link and the one beside it."""

    name: str
    joint: Joint
    own: str
    other: str


def refuse_light_links(system: System, start: StateVectors) -> None:
    """Raises rigid bodies that joints hold, whose inertia rounding hides.

    Parameters
    ----------
    start
        The assembled start.

    Raises
    ------
    InputError
        Names the body, and the joint that replaces it.
    """
    attached = _joints_by_body(system)
    ranges = {
        data.name: _inertia_range(data.sid, system.planar, data.rotates)
        if data.is_scene_body and data.sid.mass
        else (0.0, 0.0)
        for data in system.bodies
    }
    for b, data in enumerate(system.bodies):
        links = attached.get(data.name, [])
        neighbours = [marker_reference(link.other)[0] for link in links]
        others = [name for name in neighbours if name != GROUND_NAME]
        if data.sid.nq or len(links) < 2 or not others or not data.is_scene_body:
            continue
        least, heavy = ranges[data.name][0], max(others, key=lambda n: ranges[n][1])
        heaviest = ranges[heavy][1]
        limit = MIN_INERTIA_RATIO * heaviest
        if 0.0 < least < limit and _transmits_forces(system, start, b):
            raise InputError(
                f"has an inertia of {least / heaviest:.1g} of that of {heavy}, "
                "which rounding hides in the forces that pass through it",
                place=f"bodies.{data.name}",
                expected=_replacement_text(system, data, links, limit),
            )


def _joints_by_body(system: System) -> dict[str, list[_AttachedJoint]]:
    joints: dict[str, list[_AttachedJoint]] = {}
    for name, joint in system.scene.joints.items():
        ends: dict[str, str] = {}
        for text in marker_names(joint):
            ends.setdefault(marker_reference(text)[0], text)
        for body, own in ends.items():
            for other in (text for end_body, text in ends.items() if end_body != body):
                joints.setdefault(body, []).append(
                    _AttachedJoint(name, joint, own, other)
                )
    return joints


@cached_by_identity
def _inertia_range(sid: SID, planar: bool, rotates: bool) -> tuple[float, float]:
    """The smallest and the largest of mass and moments of inertia over the square of
    the size of a body [kg]; of moments the largest, as rods may rotate about
    themselves.
    """
    size = _marker_distance(sid)
    if not rotates or not size:
        return sid.mass, sid.mass
    axes = slice(2, 3) if planar else slice(0, 3)
    moments = central_inertia(sid)[axes, axes]
    rotational_inertia = float(np.linalg.eigvalsh(moments)[-1]) / size**2
    return min(sid.mass, rotational_inertia), max(sid.mass, rotational_inertia)


def _marker_distance(sid: SID) -> float:
    """Between the markers of a body [m], zero without any."""
    places = [node.position for node in sid.nodes]
    return diameter(np.array(places)) if places else 0.0


def _transmits_forces(system: System, start: StateVectors, b: int) -> bool:
    """True if joints leave a body no motion but a spin, and hold it more than once."""
    row = system.arrays.body[b]
    first, count = int(row[at.VEL]), int(row[at.RD])
    if not count:
        return False
    work, t = new_work_arrays(system), system.scene.time.start
    work.interval_time[0] = float(system.clocks(np.array([t]))[0])
    work_arrays.evaluate(system, work, t, start.z, start.v)
    rows, columns, values = jacobian_entries(system, work.C)
    own = (columns >= first) & (columns < first + count)
    _, number = np.unique(rows[own], return_inverse=True)
    C: Array = np.zeros((int(number.max(initial=-1)) + 1, count))
    np.add.at(C, (number, columns[own] - first), values[own])
    axes = 2 if system.planar else 3
    C[:, axes:] /= _marker_distance(system.bodies[b].sid) or 1.0
    sizes = np.linalg.svd(C, compute_uv=False)
    rank = int(np.sum(sizes > _INDEPENDENCE * sizes.max(initial=0.0)))
    return len(C) > rank >= count - (0 if system.planar else 1)


def _replacement_text(
    system: System, data: BodyData, links: list[_AttachedJoint], limit: float
) -> str:
    """The joint that does what a link without inertia does."""
    pins = _PINS["planar" if system.planar else "spatial"]
    moment = limit * _marker_distance(data.sid) ** 2
    suggestion = f"a mass of {_RECOMMENDED_FACTOR * limit:.2g} kg or more"
    if data.rotates:
        suggestion += (
            f" and moments of inertia of {_RECOMMENDED_FACTOR * moment:.2g} kg "
            "m2 or more"
        )
    if len(links) != 2 or any(link.joint.type not in pins for link in links):
        return (
            f"joints between the bodies that it connects in its place, or {suggestion}"
        )
    one, two = links
    ends = [data.node(marker_reference(link.own)[1]).position for link in links]
    length = float(np.linalg.norm(ends[1] - ends[0]))
    return (
        f"in the place of {data.name}, {one.name} and {two.name} a joint of type "
        f'distance, markers = ["{one.other}", "{two.other}"], length = {length:.6g}; '
        f"or {suggestion}"
    )
