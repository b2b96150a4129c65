"""Design parameters: keys of a scene, their values, and the models of all points."""

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import integer_of_text
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile, read_model
from sidtool.formats.scene import SceneFile
from sidtool.formats.scene.signal_files import is_finite_number
from sidtool.formats.sid_files import read_sid
from sidtool.formats.toml.expressions import evaluate_number
from sidtool.formats.toml.files import File, key_path
from sidtool.formats.toml.reading import PARAMETERS
from sidtool.formats.toml.tables import named_object

from ..pipeline.model_cache import model_digest
from ..pipeline.scene_changes import replace_sids

Axes = dict[str, tuple[Any, ...]]
Over = str | Iterable[str] | Mapping[str, Iterable[Any]]
_RANGE_FORM = (
    "KEY=FROM:TO:COUNT, with :log at its end for equal ratios, or KEY=VALUE,VALUE"
)
#: Sweeps with more points are refused as mistakes.
MAX_POINTS = 1_000_000

#: `rod.model.geometry.height`: a key of the model of a body.
_OF_MODEL = re.compile(r"(?:bodies\.)?([^.\[\]]+)\.model\.(.+)")
#: Pattern of a unit in the description of a key.
_UNIT = re.compile(
    r"\[((?:kg|m|N|Pa|s|rad|J|W|Hz|1/)[^\[\],]*)\]|\bin (kg/m\^3|Pa|m)(?=;|$)"
)
#: Pattern of attributes and their first line in the docstring of a table.
_ATTRIBUTE = re.compile(r"^ *(\w+(?:, \w+)*) : (.*)$", re.MULTILINE)


def parse_axes(over: Over) -> Axes:
    """Parse axes from texts of the option `--over`, or from a mapping of keys to
    values.

    Raises
    ------
    InputError : a text has another form, an axis has no values, or there are too many
        points.
    """
    axes: Axes = {}
    if isinstance(over, Mapping):
        axes = {key: _values_given(key, values) for key, values in over.items()}
    else:
        for text in [over] if isinstance(over, str) else over:
            key, values = _parse_axis(text)
            if key in axes:
                raise InputError(
                    f"{key} is varied twice", place="--over", expected="each key once"
                )
            axes[key] = values
    if not axes:
        raise InputError("nothing is varied", place="--over", expected=_RANGE_FORM)
    count = 1
    for values in axes.values():
        count *= len(values)
    if count > MAX_POINTS:
        raise InputError(
            f"{count} points", place="--over", expected=f"at most {MAX_POINTS} points"
        )
    return axes


def axis_combinations(axes: Axes) -> list[dict[str, Any]]:
    """Return all combinations of values; the last axis changes fastest."""
    return [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]


def _values_given(key: str, values: Iterable[Any]) -> tuple[Any, ...]:
    """Convert values given in Python; NumPy numbers and arrays become plain ones."""
    several = [values] if isinstance(values, str | int | float) else list(values)
    if not several:
        raise InputError(f"{key} has no values", place="over", expected="at least one")
    return tuple(
        v.tolist() if isinstance(v, np.generic | np.ndarray) else v for v in several
    )


def _parse_axis(text: str) -> tuple[str, tuple[Any, ...]]:
    key, equals, values = (part.strip() for part in text.partition("="))
    if not (key and equals and values):
        raise InputError(f"found {text!r}", place="--over", expected=_RANGE_FORM)
    parts = values.split(":")
    if len(parts) == 2 and all(map(is_finite_number, parts)):  # without a count
        raise InputError(f"found {text!r}", place="--over", expected=_RANGE_FORM)
    if len(parts) in (3, 4) and values[0] not in "\"'[{":
        return key, _parse_range(text, parts)
    return key, tuple(_split_values(values))


