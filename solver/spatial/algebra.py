"""Vector algebra of plane and space; no other kernel depends on the dimension.

In the plane a translation has two components and a rotation one; in space both have
three. Components in axes that are rotated by a small vector theta are expanded to
second order in theta.
"""

from typing import Any

from ..compiler.kernels import inner
from ..compiler.vectors import KernelValue, Rotation, SymmetricMatrix, Vector, formula


def _unit_vectors(x: Vector) -> list[Vector]:
    """Unit vectors along the axes of vectors like x."""
    many = range(len(x))
    return [Vector(*(1.0 if i == j else 0.0 for i in many)) for j in many]


@formula
def size(x: Vector) -> int:
    """How many components it has."""
    return len(x)


@formula
def zero(x: KernelValue) -> KernelValue:
    return type(x)(*[0.0] * len(x))


@formula
def unit(x: Vector, i: Any) -> Vector:
    """The i-th unit vector of those like x."""
    return Vector(*(i.matches(j) for j in range(len(x))))


@formula
def load(x: Vector, a: Any, at: Any) -> Vector:
    """A vector like x that begins at `at`."""
    return type(x)(*(a[at + i] for i in range(len(x))))


@formula
def store(a: Any, at: Any, x: Vector) -> None:
    for i, part in enumerate(x):
        a[at + i] = part


@formula
def embed_in_space(x: Vector) -> Vector:
    """Embed in space: planar translations lie in x and y, planar rotations
    are about z.
    """
    if len(x) == 3:
        return x
    return Vector(0.0, 0.0, x[0]) if len(x) == 1 else Vector(x[0], x[1], 0.0)


@formula
def column(x: Vector, a: Any, at: Any, stride: Any, k: Any) -> Vector:
    """Entry k of consecutive rows of length `stride`, a vector like x."""
    return type(x)(*(a[at + i * stride + k] for i in range(len(x))))


@formula
def add_row(a: Any, at: Any, x: Vector) -> None:
    for i, part in enumerate(x):
        a[at + i] = a[at + i] + part


@formula
def add_column(a: Any, at: Any, stride: Any, x: Vector) -> None:
    for i, part in enumerate(x):
        position = at + i * stride
        a[position] = a[position] + part


@formula
def dot(a: Vector, b: Vector) -> Any:
    return sum(x * y for x, y in zip(a, b, strict=True))


@formula
def cross(a: Vector, b: Vector) -> Vector:
    """Cross product.

    In the plane: of two translations, of a rotation and a translation, or of two
    rotations, which is zero.
    """
    if len(a) == 3:
        return Vector(
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        )
    if len(a) == len(b) == 2:
        return Vector(a[0] * b[1] - a[1] * b[0])
    if len(b) == 2:
        return Vector(-a[0] * b[1], a[0] * b[0])
    if len(a) == 2:
        return Vector(b[0] * a[1], -b[0] * a[0])
    return Vector(0.0)


@formula
def rotate(R: Rotation, x: Vector) -> Vector:
    """R x; planar rotations are not changed."""
    if len(x) == 1:
        return x
    if len(x) == 2:
        return Vector(R[0] * x[0] - R[1] * x[1], R[1] * x[0] + R[0] * x[1])
    return Vector(*(dot(Vector(*R[i : i + 3]), x) for i in (0, 3, 6)))


@formula
def rotate_inverse(R: Rotation, x: Vector) -> Vector:
    """R^T x."""
    if len(x) == 1:
        return x
    if len(x) == 2:
        return Vector(R[0] * x[0] + R[1] * x[1], R[0] * x[1] - R[1] * x[0])
    return Vector(*(dot(Vector(*R[i::3]), x) for i in range(3)))


@formula
def direction(cosine: Any, sine: Any) -> Vector:
    """In the plane."""
    return Vector(cosine, sine)


@formula
def planar_rotation(cosine: Any, sine: Any) -> Rotation:
    return Rotation(cosine, sine)


@formula
def rotation_from_quaternion(p: Vector) -> Rotation:
    """The rotation of a quaternion of any length, scalar first."""
    a, b, c, d = p
    n = 2.0 / (a * a + b * b + c * c + d * d)
    return Rotation(
        1.0 - n * (c * c + d * d), n * (b * c - a * d), n * (b * d + a * c),
        n * (b * c + a * d), 1.0 - n * (b * b + d * d), n * (c * d - a * b),
        n * (b * d - a * c), n * (c * d + a * b), 1.0 - n * (b * b + c * c),
    )  # fmt: skip


