"""Design variables of a model: numbers by their keys, parameters, and shape variables.

Every design variable is a direction in the numbers of a model: the derivative of each
of them by the variable.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from typing import Any

import numpy as np

from sidtool.formats.base.complex_step import STEP
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import real_of_text
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.files import key_path
from sidtool.formats.toml.reading import PARAMETERS
from sidtool.formats.toml.tables import Table

Place = tuple[str | int, ...]

#: Tables with numbers that a body depends on smoothly.
_TABLES = ("material", "geometry", "markers", "damping", "stiffening", PARAMETERS)
#: Numbers in them that are tolerances, units, knots or directions.
_SETTINGS = ("knots", "tolerance", "unit", "expected_mass", "order", "node", "moves")
#: Coefficients of the central difference of sixth order, by the distance in steps.
_DIFFERENCE = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
#: Step of differences of formulas, relative to a parameter.
_FORMULA_STEP = 1e-2


@dataclass(frozen=True)
class ShapeVariable:
    """Several numbers of a model that change together.

    Attributes
    ----------
    name : of the variable
    directions : key of a number -> its change per unit of the variable
    """

    name: str
    directions: Mapping[str, float]

    @classmethod
    def parse(cls, text: str) -> ShapeVariable:
        """Return the shape variable of NAME=KEY:FACTOR,KEY:FACTOR.

        Raises
        ------
        InputError : the text has another form.
        """
        name, _, rest = text.partition("=")
        name, directions = name.strip(), dict[str, float]()
        try:
            for part in rest.split(","):
                key, _, factor = part.rpartition(":")
                directions[key.strip()] = real_of_text(factor)
        except ValueError:
            directions = {"": 0.0}
        if not name or "" in directions:
            raise InputError(
                f"found {text!r}",
                place="--with",
                expected="KEY, or NAME=KEY:FACTOR,KEY:FACTOR for numbers that change "
                "together",
            )
        return cls(name, directions)


#: What design variables are given by: a key, or numbers that change together.
VariableLike = str | ShapeVariable


@dataclass(frozen=True)
class DesignVariable:
    """A direction in the numbers of a model.

    Attributes
    ----------
    name : key, or name of a shape variable
    value : of the number; 0 for a shape variable
    directions : place of each number that depends on it -> derivative by the variable
    """

    name: str
    value: float
    directions: Mapping[Place, float]

    @property
    def step(self) -> float:
        """The imaginary step of the variable."""
        return STEP * (abs(self.value) or 1.0)

    def with_imaginary_step(self, model: ModelFile) -> ModelFile:
        """Return the model at the variable plus i times `step`, without checks."""
        for place, slope in self.directions.items():
            model = _changed(
                model, place, partial(operator.add, 1j * self.step * slope)
            )
        return model

    def moved(self, model: ModelFile, amount: float) -> ModelFile:
        """Return the model with the variable changed by an amount, without checks."""
        for place, slope in self.directions.items():
            model = _changed(model, place, partial(operator.add, amount * slope))
        return model


def design_variable(model: ModelFile, given: VariableLike) -> DesignVariable:
    """Return the design variable of a key or a shape variable of a model.

    Raises
    ------
    InputError : there is no such key, or it is not a number that can change smoothly.
    """
    if isinstance(given, str):
        if "=" in given:
            return design_variable(model, ShapeVariable.parse(given))
        place = _place_of(model, given)
        if place[0] == PARAMETERS:
            return _of_parameter(model, given, place)
        return DesignVariable(given, _number_at(model, place, given), {place: 1.0})
    directions: dict[Place, float] = {}
    for key, factor in given.directions.items():
        one = design_variable(model, key)
        for place, slope in one.directions.items():
            directions[place] = directions.get(place, 0.0) + slope * factor
    return DesignVariable(given.name, 0.0, directions)


def _place_of(model: ModelFile, key: str) -> Place:
    key = full_key(model, key)
    names = {"markers": model.markers, PARAMETERS: model.parameters}
    place = tuple(key_path(key, names, ModelFile))
    fixed = place[0] not in _TABLES or any(part in _SETTINGS for part in place[1:])
    if fixed:
        raise InputError(
            "changes the discretisation or the settings of the model",
            place=key,
            expected="a number of geometry, material, markers or damping, as "
            "material.youngs_modulus",
        )
    return place


def matching_keys(model: ModelFile, pattern: str) -> list[str]:
    """Return the keys of all numbers that a pattern with `*` means.

    Raises
    ------
    InputError : there are none.
    """
    known = [
        "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in place)[1:]
        for place, _ in _numbers_in(model)
        if place[0] in _TABLES and not any(part in _SETTINGS for part in place[1:])
    ]
    escaped = full_key(model, pattern).replace("[", "[[]")
    found = [key for key in known if fnmatchcase(key, escaped)]
    if not found:
        raise InputError(
            f"no number of the model is {pattern!r}",
            place="--with",
            expected="a key such as geometry.section.height",
        )
    return found


def full_key(model: ModelFile, key: str) -> str:
    """Return a key with its table: geometry.thickness for thickness."""
    first = re.split(r"[.\[]", key, maxsplit=1)[0]
    known = (ModelFile.model_fields, model.markers, model.parameters)
    if any(first in names for names in known):
        return key
    homes = [home for home, table in _short_homes(model) if first in table]
    return f"{homes[0]}.{key}" if len(homes) == 1 else key


def _short_homes(model: ModelFile) -> Iterator[tuple[str, Container[str]]]:
    """Yield tables whose keys may be named alone, with their fields."""
    tables = {"geometry": model.geometry, "material": model.material}
    tables["geometry.section"] = getattr(model.geometry, "section", None)
    for home, table in tables.items():
        if table is not None:
            yield home, type(table).model_fields


def _number_at(model: ModelFile, place: Place, key: str) -> float:
    """Return the number at a place.

    Raises
    ------
    InputError : there is nothing, or no number with a fraction.
    """
    content: Any = model
    try:
        for part in place:
            content = None if content is None else _part_of(content, part)
    except (LookupError, TypeError):
        raise InputError(
            "is not there", place=key, expected="a key of the model"
        ) from None
    if content is None:
        raise InputError(
            "is not given", place=key, expected="a number in the model file"
        )
    if isinstance(content, tuple):
        raise InputError(
            f"has {len(content)} entries", place=key, expected=f"one of them, {key}[0]"
        )
    if type(content) is not float:
        found = "a table" if isinstance(content, Table | Mapping) else repr(content)
        raise InputError(
            f"is {found}",
            place=key,
            expected="a number that can change smoothly; whole numbers and texts "
            "change the structure of the model",
        )
    return content


def _part_of(content: Any, part: str | int) -> Any:
    if isinstance(content, Table):
        return getattr(content, _field_name(content, part))
    if isinstance(content, Mapping) or isinstance(part, int):
        return content[part]
    raise LookupError(part)


def _field_name(table: Table, part: str | int) -> str:
    fields = type(table).model_fields.items()
    for name, info in fields:
        if part in (info.alias, name):
            return name
    raise LookupError(part)


def _changed(content: Any, place: Place, change: Callable[[Any], Any]) -> Any:
    """Return a copy of tables and tuples with one changed number, without checks."""
    if not place:
        return change(content)
    part, rest = place[0], place[1:]
    inner = _changed(_part_of(content, part), rest, change)
    if isinstance(content, Table):
        return content.model_copy(update={_field_name(content, part): inner})
    if isinstance(content, Mapping):
        return {**content, part: inner}
    assert isinstance(part, int)
    return (*content[:part], inner, *content[part + 1 :])


def _of_parameter(model: ModelFile, key: str, place: Place) -> DesignVariable:
    """Return the variable of a parameter: the numbers whose formulas read it.

    The derivatives of formulas are central differences of sixth order.

    Raises
    ------
    InputError : no formula reads it, or it changes the structure of the model.
    """
    value = model.parameters.get(str(place[-1]))
    if value is None:
        raise InputError(
            "is not there", place=key, expected=", ".join(model.parameters) or "none"
        )
    step = _FORMULA_STEP * (abs(value) or 1.0)
    before = dict(_numbers_in(model))
    slopes = dict.fromkeys(before, 0.0)
    for distance, weight in _DIFFERENCE.items():
        for sign in (1, -1):
            changed = model.with_(
                {".".join(map(str, place)): value + sign * distance * step}
            )
            after = dict(_numbers_in(changed))
            if after.keys() != before.keys():
                raise InputError(
                    "changes the structure of the model",
                    place=key,
                    expected="a parameter of smooth formulas",
                )
            for there, number in after.items():
                slopes[there] += sign * weight * (number - before[there]) / step
    directions = {
        there: slope
        for there, slope in slopes.items()
        if slope != 0.0 and there[0] != PARAMETERS
    }
    if not directions:
        raise InputError(
            "no formula reads this parameter",
            place=key,
            expected=f'a parameter in a formula, as in thickness = "2*{place[-1]}"',
        )
    return DesignVariable(key, float(value), directions)


def _numbers_in(content: Any, place: Place = ()) -> Iterator[tuple[Place, float]]:
    """Yield all numbers with a fraction in a model by their places."""
    if isinstance(content, Table):
        for name in type(content).model_fields:
            yield from _numbers_in(getattr(content, name), (*place, name))
    elif isinstance(content, Mapping):
        for name, part in content.items():
            yield from _numbers_in(part, (*place, name))
    elif isinstance(content, tuple):
        for index, part in enumerate(content):
            yield from _numbers_in(part, (*place, index))
    elif type(content) is float and np.isfinite(content):
        yield place, content
