"""Beams by tables of stations, for tests."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg

from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.sid import Array
from sidtool.formats.model import ModelFile

LENGTH = 8.0
#: A uniform mast; inertia of its own, and centres beside the axis.
UNIFORM = {
    "position": [0.0, LENGTH],
    "mass_per_length": [30.0, 30.0],
    "EA": [2e8, 2e8],
    "EI_y": [4e6, 4e6],
    "EI_z": [1e6, 1e6],
    "GJ": [8e5, 8e5],
    "GA_y": [3e7, 3e7],
    "GA_z": [2e7, 2e7],
    "inertia_y": [0.9, 0.9],
    "inertia_z": [0.4, 0.4],
}


def model(
    sections: Any,
    length: float = LENGTH,
    elements: int = 4,
    theory: str | None = "timoshenko",
    **changes: Any,
) -> ModelFile:
    """A beam along x, clamped at its start."""
    data: dict[str, Any] = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {
            "type": "beam",
            "start": [0.0, 0.0, 0.0],
            "end": [length, 0.0, 0.0],
            "sections": sections,
        },
        "discretisation": {"type": "beam", "elements": elements, "theory": theory},
        "frame": {"type": "tangent", "marker": "root", "clamp": "start"},
        "markers": {
            "root": {"node": 1, "edge": "start"},
            "tip": {"node": 2, "edge": "end"},
        },
        "reduction": {"method": "modal", "modes": 6},
    }
    if theory is None:
        del data["discretisation"]["theory"]
    return ModelFile.checked(data | changes, "model")


def tip_compliance(body: FiniteElementModel) -> Array:
    """(6, 6) motion of the tip by forces and moments there, clamped at the root."""
    return np.linalg.inv(body.stiffness.toarray()[6:, 6:])[-6:, -6:]


def frequencies(body: FiniteElementModel, count: int) -> Array:
    """Of the cantilever [Hz]."""
    k, m = body.stiffness.toarray()[6:, 6:], body.mass.toarray()[6:, 6:]
    values = scipy.linalg.eigh(k, m, eigvals_only=True, subset_by_index=[0, count - 1])
    return np.sqrt(values) / (2 * np.pi)


def matrices(table: dict[str, list[float]]) -> dict[str, Any]:
    """The same stations by matrices about the axis, built from strain energy."""
    stiffness, mass = [], []
    for k in range(len(table["EA"])):
        value = {name: column[k] for name, column in table.items()}
        y, z = value.get("tension_y", 0.0), value.get("tension_z", 0.0)
        ys, zs = value.get("shear_y", 0.0), value.get("shear_z", 0.0)
        stretch = np.array([1, 0, 0, 0, z, -y])
        shear = np.array([[0, 1, 0, -zs, 0, 0], [0, 0, 1, ys, 0, 0]])
        own = value["EA"] * np.outer(stretch, stretch)
        own += value["GA_y"] * np.outer(shear[0], shear[0])
        own += value["GA_z"] * np.outer(shear[1], shear[1])
        stiffness.append(
            own + np.diag([0, 0, 0, value["GJ"], value["EI_y"], value["EI_z"]])
        )
        ym, zm = value.get("mass_y", 0.0), value.get("mass_z", 0.0)
        moved = np.eye(6)[:3].copy()
        moved[:, 3:] = [[0, zm, -ym], [-zm, 0, 0], [ym, 0, 0]]
        tensor = np.zeros((6, 6))
        iy, iz, iyz = (
            value["inertia_y"],
            value["inertia_z"],
            value.get("inertia_yz", 0.0),
        )
        tensor[3:, 3:] = [[iy + iz, 0, 0], [0, iy, -iyz], [0, -iyz, iz]]
        mass.append(value["mass_per_length"] * moved.T @ moved + tensor)
    return {
        "position": table["position"],
        "stiffness": np.array(stiffness).tolist(),
        "mass": np.array(mass).tolist(),
    }


def eccentric() -> dict[str, list[float]]:
    offsets = {
        "mass_y": 0.03,
        "mass_z": -0.05,
        "tension_y": -0.02,
        "tension_z": 0.04,
        "shear_y": 0.06,
        "shear_z": 0.01,
        "inertia_yz": 0.2,
    }
    return UNIFORM | {name: [value, value] for name, value in offsets.items()}
