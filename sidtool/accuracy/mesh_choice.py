"""Meshes and numbers of shape functions of bodies that are given by models.

If the model has normal modes only, static shape functions are added first: for forces
and moments at the loaded nodes, and for the inertia loads of the body. They are
retained if they change an output by more than a small part of the allowed error: the
modes that stretch a slender rotating body have much higher frequencies than those that
bend it. Then a body is converted with its mesh and with half the element size, with the
number of modes of its model and with twice as many, until neither changes the outputs
by more than a small part. The finer of the two is used. The remaining error of a mesh
is estimated from the geometric series of the last two changes, at least half of the
last change (second order would give a third). Changes by forces at single points of
continua do not decrease: they have no limit. The remaining error of the modes is the
full last change, because the following ones are not known.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.base.errors import InputError, TooManyModes
from sidtool.formats.base.numbers import is_label
from sidtool.formats.base.progress import EqualStages, count_within
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.geometric_stiffening import SIGNIFICANT_CHANGE
from sidtool.formats.result import Decision, OutputError
from sidtool.formats.scene import SceneFile

from ..measurement.candidates import finest_model, loaded_nodes
from ..measurement.points import (
    MAX_CONVERGENCE_RATIO,
    convergence_ratios,
    mesh_error_estimate,
)
from ..measurement.request import Request, refuse_accuracy
from ..measurement.runs import (
    Compile,
    Runs,
    check_validity,
    is_incomparable,
    missing_stiffening_diagnostics,
)
from ..pipeline.model_cache import BodyModel, ConvertedBody, Refinement
from .reference_run import Reference, make_reference

#: Share of the allowed error for meshes and omitted shape functions.
MESH_ERROR_SHARE = 0.1
#: Largest numbers of halvings of the mesh, of doublings of the modes, and of modes
#: (except for the first doubling).
MAX_HALVINGS, MAX_DOUBLINGS, MAX_MODES = 3, 3, 48
#: Expected number of conversions of one model.
EXPECTED_CHANGES = 4
#: Remedy.
TIE = "a tie (markers.NAME.tie) of {} to an edge, a face or a node set, which spreads "
TIE += "the load"
#: Total relative change of stiffness above which the search is refused.
MAX_STIFFENING_EFFECT = 0.5

#: Function of a body and its refinement: remaining errors (n,), new refinement.
Finer = Callable[[str, Refinement], tuple[Array, Refinement]]


@dataclass(frozen=True, eq=False)
class RefinedBodies:
    """Refined bodies, and their remaining errors (n,) by output.

    Attributes
    ----------
    unstiffened : bodies whose missing geometric stiffening is reported here
    """

    converted_bodies: Mapping[str, ConvertedBody]
    refinements: Mapping[str, Refinement]
    errors: Array
    decisions: tuple[Decision, ...] = ()
    diagnostics: tuple[Diagnostic, ...] = ()
    unstiffened: frozenset[str] = frozenset()

    def sids(self, others: Mapping[str, SID]) -> dict[str, SID]:
        return {
            **others,
            **{name: body.sid for name, body in self.converted_bodies.items()},
        }

    def scene(self, scene: SceneFile) -> SceneFile:
        """Return the scene that names the converted SIDs."""
        bodies = dict(scene.bodies)
        for name, body in self.converted_bodies.items():
            text = body.file or f"(made of {bodies[name].model})"  # type: ignore[union-attr]
            bodies[name] = bodies[name].model_copy(update={"sid": text, "model": None})
        return scene.model_copy(update={"bodies": bodies})


def bodies_from_cache(
    sources: Mapping[str, BodyModel], refinements: Mapping[str, Refinement]
) -> RefinedBodies:
    """Return the bodies of an earlier search; their errors are not reported."""
    bodies = {name: source.sid(refinements[name]) for name, source in sources.items()}
    return RefinedBodies(bodies, refinements, np.zeros(0))


def refine_bodies(
    scene: SceneFile,
    sids: Mapping[str, SID],
    sources: Mapping[str, BodyModel],
    request: Request,
    compile_: Compile,
) -> RefinedBodies:
    """Refine the bodies of models one after the other.

    Raises
    ------
    InputError : a model cannot be converted, or not with the requested accuracy.
    """
    search = _Search(scene, sids, sources, request, compile_)
    with count_within(EqualStages(EXPECTED_CHANGES * len(sources))) as search.steps:
        for name in sources:
            search.refine_body(name)
    if sources and search.used_share(search.errors) > MAX_STIFFENING_EFFECT:
        cause = search.largest[1]
        helps = (
            "a larger error, models with finer meshes and more modes, or loads that "
            "do not begin at once, which moves all modes"
        )
        if cause in search.points:
            helps = f"{TIE.format(search.points[cause])}, or a larger error"
        raise refuse_accuracy(cause, helps)
    search.assess_stiffening()
    if search.others:
        listed = ", ".join(sorted(search.others))
        reason = "meshes and modes compared have other shape functions"
        search.found.append(diagnose("N615", listed, reason=reason))
    bodies = {
        name: search.converted_body(name, fine) for name, fine in search.state.items()
    }
    return RefinedBodies(
        bodies,
        search.state,
        search.errors,
        tuple(search.decisions),
        tuple(search.found),
        frozenset(search.stiffness),
    )


class _Search:
    """Successive refinement of the bodies that are given by models.

    state : refinement of each body
    """

    def __init__(
        self,
        scene: SceneFile,
        sids: Mapping[str, SID],
        sources: Mapping[str, BodyModel],
        request: Request,
        compile_: Compile,
    ) -> None:
        self.scene, self.sids, self.request = scene, sids, request
        self.sources, self.compile = sources, compile_
        self.steps = EqualStages(1)
        self.state = {name: Refinement() for name in sources}
        self.decisions: list[Decision] = []
        self.found: list[Diagnostic] = []
        self.errors: Array = np.zeros(len(request.names))
        #: Largest share of the allowed error, and its cause.
        self.largest = (0.0, "")
        #: (n,) True if the last changes by finer meshes hardly decreased.
        self.slow = np.zeros(len(request.names), dtype=bool)
        #: Markers at single points of continua, by the cause of the changes there.
        self.points: dict[str, str] = {}
        #: Elastic coordinates that are not comparable between meshes.
        self.others: set[str] = set()
        #: Relative change of stiffness by the missing geometric stiffening, by body.
        self.stiffness: dict[str, float] = {}
        self.reference: Reference | None = None
        self._converted_bodies: dict[tuple[str, Refinement], ConvertedBody] = {}
        self._runs: dict[tuple[Refinement, ...], Runs] = {}

    def converted_body(self, name: str, fineness: Refinement) -> ConvertedBody:
        key = name, fineness
        if key not in self._converted_bodies:
            self._converted_bodies[key] = self.sources[name].sid(fineness)
        return self._converted_bodies[key]

    def refine_body(self, name: str) -> None:
        """Choose the mesh and the modes of one body."""
        self.steps.next()
        if self.reference is None:
            self.reference = self._initial_reference()
            check_validity(self.reference.result)
        source = self.sources[name]
        refinement = self._more_modes(name, source, self._static_shapes(name))
        self.state[name] = self._finer_mesh(name, source, refinement)

    def assess_stiffening(self) -> None:
        """Compare models without geometric stiffening with those that have it.

        The SID of such a body does not describe what rotation does to it.

        Raises
        ------
        OutsideTheory : stiffening changes a stiffness considerably, and an output by a
            hundredth of its variation and more than is allowed.
        """
        stiffened = {
            name: Refinement(static=self._loaded_nodes(name)) for name in self.state
        }
        unstiffened = [n for n, s in self.sources.items() if s.model.stiffening is None]
        stiff = stiffened | {
            n: replace(stiffened[n], stiffened=True) for n in unstiffened
        }
        if not unstiffened or self.reference is None:
            return
        try:
            runs = [self._runs_of(state) for state in (stiffened, stiff)]
        except InputError:
            return
        runs_of_choice = [
            (choice, r.attempt(choice, self.reference.setting))
            for r in runs
            for choice in [finest_model(self.scene, r.sids)]
        ]
        change, result = runs[1].max_differences(*runs_of_choice), runs_of_choice[1][1]
        if result is None or not np.isfinite(change).all():
            return
        for name in unstiffened:
            body = result.bodies[name]
            self.stiffness[name] = (body.found or body.expected).ratio
        visible = np.maximum(
            self.reference.allowed, SIGNIFICANT_CHANGE * self.reference.variation
        )
        matters = bool((change > visible).any())
        largest = self.reference.largest_error(self.request.names, change)
        self.found += missing_stiffening_diagnostics(self.stiffness, largest, matters)

    def _initial_reference(self) -> Reference:
        """Return the reference with static shape functions for all loads.

        Outputs may be constant without them. If it does not run, the models are used as
        they are.
        """
        from sidtool.solver.system.errors import SimulationError

        refined = {
            name: Refinement(static=self._loaded_nodes(name)) for name in self.state
        }
        if refined != self.state:
            with suppress(InputError, SimulationError):
                return self._reference(refined)
        return self._reference(self.state)

    def _reference(self, state: Mapping[str, Refinement]) -> Reference:
        runs = self._runs_of(state)
        return make_reference(runs, finest_model(self.scene, runs.sids), self.request)

    def _loaded_nodes(self, name: str) -> tuple[int, ...]:
        """Return the loaded nodes for which static shape functions are possible. For a
        body that is loaded by its inertia only, these are all nodes with markers.
        """
        loaded = loaded_nodes(self.scene, name).values()
        nodes = tuple(sorted(int(node) for node in loaded if is_label(node)))
        if not nodes:
            markers = self.sources[name].model.markers.values()
            nodes = tuple(sorted(marker.node for marker in markers))
        return nodes if self.sources[name].can_have_static_shapes(nodes) else ()

    def _static_shapes(self, name: str) -> Refinement:
        """Add static shape functions for the loads of this scene if these matter."""
        nodes = self._loaded_nodes(name)
        if not nodes:
            return Refinement()
        change = self._change(name, Refinement(static=nodes))
        matters = self.used_share(change) > MESH_ERROR_SHARE
        if not matters:
            self.state[name] = Refinement()
        largest = self._largest_error(change)
        self.decisions.append(
            Decision(
                body=name,
                what="static shape functions",
                output=largest.name,
                effect=largest.error,
                allowed=largest.allowed,
                unit=largest.unit,
                kept=matters,
            )
        )
        if not matters:
            self._add_error(change, f"static shape functions of {name}")
        return self.state[name]

    def _more_modes(
        self, name: str, source: BodyModel, fineness: Refinement
    ) -> Refinement:
        if not source.modes:
            reason, what = "its reduction counts no modes", "missing shape functions"
            self.found.append(
                diagnose("N603", name, what=what, reason=reason, remedy="")
            )
            return fineness
        left, refinement = self._separate_step_errors(
            name, fineness, self._error_with_more_modes
        )
        values = self._largest_error(left).values()
        last = refinement.modes or source.modes
        self._add_error_of_step(
            diagnose("N613", name, first=source.modes, last=last, **values), left
        )
        return refinement

    def _error_with_more_modes(
        self, name: str, fineness: Refinement
    ) -> tuple[Array, Refinement]:
        """Return the remaining error (n,) with more modes, and their number.

        A coarse mesh has fewer than the search would compare.
        """
        own = self.sources[name].modes or 0
        most = max(MAX_MODES, 2 * own)
        for _ in range(MAX_DOUBLINGS):
            count = min(2 * (fineness.modes or own), most)
            try:
                self.converted_body(name, replace(fineness, modes=count))
            except TooManyModes as error:
                count = most = error.available
            fineness = replace(fineness, modes=count)
            left = self._change(name, fineness)
            if self.used_share(left) <= MESH_ERROR_SHARE or count == most:
                break
        return left, fineness

    def _finer_mesh(
        self, name: str, source: BodyModel, fineness: Refinement
    ) -> Refinement:
        if not source.can_refine():
            reason = "it comes from a file and cannot be refined"
            self.found.append(
                diagnose("N603", name, what="its mesh", reason=reason, remedy="")
            )
            return fineness
        left, refinement = self._separate_step_errors(
            name, fineness, self._error_with_finer_mesh
        )
        values = self._largest_error(left).values()
        count, too_large = refinement.level, self.used_share(left) > MESH_ERROR_SHARE
        if not (too_large and self.slow[self._worst_output(left)]):
            self._add_error_of_step(
                diagnose("N612", name, halvings=count, **values), left
            )
            return refinement
        points = source.point_markers(loaded_nodes(self.scene, name).values())
        remedy = "Use a finer mesh or other elements."
        if points:
            remedy = f"Tie {', '.join(points)} to an edge or face: point loads diverge."
        found = diagnose("N604", name, halvings=count, remedy=remedy, **values)
        if points:
            self.points[found.message_line] = f"{', '.join(points)} of {name}"
        self._add_error_of_step(found, left)
        return refinement

    def _error_with_finer_mesh(
        self, name: str, fineness: Refinement
    ) -> tuple[Array, Refinement]:
        """Return the remaining error (n,) with finer meshes, and the refinement."""
        changes: list[Array] = []
        for level in range(1, MAX_HALVINGS + 1):
            fineness = replace(fineness, level=level)
            changes.insert(0, self._change(name, fineness))
            left = np.asarray(mesh_error_estimate(changes))
            if self.used_share(left) <= MESH_ERROR_SHARE:
                break
        self.slow = convergence_ratios(*changes[:2]) == MAX_CONVERGENCE_RATIO
        return left, fineness

    def _separate_step_errors(
        self, name: str, fineness: Refinement, finer: Finer
    ) -> tuple[Array, Refinement]:
        """Repeat with tighter runs if the remaining changes may be integration
        errors.
        """
        left, refinement = finer(name, fineness)
        if self.used_share(left) <= MESH_ERROR_SHARE or not self._needs_tighter_runs():
            return left, refinement
        self.state[name] = fineness
        return finer(name, fineness)

    def _needs_tighter_runs(self) -> bool:
        """Return whether finer bodies need tighter runs, and use these from now on."""
        from sidtool.solver.system.errors import SimulationError

        assert self.reference is not None
        before = self.reference.setting.rtol
        with suppress(InputError, SimulationError):
            self.reference = self._reference(self.state)
        return self.reference.setting.rtol < before

    def _add_error_of_step(self, found: Diagnostic, left: Array) -> None:
        """Record a step of the search and its remaining errors (n,)."""
        self.found.append(found)
        self._add_error(left, found.message_line)

    def _add_error(self, left: Array, cause: str) -> None:
        """Add remaining errors (n,) and their cause."""
        self.errors += left
        self.largest = max(self.largest, (self.used_share(left), cause))

    def _change(self, name: str, fineness: Refinement) -> Array:
        """Return the changes (n,) by a finer body, which is used from then on."""
        assert self.reference is not None
        before, runs = self._runs_of(self.state), []
        self.steps.next()
        with count_within(EqualStages(3)) as parts:
            parts.next()
            self.state[name] = fineness
            after = self._runs_of(self.state)
            for runs_of_model in (before, after):
                parts.next()
                whole = finest_model(self.scene, runs_of_model.sids)
                runs.append(
                    (whole, runs_of_model.attempt(whole, self.reference.setting))
                )
        change = after.max_differences(*runs)
        for row, output in enumerate(self.request.names):
            if np.isfinite(change[row]) and is_incomparable(
                output, before.sids, after.sids
            ):
                self.others.add(output)
                change[row] = 0.0
        return change

    def used_share(self, errors: Array) -> float:
        assert self.reference is not None
        return self.reference.used_share(errors)

    def _worst_output(self, errors: Array) -> int:
        assert self.reference is not None
        return self.reference.worst_output(errors)

    def _largest_error(self, errors: Array) -> OutputError:
        """Return the error that uses the largest share of what is allowed."""
        assert self.reference is not None
        return self.reference.largest_error(self.request.names, errors)

    def _runs_of(self, state: Mapping[str, Refinement]) -> Runs:
        key = tuple(state.values())
        if key not in self._runs:
            refined_sids = {
                name: self.converted_body(name, fine).sid
                for name, fine in state.items()
            }
            sids = {**self.sids, **refined_sids}
            self._runs[key] = Runs(self.scene, sids, self.compile, self.request.names)
        return self._runs[key]
