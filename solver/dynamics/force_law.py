"""Force laws between two markers, eq. (16).

The force on a measure g of the motion, positive in the direction of growing g, is

    F = applied f - K(g - rest) - D(g') - friction tanh(g' / speed)

==========  ==================================================
Symbol      Meaning
==========  ==================================================
g, g'       measure and its rate
f           function of time, or value of a law
K, D        piecewise polynomials of spring and damper
rest        measure of the unloaded spring
==========  ==================================================
"""

from ..compiler.kernels import inner
from .control_laws import law_value
from .drives import function_value
from .force_characteristics import (
    APPLIED_SCALE,
    REST_LENGTH,
    damper_force,
    passive_force,
    polynomial_integral,
    spring_polynomial,
)


@inner()
def set_force_scale(system, work, k, t):
    """Set the scale of a force: its law, its function of time, or 1."""
    value = 1.0
    if system.force[k].sampled == 1:
        value = 0.0
    elif system.force[k].code >= 0:
        value = law_value(system, work, k, t, False)
    elif system.force[k].time >= 0:
        value, _, _ = function_value(
            system, system.force[k].time, work.interval_time[0], t
        )
    work.force_scale[k] = value


@inner()
def set_law_derivatives(system, work, t):
    """Set the derivatives of all laws by the measures that they read."""
    for k in range(len(system.force)):
        if system.force[k].code >= 0 and system.force[k].sampled == 0:
            law_value(system, work, k, t, True)


@inner()
def force_law(system, work, k, g, rate):
    """Force, its stiffness -dF/dg and its damping -dF/dg'.

    For a measure that a law reads: derivatives of the force of that law.
    """
    real_data, law = system.real_data, system.force[k].law
    if system.force[k].owner >= 0:
        return 0.0, -work.law_derivative[k, 0], -work.law_derivative[k, 1]
    force, stiffness, damping = passive_force(real_data, law, g, rate)
    return _applied_force(system, work, k) + force, stiffness, damping


@inner()
def _applied_force(system, work, k):
    size = system.real_data[system.force[k].law + APPLIED_SCALE]
    return size * work.force_scale[k] if size != 0.0 else 0.0


@inner()
def energy_and_powers(system, work, k, g, rate):
    """Energy in the spring of a force, and the powers that it loses and is given."""
    real_data, law = system.real_data, system.force[k].law
    at, pieces, terms = spring_polynomial(real_data, law)
    stored_energy = polynomial_integral(
        real_data, at, pieces, terms, g - real_data[law + REST_LENGTH]
    )
    stored_energy -= polynomial_integral(real_data, at, pieces, terms, 0.0)
    damping_force, _ = damper_force(real_data, law, rate)
    return stored_energy, damping_force * rate, _applied_force(system, work, k) * rate
