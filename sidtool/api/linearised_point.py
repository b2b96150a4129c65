"""Derivatives of a point from its linearised run, direct or adjoint.

No neighbour is integrated. What a variable changes at fixed states comes from two
neighbouring systems, see `solver.simulation.motion_derivatives`.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.solver.simulation.frozen_run import Motion, StructureChange, run_on_grid
from sidtool.solver.simulation.linearised_run import LinearisedRun, NotLinearisable
from sidtool.solver.simulation.motion_derivatives import (
    SAFETY,
    AdjointGradient,
    MotionDerivatives,
    ParameterChange,
)
from sidtool.solver.simulation.sid_gradient import sid_gradient
from sidtool.solver.system.errors import SimulationError
from sidtool.solver.system.system import System

from ..sensitivity.differences import Difference
from ..sensitivity.functionals import Term
from ..sensitivity.history import History
from ..sensitivity.seeds import LinearFunctional, functional_seeds, linear_functional

ADJOINT, DIRECT, DIFFERENCES, AUTO = "adjoint", "direct", "differences", "auto"
METHODS = (AUTO, ADJOINT, DIRECT, DIFFERENCES)
#: Step of a variable, relative to its size.
STEP = 1e-5
#: Variables whose columns are solved together, and numbers of these.
COLUMNS, COLUMN_NUMBERS = 32, 20_000_000
#: Cost of a linearisation in runs: of a few coordinates in the plane; coordinates that
#: cost one run more by their square, points of differences by all coordinates that need
#: some, and all coordinates in space.
LINEARISATION_RUNS = 3.0
COORDINATES_SQUARED, POINTS_PER_RUN, SPATIAL_PER_RUN = 60.0, 13.0, 30.0
#: Variables per functional from which the adjoint method is cheaper, for functionals of
#: so few times.
ADJOINT_VARIABLES, ADJOINT_TIMES = 4, 20
#: Relative errors of derivatives with derivatives of the equations of motion that are
#: exact, or in part by differences; the second grows along the motion, and was at most
#: 4e-7 on a robot arm (2 s, 850 steps).
EXACT_ERROR, DIFFERENCE_ERROR = 1e-10, 4e-7
#: Numbers of models from which gradients by SIDs are cheaper, and how well derivatives
#: along all of them agree in both ways.
SID_VARIABLES, AGREEMENT = 3, 1e-8
#: A variable has no derivative about the run, or none at all.
Failure: TypeAlias = StructureChange | InputError | SimulationError


class SidDerivative(NamedTuple):
    """Derivative of the SID of a body by a variable: a factor times a SID."""

    body: str
    sid: SID
    factor: float


class Point(Protocol):
    """What is needed of a point, see `motion_problem.Point`."""

    history: Any
    grid: Any
    terms: Sequence[Term]
    x: Array
    all_values: Array
    scales: Array
    sizes: tuple[int, ...]

    def size(self, k: int) -> float: ...

    def neighbour_along(self, direction: Array, step: float) -> System: ...

    def model_derivatives(self, k: int) -> Sequence[SidDerivative]: ...

    def without_motion(self) -> Any: ...


def combined(
    parts: Sequence[Difference | Failure], factors: Array
) -> list[Difference | Failure]:
    """Derivatives by variables that change several numbers, or why one has none.

    Parameters
    ----------
    factors : (variables, numbers) derivatives of the numbers by the variables
    """
    good = [k for k, one in enumerate(parts) if isinstance(one, Difference)]
    if not good:
        return [parts[int(np.argmax(row != 0.0))] for row in factors]
    known = [one for one in parts if isinstance(one, Difference)]
    by_numbers = np.array([one.derivatives for one in known])
    errors = np.abs(factors[:, good]) @ np.array([one.errors for one in known])
    found: list[Difference | Failure] = [
        Difference(row, error, 0, known[0].step, known[0].method)
        for row, error in zip(factors[:, good] @ by_numbers, errors, strict=True)
    ]
    for k, one in enumerate(parts):
        if not isinstance(one, Difference):
            for row in np.flatnonzero(factors[:, k]).tolist():
                found[row] = one
    return found


class LinearisedPoint:
    """The linearised run of a point.

    Attributes
    ----------
    method : adjoint or direct

    Raises
    ------
    NotLinearisable : the run has something that is not linearised.
    """

    def __init__(self, point: Point, method: str) -> None:
        assert point.history is not None and point.grid is not None
        self._point = point
        self._history, motion = point.history, point.history.motion
        run = LinearisedRun(motion, point.grid)
        if len(run.directions):
            # Newton's matrix lacks terms: its iteration is slow, and what it leaves
            # of the tolerance is more than derivatives bear.
            motion = run_on_grid(motion.system, point.grid)
            run, self._history = LinearisedRun(motion, point.grid), History(motion)
        self._motion = MotionDerivatives(run)
        self._error = DIFFERENCE_ERROR if len(run.directions) else EXACT_ERROR
        self._terms = [t for t in point.terms if t.functional.needs_motion]
        #: which of all values are those of the motion
        needs = [t.functional.needs_motion for t in point.terms]
        self._is_motion = np.repeat(needs, point.sizes)
        values = [t.value(run.system, self._history) for t in self._terms]
        self._values = np.concatenate(values)
        self._scales = point.scales[self._is_motion]
        problems = {
            "functionals of several values": any(
                not t.functional.is_scalar for t in self._terms
            ),
            "the adjoint of a run that an event ends": motion.cut is not None,
        }
        reasons = [reason for reason, is_there in problems.items() if is_there]
        if method == ADJOINT and reasons:
            raise NotLinearisable(reasons[0])
        if method == AUTO:
            method = self._choose(run, bool(reasons), len(point.x))
        self.method = method
        numbers = len(run.motion.steps.t) * (run.nz + run.nv)
        self._columns = max(1, min(COLUMNS, COLUMN_NUMBERS // numbers))

    def _choose(self, run: LinearisedRun, needs_direct: bool, count: int) -> str:
        """The cheaper method for so many variables.

        Raises
        ------
        NotLinearisable : differences of runs are cheaper.
        """
        size = run.nz + run.nv
        runs = LINEARISATION_RUNS + (size / COORDINATES_SQUARED) ** 2
        runs += len(run.directions) * len(run.difference[0]) / POINTS_PER_RUN
        if not run.system.planar:
            runs += size / SPATIAL_PER_RUN
        if runs + count / 2 > 6 + 4 * count:
            raise NotLinearisable(f"{size} coordinates for few variables")
        if needs_direct or count < ADJOINT_VARIABLES * len(self._terms):
            return DIRECT
        times = [one.times for one in self._linear if one is not None]
        few = all(t is not None and len(t) <= ADJOINT_TIMES for t in times)
        return ADJOINT if few else DIRECT

    def differences(self, numbers: Sequence[int]) -> list[Difference | Failure]:
        """Derivatives of all terms by some variables, or why one has none about the
        run.
        """
        found: dict[int, Difference | Failure] = {**self._through_sids(numbers)}
        others = [k for k in numbers if k not in found]
        for first in range(0, len(others), self._columns):
            group = others[first : first + self._columns]
            changes = [self._change_by(k) for k in group]
            good = [c for c in changes if isinstance(c, ParameterChange)]
            rows = iter(self._derivatives(good) if good else ())
            for k, change in zip(group, changes, strict=True):
                if isinstance(change, ParameterChange):
                    found[k] = next(rows)
                else:
                    found[k] = change
        return [
            self._with_other_terms(k, one) if isinstance(one, Difference) else one
            for k, one in ((k, found[k]) for k in numbers)
        ]

    def _change_by(self, k: int) -> ParameterChange | Failure:
        """What a variable changes at fixed states."""
        direction = np.zeros(len(self._point.x))
        direction[k] = 1.0
        return self._change(direction, self._point.size(k))

    def _change(self, direction: Array, size: float) -> ParameterChange | Failure:
        """What variables change at fixed states along a direction, per unit of it."""
        step, point = STEP * size, self._point
        try:
            above, below = (point.neighbour_along(direction, e) for e in (step, -step))
            return self._motion.parameter_change((above, below), step, size)
        except (StructureChange, InputError, SimulationError) as why:
            return why

    def _through_sids(self, numbers: Sequence[int]) -> dict[int, Difference]:
        """Derivatives by numbers of models, from the gradients by all numbers of SIDs.

        None where these are few, or where they change the start or a functional at
        fixed states as well, which the derivative along all of them together shows.
        """
        parts = {k: self._point.model_derivatives(k) for k in numbers}
        parts = {k: found for k, found in parts.items() if found}
        if self.method != ADJOINT or len(parts) < SID_VARIABLES:
            return {}
        bodies = dict.fromkeys(one.body for found in parts.values() for one in found)
        try:
            gradients = {
                b: sid_gradient(self._motion, self._gradient, b) for b in bodies
            }
        except NotLinearisable:
            return {}
        known = {
            k: sum(
                (one.factor * gradients[one.body].along(one.sid) for one in found),
                np.zeros(len(self._values)),
            )
            for k, found in parts.items()
        }
        weights = np.random.default_rng(0).choice([-1.0, 1.0], len(self._point.x))
        direction = np.zeros(len(weights))
        for k in parts:
            direction[k] = weights[k] * self._point.size(k)
        change = self._change(direction, 1.0)
        if not isinstance(change, ParameterChange):
            return {}
        (whole,) = self._derivatives([change])
        if not isinstance(whole, Difference):
            return {}
        terms = np.array([direction[k] * known[k] for k in parts])
        size = np.maximum(np.abs(terms).sum(axis=0), np.finfo(float).tiny)
        difference = np.abs(terms.sum(axis=0) - whole.derivatives)
        if (difference > AGREEMENT * size + whole.errors).any():
            return {}
        share = self._error + difference / size
        return {
            k: Difference(one, share * np.abs(one), 0, 0.0, self.method)
            for k, one in known.items()
        }

    def _derivatives(
        self, changes: Sequence[ParameterChange]
    ) -> list[Difference | Failure]:
        """Derivatives of the terms of the motion."""
        none = np.zeros(len(self._values))
        if self.method == ADJOINT:
            through = [self._gradient.along(change) for change in changes]
            return [
                self._difference(change, 0.0, 0.0, row)
                for change, row in zip(changes, through, strict=True)
            ]
        z, v = self._motion.direct(changes)
        return [
            self._difference(change, z[:, :, k], v[:, :, k], none)
            for k, change in enumerate(changes)
        ]

    def _difference(
        self,
        change: ParameterChange,
        z: Array | float,
        v: Array | float,
        through: Array,
    ) -> Difference | Failure:
        """Derivatives by one variable.

        Parameters
        ----------
        z, v : derivatives of the states in the direct way, 0 in the adjoint way
        through : derivatives through the states in the adjoint way
        """
        try:
            motions = self._motion.neighbours(change, z, v)
            above, middle, below = self._values_about(change, motions)
        except (StructureChange, InputError, SimulationError) as why:
            return why
        step, size = change.step, change.step / STEP
        derivatives = (above - below) / (2.0 * step) + through
        second = np.abs(above - 2.0 * middle + below) / (2.0 * step)
        rounding = 4.0 * np.finfo(float).eps * self._scales / step
        share = self._error + change.relative_error
        errors = SAFETY * second * step / size + rounding + share * np.abs(derivatives)
        return Difference(derivatives, errors, 0, step, self.method)

    def _values_about(
        self, change: ParameterChange, motions: Sequence[Motion]
    ) -> tuple[Array, Array, Array]:
        """Values of the terms of one neighbour, of the run, and of the other one.

        Where times do not move, functionals are linear in their output: a peak need
        not be sought again.
        """
        ends = self._history.motion.cut is not None
        moves = ends or bool(change.stretch.any())
        middle = self._values if moves else self._linear_values
        above, below = (
            np.concatenate(
                [
                    term.value(motion.system, History(motion))
                    if moves or linear is None
                    else np.array([linear.value(motion)])
                    for term, linear in zip(self._terms, self._linear, strict=True)
                ]
            )
            for motion in motions
        )
        return above, middle, below

    @cached_property
    def _linear(self) -> list[LinearFunctional | None]:
        """Terms about the run as linear functionals of their outputs."""
        return [
            linear_functional(term.functional, self._history, term.peak)
            for term in self._terms
        ]

    @cached_property
    def _linear_values(self) -> Array:
        """Values of the terms, and of linear functionals."""
        motion = self._history.motion
        found = [
            term.value(motion.system, self._history)
            if linear is None
            else np.array([linear.value(motion)])
            for term, linear in zip(self._terms, self._linear, strict=True)
        ]
        return np.concatenate(found)

    @cached_property
    def _gradient(self) -> AdjointGradient:
        """Gradients of the terms of the motion."""
        run = self._motion.run
        seeds = [
            functional_seeds(linear, self._history, run.coordinate_steps, run.nz)
            for linear in self._linear
        ]
        return self._motion.adjoint(np.stack(seeds, axis=2))

    def _with_other_terms(self, k: int, found: Difference) -> Difference:
        """With the terms that need no motion, by differences of systems where they
        need more than SIDs."""
        if self._is_motion.all():
            return found
        others = self._point.without_motion()
        of_models = self._point.model_derivatives(k)
        known = [term.functional.by_sids(of_models) for term in others.terms]
        if of_models and None not in known:
            values: Array = np.array(known, float)
            errors: Array = EXACT_ERROR * np.abs(values)
            other = replace(found, derivatives=values, errors=errors)
        else:
            try:
                other = others.difference(k)
            except (StructureChange, InputError, SimulationError):
                nan = np.full(int((~self._is_motion).sum()), np.nan)
                other = replace(found, derivatives=nan, errors=nan)
        parts = []
        for own, given in (
            (found.derivatives, other.derivatives),
            (found.errors, other.errors),
        ):
            joined = np.zeros(len(self._is_motion))
            joined[self._is_motion], joined[~self._is_motion] = own, given
            parts.append(joined)
        return replace(found, derivatives=parts[0], errors=parts[1])
