"""A body in Exudyn, made of the exported arrays, moves as in sidtool."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.base.sid import Array

from .test_superelement import CRAIG_BAMPTON, rod

SPIN = (3.0, -4.0, 12.0)
FORCE, TORQUE = (5.0, 20.0, -10.0), (2.0, 1.0, -1.5)
END = 0.02


def flexible_rod() -> sidtool.SID:
    """A rod with offsets of its frame in no symmetric place: all integrals count."""
    section = {"shape": "rectangle", "height": 0.02, "width": 0.03}
    geometry = {
        "type": "beam",
        "start": [0.1, -0.2, 0.3],
        "through": [[0.4, 0.1, 0.3]],
        "end": [0.9, 0.2, 0.5],
        "section": section,
    }
    frame = {"type": "buckens", "marker": "a"}
    reduction = CRAIG_BAMPTON | {"modes": 2}
    return sidtool.convert(rod(frame, geometry=geometry, reduction=reduction))


def motion_in_exudyn(arrays: Any, step: float) -> Array:
    """Position of node 2 at the end."""
    import exudyn as exu
    from exudyn import itemInterface as items

    container = exu.SystemContainer()
    mbs = container.AddSystem()
    frame = mbs.AddNode(
        items.NodeRigidBodyEP(
            referenceCoordinates=[0, 0, 0, 1, 0, 0, 0],
            initialVelocities=[0, 0, 0, 0, *(w / 2 for w in SPIN)],
        )
    )
    count = len(arrays["massMatrixReduced"])
    zero = [0.0] * count
    modal = mbs.AddNode(
        items.NodeGenericODE2(
            numberOfODE2Coordinates=count,
            referenceCoordinates=zero,
            initialCoordinates=zero,
            initialCoordinates_t=zero,
        )
    )
    given = {}
    for name, value in arrays.items():
        if name.endswith("MatrixReduced"):
            given[name] = exu.MatrixContainer()
            given[name].SetWithDenseMatrix(value, useDenseMatrix=True)
        elif not name.endswith(("Names", "Nodes")):
            given[name] = float(value) if value.ndim == 0 else value
    body = mbs.AddObject(
        items.ObjectFFRFreducedOrder(nodeNumbers=[frame, modal], **given)
    )
    mesh_nodes = arrays["markerNodes"][1]
    marker = mbs.AddMarker(
        items.MarkerSuperElementRigid(
            bodyNumber=body,
            meshNodeNumbers=mesh_nodes[1:].tolist(),
            weightingFactors=[1 / 6] * 6,
        )
    )
    mbs.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=FORCE))
    mbs.AddLoad(items.LoadTorqueVector(markerNumber=marker, loadVector=TORQUE))
    sensor = mbs.AddSensor(
        items.SensorMarker(
            markerNumber=marker,
            storeInternal=True,
            outputVariableType=exu.OutputVariableType.Position,
        )
    )
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(END / step)
    settings.timeIntegration.endTime = END
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    settings.timeIntegration.newton.relativeTolerance = 1e-10
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = END
    mbs.SolveDynamic(settings)
    return np.asarray(mbs.GetSensorStoredData(sensor)[-1, 1:])


def scene(sid_file: str) -> sidtool.Scene:
    return sidtool.Scene.model_validate(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial",
            "time": {"end": END, "output_step": END},
            "bodies": {
                "rod": {
                    "sid": sid_file,
                    "markers": {"a": 1, "b": 2},
                    "initial": {"angular_velocity": list(SPIN)},
                }
            },
            "forces": {
                "pull": {
                    "type": "force",
                    "marker": "rod.b",
                    "force": list(FORCE),
                    "torque": list(TORQUE),
                }
            },
            "accuracy": {"rtol": 1e-7},
            "outputs": {"record": ["rod.b.*"]},
        }
    )


@pytest.mark.needs("exudyn")
def test_free_flight_with_a_force_and_a_torque(tmp_path: Path) -> None:
    sid = flexible_rod()
    sidtool.write(tmp_path / "rod.h5", sid)
    sidtool.export_body(tmp_path / "rod.npz", sid)
    with np.load(tmp_path / "rod.npz") as arrays:
        coarse, fine = (motion_in_exudyn(dict(arrays), h) for h in (1e-4, 5e-5))
    result = scene(str(tmp_path / "rod.h5")).simulate()
    place = np.array([result[f"rod.b.{axis}"][-1] for axis in "xyz"])
    deflection = np.array([result[f"rod.b.u{axis}"][-1] for axis in "xyz"])
    limit = (4 * fine - coarse) / 3  # of a method of second order
    assert np.abs(deflection).max() > 1e-4
    assert limit == pytest.approx(place, abs=1e-6)
