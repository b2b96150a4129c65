"""What a force makes of the measure that it acts on, eq. (16)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sidtool.formats.scene import Characteristic
from sidtool.formats.sid import Array

from ...functions.features import Features
from ...functions.table import features


@dataclass(frozen=True, eq=False)
class Polynomials:
    """A piecewise polynomial: starts (n,) and coefficients (n, terms), lowest first."""

    starts: Array
    terms: Array
    lines: tuple[Array, Array] | None = None  # points of a table that they join

    def value(self, x: Array) -> Array:
        """Values at x, (nt,)."""
        if len(self.starts) == 0:
            return np.zeros_like(x)
        piece = np.maximum(np.searchsorted(self.starts, x, side="right") - 1, 0)
        total, local = np.zeros(x.shape), x - self.starts[piece]
        for column in self.terms.T[::-1]:
            total = total * local + column[piece]
        return total


NOTHING = Polynomials(np.zeros(0), np.zeros((0, 0)))


@dataclass(frozen=True, eq=False)
class Law:
    """F = applied(t) - K(g - rest) - D(g') - friction tanh(g' / speed)."""

    rest: float = 0.0
    applied: float = 0.0
    friction: float = 0.0
    speed: float = 1.0
    stiffness: Polynomials = NOTHING
    damping: Polynomials = NOTHING

    def features(self) -> Features:
        """Of the force over the measure, which no step may pass unseen."""
        curve = self.stiffness

        def value(g: Array) -> Array:
            return curve.value(g - self.rest)

        if curve.lines is None:
            return features.of_characteristic(value, self.rest + curve.starts)
        x, force = curve.lines
        known = features.of_characteristic(value, self.rest + x)
        return features.with_corners(known, self.rest + x, force)

    def rate_features(self) -> Features:
        """Of the force over the rate of the measure, likewise."""
        if self.friction == 0.0:
            return features.NONE
        return features.of_friction(self.speed)

    def passive_force(self, g: float, rate: float) -> float:
        """Force of spring, damper and friction at one measure and its rate."""
        spring = self.stiffness.value(np.array([g - self.rest]))[0]
        damper = self.damping.value(np.array([rate]))[0]
        friction = self.friction * math.tanh(rate / self.speed)
        return float(-spring - damper - friction)

    def packed(self) -> Array:
        """In the order of `equations.forces`."""
        sizes = [*self.stiffness.terms.shape, *self.damping.terms.shape]
        head = [self.rest, self.applied, self.friction, self.speed, *sizes]
        parts = [self.stiffness, self.damping]
        rows = [np.concatenate([p.starts, p.terms.ravel()]) for p in parts]
        return np.concatenate([head, *rows])


def powers(values: tuple[float, ...] | None) -> Polynomials:
    """A polynomial without constant term."""
    if values is None:
        return NOTHING
    return Polynomials(np.zeros(1), np.array([[0.0, *values]]))


def characteristic(table: Characteristic) -> Polynomials:
    """A table of forces in pieces; the outer ones go on beyond it."""
    if table.interpolation == "linear":
        x, force = np.array(table.deflection), np.array(table.force)
        slopes = np.diff(force) / np.diff(x)
        terms = np.stack([force[:-1], slopes], axis=1)
        return Polynomials(x[:-1], terms, lines=(x, force))
    from scipy.interpolate import PchipInterpolator

    curve = PchipInterpolator(table.deflection, table.force)
    inside = np.ascontiguousarray(curve.c[::-1].T)
    slopes = curve.derivative()(curve.x[[0, -1]])
    before = [table.force[0], slopes[0], 0.0, 0.0]
    after = [table.force[-1], slopes[1], 0.0, 0.0]
    starts = np.concatenate([curve.x[:1], curve.x])
    return Polynomials(starts, np.vstack([before, inside, after]))
