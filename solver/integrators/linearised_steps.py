"""Linearised steps of a collocation method, one after the other, eq. (46) and (49).

With the derivative F of the slopes at the stages, a step solves

    x = b + h (A x I) F x .

Newton's matrix with the F of the middle stage, without the derivatives of the rates of
positions by positions, is the preconditioner: the error falls by a factor of 30 to 1000
in each iteration. Backwards the same equations hold with transposed matrices, for the
vectors u of (49).

==========  ==================================================================
Symbol      Meaning
==========  ==================================================================
F           [T, Z; J_z, J_v], of which the rows of the arguments are the columns
P           derivative of the projection after a step, its transpose backwards
mu          eigenvalues of A^-1 over h, of each pair one
==========  ==================================================================
"""

from typing import Any

from llvmlite import ir

from ..compiler.inner_kernels import Intrinsic, quotient
from ..compiler.kernels import entry, inner
from ..compiler.types import boolean, complex128, float64, int64, void
from ..spatial.system_arrays import C1, F1, F2, F3, I1
from .loop_state import copy

#: Entries of rows that are added at once.
WIDTHS = (4, 2, 1)
#: Error of the stages, relative to their norm: the largest of their weighted entries.
TOLERANCE = 1e-13
#: Changes that are rounding if they do not fall any more, and iterations at most.
ROUNDING, MAX_ITERATIONS = 1e-10, 50


def _row_adder(n_rows: int) -> Intrinsic:
    """Function that adds sums of consecutive rows of a matrix to a vector."""

    def add(
        out: Any, to: Any, f: Any, c: Any, stride: Any, x: Any, k: Any, n: Any
    ) -> Any:
        """out[to:] += sum of x[k + i] f[i stride + c:] for all rows, n entries.

        Vectors of the processor hold the entries: `out` and the rows share none.
        """
        real, whole = ir.DoubleType(), ir.IntType(64)

        def generate(builder: Any, values: Any) -> Any:
            from numba.core import cgutils

            out, to, f, c, stride, x, k, n = values

            def address(view: Any, index: Any, kind: Any) -> Any:
                place = builder.gep(builder.extract_value(view, 0), [index])
                return builder.bitcast(place, kind.as_pointer())

            rows = [
                builder.add(c, builder.mul(whole(i), stride)) for i in range(n_rows)
            ]
            factors = [
                builder.load(address(x, builder.add(k, whole(i)), real))
                for i in range(n_rows)
            ]
            begin = whole(0)
            for width in WIDTHS:
                kind = ir.VectorType(real, width)
                none, mask = kind(ir.Undefined), ir.VectorType(ir.IntType(32), width)
                vectors = []
                for factor in factors:
                    one = builder.insert_element(none, factor, ir.IntType(32)(0))
                    vectors.append(builder.shuffle_vector(one, none, mask([0] * width)))
                count = builder.sdiv(builder.sub(n, begin), whole(width))
                with cgutils.for_range(builder, count) as loop:
                    at = builder.add(begin, builder.mul(loop.index, whole(width)))
                    terms = []
                    for row, vector in zip(rows, vectors, strict=True):
                        entries = address(f, builder.add(row, at), kind)
                        entries = builder.load(entries, align=8)
                        terms.append(builder.fmul(entries, vector))
                    while len(terms) > 1:
                        pairs = zip(terms[::2], terms[1::2], strict=True)
                        terms = [builder.fadd(*pair) for pair in pairs]
                    place = address(out, builder.add(to, at), kind)
                    total = builder.fadd(builder.load(place, align=8), terms[0])
                    builder.store(total, place, align=8)
                begin = builder.add(begin, builder.mul(count, whole(width)))
            return factors[0]

        return float64(F1, int64, F1, int64, int64, F1, int64, int64), generate

    return Intrinsic(add)


_add_four_rows, _add_row = _row_adder(4), _row_adder(1)


@inner(void(F2, int64, int64, int64, int64, F1, int64, F1, int64))
def _add_product(F, row, column, m, n, x, first, out, to):
    """out[to:] += F^T x[first:] with the m x n block of F at a row and a column."""
    k, stride = 0, F.shape[1]
    while k + 4 <= m:
        _add_four_rows(out, to, F[row + k], column, stride, x, first + k, n)
        k += 4
    while k < m:
        _add_row(out, to, F[row + k], column, stride, x, first + k, n)
        k += 1


@inner(void(F2, F1, F1))
def _apply(F, x, out):
    """out = F x, with the columns of F in its rows."""
    for j in range(len(out)):
        out[j] = 0.0
    _add_product(F, 0, 0, len(x), len(out), x, 0, out, 0)


