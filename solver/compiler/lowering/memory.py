"""Arrays, records, tables and addresses of functions in machine code."""

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_getattr,
    infer_global,
    signature,
)
from numba.extending import (
    lower_builtin,
    lower_getattr,
    lower_getattr_generic,
    lower_setattr_generic,
    models,
    register_model,
)

from ..arrays import CHECKED, PointerType, ViewType
from ..records import RecordType, RowsType
from ..tables import TableType
from ..types import float64, int64
from ..vectors import ValueType
from .numba_types import Wrapped, numba_type, wrapper, wraps

INDEX, REAL = ir.IntType(64), ir.DoubleType()
View, Record = wrapper(ViewType), wrapper(RecordType)
Rows, TableAddress = wrapper(RowsType), wrapper(TableType)


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


@register_model(View)
class _ViewModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        members: list[Any] = [("data", types.CPointer(numba_type(kind.kind.dtype)))]
        members += [(f"n{axis}", types.intp) for axis in range(kind.kind.ndim)]
        super().__init__(manager, kind, members)


def make_view(context: Any, kind: Any, builder: Any, parts: list[Any]) -> Any:
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
    if not isinstance(view, View) or count is None or count > view.kind.ndim:
        return None
    dtype, left = view.kind.dtype, view.kind.ndim - count
    return numba_type(ViewType(dtype, left) if left else dtype)


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
        if kind is None or isinstance(kind, View):
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
    extents = [builder.extract_value(view, 1 + axis) for axis in range(kind.kind.ndim)]
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


