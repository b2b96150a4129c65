"""Every solid element on four drawn parts, beside CalculiX and converged values.

CalculiX (``ccx``, Debian package calculix-ccx) gets the same meshes, supports and nodal
loads. Converged values are those of hex20 on a finer mesh.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.sidtool.frontends.drawn_parts import PARTS, drawn
from tests.sidtool.importers.twins import ELEMENTS, Found, by_calculix, by_sidtool

from .machine import describe_machine
from .report import Report, Table

#: Cells through the least width, of the elements and of the converged values.
CELLS, FINE = 1, 3
REMARKS = (
    "Errors against hex20 with three cells through the least width, in per cent: of "
    "f1, the worst of f1 to f6, the deflection under the load, the von Mises stress at "
    "a point of the surface, mass and the worst moment of inertia; sidtool / CalculiX. "
    "*worse by* is how much further from the converged value sidtool is than CalculiX, "
    "at most, and where. hex8 differs from C3D8I on distorted elements, where C3D8I "
    "fails the patch test (uniform stress does work on its internal modes, 21 % of the "
    "nodal forces on a shaken cube) and is softer. C3D4, C3D6, C3D10 and C3D15 "
    "integrate their mass by few points.",
)
_NAMES = ("f1", "f1 to f6", "deflection", "von Mises", "mass", "inertia")


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure every element; an empty report where CalculiX is not installed."""
    title = "Elements on drawn parts beside CalculiX"
    if shutil.which("ccx") is None:
        return Report(title, [], ["ccx is not installed (Debian: calculix-ccx)."])
    tables = []
    for part in PARTS:
        say(f"  {part}")
        best = by_sidtool(drawn(part, "hex20", FINE), "hex20")
        rows = [_row(part, element, best) for element in ELEMENTS]
        caption = f"{part.capitalize()}, f1 = {best.frequencies[0]:.2f} Hz:"
        header = ["element", "unknowns", *_NAMES, "worse by"]
        tables.append(Table(caption, header, rows))
    return Report(title, tables, REMARKS, machine=describe_machine())


def _row(part: str, element: str, best: Found) -> list[str]:
    kind, twin = ELEMENTS[element]
    drawing = drawn(part, kind, CELLS)
    own = _errors(by_sidtool(drawing, element), best)
    with tempfile.TemporaryDirectory() as place:
        other = _errors(by_calculix(drawing, element, Path(place)), best)
    worse = [np.max(np.abs(a) - np.abs(b)) for a, b in zip(own, other, strict=True)]
    most = int(np.argmax(worse))
    told = f"{worse[most]:.1e} ({_NAMES[most]})" if worse[most] > 1e-4 else "-"
    cells = [f"{_worst(a)} / {_worst(b)}" for a, b in zip(own, other, strict=True)]
    return [f"{element} ({twin})", str(drawing.mesh.positions.size), *cells, told]


def _errors(found: Found, best: Found) -> list[np.ndarray]:
    ratios = [
        found.frequencies[:1] / best.frequencies[:1],
        found.frequencies / best.frequencies,
        found.deflection / best.deflection,
        found.von_mises / best.von_mises,
        found.mass / best.mass,
        found.inertia / best.inertia,
    ]
    return [np.atleast_1d(ratio) - 1 for ratio in ratios]


def _worst(errors: np.ndarray) -> str:
    return f"{100 * errors[np.abs(errors).argmax()]:+.3g}"
