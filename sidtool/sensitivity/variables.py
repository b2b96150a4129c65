"""Design variables: numbers of a scene and of the models of its bodies, by key."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.files import File, key_path

from ..sweep.design import Designs, value_at

#: Tables of a scene whose numbers a wildcard may mean.
_TABLES = ("parameters", "gravity", "bodies", "joints", "drives", "forces", "inputs")
#: Keys that are numbers, but no quantities.
_COUNTS = frozenset(["version", "count", "samples"])


@dataclass(frozen=True)
class Variable:
    """A number of a scene that is varied.

    Attributes
    ----------
    key : as in `Scene.with_`
    value : in the scene
    unit : "" if there is none, or it is not known
    body, model_key : of a number of a model: its body, and the key in the model; else
        empty
    """

    key: str
    value: float
    unit: str
    body: str = ""
    model_key: str = ""


def find_variables(keys: str | Iterable[str], scene: SceneFile) -> list[Variable]:
    """Find variables by their keys.

    Parameters
    ----------
    keys : of numbers, also several in one text with commas; `*` stands for any letters
        of the keys in the file

    Raises
    ------
    InputError : there is no such key, or it is no number.
    """
    given = [keys] if isinstance(keys, str) else [*keys]
    listed = [part.strip() for text in given for part in text.split(",")]
    known = [*_numbers_in(scene)]
    wanted: list[str] = []
    for key in filter(None, listed):
        if "*" not in key:
            wanted.append(key)
            continue
        found = [k for k in known if fnmatchcase(k, key.replace("[", "[[]"))]
        if not found:
            raise InputError(
                f"no number of the scene is {key!r}",
                place="--with",
                expected="a key such as forces.spring.stiffness",
            )
        wanted += found
    if not wanted:
        raise InputError(
            "nothing is varied",
            place="--with",
            expected="a key such as bodies.rod.mass",
        )
    designs = Designs(scene, {}, [])
    variables = []
    for key in dict.fromkeys(wanted):
        body, model_key = designs.key_of_model(key) or ("", "")
        content: File = designs.model(body) if body else scene
        value = _number_at(content, model_key or key, key)
        variables.append(Variable(key, value, designs.unit(key), body, model_key))
    return variables


def _numbers_in(scene: SceneFile) -> Iterator[str]:
    """Keys of the numbers in the tables of a file, without formulas."""
    waiting: list[tuple[str, Any]] = [
        (name, scene.file_data().get(name)) for name in reversed(_TABLES)
    ]
    while waiting:
        key, part = waiting.pop()
        if isinstance(part, dict):
            waiting += [(f"{key}.{name}", part[name]) for name in reversed(part)]
        elif isinstance(part, list) and not _is_single(part):
            waiting += [(f"{key}[{k}]", part[k]) for k in reversed(range(len(part)))]
        elif key.rpartition(".")[2] not in _COUNTS:
            part = part[0] if _is_single(part) else part
            if isinstance(part, int | float) and not isinstance(part, bool):
                yield key


def _is_single(part: Any) -> bool:
    """True for a list of one number, which a file may have as that number."""
    is_list = isinstance(part, list | tuple) and len(part) == 1
    return is_list and isinstance(part[0], int | float)


def _number_at(content: File, key: str, place: str) -> float:
    """The number at a key.

    Raises
    ------
    InputError : there is none.
    """
    value: Any = content
    try:
        for part in key_path(key, content.file_data(), type(content)):
            value = value_at(value, part)
    except (LookupError, AttributeError, TypeError, StopIteration):
        raise InputError(
            "is not there", place=place, expected="a key of the file"
        ) from None
    if _is_single(value):
        value = value[0]
    if value is None:
        raise InputError(
            "has no value", place=place, expected=f"one, as by --set {place}=0.1"
        )
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(
            f"is no number, but {value!r}"[:200],
            place=place,
            expected="the key of a number, such as gravity[1] for a component",
        )
    return float(value)


def scene_changes(variables: Sequence[Variable], values: Array) -> dict[str, float]:
    """Changes of the scene that give its variables other values; those of models are
    left out.
    """
    pairs = zip(variables, values, strict=True)
    return {v.key: float(x) for v, x in pairs if not v.body}


def model_changes(
    variables: Sequence[Variable], values: Array, body: str
) -> dict[str, float]:
    """Values of the variables of the model of a body, by keys of the model."""
    pairs = zip(variables, values, strict=True)
    return {v.model_key: float(x) for v, x in pairs if v.body == body}
