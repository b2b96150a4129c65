"""Design variables: numbers of a scene and of the models of its bodies, by key."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.files import File

from ..model_derivatives.design_variables import ShapeVariable
from ..sweep.design import Designs, places_of_key, value_at

#: Tables of a scene whose numbers a wildcard may mean.
_TABLES = ("parameters", "gravity", "bodies", "joints", "drives", "forces", "inputs")
#: Keys that are numbers, but no quantities.
_COUNTS = frozenset(["version", "count", "samples"])


class Entry(NamedTuple):
    """A number that a variable changes.

    Attributes
    ----------
    key : as in `Scene.with_`
    body, model_key : of a number of a model: its body, and the key in the model; else
        empty
    value : in the file
    factor : of changes of the variable
    """

    key: str
    body: str
    model_key: str
    value: float
    factor: float


class Variable(NamedTuple):
    """A number of a scene that is varied, or several that change together.

    Attributes
    ----------
    name : its key, or the name of a group
    value : in the scene; 0 for a group
    unit : "" if there is none, or it is not known
    entries : numbers that it changes
    """

    name: str
    value: float
    unit: str
    entries: tuple[Entry, ...]


def find_variables(keys: str | Iterable[str], scene: SceneFile) -> list[Variable]:
    """Find variables by their keys.

    Parameters
    ----------
    keys : of numbers, also several in one text with commas; `*` stands for any letters
        of the keys in the file; a text NAME=KEY:FACTOR,KEY:FACTOR is a group

    Raises
    ------
    InputError : there is no such key, or it is no number.
    """
    given = [keys] if isinstance(keys, str) else [*keys]
    numbers = Numbers(Designs(scene, {}, []))
    known = [*_numbers_in(scene)] if any("*" in text for text in given) else []
    variables: dict[str, Variable] = {}
    for text in given:
        if "=" in text:
            group = ShapeVariable.parse(text)
            variables[group.name] = numbers.group(group.name, group.directions)
            continue
        for key in filter(None, (part.strip() for part in text.split(","))):
            for each in _matching(key, known):
                variables[each] = numbers.single(each)
    if not variables:
        raise InputError(
            "nothing is varied", place="--with", expected="a key such as rod.mass"
        )
    return [*variables.values()]


class Numbers:
    """Variables of a scene and its models; each number is looked up once."""

    def __init__(self, designs: Designs) -> None:
        self._designs = designs
        self._found: dict[str, tuple[Entry, str]] = {}

    def single(self, key: str, name: str = "") -> Variable:
        """The variable of a key.

        Raises
        ------
        InputError : there is no such key, or it is no number.
        """
        entry, unit = self._number(key)
        return Variable(name or key, entry.value, unit, (entry,))

    def group(self, name: str, factors: Mapping[str, float]) -> Variable:
        """The variable that changes several numbers by factors.

        Raises
        ------
        InputError : there is no such key, or it is no number.
        """
        entries, units = list[Entry](), set[str]()
        for key, factor in factors.items():
            entry, unit = self._number(key)
            entries.append(Entry(*entry[:-1], factor))
            units.add(unit)
        unit = units.pop() if len(units) == 1 else ""
        return Variable(name, 0.0, unit, tuple(entries))

    def _number(self, key: str) -> tuple[Entry, str]:
        """The entry of a key with the factor 1, and its unit."""
        if key not in self._found:
            designs = self._designs
            body, model_key = designs.key_of_model(key) or ("", "")
            content: File = designs.model(body) if body else designs.scene
            value = _number_at(content, model_key or key, key)
            self._found[key] = (
                Entry(key, body, model_key, value, 1.0),
                designs.unit(key),
            )
        return self._found[key]


def _matching(key: str, known: Sequence[str]) -> list[str]:
    """Keys that a key with wildcards means."""
    if "*" not in key:
        return [key]
    found = [k for k in known if fnmatchcase(k, key.replace("[", "[[]"))]
    if not found:
        raise InputError(
            f"no number of the scene is {key!r}",
            place="--with",
            expected="a key such as forces.spring.stiffness",
        )
    return found


def _numbers_in(scene: SceneFile) -> Iterator[str]:
    """Keys of the numbers in the tables of a file, without formulas."""
    data = scene.file_data()
    waiting: list[tuple[str, Any]] = [
        (name, data.get(name)) for name in reversed(_TABLES)
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
        for part in places_of_key(content, key):
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
    """Values of the variables by keys of the scene; those of models are left out."""
    found: dict[str, float] = {}
    for entry, change in _changes(variables, values):
        if not entry.body:
            found[entry.key] = found.get(entry.key, entry.value) + change
    return found


def model_changes(
    variables: Sequence[Variable], values: Array, body: str
) -> dict[str, float]:
    """Values of the variables of the model of a body, by keys of the model."""
    found: dict[str, float] = {}
    for entry, change in _changes(variables, values):
        if entry.body == body:
            key = entry.model_key
            found[key] = found.get(key, entry.value) + change
    return found


def model_offsets(
    variables: Sequence[Variable], offsets: Array, body: str
) -> dict[str, float]:
    """Changes of the numbers of a model by changes of the variables."""
    found: dict[str, float] = {}
    for variable, offset in zip(variables, offsets, strict=True):
        for entry in variable.entries:
            if entry.body == body:
                change = entry.factor * float(offset)
                found[entry.model_key] = found.get(entry.model_key, 0.0) + change
    return found


def _changes(
    variables: Sequence[Variable], values: Array
) -> Iterator[tuple[Entry, float]]:
    """Entries of variables with their changes from the file."""
    for variable, value in zip(variables, values, strict=True):
        for entry in variable.entries:
            yield entry, entry.factor * (float(value) - variable.value)
