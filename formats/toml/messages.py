"""Convert the list of errors of pydantic to the one message that a person needs."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticUndefined

from ..base.errors import InputError

Location = tuple[str | int, ...]
QUOTE = "'"
#: Of a validator that takes other values than the field has: what these are.
_SAID = "json_schema_input_type"

#: Problems of a file that are reported beside the first.
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
    first = min(problems, key=_problem_rank)
    place, problem, expected = _describe_problem(first, data, model)
    main_problem = str(InputError(problem, place=place or None, expected=expected))
    meant = _intended_keys(problems, model)
    others = {p["loc"]: p for p in problems if not _is_inside(p, first)}
    listed = [
        _describe_problem(p, data, model)
        for loc, p in others.items()
        if loc not in meant
    ]
    found = [str(InputError(w, place=p or None, expected=e)) for p, w, e in listed]
    also = [text for text in dict.fromkeys(found) if text != main_problem]
    if len(also) > _SHOWN:
        also[_SHOWN:] = [f"{len(also) - _SHOWN} more problems in this file"]
    return InputError(problem, place=place or None, expected=expected, also=also)


def _intended_keys(
    problems: list[ErrorDetails], model: type[BaseModel]
) -> set[Location]:
    """The keys that misspelt ones may mean: those are not missing."""
    places = [p["loc"] for p in problems if p["type"] == "extra_forbidden"]
    near = (nearest_key(str(at[-1]), _known_keys(model, at[:-1])) for at in places)
    return {(*at[:-1], key) for at, key in zip(places, near, strict=True) if key}


def _is_inside(outer: ErrorDetails, inner: ErrorDetails) -> bool:
    """A list with a wrong entry counts as one problem, not two."""
    return inner["loc"][: len(outer["loc"])] == outer["loc"]


def _problem_rank(problem: ErrorDetails) -> int:
    """A wrong kind of file first, then misspelt keys, which explain missing ones."""
    if problem["loc"] in (("format",), ("version",)):
        return 0
    return 1 if problem["type"] == "extra_forbidden" else 2


def _describe_problem(
    error: ErrorDetails, data: Mapping[str, Any], model: type[BaseModel]
) -> tuple[str, str, str | None]:
    """Place, problem and expectation."""
    kind, location = error["type"], error["loc"]
    place = dotted_key(_location_in_file(location, data, missing=kind == "missing"))
    if kind == "missing":
        return place, "is missing", _field_meaning(model, location)
    if kind == "extra_forbidden":
        known = _known_keys(model, location[:-1])
        return place, "is not a known key", nearest_key(str(location[-1]), known)
    if kind.startswith("union_tag"):
        return _describe_wrong_tag(error, place, model)
    return place, f"found {shorten_value(error['input'])}", _expectation_text(error)


def _describe_wrong_tag(
    error: ErrorDetails, place: str, model: type[BaseModel]
) -> tuple[str, str, str]:
    context = error["ctx"]
    key = context["discriminator"].strip(QUOTE)
    place = f"{place}.{key}"
    if error["type"] == "union_tag_not_found":
        kinds = _allowed_values(_models_at(model, error["loc"]), key)
        return place, "is missing", f"one of {', '.join(map(repr, kinds))}"
    return place, f"found {context['tag']!r}", f"one of {context['expected_tags']}"


def _expectation_text(error: ErrorDetails) -> str:
    context = error.get("ctx", {})
    if error["type"] == "value_error":
        return str(context["error"])
    template = _EXPECTED.get(error["type"])
    if template is None:
        return error["msg"][:1].lower() + error["msg"][1:]
    return template.format(**{k: _plain_text(v) for k, v in context.items()})


def _plain_text(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


def shorten_value(value: object, limit: int = 60) -> str:
    """A value as TOML would show it, cut to a readable length."""
    if isinstance(value, Mapping):
        return "a table"
    text = (
        {True: "true", False: "false"}.get(value) if isinstance(value, bool) else None
    )
    text = text or (repr(value) if value is not None else "null")
    return text if len(text) <= limit else text[: limit - 3] + "..."


def dotted_key(location: Sequence[str | int]) -> str:
    """("pieces", 0, "to") as ``pieces[0].to``."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}"
    return text.removeprefix(".")


