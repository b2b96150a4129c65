"""Mass matrix and forces of one body, eq. (10)-(12).

==============  =======================================  ===========
Symbol          Meaning                                  Theory
==============  =======================================  ===========
mdCM            mass times centre of mass                eq. (10)
J, J_dot        moment of inertia and its rate           eq. (10)
Ct, Cr          coupling of translation and rotation     eq. (10)
                with the elastic coordinates
Me, Ke, De      elastic mass, stiffness and damping      eq. (10)
Oe, Ge          centrifugal and gyroscopic terms         eq. (11)
K1              cubic stiffness, has an energy           eq. (13)
==============  =======================================  ===========

The SID terms of a body are in `SystemArrays.real_data`: mass, mdCM, J and H; then
rows over the elastic coordinates; then square matrices, component by component. Their
offsets are computed once.
"""

from collections.abc import Callable
from typing import Any

from ..compiler.inner_kernels import inner, row_dot
from ..compiler.types import float64, int64, void
from ..compiler.vectors import SymmetricMatrix, Vector, formula
from ..spatial.algebra import (
    cross,
    dot,
    inertia_second_derivative,
    inertia_times,
    load,
    omega_product,
    rotate_inverse,
    size,
    store,
    store_column,
    write_point_mass,
    write_rigid_mass_matrix,
    zero,
)
from ..spatial.system_arrays import (
    DIAGONAL_DE,
    DIAGONAL_KE,
    F1,
    HAS_CR1,
    HAS_CT1,
    HAS_KE1,
    HAS_OE1,
    HAS_QUADRATIC_J,
)

#: Numbers of components: of a translation, a rotation and a symmetric matrix.
SIZES = {2: {"number": 1, "translation": 2, "rotation": 1, "matrix": 1}}
SIZES[3] = {"number": 1, "translation": 3, "rotation": 3, "matrix": 6}
SCALARS = {"mass": "number", "mdCM": "translation", "J0": "matrix", "H0": "matrix"}
VECTORS = {
    "Ct0": "translation",
    "Cr0": "rotation",
    "J1": "matrix",
    "Oe0": "matrix",
    "ksigma": "number",
    "theta_k": "rotation",
    "H_derivative": "matrix",
}
MATRICES = {
    "Ke": "number",
    "De": "number",
    "Cr1": "rotation",
    "Ge": "rotation",
    "Oe1": "matrix",
    "Ct1": "translation",
    "coupling": "rotation",
    "H_second_derivative": "matrix",
    "free_rotation": "rotation",
    "free_mass": "number",
}


def _starts(blocks: dict[str, str], dimension: int) -> dict[str, int]:
    """Components before each block, and of all under the name ""."""
    starts, total = {}, 0
    for name, kind in blocks.items():
        starts[name] = total
        total += SIZES[dimension][kind]
    return starts | {"": total}


_STARTS = {d: [_starts(b, d) for b in (SCALARS, VECTORS, MATRICES)] for d in SIZES}


def _read_block(kind: str, dimension: int, a: Any, at: Any, stride: Any) -> Any:
    if kind == "number":
        return a[at]
    many = range(SIZES[dimension][kind])
    value = SymmetricMatrix if kind == "matrix" else Vector
    return value(*(a[at + i * stride] for i in many))


def _scalar_reader(name: str) -> Callable[..., Any]:
    def read(x: Any, real_data: Any, o: Any) -> Any:
        head, _, _ = _STARTS[len(x)]
        return _read_block(SCALARS[name], len(x), real_data, o + head[name], 1)

    return formula(read)


def _vector_reader(name: str) -> Callable[..., Any]:
    def read(x: Any, real_data: Any, o: Any, nq: Any, k: Any) -> Any:
        head, rows, _ = _STARTS[len(x)]
        at = nq * rows[name] + (o + head[""] + k)
        return _read_block(VECTORS[name], len(x), real_data, at, nq)

    return formula(read)


def _matrix_reader(name: str) -> Callable[..., Any]:
    def read(x: Any, real_data: Any, o: Any, nq: Any, k: Any, i: Any) -> Any:
        head, rows, squares = _STARTS[len(x)]
        square = nq * nq
        at = square * squares[name] + nq * rows[""] + (o + head[""] + k * nq + i)
        return _read_block(MATRICES[name], len(x), real_data, at, square)

    return formula(read)


