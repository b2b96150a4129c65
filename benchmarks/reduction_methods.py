"""Error of the frequency response at the piston pin against the number of shapes.

The rod of the slider-crank, 150 x 10 quadrilaterals, clamped at the crank; response to
forces and a moment at the piston pin between 1 and 1500 Hz, with 2 % structural
damping. What a user brings are natural modes and static shapes here.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import read_data, validate_data
from sidtool.pipeline.model_to_sid import finite_element_model
from sidtool.plot.figure import saved_figure
from sidtool.reduction.admissible_space import constrained_space
from sidtool.reduction.body_frames import FRAMES, motion_rows
from sidtool.reduction.methods import REDUCTIONS

from .machine import describe_machine
from .report import Report, Table

ROD = Path(__file__).parents[1] / "examples" / "slider_crank" / "rod_q4.toml"
PIN = ["piston_pin"]
SIZES = (3, 6, 9, 12, 18, 24, 36)
FREQUENCIES = np.linspace(1, 1500, 60)
LOSS = 0.02

Curves = dict[str, list[tuple[int, float]]]


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure all registered methods; the plot goes to `folder`."""
    data = read_data(ROD)
    body = finite_element_model(validate_data(data, ModelFile))
    loads = motion_rows(body, body.marker("piston_pin")).T
    exact = full_response(body, loads)
    largest = np.abs(np.einsum("fii->fi", exact)).max(axis=0)
    scale = np.sqrt(np.outer(largest, largest))
    curves: Curves = {}
    for method in REDUCTIONS:
        curves[method] = []
        for size in SIZES:
            found, count = reduced_response(data, body, loads, method, size)
            error = float((np.abs(found - exact).max(axis=0) / scale).max())
            curves[method].append((count, error))
        say(f"  {method}: {', '.join(_cells(curves[method]))}")
    _plot(folder / f"{name}.png", curves)
    rows = [[method, *_cells(points)] for method, points in curves.items()]
    header = ["method", *(f"size {size}" for size in SIZES)]
    caption = (
        "Largest error of the receptances at the piston pin, 1 to 1500 Hz, over the "
        "largest receptance; in brackets the number of shape functions:"
    )
    return Report(
        title="Shape functions: error of the frequency response of the rod",
        tables=[Table(caption, header, rows)],
        plot=f"{name}.png",
        machine=describe_machine(),
    )


def reduced_response(
    data: Any, body: FiniteElementModel, loads: np.ndarray, method: str, size: int
) -> tuple[np.ndarray, int]:
    """(nf, 3, 3) receptance with about `size` shape functions, and their number."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shapes.npy"
        table = settings(method, size, path)
        if method == "user":
            np.save(path, exported_shapes(data, body, loads, size))
        model = validate_data(data | {"reduction": table}, ModelFile)
        frame = FRAMES["tangent"](body, model.frame)
        basis = REDUCTIONS[method](body, frame, model.reduction)
    return response(basis.stiffness, basis.shapes.T @ loads), len(basis.labels)


def settings(method: str, size: int, shapes: Path | None = None) -> dict[str, Any]:
    """A method with about `size` shape functions; those of a user are in a file."""
    if method == "modal":
        return {"method": method, "modes": size}
    if method == "krylov":
        points = np.linspace(0, 1500, max(1, size // 3)).tolist()
        return {"method": method, "interfaces": PIN, "frequencies": points}
    if method == "user":
        return {"method": method, "file": str(shapes)}
    return {"method": method, "interfaces": PIN, "modes": max(0, size - 3)}


def exported_shapes(
    data: Any, body: FiniteElementModel, loads: np.ndarray, size: int
) -> np.ndarray:
    """(ndof, size) natural modes and static shapes, as another program writes them."""
    model = validate_data(data | {"reduction": settings("modal", size)}, ModelFile)
    frame = FRAMES["tangent"](body, model.frame)
    modes = REDUCTIONS["modal"](body, frame, model.reduction).shapes
    static = constrained_space(body, frame).static(loads)
    return np.hstack([static, modes])[:, :size]


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


def _cells(points: list[tuple[int, float]]) -> list[str]:
    return [f"{error:.1e} ({count})" for count, error in points]


def _plot(path: Path, curves: Curves) -> None:
    with saved_figure(path, 1, 1, size=(7.0, 4.5)) as axes:
        place = np.ravel(axes)[0]
        for name, points in curves.items():
            place.semilogy(*zip(*sorted(points), strict=True), marker="o", label=name)
        place.set_xlabel("shape functions")
        place.set_ylabel("largest error of the receptance, 1 to 1500 Hz")
        place.legend()