@lower_builtin(operator.getitem, View, types.Integer)
@lower_builtin(operator.getitem, View, types.BaseTuple)
def _get(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    address, left = _item_address(context, builder, sig.args, args)
    if left:
        return make_view(context, sig.return_type, builder, [address, *left])
    return builder.load(address)


@lower_builtin(operator.setitem, View, types.Integer, types.Any)
@lower_builtin(operator.setitem, View, types.BaseTuple, types.Any)
def _set(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    address, _ = _item_address(context, builder, sig.args[:2], args[:2])
    builder.store(args[2], address)
    return context.get_dummy_value()


@infer_global(len)
class _Length(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        known = isinstance(args[0], View)
        return signature(types.intp, *args) if known else None


@lower_builtin(len, View)
def _length(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.extract_value(args[0], 1)


@infer_getattr
class _Attributes(AttributeTemplate):
    key = View

    def resolve_shape(self, view: Any) -> Any:
        return types.UniTuple(types.intp, view.kind.ndim)


@lower_getattr(View, "shape")
def _shape(context: Any, builder: Any, kind: Any, view: Any) -> Any:
    n = kind.kind.ndim
    extents = [builder.extract_value(view, 1 + i) for i in range(n)]
    return context.make_tuple(builder, types.UniTuple(types.intp, n), extents)


@wraps(PointerType)
class Function(Wrapped, types.Callable):  # type: ignore[misc]
    """The address of a function with one signature, in numba."""

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        called = numba_type(self.kind.signature)
        kinds = called.args
        if len(args) != len(kinds) or not all(
            context.can_convert(given, kind) is not None
            for given, kind in zip(args, kinds, strict=True)
        ):
            return None
        return called.replace(recvr=self)

    def get_call_signatures(self) -> Any:
        return (numba_type(self.kind.signature),), False

    def get_impl_key(self, sig: Any) -> Any:
        return type(self)


@register_model(Function)
class _FunctionModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Function) -> None:
        super().__init__(manager, kind, INDEX)


@lower_builtin(Function, types.VarArg(types.Any))
def _call_pointer(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Calls by value, as C callbacks of numba are called."""
    pointer, *values = args
    result = context.get_value_type(sig.return_type)
    kinds = [value.type for value in values]
    function = builder.inttoptr(pointer, ir.FunctionType(result, kinds).as_pointer())
    return builder.call(function, values)


for _kind in (Record, Rows):

    @register_model(_kind)
    class _RecordAddressModel(models.PrimitiveModel):
        def __init__(self, manager: Any, kind: Any) -> None:
            real = isinstance(kind, Record) and kind.kind.number == float64
            number = REAL if real else INDEX
            super().__init__(manager, kind, number.as_pointer())


@infer_getattr
class _FieldOfRecord(AttributeTemplate):
    key = Record

    def generic_resolve(self, kind: Any, field: str) -> Any:  # type: ignore[override]
        return numba_type(kind.kind.fields.get(field))


def _field_address(
    builder: Any, kind: RecordType, record: Any, field: str, i: int = 0
) -> Any:
    offset = ir.Constant(INDEX, kind.places[field] + i)
    return builder.gep(record, [offset], inbounds=True)


@lower_getattr_generic(Record)
def _get_field(context: Any, builder: Any, kind: Any, record: Any, field: str) -> Any:
    kind = kind.kind
    member = kind.fields[field]
    if not isinstance(member, ValueType):
        loaded = builder.load(_field_address(builder, kind, record, field))
        return _mark_invariant(builder, loaded) if kind.number == int64 else loaded
    value = ir.Constant(context.get_value_type(numba_type(member)), ir.Undefined)
    for i in range(member.size):
        loaded = builder.load(_field_address(builder, kind, record, field, i))
        value = builder.insert_value(value, loaded, i)
    return value


@lower_setattr_generic(Record)
def _set_field(context: Any, builder: Any, sig: Any, args: Any, field: str) -> None:
    kind = sig.args[0].kind
    member = kind.fields[field]
    record, value = args
    value = context.cast(builder, value, sig.args[1], numba_type(member))
    if not isinstance(member, ValueType):
        builder.store(value, _field_address(builder, kind, record, field))
        return
    for i in range(member.size):
        number = builder.extract_value(value, i)
        builder.store(number, _field_address(builder, kind, record, field, i))


@infer_global(operator.getitem)
class _RowOfTable(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        rows, index = args
        if isinstance(rows, Rows) and isinstance(index, types.Integer):
            return signature(numba_type(rows.kind.record), rows, index)
        return None


@lower_builtin(operator.getitem, Rows, types.Integer)
def _get_row(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    record = sig.args[0].kind.record
    index = context.cast(builder, args[1], sig.args[1], types.int64)
    check_index(builder, index, load_invariant_word(builder, args[0], 1))
    offset = builder.mul(index, ir.Constant(INDEX, record.size))
    number = REAL if record.number == float64 else INDEX
    data = builder.inttoptr(
        load_invariant_word(builder, args[0], 0), number.as_pointer()
    )
    return builder.gep(data, [offset], inbounds=True)


@infer_global(len)
class _LengthOfTable(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if isinstance(args[0], Rows):
            return signature(types.intp, *args)
        return None


@lower_builtin(len, Rows)
def _count_rows(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return load_invariant_word(builder, args[0], 1)


def load_invariant_word(builder: Any, words: Any, index: int) -> Any:
    """A word of a table; tables do not change."""
    return _mark_invariant(
        builder, builder.load(builder.gep(words, [ir.Constant(INDEX, index)]))
    )


def _mark_invariant(builder: Any, word: Any) -> Any:
    """Marks that kernels do not write there, so that it is read once."""
    word.set_metadata("invariant.load", builder.module.add_metadata([]))
    return word


@register_model(TableAddress)
class _TableModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, cgutils.voidptr_t)


@infer_getattr
class _TableAttribute(AttributeTemplate):
    key = TableAddress

    def generic_resolve(self, kind: Any, field: str) -> Any:  # type: ignore[override]
        return numba_type(kind.kind.members.get(field))


@lower_getattr_generic(TableAddress)
def _load_field(context: Any, builder: Any, kind: Any, table: Any, field: str) -> Any:
    kind = kind.kind
    member, start = kind.members[field], kind.offsets[field]
    if field in kind.scalars:
        return builder.load(_place_of_number(context, builder, kind, table, field))
    words = builder.bitcast(table, INDEX.as_pointer())
    address = load_invariant_word(builder, words, start)
    if isinstance(member, RowsType):
        return builder.gep(words, [ir.Constant(INDEX, start)])
    if isinstance(member, TableType):
        return builder.inttoptr(address, cgutils.voidptr_t)
    if isinstance(member, PointerType):
        return address
    kind_of_entry = context.get_data_type(numba_type(member.dtype)).as_pointer()
    extents = [
        load_invariant_word(builder, words, start + 1 + i) for i in range(member.ndim)
    ]
    data = builder.inttoptr(address, kind_of_entry)
    return make_view(context, numba_type(member), builder, [data, *extents])


@lower_setattr_generic(TableAddress)
def _store_field(context: Any, builder: Any, sig: Any, args: Any, field: str) -> None:
    kind, (table, value) = sig.args[0].kind, args
    member = numba_type(kind.members[field])
    value = context.cast(builder, value, sig.args[1], member)
    builder.store(value, _place_of_number(context, builder, kind, table, field))


def _place_of_number(
    context: Any, builder: Any, kind: TableType, table: Any, field: str
) -> Any:
    number = context.get_data_type(numba_type(kind.members[field]))
    numbers = builder.bitcast(table, number.as_pointer())
    return builder.gep(numbers, [ir.Constant(INDEX, kind.offsets[field])])