def _parse_range(text: str, parts: list[str]) -> tuple[float, ...]:
    """Return evenly spaced values of a range that includes both ends.

    Raises
    ------
    InputError : an end or the count is not a number, or a logarithmic range is not
        positive.
    """
    try:
        first, last = (evaluate_number(part, {}) for part in parts[:2])
        count = integer_of_text(parts[2])
    except (InputError, ValueError):
        raise InputError(
            f"found {text!r}", place="--over", expected=_RANGE_FORM
        ) from None
    if not 1 <= count <= MAX_POINTS or (count == 1 and first != last):
        raise InputError(
            f"{parts[2]} values in {text!r}", place="--over", expected="2 or more"
        )
    if parts[3:] not in ([], ["log"]):
        raise InputError(
            f"found {parts[3]!r} in {text!r}", place="--over", expected="log or nothing"
        )
    if parts[3:] and not (first > 0 and last > 0):
        raise InputError(
            f"{text!r} has values without a logarithm",
            place="--over",
            expected="positive numbers",
        )
    space = np.geomspace if parts[3:] else np.linspace
    return tuple(float(f"{value:.15g}") for value in space(first, last, count))


def _split_values(text: str) -> list[Any]:
    """Return values separated by commas, each as in `--set`."""
    try:
        return list(tomllib.loads(f"values = [{text}]")["values"])
    except tomllib.TOMLDecodeError:
        parts = [part.strip() for part in text.split(",")]
    if not all(parts):
        raise InputError(f"found {text!r}", place="--over", expected=_RANGE_FORM)
    return [_parse_value(part) for part in parts]


def _parse_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


@dataclass(frozen=True, eq=False)
class Design:
    """A scene with the values of a point.

    models : models of bodies, which the sweep converts
    sids : SIDs of the other flexible bodies
    """

    scene: SceneFile
    models: Mapping[str, ModelFile]
    sids: Mapping[str, SID]

    def with_sids(
        self, converted: Mapping[str, SID]
    ) -> tuple[SceneFile, dict[str, SID]]:
        """Return the scene without files, and the SIDs of all flexible bodies.

        converted : SIDs of the models, by body
        """
        return replace_sids(self.scene, {**self.sids, **converted}, self.scene.folder)


@dataclass
class Designs:
    """Factory of the designs of a scene; it reads each file once.

    given : SIDs that replace those of the scene, by body
    record : outputs that the runs record
    """

    scene: SceneFile
    given: Mapping[str, SID]
    record: Sequence[str]
    _read: dict[Path, Any] = field(default_factory=dict)

    def design(self, values: Mapping[str, Any]) -> Design:
        """Return the design of one point.

        values : by keys of the scene, and of models as `BODY.model.KEY`

        Raises
        ------
        InputError : there is no such key, a value does not fit, or a file cannot be
            read.
        """
        of_models: dict[str, dict[str, Any]] = {}
        of_scene: dict[str, Any] = {}
        for key, value in values.items():
            key_of_model = self.key_of_model(key)
            if key_of_model is None:
                of_scene[key] = value
            else:
                of_models.setdefault(key_of_model[0], {})[key_of_model[1]] = value
        for key in of_scene:
            check_parameter(self.scene, key, key)
        for name, keys in of_models.items():
            for key in keys if name in self.scene.sid_bodies else ():
                model = self.model(name)
                check_parameter(model, key, f"{name}.model.{key}")
        content = self.scene.with_({**of_scene, "outputs.record": list(self.record)})
        if content.accuracy.wanted is not None:
            raise InputError(
                "asks for an accuracy, for which models are chosen and compared",
                place="accuracy.wanted",
                expected="a scene with rtol and integrator",
            )
        rigid = [name for name in of_models if name not in content.sid_bodies]
        if rigid:
            raise InputError(
                f"{rigid[0]} is a rigid body without a model",
                place=f"bodies.{rigid[0]}.model",
                expected="a flexible body",
            )
        models: dict[str, ModelFile] = {}
        sids = dict(self.given)
        for name, body in content.sid_bodies.items():
            if name in of_models or (name not in sids and body.model and not body.sid):
                models[name] = self._model(content, name, of_models.get(name, {}))
                sids.pop(name, None)
            elif name not in sids and isinstance(named_object(body.sid), SID):
                sids[name] = named_object(body.sid)
            elif name not in sids:
                sids[name] = self._file(content.folder / (body.sid or ""), read_sid)
        return Design(content, models, sids)

    def key_of_model(self, key: str) -> tuple[str, str] | None:
        """Return the body and the key of its model, for a key BODY.model.KEY."""
        match = _OF_MODEL.fullmatch(key)
        if match is None or match[1] not in self.scene.bodies:
            return None
        return match[1], match[2]

    def model(self, body: str) -> ModelFile:
        """Return the model of a body of the scene.

        Raises
        ------
        InputError : the body has none, or its file cannot be read.
        """
        return self._model(self.scene, body, {})

    def _model(
        self, content: SceneFile, name: str, changes: Mapping[str, Any]
    ) -> ModelFile:
        body = content.sid_bodies[name]
        given = named_object(body.model)
        if not body.model or name in self.given:
            raise InputError(
                f"{name} is given by a SID, which has no dimensions of its own",
                place=f"bodies.{name}.model",
                expected='`model = "rod.toml"` of the body in the scene',
            )
        path = content.folder / body.model
        model = given if given is not None else self._file(path, read_model)
        try:
            return model.with_(changes) if changes else model
        except InputError as error:
            raise error.located(body.model) from None

    def _file(self, path: Path, read: Any) -> Any:
        if path not in self._read:
            self._read[path] = read(path)
        return self._read[path]

    def unit(self, key: str) -> str:
        """Return the unit of a key from its description; parameters have none."""
        key_of_model = self.key_of_model(key)
        if key_of_model is None:
            return unit_of_key(self.scene, key)
        try:
            return unit_of_key(self.model(key_of_model[0]), key_of_model[1])
        except InputError:
            return ""


