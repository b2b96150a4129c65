"""Types of numbers in kernels, and signatures of kernels.

They do not need numba, which is imported where a kernel is compiled; `lowering` maps
them to types of numba.
"""

from __future__ import annotations

from typing import Any, NamedTuple


class KernelType:
    """A type that kernels know by its name; types of one class and name are equal.

    A call of it with types of arguments makes a signature that returns it.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def __repr__(self) -> str:
        return self.name

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and repr(other) == self.name

    def __hash__(self) -> int:
        return hash(self.name)

    def __call__(self, *arguments: Any) -> Signature:
        return Signature(self, arguments)


class Signature(NamedTuple):
    """Types of a kernel's result and arguments."""

    return_type: Any
    args: tuple[Any, ...]

    def __str__(self) -> str:
        return f"({', '.join(map(str, self.args))}) -> {self.return_type}"


class UniTuple(KernelType):
    """So many values of one type."""

    def __init__(self, dtype: KernelType, count: int) -> None:
        self.dtype, self.count = dtype, count
        super().__init__(f"UniTuple({dtype} x {count})")


boolean, int64, float64, complex128 = map(
    KernelType, ("boolean", "int64", "float64", "complex128")
)
#: Of kernels that return nothing.
void = KernelType("none")
