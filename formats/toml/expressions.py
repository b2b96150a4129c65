"""Formulas of scene and model files: a small grammar of numbers, names and functions.

    sum      = product {("+" | "-") product}
    product  = sign {("*" | "/") sign}
    sign     = {"+" | "-"} power
    power    = atom [("**" | "^") sign]
    atom     = number | NAME | "quoted name" | "(" sum ")"
             | FUNCTION "(" sum {"," sum} ")"

`lookup` has the name of a table before its one or two variables. A name is `t`, `pi`,
a parameter, a term, or an output such as ``arm.angle``; one with a hyphen is quoted.
Nothing is ever run: a formula becomes a list of instructions for a stack, operands
before their operators; clip becomes max and min.
"""

import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from itertools import islice
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

from ..base.errors import InputError

#: Functions with the number of their arguments; `min` and `max` take two or more.
FUNCTIONS: Mapping[str, int] = {
    **dict.fromkeys(
        ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"], 1
    ),
    **dict.fromkeys(["exp", "log", "sqrt", "abs", "sign"], 1),
    **dict.fromkeys(["atan2", "min", "max"], 2),
    "clip": 3,
    "lookup": 2,
}
_MANY = ("min", "max")
#: Instructions that look up the table of their value, by the number of variables.
LOOKUPS = ("lookup1", "lookup2")
#: Each part takes all it can and gives nothing back: the time is linear in the text.
_TOKEN = re.compile(
    r"\s*+(?:(?P<number>(?:[0-9]++\.?+[0-9]*+|\.[0-9]++)(?:[eE][+-]?[0-9]++)?+)(?![\w.])"
    r"|(?P<name>[^\W\d]\w*+(?:\.\w++)*+)"
    r"|'(?P<quoted>[^']++)'|\"(?P<quoted2>[^\"]++)\""
    r"|(?P<operator>\*\*|[-+*/^(),]))"
)
#: Characters of a formula, and parameters, that a message shows.
_SHOWN, _NAMES = 60, 10
#: Deepest nesting of parentheses, powers and signs.
DEEPEST = 30
#: Most instructions of a formula with its terms.
MOST_INSTRUCTIONS = 10_000

_OF_TWO = ("+", "-", "*", "/", "**", "min", "max", "atan2")


class Instruction(NamedTuple):
    """`kind` is number, name, time, or an operator or function that takes its operands
    from the stack; `value` is the number or the name."""

    kind: str
    value: float | str = 0.0


Postfix = tuple[Instruction, ...]


def parse_expression(
    text: str,
    parameters: Mapping[str, float],
    terms: Mapping[str, str] = MappingProxyType({}),
) -> Postfix:
    """Parse a formula to instructions.

    Parameters
    ----------
    parameters : numbers by name
    terms : formulas by name, which replace their names in this one and in each other

    Raises
    ------
    InputError : states where the formula is invalid.
    """
    check_names(parameters)
    return _Parser(text, parameters, terms).whole()


def check_names(names: Iterable[str], kind: str = "a parameter") -> None:
    """Whether formulas can read names.

    Parameters
    ----------
    kind : what the names are of

    Raises
    ------
    InputError : one is no word, or means something else.
    """
    for name in names:
        if name in FUNCTIONS or name in ("t", "pi") or not name.isidentifier():
            raise InputError(
                f"{kind} has the name {name!r}",
                expected="a word that is neither t, pi nor a function",
            )


def quoted_formula(text: str) -> str:
    """Return a formula for messages, cut to a readable length."""
    return f"the formula {shortened_text(text)}"


def shortened_text(text: str) -> str:
    """A text in quotes, cut to a readable length."""
    return repr(text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "...")


def output_names(postfix: Postfix) -> tuple[str, ...]:
    """Outputs that a formula reads, each once."""
    return tuple(dict.fromkeys(str(i.value) for i in postfix if i.kind == "name"))


def lookups(postfix: Postfix) -> list[tuple[str, int]]:
    """Tables that a formula looks up, with the number of variables."""
    return [(str(i.value), int(i.kind[-1])) for i in postfix if i.kind in LOOKUPS]


