"""What a study varies: `--over mesh,modes=2:4:8,integrator`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sidtool.formats.errors import InputError

from .settings import Setting

#: What can be varied, in the order of tables.
AXES = ("mesh", "modes", "reduction", "frame", "terms", "integrator")
#: What the values of an axis look like, for messages.
MEANINGS = {
    "mesh": "halvings of the elements, such as mesh=-1:0:1",
    "modes": "numbers of modes, or of shape functions of a SID, such as modes=2:4:8",
    "reduction": "methods, such as reduction=modal:craig_bampton",
    "frame": "frames, out of frame=tangent:chord:buckens",
    "terms": "terms, out of terms=all:stiffening:quadratic:none",
    "integrator": "integrators, such as integrator=radau5:radau9",
}
METHODS = ("modal", "craig_bampton", "attachment", "herting", "krylov")
FRAMES = ("tangent", "chord", "buckens")
TERMS = ("all", "stiffening", "quadratic", "none")
_WORDS = {"reduction": METHODS, "frame": FRAMES, "terms": TERMS}
#: Between the values of an axis.
BETWEEN = ":"


@dataclass(frozen=True)
class Variant:
    """One model of a scene; what is None is as the files say.

    model : number of the model files of the bodies
    mesh : halvings of the elements
    modes : of each body
    """

    model: int = 0
    mesh: int = 0
    modes: int | None = None
    reduction: str | None = None
    frame: str | None = None
    terms: str | None = None


Values = Mapping[str, tuple[Any, ...]]


def parsed(texts: Iterable[str]) -> dict[str, tuple[Any, ...]]:
    """Axes and their values from `--over`; none where the defaults are asked for.

    Raises
    ------
    InputError : there is no such axis or value.
    """
    found: dict[str, tuple[Any, ...]] = {}
    for part in (part.strip() for text in texts for part in text.split(",")):
        name, equals, values = part.partition("=")
        if name not in AXES:
            raise InputError(
                f"found {name!r}", place="--over", expected=", ".join(AXES)
            )
        listed = [v.strip() for v in values.split(BETWEEN)] if equals else []
        found[name] = tuple(dict.fromkeys(_value(name, v) for v in listed))
    return {name: found[name] for name in AXES if name in found}


def _value(axis: str, text: str) -> Any:
    if axis in _WORDS:
        if text in _WORDS[axis]:
            return text
    elif axis == "integrator":
        return text
    else:
        least, most = (-4, 4) if axis == "mesh" else (0, 1000)
        try:
            number = int(text)
        except ValueError:
            number = most + 1
        if least <= number <= most:
            return number
    raise InputError(f"found {text!r}", place=f"--over {axis}", expected=MEANINGS[axis])


def grid(
    models: int, values: Values, base: Variant, settings: Sequence[Setting]
) -> list[tuple[Variant, Setting, int]]:
    """All combinations, and in how many choices each differs from the base.

    Integrators and tolerances are one choice, and so is the model. Those that differ
    least come first.
    """
    found = [(base, 0)]
    names = [name for name in AXES if name in values and name != "integrator"]
    axes = {"model": tuple(range(models))} | {name: values[name] for name in names}
    for name, choices in axes.items():
        own = getattr(base, name)
        found = [
            (with_choice(variant, name, choice), away + (choice != own))
            for variant, away in found
            for choice in choices
        ]
    points = [
        (variant, setting, away + (setting != settings[0]))
        for variant, away in found
        for setting in settings
    ]
    return sorted(points, key=lambda point: point[2])


def with_choice(variant: Variant, name: str, choice: Any) -> Variant:
    """The variant with another choice on an axis."""
    return replace(variant, **{name: choice})
