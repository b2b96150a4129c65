"""Matrices that depend on the elastic coordinates of a body."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .complex_step import number_type

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Taylor:
    """A matrix that depends on the elastic coordinates: M(q) = m0 + sum_l m1[l] q_l.

    Attributes
    ----------
    m0 : (nrow, ncol) value at q = 0
    m1 : (nq, nrow, ncol) derivative by each elastic coordinate; None at order 0
    mn : (nqn, nrow, ncol) coefficients of terms above the first, stored as read;
        no producer writes them and their meaning is not defined; None otherwise
    order : declared order of the expansion; at least 1 with m1, 2 with mn
    """

    m0: Array
    m1: Array | None = None
    mn: Array | None = None
    order: int = 0

    def __post_init__(self) -> None:
        implied = 2 if self.mn is not None else (1 if self.m1 is not None else 0)
        object.__setattr__(self, "order", max(self.order, implied))
        for name in ("m0", "m1", "mn"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _read_only(value))

    @property
    def shape(self) -> tuple[int, int]:
        """(nrow, ncol)."""
        rows, columns = self.m0.shape
        return rows, columns

    @property
    def is_zero(self) -> bool:
        """True when every stored coefficient is zero."""
        stored = (self.m0, self.m1, self.mn)
        return not any(part is not None and part.any() for part in stored)

    def first_order(self, nq: int) -> Array:
        """m1 as (nq, nrow, ncol), zeros where the expansion has none."""
        return np.zeros((nq, *self.shape)) if self.m1 is None else self.m1

    def at(self, q: ArrayLike) -> Array:
        """M(q), (nrow, ncol), to first order."""
        if self.m1 is None:
            return self.m0
        return self.m0 + np.tensordot(np.asarray(q, float), self.m1, axes=1)


def _read_only(value: ArrayLike) -> Array:
    array = np.array(value, dtype=number_type(value), order="C")
    array.setflags(write=False)
    return array
