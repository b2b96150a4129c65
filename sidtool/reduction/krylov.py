"""Rational Krylov vectors of an undamped body.

Source: J. Fehr, P. Eberhard, "Simulation process of flexible multibody systems with
non-modal model order reduction techniques", Multibody System Dynamics 25, 2011;
E. Grimme, "Krylov projection methods for model reduction", 1997.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from sidtool.formats.errors import InputError
from sidtool.formats.model.reduction import KrylovReduction

from .space import Space

Array = NDArray[np.float64]


def krylov_vectors(
    space: Space, loads: Array, settings: KrylovReduction
) -> Iterator[tuple[float, Array, int]]:
    """(K - w^2 M)^-1 B and their derivatives by w^2, for every expansion point w.

    With these vectors the reduced transfer functions between the loads agree with the
    full ones at w in the value and in the first 2 `moments` - 1 derivatives by w^2,
    since the projection is symmetric.

    Parameters
    ----------
    loads : (ndof, n) load vectors B

    Yields
    ------
    frequency [Hz], vectors (ndof, n moments), moments

    Raises
    ------
    InputError : an expansion point is an eigenfrequency.
    """
    for frequency in settings.frequencies:
        solve = _solver(space, 2 * np.pi * frequency)
        vectors = [solve(space.loads(loads))]
        for _ in range(settings.moments - 1):
            last = vectors[-1] / np.linalg.norm(vectors[-1], axis=0)
            vectors.append(solve(space.mass @ last))
        shapes = space.displacements(np.hstack(vectors))
        if not np.isfinite(shapes).all():
            raise _resonance(frequency)
        yield frequency, shapes, settings.moments


class _Dynamic:
    """Solves (K - w^2 M) y = f with the constraints of a space."""

    def __init__(self, space: Space, omega: float) -> None:
        k, m = space.stiffness, space.mass
        rows = sp.csr_matrix(space.constraints * float(k.diagonal().mean()))
        matrix = k - omega**2 * m
        if rows.shape[0]:
            matrix = sp.block_array([[matrix, rows.T], [rows, None]])
        try:
            self._factors = splu(sp.csc_matrix(matrix))
        except RuntimeError:
            raise _resonance(omega / (2 * np.pi)) from None
        self._extra = rows.shape[0]

    def __call__(self, loads: Array) -> Array:
        padded = np.vstack([loads, np.zeros((self._extra, loads.shape[1]))])
        return self._factors.solve(padded)[: len(loads)]


def _solver(space: Space, omega: float) -> Callable[[Array], Array]:
    if omega > 0:
        return _Dynamic(space, omega)
    identity = sp.csr_matrix(sp.eye_array(space.stiffness.shape[0]))
    return replace(space, transform=identity).static


def _resonance(frequency: float) -> InputError:
    return InputError(
        f"{frequency:g} Hz is an eigenfrequency of the body",
        place="reduction.frequencies",
        expected="expansion points beside the eigenfrequencies",
    )
