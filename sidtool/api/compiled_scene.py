"""Scene that is compiled once and run with other numbers.

Runs in several threads: the kernels leave the lock of the interpreter to others.
"""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Event
from typing import TYPE_CHECKING, Any, TypeVar

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.diagnostics.record import warn_of
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_files import read_sid
from sidtool.formats.storage.operating_system import processors
from sidtool.formats.toml.files import locate_errors

from ..pipeline.scene_changes import (
    apply_changes,
    changed_shape_notes,
    reduced_body_notes,
    replace_sids,
    rigid_body_notes,
    take_as_rigid,
)
from ..pipeline.scene_models import convert_bodies
from .interrupts import run_interruptible, wrap_errors
from .result import Result, to_user_result

if TYPE_CHECKING:
    from sidtool.solver.system.system import System

    from .plant import Plant
    from .state_space import StateSpace


Item = TypeVar("Item")
Found = TypeVar("Found")

#: Seconds after which a thread that waits for the interpreter gets it; the default of
#: 5 ms is as long as a whole run.
SWITCH_INTERVAL = 5e-5
#: Items that are begun before the first of them is taken, by thread.
ITEMS_AHEAD = 3


def map_in_threads(
    function: Callable[[Item, Event], Found], items: Iterable[Item], jobs: int
) -> Iterator[Found]:
    """Yield a function of each item, in the order of the items.

    The first item is done alone, so that the others find what is cached. Items are
    taken as they are needed, some ahead.

    Parameters
    ----------
    function : of an item and of an event that is set when the rest is not needed
    jobs : number of threads
    """
    ended, rest = Event(), iter(items)
    for first in rest:
        yield function(first, ended)
        break
    waiting: deque[Future[Found]] = deque()
    interval = sys.getswitchinterval()
    sys.setswitchinterval(min(interval, SWITCH_INTERVAL))
    pool = ThreadPoolExecutor(jobs)
    try:
        for item in rest:
            waiting.append(pool.submit(function, item, ended))
            if len(waiting) >= ITEMS_AHEAD * jobs:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        ended.set()
        pool.shutdown(cancel_futures=True)
        sys.setswitchinterval(interval)


Sids = Mapping[str, SID | str | os.PathLike[str]]


