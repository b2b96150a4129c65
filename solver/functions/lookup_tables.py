"""Tables of formulas: as rows of functions, as grids, and evaluated in Python."""

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import LookupTable, Spline

from .function_table import compile_function
from .piecewise import PiecewisePolynomial


def curve_of_table(table: LookupTable) -> PiecewisePolynomial:
    """The curve of a table of one variable."""
    x, _, values = table.points
    spline = Spline(
        times=x.tolist(), values=values.tolist(), interpolation=table.interpolation
    )
    curve = compile_function(spline, "")
    assert isinstance(curve, PiecewisePolynomial)
    return curve


def grid_data(table: LookupTable) -> Array:
    """Numbers of x and y, x, y and the values row by row, as kernels read them."""
    x, y, values = table.points
    return np.concatenate([[len(x), len(y)], x, y, values.ravel()])


def curve_value(curve: PiecewisePolynomial, x: float, order: int) -> float:
    """The value of a curve, or a derivative."""
    k = max(int(np.searchsorted(curve.starts, x, side="right")) - 1, 0)
    terms = np.polynomial.Polynomial(curve.terms[k])
    return float(terms.deriv(order)(x - curve.starts[k]))


def bilinear_value(table: LookupTable, a: float, b: float) -> float:
    """The value of a table of two variables."""
    x, y, values = table.points
    a, b = float(np.clip(a, x[0], x[-1])), float(np.clip(b, y[0], y[-1]))
    i = min(max(int(np.searchsorted(x, a, side="right")) - 1, 0), len(x) - 2)
    j = min(max(int(np.searchsorted(y, b, side="right")) - 1, 0), len(y) - 2)
    p, q = (a - x[i]) / (x[i + 1] - x[i]), (b - y[j]) / (y[j + 1] - y[j])
    rows = (1 - q) * values[i : i + 2, j] + q * values[i : i + 2, j + 1]
    return float((1 - p) * rows[0] + p * rows[1])
