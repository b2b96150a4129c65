"""Bodies that are given by models: mesh and number of shape functions, as needed.

Where the model asks for modes alone, static answers to forces and moments at the nodes
that the scene loads are added first, and stay if they change what is wanted by more
than a small part. A body is made on a mesh and on one of half the size, with as many
modes as its model asks for and with twice as many, until neither changes what is wanted
by more than a small part. The finer of both is used. What is left of the error of a
mesh is what a geometric series leaves of the last two changes; half of the last one at
least, where second order would leave a third. Changes by forces at points of plane
bodies and solids do not get smaller: they have no limit. Of the modes it is all of the
last change, as nothing is known of those that follow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.progress import Steps, along
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID, Array

from ..made import Fineness, Made, Source
from ..study.reference import SLOWEST, falling, left_by
from .candidates import finest, loaded_nodes
from .outside import check_inside
from .reference import Reference, make_reference
from .runs import Compile, Runs
from .wanted import Request

#: What meshes and shape functions that are not there may cost of what is allowed.
SHARE = 0.1
#: Halvings of the mesh and doublings of the modes at most, and modes at most.
HALVINGS, DOUBLINGS, MODES = 3, 3, 48
#: Bodies that are made of one model, about.
CHANGES = 4
#: Why they may not.
POINTS = "a body yields the more to a force at a point, the finer its mesh is"
#: In all, from which on the search gives up.
TOO_MUCH = 0.5


@dataclass(frozen=True, eq=False)
class Meshes:
    """Bodies as they are used, and what is left of their error, (n,) by output."""

    made: Mapping[str, Made]
    finenesses: Mapping[str, Fineness]
    errors: Array
    sentences: tuple[str, ...]

    def sids(self, others: Mapping[str, SID]) -> dict[str, SID]:
        return {**others, **{name: made.sid for name, made in self.made.items()}}

    def scene(self, scene: SceneFile) -> SceneFile:
        """The scene that names the SIDs that were made."""
        bodies = dict(scene.bodies)
        for name, made in self.made.items():
            text = made.file or f"(made of {bodies[name].model})"  # type: ignore[union-attr]
            bodies[name] = bodies[name].model_copy(update={"sid": text, "model": None})
        return scene.model_copy(update={"bodies": bodies})


def as_made(sources: Mapping[str, Source], found: Mapping[str, Fineness]) -> Meshes:
    """Bodies as they were made before; their errors are not told."""
    made = {name: source.sid(found[name]) for name, source in sources.items()}
    return Meshes(made, found, np.zeros(0), ())


def refined_meshes(
    scene: SceneFile,
    sids: Mapping[str, SID],
    sources: Mapping[str, Source],
    request: Request,
    compile_: Compile,
) -> Meshes:
    """The bodies of models, one after the other.

    Raises
    ------
    InputError : a model cannot be made, or not as exactly as is asked for.
    """
    search = _Search(scene, dict(sids), request, compile_)
    with along(Steps(CHANGES * len(sources))) as search.steps:
        for name, source in sources.items():
            search.settle(name, source)
    if sources and search.use() > TOO_MUCH:
        raise InputError(
            f"models cannot be made as fine as is asked for: {search.largest[1]}",
            place="accuracy.wanted",
            expected="a larger error, or models with finer meshes and more modes",
        )
    return Meshes(
        search.made, search.finenesses, search.errors, tuple(search.sentences)
    )


class _Search:
    def __init__(
        self,
        scene: SceneFile,
        sids: dict[str, SID],
        request: Request,
        compile_: Compile,
    ) -> None:
        self.scene, self.sids, self.request = scene, sids, request
        self.compile = compile_
        self.steps = Steps(1)
        self.made: dict[str, Made] = {}
        self.finenesses: dict[str, Fineness] = {}
        self.sentences: list[str] = []
        self.errors: Array = np.zeros(len(request.names))
        #: What takes most of what is allowed, and its sentence.
        self.largest = (0.0, "")
        self.reference: Reference | None = None
        #: Runs of the bodies as they are.
        self.runs: Runs | None = None

    def use(self) -> float:
        assert self.reference is not None
        return self.reference.use(self.errors)

    def settle(self, name: str, source: Source) -> None:
        """The mesh and the modes of one body."""
        self.steps.next()
        self.made[name] = source.sid(Fineness())
        self.sids[name] = self.made[name].sid
        if self.reference is None:
            self.runs = self._runs(self.sids)
            whole = finest(self.scene, self.sids)
            self.reference = make_reference(self.runs, whole, self.request)
            check_inside(self.reference.result)
        found = self._more_modes(name, source, self._static_shapes(name, source))
        self.finenesses[name] = self._finer_mesh(name, source, found)

    def _static_shapes(self, name: str, source: Source) -> Fineness:
        """With static shape functions for the loads of this scene, if these matter."""
        loaded = loaded_nodes(self.scene, name)
        nodes = tuple(sorted(int(node) for node in loaded.values() if node.isdecimal()))
        if not source.can_have_static_shapes(nodes):
            return Fineness()
        before, runs = self.made[name], self.runs
        fineness = Fineness(static=nodes)
        change = self._change(name, source, fineness)
        matters = self._use(change) > SHARE
        if not matters:
            fineness, self.made[name] = Fineness(), before
            self.sids[name], self.runs = before.sid, runs
        told = f"static shape functions of {name} for loads at {', '.join(loaded)}"
        verdict = "kept" if matters else "dropped"
        left = np.zeros_like(change) if matters else change
        self._tell(f"{told}: {self._seen(change)}, {verdict}", left)
        return fineness

    def _more_modes(self, name: str, source: Source, fineness: Fineness) -> Fineness:
        left = np.zeros(len(self.request.names))
        if not source.modes:
            self.sentences.append(
                f"shape functions of {name}: its reduction counts no modes, so that "
                "others than these are not judged"
            )
            return fineness
        for _ in range(DOUBLINGS):
            count = min(2 * (fineness.modes or source.modes), MODES)
            more = replace(fineness, modes=count)
            left = self._change(name, source, more)
            fineness = more
            if self._use(left) <= SHARE or count == MODES:
                break
        told = f"{source.modes} to {fineness.modes} modes of {name}"
        self._tell(f"{told}: the last change {self._seen(left)}", left)
        return fineness

    def _finer_mesh(self, name: str, source: Source, fineness: Fineness) -> Fineness:
        if not source.can_refine():
            self.sentences.append(f"mesh of {name}: as it is, not judged")
            return fineness
        left = np.zeros(len(self.request.names))
        changes: list[Array] = []
        for level in range(1, HALVINGS + 1):
            fineness = replace(fineness, level=level)
            changes.insert(0, self._change(name, source, fineness))
            left = np.asarray(left_by(changes))
            if self._use(left) <= SHARE:
                break
        times = "once" if fineness.level == 1 else f"{fineness.level} times"
        told = f"mesh of {name}: halved {times}, the rest {self._seen(left)}"
        if falling(*changes[:2])[self._worst(left)] == SLOWEST:
            told += f", as changes hardly get smaller; {POINTS}"
        self._tell(told, left)
        return fineness

    def _tell(self, sentence: str, left: Array) -> None:
        """A step of the search, and the errors (n,) that it leaves."""
        self.sentences.append(sentence)
        self.errors += left
        self.largest = max(self.largest, (self._use(left), sentence))

    def _change(self, name: str, source: Source, fineness: Fineness) -> Array:
        """What a finer body changes, (n,); from then on it is used."""
        assert self.reference is not None and self.runs is not None
        before, runs = self.runs, []
        self.steps.next()
        with along(Steps(3)) as parts:
            parts.next()
            made = source.sid(fineness)
            after = self._runs({**self.sids, name: made.sid})
            for found in (before, after):
                parts.next()
                whole = finest(self.scene, found.sids)
                runs.append((whole, found.attempt(whole, self.reference.setting)))
        self.made[name], self.sids, self.runs = made, dict(after.sids), after
        return after.between(*runs)

    def _use(self, errors: Array) -> float:
        assert self.reference is not None
        return self.reference.use(errors)

    def _worst(self, errors: Array) -> int:
        assert self.reference is not None
        return self.reference.worst(errors)

    def _seen(self, errors: Array) -> str:
        """The output that sees most of it."""
        assert self.reference is not None
        row = self._worst(errors)
        name = self.request.names[row]
        return f"{errors[row]:.1e} {self.reference.units[row]}".rstrip() + f" in {name}"

    def _runs(self, sids: Mapping[str, SID]) -> Runs:
        return Runs(self.scene, sids, self.compile, self.request.names)