@formula
def tangent_operator(theta: Vector, s2: Any, s3: Any) -> Rotation:
    """I + s2 theta~ + s3 theta~ theta~."""
    x, y, z = theta
    return Rotation(
        1.0 - s3 * (y * y + z * z), s3 * x * y - s2 * z, s2 * y + s3 * x * z,
        s2 * z + s3 * x * y, 1.0 - s3 * (x * x + z * z), s3 * y * z - s2 * x,
        s3 * x * z - s2 * y, s2 * x + s3 * y * z, 1.0 - s3 * (x * x + y * y),
    )  # fmt: skip


@formula
def shape_function_offset(w: Vector, data: Any) -> Any:
    """Where Phi of a marker stands, behind its position and angle or rotation."""
    return data + (3 if len(w) == 1 else 12)


@formula
def rotation_product(R: Rotation, S: Rotation) -> Rotation:
    """R S in space."""
    return Rotation(
        *(x for i in (0, 3, 6) for x in rotate_inverse(S, Vector(*R[i : i + 3])))
    )


@formula
def rotation_product_transposed(R: Rotation, S: Rotation) -> Rotation:
    """R S^T in space."""
    return Rotation(*(x for i in (0, 3, 6) for x in rotate(S, Vector(*R[i : i + 3]))))


@formula
def rotate_about_axis(R: Rotation, axis: Vector, cosine: Any, sine: Any) -> Rotation:
    """R times the rotation about a unit axis in space."""
    rows = []
    for r in (Vector(*R[i : i + 3]) for i in (0, 3, 6)):
        parallel = dot(r, axis) * (1.0 - cosine)
        rows.append(cosine * r + sine * cross(r, axis) + parallel * axis)
    return Rotation(*(x for r in rows for x in r))


def _matrix(J: SymmetricMatrix) -> list[Vector]:
    """Its columns."""
    if len(J) == 1:
        return [Vector(J[0])]
    xx, yy, zz, xy, xz, yz = J
    return [Vector(xx, xy, xz), Vector(xy, yy, yz), Vector(xz, yz, zz)]


@formula
def inertia_times(J: SymmetricMatrix, x: Vector) -> Vector:
    return Vector(*(dot(line, x) for line in _matrix(J)))


@formula
def symmetric_entry(J: SymmetricMatrix, i: Any) -> Any:
    return sum(i.matches(j) * x for j, x in enumerate(J))


@formula
def symmetric_matrix(
    xx: Any, yy: Any, zz: Any, xy: Any, xz: Any, yz: Any
) -> SymmetricMatrix:
    return SymmetricMatrix(xx, yy, zz, xy, xz, yz)


@formula
def isotropic(J: SymmetricMatrix, moment: Any) -> SymmetricMatrix:
    """A moment about all axes, as a matrix like J."""
    return SymmetricMatrix(*[moment] * min(len(J), 3), *[0.0] * (len(J) - 3))


@formula
def inertia_term(a: Vector, b: Vector, weight: Any) -> SymmetricMatrix:
    """weight (a~ b~ + b~ a~): contribution of the position of a point to J."""
    if len(a) == 2:
        return SymmetricMatrix(-2.0 * weight * dot(a, b))
    x, y, z = (-2.0 * weight * (i * j) for i, j in zip(a, b, strict=True))
    pairs = ((0, 1), (0, 2), (1, 2))
    mixed = (weight * (a[i] * b[j] + a[j] * b[i]) for i, j in pairs)
    return SymmetricMatrix(y + z, x + z, x + y, *mixed)


@formula
def omega_product(oe: SymmetricMatrix, w: Vector) -> Any:
    """A row of Oe times (wx2, wy2, wz2, wxwy, wywz, wxwz)."""
    if len(w) == 1:
        return oe[0] * w[0] * w[0]
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
    return sum(o * w[i] * w[j] for o, (i, j) in zip(oe, pairs, strict=True))


@formula
def omega_gradient(oe: SymmetricMatrix, w: Vector) -> Vector:
    """Gradient by w of `omega_product`."""
    if len(w) == 1:
        return Vector(2.0 * oe[0] * w[0])
    xx, yy, zz, xy, yz, xz = oe
    return Vector(
        2.0 * xx * w[0] + xy * w[1] + xz * w[2],
        2.0 * yy * w[1] + xy * w[0] + yz * w[2],
        2.0 * zz * w[2] + yz * w[1] + xz * w[0],
    )


