"""Read TOML and JSON files and validate them by a pydantic model.

Formulas such as "2*pi*n" in place of numbers are evaluated before validation.
"""

import json
import math
import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from ..base.errors import InputError
from ..storage.unreadable import QUOTES, read_text
from .expressions import (
    NumberTable,
    check_names,
    evaluate_number,
    quoted_formula,
    shortened_text,
)
from .messages import (
    dotted_key,
    input_error,
    shorten_value,
    type_in_words,
    union_members,
)

Place = tuple[str | int, ...]
Formulas = dict[Place, str]
PARAMETERS, TABLES = "parameters", "tables"
PARAMETERS_MEAN = (
    'numbers by name, for formulas such as "2*pi*n" wherever a number stands; those '
    "below may use those above"
)


def evaluate_formulas(
    data: Mapping[str, Any], model: type[BaseModel]
) -> tuple[dict[str, Any], Formulas]:
    """Replace formulas in data by numbers; return also the formulas by their keys.

    Parameters may use those above them.

    Raises
    ------
    InputError : a formula is invalid, reads what is no parameter, or has no
        finite value; a key that selects the kind of a table is missing.
    """
    walk = _FormulaEvaluation()
    walk.tables = _GivenTables(data.get(TABLES), model, walk)
    given = data.get(PARAMETERS)
    if PARAMETERS in model.model_fields and isinstance(given, Mapping):
        for name, value in given.items():
            number = walk.value(value, [float], (PARAMETERS, name))
            if isinstance(number, int | float) and not isinstance(number, bool):
                walk.parameters[name] = number
                walk.unchecked.append(name)
    return walk.value(data, [model], ()), walk.formulas


@lru_cache(maxsize=1024)
def required_keys(model: type[BaseModel]) -> dict[str, Any]:
    """Return the keys with one possible value, such as `type`, which files must
    contain.
    """
    required = {}
    for name, info in model.model_fields.items():
        values = get_args(info.annotation)
        if get_origin(info.annotation) is Literal and values == (info.default,):
            required[name] = info.default
    return required


class _FormulaEvaluation:
    """Evaluates data along its schema; `kinds` are the allowed types.

    Unions and annotations are resolved.
    """

    def __init__(self) -> None:
        self.parameters: dict[str, float] = {}
        self.unchecked: list[str] = []
        self.formulas: Formulas = {}
        self.tables: Mapping[str, NumberTable] = {}

    def value(self, data: Any, kinds: list[Any], place: Place) -> Any:
        if isinstance(data, bool):
            _check_truth_value(data, kinds, place)
        if isinstance(data, str):
            return self._number(data, kinds, place)
        if isinstance(data, list):
            return self._list(data, kinds, place)
        if isinstance(data, Mapping):
            return self._table(data, kinds, place)
        return data

    def _list(self, data: list[Any], kinds: list[Any], place: Place) -> list[Any]:
        if all(type(part) in (int, float) for part in data):
            return data
        lists = [k for k in kinds if get_origin(k) in (tuple, list)]
        inner = _flat_types(a for k in lists for a in get_args(k) if a is not ...)
        return [self.value(part, inner, (*place, i)) for i, part in enumerate(data)]

    def _table(
        self, data: Mapping[str, Any], kinds: list[Any], place: Place
    ) -> dict[str, Any]:
        models = [k for k in kinds if _is_model(k) and _can_be(k, data)]
        if len(models) == 1:
            _check_tags(models[0], data, place)
        entries = [get_args(k)[1] for k in kinds if get_origin(k) in (dict, _MAPPING)]
        others = _flat_types(entries)
        evaluated = {}
        for key, part in data.items():
            fields = [kind for m in models for kind in _types_of_key(m, key)]
            evaluated[key] = self.value(part, [*others, *fields], (*place, key))
        return evaluated

    def _number(self, text: str, kinds: list[Any], place: Place) -> str | float:
        fixed = [v for k in kinds if get_origin(k) is Literal for v in get_args(k)]
        numbers = {int, float}.intersection(k for k in kinds if isinstance(k, type))
        if str in kinds or text in fixed or not numbers:
            return text
        try:
            check_names(self.unchecked)
            self.unchecked.clear()
            value = evaluate_number(text, self.parameters, self.tables)
        except InputError as error:
            why = error.problem.removeprefix(f"{quoted_formula(text)} ")
            why += f", not {error.expected}" if error.expected else ""
            raise InputError(
                f"found {shorten_value(text)}",
                place=dotted_key(place),
                expected=f"a number, or a formula (this one {why})",
            ) from None
        if float not in numbers:
            if not value.is_integer():
                raise InputError(
                    f"{quoted_formula(text)} gives {value:g}",
                    place=dotted_key(place),
                    expected="a whole number",
                )
            value = int(value)
        self.formulas[place] = text
        return value


