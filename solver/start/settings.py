"""How a run is made: what is asked for, else what the scene says."""

from __future__ import annotations

from dataclasses import dataclass

from sidtool.formats.errors import InputError
from sidtool.formats.scene import SceneFile

from ..integrators import INTEGRATORS
from ..integrators.automatic import AUTO, Choice, choose
from ..system.bodies.turned_markers import as_written
from ..system.scene import System


@dataclass(frozen=True)
class Settings:
    """How a run is made: integrator, relative tolerance, or a fixed step [s].

    asked : integrator that was asked for, perhaps "auto"
    when_stiff : integrator that goes on where the scene turns out to be stiff, or empty
    radius : spectral radius at infinite frequency, of methods that have one
    """

    asked: str
    integrator: str
    when_stiff: str
    rtol: float
    step: float | None
    radius: float

    @property
    def possible(self) -> tuple[str, ...]:
        """Integrators that may be used."""
        return tuple(name for name in (self.integrator, self.when_stiff) if name)


def settings_of(
    system: System,
    integrator: str | None,
    rtol: float | None,
    step: float | None,
    radius: float | None,
) -> Settings:
    accuracy = system.scene.accuracy
    name = integrator or accuracy.integrator
    if name not in (AUTO, *INTEGRATORS):
        raise InputError(
            f"there is no integrator {name!r}",
            place="accuracy.integrator",
            expected=f"one of {', '.join((AUTO, *INTEGRATORS))}",
        )
    rtol = accuracy.rtol if rtol is None else rtol
    step = accuracy.step if step is None else step
    if system.led and name == "generalised_alpha" and step is None:
        raise InputError(
            f"generalised_alpha takes drives with laws ({', '.join(system.led)}) in "
            "fixed steps alone: steps of its own would be far too many",
            place="accuracy.integrator",
            expected="a fixed step (accuracy.step, --step), or auto, radau5, radau9, "
            "radau13, trapezoidal or dop853",
        )
    if not 1e-13 <= rtol <= 0.1:
        raise InputError(f"rtol is {rtol:g}", expected="a number from 1e-13 to 0.1")
    if step is not None and not step > 0.0:
        raise InputError(f"step is {step:g}", expected="a positive number of seconds")
    radius = accuracy.spectral_radius if radius is None else radius
    if not 0.0 <= radius <= 1.0:
        raise InputError(f"spectral_radius is {radius:g}", expected="0 to 1")
    choice = choose(system, rtol, step) if name == AUTO else Choice(name)
    return Settings(name, choice.first, choice.when_stiff, rtol, step, radius)


def made_with(scene: SceneFile, settings: Settings) -> str:
    """The scene as JSON, with the settings that a run was made with."""
    accuracy = scene.accuracy.model_copy(
        update={
            "integrator": settings.asked,
            "rtol": settings.rtol,
            "step": settings.step,
            "spectral_radius": settings.radius,
        }
    )
    made = as_written(scene).model_copy(update={"accuracy": accuracy})
    return made.model_dump_json(by_alias=True, exclude_none=True)