def _row_start(name: str) -> Callable[..., Any]:
    """Where row k of a square matrix begins, of its first component."""

    def start(x: Any, o: Any, nq: Any, k: Any) -> Any:
        head, rows, squares = _STARTS[len(x)]
        return nq * nq * squares[name] + nq * rows[""] + (o + head[""] + k * nq)

    return formula(start)


@formula
def Ke1_offset(x: Any, o: Any, nq: Any) -> Any:
    """Where Ke1 stands."""
    head, rows, squares = _STARTS[len(x)]
    return o + head[""] + nq * rows[""] + nq * nq * squares[""]


mass, mdCM, J0, H0 = map(_scalar_reader, SCALARS)
Ct0, Cr0, J1, Oe0, ksigma, theta_k, H_derivative = map(_vector_reader, VECTORS)
Ke, De, Cr1, Ge, Oe1, Ct1, coupling, H_second_derivative, free_rotation, free_mass = (
    map(_matrix_reader, MATRICES)
)
ROW_BLOCKS = "Ke", "De", "Cr1", "Ge", "Oe1", "Ct1"
Ke_row, De_row, Cr1_row, Ge_row, Oe1_row, Ct1_row = map(_row_start, ROW_BLOCKS)


@inner()
def row_product(like, work, real_data, at, nq, x, first):
    """A row of a square matrix times x[first:]; its entries are values like that."""
    for c in range(size(like)):
        work.scratch[c] = row_dot(real_data, at + c * nq * nq, x, first, nq)
    return load(like, work.scratch, 0)


@inner(void(F1, int64, int64, F1, int64, F1, int64))
def add_cubic_force(real_data, at, nq, z, q, f, row):
    """Adds the forces on the elastic coordinates z[q:] to f[row:]; K1 is at `at`."""
    for k in range(nq):
        for i in range(nq):
            for j in range(nq):
                f[row + k] -= (
                    real_data[at + (k * nq + i) * nq + j] * z[q + i] * z[q + j]
                )


@inner(float64(F1, int64, int64, F1, int64))
def cubic_energy(real_data, at, nq, z, q):
    """Their energy."""
    total = 0.0
    for k in range(nq):
        for i in range(nq):
            for j in range(nq):
                part = z[q + k] * z[q + i] * z[q + j]
                total += real_data[at + (k * nq + i) * nq + j] * part
    return total / 3.0


@inner(void(F1, int64, int64, F1, int64, F1, int64, int64))
def add_cubic_stiffness(real_data, at, nq, z, q, out, corner, stride):
    """Adds minus the derivative of the forces to the nq x nq block at `corner`."""
    for k in range(nq):
        for i in range(nq):
            for j in range(nq):
                e = at + (k * nq + i) * nq + j
                out[corner + k * stride + i] += 2.0 * real_data[e] * z[q + j]


@inner()
def gravity_in_body_axes(system, frame):
    """The acceleration of gravity in the axes of a body frame."""
    return rotate_inverse(frame.R, load(frame.x, system.gravity, 0))