@inner(void(F2, F2, F2))
def _transform(matrix, x, out):
    """out = matrix x for the stages x."""
    for i in range(x.shape[0]):
        _apply(x, matrix[i], out[i])


@inner(int64(F2, F2, boolean, I1))
def _invert(real, imaginary, is_complex, pivots):
    """Replace a matrix by its inverse; 1 if it is singular."""
    n = real.shape[0]
    for j in range(n):
        best, size = j, abs(real[j, j]) + abs(imaginary[j, j])
        for i in range(j + 1, n):
            candidate = abs(real[i, j]) + abs(imaginary[i, j])
            if candidate > size:
                best, size = i, candidate
        pivots[j] = best
        if not size > 0.0:
            return 1
        if best != j:
            for k in range(n):
                real[j, k], real[best, k] = real[best, k], real[j, k]
                held = imaginary[j, k]
                imaginary[j, k], imaginary[best, k] = imaginary[best, k], held
        inverse = quotient(1.0, complex(real[j, j], imaginary[j, j]))
        a, b, own, own_i = inverse.real, inverse.imag, real[j], imaginary[j]
        own[j], own_i[j] = 1.0, 0.0
        for k in range(n):
            x, y = own[k], own_i[k]
            own[k], own_i[k] = a * x - b * y, a * y + b * x
        for i in range(n):
            row, row_i = real[i], imaginary[i]
            a, b = row[j], row_i[j]
            if i == j or (a == 0.0 and b == 0.0):
                continue
            row[j] = row_i[j] = 0.0
            for k in range(n):
                row[k] -= a * own[k]
            if is_complex:
                for k in range(n):
                    row[k] += b * own_i[k]
                    row_i[k] -= a * own_i[k] + b * own[k]
    for j in range(n - 1, -1, -1):
        best = pivots[j]
        if best != j:
            for i in range(n):
                real[i, j], real[i, best] = real[i, best], real[i, j]
                held = imaginary[i, j]
                imaginary[i, j], imaginary[i, best] = imaginary[i, best], held
    return 0


@inner(int64(F2, int64, float64, C1, F2, F3, F3, I1))
def _factor(F, nz, h, eigenvalues, product, real, imaginary, pivots):
    """Inverse of mu - J_v - J_z Z / mu for each eigenvalue, with its columns in rows;
    1 if one is singular."""
    nv = F.shape[0] - nz
    for j in range(nv):  # Z^T J_z^T
        row = product[j]
        for i in range(nv):
            row[i] = 0.0
        for k in range(nz):
            factor, column = F[nz + j, k], F[k]
            for i in range(nv):
                row[i] += factor * column[nz + i]
    for part in range(len(eigenvalues)):
        mu = complex(eigenvalues[part].real / h, eigenvalues[part].imag / h)
        inverse = quotient(1.0, mu)
        for j in range(nv):
            row, row_i = real[part, j], imaginary[part, j]
            column, change = F[nz + j], product[j]
            for i in range(nv):
                row[i] = -column[nz + i] - change[i] * inverse.real
                row_i[i] = -change[i] * inverse.imag
            row[j] += mu.real
            row_i[j] += mu.imag
        if _invert(real[part], imaginary[part], part > 0, pivots) != 0:
            return 1
    return 0


@inner(void(complex128, int64, int64, F2, F2))
def _multiply(factor, part, nz, x, out):
    """Velocities of `out` = factor x for the rows of a part, complex but for one."""
    re, im = max(0, 2 * part - 1), 2 * part
    for k in range(nz, x.shape[1]):
        a, b = x[re, k], x[im, k] if part > 0 else 0.0
        out[re, k] = factor.real * a - factor.imag * b
        if part > 0:
            out[im, k] = factor.real * b + factor.imag * a


@inner(void(F2, int64, float64, C1, F2, F2, F3, F3, F2, F2, F2))
def _precondition(
    F, nz, h, eigenvalues, to_pairs, from_pairs, real, imaginary, r, w, out
):
    """out = P^-1 r for the stages r, with the inverses of `_factor`."""
    s, N, nv = r.shape[0], F.shape[0], F.shape[0] - nz
    _transform(to_pairs, r, w)
    for part in range(len(eigenvalues)):
        mu = complex(eigenvalues[part].real / h, eigenvalues[part].imag / h)
        _multiply(mu, part, nz, w, w)
    for i in range(s):
        _add_product(F, 0, nz, nz, nv, w[i], 0, w[i], nz)
        for k in range(nz, N):
            out[i, k] = 0.0
    for part in range(len(eigenvalues)):
        re, im = max(0, 2 * part - 1), 2 * part
        _add_product(real[part], 0, 0, nv, nv, w[re], nz, out[re], nz)
        if part > 0:
            _add_product(real[part], 0, 0, nv, nv, w[im], nz, out[im], nz)
            _add_product(imaginary[part], 0, 0, nv, nv, w[re], nz, out[im], nz)
            for k in range(nz, N):
                w[im, k] = -w[im, k]
            _add_product(imaginary[part], 0, 0, nv, nv, w[im], nz, out[re], nz)
        mu = complex(eigenvalues[part].real / h, eigenvalues[part].imag / h)
        _multiply(quotient(1.0, mu), part, nz, out, w)
    for i in range(s):
        _add_product(F, nz, 0, nv, nz, w[i], nz, w[i], 0)
        for k in range(nz, N):
            w[i, k] = out[i, k]
    _transform(from_pairs, w, out)


