"""Functions of time, said in other ways; their values by own formulas."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable

import numpy as np
from scipy.interpolate import BPoly, CubicSpline, KroghInterpolator, PPoly

from tests.metamorphic.generator import laws
from tests.metamorphic.generator.case import Table


def value(function: Table) -> Callable[[float], float]:
    """A function of time as a callable."""
    kind = function["type"]
    if kind == "constant":
        return lambda t: float(function["value"])
    if kind == "harmonic":
        speed, phase = angular_frequency(function), function.get("phase", 0.0)
        offset, amplitude = function.get("offset", 0.0), function["amplitude"]
        return lambda t: float(offset + amplitude * math.sin(speed * t + phase))
    return _at_one_time(pieces(function))


def _at_one_time(found: PPoly) -> Callable[[float], float]:
    """Piecewise polynomials as a function of one number: fifty thousand calls a run."""
    edges, rows = found.x.tolist(), found.c.T.tolist()

    def at(t: float) -> float:
        k = min(max(bisect_right(edges, t) - 1, 0), len(rows) - 1)
        result = 0.0
        for c in rows[k]:
            result = result * (t - edges[k]) + c
        return float(result)

    return at


def angular_frequency(function: Table) -> float:
    if function.get("angular_frequency") is not None:
        return float(function["angular_frequency"])
    return 2.0 * math.pi * float(function["frequency"])


def pieces(function: Table) -> PPoly:
    """A polynomial, a step or a table as piecewise polynomials; scipy's formulas."""
    kind = function["type"]
    if kind == "table" and function.get("interpolation") == "linear":
        t, y = np.array(function["times"]), np.array(function["values"])
        return _extended(PPoly(np.stack([np.diff(y) / np.diff(t), y[:-1]]), t))
    if kind == "table":
        ends = function.get("ends", "not-a-knot")
        return CubicSpline(function["times"], function["values"], bc_type=ends)
    if kind == "smooth_step":
        flat = [0.0] * function.get("continuity", 2)
        edges = [function["from"], function["to"]]
        sides = [[function.get("start", 0.0), *flat], [function["end"], *flat]]
        return _extended(
            PPoly.from_bernstein_basis(BPoly.from_derivatives(edges, sides))
        )
    polynomials = [_piece(piece) for piece in function["pieces"]]
    edges = [piece["from"] for piece in function["pieces"]]
    last = function["pieces"][-1].get("to")
    edges.append(edges[-1] + 1e3 if last is None else last)
    return _joined(edges, polynomials)


def _piece(piece: Table) -> list[float]:
    """Powers of t - from, lowest first."""
    if piece.get("coefficients") is not None:
        return list(piece["coefficients"])
    start, end, begin = piece["start"], piece["end"], piece["from"]
    t = [0.0] * len(start) + [piece["to"] - begin] * len(end)
    found = KroghInterpolator(t, [*start, *end])
    count = len(t)
    return [float(found.derivative(0.0, k)) / math.factorial(k) for k in range(count)]


def _joined(edges: list[float], powers: list[list[float]]) -> PPoly:
    most = max(map(len, powers))
    table = np.array([np.pad(p, (0, most - len(p))) for p in powers])
    return PPoly(table.T[::-1], edges)


def _extended(found: PPoly) -> PPoly:
    """Constant before and after."""
    c = np.zeros((found.c.shape[0], found.c.shape[1] + 2))
    c[:, 1:-1] = found.c
    c[-1, 0], c[-1, -1] = found(found.x[0]), found(found.x[-1])
    return PPoly(c, [found.x[0] - 1e3, *found.x, found.x[-1] + 1e3])


def as_polynomial(function: Table) -> Table:
    """The same function by coefficients of pieces; harmonics stay."""
    if function["type"] in ("harmonic", "callable"):
        return function
    if function["type"] == "constant":
        rows = [{"from": -1e3, "coefficients": [function["value"]]}]
        return {"type": "polynomial", "pieces": rows}
    found = pieces(function)
    rows = [
        {"from": float(a), "to": float(b), "coefficients": c[::-1].tolist()}
        for a, b, c in zip(found.x[:-1], found.x[1:], found.c.T, strict=True)
    ]
    return {"type": "polynomial", "pieces": rows}


def scaled(function: Table, factor: float) -> Table:
    """A function of time, or a law, times a number."""
    if laws.is_law(function):
        return laws.scaled(function, factor)
    new = dict(function)
    for key in ("value", "offset", "amplitude"):
        if key in new:
            new[key] = factor * new[key]
    if new["type"] == "smooth_step":
        new |= {k: factor * new.get(k, 0.0) for k in ("start", "end")}
    if new["type"] == "table":
        new["values"] = [factor * x for x in new["values"]]
    if new["type"] == "polynomial":
        new["pieces"] = [_times(piece, lambda k: factor) for piece in new["pieces"]]
    return new


def about_start(function: Table, factor: float) -> Table:
    """A function whose change since time zero is multiplied by a number."""
    rest = (1.0 - factor) * value(function)(0.0)
    new = scaled(function, factor)
    for key in ("value", "offset", "start", "end"):
        if key in new:
            new[key] += rest
    if new["type"] == "harmonic":
        new.setdefault("offset", rest)
    if new["type"] == "table":
        new["values"] = [x + rest for x in new["values"]]
    for piece in new.get("pieces", ()):
        for key in ("start", "end", "coefficients"):
            if key in piece:
                piece[key] = [piece[key][0] + rest, *piece[key][1:]]
    return new


def _times(piece: Table, factor: Callable[[int], float]) -> Table:
    """A piece whose coefficients and derivatives of order k are multiplied."""
    keys = ("start", "end", "coefficients")
    return {
        name: [factor(k) * x for k, x in enumerate(v)] if name in keys else v
        for name, v in piece.items()
    }


def later(function: Table, delay: float) -> Table:
    """The function with all that happens later."""
    new = dict(function)
    if new["type"] == "harmonic":
        new["phase"] = new.get("phase", 0.0) - angular_frequency(new) * delay
    for key in ("from", "to"):
        if key in new:
            new[key] = new[key] + delay
    if new["type"] == "table":
        new["times"] = [t + delay for t in new["times"]]
    if new["type"] == "polynomial":
        new["pieces"] = [
            {k: v + delay if k in ("from", "to") else v for k, v in piece.items()}
            for piece in new["pieces"]
        ]
    return new


def in_time_unit(function: Table, unit: float) -> Table:
    """The function with times in another unit, of which one of the old has `unit`."""
    new = dict(function)
    if new["type"] == "harmonic":
        new["angular_frequency"] = angular_frequency(new) / unit
        new.pop("frequency", None)
    for key in ("from", "to"):
        if key in new:
            new[key] = new[key] * unit
    if new["type"] == "table":
        new["times"] = [t * unit for t in new["times"]]
    if new["type"] == "polynomial":
        new["pieces"] = [
            {k: v * unit if k in ("from", "to") else v for k, v in piece.items()}
            for piece in (_times(p, lambda k: unit**-k) for p in new["pieces"])
        ]
    return new
