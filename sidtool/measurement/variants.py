"""Variants of a study: axes such as `--over mesh,modes=2:4:8`, integration settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import SceneFile

#: Axes of a study, in the order of tables.
AXES = ("mesh", "modes", "reduction", "frame", "terms", "integrator")
#: Description of the values of each axis, for messages.
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
#: Separator of the values of an axis.
VALUE_SEPARATOR = ":"

Values = Mapping[str, tuple[Any, ...]]
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
#: Integrators and tolerances if other axes vary, too.
FEW_SETTINGS = ("radau5", "radau9"), (1e-3, 1e-5, 1e-7)
#: Integrators and tolerances of the two references, at the tightest.
TIGHTEST_SETTINGS = (("radau13", 1e-12), ("radau9", 1e-11))
#: Tolerances of the references relative to the tightest one of a study.
FACTOR_OF_TIGHT_SETTINGS = (1e-3, 1e-2)


@dataclass(frozen=True)
class Variant:
    """A variant of a scene; None stands for the content of the files.

    Attributes
    ----------
    model : index of the model files of the bodies
    mesh : number of halvings of the element size
    modes : number of modes of each body
    """

    model: int = 0
    mesh: int = 0
    modes: int | None = None
    reduction: str | None = None
    frame: str | None = None
    terms: str | None = None


def parse_axes(texts: Iterable[str]) -> dict[str, tuple[Any, ...]]:
    """Parse axes and their values from `--over`; no values stand for the defaults.

    Raises
    ------
    InputError : there is no such axis or value.
    """
    axes: dict[str, tuple[Any, ...]] = {}
    for part in (part.strip() for text in texts for part in text.split(",")):
        name, equals, values = part.partition("=")
        if name not in AXES:
            raise InputError(
                f"found {name!r}", place="--over", expected=", ".join(AXES)
            )
        listed = [v.strip() for v in values.split(VALUE_SEPARATOR)] if equals else []
        axes[name] = tuple(dict.fromkeys(_parse_value(name, v) for v in listed))
    return {name: axes[name] for name in AXES if name in axes}


def _parse_value(axis: str, text: str) -> Any:
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


def variant_grid(
    models: int, values: Values, base: Variant, settings: Sequence[Setting]
) -> list[tuple[Variant, Setting, int]]:
    """Return all combinations, with the number of choices in which each differs from
    the base. Integrator and tolerance are one choice, and so is the model. Combinations
    with the fewest changes come first.
    """
    variants = [(base, 0)]
    names = [name for name in AXES if name in values and name != "integrator"]
    axes = {"model": tuple(range(models))} | {name: values[name] for name in names}
    for name, choices in axes.items():
        own = getattr(base, name)
        variants = [
            (with_choice(variant, name, choice), away + (choice != own))
            for variant, away in variants
            for choice in choices
        ]
    points = [
        (variant, setting, away + (setting != settings[0]))
        for variant, away in variants
        for setting in settings
    ]
    return sorted(points, key=lambda point: point[2])


def with_choice(variant: Variant, name: str, choice: Any) -> Variant:
    """Return the variant with another choice on an axis."""
    return replace(variant, **{name: choice})


@dataclass(frozen=True)
class Setting:
    """Integration of one run; `step` [s] replaces the error control by `rtol`."""

    integrator: str
    rtol: float | None = None
    step: float | None = None

    @property
    def value(self) -> str:
        return f"{self.rtol:.0e}" if self.step is None else f"{self.step:g} s"

    @property
    def key(self) -> str:
        """Return the keys of the table `[accuracy]` for this setting."""
        kind, number = ("rtol", self.rtol) if self.step is None else ("step", self.step)
        return f'integrator = "{self.integrator}", {kind} = {number:g}'


def setting_of(scene: SceneFile) -> Setting:
    """Return the setting in the table [accuracy] of a scene."""
    accuracy = scene.accuracy
    if accuracy.step is not None:
        return Setting(accuracy.integrator, step=accuracy.step)
    return Setting(accuracy.integrator, accuracy.rtol)


def default_settings(
    integrators: Sequence[str] = (),
    tolerances: Sequence[float] = (),
    steps: Sequence[float] = (),
) -> list[Setting]:
    """Return every integrator with every tolerance and fixed step; "auto" on request.

    Raises
    ------
    InputError : an integrator is not known.
    """
    from sidtool.solver.integrators.registry import AUTO, INTEGRATORS

    known = (AUTO, *INTEGRATORS)
    for name in integrators:
        if name not in known:
            raise InputError(
                f"there is no integrator {name!r}",
                expected=f"one of {', '.join(known)}",
            )
    chosen = integrators or tuple(INTEGRATORS)
    if not tolerances and not steps:
        tolerances = TOLERANCES
    return [Setting(name, rtol=rtol) for name in chosen for rtol in tolerances] + [
        Setting(name, step=step) for name in chosen for step in steps
    ]


def tight_settings(settings: Sequence[Setting]) -> tuple[Setting, Setting]:
    """Return two settings with different methods, much tighter than those of a
    study.
    """
    least = min((s.rtol for s in settings if s.rtol is not None), default=0.0)
    first, second = (
        Setting(name, max(limit, part * least))
        for (name, limit), part in zip(
            TIGHTEST_SETTINGS, FACTOR_OF_TIGHT_SETTINGS, strict=True
        )
    )
    return first, second
