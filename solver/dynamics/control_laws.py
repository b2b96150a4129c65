"""Interpreter of control laws, eq. (29): programs of a stack machine.

A law that reads n measures is a row of the force table that follows those of its
measures. Its program is in `SystemArrays.real_data`: n, the number of instructions,
and three numbers per instruction. Each entry of the stack carries its derivatives by
the n measures and their n rates, eq. (30).
"""

import math
from typing import Any

from llvmlite import ir

from ..compiler.inner_kernels import Intrinsic, inner
from ..compiler.types import float64, int64
from ..linear.block_factors import address_of_entry
from .drives import function_value
from .force_characteristics import passive_force

# --- instructions, each with two numbers -----------------------------------
CONSTANT = 0  # value
TIME = 1
MEASURE = 2  # number of the measure, 1 for its rate
FUNCTION = 3  # row of a function of time, 1 for its rate
CALL = 4  # address of `double f(double t, double *y, long i)`, n: takes n entries y;
# the value is that of i = -1
CALL_GIVEN = 5  # the same, which yields for i >= 0 its derivative by y[i]
LOOKUP = 7  # row of a function, order of its derivative: of the entry on top
LOOKUP_GRID = 8  # where the numbers of a grid begin: of the two entries on top
PASSIVE_FORCE = 6  # number of the measure: spring, damper and friction of its own law
ADD, SUBTRACT, MULTIPLY, DIVIDE, POWER, MINIMUM, MAXIMUM, ATAN2 = range(10, 18)
(
    NEGATIVE,
    SIN,
    COS,
    TAN,
    ASIN,
    ACOS,
    ATAN,
    SINH,
    COSH,
    TANH,
    EXP,
    LOG,
    SQRT,
    ABS,
    SIGN,
) = range(20, 35)

#: Numbers before the instructions, and of each.
HEADER_SIZE, INSTRUCTION_SIZE = 2, 3
#: Most entries that a program may have on the stack.
STACK_DEPTH = 64
#: Step of the differences of a callable, relative to the larger of its argument and
#: `SMALL`: Newton's matrix need not be exact.
DIFFERENCE_STEP, SMALLEST_ARGUMENT = 6e-6, 1e-3
#: Entries of `WorkArrays.law_failure`: 1 + the row of the last law that gave no number,
#: else zero; the time of that; its measures with their rates.
FAILED_LAW, FAILURE_TIME, FAILURE_MEASURES = 0, 1, 2


@Intrinsic
def _call_address(pointer: Any, t: Any, y: Any, i: Any) -> Any:
    """Calls `double f(double t, double *y, long i)` at an address."""

    def generate(builder: Any, values: Any) -> Any:
        real, whole = ir.DoubleType(), ir.IntType(64)
        kind = ir.FunctionType(real, [real, whole, whole])
        function = builder.inttoptr(values[0], kind.as_pointer())
        return builder.call(function, values[1:])

    return float64(int64, float64, int64, int64), generate


@inner()
def _unary_function(op, x):
    """Value and slope of a function of one number."""
    if op == NEGATIVE:
        return -x, -1.0
    if op == SIN:
        return math.sin(x), math.cos(x)
    if op == COS:
        return math.cos(x), -math.sin(x)
    if op == TAN:
        y = math.tan(x)
        return y, 1.0 + y * y
    if op == ASIN:
        return math.asin(x), 1.0 / math.sqrt(1.0 - x * x)
    if op == ACOS:
        return math.acos(x), -1.0 / math.sqrt(1.0 - x * x)
    if op == ATAN:
        return math.atan(x), 1.0 / (1.0 + x * x)
    if op == SINH:
        return math.sinh(x), math.cosh(x)
    if op == COSH:
        return math.cosh(x), math.sinh(x)
    if op == TANH:
        y = math.tanh(x)
        return y, 1.0 - y * y
    if op == EXP:
        y = math.exp(x)
        return y, y
    if op == LOG:
        return math.log(x), 1.0 / x
    if op == SQRT:
        y = math.sqrt(x)
        return y, 0.5 / max(y, 1e-150)
    if op == ABS:
        return abs(x), math.copysign(1.0, x)
    return (0.0 if x == 0.0 else math.copysign(1.0, x)), 0.0