def unit_of_key(content: Any, key: str) -> str:
    """Return the unit of a key of a file from its description, "" if there is none."""
    try:
        places = places_of_key(content, key)
        while isinstance(places[-1], int):  # a component of a vector
            places.pop()
        for place in places[:-1]:
            content = value_at(content, place)
    except (InputError, LookupError, AttributeError, TypeError):
        return ""
    pairs = _UNIT.findall(_key_description(content, places[-1]))
    units = {bracketed or named for bracketed, named in pairs}
    return units.pop() if len(units) == 1 else ""


def places_of_key(content: File, key: str) -> list[str | int]:
    """Return the parts of a key from the top of a file.

    Raises
    ------
    InputError : it has another form, or nothing has this name.
    """
    tables = {name: getattr(content, name, None) or {} for name in content.named}
    return key_path(key, tables, type(content))


def check_parameter(content: File, key: str, place: str) -> None:
    """Refuse a parameter that no formula of a file reads.

    Raises
    ------
    InputError : every point would have the same result.
    """
    _, dot, name = key.rpartition(f"{PARAMETERS}.")
    if dot and not content.reads_parameter(name):
        raise InputError(
            "no formula reads this parameter",
            place=place,
            expected=f'a parameter that a value uses, as in mass = "2*{name}"',
        )


def _key_description(content: Any, key: str | int) -> str:
    """Return the description of a key of a table."""
    fields = type(content).model_fields if isinstance(content, BaseModel) else {}
    for name, about in fields.items():
        if (about.alias or name) == key:
            attributes = _ATTRIBUTE.findall(type(content).__doc__ or "")
            texts = [text for names, text in attributes if name in names.split(", ")]
            return about.description or " ".join(texts)
    return ""


def value_at(content: Any, place: str | int) -> Any:
    """Return the value at a key of a table or an index of a list."""
    if not isinstance(content, BaseModel):
        return content[place]
    fields = type(content).model_fields.items()
    return getattr(content, next(n for n, f in fields if (f.alias or n) == place))


def models_of_designs(designs: Sequence[Design]) -> dict[str, ModelFile]:
    """Return the models of all designs by their digests."""
    return {model_digest(m): m for design in designs for m in design.models.values()}
