"""Build the scene and the models of each point of a sweep."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile, read_model
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_files import read_sid
from sidtool.formats.toml.evaluation import PARAMETERS
from sidtool.formats.toml.files import File, key_path
from sidtool.formats.toml.objects import named_object

from ..pipeline.model_cache import model_digest
from ..pipeline.scene_changes import replace_sids

#: `rod.model.geometry.height`: a key of the model of a body.
_OF_MODEL = re.compile(r"(?:bodies\.)?([^.\[\]]+)\.model\.(.+)")
#: Pattern of a unit in the description of a key.
_UNIT = re.compile(r"\[((?:kg|m|N|Pa|s|rad|J|W|Hz|1/)[^\[\],]*)\]")
#: Pattern of attributes and their first line in the docstring of a table.
_ATTRIBUTE = re.compile(r"^ *(\w+(?:, \w+)*) : (.*)$", re.MULTILINE)


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
            key_of_model = self._key_of_model(key)
            if key_of_model is None:
                of_scene[key] = value
            else:
                of_models.setdefault(key_of_model[0], {})[key_of_model[1]] = value
        for key in of_scene:
            _check_parameter(self.scene, key, key)
        for name, keys in of_models.items():
            for key in keys if name in self.scene.sid_bodies else ():
                model = self._model(self.scene, name, {})
                _check_parameter(model, key, f"{name}.model.{key}")
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

    def _key_of_model(self, key: str) -> tuple[str, str] | None:
        """Return the body and the key of its model, for a key BODY.model.KEY."""
        match = _OF_MODEL.fullmatch(key)
        if match is None or match[1] not in self.scene.bodies:
            return None
        return match[1], match[2]

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
        key_of_model = self._key_of_model(key)
        content: Any = self.scene
        try:
            if key_of_model is not None:
                content = self._model(content, key_of_model[0], {})
                key = key_of_model[1]
            places = key_path(key, content.file_data(), type(content))
            while isinstance(places[-1], int):  # a component of a vector
                places.pop()
            for place in places[:-1]:
                content = _value_at(content, place)
        except (InputError, LookupError, AttributeError, TypeError):
            return ""
        units = set(_UNIT.findall(_key_description(content, places[-1])))
        return units.pop() if len(units) == 1 else ""


def _check_parameter(content: File, key: str, place: str) -> None:
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


def _value_at(content: Any, place: str | int) -> Any:
    """Return the value at a key of a table or an index of a list."""
    if not isinstance(content, BaseModel):
        return content[place]
    fields = type(content).model_fields.items()
    return getattr(content, next(n for n, f in fields if (f.alias or n) == place))


def models_of_designs(designs: Sequence[Design]) -> dict[str, ModelFile]:
    """Return the models of all designs by their digests."""
    return {model_digest(m): m for design in designs for m in design.models.values()}
