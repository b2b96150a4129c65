"""Read TOML and JSON files and validate them by a pydantic model."""

import json
import math
import re
import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from ..base.errors import InputError
from ..storage.unreadable import QUOTES, read_text
from .evaluation import Formulas, evaluate_formulas
from .expressions import shortened_text
from .messages import dotted_key, input_error

Model = TypeVar("Model", bound=BaseModel)

#: Tables and lists in each other, and parts of a dotted key; more is damage.
DEEPEST = 50
_LARGEST = 2**63
#: Largest size of a number: products of six of them are finite.
LARGEST_NUMBER = 1e50
_KEY = r"(?:[\w-]++|\"[^\"\n]*+\"|'[^'\n]*+')[ \t]*+"
#: A key of so many parts that the parser would spend its time on it.
_ENDLESS_KEY = re.compile(
    rf"(?:^[ \t]*+\[{{0,2}}+|[{{,])[ \t]*+(?:{_KEY}\.[ \t]*+){{{DEEPEST}}}",
    re.MULTILINE,
)
#: Halves of characters in JSON, and bytes of names of files that are not UTF-8.
_NO_CHARACTER = re.compile(r"[\ud800-\udfff]")
#: How tomllib calls what follows a backslash and is no escape.
_ESCAPE = re.compile(r"Unescaped '\\'|hex value|Escaped character")


def load(path: str | Path, model: type[Model]) -> Model:
    """Read a TOML file, or a JSON file if its name ends in ``.json``, into `model`.

    Values are not converted, but for formulas where numbers are expected.

    Raises
    ------
    InputError : the file cannot be read or parsed, or does not fit the model.
    """
    return validate_data(read_data(path), model, source=path)


def validate_data(
    data: Mapping[str, Any], model: type[Model], *, source: str | Path | None = None
) -> Model:
    """The model of data as TOML or JSON hold them (tables, lists, plain values).

    Raises
    ------
    InputError : the data do not fit the model; `source` is named.
    """
    return with_formulas(data, model, source)[0]


def with_formulas(
    data: Mapping[str, Any], model: type[Model], source: str | Path | None
) -> tuple[Model, Formulas]:
    """The same, and the formulas in the data by their places."""
    formulas: Formulas = {}
    try:
        data, formulas = evaluate_formulas(data, model)
        _check_values(data)
        text = json.dumps(data, default=str)
        return model.model_validate_json(text, strict=True), formulas
    except ValidationError as error:
        problem = input_error(error, data, model)
    except InputError as error:
        problem = error
    for place, text in formulas.items():
        if dotted_key(place) == problem.place:
            problem.problem += f", which is {shortened_text(text)}"
    raise problem.located(source or "input") from None


def read_data(path: str | Path) -> dict[str, Any]:
    """The tables of a TOML or JSON file as plain Python data.

    Raises
    ------
    InputError : no such file, a folder, no UTF-8, or wrong syntax (line and column).
    """
    path = Path(path)
    text, is_json = _read_text(path), path.suffix.lower() == ".json"
    try:
        data = _parse_json(text) if is_json else _parse_toml(text)
        _check_values(data)
    except InputError as error:
        raise error.located(path) from None
    except ValueError as error:
        place, problem = _syntax_error(error)
        kind = "JSON" if is_json else "TOML"
        escaped = kind == "TOML" and _ESCAPE.search(problem)
        raise InputError(
            problem,
            source=path,
            place=place,
            expected=QUOTES if escaped else f"valid {kind}",
        ) from None
    except RecursionError:
        raise InputError("is nested too deeply", source=path) from None
    if not isinstance(data, dict):
        raise InputError("holds no table at its top", source=path, expected="a table")
    return data


def _read_text(path: Path) -> str:
    if path.exists() and not (path.is_file() or path.is_dir()):
        problem = "is a pipe or a device"
        raise InputError(problem, source=path, expected="a regular file")
    try:
        return read_text(path, "a TOML or JSON file").replace("\r\n", "\n")
    except ValueError as error:
        raise InputError(f"cannot be read ({error})", source=path) from None


def _parse_toml(text: str) -> Any:
    match = _ENDLESS_KEY.search(text)
    if match:
        line = text.count("\n", 0, match.start() + 1) + 1
        raise InputError(
            f"has a key of more than {DEEPEST} parts",
            place=f"line {line}",
            expected="tables that are nested less deeply",
        )
    return tomllib.loads(text)


def _check_values(data: Any) -> None:
    """Refuse numbers and texts that other readers cannot hold, with their key."""
    waiting: list[tuple[tuple[str | int, ...], Any]] = [((), data)]
    while waiting:
        place, value = waiting.pop()
        if len(place) > DEEPEST:
            raise InputError(
                "is nested too deeply", place=dotted_key(place[:3]) + "..."
            )
        if isinstance(value, dict):
            for key in value:
                _check_text(key, place)
            waiting += (((*place, key), part) for key, part in value.items())
        elif isinstance(value, list):
            waiting += (
                ((*place, i), part)
                for i, part in enumerate(value)
                if not (type(part) is float and abs(part) <= LARGEST_NUMBER)
            )
        elif isinstance(value, str):
            _check_text(value, place)
        elif isinstance(value, int) and abs(value) >= _LARGEST:
            raise InputError(
                "found an integer of more than 64 bits",
                place=dotted_key(place),
                expected="a smaller number",
            )
        elif isinstance(value, float) and LARGEST_NUMBER < abs(value) < math.inf:
            raise InputError(
                f"found {value:g}",
                place=dotted_key(place),
                expected=f"at most {LARGEST_NUMBER:g} in size, in consistent units",
            )


def _check_text(text: str, place: tuple[str | int, ...]) -> None:
    if "\0" in text:
        problem, expected = "holds the character NUL", "printable text"
    elif _NO_CHARACTER.search(text):
        problem = "holds bytes or codes that are no characters"
        expected = "text in UTF-8, also of names of files"
    else:
        return
    raise InputError(
        f"{text[:40]!r} {problem}", place=dotted_key(place) or None, expected=expected
    )


def _parse_json(text: str) -> Any:
    return json.loads(text, object_pairs_hook=_unique_keys)


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        repeated = next(key for key, count in counts.items() if count > 1)
        raise InputError("appears twice", place=repeated, expected="one value per key")
    return table


def _syntax_error(error: ValueError) -> tuple[str | None, str]:
    if "integer string conversion" in str(error):
        return None, "holds an integer of thousands of digits"
    if isinstance(error, json.JSONDecodeError):
        return f"line {error.lineno}, column {error.colno}", error.msg
    match = re.fullmatch(
        r"(.*) \(at (line \d+, column \d+|end of document)\)", str(error)
    )
    return (match[2], match[1]) if match else (None, str(error))