def _location_in_file(location: Location, data: Any, *, missing: bool) -> Location:
    """The location without pydantic's own parts (tags of unions, names of types)."""
    parts: list[str | int] = []
    for depth, part in enumerate(location):
        if missing and depth == len(location) - 1:
            return (*parts, part)
        if (
            _is_key_next(location, depth)
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
        parts.append(part)
    return tuple(parts)


def _is_key_next(location: Location, depth: int) -> bool:
    """Whether a key comes next: what is both a tag and a list is the tag then."""
    return isinstance(next(iter(location[depth + 1 :]), None), str)


# --- what the model knows at a location ----------------------------------------------


def _field_meaning(model: type[BaseModel], location: Location) -> str | None:
    if isinstance(location[-1], int):
        return "one more entry in this list"
    for candidate in _models_at(model, location[:-1]):
        for name, info in candidate.model_fields.items():
            if location[-1] in (name, info.alias):
                return info.description or type_in_words(info) or _table_types(info)
    return None


def _table_types(info: FieldInfo) -> str | None:
    """Return the types of a table that may be of several kinds."""
    kinds = _allowed_values(get_args(info.annotation), "type")
    return f"a table with a type out of {', '.join(kinds)}" if kinds else None


def _allowed_values(tables: Iterable[Any], key: str) -> list[str]:
    """Return the allowed values of a key in some tables."""
    fields = [getattr(table, "model_fields", {}).get(key) for table in tables]
    return [kind for f in fields if f is not None for kind in get_args(f.annotation)]


def type_in_words(info: FieldInfo) -> str | None:
    if get_origin(info.annotation) is Literal:
        return " or ".join(repr(value) for value in get_args(info.annotation))
    names = {float: "a number", int: "a whole number", str: "a text in quotes"}
    annotation = info.annotation
    return names.get(annotation) if isinstance(annotation, type) else None


def _known_keys(model: type[BaseModel], location: Location) -> list[str]:
    models = _models_at(model, location)
    return [info.alias or name for m in models for name, info in m.model_fields.items()]


def nearest_key(key: str, known: list[str]) -> str | None:
    from difflib import get_close_matches

    near = get_close_matches(key, known, n=1, cutoff=0.6)
    return near[0] if near else f"one of {', '.join(dict.fromkeys(known))}"


def _models_at(model: type[BaseModel], location: Location) -> list[type[BaseModel]]:
    candidates: list[Any] = [model]
    for depth, part in enumerate(location):
        is_name = depth == len(location) - 1 or _is_key_next(location, depth)
        candidates = [c for a in candidates for c in _schema_step(a, part, is_name)]
    flat = [alternative for a in candidates for alternative in union_members(a)]
    return [c for c in flat if isinstance(c, type) and issubclass(c, BaseModel)]


def union_members(annotation: Any) -> list[Any]:
    """Return the members of a union without Annotated, as far as files may contain
    them.
    """
    if hasattr(annotation, "__metadata__"):
        descriptions = [
            getattr(m, _SAID, PydanticUndefined) for m in annotation.__metadata__
        ]
        descriptions = [kind for kind in descriptions if kind is not PydanticUndefined]
        return union_members(descriptions[0] if descriptions else annotation.__origin__)
    if type(annotation).__name__ in ("Union", "UnionType", "_UnionGenericAlias"):
        return [a for member in get_args(annotation) for a in union_members(member)]
    return [annotation]


def _schema_step(annotation: Any, part: str | int, is_name: bool) -> list[Any]:
    """Return the schema one step deeper; a tag selects the members it may mean.

    Parameters
    ----------
    named : a key follows, see `_is_key_next`
    """
    inner: list[Any] = []
    same: list[Any] = []
    tagged: list[Any] = []
    for candidate in union_members(annotation):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            fields = candidate.model_fields
            field = fields.get(str(part))
            inner += [field.annotation] if field is not None else []
            kind = fields.get("type")
            tags = get_args(kind.annotation) if kind is not None else (part,)
            same += [candidate] if part in tags else []
            tagged += [candidate] if kind is not None and part in tags else []
        elif get_origin(candidate) in (dict, Mapping):
            inner.append(get_args(candidate)[1])
        elif get_origin(candidate) in (list, tuple, Sequence):
            inner.append(get_args(candidate)[0])
    return (is_name and tagged) or inner or same
