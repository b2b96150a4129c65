"""Values in machine code, and formulas that write it."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

from ..vectors import KernelValue, ValueType, new_formulas
from .memory import INDEX, REAL, View
from .numba_types import numba_type, wrapper

Value = wrapper(ValueType)


@register_model(Value)
class _ValueModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        members = [(f"x{i}", types.float64) for i in range(kind.kind.size)]
        super().__init__(manager, kind, members)


class Number:
    """A number in machine code that is being written; constants are folded."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value
        self.real = value.type == REAL

    def _binary(self, other: Any, operation: str) -> Number:
        value = other.value if isinstance(other, Number) else self.constant(other).value
        write = getattr(self.builder, f"f{operation}" if self.real else operation)
        return Number(self.builder, write(self.value, value))

    def constant(self, value: float) -> Number:
        """A number of the same kind."""
        kind = REAL if self.real else INDEX
        return Number(self.builder, ir.Constant(kind, value))

    def __add__(self, other: Any) -> Number:
        return self if _is_constant(other, 0) else self._binary(other, "add")

    def __sub__(self, other: Any) -> Number:
        return self if _is_constant(other, 0) else self._binary(other, "sub")

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, KernelValue):
            return NotImplemented
        if _is_constant(other, 0) or _is_constant(other, 1):
            return self if other else 0.0
        return self._binary(other, "mul")

    def __truediv__(self, other: Any) -> Number:
        return self._binary(other, "div")

    def __rtruediv__(self, other: Any) -> Number:
        return self.constant(other) / self

    def __rsub__(self, other: Any) -> Number:
        return -self if _is_constant(other, 0) else self.constant(other) - self

    def __neg__(self) -> Number:
        return Number(self.builder, self.builder.fneg(self.value))

    __radd__, __rmul__ = __add__, __mul__

    def matches(self, index: int) -> Number:
        """1.0 where this index is the given one, else 0.0."""
        same = self.builder.icmp_signed("==", self.value, ir.Constant(INDEX, index))
        one, none = ir.Constant(REAL, 1.0), ir.Constant(REAL, 0.0)
        return Number(self.builder, self.builder.select(same, one, none))


def _is_constant(number: Any, constant: int) -> bool:
    return not isinstance(number, Number) and bool(number == constant)


class CodeArray:
    """Numbers in memory, by their index."""

    def __init__(self, builder: Any, address: Any) -> None:
        self._builder, self._address = builder, address

    def _entry_address(self, index: Any) -> Any:
        at = index.value if isinstance(index, Number) else ir.Constant(INDEX, index)
        return self._builder.gep(self._address, [at], inbounds=True)

    def __getitem__(self, index: Any) -> Number:
        return Number(self._builder, self._builder.load(self._entry_address(index)))

    def __setitem__(self, index: Any, number: Any) -> None:
        if not isinstance(number, Number):
            number = Number(self._builder, ir.Constant(REAL, number))
        self._builder.store(number.value, self._entry_address(index))


class _Placeholder:
    """Stands for a number or an array; operations on it give placeholders."""

    def __init__(self, kind: Any) -> None:
        self.kind = kind

    def __add__(self, other: Any) -> Any:
        return NotImplemented if isinstance(other, KernelValue) else self

    __sub__ = __mul__ = __truediv__ = __radd__ = __rsub__ = __rmul__ = __add__
    __rtruediv__ = __add__

    def __getitem__(self, index: Any) -> _Placeholder:
        return self

    def matches(self, index: int) -> _Placeholder:
        return _REAL_PLACEHOLDER

    def __neg__(self) -> _Placeholder:
        return self

    def __setitem__(self, index: Any, number: Any) -> None:
        pass


_REAL_PLACEHOLDER, _INTEGER_PLACEHOLDER = (
    _Placeholder(types.float64),
    _Placeholder(types.int64),
)


def _placeholder(kind: Any) -> Any:
    if isinstance(kind, Value):
        return kind.kind.python(*[_REAL_PLACEHOLDER] * kind.kind.size)
    return (
        _INTEGER_PLACEHOLDER if isinstance(kind, types.Integer) else _REAL_PLACEHOLDER
    )


def _type_of_result(result: Any) -> Any:
    if isinstance(result, KernelValue):
        return numba_type(ValueType(type(result), len(result)))
    if result is None:
        return types.none
    if isinstance(result, _Placeholder):
        return result.kind
    return types.int64 if isinstance(result, int) else types.float64


def _from_code(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """What a formula computes with."""
    if isinstance(kind, Value):
        parts = (builder.extract_value(value, i) for i in range(kind.kind.size))
        return kind.kind.python(*(Number(builder, part) for part in parts))
    if isinstance(kind, View):
        return CodeArray(builder, builder.extract_value(value, 0))
    if isinstance(kind, types.Integer):
        value = context.cast(builder, value, kind, types.int64)
    return Number(builder, value)


def _to_code(context: Any, builder: Any, kind: Any, result: Any) -> Any:
    if isinstance(kind, Value):
        value = ir.Constant(context.get_value_type(kind), ir.Undefined)
        for i, part in enumerate(result):
            number = _to_code(context, builder, types.float64, part)
            value = builder.insert_value(value, number, i)
        return value
    if kind == types.none:
        return context.get_dummy_value()
    if isinstance(result, Number):
        return result.value
    return ir.Constant(INDEX if kind == types.int64 else REAL, result)


def register_formulas() -> None:
    """Lets kernels call the formulas that were defined meanwhile."""
    while new_formulas:
        function = new_formulas.pop()
        _register(function, function, (types.VarArg(types.Any),))


def _register(
    key: Any, function: Callable[..., Any], accepted: tuple[Any, ...]
) -> None:
    """Lets kernels call `key`: writes what the function makes of its arguments."""

    class Template(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, kws: Any) -> Any:
            foreign = not any(isinstance(a, Value) for a in args)
            if foreign and key.__module__ == operator.add.__module__:
                return None
            return signature(_type_of_result(function(*map(_placeholder, args))), *args)

    Template.key = key  # type: ignore[attr-defined]
    infer_global(key, types.Function(Template))

    @lower_builtin(key, *accepted)
    def write(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pairs = zip(sig.args, args, strict=True)
        numbers = [_from_code(context, builder, k, a) for k, a in pairs]
        return _to_code(context, builder, sig.return_type, function(*numbers))


for _operator in (operator.add, operator.sub):
    _register(_operator, _operator, (Value, Value))
_register(operator.neg, operator.neg, (Value,))
_register(operator.mul, operator.mul, (types.Any, Value))
