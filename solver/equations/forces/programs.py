"""Laws: what a force makes of outputs of the motion, as programs of a stack machine.

A law that reads n measures is a row of the table of forces that follows those of its
measures. Its program stands in the pool: n, the number of instructions, and three
numbers for each of them. Every entry of the stack has its derivatives by the n
measures and their n rates beside it, eq. (30).
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba import float64, int64
from numba.extending import intrinsic

from ...compiler.compiling import inner
from ...linear.lapack import address
from ..drives import drive_value
from .characteristics import passive_force

# --- instructions, each with two numbers -----------------------------------
CONSTANT = 0  # value
TIME = 1
MEASURE = 2  # number of the measure, 1 for its rate
FUNCTION = 3  # row of a function of time, 1 for its rate
CALL = 4  # address of `double f(double t, double *y, long i)`, n: takes n entries y;
# the value is that of i = -1
CALL_GIVEN = 5  # the same, which yields for i >= 0 its derivative by y[i]
FORCE = 6  # number of the measure: spring, damper and friction of its own law
ADD, SUBTRACT, MULTIPLY, DIVIDE, POWER, LEAST, MOST, ANGLE_OF = range(10, 18)
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
HEAD, WIDTH = 2, 3
#: Most entries that a program may have on the stack.
DEPTH = 64
#: Step of the differences of a callable, relative to the larger of its argument and
#: `SMALL`: Newton's matrix need not be exact.
STEP, SMALL = 6e-6, 1e-3
#: Entries of Work.lapse: 1 + the row of the last law that gave no number, else zero;
#: when that was; its measures with their rates.
LAPSED, LAPSED_AT, LAPSED_MEASURES = 0, 1, 2


@intrinsic
def _call(typing: Any, pointer: Any, t: Any, y: Any, i: Any):  # type: ignore[no-untyped-def]
    """Calls `double f(double t, double *y, long i)` at an address."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        real, whole = ir.DoubleType(), ir.IntType(64)
        kind = ir.FunctionType(real, [real, whole, whole])
        function = builder.inttoptr(values[0], kind.as_pointer())
        return builder.call(function, values[1:])

    return float64(int64, float64, int64, int64), generate


@inner()
def _of_one(op, x):
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
def _of_two(op, a, b):
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
    if op == ANGLE_OF:
        size = max(a * a + b * b, 1e-300)
        return math.atan2(a, b), b / size, -a / size
    first = (a <= b) if op == LEAST else (a >= b)
    if math.isnan(a) or math.isnan(b):
        return math.nan, 0.0, 0.0
    return (a, 1.0, 0.0) if first else (b, 0.0, 1.0)


@inner()
def _call_law(stack, top, columns, given, pointer, n, t):
    """Replaces n entries from `top` on by what a callable makes of them."""
    y = address(stack, top)
    value = _call(pointer, t, y, -1)
    for j in range(1, columns):
        stack[j * DEPTH + DEPTH - 1] = 0.0
    for i in range(n if columns > 1 else 0):
        if given:
            slope = _call(pointer, t, y, i)
        else:
            x = stack[top + i]
            step = STEP * max(abs(x), SMALL)
            stack[top + i] = x + step
            slope = _call(pointer, t, y, -1)
            stack[top + i] = x - step
            slope = (slope - _call(pointer, t, y, -1)) / (2.0 * step)
            stack[top + i] = x
        for j in range(1, columns):
            stack[j * DEPTH + DEPTH - 1] += slope * stack[j * DEPTH + top + i]
    stack[top] = value
    for j in range(1, columns):
        stack[j * DEPTH + top] = stack[j * DEPTH + DEPTH - 1]


@inner()
def law_value(system, work, k, t, slopes):
    """What the law of row k yields; with `slopes` also its derivatives, into the rows
    of its measures in Work.slope."""
    pool, stack = system.pool, work.stack
    code = system.force[k].code
    n, count = int(pool[code]), int(pool[code + 1])
    columns = 1 + 2 * n if slopes else 1
    top = 0
    for at in range(code + HEAD, code + HEAD + WIDTH * count, WIDTH):
        op, a, b = int(pool[at]), pool[at + 1], int(pool[at + 2])
        stiffness, damping = 0.0, 0.0
        if op in (CALL, CALL_GIVEN):
            top -= b
            _call_law(stack, top, columns, op == CALL_GIVEN, int(a), b, t)
            top += 1
        elif op < ADD:
            value = a
            if op == TIME:
                value = t
            elif op == MEASURE:
                value = work.measure[k - n + int(a), b]
            elif op == FORCE:
                read = k - n + int(a)
                value, stiffness, damping = passive_force(
                    pool,
                    system.force[read].law,
                    work.measure[read, 0],
                    work.measure[read, 1],
                )
            elif op == FUNCTION:
                f, rate, _ = drive_value(system, int(a), work.clock[0], t)
                value = f if b == 0 else rate
            stack[top] = value
            for j in range(1, columns):
                stack[j * DEPTH + top] = 0.0
            if op == MEASURE and slopes:
                stack[(1 + 2 * int(a) + b) * DEPTH + top] = 1.0
            elif op == FORCE and slopes:
                stack[(1 + 2 * int(a)) * DEPTH + top] = -stiffness
                stack[(2 + 2 * int(a)) * DEPTH + top] = -damping
            top += 1
        elif op < NEGATIVE:
            top -= 1
            value, left, right = _of_two(op, stack[top - 1], stack[top])
            stack[top - 1] = value
            for j in range(DEPTH, columns * DEPTH, DEPTH):
                stack[j + top - 1] = left * stack[j + top - 1] + right * stack[j + top]
        else:
            value, slope = _of_one(op, stack[top - 1])
            stack[top - 1] = value
            for j in range(DEPTH, columns * DEPTH, DEPTH):
                stack[j + top - 1] *= slope
    for i in range(n if slopes else 0):
        for order in range(2):
            slope = stack[(1 + 2 * i + order) * DEPTH]
            work.slope[k - n + i, order] = slope if math.isfinite(slope) else 0.0
    if not math.isfinite(stack[0]):
        work.lapse[LAPSED], work.lapse[LAPSED_AT] = 1.0 + k, t
        for i in range(n):
            work.lapse[LAPSED_MEASURES + 2 * i] = work.measure[k - n + i, 0]
            work.lapse[LAPSED_MEASURES + 2 * i + 1] = work.measure[k - n + i, 1]
    return stack[0]
