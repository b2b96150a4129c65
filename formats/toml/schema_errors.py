"""From pydantic's list of errors to the one message that a person needs.

The location becomes the dotted key as it stands in the file, without the tags and
type names that pydantic adds; a misspelt key is answered with the nearest known one.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticUndefined

from ..errors import InputError

Location = tuple[str | int, ...]
QUOTE = "'"
#: Of a validator that takes other values than the field has: what these are.
_SAID = "json_schema_input_type"

#: Problems of a file that are told beside the first.
_SHOWN = 6
_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "finite_number": "a finite number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "list_type": "a list",
    "tuple_type": "a list",
    "greater_than": "a number greater than {gt}",
    "greater_than_equal": "a number not less than {ge}",
    "less_than": "a number less than {lt}",
    "less_than_equal": "a number not greater than {le}",
    "literal_error": "{expected}",
    "too_short": "at least {min_length} entries",
    "too_long": "at most {max_length} entries",
    "string_too_short": "a text that is not empty",
}


def input_error(
    error: ValidationError, data: Mapping[str, Any], model: type[BaseModel]
) -> InputError:
    """The one message for what pydantic found wrong in `data`; no source named."""
    problems = error.errors(include_url=False)
    first = min(problems, key=_rank)
    place, problem, expected = _described(first, data, model)
    meant = _meant(problems, model)
    others = {p["loc"]: p for p in problems if not _contains(p, first)}
    others = {loc: p for loc, p in others.items() if loc not in meant}
    shown = [_described(p, data, model) for p in list(others.values())[:_SHOWN]]
    also = [str(InputError(w, place=p or None, expected=e)) for p, w, e in shown]
    if len(others) > _SHOWN:
        also.append(f"{len(others) - _SHOWN} more problems in this file")
    return InputError(problem, place=place or None, expected=expected, also=also)


def _meant(problems: list[ErrorDetails], model: type[BaseModel]) -> set[Location]:
    """The keys that misspelt ones may mean: those are not missing."""
    places = [p["loc"] for p in problems if p["type"] == "extra_forbidden"]
    near = (nearest(str(at[-1]), _known_keys(model, at[:-1])) for at in places)
    return {(*at[:-1], key) for at, key in zip(places, near, strict=True) if key}


def _contains(outer: ErrorDetails, inner: ErrorDetails) -> bool:
    """A list with a wrong entry counts as one problem, not two."""
    return inner["loc"][: len(outer["loc"])] == outer["loc"]


def _rank(problem: ErrorDetails) -> int:
    """A wrong kind of file first, then misspelt keys, which explain missing ones."""
    if problem["loc"] in (("format",), ("version",)):
        return 0
    return 1 if problem["type"] == "extra_forbidden" else 2


def _described(
    error: ErrorDetails, data: Mapping[str, Any], model: type[BaseModel]
) -> tuple[str, str, str | None]:
    """Place, problem and expectation."""
    kind, location = error["type"], error["loc"]
    place = dotted(_written(location, data, missing=kind == "missing"))
    if kind == "missing":
        return place, "is missing", _field_meaning(model, location)
    if kind == "extra_forbidden":
        known = _known_keys(model, location[:-1])
        return place, "is not a known key", nearest(str(location[-1]), known)
    if kind.startswith("union_tag"):
        return _wrong_tag(error, place, model)
    return place, f"found {shortened(error['input'])}", _expectation(error)


def _wrong_tag(
    error: ErrorDetails, place: str, model: type[BaseModel]
) -> tuple[str, str, str]:
    context = error["ctx"]
    key = context["discriminator"].strip(QUOTE)
    place = f"{place}.{key}"
    if error["type"] == "union_tag_not_found":
        kinds = _values(_models_at(model, error["loc"]), key)
        return place, "is missing", f"one of {', '.join(map(repr, kinds))}"
    return place, f"found {context['tag']!r}", f"one of {context['expected_tags']}"


def _expectation(error: ErrorDetails) -> str:
    context = error.get("ctx", {})
    if error["type"] == "value_error":
        return str(context["error"])
    template = _EXPECTED.get(error["type"])
    if template is None:
        return error["msg"][:1].lower() + error["msg"][1:]
    return template.format(**{k: _plain(v) for k, v in context.items()})


def _plain(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


def shortened(value: object, limit: int = 60) -> str:
    """A value as TOML would show it, cut to a readable length."""
    if isinstance(value, Mapping):
        return "a table"
    text = (
        {True: "true", False: "false"}.get(value) if isinstance(value, bool) else None
    )
    text = text or (repr(value) if value is not None else "null")
    return text if len(text) <= limit else text[: limit - 3] + "..."


def dotted(location: Sequence[str | int]) -> str:
    """("pieces", 0, "to") as ``pieces[0].to``."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}"
    return text.removeprefix(".")


