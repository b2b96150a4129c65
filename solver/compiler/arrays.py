"""Arrays and functions in kernels: addresses with shapes or signatures.

A kernel neither allocates nor frees arrays, reads rows in full and uses no negative
indices. Therefore a view consists of the address of the first entry and the shape,
which compiles and runs faster than an array of numba.
"""

import ctypes
import os
from typing import Any, NamedTuple

import numpy as np

from .types import KernelType

#: Whether kernels stop at an index outside of an array; for those who write kernels.
CHECKED = os.environ.get("SIDTOOL_CHECK_BOUNDS") == "1"


class ViewType(KernelType):
    """The compiled type of a C-contiguous array."""

    def __init__(self, dtype: Any, ndim: int) -> None:
        self.dtype, self.ndim = dtype, ndim
        self.numbers = np.dtype(str(dtype))
        super().__init__(f"view of {dtype} in {ndim} dimensions")


def array_words(kind: Any, array: Any) -> list[int]:
    """The address of an array and its shape.

    Raises TypeError where it is not one of this kind.
    """
    fits = array.ndim == kind.ndim and array.dtype == kind.numbers
    if not (fits and array.flags.c_contiguous):
        raise TypeError(f"not an array of {kind}: {array.dtype}, {array.shape}")
    return [address_of(array), *array.shape]


def address_of(array: Any) -> int:
    """Of the first entry of a C-contiguous array."""
    if array.size and array.flags.writeable:  # takes a quarter of the time
        return ctypes.addressof(ctypes.c_byte.from_buffer(array))
    return int(array.__array_interface__["data"][0])


class Pointer(NamedTuple):
    """The address of a compiled function, as a field of a table."""

    address: int
    signature: Any


class PointerType(KernelType):
    """The compiled type of the address of a function with one signature."""

    def __init__(self, signature: Any) -> None:
        self.signature = signature
        super().__init__(f"pointer to {signature}")
