"""Sizes of bodies, for the detection of wrong units.

Markers and the centre of mass may lie much closer together than the body is large, as
those of an eccentric disc. Its inertia gives a size, unless it has a wrong unit itself.
"""

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.sid_mass import body_size

from ..system.characteristic_sizes import diameter
from ..system.system import System

#: No body is thinner [kg/m3]: its mass over the cube of its size. A bicycle wheel has
#: 5, a satellite 30; inertia in kg mm2 instead of kg m2 gives 1e-6 of what is right.
_MIN_DENSITY = 0.1


def body_extent(system: System, name: str) -> float:
    """The size of a body [m]: between its markers and its centre of mass, or what its
    inertia gives if that is more."""
    sid = system.bodies[system.index(name)].sid
    size = body_size(sid)
    return max(marker_extent(sid), size if is_dense(sid, size) else 0.0)


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
