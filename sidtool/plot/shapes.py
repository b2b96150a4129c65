"""The outline of a plane body and its shape functions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.model import ModelFile

from ..frontends.finite_element_model import FiniteElementModel
from ..frontends.registry import finite_element_model
from ..reduction.frames import FRAMES
from ..reduction.methods import REDUCTIONS
from .figure import COLOURS, figure

Array = NDArray[np.float64]
#: Largest displacement in the picture, as a share of the body's length.
_EXAGGERATION = 0.07


def plot_shapes(path: Path, model: ModelFile) -> None:
    """Draw a body and its shape functions, exaggerated to the same size.

    The mesh must have nodes on its edges, as Q4 has.

    Raises
    ------
    InputError : the model cannot be built, or the file cannot be written.
    """
    body = finite_element_model(model)
    frame = FRAMES[model.frame.type](body, model.frame)
    basis = REDUCTIONS[model.reduction.method](body, frame, model.reduction)
    rim = _outline(body)
    lengths = np.ptp(body.positions, axis=0)
    reach = _EXAGGERATION * lengths.max()
    pictures = [(model.title, np.zeros_like(body.positions))]
    for label, shape in zip(basis.labels, basis.shapes.T, strict=True):
        field = shape.reshape(-1, body.dimension)
        pictures.append((" ".join(label.split()), field * reach / np.abs(field).max()))
    rows = -(-len(pictures) // 2)
    window = body.positions.min(axis=0) - reach, body.positions.max(axis=0) + reach
    height = 3.6 * (lengths[1] + 2 * reach) / (lengths[0] + 2 * reach) + 0.35
    with figure(path, rows, 2, size=(8.0, height * rows + 0.3)) as axes:
        for place, (label, field) in zip(axes.flat, pictures, strict=False):
            _draw(place, body.positions[rim], field[rim], label)
            place.set_xlim(window[0][0], window[1][0])
            place.set_ylim(window[0][1], window[1][1])
        for place in axes.flat[len(pictures) :]:
            place.set_axis_off()
        for place in axes[-1]:
            place.set_xlabel("x [m]")


def _outline(body: FiniteElementModel) -> NDArray[np.int64]:
    """Nodes along the rim, once around."""
    sides = body.node_sets
    ring = [
        sides["bottom"],
        sides["right"],
        sides["top"][::-1],
        sides["left"][::-1],
    ]
    return np.concatenate(ring)


def _draw(axes: Any, rest: Array, field: Array, label: str) -> None:
    if field.any():
        axes.plot(*rest.T, color="0.6", linewidth=0.7)
    axes.fill(*(rest + field).T, facecolor=f"{COLOURS[0]}40", edgecolor=COLOURS[0])
    axes.set_aspect("equal")
    axes.set_title(label, loc="left", fontsize="medium")
