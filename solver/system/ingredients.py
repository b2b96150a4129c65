"""What the tables of a scene are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sidtool.formats.scene import Joint, Marker, SceneFile, driven_coordinate
from sidtool.formats.sid import Node

from ..functions.pool import Pool
from .bodies.data import BodyData

#: Body and marker.
Reference = tuple[str, str]


@dataclass(frozen=True)
class Frame:
    """How a prescribed frame hangs on its base."""

    joint: Joint
    base: Reference
    tip: Reference
    drive: str | None


@dataclass(frozen=True, eq=False)
class Ingredients:
    """Parts of a scene that several tables refer to.

    data : data of all bodies, with the ground
    frames : bodies whose frame is prescribed
    order : bodies in the order of the tables
    drive_index : row of the function of each drive; of one that follows a law, it is
        the value at the start
    led : row of the table of forces that has the law of a drive, of those that follow
        one
    pool : where the numbers of all tables go
    """

    scene: SceneFile
    data: Mapping[str, BodyData]
    frames: Mapping[str, Frame]
    order: tuple[str, ...]
    drive_index: Mapping[str, int]
    led: Mapping[str, int]
    pool: Pool

    @property
    def planar(self) -> bool:
        return self.scene.dimension == "planar"

    def node(self, reference: Reference) -> Node:
        """The node behind a marker of a body."""
        body, marker = reference
        return self.data[body].node(marker)

    def marker_angle(self, reference: Reference) -> float:
        """Of a marker in the plane: as the scene says it, else that of its node."""
        name, marker = reference
        owner = self.scene.bodies.get(name, self.scene.ground)
        stated = owner.markers.get(marker)
        if isinstance(stated, Marker):
            return stated.angle or 0.0
        AP = self.node(reference).AP.m0
        return float(np.arctan2(AP[1, 0], AP[0, 0]))


def driven_coordinates(scene: SceneFile) -> dict[str, dict[str, str]]:
    """Drive of each driven coordinate, for all joints."""
    found: dict[str, dict[str, str]] = {name: {} for name in scene.joints}
    for name, drive in scene.drives.items():
        if drive.joint is not None:
            found[drive.joint][driven_coordinate(drive, scene.joints)] = name
    return found
