"""Formulas of scene files."""

from __future__ import annotations

import math
import operator
import random
from itertools import pairwise
from typing import Any

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_ascii.title import split_tag, split_title
from sidtool.formats.toml.expressions import Postfix, output_names, parse_expression
from sidtool.formats.toml.reading import evaluate_formulas

TWO = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
    "min": min,
    "max": max,
    "atan2": math.atan2,
}
LETTERS = "abcdefghijklmnopqrstuvwxyz"
ONE = {"negative": operator.neg, "sin": math.sin, "sqrt": math.sqrt, "abs": abs}


def run(postfix: Postfix, names: dict[str, float], t: float = 0.0) -> float:
    """A stack of its own."""
    stack: list[float] = []
    for kind, value in postfix:
        if kind == "number":
            stack.append(float(value))
        elif kind == "time":
            stack.append(t)
        elif kind == "name":
            stack.append(names[str(value)])
        elif kind in ONE:
            stack.append(ONE[kind](stack.pop()))
        else:
            right = stack.pop()
            stack.append(TWO[kind](stack.pop(), right))
    assert len(stack) == 1
    return stack[0]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2 * 3 - 4 / 8", 6.5),
        ("2 - 3 - 4", -5.0),
        ("24 / 4 / 3", 2.0),
        ("-2 ** 2", -4.0),
        ("2 ** -1 ** 2", 0.5),
        ("2^3^2", 512.0),
        ("- - 3", 3.0),
        ("+(1.5e-3)*1E3", 1.5),
        (".5 + 1.", 1.5),
        ("clip(7, -1, 2) + clip(-7, -1, 2) + clip(0.5, -1, 2)", 1.5),
        ("min(3, 1, 2) * max(3, 1, 2, 5)", 5.0),
        ("atan2(1, -1) / pi", 0.75),
        ("k * t + sqrt(abs(-16))", 14.0),
        ("sin(pi / 6)", 0.5),
        ("arm.angle - 'left-arm.tip.vx' * rod.12.x", 2.0 - 3.0 * 5.0),
    ],
)
def test_a_formula_has_the_value_of_arithmetic(text: str, value: float) -> None:
    names = {"arm.angle": 2.0, "left-arm.tip.vx": 3.0, "rod.12.x": 5.0}
    found = run(parse_expression(text, {"k": 5.0}), names, t=2.0)
    assert found == pytest.approx(value, rel=1e-14)


def _random_formula(draw: random.Random, depth: int) -> str:
    if depth == 0 or draw.random() < 0.2:
        return draw.choice(["t", "a.x", "b", f"{draw.uniform(0.1, 9.0):.3f}"])
    left, right = (_random_formula(draw, depth - 1) for _ in range(2))
    kind = draw.randrange(6)
    if kind < 4:
        space = draw.choice(["", " "])
        return f"{left}{space}{'+-*/'[kind]}{space}({right})"
    return f"-({left})" if kind == 4 else f"({left}) + {right}"


