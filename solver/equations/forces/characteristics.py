"""What springs, dampers and friction of a force law make of a measure, eq. (16)."""

from __future__ import annotations

import math

from ...compiler.compiling import inner

# Entries of a force law in the pool; K and D follow, each as the starts of its pieces
# and then the coefficients of each, lowest power first.
REST, APPLIED, FRICTION, SPEED = 0, 1, 2, 3
K_PIECES, K_TERMS, D_PIECES, D_TERMS = 4, 5, 6, 7
POLYNOMIALS = 8


@inner()
def piecewise(pool, at, pieces, terms, x):
    """Value and slope at x of a piecewise polynomial."""
    if pieces == 0:
        return 0.0, 0.0
    k = 0
    while k + 1 < pieces and pool[at + k + 1] <= x:
        k += 1
    x -= pool[at + k]
    first = at + pieces + k * terms
    value, slope = 0.0, 0.0
    for i in range(terms - 1, -1, -1):
        slope = slope * x + value
        value = value * x + pool[first + i]
    return value, slope


@inner()
def antiderivative(pool, at, pieces, terms, x):
    """Integral of a piecewise polynomial up to x, from the start of its first piece."""
    k, total, is_last = 0, 0.0, pieces == 0
    while not is_last:
        is_last = k + 1 == pieces or pool[at + k + 1] > x
        length = (x if is_last else pool[at + k + 1]) - pool[at + k]
        first, value = at + pieces + k * terms, 0.0
        for i in range(terms - 1, -1, -1):
            value = value * length + pool[first + i] / (i + 1)
        total += value * length
        k += 1
    return total


@inner()
def spring(pool, law):
    """Where K stands, its pieces and coefficients of each."""
    return law + POLYNOMIALS, int(pool[law + K_PIECES]), int(pool[law + K_TERMS])


@inner()
def damper(pool, law, rate):
    """What damping and friction take, and its slope."""
    at, pieces, terms = spring(pool, law)
    at += pieces * (1 + terms)
    pieces, terms = int(pool[law + D_PIECES]), int(pool[law + D_TERMS])
    force, slope = piecewise(pool, at, pieces, terms, rate)
    if pool[law + FRICTION] != 0.0:
        saturation = math.tanh(rate / pool[law + SPEED])
        force += pool[law + FRICTION] * saturation
        bend = (1.0 - saturation * saturation) / pool[law + SPEED]
        slope += pool[law + FRICTION] * bend
    return force, slope


@inner()
def passive_force(pool, law, g, rate):
    """Force of spring, damper and friction, -dF/dg and -dF/dg'."""
    at, pieces, terms = spring(pool, law)
    pull, stiffness = piecewise(pool, at, pieces, terms, g - pool[law + REST])
    drag, damping = damper(pool, law, rate)
    return -pull - drag, stiffness, damping