class CompiledScene:
    """A compiled scene, which is run with other numbers; see `Scene.compile`::

        compiled = sidtool.Scene.load("slider_crank.toml").compile()
        for mass in masses:
            result = compiled.run({"crank.mass": mass})

    Runs do not change it. Each run uses the given numbers, else those of the scene, and
    returns the same result as `simulate`, to the last bit.

    Raises
    ------
    InputError : as `simulate`; or the scene asks for an accuracy.
    """

    def __init__(
        self,
        scene: SceneFile,
        *,
        sids: Sids | None = None,
        rigid: Iterable[str] = (),
        accept_defects: bool = False,
        drives: Mapping[str, Any] | None = None,
        forces: Mapping[str, Any] | None = None,
    ) -> None:
        self.scene = scene.model_copy(deep=True)
        self._rigid, self._accepts_defects = tuple(rigid), accept_defects
        self._programs = drives, forces
        self._before: System | None = None
        with locate_errors(scene):
            plain = take_as_rigid(self.scene, self._rigid)
            content, self._given = replace_sids(plain, sids or {}, scene.folder)
            self._former = {name: self._read(plain, name) for name in self._given}
            self._content, model_sids, self._notes = convert_bodies(
                content, scene.folder
            )
            self._before = self._compiled(self._content, self._given | model_sids)

    def __repr__(self) -> str:
        return f"<CompiledScene of {self.scene!r}>"

    def run(
        self,
        changes: Mapping[str, Any] | None = None,
        *,
        sids: Sids | None = None,
        integrator: str | None = None,
        rtol: float | None = None,
        step: float | None = None,
        spectral_radius: float | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Result:
        """Return the motion with other numbers.

        Parameters
        ----------
        changes : values by the keys of the file, as in `Scene.with_`: masses,
            positions, initial values, functions of drives, parameters; the scene is
            compiled again if they change more than numbers
        sids : SIDs, or SID files, that replace those of the scene, by body
        integrator, rtol, step, spectral_radius, progress : as of `sidtool.simulate`

        Raises
        ------
        sidtool.Interrupted, InputError, sidtool.SimulationError : as `simulate`.
        """
        settings: dict[str, Any] = {"integrator": integrator, "rtol": rtol}
        settings |= {"step": step, "spectral_radius": spectral_radius}
        with locate_errors(self.scene), wrap_errors(*self._programs) as stop:
            system, notes = self._with(changes or {}, sids or {})
            settings |= {"progress": progress, "diagnostics": notes}
            return run_interruptible(system, stop, *self._programs, **settings)

    def map(
        self,
        changes: Iterable[Mapping[str, Any]],
        of: Callable[[Result], Any] | None = None,
        *,
        jobs: int | None = None,
        return_errors: bool = False,
        integrator: str | None = None,
        rtol: float | None = None,
        step: float | None = None,
        spectral_radius: float | None = None,
    ) -> Iterator[Any]:
        """Yield the results of runs with other numbers, in the order of the changes::

            masses = [{"crank.mass": 0.3 + 0.01 * k} for k in range(100)]
            largest = [*compiled.map(masses, lambda result: result["rod.q1"].max())]

        Runs share the processors in threads. They give what `run` gives, to the last
        bit.

        Parameters
        ----------
        changes : of each run, as of `run`
        of : number or object that is yielded of each result, evaluated in its thread;
            default the result, which needs memory
        jobs : number of threads, default the processors of this process; scenes with
            functions of Python run one after the other
        return_errors : yield the `sidtool.SimulationError` of a run that stops, instead
            of raising it
        integrator, rtol, step, spectral_radius : as of `sidtool.simulate`

        Raises
        ------
        InputError, sidtool.SimulationError : as `simulate`, when the result of the run
            is taken.
        """
        from sidtool.solver.system.errors import SimulationError

        if jobs is not None and jobs < 1:
            raise InputError(f"jobs is {jobs}", expected="a positive number")
        settings: dict[str, Any] = {"integrator": integrator, "rtol": rtol}
        settings |= {"step": step, "spectral_radius": spectral_radius}

        def run(numbers: Mapping[str, Any], ended: Event) -> Any:
            try:
                result = self._run_alone(numbers, ended, settings)
            except SimulationError as error:
                if not return_errors or ended.is_set():
                    raise
                return error
            return result if of is None else of(result)

        assert self._before is not None
        threads = 1 if self._before.natives else jobs or processors()
        return map_in_threads(run, changes, threads)

    def _run_alone(
        self, changes: Mapping[str, Any], ended: Event, settings: Mapping[str, Any]
    ) -> Result:
        """Run in a thread, until an event is set."""
        from sidtool.solver import simulate

        with locate_errors(self.scene), wrap_errors(*self._programs):
            system, notes = self._with(changes, {})
            found = simulate(
                system,
                stop=lambda: "ended by the program" if ended.is_set() else "",
                emit_warning=warn_of,
                diagnostics=notes,
                **settings,
            )
        return to_user_result(found, *self._programs)

    def plant(
        self,
        outputs: Iterable[str] = (),
        *,
        integrator: str | None = None,
        rtol: float | None = None,
        step: float | None = None,
        spectral_radius: float | None = None,
    ) -> Plant:
        """Return the scene as a plant, which a program advances step by step::

            plant = scene.compile().plant()
            while plant.time < 1.0:
                plant.set(torque=-20.0 * plant["arm.angle"])
                plant.advance(0.01)

        Parameters
        ----------
        outputs : names of outputs in addition to those of the scene; others can be read
            as well, if they do not count revolutions from the start
        integrator, rtol, step, spectral_radius : as of `sidtool.simulate`

        Raises
        ------
        InputError : as `simulate`.
        """
        from .plant import Plant

        settings: dict[str, Any] = {"integrator": integrator, "rtol": rtol}
        settings |= {"step": step, "spectral_radius": spectral_radius}
        return Plant(self.scene, self.system_with, outputs, settings)

    def system_with(
        self, changes: Mapping[str, Any], sids: Sids | None = None
    ) -> System:
        """Return the compiled tables of the scene with other numbers, see `run`."""
        with locate_errors(self.scene):
            return self._with(changes, sids or {})[0]

    def state_space(
        self,
        changes: Mapping[str, Any] | None = None,
        *,
        about: str | float = "static",
        inputs: str | Iterable[str] | None = None,
        outputs: str | Iterable[str] | None = None,
        descriptor: bool = False,
    ) -> StateSpace:
        """Linearise the scene with other numbers between its inputs and outputs.

        Parameters
        ----------
        changes : as of `run`
        about, inputs, outputs, descriptor : as of `sidtool.state_space`

        Raises
        ------
        InputError, sidtool.SimulationError : as `sidtool.state_space`.
        """
        from .state_space import state_space

        drives, forces = self._programs
        return state_space(
            self.scene.with_(changes) if changes else self.scene,
            about=about,
            inputs=inputs,
            outputs=outputs,
            descriptor=descriptor,
            sids=self._given,
            rigid=self._rigid,
            accept_defects=self._accepts_defects,
            drives=drives,
            forces=forces,
        )

    def _with(
        self, changes: Mapping[str, Any], sids: Sids
    ) -> tuple[System, Iterable[Diagnostic]]:
        """Return the system with other numbers, and the diagnostics of it."""
        assert self._before is not None
        content = self._content.with_(changes) if changes else self._content
        if _files(content) != _files(self._content):
            changed, given = self.scene.with_(changes), {**self._given, **sids}
            content, new_sids, notes = apply_changes(
                changed, self.scene.folder, given, self._rigid
            )
            return self._compiled(content, new_sids), notes
        content, new_sids = replace_sids(content, sids, self.scene.folder)
        same = content is self._content
        system = self._before if same else self._compiled(content, new_sids)
        return system, self._notes_on_changes(changes, new_sids)

    def _notes_on_changes(
        self, changes: Mapping[str, Any], sids: Mapping[str, SID]
    ) -> Iterator[Diagnostic]:
        """Yield the diagnostics as of `apply_changes`, computed on demand."""
        plain = take_as_rigid(self.scene.with_(changes), self._rigid)
        yield from changed_shape_notes(plain, {**self._given, **sids}, self._former_of)
        yield from rigid_body_notes(plain)
        for name, lines in self._notes.items():
            yield from lines if name not in sids else ()
        yield from reduced_body_notes(plain)

    def _former_of(self, name: str) -> SID:
        """Return the SID that the scene names for a body."""
        assert self._before is not None
        sid = self._former.get(name, self._before.sids[name])
        if sid is None:
            raise InputError("cannot be read", place=f"bodies.{name}.sid")
        return sid

    def _read(self, scene: SceneFile, name: str) -> SID | None:
        """Return the SID that the scene names, or None."""
        try:
            return read_sid(scene.folder / (scene.sid_bodies[name].sid or ""))
        except InputError:
            return None

    def _compiled(self, content: SceneFile, sids: Mapping[str, SID]) -> System:
        from sidtool.solver import compile_scene

        if content.accuracy.wanted is not None:
            raise InputError(
                "asks for an accuracy, for which models are chosen and compared",
                place="accuracy.wanted",
                expected="`simulate`, or a scene with rtol and integrator",
            )
        drives, forces = self._programs
        return compile_scene(
            content,
            self.scene.folder,
            sids,
            self._accepts_defects,
            drives,
            forces=forces,
            before=self._before,
        )


def _files(scene: SceneFile) -> list[tuple[str | None, str | None]]:
    return [(body.sid, body.model) for body in scene.sid_bodies.values()]