@inner(float64(F2, F1, F1))
def _largest(x, weights, best):
    """Largest entry of stages, weighted; `best` is overwritten."""
    n = len(weights)
    for k in range(n):
        best[k] = 0.0
    for i in range(x.shape[0]):
        row = x[i]
        for k in range(n):
            size = abs(row[k]) * weights[k]
            best[k] = size if size > best[k] else best[k]
    found = 0.0
    for k in range(n):
        found = max(found, best[k])
    return found


@entry(
    int64(
        *(int64, int64, F1, F2, F2, F2, C1, F3, F3, F1),
        *(F3, F2, F2, F2, F3, F2, F3, F3, F1, I1),
    )
)
def march(
    backward,
    nz,
    h,
    A,
    to_pairs,
    from_pairs,
    eigenvalues,
    F,
    P,
    weights,
    x,
    added,
    current,
    starts,
    scratch,
    product,
    real,
    imaginary,
    best,
    pivots,
):
    """Solve linearised steps in sequence, for some columns each.

    Parameters
    ----------
    backward : 1 for the transposed equations, from the last step to the first one
    nz : number of positions
    h : (steps,) [s]
    A : (s, s) of the method, transposed backwards
    to_pairs, from_pairs : (s, s) transformation that makes the inverse of A diagonal
        but for pairs, and its inverse
    eigenvalues : of these, the real one first
    F : (steps s, N, N) columns of F as rows
    P : (steps or one less, N, N) columns of P as rows
    weights : (N,) of the entries of x in its norm
    x : (steps columns, s, N) b without the part of the state before the step, which
        the stages replace
    added : (steps columns, N) to the state after the step
    current : (columns, N) state
    starts : (steps columns, N) state before each step
    scratch, product, real, imaginary, best, pivots : (5, s, N), (nv, nv), twice (pairs,
        nv, nv), (N,), (nv,)

    Returns 0, or 1 where the iteration does not converge.
    """
    s, n_steps, N, count = A.shape[0], len(h), len(weights), current.shape[0]
    b, r, w, f, change = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    for step in range(n_steps):
        k = n_steps - 1 - step if backward == 1 else step
        middle = F[k * s + s // 2]
        if (
            _factor(middle, nz, h[k], eigenvalues, product, real, imaginary, pivots)
            != 0
        ):
            return 1
        for column in range(count):
            stages, state = x[k * count + column], current[column]
            copy(state, starts[k * count + column])
            if backward == 1 and k < len(P):
                _apply(P[k], starts[k * count + column], state)
            for i in range(s):
                weight = h[k] * A[i, s - 1] if backward == 1 else 1.0
                for j in range(N):
                    b[i, j] = r[i, j] = stages[i, j] + weight * state[j]
                    stages[i, j] = 0.0
            last, converged = 0.0, 0
            for _ in range(MAX_ITERATIONS + 1):
                _precondition(
                    middle,
                    nz,
                    h[k],
                    eigenvalues,
                    to_pairs,
                    from_pairs,
                    real,
                    imaginary,
                    r,
                    w,
                    change,
                )
                for i in range(s):
                    for j in range(N):
                        stages[i, j] += change[i, j]
                size = _largest(stages, weights, best)
                new = _largest(change, weights, best)
                if new * new <= TOLERANCE * size * last or (
                    2.0 * new > last and new <= ROUNDING * size
                ):
                    converged = 1
                    break
                last = new
                for i in range(s):
                    _apply(F[k * s + i], stages[i], f[i])
                _transform(A, f, r)
                for i in range(s):
                    for j in range(N):
                        r[i, j] = b[i, j] - stages[i, j] + h[k] * r[i, j]
            if converged == 0:
                return 1
            after = added[k * count + column]
            if backward == 1:
                for i in range(s):
                    _apply(F[k * s + i], stages[i], f[i])
                    for j in range(N):
                        state[j] += f[i, j]
            elif k < len(P):
                _apply(P[k], stages[s - 1], state)
            else:
                copy(stages[s - 1], state)
            for j in range(N):
                state[j] += after[j]
    return 0
