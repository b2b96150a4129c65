"""Derivatives of a SID by a number of its model: cost beside a conversion."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import sidtool
from sidtool.formats.model import ModelFile
from sidtool.model_derivatives.design_variables import design_variable
from sidtool.model_derivatives.sid_derivatives import DifferentiableBody
from sidtool.pipeline.model_to_sid import sid_from_model

from .machine import describe_machine
from .report import Report, Table

EXAMPLES = Path(__file__).parents[1] / "examples"
#: Repetitions of everything that takes less than `_SHORT` seconds.
_REPEATED, _SHORT = 5, 1.0


def _models() -> Iterator[tuple[str, ModelFile, list[str]]]:
    """Names, models, and a number of the material and one of the geometry."""
    crank, space = EXAMPLES / "slider_crank", EXAMPLES / "rod_in_space"
    plane = ["material.youngs_modulus", "geometry.control_points[1][0][1]"]
    solid = ["material.youngs_modulus", "geometry.control_points[1][0][0][1]"]
    beam = ["material.youngs_modulus", "geometry.section.height[1]"]
    rod = sidtool.Model.load(space / "rod_hex20.toml")
    yield "founding rod, Q4", sidtool.Model.load(crank / "rod_q4.toml"), plane
    yield "founding rod, IGA", sidtool.Model.load(crank / "rod_iga.toml"), plane
    yield "rod in space, beam", sidtool.Model.load(space / "rod_beam.toml"), beam
    yield "rod in space, hex20", rod, solid
    for kind, elements in (("hex20", [40, 6, 3]), ("hex8", [60, 6, 6])):
        changed = rod.with_({"discretisation": {"type": kind, "elements": elements}})
        yield f"rod in space, finer {kind}", changed, solid


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Processor time of a conversion, of the preparation, and of each variable."""
    rows = []
    for label, model, keys in _models():
        conversion = _least(partial(sid_from_model, model))
        preparation = _least(partial(DifferentiableBody, model))
        body = DifferentiableBody(model)
        variables = [design_variable(model, key) for key in keys]
        with _clock() as first:
            body.derivative(variables[0])
        each = [_least(partial(body.derivative, v)) for v in variables]
        factors = max(0.0, first[0] - each[0])
        cells = [conversion, preparation, factors, *each]
        shares = [f"{seconds / conversion:.2f}" for seconds in each]
        size = body.basis.shapes.shape
        row = [label, str(size[0]), str(size[1]), *(f"{x:.3g}" for x in cells)]
        rows.append([*row, *shares])
        say(f"  {label}: {' and '.join(shares)} conversions a variable")
    header = ["model", "equations", "modes", "conversion s", "body s", "factors s"]
    header += ["E s", "shape s", "E / conversion", "shape / conversion"]
    caption = (
        "Processor seconds of a conversion, of the body without a step, of the factors "
        "of all modes (both once), and of the derivatives of all blocks by Young's "
        f"modulus and by a dimension (least of {_REPEATED} if short)."
    )
    return Report(
        title="Derivatives of a body",
        tables=[Table(caption, header, rows)],
        machine=describe_machine(),
    )


@contextmanager
def _clock() -> Iterator[list[float]]:
    seconds: list[float] = []
    start = time.process_time()
    yield seconds
    seconds.append(time.process_time() - start)


def _least(work: Callable[[], Any]) -> float:
    least = float("inf")
    for _ in range(_REPEATED):
        with _clock() as seconds:
            work()
        least = min(least, seconds[0])
        if seconds[0] > _SHORT:
            break
    return least
