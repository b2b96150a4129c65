"""Types of kernels as types of numba."""

from collections.abc import Callable
from typing import Any

from numba import types
from numba.core.typing.templates import signature

from ..types import KernelType, Signature, UniTuple

#: Classes of numba's types by the classes of types that they stand for.
_CLASSES: dict[type[KernelType], Any] = {}


class Wrapped(types.Type):
    """Type in numba of a type of kernels.

    Attributes
    ----------
    kind
        That type.
    """

    def __init__(self, kind: KernelType) -> None:
        self.kind: Any = kind
        super().__init__(repr(kind))


def wraps(kind: type[KernelType]) -> Callable[[Any], Any]:
    """Marks the class of numba's types that stand for types of a class."""
    return lambda numba_class: _CLASSES.setdefault(kind, numba_class)


def wrapper(kind: type[KernelType]) -> Any:
    """A class of numba's types that stand for types of a class."""
    return wraps(kind)(type(kind.__name__, (Wrapped,), {}))


def numba_type(kind: Any) -> Any:
    """The type or signature of numba; what is of numba itself stays as it is."""
    if isinstance(kind, Signature):
        return signature(numba_type(kind.return_type), *map(numba_type, kind.args))
    if isinstance(kind, UniTuple):
        return types.UniTuple(numba_type(kind.dtype), kind.count)
    if type(kind) is KernelType:
        return getattr(types, kind.name)
    return _CLASSES[type(kind)](kind) if isinstance(kind, KernelType) else kind


def kernel_type(kind: Any) -> Any:
    """The type of kernels that a type of numba stands for."""
    return kind.kind if isinstance(kind, Wrapped) else KernelType(str(kind))
