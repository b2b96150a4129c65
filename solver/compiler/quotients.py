"""Quotients of real and of complex numbers that do not fail.

numba's own of complex numbers raises an error for zero, which a kernel cannot tell
anybody; here the result is infinite or not a number, as that of real ones.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import typeof_impl

from .inner import Inner, InnerType, inner


@inner()
def _real(a, b):
    return a / b


@inner()
def _complex(a, b):
    """R. L. Smith, Algorithm 116: Complex division, Comm. ACM 5 (1962)."""
    if abs(b.real) >= abs(b.imag):
        ratio = b.imag / b.real
        scale = b.real + b.imag * ratio
        return complex(
            (a.real + a.imag * ratio) / scale, (a.imag - a.real * ratio) / scale
        )
    ratio = b.real / b.imag
    scale = b.real * ratio + b.imag
    return complex((a.real * ratio + a.imag) / scale, (a.imag * ratio - a.real) / scale)


class _ByNumber:
    """A kernel for real numbers and one for complex ones."""

    py_funcs = _real.py_func, _complex.py_func

    def chosen(self, arguments: Any) -> Inner:
        """The kernel that is called with arguments of these types."""
        real = not any(isinstance(a, types.Complex) for a in arguments)
        return _real if real else _complex  # type: ignore[no-any-return]


@typeof_impl.register(_ByNumber)
def _type_of(value: _ByNumber, context: Any) -> InnerType:
    return InnerType(value)


#: a / b
quotient = _ByNumber()
