"""How runs of a study are integrated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sidtool.formats.errors import InputError
from sidtool.formats.scene import SceneFile

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
#: Integrators and tolerances that are tried where other things vary, too.
FEW = ("radau5", "radau9"), (1e-3, 1e-5, 1e-7)
#: Integrators and tolerances of the two references, at the tightest.
TIGHT = (("radau13", 1e-12), ("radau9", 1e-11))
#: Of the tightest tolerance of a study, those of the references.
TIGHTER = (1e-3, 1e-2)


@dataclass(frozen=True)
class Setting:
    """How one run is made; `step` [s] replaces the error control by `rtol`."""

    integrator: str
    rtol: float | None = None
    step: float | None = None

    @property
    def value(self) -> str:
        return f"{self.rtol:.0e}" if self.step is None else f"{self.step:g} s"

    @property
    def key(self) -> str:
        """The lines of `[accuracy]` that ask for it."""
        kind, number = ("rtol", self.rtol) if self.step is None else ("step", self.step)
        return f'integrator = "{self.integrator}", {kind} = {number:g}'


def setting_of(scene: SceneFile) -> Setting:
    """What the table [accuracy] of a scene says."""
    accuracy = scene.accuracy
    if accuracy.step is not None:
        return Setting(accuracy.integrator, step=accuracy.step)
    return Setting(accuracy.integrator, accuracy.rtol)


def default_settings(
    integrators: Sequence[str] = (),
    tolerances: Sequence[float] = (),
    steps: Sequence[float] = (),
) -> list[Setting]:
    """Every integrator with every tolerance and fixed step; "auto" if asked for.

    Raises
    ------
    InputError : an integrator is not known.
    """
    from sidtool.solver.integrators import INTEGRATORS
    from sidtool.solver.integrators.automatic import AUTO

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


def tight(settings: Sequence[Setting]) -> tuple[Setting, Setting]:
    """Two settings by different methods, much tighter than all of a study."""
    least = min((s.rtol for s in settings if s.rtol is not None), default=0.0)
    first, second = (
        Setting(name, max(limit, part * least))
        for (name, limit), part in zip(TIGHT, TIGHTER, strict=True)
    )
    return first, second
