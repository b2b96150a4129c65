"""Extremes among numbers that rounding may have changed."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

#: Numbers that differ by less than this part of the largest count as equal.
EQUAL = 1e-6


def first_largest(values: ArrayLike, axis: int | None = None) -> Any:
    """Return the index of the first value that is the largest up to rounding.

    Symmetric bodies have equal values at several places. Which one `argmax` returns
    is decided by rounding, and so by the processor.

    Parameters
    ----------
    values : not negative, at least one
    axis : with an axis, the result is an array of indices, see `numpy.argmax`
    """
    sizes = np.asarray(np.real(values), float)
    largest = sizes.max(axis=axis, keepdims=True)
    return np.argmax(sizes >= (1.0 - EQUAL) * largest, axis=axis)
