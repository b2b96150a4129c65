"""A scene in Exudyn: rigid bodies and SIDs, pins, hinges, seats, loads, bushings.

Flexible bodies are `ObjectFFRFreducedOrder` with the arrays that sidtool exports. In
the plane their motion out of it is locked, and rigid bodies are those of the plane.
What a scene has beside that is refused.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.scene import SceneFile

from .exudyn_body import add_body, exudyn

GROUND = "ground"


@dataclass(frozen=True)
class ExudynSettings:
    """Step [s], tolerance of Newton's iteration, and the solver of linear equations."""

    step: float
    tolerance: float
    sparse: bool


def run(
    scene: SceneFile, sids: Mapping[str, SID], settings: ExudynSettings
) -> tuple[dict[str, Array], float]:
    """Positions x, y, z of the recorded markers at the output times, and the seconds.

    Parameters
    ----------
    sids : by the names of the bodies

    Raises
    ------
    ImportError : Exudyn is not installed.
    ValueError : the scene has something that is not translated.
    RuntimeError : Exudyn found no solution.
    """
    exu = exudyn()
    machine = _Machine(exu, scene, sids)
    machine.mbs.Assemble()
    chosen = _settings(exu, scene, settings)
    began = time.perf_counter()
    machine.mbs.SolveDynamic(chosen, showHints=False)
    seconds = time.perf_counter() - began
    values = {}
    for name, sensor in machine.sensors.items():
        rows = machine.mbs.GetSensorStoredData(sensor)
        for axis, column in zip("xyz", rows[:, 1:].T, strict=True):
            values[f"{name}.{axis}"] = column
    return values, seconds


