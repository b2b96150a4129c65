"""Formulas such as "2*pi*n" wherever a file has a number, before it is validated.

The schema says where numbers stand: a text there is a formula of numbers, pi and the
table [parameters], in the grammar of `expressions`. Where a text may stand as well, as
in the name of an output, it stays one.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel

from ..errors import InputError
from .expressions import check_names, in_words, number_of
from .schema_errors import alternatives, dotted, shortened, type_in_words

Place = tuple[str | int, ...]
Formulas = dict[Place, str]
PARAMETERS = "parameters"
PARAMETERS_MEAN = (
    'numbers by name, for formulas such as "2*pi*n" wherever a number stands; those '
    "below may use those above"
)


def evaluated(
    data: Mapping[str, Any], model: type[BaseModel]
) -> tuple[dict[str, Any], Formulas]:
    """The data with numbers for formulas, and the formulas by their places.

    Parameters may use those above them.

    Raises
    ------
    InputError : a formula has another form, reads what is no parameter, or has no
        finite value; a key that says what kind of table this is is missing.
    """
    walk = _Walk()
    given = data.get(PARAMETERS)
    if PARAMETERS in model.model_fields and isinstance(given, Mapping):
        for name, value in given.items():
            found = walk.value(value, [float], (PARAMETERS, name))
            if isinstance(found, int | float) and not isinstance(found, bool):
                walk.parameters[name] = found
                walk.unchecked.append(name)
    return walk.value(data, [model], ()), walk.formulas


@lru_cache(maxsize=1024)
def tags(model: type[BaseModel]) -> dict[str, Any]:
    """Keys with one possible value, such as `type`, which files have to say."""
    found = {}
    for name, info in model.model_fields.items():
        values = get_args(info.annotation)
        if get_origin(info.annotation) is Literal and values == (info.default,):
            found[name] = info.default
    return found


class _Walk:
    """Walks data and schema side by side; `kinds` are the types that may stand there,
    without unions and annotations."""

    def __init__(self) -> None:
        self.parameters: dict[str, float] = {}
        self.unchecked: list[str] = []
        self.formulas: Formulas = {}

    def value(self, data: Any, kinds: list[Any], place: Place) -> Any:
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
        inner = _flat(a for k in lists for a in get_args(k) if a is not ...)
        return [self.value(part, inner, (*place, i)) for i, part in enumerate(data)]

    def _table(
        self, data: Mapping[str, Any], kinds: list[Any], place: Place
    ) -> dict[str, Any]:
        models = [k for k in kinds if _is_model(k) and _fits(k, data)]
        if len(models) == 1:
            _check_tags(models[0], data, place)
        entries = [get_args(k)[1] for k in kinds if get_origin(k) in (dict, _MAPPING)]
        others = _flat(entries)
        found = {}
        for key, part in data.items():
            fields = [kind for m in models for kind in _fields(m, key)]
            found[key] = self.value(part, [*others, *fields], (*place, key))
        return found

    def _number(self, text: str, kinds: list[Any], place: Place) -> str | float:
        fixed = [v for k in kinds if get_origin(k) is Literal for v in get_args(k)]
        numbers = {int, float}.intersection(k for k in kinds if isinstance(k, type))
        if str in kinds or text in fixed or not numbers:
            return text
        try:
            check_names(self.unchecked)
            self.unchecked.clear()
            value = number_of(text, self.parameters)
        except InputError as error:
            why = error.problem.removeprefix(f"{in_words(text)} ")
            why += f", not {error.expected}" if error.expected else ""
            raise InputError(
                f"found {shortened(text)}",
                place=dotted(place),
                expected=f"a number, or a formula (this one {why})",
            ) from None
        if float not in numbers:
            if not value.is_integer():
                raise InputError(
                    f"{in_words(text)} gives {value:g}",
                    place=dotted(place),
                    expected="a whole number",
                )
            value = int(value)
        self.formulas[place] = text
        return value


_MAPPING = get_origin(Mapping[str, Any])


def _flat(annotations: Any) -> list[Any]:
    return [kind for a in annotations for kind in alternatives(a)]


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _fits(model: type[BaseModel], data: Mapping[str, Any]) -> bool:
    """Whether no key of one value, or of a few, says that it is another table."""
    return all(
        data.get(name) in get_args(info.annotation)
        for name, info in model.model_fields.items()
        if name in data and get_origin(info.annotation) is Literal
    )


@lru_cache(maxsize=1024)
def _fields(model: type[BaseModel], key: str) -> tuple[Any, ...]:
    """Types that may stand under a key."""
    annotations = [
        Annotated[(info.annotation, *info.metadata)]
        if info.metadata
        else info.annotation
        for name, info in model.model_fields.items()
        if key in (name, info.alias)
    ]
    return tuple(_flat(annotations))


def _check_tags(model: type[BaseModel], data: Mapping[str, Any], place: Place) -> None:
    for name in tags(model):
        if name not in data:
            raise InputError(
                "is missing",
                place=dotted((*place, name)),
                expected=type_in_words(model.model_fields[name]),
            )