@inner()
def body_state(system, work, row, omega, z, v):
    """mdCM, J, J', Ct^T q' and Cr^T q' at a state; rows of the modes in
    WorkArrays.modal.
    """
    nq, flags, real_data, o = row.nq, row.flags, system.real_data, row.data
    q, qd, x = row.pos + row.np - row.nq, row.vel + row.rd, work.frame[0].x
    md, J = mdCM(x, real_data, o), J0(x, real_data, o)
    J_dot, Ct_qdot, Cr_qdot = zero(J), zero(x), zero(omega)
    for k in range(nq):
        qk, qdk, mode = z[q + k], v[qd + k], work.modal_scratch[k]
        oe, ge = omega_product(Oe0(x, real_data, o, nq, k), omega), 0.0
        ct, J1_k = Ct0(x, real_data, o, nq, k), J1(x, real_data, o, nq, k)
        cr, j1, ct_mean = Cr0(x, real_data, o, nq, k), J1_k, ct
        cr_gyro = cr
        if flags & HAS_CR1:
            cr = cr + row_product(
                omega, work, real_data, Cr1_row(x, o, nq, k), nq, z, q
            )
            Ge_qdot = row_product(
                omega, work, real_data, Ge_row(x, o, nq, k), nq, v, qd
            )
            ge = dot(Ge_qdot, omega)
        if flags & HAS_OE1:
            Oe1_q = row_product(J, work, real_data, Oe1_row(x, o, nq, k), nq, z, q)
            oe += omega_product(Oe1_q, omega)
            if flags & HAS_QUADRATIC_J:
                j1 = j1 + inertia_second_derivative(Oe1_q)
        if flags & HAS_CT1:
            Ct1_q = row_product(x, work, real_data, Ct1_row(x, o, nq, k), nq, z, q)
            ct_mean, ct = ct_mean + 0.5 * Ct1_q, ct + Ct1_q
        if flags & HAS_QUADRATIC_J:
            cr_gyro = cr
        mode.ct, mode.cr, mode.j1, mode.cr_gyro = ct, cr, j1, cr_gyro
        mode.oe, mode.ge = oe, ge
        md, Ct_qdot, Cr_qdot = (
            md + qk * ct_mean,
            Ct_qdot + qdk * ct,
            Cr_qdot + qdk * cr_gyro,
        )
        J, J_dot = J + (0.5 * qk) * (j1 + J1_k), J_dot + qdk * j1
    return md, J, J_dot, Ct_qdot, Cr_qdot


@inner()
def _elastic_and_damping_force(row, x, real_data, k, z, v):
    """Row k of Ke q + De q'."""
    nq, o, q, qd = row.nq, row.data, row.pos + row.np - row.nq, row.vel + row.rd
    if row.flags & DIAGONAL_KE:
        force = Ke(x, real_data, o, nq, k, k) * z[q + k]
    else:
        force = row_dot(real_data, Ke_row(x, o, nq, k), z, q, nq)
    if row.flags & DIAGONAL_DE:
        return force + De(x, real_data, o, nq, k, k) * v[qd + k]
    return force + row_dot(real_data, De_row(x, o, nq, k), v, qd, nq)


@inner()
def evaluate_body(system, work, b, z, v):
    row, frame = system.body[b], work.frame[b]
    nq, nv, rd, n = row.nq, row.nv, row.rd, size(frame.x)
    if nv == 0:
        return
    real_data, M, f, o, omega, alpha = (
        system.real_data,
        work.M,
        work.f,
        row.data,
        frame.w,
        frame.al,
    )
    md, J, J_dot, Ct_qdot, Cr_qdot = body_state(system, work, row, omega, z, v)
    block, first, q, qd = row.block, row.vel, row.pos + row.np - nq, row.vel + rd
    x, m = frame.x, mass(frame.x, real_data, o)
    a = frame.a - gravity_in_body_axes(system, frame)
    if rd >= n:
        force_rate = (
            m * a + cross(omega, cross(omega, md)) + 2.0 * cross(omega, Ct_qdot)
        )
        store(f, first, -force_rate)
        write_point_mass(M, block, nv, m, x)
    if rd > n:
        torque = cross(omega, inertia_times(J, omega) + Cr_qdot) + inertia_times(
            J_dot, omega
        )
        store(f, first + n, -(cross(md, a) + torque))
        write_rigid_mass_matrix(M, block, nv, m, md, J)
    for k in range(nq):
        mode, row_start = work.modal_scratch[k], block + (rd + k) * nv
        ct, cr = mode.ct, mode.cr
        force = -mode.oe - mode.ge - dot(ct, a) - dot(cr, alpha)
        force -= ksigma(x, real_data, o, nq, k)
        f[qd + k] = force - _elastic_and_damping_force(row, x, real_data, k, z, v)
        if rd >= n:
            store(M, row_start, ct)
            store_column(M, block, nv, rd + k, ct)
        if rd > n:
            store(M, row_start + n, cr)
            store_column(M, block + n * nv, nv, rd + k, cr)
    if row.flags & HAS_KE1:
        add_cubic_force(real_data, Ke1_offset(x, o, nq), nq, z, q, f, qd)