class _Machine:
    """A system of Exudyn under construction.

    Attributes
    ----------
    mbs : the system
    sensors : by the names of the recorded markers
    """

    def __init__(self, exu: Any, scene: SceneFile, sids: Mapping[str, SID]) -> None:
        from exudyn import itemInterface

        self.exu, self.items, self.scene, self.sids = exu, itemInterface, scene, sids
        self.planar = scene.dimension == "planar"
        container = exu.SystemContainer()
        self.mbs = container.AddSystem()
        self.mbs.variables["container"] = container  # keeps it alive
        self.ground = self.mbs.AddObject(itemInterface.ObjectGround())
        self.markers: dict[str, int] = {}
        for name, marker in scene.ground.markers.items():
            self._body_marker(f"{GROUND}.{name}", self.ground, marker.position)
        self._body_marker(GROUND, self.ground, (0.0, 0.0, 0.0))
        for name, body in scene.bodies.items():
            if name in sids:
                self._flexible(name, body)
            else:
                self._rigid(name, body)
        for joint in scene.joints.values():
            self._joint(joint)
        for force in scene.forces.values():
            self._force(force)
        kind = exu.OutputVariableType.Position
        self.sensors = {
            name: self.mbs.AddSensor(
                itemInterface.SensorMarker(
                    markerNumber=self.markers[name],
                    storeInternal=True,
                    outputVariableType=kind,
                )
            )
            for name in dict.fromkeys(o.rsplit(".", 1)[0] for o in scene.outputs.record)
        }

    def _body_marker(self, name: str, body: int, position: Any) -> None:
        kind = (
            self.items.MarkerBodyPosition if self.planar else self.items.MarkerBodyRigid
        )
        self.markers[name] = self.mbs.AddMarker(
            kind(bodyNumber=body, localPosition=_vector(position))
        )

    def _gravity(self, body: int) -> None:
        gravity = _vector(self.scene.gravity)
        if any(gravity):
            marker = self.mbs.AddMarker(self.items.MarkerBodyMass(bodyNumber=body))
            self.mbs.AddLoad(
                self.items.LoadMassProportional(markerNumber=marker, loadVector=gravity)
            )

    def _rigid(self, name: str, body: Any) -> None:
        """A rigid body whose node is its centre of mass, where its frame is, too."""
        initial, items = body.initial, self.items
        if self.planar:
            node = self.mbs.AddNode(
                items.NodeRigidBody2D(
                    referenceCoordinates=[*_vector(initial.position)[:2], 0.0],
                )
            )
            centre = body.centre_of_mass or (0.0, 0.0)
            number = self.mbs.AddObject(
                items.ObjectRigidBody2D(
                    mass=body.mass,
                    inertia=body.inertia + body.mass * float(np.dot(centre, centre)),
                    centerOfMass=list(centre),
                    nodeNumber=node,
                )
            )
        else:
            if body.centre_of_mass is not None:
                raise ValueError(f"bodies.{name}.centre_of_mass is not translated")
            node = self._frame(initial)
            number = self.mbs.AddObject(
                items.ObjectRigidBody(
                    mass=body.mass,
                    inertia=[*np.broadcast_to(body.inertia, 3), 0.0, 0.0, 0.0],
                    nodeNumber=node,
                )
            )
        self._gravity(number)
        if not self.planar:
            self._body_marker(name, number, (0.0, 0.0, 0.0))
        for marker, data in body.markers.items():
            self._body_marker(f"{name}.{marker}", number, data.position)

    def _frame(self, initial: Any) -> int:
        """A node of a body in space without initial rotation: Euler parameters."""
        spin = 0.5 * np.array(_vector(initial.angular_velocity))
        return int(
            self.mbs.AddNode(
                self.items.NodeRigidBodyEP(
                    referenceCoordinates=[
                        *_vector(initial.position),
                        1.0,
                        0.0,
                        0.0,
                        0.0,
                    ],
                    initialVelocities=[*_vector(initial.velocity), 0.0, *spin],
                )
            )
        )

    def _flexible(self, name: str, body: Any) -> None:
        sid, initial, items = self.sids[name], body.initial, self.items
        if self.planar:
            frame = self.mbs.AddNode(
                items.NodeRigidBodyRxyz(
                    referenceCoordinates=[*_vector(initial.position), 0.0, 0.0, 0.0]
                )
            )
            for coordinate in (2, 3, 4):
                self._lock(frame, coordinate)
        else:
            frame = self._frame(initial)
        nodes = list(dict.fromkeys(str(node) for node in body.markers.values()))
        number, _, mesh_nodes = add_body(self.exu, self.mbs, sid, nodes, frame)
        self._gravity(number)
        for marker, node in body.markers.items():
            centre, *arms = mesh_nodes[nodes.index(str(node))]
            if self.planar:
                made = items.MarkerSuperElementPosition(
                    bodyNumber=number, meshNodeNumbers=[centre], weightingFactors=[1.0]
                )
            else:
                made = items.MarkerSuperElementRigid(
                    bodyNumber=number,
                    meshNodeNumbers=arms,
                    weightingFactors=[1.0 / len(arms)] * len(arms),
                )
            self.markers[f"{name}.{marker}"] = self.mbs.AddMarker(made)

    def _lock(self, node: int, coordinate: int) -> None:
        items = self.items
        ground = self.mbs.AddMarker(
            items.MarkerNodeCoordinate(
                nodeNumber=self.mbs.AddNode(items.NodePointGround()), coordinate=0
            )
        )
        marker = self.mbs.AddMarker(
            items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate)
        )
        self.mbs.AddObject(items.CoordinateConstraint(markerNumbers=[ground, marker]))

    def _joint(self, joint: Any) -> None:
        pair = [self.markers[name] for name in joint.markers]
        items = self.items
        if joint.type == "revolute" and self.planar:
            made = items.SphericalJoint(markerNumbers=pair, constrainedAxes=[1, 1, 0])
        elif joint.type == "revolute":
            turned = _axis_to_z(joint.axis or (0.0, 0.0, 1.0))
            made = items.ObjectJointRevoluteZ(
                markerNumbers=pair, rotationMarker0=turned, rotationMarker1=turned
            )
        elif joint.type == "fixed" and not self.planar:
            made = items.GenericJoint(markerNumbers=pair)
        else:
            raise ValueError(f"joints of type {joint.type} are not translated")
        self.mbs.AddObject(made)

    def _force(self, force: Any) -> None:
        items = self.items
        if force.type == "bushing":
            pair = [self.markers[name] for name in force.markers]
            self.mbs.AddObject(
                items.CartesianSpringDamper(
                    markerNumbers=pair,
                    stiffness=list(force.stiffness)[:3],
                    damping=list(force.damping)[:3],
                )
            )
            return
        if force.type != "force" or force.function is not None:
            raise ValueError(f"forces of type {force.type} are not translated")
        marker = self.markers[force.marker]
        if force.force is not None:
            vector = _vector(force.force)
            self.mbs.AddLoad(
                items.LoadForceVector(markerNumber=marker, loadVector=vector)
            )
        if force.torque is not None:
            raise ValueError("torques are not translated")


def _vector(given: Any) -> list[float]:
    """Three components of a vector that is left out, or has two."""
    return [*(given or ()), 0.0, 0.0, 0.0][:3]


def _axis_to_z(axis: Any) -> Array:
    """A rotation matrix whose third column is the axis."""
    third = np.array(axis, float) / np.linalg.norm(axis)
    first = np.cross(np.eye(3)[np.argmin(np.abs(third))], third)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(third, first), third])


def _settings(exu: Any, scene: SceneFile, given: ExudynSettings) -> Any:
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps = round(scene.time.end / given.step)
    integration.endTime = scene.time.end
    integration.generalizedAlpha.spectralRadius = 0.8
    integration.newton.useModifiedNewton = True
    integration.newton.relativeTolerance = given.tolerance
    integration.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = scene.time.output_step
    kinds = exu.LinearSolverType
    kind = kinds.EigenSparse if given.sparse else kinds.EXUdense
    settings.linearSolver.solverType = kind
    return settings