@pytest.mark.parametrize("seed", range(40))
def test_formulas_are_those_of_python(seed: int) -> None:
    draw = random.Random(seed)
    text = _random_formula(draw, 5)
    known: dict[str, Any] = {"t": 0.7, "b": 1.3, "a": type("A", (), {"x": 2.9})}
    try:
        wanted = eval(text, {"__builtins__": {}}, known)
    except ZeroDivisionError:
        return
    found = run(parse_expression(text, {"b": 1.3}), {"a.x": 2.9}, t=0.7)
    assert found == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_terms_stand_where_they_are_named(seed: int) -> None:
    """In parentheses, not as text: a sum stays one part of a product."""
    draw = random.Random(seed)
    terms = {"a_sum": "t + b", "root": "sqrt(abs(a_sum))"}
    text = _random_formula(draw, 5).replace("a.x", "(2*a_sum - root^a_sum)")
    known: dict[str, Any] = {"t": 0.7, "b": 1.3, "a_sum": 2.0, "root": math.sqrt(2.0)}
    try:
        wanted = eval(text.replace("^", "**"), {"__builtins__": {}}, known)
    except ZeroDivisionError:
        return
    found = run(parse_expression(text, {"b": 1.3}, terms), {}, t=0.7)
    assert found == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    ("terms", "expected"),
    [
        ({"a": "1 + a"}, "terms that do not read themselves, as a does"),
        ({"a": "b", "b": "2*c", "c": "a"}, "do not read themselves"),
        ({"a": "1 +"}, "a number or a name"),
        (
            {"a": "1 + 1"} | {name: f"{of} + {of}" for of, name in pairwise(LETTERS)},
            "at most 10000",
        ),
        (
            {"a000": "t"} | {f"a{k + 1:03}": f"1 + a{k:03}" for k in range(500)},
            "nested parts",
        ),
    ],
)
def test_terms_without_an_end_are_refused(terms: dict[str, str], expected: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_expression(max(terms), {}, terms)
    assert expected in (caught.value.expected or "")


def test_names_that_are_read() -> None:
    postfix = parse_expression("a.x + 2*a.x - k*b.vx + t + pi", {"k": 1.0})
    assert output_names(postfix) == ("a.x", "b.vx")


@pytest.mark.parametrize(
    ("text", "place", "expected"),
    [
        ("1 +", "its end", "a number or a name"),
        ("(1 + 2", "its end", "')'"),
        ("1 2", "'2' at character 3", "an operator"),
        ("sin(1, 2)", "')' at character 9", "1 argument of sin"),
        ("clip(1, 2)", "')' at character 10", "3 arguments of clip"),
        ("min(1)", "')' at character 6", "2 arguments of min"),
        ("1 + open('x')", "at character 5", "one of the functions sin"),
        ("__import__('os')", "at character 1", "one of the functions"),
        ("a.x[0]", "'[0]' at character 4", "numbers, names"),
        ("1 if t else 2", "'if t else 2' at character 3", "an operator"),
        ("2a.x", "'2a.x' at character 1", "numbers, names"),
        ("x = 1", "'= 1' at character 3", "numbers, names"),
        ("1e400*t", "'1e400*t' at character 1", "a finite number"),
        ("", "its end", "a number or a name"),
        ("(" * 60 + "1" + ")" * 60, "", "nested"),
        ("-" * 100 + "1", "", "nested"),
    ],
)
def test_what_is_no_formula_is_refused(text: str, place: str, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_expression(text, {})
    assert place in caught.value.problem
    assert expected in (caught.value.expected or "")


@pytest.mark.parametrize("name", ["t", "sin", "a.b", "2k"])
def test_names_of_parameters(name: str) -> None:
    with pytest.raises(InputError, match="a parameter has the name"):
        parse_expression("1", {name: 1.0})


#: With time that grows with the square of this, a test would take very long.
LONG = 300_000


@pytest.mark.parametrize(
    "text",
    [
        "1" * LONG + "_",
        "1" * LONG + "." + "1" * LONG + "_",
        "1" * LONG + "e" + "1" * LONG + "_",
        "." + "1" * LONG + "x",
        "1" + " " * LONG + "$",
        " " * LONG + "$",
        "a" + ".a" * LONG + ".",
        "'" + "a" * LONG,
        "(" * LONG,
        "-" * LONG + "1",
    ],
    ids=lambda text: text[:3] + "..." + text[-2:],
)
def test_the_time_is_linear_in_the_length(text: str) -> None:
    """Whatever is wrong with it; and a message stays readable."""
    with pytest.raises(InputError) as caught:
        parse_expression(text, {})
    assert len(str(caught.value)) < 500


def test_long_formulas_are_read() -> None:
    count = 30_000
    assert run(parse_expression("+".join(["1.5e0"] * count), {}), {}) == 1.5 * count


def test_many_parameters_that_build_on_each_other() -> None:
    """Names are checked once, not for each formula; a message names some of them."""
    count = 5_000
    chain = {f"k{i}": f"k{i - 1} + 1" if i else 0.0 for i in range(count)}
    head = {"format": "sidtool scene", "version": 1}
    found, _ = evaluate_formulas(head | {"parameters": chain}, SceneFile)
    assert found["parameters"][f"k{count - 1}"] == count - 1
    with pytest.raises(InputError) as caught:
        evaluate_formulas(head | {"parameters": chain | {"last": "unknown"}}, SceneFile)
    assert caught.value.place == "parameters.last"
    assert len(str(caught.value)) < 500
    with pytest.raises(InputError, match="a parameter has the name"):
        evaluate_formulas(head | {"parameters": {"sin": 1.0, "b": "2"}}, SceneFile)


def test_titles_of_many_spaces() -> None:
    found = split_title("2 3 a" + " " * LONG + "b")
    assert found is not None and split_tag(found[1]).text == found[1]
    found = split_title("2 3 rod" + " " * LONG + "[sidtool]")
    assert found is not None and split_tag(found[1]).text == "rod"
