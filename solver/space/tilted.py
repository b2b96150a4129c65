"""Vectors in axes that are tilted by a rotation vector, to second order in it."""

from __future__ import annotations

from ..compiler.compiling import inner
from .algebra import cross


@inner()
def seen(theta, x):
    """x in axes turned by theta, to second order."""
    turned = cross(theta, x)
    return x - turned + 0.5 * cross(theta, turned)


@inner()
def meant(theta, x):
    """The transpose of `seen`."""
    turned = cross(theta, x)
    return x + turned + 0.5 * cross(theta, turned)


@inner()
def bent_by(a, b, x):
    """The second derivative of `seen` along a and b; it is symmetric."""
    return 0.5 * (cross(a, cross(b, x)) + cross(b, cross(a, x)))


@inner()
def seen_by(theta, a, x):
    """The derivative of `seen` by theta along a."""
    return bent_by(theta, a, x) - cross(a, x)


@inner()
def meant_by(theta, a, x):
    """The derivative of `meant` by theta along a."""
    return bent_by(theta, a, x) + cross(a, x)
