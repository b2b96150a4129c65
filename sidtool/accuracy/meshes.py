"""Bodies that are given by models: mesh and number of shape functions, as needed.

Where the model asks for modes alone, static answers to forces and moments at the nodes
that the scene loads, and to the loads of its own inertia, are added first, and stay if
they change what is wanted by more than a small part: the modes that stretch a slender
body as it turns stand far above those that bend it. A body is made on a mesh and on one
of half the size, with as many modes as its model asks for and with twice as many, until
neither changes what is wanted by more than a small part. The finer of both is used.
What is left of the error of a mesh is what a geometric series leaves of the last two
changes; half of the last one at least, where second order would leave a third. Changes
by forces at points of plane bodies and solids do not get smaller: they have no limit.
Of the modes it is all of the last change, as nothing is known of those that follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.progress import Steps, along
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID, Array
from sidtool.formats.stiffening import MATTERS

from ..made import Fineness, Made, Source
from ..study.reference import SLOWEST, falling, left_by
from .candidates import finest, loaded_nodes
from .outside import check_inside, told_lack
from .reference import Reference, make_reference
from .runs import Compile, Runs
from .same_shapes import differs
from .wanted import Request

#: What meshes and shape functions that are not there may cost of what is allowed.
SHARE = 0.1
#: Halvings of the mesh and doublings of the modes at most, and modes at most, but for
#: the first doubling.
HALVINGS, DOUBLINGS, MODES = 3, 3, 48
#: Bodies that are made of one model, about.
CHANGES = 4
#: Why they may not.
POINTS = "a body yields the more to a force at a point, the finer its mesh is"
#: What helps then.
TIE = "a tie (markers.NAME.tie) of {} to an edge, a face or a node set, which spreads "
TIE += "the load"
#: In all, from which on the search gives up.
TOO_MUCH = 0.5

#: What finer bodies leave, (n,), and how fine they are, by name and from where on.
Finer = Callable[[str, Fineness], tuple[Array, Fineness]]


@dataclass(frozen=True, eq=False)
class Meshes:
    """Bodies as they are used, and what is left of their error, (n,) by output.

    unstiffened : whose geometric stiffening is told here, as their models lack it
    """

    made: Mapping[str, Made]
    finenesses: Mapping[str, Fineness]
    errors: Array
    sentences: tuple[str, ...]
    unstiffened: frozenset[str] = frozenset()

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
    search = _Search(scene, sids, sources, request, compile_)
    with along(Steps(CHANGES * len(sources))) as search.steps:
        for name in sources:
            search.settle(name)
    if sources and search.use(search.errors) > TOO_MUCH:
        cause = search.largest[1]
        helps = (
            "a larger error, models with finer meshes and more modes, or loads that "
        )
        helps += "do not begin at once, which moves all modes"
        if cause in search.points:
            helps = f"{TIE.format(search.points[cause])}, or a larger error"
        raise InputError(
            f"models cannot be made as fine as is asked for: {cause}",
            place="accuracy.wanted",
            expected=helps,
        )
    search.judge_stiffening()
    if search.others:
        listed = ", ".join(sorted(search.others))
        search.sentences.append(
            f"not judged over meshes and modes, whose shape functions differ: {listed}"
        )
    made = {name: search.made(name, fine) for name, fine in search.state.items()}
    sentences, judged = tuple(search.sentences), frozenset(search.stiffness)
    return Meshes(made, search.state, search.errors, sentences, judged)


class _Search:
    """Bodies of models, refined one after the other.

    state : how fine each is
    """

    def __init__(
        self,
        scene: SceneFile,
        sids: Mapping[str, SID],
        sources: Mapping[str, Source],
        request: Request,
        compile_: Compile,
    ) -> None:
        self.scene, self.sids, self.request = scene, sids, request
        self.sources, self.compile = sources, compile_
        self.steps = Steps(1)
        self.state = {name: Fineness() for name in sources}
        self.sentences: list[str] = []
        self.errors: Array = np.zeros(len(request.names))
        #: What takes most of what is allowed, and its sentence.
        self.largest = (0.0, "")
        #: Whether the last changes by finer meshes hardly got smaller, (n,).
        self.slow = np.zeros(len(request.names), dtype=bool)
        #: Markers at single points of continua, by the sentence on the changes there.
        self.points: dict[str, str] = {}
        #: Elastic coordinates that mean something else on another mesh.
        self.others: set[str] = set()
        #: What geometric stiffening would change, of the stiffness of bodies without.
        self.stiffness: dict[str, float] = {}
        self.reference: Reference | None = None
        self._made: dict[tuple[str, Fineness], Made] = {}
        self._runs: dict[tuple[Fineness, ...], Runs] = {}

    def made(self, name: str, fineness: Fineness) -> Made:
        key = name, fineness
        if key not in self._made:
            self._made[key] = self.sources[name].sid(fineness)
        return self._made[key]

    def settle(self, name: str) -> None:
        """The mesh and the modes of one body."""
        self.steps.next()
        if self.reference is None:
            self.reference = self._first_reference()
            check_inside(self.reference.result)
        source = self.sources[name]
        found = self._more_modes(name, source, self._static_shapes(name))
        self.state[name] = self._finer_mesh(name, source, found)

    def judge_stiffening(self) -> None:
        """The models beside those with the geometric stiffening that they lack: what
        rotation does to a plate its SID does not tell.

        Raises
        ------
        OutsideTheory : it changes a stiffness by much, and an output by a hundredth of
            its variation and more than is allowed.
        """
        rich = {name: Fineness(static=self._loaded(name)) for name in self.state}
        lacking = [n for n, s in self.sources.items() if s.model.stiffening is None]
        stiff = rich | {n: replace(rich[n], stiffened=True) for n in lacking}
        if not lacking or self.reference is None:
            return
        try:
            runs = [self._runs_of(state) for state in (rich, stiff)]
        except InputError:
            return
        found = [
            (choice, r.attempt(choice, self.reference.setting))
            for r in runs
            for choice in [finest(self.scene, r.sids)]
        ]
        change, result = runs[1].between(*found), found[1][1]
        if result is None or not np.isfinite(change).all():
            return
        for name in lacking:
            body = result.bodies[name]
            self.stiffness[name] = (body.found or body.expected).ratio
        visible = np.maximum(self.reference.allowed, MATTERS * self.reference.variation)
        matters = bool((change > visible).any())
        self.sentences += told_lack(self.stiffness, self._seen(change), matters)

    def _first_reference(self) -> Reference:
        """With static shapes for all loads, as outputs may not move without; as the
        models are if that does not run."""
        from sidtool.solver.errors import SimulationError

        rich = {name: Fineness(static=self._loaded(name)) for name in self.state}
        if rich != self.state:
            with suppress(InputError, SimulationError):
                return self._reference(rich)
        return self._reference(self.state)

    def _reference(self, state: Mapping[str, Fineness]) -> Reference:
        runs = self._runs_of(state)
        return make_reference(runs, finest(self.scene, runs.sids), self.request)

    def _loaded(self, name: str) -> tuple[int, ...]:
        """Nodes with loads that static shape functions can be had for; all nodes with
        markers of a body that nothing loads but its own inertia."""
        loaded = loaded_nodes(self.scene, name).values()
        nodes = tuple(sorted(int(node) for node in loaded if node.isdecimal()))
        if not nodes:
            markers = self.sources[name].model.markers.values()
            nodes = tuple(sorted(marker.node for marker in markers))
        return nodes if self.sources[name].can_have_static_shapes(nodes) else ()

    def _static_shapes(self, name: str) -> Fineness:
        """With static shape functions for the loads of this scene, if these matter."""
        nodes = self._loaded(name)
        if not nodes:
            return Fineness()
        change = self._change(name, Fineness(static=nodes))
        matters = self.use(change) > SHARE
        if not matters:
            self.state[name] = Fineness()
        loaded = ", ".join(loaded_nodes(self.scene, name))
        told = f"static shape functions of {name} for its own inertia"
        told += f", and for loads at {loaded}" if loaded else ""
        verdict = "kept" if matters else "dropped"
        left = np.zeros_like(change) if matters else change
        self._tell(f"{told}: {self._seen(change)}, {verdict}", left)
        return self.state[name]

    def _more_modes(self, name: str, source: Source, fineness: Fineness) -> Fineness:
        if not source.modes:
            self.sentences.append(
                f"shape functions of {name}: its reduction counts no modes, so that "
                "others than these are not judged"
            )
            return fineness
        left, found = self._told_from_steps(name, fineness, self._doubled)
        told = f"{source.modes} to {found.modes} modes of {name}"
        self._tell(f"{told}: the last change {self._seen(left)}", left)
        return found

    def _doubled(self, name: str, fineness: Fineness) -> tuple[Array, Fineness]:
        """What is left (n,) with more modes, and how many."""
        own = self.sources[name].modes or 0
        most = max(MODES, 2 * own)
        for _ in range(DOUBLINGS):
            count = min(2 * (fineness.modes or own), most)
            fineness = replace(fineness, modes=count)
            left = self._change(name, fineness)
            if self.use(left) <= SHARE or count == most:
                break
        return left, fineness

    def _finer_mesh(self, name: str, source: Source, fineness: Fineness) -> Fineness:
        if not source.can_refine():
            self.sentences.append(f"mesh of {name}: as it is, not judged")
            return fineness
        left, found = self._told_from_steps(name, fineness, self._halved)
        times = "once" if found.level == 1 else f"{found.level} times"
        told = f"mesh of {name}: halved {times}, the rest {self._seen(left)}"
        if self.slow[self._worst(left)]:
            told += ", as changes hardly get smaller"
            points = source.point_markers(loaded_nodes(self.scene, name).values())
            if points and self.use(left) > SHARE:
                listed = ", ".join(points)
                told += f"; {POINTS}, as joints and forces do at {listed}"
                self.points[told] = f"{listed} of {name}"
        self._tell(told, left)
        return found

    def _halved(self, name: str, fineness: Fineness) -> tuple[Array, Fineness]:
        """What is left (n,) with finer meshes, and how fine."""
        changes: list[Array] = []
        for level in range(1, HALVINGS + 1):
            fineness = replace(fineness, level=level)
            changes.insert(0, self._change(name, fineness))
            left = np.asarray(left_by(changes))
            if self.use(left) <= SHARE:
                break
        self.slow = falling(*changes[:2]) == SLOWEST
        return left, fineness

    def _told_from_steps(
        self, name: str, fineness: Fineness, finer: Finer
    ) -> tuple[Array, Fineness]:
        """Once more with tighter runs, if what is left may be that of their steps."""
        left, found = finer(name, fineness)
        if self.use(left) <= SHARE or not self._tightened():
            return left, found
        self.state[name] = fineness
        return finer(name, fineness)

    def _tightened(self) -> bool:
        """Whether finer bodies need tighter runs, which are made from then on."""
        from sidtool.solver.errors import SimulationError

        assert self.reference is not None
        before = self.reference.setting.rtol
        with suppress(InputError, SimulationError):
            self.reference = self._reference(self.state)
        return self.reference.setting.rtol < before

    def _tell(self, sentence: str, left: Array) -> None:
        """A step of the search, and the errors (n,) that it leaves."""
        self.sentences.append(sentence)
        self.errors += left
        self.largest = max(self.largest, (self.use(left), sentence))

    def _change(self, name: str, fineness: Fineness) -> Array:
        """What a finer body changes, (n,); from then on it is used."""
        assert self.reference is not None
        before, runs = self._runs_of(self.state), []
        self.steps.next()
        with along(Steps(3)) as parts:
            parts.next()
            self.state[name] = fineness
            after = self._runs_of(self.state)
            for found in (before, after):
                parts.next()
                whole = finest(self.scene, found.sids)
                runs.append((whole, found.attempt(whole, self.reference.setting)))
        change = after.between(*runs)
        for row, output in enumerate(self.request.names):
            if np.isfinite(change[row]) and differs(output, before.sids, after.sids):
                self.others.add(output)
                change[row] = 0.0
        return change

    def use(self, errors: Array) -> float:
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

    def _runs_of(self, state: Mapping[str, Fineness]) -> Runs:
        key = tuple(state.values())
        if key not in self._runs:
            found = {name: self.made(name, fine).sid for name, fine in state.items()}
            sids = {**self.sids, **found}
            self._runs[key] = Runs(self.scene, sids, self.compile, self.request.names)
        return self._runs[key]
