"""How large bodies are, for questions about units.

Markers and the centre of mass need not tell it: those of an eccentric disc lie a
tenth of a millimetre apart. Its inertia does, unless that is in other units itself.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import SID, Array
from sidtool.formats.sid_mass import body_size

from ...system.scene import System
from ...system.sizes import diameter

#: No body is thinner [kg/m3]: its mass over the cube of its size. A bicycle wheel has
#: 5, a satellite 30; inertia in kg mm2 instead of kg m2 gives 1e-6 of what is right.
_THINNEST = 0.1


def body_extent(system: System, name: str) -> float:
    """The size of a body [m]: between its markers and its centre of mass, or what its
    inertia tells if that is more."""
    sid = system.bodies[system.index(name)].sid
    size = body_size(sid)
    return max(marker_extent(sid), size if is_dense(sid, size) else 0.0)


def marker_extent(sid: SID) -> float:
    """The largest distance between nodes and the centre of mass [m]."""
    points: list[Array] = [node.position for node in sid.nodes]
    return diameter(np.array([*points, sid.mdCM.m0[:, 0] / (sid.mass or 1.0)]))


def is_dense(sid: SID, size: float) -> bool:
    """Whether a body of this size [m] can have the mass."""
    return bool(size > 0.0 and sid.mass >= _THINNEST * size**3)


def mechanism_extent(system: System) -> float:
    """The size of the mechanism [m], and of its largest body."""
    sizes = (body_extent(system, d.name) for d in system.bodies if d.of_scene)
    return max(system.length, *sizes, 0.0)