@formula
def inertia_second_derivative(oe: SymmetricMatrix) -> SymmetricMatrix:
    """The second derivative of J that belongs to a row of Oe1: of -q Oe1 q."""
    if len(oe) == 1:
        return SymmetricMatrix(-2.0 * oe[0])
    xx, yy, zz, xy, yz, xz = oe
    return SymmetricMatrix(-2.0 * xx, -2.0 * yy, -2.0 * zz, -xy, -xz, -yz)


def _write(out: Any, at: Any, stride: Any, columns: list[Vector]) -> None:
    for j, entries in enumerate(columns):
        for i, part in enumerate(entries):
            out[at + i * stride + j] = part


@formula
def write_rigid_mass_matrix(
    out: Any, at: Any, stride: Any, mass: Any, md: Vector, J: SymmetricMatrix
) -> None:
    """The mass matrix of a rigid body, in translations and rotations."""
    n, rotations = len(md), _unit_vectors(Vector(*[0.0] * len(_matrix(J))))
    _write(out, at, stride, [mass * e for e in _unit_vectors(md)])
    _write(out, at + n, stride, [-cross(md, e) for e in rotations])
    _write(out, at + n * stride, stride, [cross(md, e) for e in _unit_vectors(md)])
    _write(out, at + n * stride + n, stride, _matrix(J))


@formula
def write_point_mass(out: Any, at: Any, stride: Any, mass: Any, x: Vector) -> None:
    """The mass of a point."""
    _write(out, at, stride, [mass * e for e in _unit_vectors(x)])


@formula
def add_gyroscopic_matrix(
    out: Any, at: Any, stride: Any, w: Vector, J: SymmetricMatrix, rate: SymmetricMatrix
) -> None:
    """Adds the matrix of w x J e + J' e."""
    columns = [
        cross(w, inertia_times(J, e)) + inertia_times(rate, e) for e in _unit_vectors(w)
    ]
    _add_matrix(out, at, stride, columns)


@formula
def add_symmetric(out: Any, at: Any, stride: Any, J: SymmetricMatrix) -> None:
    _add_matrix(out, at, stride, _matrix(J))


@formula
def store_column(out: Any, at: Any, stride: Any, k: Any, x: Vector) -> None:
    for i, part in enumerate(x):
        out[at + i * stride + k] = part


def _add_matrix(out: Any, at: Any, stride: Any, columns: list[Vector]) -> None:
    for j, entries in enumerate(columns):
        add_column(out, at + j, stride, entries)


@formula
def add_cross(out: Any, at: Any, stride: Any, a: Vector, x: Vector) -> None:
    """Add the matrix of the linear map x -> cross(a, x)."""
    _add_matrix(out, at, stride, [cross(a, e) for e in _unit_vectors(x)])


@formula
def add_double_cross(
    out: Any, at: Any, stride: Any, a: Vector, b: Vector, x: Vector
) -> None:
    """Add the matrix of the linear map x -> cross(a, cross(b, x))."""
    _add_matrix(out, at, stride, [cross(a, cross(b, e)) for e in _unit_vectors(x)])


@inner()
def to_rotated_axes(theta, x):
    """Components of x in axes rotated by theta, to second order."""
    theta_x = cross(theta, x)
    return x - theta_x + 0.5 * cross(theta, theta_x)


@inner()
def from_rotated_axes(theta, x):
    """Transpose of `to_rotated_axes`."""
    theta_x = cross(theta, x)
    return x + theta_x + 0.5 * cross(theta, theta_x)


@inner()
def d2_to_rotated_axes(a, b, x):
    """Second derivative of `to_rotated_axes` along a and b; it is symmetric."""
    return 0.5 * (cross(a, cross(b, x)) + cross(b, cross(a, x)))


@inner()
def d_to_rotated_axes(theta, a, x):
    """Derivative of `to_rotated_axes` by theta along a."""
    return d2_to_rotated_axes(theta, a, x) - cross(a, x)


@inner()
def d_from_rotated_axes(theta, a, x):
    """Derivative of `from_rotated_axes` by theta along a."""
    return d2_to_rotated_axes(theta, a, x) + cross(a, x)
