"""Vectors in axes that are tilted by a rotation vector, to second order in it."""

from __future__ import annotations

from .compiling import inner
from .vectors import VECTOR, cross, minus, plus, times


@inner(VECTOR(VECTOR, VECTOR))
def seen(theta, x):
    """x in axes turned by theta, to second order."""
    turned = cross(theta, x)
    return minus(plus(x, times(0.5, cross(theta, turned))), turned)


@inner(VECTOR(VECTOR, VECTOR))
def meant(theta, x):
    """The transpose of `seen`."""
    turned = cross(theta, x)
    return plus(plus(x, times(0.5, cross(theta, turned))), turned)


@inner(VECTOR(VECTOR, VECTOR, VECTOR))
def bent_by(a, b, x):
    """The second derivative of `seen` along a and b; it is symmetric."""
    return times(0.5, plus(cross(a, cross(b, x)), cross(b, cross(a, x))))


@inner(VECTOR(VECTOR, VECTOR, VECTOR))
def seen_by(theta, a, x):
    """The derivative of `seen` by theta along a."""
    return minus(bent_by(theta, a, x), cross(a, x))


@inner(VECTOR(VECTOR, VECTOR, VECTOR))
def meant_by(theta, a, x):
    """The derivative of `meant` by theta along a."""
    return plus(bent_by(theta, a, x), cross(a, x))
