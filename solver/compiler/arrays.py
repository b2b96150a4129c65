"""Arrays and functions in kernels: addresses with shapes or signatures.

A kernel neither allocates nor frees arrays, reads rows in full and uses no negative
indices. Therefore a view consists of the address of the first entry and the shape,
which compiles and runs faster than an array of numba.
"""

import ctypes
import operator
import os
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_getattr,
    infer_global,
    signature,
)
from numba.extending import lower_builtin, lower_getattr, register_model

INDEX = ir.IntType(64)
#: Whether kernels stop at an index outside of an array; for those who write kernels.
CHECKED = os.environ.get("SIDTOOL_CHECK_BOUNDS") == "1"


def check_index(builder: Any, index: Any, extent: Any) -> None:
    """Ends the process where an index is outside, if that is requested."""
    if not CHECKED:
        return
    module, number, text = builder.module, ir.IntType(32), ir.IntType(8).as_pointer()
    with builder.if_then(builder.icmp_unsigned(">=", index, extent), likely=False):
        text_format = f"sidtool: index %lld of %lld in {builder.function.name}\n"
        message = cgutils.global_constant(
            module, "outside", cgutils.make_bytearray(f"{text_format}\0".encode())
        )
        kind = ir.FunctionType(number, [number, text], var_arg=True)
        print_function = cgutils.get_or_insert_function(module, kind, "dprintf")
        address = builder.bitcast(message, text)
        builder.call(print_function, [ir.Constant(number, 2), address, index, extent])
        abort_type = ir.FunctionType(ir.VoidType(), [])
        builder.call(cgutils.get_or_insert_function(module, abort_type, "abort"), [])


class ViewType(types.Type):
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


@register_model(ViewType)
class _ViewModel(models.StructModel):
    def __init__(self, manager: Any, kind: ViewType) -> None:
        members: list[Any] = [("data", types.CPointer(kind.dtype))]
        members += [(f"n{axis}", types.intp) for axis in range(kind.ndim)]
        super().__init__(manager, kind, members)


def make_view(context: Any, kind: ViewType, builder: Any, parts: list[Any]) -> Any:
    """A view of an address and the extents behind it."""
    view = ir.Constant(context.get_value_type(kind), ir.Undefined)
    for position, part in enumerate(parts):
        view = builder.insert_value(view, part, position)
    return view


def _index_count(index: Any) -> int | None:
    """How many indices a type stands for."""
    if isinstance(index, types.Integer):
        return 1
    kinds: Any = index if isinstance(index, types.BaseTuple) else [None]
    if all(isinstance(kind, types.Integer) for kind in kinds):
        return len(kinds)
    return None


def _item_type(view: Any, index: Any) -> Any:
    """The entry at an index; None where that is no matter of views."""
    count = _index_count(index)
    if not isinstance(view, ViewType) or count is None or count > view.ndim:
        return None
    left = view.ndim - count
    return ViewType(view.dtype, left) if left else view.dtype


@infer_global(operator.getitem)
class _Get(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        kind = _item_type(*args)
        return None if kind is None else signature(kind, *args)


@infer_global(operator.setitem)
class _Set(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        view, index, value = args
        kind = _item_type(view, index)
        if kind is None or isinstance(kind, ViewType):
            return None
        return signature(types.none, view, index, kind)


def _item_address(
    context: Any, builder: Any, kinds: Any, values: Any
) -> tuple[Any, list]:  # type: ignore[type-arg]
    """Address of an entry or a row, and the extents of what is there."""
    (kind, index_kind), (view, index) = kinds, values
    indices, index_kinds = [index], [index_kind]
    if not isinstance(index_kind, types.Integer):
        index_kinds = list(index_kind)
        indices = [builder.extract_value(index, i) for i in range(len(index_kinds))]
    extents = [builder.extract_value(view, 1 + axis) for axis in range(kind.ndim)]
    position = None
    for axis, extent in enumerate(extents):
        if position is not None:
            position = builder.mul(position, extent)
        if axis < len(indices):
            i = context.cast(builder, indices[axis], index_kinds[axis], types.intp)
            check_index(builder, i, extent)
            position = i if position is None else builder.add(position, i)
    address = builder.gep(builder.extract_value(view, 0), [position], inbounds=True)
    return address, extents[len(indices) :]


@lower_builtin(operator.getitem, ViewType, types.Integer)
@lower_builtin(operator.getitem, ViewType, types.BaseTuple)
def _get(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    address, left = _item_address(context, builder, sig.args, args)
    if left:
        return make_view(context, sig.return_type, builder, [address, *left])
    return builder.load(address)


@lower_builtin(operator.setitem, ViewType, types.Integer, types.Any)
@lower_builtin(operator.setitem, ViewType, types.BaseTuple, types.Any)
def _set(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    address, _ = _item_address(context, builder, sig.args[:2], args[:2])
    builder.store(args[2], address)
    return context.get_dummy_value()


@infer_global(len)
class _Length(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        known = isinstance(args[0], ViewType)
        return signature(types.intp, *args) if known else None


@lower_builtin(len, ViewType)
def _length(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.extract_value(args[0], 1)


@infer_getattr
class _Attributes(AttributeTemplate):
    key = ViewType

    def resolve_shape(self, view: ViewType) -> Any:
        return types.UniTuple(types.intp, view.ndim)


@lower_getattr(ViewType, "shape")
def _shape(context: Any, builder: Any, kind: ViewType, view: Any) -> Any:
    extents = [builder.extract_value(view, 1 + i) for i in range(kind.ndim)]
    return context.make_tuple(builder, types.UniTuple(types.intp, kind.ndim), extents)


class Pointer(NamedTuple):
    """The address of a compiled function, as a field of a table."""

    address: int
    signature: Any


class PointerType(types.Callable):  # type: ignore[misc]
    """The compiled type of the address of a function with one signature."""

    def __init__(self, signature: Any) -> None:
        self.signature = signature
        super().__init__(f"pointer to {signature}")

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        kinds = self.signature.args
        if len(args) != len(kinds) or not all(
            context.can_convert(given, kind) is not None
            for given, kind in zip(args, kinds, strict=True)
        ):
            return None
        return signature(self.signature.return_type, *kinds, recvr=self)

    def get_call_signatures(self) -> Any:
        return (self.signature,), False

    def get_impl_key(self, sig: Any) -> Any:
        return type(self)


@register_model(PointerType)
class _PointerModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: PointerType) -> None:
        super().__init__(manager, kind, INDEX)


@lower_builtin(PointerType, types.VarArg(types.Any))
def _call_pointer(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Calls by value, as C callbacks of numba are called."""
    pointer, *values = args
    result = context.get_value_type(sig.return_type)
    kinds = [value.type for value in values]
    function = builder.inttoptr(pointer, ir.FunctionType(result, kinds).as_pointer())
    return builder.call(function, values)