@inner()
def _binary_function(op, a, b):
    """Value and both slopes of a function of two numbers."""
    if op == ADD:
        return a + b, 1.0, 1.0
    if op == SUBTRACT:
        return a - b, 1.0, -1.0
    if op == MULTIPLY:
        return a * b, b, a
    if op == DIVIDE:
        return a / b, 1.0 / b, -a / (b * b)
    if op == POWER:
        y = a**b
        by_a = 0.0 if b == 0.0 else b * a ** (b - 1.0)
        return y, by_a, (y * math.log(a) if a > 0.0 else 0.0)
    if op == ATAN2:
        size = max(a * a + b * b, 1e-300)
        return math.atan2(a, b), b / size, -a / size
    first = (a <= b) if op == MINIMUM else (a >= b)
    if math.isnan(a) or math.isnan(b):
        return math.nan, 0.0, 0.0
    return (a, 1.0, 0.0) if first else (b, 0.0, 1.0)


@inner()
def _call_function(stack, top, columns, has_derivatives, pointer, n, t):
    """Replace n entries from `top` on by the value of a callable of them."""
    y = address_of_entry(stack, top)
    value = _call_address(pointer, t, y, -1)
    for j in range(1, columns):
        stack[j * STACK_DEPTH + STACK_DEPTH - 1] = 0.0
    for i in range(n if columns > 1 else 0):
        if has_derivatives:
            slope = _call_address(pointer, t, y, i)
        else:
            x = stack[top + i]
            step = DIFFERENCE_STEP * max(abs(x), SMALLEST_ARGUMENT)
            stack[top + i] = x + step
            slope = _call_address(pointer, t, y, -1)
            stack[top + i] = x - step
            slope = (slope - _call_address(pointer, t, y, -1)) / (2.0 * step)
            stack[top + i] = x
        for j in range(1, columns):
            stack[j * STACK_DEPTH + STACK_DEPTH - 1] += (
                slope * stack[j * STACK_DEPTH + top + i]
            )
    stack[top] = value
    for j in range(1, columns):
        stack[j * STACK_DEPTH + top] = stack[j * STACK_DEPTH + STACK_DEPTH - 1]


@inner()
def _interval(real_data, start, count, x):
    """The interval of growing numbers that holds x, the share of it, 1 over its length;
    x beyond them is held at their ends, where the last one is zero.
    """
    k, end = 0, count - 1
    while end - k > 1:
        middle = (k + end) // 2
        if real_data[start + middle] <= x:
            k = middle
        else:
            end = middle
    first, last = real_data[start + k], real_data[start + k + 1]
    slope = 1.0 / (last - first)
    share = (x - first) * slope
    if share < 0.0:
        return k, 0.0, 0.0
    if share > 1.0:
        return k, 1.0, 0.0
    return k, share, slope


@inner()
def _grid_value(real_data, start, x, y):
    """Bilinear value of a grid, see `lookup_tables`, and its slopes by x and y."""
    nx, ny = int(real_data[start]), int(real_data[start + 1])
    i, p, by_x = _interval(real_data, start + 2, nx, x)
    j, q, by_y = _interval(real_data, start + 2 + nx, ny, y)
    at = start + 2 + nx + ny + i * ny + j
    a, b = real_data[at], real_data[at + 1]
    c, d = real_data[at + ny], real_data[at + ny + 1]
    low, high = a + q * (b - a), c + q * (d - c)
    slope_y = ((1.0 - p) * (b - a) + p * (d - c)) * by_y
    return low + p * (high - low), (high - low) * by_x, slope_y


