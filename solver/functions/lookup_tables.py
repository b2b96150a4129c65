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
