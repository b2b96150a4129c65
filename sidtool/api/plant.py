"""Plant: a scene that a program advances step by step."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics.record import warn_of
from sidtool.formats.scene import SceneFile, unit_of
from sidtool.formats.scene.laws import without_tables
from sidtool.formats.toml.files import locate_errors

if TYPE_CHECKING:
    from sidtool.solver.simulation.plant import Observer, PlantRun, PlantState
    from sidtool.solver.system.system import System


class PlantEvent(NamedTuple):
    """An event of the scene, or a joint that begins to stick or to slip.

    Attributes
    ----------
    name : of the event or of the joint
    kind : "rising" or "falling", "stick" or "slip", "break" of a function of time
    t : time [s]
    """

    name: str
    kind: str
    t: float


class Plant:
    """A scene between a controller and its sensors; see `CompiledScene.plant`.

    The integrator chooses its steps by itself, whatever the length of the calls of
    `advance` is. Tables `times`, `values` of inputs have no effect: a program sets the
    inputs, which begin with `initial`.

    Parameters
    ----------
    scene : content of the scene
    system_with : compiles the scene with other values of its keys
    outputs : names of outputs in addition to those of the scene
    settings : integrator, rtol, step and spectral_radius as of `sidtool.simulate`

    Raises
    ------
    InputError : an output is an integral over a run; or as `sidtool.simulate`.
    """

    def __init__(
        self,
        scene: SceneFile,
        system_with: Callable[[Mapping[str, Any]], System],
        outputs: Iterable[str],
        settings: Mapping[str, Any],
    ) -> None:
        self._scene, self._system_with = scene, system_with
        self._settings = settings
        names = [*scene.outputs.record, *outputs]
        self._fixed: dict[str, Any] = {"outputs.record": [*dict.fromkeys(names)]}
        self._fixed |= without_tables(scene.inputs)
        self._begin({})

    def _begin(self, changes: Mapping[str, Any]) -> None:
        """Begin the motion with other numbers of the scene."""
        from sidtool.solver.simulation.plant import new_plant

        with locate_errors(self._scene):
            system = self._system_with({**changes, **self._fixed})
            _check_outputs(system.scene.outputs.record)
            self._run: PlantRun = new_plant(system, warn_of, **self._settings)
            observer = self._run.observe(system=self._run.system)
        self._observers: dict[str, tuple[Observer, int]] = {}
        self._values: dict[int, np.ndarray] = {}
        self._changes = dict(changes)
        self._add(observer)
        self._outputs = observer.names
        self._start = self._run.save()

    def _add(self, observer: Observer) -> None:
        for k, name in enumerate(observer.names):
            self._observers.setdefault(name, (observer, k))

    def __repr__(self) -> str:
        return (
            f"<Plant {self._scene.title!r} at t = {self.time:g} s: "
            f"{len(self.inputs)} inputs, {len(self._outputs)} outputs>"
        )

    @property
    def time(self) -> float:
        """The time that was reached [s]."""
        return self._run.time

    @property
    def end(self) -> float:
        """End of the scene, beyond which the plant does not go [s]."""
        return self._run.end

    @property
    def inputs(self) -> dict[str, float]:
        """Values of the inputs at the present time, by name."""
        return {n: piece.at(self.time)[0] for n, piece in self._run.pieces.items()}

    @property
    def outputs(self) -> dict[str, float]:
        """Outputs of the scene at the present time, by name."""
        return dict(zip(self._outputs, self.read(*self._outputs).tolist(), strict=True))

    @property
    def events(self) -> list[PlantEvent]:
        """Events and changes between sticking and slipping since the start."""
        return [PlantEvent(e.name, e.kind, e.t) for e in self._run.events]

    @property
    def stopping_event(self) -> str:
        """Name of the event that has ended the motion, or empty."""
        return self._run.stopping_event

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of an input by `inputs.NAME`."""
        return unit_of(name, self._scene)

    def set(self, values: Mapping[str, float] | None = None, /, **named: float) -> None:
        """Set inputs from the present time on.

        A held input jumps to the value. A linear or smooth one reaches it at the end of
        the next `advance`.

        Raises
        ------
        InputError : there is no such input, or the value is no finite number.
        """
        for name, value in {**(values or {}), **named}.items():
            if name not in self._run.pieces:
                known = ", ".join(self._run.pieces) or "the scene has none"
                raise InputError(
                    f"there is no input {name!r}", place="set", expected=known
                )
            number = _finite_number(name, value)
            self._run.set(name, number)
        self._values.clear()

    def advance(self, duration: float) -> None:
        """Advance the motion by a time span [s].

        It ends before where an event of the scene ends the motion: `stopping_event` is
        its name then.

        Raises
        ------
        InputError : the duration is negative, its end lies behind the end of the scene,
            or the motion has ended.
        sidtool.SimulationError : the motion cannot go on. The plant goes on after
            `restore` or `reset`.
        """
        self.advance_to(self._run.time + duration)

    def advance_to(self, time: float) -> None:
        """Advance the motion to a time [s]; see `advance`."""
        self._values.clear()
        self._run.advance_to(time)

    def __getitem__(self, name: str) -> float:
        """Return an output at the present time.

        Accelerations and forces are those just before the time, with the inputs that
        are set.

        Raises
        ------
        InputError : there is no such output, it is an integral over a run, or it counts
            revolutions and was not named when the plant was made.
        """
        return float(self.read(name)[0])

    def read(self, *names: str) -> np.ndarray:
        """Return outputs at the present time, (n,); errors as of `plant[name]`."""
        for name in names:
            if name not in self._observers:
                self._observe(name)
        return np.array([self._value(*self._observers[name]) for name in names])

    def _value(self, observer: Observer, k: int) -> float:
        values = self._values.get(id(observer))
        if values is None:
            values = self._values[id(observer)] = observer.values()
        return float(values[k])

    def _observe(self, name: str) -> None:
        """Find how to evaluate an output that the scene does not record."""
        _check_outputs([name])
        with locate_errors(self._scene):
            changes = {**self._changes, **self._fixed, "outputs.record": [name]}
            system = self._system_with(changes)
            if list(system.scene.outputs.record) != [name]:
                raise InputError(
                    f"{name} is not one output", expected="a name without *"
                )
            self._add(self._run.observe(system))

    def state(self) -> PlantState:
        """Return a copy of the state, with the memory of the integrator.

        `restore` goes on from there to the last bit. States can be pickled. What laws
        in Python remember is not part of it.
        """
        return self._run.save()

    def restore(self, state: PlantState) -> None:
        """Go back to a state of this plant, or of an equal one.

        Raises
        ------
        InputError : it is the state of another scene.
        """
        self._values.clear()
        self._run.restore(state)

    def reset(self, changes: Mapping[str, Any] | None = None) -> None:
        """Go back to the start of the scene, with inputs at their initial values.

        Parameters
        ----------
        changes : other values by the keys of the scene, as of `CompiledScene.run`:
            `{"arm.initial.angle": 0.1}`; default as in the last `reset` with changes

        Raises
        ------
        InputError : as `simulate`.
        """
        self._values.clear()
        if changes is None:
            self._run.restore(self._start)
        else:
            self._begin(changes)


def _check_outputs(names: Iterable[str]) -> None:
    """Refuse integrals over a run, whose steps a plant does not keep."""
    from sidtool.solver.output.energies import is_energy_integral

    for name in filter(is_energy_integral, names):
        raise InputError(
            f"{name} is an integral over a run, which a plant does not keep",
            place="outputs.record",
            expected="an output that follows from the present state",
        )


def _finite_number(name: str, value: Any) -> float:
    """Return the value of an input as a number."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(
            f"{value!r} is no finite number", place=name, expected="a number"
        )
    return number
