"""Error of the frequency response at the piston pin against the number of shapes.

    python benchmarks/reduction_methods.py [FOLDER]

Prints a table and writes reduction_methods.png into FOLDER (here by default). The rod
of the slider-crank, 150 x 10 quadrilaterals, clamped at the crank; response to forces
and a moment at the piston pin between 1 and 1500 Hz, with 2 % structural damping.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from formats.model import ModelFile
from formats.toml_files import read_data, validated
from sidtool.convert import finite_element_model
from sidtool.frontends.finite_element_model import FiniteElementModel
from sidtool.plot.figure import figure
from sidtool.reduction.frames import FRAMES, motion_rows
from sidtool.reduction.methods import REDUCTIONS

ROD = Path(__file__).parents[1] / "examples" / "slider_crank" / "rod_q4.toml"
PIN = ["piston_pin"]
FREQUENCIES = np.linspace(1, 1500, 60)
LOSS = 0.02


def settings(method: str, size: int) -> dict[str, Any]:
    """A method with about `size` shape functions."""
    if method == "modal":
        return {"method": "modal", "modes": size}
    if method == "krylov":
        points = np.linspace(0, 1500, max(1, size // 3)).tolist()
        return {"method": "krylov", "interfaces": PIN, "frequencies": points}
    return {"method": method, "interfaces": PIN, "modes": max(0, size - 3)}


def full_response(body: FiniteElementModel, loads: np.ndarray) -> np.ndarray:
    """(nf, 3, 3) receptance of the whole model."""
    held = body.dofs(body.node_sets["left"])
    free = np.setdiff1d(np.arange(body.ndof), held)
    k = body.stiffness[free][:, free] * (1 + 1j * LOSS)
    m = body.mass[free][:, free]
    inputs = loads[free].astype(complex)
    return np.array(
        [
            loads[free].T @ splu(sp.csc_matrix(k - w * w * m)).solve(inputs)
            for w in 2 * np.pi * FREQUENCIES
        ]
    )


def response(stiffness: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """(nf, 3, 3) receptance of a mass-normalised reduced model."""
    eye = np.eye(len(stiffness))
    return np.array(
        [
            inputs.T
            @ np.linalg.solve(stiffness * (1 + 1j * LOSS) - w * w * eye, inputs)
            for w in 2 * np.pi * FREQUENCIES
        ]
    )


def main(folder: Path) -> None:
    """Tabulate and plot."""
    data = read_data(ROD)
    body = finite_element_model(validated(data, ModelFile))
    loads = motion_rows(body, body.marker("piston_pin")).T
    exact = full_response(body, loads)
    largest = np.abs(np.einsum("fii->fi", exact)).max(axis=0)
    scale = np.sqrt(np.outer(largest, largest))
    methods = [name for name in REDUCTIONS if name != "user"]
    curves: dict[str, list[tuple[int, float]]] = {name: [] for name in methods}
    for name in methods:
        for size in (3, 6, 9, 12, 18, 24, 36):
            model = validated(data | {"reduction": settings(name, size)}, ModelFile)
            frame = FRAMES["tangent"](body, model.frame)
            basis = REDUCTIONS[name](body, frame, model.reduction)
            found = response(basis.stiffness, basis.shapes.T @ loads)
            error = float((np.abs(found - exact).max(axis=0) / scale).max())
            curves[name].append((len(basis.labels), error))
    for name, points in curves.items():
        row = "  ".join(f"{n:3d}: {error:.1e}" for n, error in points)
        print(f"{name:14s} {row}")
    path = folder / "reduction_methods.png"
    with figure(path, 1, 1, size=(7.0, 4.5)) as axes:
        place = np.ravel(axes)[0]
        for name, points in curves.items():
            place.semilogy(*zip(*points, strict=True), marker="o", label=name)
        place.set_xlabel("shape functions")
        place.set_ylabel("largest error of the receptance, 1 to 1500 Hz")
        place.legend()
    print(path)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path())
