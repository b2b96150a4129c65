"""Forces of springs, dampers and friction as functions of a measure, eq. (16)."""

import math

from ..compiler.kernels import inner

# Entries of a force law in the pool; K and D follow, each as the starts of its pieces
# and then the coefficients of each, lowest power first.
REST_LENGTH, APPLIED_SCALE, FRICTION_FORCE, FRICTION_SPEED = 0, 1, 2, 3
K_PIECES, K_TERMS, D_PIECES, D_TERMS = 4, 5, 6, 7
POLYNOMIAL_DATA = 8


@inner()
def piecewise_polynomial(real_data, at, pieces, terms, x):
    """Value and slope at x of a piecewise polynomial."""
    if pieces == 0:
        return 0.0, 0.0
    k = 0
    while k + 1 < pieces and real_data[at + k + 1] <= x:
        k += 1
    x -= real_data[at + k]
    first = at + pieces + k * terms
    value, slope = 0.0, 0.0
    for i in range(terms - 1, -1, -1):
        slope = slope * x + value
        value = value * x + real_data[first + i]
    return value, slope


@inner()
def polynomial_integral(real_data, at, pieces, terms, x):
    """Integral of a piecewise polynomial up to x, from the start of its first piece."""
    k, total, is_last = 0, 0.0, pieces == 0
    while not is_last:
        is_last = k + 1 == pieces or real_data[at + k + 1] > x
        length = (x if is_last else real_data[at + k + 1]) - real_data[at + k]
        first, value = at + pieces + k * terms, 0.0
        for i in range(terms - 1, -1, -1):
            value = value * length + real_data[first + i] / (i + 1)
        total += value * length
        k += 1
    return total


@inner()
def spring_polynomial(real_data, law):
    """Where K stands, its pieces and coefficients of each."""
    return (
        law + POLYNOMIAL_DATA,
        int(real_data[law + K_PIECES]),
        int(real_data[law + K_TERMS]),
    )


@inner()
def damper_force(real_data, law, rate):
    """Force of damping and friction, and its slope."""
    at, pieces, terms = spring_polynomial(real_data, law)
    at += pieces * (1 + terms)
    pieces, terms = int(real_data[law + D_PIECES]), int(real_data[law + D_TERMS])
    force, slope = piecewise_polynomial(real_data, at, pieces, terms, rate)
    if real_data[law + FRICTION_FORCE] != 0.0:
        saturation = math.tanh(rate / real_data[law + FRICTION_SPEED])
        force += real_data[law + FRICTION_FORCE] * saturation
        saturation_slope = (1.0 - saturation * saturation) / real_data[
            law + FRICTION_SPEED
        ]
        slope += real_data[law + FRICTION_FORCE] * saturation_slope
    return force, slope


@inner()
def passive_force(real_data, law, g, rate):
    """Force of spring, damper and friction, -dF/dg and -dF/dg'."""
    at, pieces, terms = spring_polynomial(real_data, law)
    spring_force, stiffness = piecewise_polynomial(
        real_data, at, pieces, terms, g - real_data[law + REST_LENGTH]
    )
    damping_force, damping = damper_force(real_data, law, rate)
    return -spring_force - damping_force, stiffness, damping
