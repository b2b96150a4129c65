"""The founding slider-crank in Exudyn, with a reduced-order body from the same SID."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array

from .exudyn_body import add_body, exudyn

CRANK = 0.1
PISTON = 5.0
#: The drive of the scene: coefficients of t^0 ... t^7 until `REACHED`, then linear.
SPEED = 12.0 * np.pi
REACHED = 2.0


def drive_coefficients() -> Array:
    """Polynomial of degree 7 from rest to SPEED at SPEED rad, smooth to order three."""
    powers = np.vander([1.0], 8, increasing=True)[0]
    rows, right = [], []
    for derivative in range(4):
        factors = [np.prod(np.arange(k, k - derivative, -1)) for k in range(8)]
        start = np.zeros(8)
        start[derivative] = 1.0
        rows += [start, np.array(factors, float) * powers]
        right += [0.0, (SPEED, SPEED * REACHED, 0.0, 0.0)[derivative]]
    scaled = np.linalg.solve(np.array(rows), np.array(right))
    return scaled / REACHED ** np.arange(8)


def run(
    sid: SID, step: float, end: float, every: float, tolerance: float = 1e-8
) -> tuple[Array, Array, float]:
    """Solves with a fixed step; q1 and piston x at the output times, and the seconds.

    Parameters
    ----------
    every : output step [s], a multiple of `step`
    tolerance : relative, of Newton's iteration

    Raises
    ------
    ImportError : Exudyn is not installed.
    """
    exu = exudyn()
    mbs, sensors = _model(exu, sid)
    settings = _settings(exu, step, end, every)
    settings.timeIntegration.newton.relativeTolerance = tolerance
    began = time.perf_counter()
    mbs.SolveDynamic(settings)
    seconds = time.perf_counter() - began
    q1, x = (mbs.GetSensorStoredData(sensor) for sensor in sensors)
    return q1[:, 1], x[:, 1], seconds


def _model(exu: Any, sid: SID) -> tuple[Any, tuple[int, int]]:
    from exudyn import itemInterface as items

    container = exu.SystemContainer()
    mbs = container.AddSystem()
    mbs.variables["container"] = container  # keeps it alive
    zero = mbs.AddMarker(
        items.MarkerNodeCoordinate(
            nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0
        )
    )
    pin = _crank(exu, mbs, items, zero)
    frame = mbs.AddNode(
        items.NodeRigidBodyRxyz(referenceCoordinates=[CRANK, *[0.0] * 5])
    )
    body, modal, mesh_nodes = add_body(exu, mbs, sid, ("1", "2"), frame)
    near, far = (
        mbs.AddMarker(
            items.MarkerSuperElementPosition(
                bodyNumber=body, meshNodeNumbers=[centre], weightingFactors=[1.0]
            )
        )
        for centre, *_ in mesh_nodes
    )
    _join(mbs, items, pin, near)
    for coordinate in (2, 3, 4):  # in the plane
        _lock(mbs, items, frame, coordinate, zero)
    piston = mbs.AddNode(items.NodePoint2D(referenceCoordinates=[1.0 + CRANK, 0.0]))
    mbs.AddObject(items.ObjectMassPoint2D(mass=PISTON, nodeNumber=piston))
    slider = mbs.AddMarker(items.MarkerNodePosition(nodeNumber=piston))
    _join(mbs, items, slider, far)
    _lock(mbs, items, piston, 1, zero)
    kinds = exu.OutputVariableType
    sensors = tuple(
        mbs.AddSensor(
            items.SensorNode(nodeNumber=n, storeInternal=True, outputVariableType=kind)
        )
        for n, kind in ((modal, kinds.Coordinates), (piston, kinds.Position))
    )
    mbs.Assemble()
    return mbs, sensors  # type: ignore[return-value]


def _crank(exu: Any, mbs: Any, items: Any, zero: int) -> int:
    """A wheel whose angle is prescribed; the marker of its pin."""
    angle = mbs.AddNode(items.Node1D(referenceCoordinates=[0.0]))
    crank = mbs.AddObject(items.ObjectRotationalMass1D(inertia=1e-3, nodeNumber=angle))
    driven = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=angle, coordinate=0))
    drive = _drive_function(exu, mbs)
    mbs.variables["drive"] = drive  # keeps it alive
    mbs.AddObject(
        items.CoordinateConstraint(
            markerNumbers=[zero, driven], offsetUserFunction=drive
        )
    )
    return int(
        mbs.AddMarker(
            items.MarkerBodyPosition(bodyNumber=crank, localPosition=[CRANK, 0.0, 0.0])
        )
    )


def _drive_function(exu: Any, mbs: Any) -> Any:
    """The angle as Exudyn's own expression: no call of Python in the time loop."""
    from exudyn.advancedUtilities import CreateSymbolicUserFunction

    coefficients = drive_coefficients()

    def angle(mbs: Any, t: Any, itemNumber: Any, lOffset: Any) -> Any:  # noqa: N803
        value = coefficients[-1]
        for coefficient in coefficients[-2::-1]:
            value = coefficient + t * value
        late = SPEED + SPEED * (t - REACHED)
        return exu.symbolic.IfThenElse(t < REACHED, value, late)

    return CreateSymbolicUserFunction(
        mbs,
        angle,
        "offsetUserFunction",
        itemTypeName="ObjectConnectorCoordinate",
    )


def _join(mbs: Any, items: Any, first: int, second: int) -> None:
    """Coincident points in the plane."""
    mbs.AddObject(
        items.SphericalJoint(markerNumbers=[first, second], constrainedAxes=[1, 1, 0])
    )


def _lock(mbs: Any, items: Any, node: int, coordinate: int, zero: int) -> None:
    marker = mbs.AddMarker(
        items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate)
    )
    mbs.AddObject(items.CoordinateConstraint(markerNumbers=[zero, marker]))


def _settings(exu: Any, step: float, end: float, every: float) -> Any:
    settings = exu.SimulationSettings()
    time_integration = settings.timeIntegration
    time_integration.numberOfSteps = round(end / step)
    time_integration.endTime = end
    time_integration.generalizedAlpha.spectralRadius = 0.8
    time_integration.newton.useModifiedNewton = True
    time_integration.verboseMode = 0
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = every
    settings.linearSolverType = exu.LinearSolverType.EXUdense
    return settings