class _GivenTables(Mapping[str, NumberTable]):
    """The tables of a file that formulas of numbers look up, read when they are."""

    def __init__(
        self, data: Any, model: type[BaseModel], walk: _FormulaEvaluation
    ) -> None:
        entries = _types_of_key(model, TABLES)
        mappings = [k for k in entries if get_origin(k) in (dict, _MAPPING)]
        kinds = _flat_types(get_args(k)[1] for k in mappings)
        self._kinds = [k for k in kinds if _is_model(k) and hasattr(k, "number")]
        self._data = data if self._kinds and isinstance(data, Mapping) else {}
        self._walk = walk
        self._read: dict[str, NumberTable | None] = {}

    def __getitem__(self, name: str) -> NumberTable:
        if name not in self._read:
            self._read[name] = None
            place = (TABLES, name)
            entry = self._walk.value(self._data[name], list(self._kinds), place)
            try:
                text = json.dumps(entry, default=str)
                self._read[name] = self._kinds[0].model_validate_json(text, strict=True)
            except ValidationError:
                pass  # the table itself is refused later, with its key
        table = self._read[name]
        if table is None:
            problem = f"looks up the table {name}, which is not valid"
            raise InputError(problem, expected="numbers")
        return table

    def __iter__(self) -> Iterator[str]:
        return iter(self._data)

    def __len__(self) -> int:
        return len(self._data)


_MAPPING = get_origin(Mapping[str, Any])


def _flat_types(annotations: Any) -> list[Any]:
    return [kind for a in annotations for kind in union_members(a)]


def _check_truth_value(data: bool, kinds: list[Any], place: Place) -> None:
    """Refuse true where only the number 1 is allowed, to which it is equal."""
    fixed = [v for k in kinds if get_origin(k) is Literal for v in get_args(k)]
    if data in fixed and bool not in kinds and not any(v is data for v in fixed):
        raise InputError(
            f"found {shorten_value(data)}",
            place=dotted_key(place),
            expected=" or ".join(map(repr, fixed)),
        )


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _can_be(model: type[BaseModel], data: Mapping[str, Any]) -> bool:
    """Check that no key with one or a few allowed values contradicts a model."""
    return all(
        data.get(name) in get_args(info.annotation)
        for name, info in model.model_fields.items()
        if name in data and get_origin(info.annotation) is Literal
    )


@lru_cache(maxsize=1024)
def _types_of_key(model: type[BaseModel], key: str) -> tuple[Any, ...]:
    """Return the types allowed for a key."""
    annotations = [
        Annotated[(info.annotation, *info.metadata)]
        if info.metadata
        else info.annotation
        for name, info in model.model_fields.items()
        if key in (name, info.alias)
    ]
    return tuple(_flat_types(annotations))


def _check_tags(model: type[BaseModel], data: Mapping[str, Any], place: Place) -> None:
    for name in required_keys(model):
        if name not in data:
            raise InputError(
                "is missing",
                place=dotted_key((*place, name)),
                expected=type_in_words(model.model_fields[name]),
            )


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