def split_at_commas(text: str) -> list[str]:
    """Split a text at the commas outside of parentheses."""
    parts, depth, last = [], 0, 0
    for k, letter in enumerate(text):
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            parts.append(text[last:k].strip())
            last = k + 1
    return [part for part in [*parts, text[last:].strip()] if part]


class NumberTable(Protocol):
    """Values over one or two variables."""

    def number(self, name: str, *point: float) -> float:
        """The value at a point, of the table of a name.

        Raises
        ------
        InputError : the table has another number of variables, or is no table.
        """


def evaluate_number(
    text: str,
    parameters: Mapping[str, float],
    tables: Mapping[str, NumberTable] = MappingProxyType({}),
) -> float:
    """The value of a formula of numbers, parameters and tables.

    parameters : numbers by names that `check_names` accepts

    Raises
    ------
    InputError : it reads something else, or has no finite value.
    """
    stack: list[float] = []
    for kind, value in _Parser(text, parameters).whole():
        if kind in ("name", "time"):
            known = ", ".join(islice(parameters, _NAMES)) or "none"
            known += ", ..." if len(parameters) > _NAMES else ""
            raise InputError(
                f"{quoted_formula(text)} reads {shortened_text(str(value or 't'))}",
                expected=f"numbers, pi and parameters (here {known})",
            )
        if kind == "number":
            stack.append(float(value))
            continue
        if kind in LOOKUPS:
            if value not in tables:
                known = f"a table out of {', '.join(tables)}" if tables else "no table"
                problem = f"{quoted_formula(text)} looks up the table {value}"
                raise InputError(problem, expected=known)
            point = [stack.pop() for _ in range(int(kind[-1]))][::-1]
            stack.append(tables[str(value)].number(str(value), *point))
            continue
        operation = _OPERATIONS.get(kind) or getattr(math, kind)
        count = 2 if kind in _OF_TWO else 1
        operands = [stack.pop() for _ in range(count)][::-1]
        stack.append(_apply(operation, operands, text))
    return stack[0]


def _apply(operation: Callable[..., Any], operands: list[float], text: str) -> float:
    try:
        result = float(operation(*operands))
    except (ArithmeticError, ValueError, TypeError):  # a complex power: TypeError
        result = math.nan
    if not math.isfinite(result):
        raise InputError(f"{quoted_formula(text)} has no finite value")
    return result


