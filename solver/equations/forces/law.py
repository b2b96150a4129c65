"""Force laws: what a force between two markers makes of their motion.

The force on a measure g of the motion, positive in the direction in which g grows, is
(eq. (16))

    F = applied f - K(g - rest) - D(g') - friction tanh(g' / speed),

with piecewise polynomials K and D, and f a function of time or what a law makes of
other measures, see `programs`.
"""

from __future__ import annotations

import math

from ...compiler.compiling import inner
from ..drives import drive_value
from .programs import law_value

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
def _antiderivative(pool, at, pieces, terms, x):
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
def set_factor(system, work, k, t):
    """What scales a force: its law, its function of time, or 1."""
    value = 1.0
    if system.force[k].sampled == 1:
        value = 0.0
    elif system.force[k].code >= 0:
        value = law_value(system, work, k, t, False)
    elif system.force[k].time >= 0:
        value, _, _ = drive_value(system, system.force[k].time, work.clock[0], t)
    work.factor[k] = value


@inner()
def set_slopes(system, work, t):
    """Derivatives of all laws by what they read."""
    for k in range(len(system.force)):
        if system.force[k].code >= 0 and system.force[k].sampled == 0:
            law_value(system, work, k, t, True)


@inner()
def force_law(system, work, k, g, rate):
    """Force, its stiffness -dF/dg and its damping -dF/dg'.

    Of a measure that a law reads, those of the force by that law.
    """
    pool, law = system.pool, system.force[k].law
    if system.force[k].owner >= 0:
        return 0.0, -work.slope[k, 0], -work.slope[k, 1]
    at, pieces, terms = _spring(pool, law)
    spring, stiffness = piecewise(pool, at, pieces, terms, g - pool[law + REST])
    damper, damping = _damper(pool, law, rate)
    return _applied(system, work, k) - spring - damper, stiffness, damping


@inner()
def _spring(pool, law):
    """Where K stands, its pieces and coefficients of each."""
    return law + POLYNOMIALS, int(pool[law + K_PIECES]), int(pool[law + K_TERMS])


@inner()
def _damper(pool, law, rate):
    """What damping and friction take, and its slope."""
    at, pieces, terms = _spring(pool, law)
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
def _applied(system, work, k):
    size = system.pool[system.force[k].law + APPLIED]
    return size * work.factor[k] if size != 0.0 else 0.0


@inner()
def energies(system, work, k, g, rate):
    """Energy in the spring of a force, and the powers that it loses and is given."""
    pool, law = system.pool, system.force[k].law
    at, pieces, terms = _spring(pool, law)
    stored = _antiderivative(pool, at, pieces, terms, g - pool[law + REST])
    stored -= _antiderivative(pool, at, pieces, terms, 0.0)
    damper, _ = _damper(pool, law, rate)
    return stored, damper * rate, _applied(system, work, k) * rate
