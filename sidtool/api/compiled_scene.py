"""Scene that is compiled once and run with other numbers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_files import read_sid
from sidtool.formats.toml.files import locate_errors

from ..pipeline.model_cache import convert_bodies
from ..pipeline.scene_changes import (
    apply_changes,
    changed_shape_notes,
    reduced_body_notes,
    replace_sids,
    rigid_body_notes,
    take_as_rigid,
)
from .interrupts import run_interruptible, wrap_errors
from .result import Result

if TYPE_CHECKING:
    from sidtool.solver.system.system import System

    from .plant import Plant

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

    def system_with(self, changes: Mapping[str, Any]) -> System:
        """Return the compiled tables of the scene with other numbers, see `run`."""
        with locate_errors(self.scene):
            return self._with(changes, {})[0]

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
