"""Radau, BDF and DOP853 of scipy, and IDA of SUNDIALS, on the index-1 equations."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array

from .equations import Equations

Solver = Callable[[Equations, float, Array], Array]
#: scipy's DOP853 is bound by stability and IDA by its callbacks: runs longer than this
#: end the line of a solver [s].
LONGEST = 4.0


def solve(
    equations: Equations, method: str, rtol: float, scale: Array
) -> tuple[dict[str, Array], float]:
    """Outputs by name and the seconds of the solution.

    Parameters
    ----------
    method : one of `METHODS`
    scale : (n,) size of every entry of the state, for the absolute tolerances

    Raises
    ------
    ImportError : the program is not installed.
    RuntimeError : the solver gave up.
    """
    began = time.perf_counter()
    states = METHODS[method](equations, rtol, scale)
    seconds = time.perf_counter() - began
    return equations.values(states), seconds


def _scipy(name: str) -> Solver:
    def run(equations: Equations, rtol: float, scale: Array) -> Array:
        from scipy.integrate import solve_ivp

        options: dict[str, Any] = {}
        if name != "DOP853":
            options["jac"] = lambda t, y: equations.jacobian(t, y, scale)

        def piece(begin: float, end: float, y: Array, times: Array) -> Array:
            solution = solve_ivp(
                equations,
                (begin, end),
                y,
                method=name,
                t_eval=times,
                rtol=rtol,
                atol=rtol * scale,
                **options,
            )
            if not solution.success:
                raise RuntimeError(solution.message)
            return np.asarray(solution.y.T)

        return _in_pieces(equations, piece)

    return run


def _ida(equations: Equations, rtol: float, scale: Array) -> Array:
    from sksundae.ida import IDA

    def residual(t: float, y: Array, slope: Array, out: Array) -> None:
        out[:] = slope - equations(t, y)

    def piece(begin: float, end: float, y: Array, times: Array) -> Array:
        solver = IDA(residual, rtol=rtol, atol=rtol * scale, max_num_steps=1_000_000)
        solution = solver.solve(times, y, equations(begin, y))
        if not solution.success:
            raise RuntimeError(str(solution.message))
        return np.asarray(solution.y)

    return _in_pieces(equations, piece)


def _in_pieces(
    equations: Equations, piece: Callable[[float, float, Array, Array], Array]
) -> Array:
    """States at the output times, with a new start where a drive is not smooth."""
    times = equations.times
    y = equations.start
    states = [y[None]] if times[0] == equations.intervals()[0][0] else []
    for begin, end in equations.intervals():
        equations.enter(begin, end)
        inside = times[(times > begin) & (times <= end)]
        grid = np.unique(np.concatenate([[begin], inside, [end]]))
        found = piece(begin, end, y, grid)
        y = found[-1]
        states.append(found[np.isin(grid, inside)])
    return np.concatenate(states)


METHODS: dict[str, Solver] = {
    "scipy Radau": _scipy("Radau"),
    "scipy BDF": _scipy("BDF"),
    "scipy DOP853": _scipy("DOP853"),
    "IDA (scikit-sundae)": _ida,
}
