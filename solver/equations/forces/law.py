"""Force laws: what a force between two markers makes of their motion.

The force on a measure g of the motion, positive in the direction in which g grows, is
(eq. (16))

    F = applied f - K(g - rest) - D(g') - friction tanh(g' / speed),

with piecewise polynomials K and D, and f a function of time or what a law makes of
other measures, see `programs`.
"""

from __future__ import annotations

from ...compiler.compiling import inner
from ..drives import drive_value
from .characteristics import (
    APPLIED,
    REST,
    antiderivative,
    damper,
    passive_force,
    spring,
)
from .programs import law_value


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
    force, stiffness, damping = passive_force(pool, law, g, rate)
    return _applied(system, work, k) + force, stiffness, damping


@inner()
def _applied(system, work, k):
    size = system.pool[system.force[k].law + APPLIED]
    return size * work.factor[k] if size != 0.0 else 0.0


@inner()
def energies(system, work, k, g, rate):
    """Energy in the spring of a force, and the powers that it loses and is given."""
    pool, law = system.pool, system.force[k].law
    at, pieces, terms = spring(pool, law)
    stored = antiderivative(pool, at, pieces, terms, g - pool[law + REST])
    stored -= antiderivative(pool, at, pieces, terms, 0.0)
    lost, _ = damper(pool, law, rate)
    return stored, lost * rate, _applied(system, work, k) * rate
