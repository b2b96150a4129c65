"""Vectors and rotation matrices in spatial kernels."""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import inner
from .layout import F1

VECTOR = types.UniTuple(float64, 3)


@inner(VECTOR(F1, int64))
def load(a, at):
    return a[at], a[at + 1], a[at + 2]


@inner(types.void(F1, int64, VECTOR))
def store(a, at, x):
    a[at], a[at + 1], a[at + 2] = x[0], x[1], x[2]


@inner(VECTOR(VECTOR, VECTOR))
def cross(a, b):
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@inner(VECTOR(int64))
def unit(a):
    return 1.0 if a == 0 else 0.0, 1.0 if a == 1 else 0.0, 1.0 if a == 2 else 0.0


@inner(float64(VECTOR, VECTOR))
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner(VECTOR(VECTOR, VECTOR))
def plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inner(VECTOR(VECTOR, VECTOR))
def minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner(VECTOR(float64, VECTOR))
def times(s, a):
    return s * a[0], s * a[1], s * a[2]


@inner(VECTOR(F1, int64, VECTOR))
def rotate(m, at, x):
    """The matrix m[at:at+9], by rows, times x."""
    return (
        m[at] * x[0] + m[at + 1] * x[1] + m[at + 2] * x[2],
        m[at + 3] * x[0] + m[at + 4] * x[1] + m[at + 5] * x[2],
        m[at + 6] * x[0] + m[at + 7] * x[1] + m[at + 8] * x[2],
    )


@inner(VECTOR(F1, int64, VECTOR))
def rotate_back(m, at, x):
    """The transpose of the matrix m[at:at+9], by rows, times x."""
    return (
        m[at] * x[0] + m[at + 3] * x[1] + m[at + 6] * x[2],
        m[at + 1] * x[0] + m[at + 4] * x[1] + m[at + 7] * x[2],
        m[at + 2] * x[0] + m[at + 5] * x[1] + m[at + 8] * x[2],
    )


@inner(VECTOR(F1, int64, int64, int64))
def column(a, at, stride, k):
    """Entry k of three consecutive vectors of length `stride`."""
    return a[at + k], a[at + stride + k], a[at + 2 * stride + k]


@inner(types.void(F1, int64, F1, int64))
def rotation_matrix(p, at, out, to):
    """Rotation matrix, by rows, of the quaternion p[at:at+4], of any length."""
    a, b, c, d = p[at], p[at + 1], p[at + 2], p[at + 3]
    n = 2.0 / (a * a + b * b + c * c + d * d)
    out[to] = 1.0 - n * (c * c + d * d)
    out[to + 1] = n * (b * c - a * d)
    out[to + 2] = n * (b * d + a * c)
    out[to + 3] = n * (b * c + a * d)
    out[to + 4] = 1.0 - n * (b * b + d * d)
    out[to + 5] = n * (c * d - a * b)
    out[to + 6] = n * (b * d - a * c)
    out[to + 7] = n * (c * d + a * b)
    out[to + 8] = 1.0 - n * (b * b + c * c)


@inner(types.void(F1, int64, VECTOR, float64, F1, int64))
def turned(matrix, at, axis, angle, out, to):
    """The matrix at `at` times the rotation by `angle` about a unit axis."""
    c, s = math.cos(angle), math.sin(angle)
    for i in range(3):
        r = (matrix[at + 3 * i], matrix[at + 3 * i + 1], matrix[at + 3 * i + 2])
        along = dot(r, axis) * (1.0 - c)
        turned = cross(r, axis)
        store(
            out,
            to + 3 * i,
            (
                c * r[0] + s * turned[0] + along * axis[0],
                c * r[1] + s * turned[1] + along * axis[1],
                c * r[2] + s * turned[2] + along * axis[2],
            ),
        )


@inner(VECTOR(F1, int64, VECTOR))
def inertia_times(six, at, x):
    """The symmetric matrix (xx, yy, zz, xy, xz, yz) at `at` times x."""
    return (
        six[at] * x[0] + six[at + 3] * x[1] + six[at + 4] * x[2],
        six[at + 3] * x[0] + six[at + 1] * x[1] + six[at + 5] * x[2],
        six[at + 4] * x[0] + six[at + 5] * x[1] + six[at + 2] * x[2],
    )


@inner(types.void(F1, int64, VECTOR))
def add_row(out, at, x):
    out[at] += x[0]
    out[at + 1] += x[1]
    out[at + 2] += x[2]


@inner(types.void(F1, int64, int64, VECTOR))
def add_column(out, at, stride, x):
    out[at] += x[0]
    out[at + stride] += x[1]
    out[at + 2 * stride] += x[2]


@inner(VECTOR(VECTOR, VECTOR, VECTOR))
def symmetric_times(own, mixed, x):
    """The symmetric matrix with xx, yy, zz and xy, xz, yz times x."""
    return (
        own[0] * x[0] + mixed[0] * x[1] + mixed[1] * x[2],
        mixed[0] * x[0] + own[1] * x[1] + mixed[2] * x[2],
        mixed[1] * x[0] + mixed[2] * x[1] + own[2] * x[2],
    )


@inner(VECTOR(VECTOR, VECTOR, float64))
def own_product(a, b, weight):
    """weight (a~ b~ + b~ a~): xx, yy, zz."""
    x, y, z = a[0] * b[0], a[1] * b[1], a[2] * b[2]
    return -2.0 * weight * (y + z), -2.0 * weight * (x + z), -2.0 * weight * (x + y)


@inner(VECTOR(VECTOR, VECTOR, float64))
def mixed_product(a, b, weight):
    """weight (a~ b~ + b~ a~): xy, xz, yz."""
    return (
        weight * (a[0] * b[1] + a[1] * b[0]),
        weight * (a[0] * b[2] + a[2] * b[0]),
        weight * (a[1] * b[2] + a[2] * b[1]),
    )
