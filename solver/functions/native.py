"""Callables of a program as addresses that kernels call, compiled where they can be.

What numba compiles is called at the cost of a function in C; another one through
Python, with the same numbers. A callable that fails gives no number, and what it said
is kept until the run asks for it.
"""

from __future__ import annotations

import ctypes
import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sidtool.formats.sid import Array

from .returned_values import real_number

_SIGNATURE = ctypes.CFUNCTYPE(
    ctypes.c_double, ctypes.c_double, ctypes.POINTER(ctypes.c_double), ctypes.c_int64
)
VALUE = -1


class Native:
    """A function f(t, y) and, if they are given, its derivatives by y.

    Kernels call `double f(double t, double *y, long i)`: the value for i = -1, else the
    derivative by y[i].

    Attributes
    ----------
    address : of that function
    compiled : whether numba could compile what was given
    raised : an exception that has to go on as soon as the kernel returns, or None
    failure : the last time [s] at which it gave no number, and why; None if it always
        did, and of what numba compiled
    """

    def __init__(
        self,
        function: Callable[[float, Array], float],
        count: int,
        derivatives: Callable[[float, Array], Sequence[float]] | None = None,
    ) -> None:
        self.function, self.count = function, count
        self.derivatives = derivatives
        self.raised: BaseException | None = None
        self.failure: tuple[float, str] | None = None
        self._kept: Any = _compiled(function, derivatives, count)
        self.compiled = self._kept is not None
        if self._kept is None:
            self._kept = _SIGNATURE(self._call)
            address = ctypes.cast(self._kept, ctypes.c_void_p).value
        else:
            address = self._kept.address
        assert address is not None
        self.address = int(address)

    def go_on(self) -> None:
        """Raises what has to go on, such as KeyboardInterrupt."""
        if self.raised is not None:
            error, self.raised = self.raised, None
            raise error

    def _call(self, t: float, y: Any, i: int) -> float:
        if self.raised is not None:
            return math.nan
        try:
            values = np.array(y[: self.count])
            if i == VALUE:
                return real_number(self.function(t, values))
            assert self.derivatives is not None
            return real_number(self.derivatives(t, values)[i])
        except Exception as error:
            what = "" if i == VALUE else "has derivatives that "
            self.failure = t, what + _fails(error, plural=i != VALUE)
            return math.nan
        except BaseException as error:
            self.raised = error
            return math.nan

    def complaint(self, t: float, y: Array) -> str:
        """Why it gives no number at a time and for outputs."""
        if self.failure is not None and self.failure[0] == t:
            return self.failure[1]
        try:
            value = real_number(self.function(t, np.array(y)))
        except Exception as error:
            return _fails(error)
        return f"gives {value}"


def _fails(error: Exception, plural: bool = False) -> str:
    return f"fail{'' if plural else 's'} with {type(error).__name__}: {error}"


def _compiled(function: Any, derivatives: Any, count: int) -> Any:
    """What numba makes of them, or None."""
    import numba

    f = _jitted(numba, function)
    g = f if derivatives is None else _jitted(numba, derivatives)
    known = derivatives is not None
    if f is None or g is None:
        return None

    def call(t, y, i):  # type: ignore[no-untyped-def]
        try:
            if i < 0:
                return float(f(t, numba.carray(y, (count,))))
            if known:
                return float(g(t, numba.carray(y, (count,)))[i])
            return math.nan
        except Exception:
            return math.nan

    kinds = numba.types
    signature = kinds.double(kinds.double, kinds.CPointer(kinds.double), kinds.int64)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            made = numba.cfunc(signature)(call)
    except Exception:
        return None
    return made if _gives_numbers(f) else None


def _gives_numbers(function: Any) -> bool:
    """Whether what numba compiled gives numbers; `float` of numba takes truth values
    and texts, too."""
    from numba import types

    overloads = getattr(function, "overloads", {}).values()
    kinds = [types.unliteral(each.signature.return_type) for each in overloads]
    return all(isinstance(kind, types.Number) for kind in kinds)


def _jitted(numba: Any, function: Any) -> Any:
    if hasattr(function, "py_func"):
        return function
    try:
        return numba.njit(function)
    except Exception:
        return None
