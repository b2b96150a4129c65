"""Shared inputs of the tables of a scene."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sidtool.formats.base.sid import Node
from sidtool.formats.scene import Joint, Marker, SceneFile, driven_coordinate

from ..functions.function_table import RealData
from .body_data import BodyData

#: Body and marker.
MarkerKey = tuple[str, str]


@dataclass(frozen=True)
class PrescribedFrame:
    """How a prescribed frame hangs on its base."""

    joint: Joint
    base: MarkerKey
    tip: MarkerKey
    drive: str | None


@dataclass(frozen=True, eq=False)
class BuildInputs:
    """Parts of a scene that several tables refer to.

    data : data of all bodies, with the ground
    frames : bodies whose frame is prescribed
    order : bodies in the order of the tables
    drive_index : row of the function of each drive; of one that follows a law, it is
        the value at the start
    drive_law_rows : row of the force table with the law of a drive, by drives with one
    real_data : where the numbers of all tables go
    input_rows : row of the function of each input
    """

    scene: SceneFile
    data: Mapping[str, BodyData]
    frames: Mapping[str, PrescribedFrame]
    order: tuple[str, ...]
    drive_index: Mapping[str, int]
    drive_law_rows: Mapping[str, int]
    real_data: RealData
    input_rows: Mapping[str, int] = field(default_factory=dict)

    @property
    def planar(self) -> bool:
        return self.scene.dimension == "planar"

    def node(self, reference: MarkerKey) -> Node:
        """The node behind a marker of a body."""
        body, marker = reference
        return self.data[body].node(marker)

    def marker_angle(self, reference: MarkerKey) -> float:
        """Of a marker in the plane: as the scene says it, else that of its node."""
        name, marker = reference
        owner = self.scene.bodies.get(name, self.scene.ground)
        specified = owner.markers.get(marker)
        if isinstance(specified, Marker):
            return specified.angle or 0.0
        AP = self.node(reference).AP.m0
        return float(np.arctan2(AP[1, 0], AP[0, 0]))


def driven_coordinates(scene: SceneFile) -> dict[str, dict[str, str]]:
    """Drive of each driven coordinate, for all joints."""
    coordinates: dict[str, dict[str, str]] = {name: {} for name in scene.joints}
    for name, drive in scene.drives.items():
        if drive.joint is not None:
            coordinates[drive.joint][driven_coordinate(drive, scene.joints)] = name
    return coordinates