def _written(location: Location, data: Any, *, missing: bool) -> Location:
    """The location without pydantic's own parts (tags of unions, names of types)."""
    kept: list[str | int] = []
    for depth, part in enumerate(location):
        if missing and depth == len(location) - 1:
            return (*kept, part)
        if (
            _named(location, depth)
            and isinstance(data, Mapping)
            and data.get("type") == part
        ):
            continue
        if isinstance(data, Mapping) and part in data:
            data = data[str(part)]
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
        else:
            continue
        kept.append(part)
    return tuple(kept)


def _named(location: Location, depth: int) -> bool:
    """Whether a key comes next: what is both a tag and a list is the tag then."""
    return isinstance(next(iter(location[depth + 1 :]), None), str)


# --- what the model knows at a location ----------------------------------------------


def _field_meaning(model: type[BaseModel], location: Location) -> str | None:
    if isinstance(location[-1], int):
        return "one more entry in this list"
    for candidate in _models_at(model, location[:-1]):
        for name, info in candidate.model_fields.items():
            if location[-1] in (name, info.alias):
                return info.description or type_in_words(info) or _kinds(info)
    return None


def _kinds(info: FieldInfo) -> str | None:
    """Of a table that may be of several kinds their types."""
    kinds = _values(get_args(info.annotation), "type")
    return f"a table with a type out of {', '.join(kinds)}" if kinds else None


def _values(tables: Iterable[Any], key: str) -> list[str]:
    """What a key of some tables may say."""
    fields = [getattr(table, "model_fields", {}).get(key) for table in tables]
    return [kind for f in fields if f is not None for kind in get_args(f.annotation)]


def type_in_words(info: FieldInfo) -> str | None:
    if get_origin(info.annotation) is Literal:
        return " or ".join(repr(value) for value in get_args(info.annotation))
    words = {float: "a number", int: "a whole number", str: "a text in quotes"}
    annotation = info.annotation
    return words.get(annotation) if isinstance(annotation, type) else None


def _known_keys(model: type[BaseModel], location: Location) -> list[str]:
    models = _models_at(model, location)
    return [info.alias or name for m in models for name, info in m.model_fields.items()]


def nearest(key: str, known: list[str]) -> str | None:
    near = difflib.get_close_matches(key, known, n=1, cutoff=0.6)
    return near[0] if near else f"one of {', '.join(dict.fromkeys(known))}"


def _models_at(model: type[BaseModel], location: Location) -> list[type[BaseModel]]:
    candidates: list[Any] = [model]
    for depth, part in enumerate(location):
        named = depth == len(location) - 1 or _named(location, depth)
        candidates = [c for a in candidates for c in _step(a, part, named)]
    flat = [alternative for a in candidates for alternative in alternatives(a)]
    return [c for c in flat if isinstance(c, type) and issubclass(c, BaseModel)]


def alternatives(annotation: Any) -> list[Any]:
    """The members of a union, without Annotated wrappings: of what files may say."""
    if hasattr(annotation, "__metadata__"):
        said = [getattr(m, _SAID, PydanticUndefined) for m in annotation.__metadata__]
        said = [kind for kind in said if kind is not PydanticUndefined]
        return alternatives(said[0] if said else annotation.__origin__)
    if type(annotation).__name__ in ("Union", "UnionType", "_UnionGenericAlias"):
        return [a for member in get_args(annotation) for a in alternatives(member)]
    return [annotation]


def _step(annotation: Any, part: str | int, named: bool) -> list[Any]:
    """What the schema says one step deeper; a tag keeps the members it may mean.

    named : a key comes next, see `_named`
    """
    deeper: list[Any] = []
    same: list[Any] = []
    tagged: list[Any] = []
    for candidate in alternatives(annotation):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            fields = candidate.model_fields
            field = fields.get(str(part))
            deeper += [field.annotation] if field is not None else []
            kind = fields.get("type")
            tags = get_args(kind.annotation) if kind is not None else (part,)
            same += [candidate] if part in tags else []
            tagged += [candidate] if kind is not None and part in tags else []
        elif get_origin(candidate) in (dict, Mapping):
            deeper.append(get_args(candidate)[1])
        elif get_origin(candidate) in (list, tuple, Sequence):
            deeper.append(get_args(candidate)[0])
    return (named and tagged) or deeper or same