_OPERATIONS: Mapping[str, Callable[..., Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
    "negative": operator.neg,
    "abs": abs,
    "sign": lambda x: (x > 0) - (x < 0),
    "min": min,
    "max": max,
}


class _Parser:
    """Recursive descent; each method appends the instructions of what it reads."""

    def __init__(
        self,
        text: str,
        parameters: Mapping[str, float],
        terms: Mapping[str, str] = MappingProxyType({}),
        inside: tuple[str, ...] = (),
        depth: int = 0,
    ) -> None:
        self.text, self.parameters = text, parameters
        self.terms, self.inside = terms, inside
        self.tokens = _tokenise(text)
        self.next, self.depth = 0, depth
        self.instructions: list[Instruction] = []

    def whole(self) -> Postfix:
        self._sum()
        if self.next < len(self.tokens):
            self._fail("an operator, or the end")
        return tuple(self.instructions)

    def _sum(self) -> None:
        self._chain(self._product, "+-")

    def _product(self) -> None:
        self._chain(self._sign, "*/")

    def _chain(self, part, operators: str) -> None:  # type: ignore[no-untyped-def]
        part()
        while self._peek() in tuple(operators):
            operator = self._take()
            part()
            self.instructions.append(Instruction(operator))

    def _sign(self) -> None:
        self.depth += 1
        if self.depth > DEEPEST:
            self._fail(f"at most {DEEPEST} nested parts")
        if self._peek() in ("+", "-"):
            operator = self._take()
            self._sign()
            if operator == "-":
                self.instructions.append(Instruction("negative"))
        else:
            self._atom()
            if self._peek() in ("**", "^"):
                self._take()
                self._sign()
                self.instructions.append(Instruction("**"))
        self.depth -= 1

    def _atom(self) -> None:
        if self.next == len(self.tokens):
            self._fail("a number or a name")
        kind, text, _ = self.tokens[self.next]
        self.next += 1
        if kind == "number":
            if not math.isfinite(float(text)):
                self.next -= 1
                self._fail("a finite number")
            self.instructions.append(Instruction("number", float(text)))
        elif kind == "name" and self._peek() == "(":
            self._function(text)
        elif kind == "name" and text in self.terms:
            self._term(text)
        elif kind in ("name", "quoted"):
            self.instructions.append(self._named(text, kind))
        elif text == "(":
            self._sum()
            self._expect(")")
        else:
            self.next -= 1
            self._fail("a number or a name")

    def _named(self, name: str, kind: str) -> Instruction:
        if kind == "name" and name in self.parameters:
            return Instruction("number", self.parameters[name])
        if kind == "name" and name == "t":
            return Instruction("time")
        if kind == "name" and name == "pi":
            return Instruction("number", math.pi)
        return Instruction("name", name)

    def _term(self, name: str) -> None:
        """The instructions of a term, in its place, which nests like parentheses."""
        if name in self.inside:
            self.next -= 1
            self._fail(f"terms that do not read themselves, as {name} does")
        inside = (*self.inside, name)
        term = _Parser(
            self.terms[name], self.parameters, self.terms, inside, self.depth
        )
        self.instructions += term.whole()
        if len(self.instructions) > MOST_INSTRUCTIONS:
            self.next -= 1
            self._fail(f"at most {MOST_INSTRUCTIONS} numbers, names and operators")

    def _function(self, name: str) -> None:
        if name not in FUNCTIONS:
            self.next -= 1
            self._fail(f"one of the functions {', '.join(FUNCTIONS)}")
        self._take()
        if name == "lookup":
            self._lookup()
            return
        self._sum()
        count = 1
        while self._peek() == ",":
            self._take()
            self._sum()
            count += 1
            if name in _MANY:
                self.instructions.append(Instruction(name))
            elif name == "clip":
                self.instructions.append(Instruction("max" if count == 2 else "min"))
        n_arguments = FUNCTIONS[name]
        if count < n_arguments or (count > n_arguments and name not in _MANY):
            self._fail(f"{n_arguments} argument{'s' * (n_arguments > 1)} of {name}")
        self._expect(")")
        if name not in (*_MANY, "clip"):
            self.instructions.append(Instruction(name))

    def _lookup(self) -> None:
        """The table and its variables, behind the parenthesis."""
        kind, table, _ = (*self.tokens, ("", "", 0))[self.next]
        if kind not in ("name", "quoted"):
            self._fail("the name of a table")
        self.next += 1
        count = 0
        while self._peek() == "," and count < len(LOOKUPS):
            self._take()
            self._sum()
            count += 1
        if not count:
            self._fail("a variable behind the table of lookup")
        self._expect(")")
        self.instructions.append(Instruction(LOOKUPS[count - 1], table))

    def _peek(self) -> str:
        if self.next == len(self.tokens):
            return ""
        kind, text, _ = self.tokens[self.next]
        return text if kind == "operator" else ""

    def _take(self) -> str:
        self.next += 1
        return self.tokens[self.next - 1][1]

    def _expect(self, operator: str) -> None:
        if self._peek() != operator:
            self._fail(f"{operator!r}")
        self.next += 1

    def _fail(self, expected: str) -> None:
        at = len(self.text)
        if self.next < len(self.tokens):
            at = self.tokens[self.next][2]
        _raise_syntax_error(self.text, at, expected)


def _tokenise(text: str) -> list[tuple[str, str, int]]:
    """Kind, text and place of each word."""
    tokens, at, end = [], 0, len(text.rstrip())
    while at < end:
        match = _TOKEN.match(text, at)
        if match is None:
            while text[at].isspace():
                at += 1
            _raise_syntax_error(text, at, "numbers, names, + - * / ** and parentheses")
        assert match is not None and match.lastgroup is not None
        kind = match.lastgroup
        token = match.group(kind)
        tokens.append((kind.removesuffix("2"), token, match.start(kind)))
        at = match.end()
    return tokens


def _raise_syntax_error(text: str, at: int, expected: str) -> None:
    remaining = text[at : at + 12] + ("..." if len(text) > at + 12 else "")
    location = f"{remaining!r} at character {at + 1}" if remaining else "its end"
    raise InputError(f"{quoted_formula(text)} has {location}", expected=expected)
