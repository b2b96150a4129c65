"""Places where what drives a motion changes quickly, which no step may pass unseen.

An integrator sees a function of time, or the force of a spring, at the stages of its
steps only. What is known of it beforehand is kept as pieces: how far a polynomial of
low degree follows it from some place on. Steps inside a piece are no longer than that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from sidtool.formats.sid import Array

from .chebyshev_pieces import Scan, halved

#: Degree of the polynomials, and their error relative to the largest value.
DEGREE, ERROR = 8, 1e-6
#: Pieces of a function of time below this part of the span are rounding at a kink.
LEAST = 1e-7
#: Where the pieces of a function that is known are looked at, -1 to 1.
LOOKS = np.array([-0.8, -0.4, 0.0, 0.4, 0.8])
#: Where friction changes, in units of its speed: tanh there in pieces of a polynomial.
CREEP = np.array([-4.0, -4.0 / 3.0, 4.0 / 3.0, 4.0])
#: Neighbouring pieces of a table are one when a polynomial follows them so well,
#: relative to how much each changes.
ALIKE = 0.1
#: Steps end where the slope of a force changes by more than this part of the largest.
CORNER = 0.05


@dataclass(frozen=True, eq=False)
class Features:
    """Pieces of an axis, from -inf to inf.

    starts : (n,) growing, where the pieces begin; the first is -inf
    lengths : (n,) how far a step may go inside them
    corners : of the starts, those at which the slope jumps: steps end there
    """

    starts: Array
    lengths: Array
    corners: tuple[float, ...] = ()


NONE = Features(np.array([-np.inf]), np.array([np.inf]))


def together(parts: Sequence[Features]) -> Features:
    """The shortest lengths of all."""
    if len(parts) == 1:
        return parts[0]
    starts = np.unique(np.concatenate([NONE.starts, *(p.starts for p in parts)]))
    lengths = np.full(len(starts), np.inf)
    for part in parts:
        k = np.searchsorted(part.starts, starts, side="right") - 1
        lengths = np.minimum(lengths, part.lengths[k])
    kept = np.concatenate([[True], lengths[1:] != lengths[:-1]])
    kept |= np.isfinite(lengths)
    return Features(starts[kept], lengths[kept])


def of_curve(
    value: Callable[[Array], Array],
    edges: Array,
    kinks: Sequence[float],
    span: tuple[float, float],
) -> Features:
    """Of a function of time that is known on pieces, smooth but for its kinks.

    What is straight to the tolerated error needs no look inside.
    """
    inner = [t for t in kinks if span[0] < t < span[1]]
    halves = 0.5 * np.diff(edges)
    times = (edges[:-1, None] + halves[:, None] * (1.0 + LOOKS)).ravel()
    scan = Scan(times, value(times))
    outer = np.array([span[0], *inner, span[1]])
    series = halved(value, outer, scan, DEGREE, ERROR, "")
    bend = np.abs(series.terms[:, 2:]).sum(axis=1)
    size = float(np.max(np.abs(scan.values), initial=0.0))
    bent = (bend > ERROR * size) & (series.lengths > LEAST * (span[1] - span[0]))
    return _bounded(series.edges, np.where(bent, series.lengths, np.inf))


def of_polynomials(starts: Array, terms: Array, span: tuple[float, float]) -> Features:
    """Of polynomials in time, lowest power first, between which steps end anyway."""
    ends = np.append(starts[1:], max(span[1], starts[-1]))
    begins = np.append(min(span[0], starts[0]), starts[1:])
    edges = np.clip(np.append(begins, span[1]), *span)
    lengths, inside = ends - begins, np.diff(edges) > 0.0
    powers = np.arange(terms.shape[1])
    sizes = np.abs(terms) * np.maximum(ends - starts, lengths)[:, None] ** powers
    matter = sizes > ERROR * sizes.sum(axis=1).max(initial=0.0)
    degree = np.max(np.where(matter, powers, 0), axis=1)
    followed = lengths * DEGREE / np.maximum(degree, 1)
    reaches = np.where(degree > 1, followed, np.inf)
    return _bounded(np.append(edges[:-1][inside], span[1]), reaches[inside])


def of_characteristic(value: Callable[[Array], Array], knots: Array) -> Features:
    """Of a force over a measure of the motion, straight outside of its knots."""
    knots = np.unique(knots)
    if len(knots) < 2:
        return NONE
    edges = [float(knots[0])]
    waiting = [(0, len(knots) - 1)]
    while waiting:
        i, j = waiting.pop()
        if j == i + 1 or _is_one(value, knots[i : j + 1]):
            edges.append(float(knots[j]))
        else:
            middle = (i + j) // 2
            waiting += [(middle, j), (i, middle)]
    return _bounded(np.array(edges), np.diff(edges))


def with_corners(known: Features, x: Array, y: Array) -> Features:
    """With the corners of a force over a measure that is straight between points."""
    slopes = np.diff(y) / np.diff(x)
    changes = np.abs(np.diff(slopes))
    corners = x[1:-1][changes > CORNER * np.abs(slopes).max()]
    starts = np.union1d(known.starts, corners)
    k = np.searchsorted(known.starts, starts, side="right") - 1
    return Features(starts, known.lengths[k], tuple(corners.tolist()))


def of_friction(speed: float) -> Features:
    """Of friction over the relative speed, which it turns with within some `speed`."""
    edges = speed * CREEP
    return _bounded(edges, np.diff(edges))


def _is_one(value: Callable[[Array], Array], knots: Array) -> bool:
    """Whether one polynomial follows all pieces between knots."""
    shares = np.linspace(0.0, 1.0, 6)
    x = knots[:-1, None] + np.diff(knots)[:, None] * shares
    y = value(x.ravel()).reshape(x.shape)
    u = 2.0 * (x - knots[0]) / (knots[-1] - knots[0]) - 1.0
    fit = chebyshev.chebfit(u.ravel(), y.ravel(), DEGREE)
    gap = np.abs(chebyshev.chebval(u, fit) - y).max(axis=1)
    return bool((gap <= ALIKE * np.ptp(y, axis=1) + 1e-9 * np.ptp(y)).all())


def _bounded(edges: Array, lengths: Array) -> Features:
    """Nothing is known outside."""
    starts = np.concatenate([NONE.starts, edges])
    return Features(starts, np.concatenate([NONE.lengths, lengths, NONE.lengths]))