@inner()
def law_value(system, work, k, t, with_derivatives):
    """What the law of row k yields; with `with_derivatives` also its derivatives, into
    the rows of its measures in WorkArrays.slope.
    """
    real_data, stack = system.real_data, work.stack
    code = system.force[k].code
    n, count = int(real_data[code]), int(real_data[code + 1])
    columns = 1 + 2 * n if with_derivatives else 1
    top = 0
    for at in range(
        code + HEADER_SIZE,
        code + HEADER_SIZE + INSTRUCTION_SIZE * count,
        INSTRUCTION_SIZE,
    ):
        op, a, b = int(real_data[at]), real_data[at + 1], int(real_data[at + 2])
        stiffness, damping = 0.0, 0.0
        if op in (CALL, CALL_GIVEN):
            top -= b
            _call_function(stack, top, columns, op == CALL_GIVEN, int(a), b, t)
            top += 1
        elif op == LOOKUP:
            x = stack[top - 1]
            value, slope, curvature = function_value(system, int(a), x, x)
            if b > 0:
                value, slope, curvature = slope, curvature, 0.0
            if b > 1:
                value, slope = slope, curvature
            stack[top - 1] = value
            for j in range(STACK_DEPTH, columns * STACK_DEPTH, STACK_DEPTH):
                stack[j + top - 1] *= slope
        elif op == LOOKUP_GRID:
            top -= 1
            value, left, right = _grid_value(
                real_data, int(a), stack[top - 1], stack[top]
            )
            stack[top - 1] = value
            for j in range(STACK_DEPTH, columns * STACK_DEPTH, STACK_DEPTH):
                stack[j + top - 1] = left * stack[j + top - 1] + right * stack[j + top]
        elif op < ADD:
            value = a
            if op == TIME:
                value = t
            elif op == MEASURE:
                value = work.measure[k - n + int(a), b]
            elif op == PASSIVE_FORCE:
                measure = k - n + int(a)
                value, stiffness, damping = passive_force(
                    real_data,
                    system.force[measure].law,
                    work.measure[measure, 0],
                    work.measure[measure, 1],
                )
            elif op == FUNCTION:
                f, rate, _ = function_value(system, int(a), work.interval_time[0], t)
                value = f if b == 0 else rate
            stack[top] = value
            for j in range(1, columns):
                stack[j * STACK_DEPTH + top] = 0.0
            if op == MEASURE and with_derivatives:
                stack[(1 + 2 * int(a) + b) * STACK_DEPTH + top] = 1.0
            elif op == PASSIVE_FORCE and with_derivatives:
                stack[(1 + 2 * int(a)) * STACK_DEPTH + top] = -stiffness
                stack[(2 + 2 * int(a)) * STACK_DEPTH + top] = -damping
            top += 1
        elif op < NEGATIVE:
            top -= 1
            value, left, right = _binary_function(op, stack[top - 1], stack[top])
            stack[top - 1] = value
            for j in range(STACK_DEPTH, columns * STACK_DEPTH, STACK_DEPTH):
                stack[j + top - 1] = left * stack[j + top - 1] + right * stack[j + top]
        else:
            value, slope = _unary_function(op, stack[top - 1])
            stack[top - 1] = value
            for j in range(STACK_DEPTH, columns * STACK_DEPTH, STACK_DEPTH):
                stack[j + top - 1] *= slope
    for i in range(n if with_derivatives else 0):
        for order in range(2):
            slope = stack[(1 + 2 * i + order) * STACK_DEPTH]
            work.law_derivative[k - n + i, order] = (
                slope if math.isfinite(slope) else 0.0
            )
    if not math.isfinite(stack[0]):
        work.law_failure[FAILED_LAW], work.law_failure[FAILURE_TIME] = 1.0 + k, t
        for i in range(n):
            work.law_failure[FAILURE_MEASURES + 2 * i] = work.measure[k - n + i, 0]
            work.law_failure[FAILURE_MEASURES + 2 * i + 1] = work.measure[k - n + i, 1]
    return stack[0]
