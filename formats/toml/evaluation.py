"""Evaluation of formulas such as "2*pi*n" in place of numbers, before validation."""

import json
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError

from ..base.errors import InputError
from .expressions import NumberTable, check_names, evaluate_number, quoted_formula
from .messages import dotted_key, shorten_value, type_in_words, union_members

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
