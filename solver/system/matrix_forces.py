"""Forces F = -K g - D g' on several measures g of two markers, with full matrices.

The symmetric parts are sums of products w w^T: each is a spring or damper on the
weighted sum w g of the measures, so that its energy is known. The antisymmetric rest of
K and D has no potential and is a law that reads the measures.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sidtool.formats.base.sid import Array

from ..dynamics import control_laws as op
from ..spatial import system_arrays as at
from .force_rows import ControlledForce, ForceLaw, ForceRow, polynomial_force

#: Eigenvalues below this part of the largest are rounding of the matrix.
_ROUNDING = 1e-14


def as_matrix(values: tuple[float, ...] | tuple[tuple[float, ...], ...]) -> Array:
    """The matrix of rows, or with values on its diagonal, (n, n)."""
    given = np.array(values, float)
    return np.diag(given) if given.ndim == 1 else given


def symmetric_force_rows(
    measures: Sequence[ForceRow], K: Array, D: Array
) -> list[ForceRow]:
    """Springs and dampers on the measures, and on sums of those that are coupled."""
    K, D = (K + K.T) / 2.0, (D + D.T) / 2.0
    uncoupled = ~np.array(
        [np.delete(np.abs(K[i]) + np.abs(D[i]), i).any() for i in range(len(K))]
    )
    rows = [
        replace(
            measure,
            law=ForceLaw(
                stiffness=polynomial_force((k,)), damping=polynomial_force((d,))
            ),
        )
        for measure, k, d, is_alone in zip(
            measures, np.diag(K), np.diag(D), uncoupled, strict=True
        )
        if is_alone and (k != 0.0 or d != 0.0)
    ]
    coupled = [int(i) for i in np.flatnonzero(~uncoupled)]
    coupled_measures = [measures[i] for i in coupled]
    for size, weights in _rank_one_terms(K[np.ix_(coupled, coupled)]):
        rows += _combined_force_rows(
            coupled_measures, weights, ForceLaw(stiffness=polynomial_force((size,)))
        )
    for size, weights in _rank_one_terms(D[np.ix_(coupled, coupled)]):
        rows += _combined_force_rows(
            coupled_measures, weights, ForceLaw(damping=polynomial_force((size,)))
        )
    return rows


def _rank_one_terms(matrix: Array) -> Iterator[tuple[float, Array]]:
    """Sizes and vectors whose products with themselves add up to a matrix.

    Lengths and angles are made comparable first, for the sake of rounding.
    """
    diagonal = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    sizes, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    least = _ROUNDING * np.abs(sizes).max(initial=0.0)
    for size, vector in zip(sizes, vectors.T, strict=True):
        if abs(size) > least:
            yield float(size), vector * scale


def _combined_force_rows(
    measures: list[ForceRow], weights: Array, law: ForceLaw
) -> list[ForceRow]:
    """The rows of a force on a weighted sum of measures."""
    used = [(m, float(w)) for m, w in zip(measures, weights, strict=True) if w != 0.0]
    data = (float(len(used)), *(weight for _, weight in used))
    read = [replace(measure, is_measure=True) for measure, _ in used]
    return [*read, replace(measures[0], kind=at.COMBINED_MEASURE, data=data, law=law)]


def antisymmetric_force_rows(
    measures: Sequence[ForceRow], K: Array, D: Array
) -> list[ForceRow]:
    """The rows of laws that give each measure its force of the others."""
    K, D = (K - K.T) / 2.0, (D - D.T) / 2.0
    rows: list[ForceRow] = []
    for i, measure in enumerate(measures):
        others = [int(j) for j in np.flatnonzero((K[i] != 0.0) | (D[i] != 0.0))]
        if not others:
            continue
        entries: list[tuple[float, float, float]] = []
        for number, j in enumerate(others):
            for order, factor in enumerate((K[i, j], D[i, j])):
                is_first = not entries
                entries.append((op.MEASURE, number, order))
                entries.append((op.CONSTANT, -factor, 0.0))
                entries.append((op.MULTIPLY, 0.0, 0.0))
                if not is_first:
                    entries.append((op.ADD, 0.0, 0.0))
        flat = [float(entry) for triple in entries for entry in triple]
        code = (float(len(others)), float(len(entries)), *flat)
        rows += [replace(measures[j], is_measure=True) for j in others]
        law = ForceLaw(applied=1.0)
        control = ControlledForce({}, ())
        rows.append(replace(measure, law=law, code=code, control=control))
    return rows
