"""Search for the fastest model and integration that keep a request.

Shape functions and terms may use `MODEL_SHARE` of the allowed error, integration the
rest up to `FULL_SHARE`. Every selected model has been run and compared with the
reference.

Integrator and tolerance of a model: the fastest whose measured error is allowed.
"""

from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import expand_names, unit_of

from ..measurement.candidates import (
    FLEXIBILITY,
    IN_PLANE,
    QUADRATIC,
    SHAPES,
    SPACE,
    STIFFENING,
    Candidate,
    Choice,
    bodies_with_stiffening,
    is_out_of_plane,
    planar_scene,
    shape_function_candidates as shapes_of,
)
from ..measurement.request import refuse_accuracy
from ..measurement.runs import Runs, Setting
from .reference_run import Reference

#: The loosest and tightest tolerances that are tried.
LOOSEST_RTOL, TIGHTEST_RTOL = 0.1, 1e-12
#: A run that uses at least this share of the allowed error is not loosened further.
SUFFICIENT_SHARE = 0.4
#: Largest number of runs of one integrator.
MAX_RUNS = 7
#: Smallest ratio to the next tolerance; errors above this fraction of the previous ones
#: do not decrease with the tolerance.
MIN_RTOL_RATIO, STAGNATION_RATIO = 1e-2, 0.98
#: Minimum fraction of time that another integrator than the default must save.
MIN_SAVING = 0.1
DEFAULT_INTEGRATOR, EXPLICIT_INTEGRATOR = "radau9", "auto"
#: Requests from which on integrators of lower and of higher order are tried as well.
LOW_ORDER, HIGH_ORDER = ("radau5", 1e-5), ("radau13", 1e-4)

#: Shares of the allowed error: for the plane, for rigid bodies, with groups of shape
#: functions, with single ones, with terms, with integration.
PLANE_SHARE, RIGID_SHARE, GROUP_SHARE, SHAPE_SHARE, MODEL_SHARE, FULL_SHARE = (
    0.05,
    0.2,
    0.25,
    0.4,
    0.5,
    0.95,
)
#: Shape functions of one body that are tested one by one; of more, those of least
#: elastic energy are omitted in groups first.
MAX_SINGLE_SHAPES = 10
#: Factor on differences that are reported as errors.
ERROR_SAFETY = 1.01
#: A term is omitted if its omission alone uses at most this share.
TERM_SHARE = 0.1
#: Shape functions that are tested one by one after the first that must remain.
MAX_LATER_TRIALS = 6


@dataclass(frozen=True, eq=False)
class AcceptedRun:
    """A run that meets the request.

    Attributes
    ----------
    errors : (n,) differences to the reference
    """

    setting: Setting
    errors: Array
    seconds: float


def fastest_setting(
    runs: Runs, reference: Reference, choice: Choice, share: float
) -> AcceptedRun | None:
    """Return the fastest run that uses at most a share of the allowed error."""
    integrators = _integrators(reference, choice)
    settings = [
        largest_sufficient_tolerance(runs, reference, choice, name, share)
        for name in integrators
    ]
    fit = [setting for setting in settings if setting is not None]
    seconds = runs.cost if len(fit) > 1 else runs.seconds
    accepted = [
        AcceptedRun(s, _errors(runs, reference, choice, s), seconds(choice, s))
        for s in fit
    ]
    default = next(
        (f for f in accepted if f.setting.integrator == DEFAULT_INTEGRATOR), None
    )
    best = min(accepted, key=lambda f: f.seconds, default=None)
    if best is None or default is None:
        return best
    return best if best.seconds < (1.0 - MIN_SAVING) * default.seconds else default


def largest_sufficient_tolerance(
    runs: Runs, reference: Reference, choice: Choice, integrator: str, share: float
) -> Setting | None:
    """Return the largest tolerance found that uses at most a share of the allowed
    error.

    For the next guess the error is assumed to be proportional to the tolerance. Between
    a sufficient and an insufficient tolerance the geometric mean is tried. Errors that
    do not decrease, for example of oscillations below the tolerance, need much smaller
    tolerances.
    """
    target = share - reference.used_share(reference.difference_uncertainty)
    fits, fails, last = 0.0, np.inf, np.inf
    rtol = float(np.clip(_tightest_request(reference), TIGHTEST_RTOL, LOOSEST_RTOL))
    for _ in range(MAX_RUNS):
        setting = Setting(integrator, rtol)
        use = reference.used_share(_errors(runs, reference, choice, setting))
        if use <= target:
            fits = rtol
            if use >= SUFFICIENT_SHARE * share or rtol >= LOOSEST_RTOL:
                break
        else:
            fails = rtol
            if rtol <= TIGHTEST_RTOL:
                break
        guess = rtol * float(
            np.clip(0.7 * target / max(use, 1e-12), MIN_RTOL_RATIO, 30.0)
        )
        if not fits and use > STAGNATION_RATIO * last:
            guess = MIN_RTOL_RATIO * rtol
        last = use
        if fits and np.isfinite(fails):
            if fails < 2.0 * fits:
                break
            guess = float(np.sqrt(fits * fails))
        rtol = float(np.clip(guess, TIGHTEST_RTOL, LOOSEST_RTOL))
    return Setting(integrator, fits) if fits else None


def _errors(
    runs: Runs, reference: Reference, choice: Choice, setting: Setting
) -> Array:
    result = runs.attempt(choice, setting)
    return runs.max_differences((choice, result), (reference.choice, reference.result))


def _integrators(reference: Reference, choice: Choice) -> list[str]:
    """Return the default integrator, and those whose order suits the request."""
    wanted, integrators = _tightest_request(reference), [DEFAULT_INTEGRATOR]
    if wanted >= LOW_ORDER[1]:
        integrators.append(LOW_ORDER[0])
    if wanted <= HIGH_ORDER[1]:
        integrators.append(HIGH_ORDER[0])
    if not any(kept for _, kept in choice.kept):
        integrators.append(EXPLICIT_INTEGRATOR)
    return integrators


def _tightest_request(reference: Reference) -> float:
    """Return the smallest requested error relative to the variation of an output."""
    with np.errstate(divide="ignore"):
        parts = reference.allowed / reference.variation
    return float(np.clip(parts.min(), TIGHTEST_RTOL, 1.0))


@dataclass(frozen=True, eq=False)
class MeasuredReduction:
    """Errors (n,) caused by one simplification of the finest model."""

    candidate: Candidate
    errors: Array


@dataclass(frozen=True, eq=False)
class SelectedModel:
    """The selected model and its integration.

    Attributes
    ----------
    measured : all simplifications that were measured
    errors : (n,) errors of the selected run, with the uncertainty of the reference
    """

    choice: Choice
    accepted_run: AcceptedRun
    measured: tuple[MeasuredReduction, ...]
    errors: Array


def select_model(runs: Runs, reference: Reference) -> SelectedModel:
    """Simplify the model as far as the request allows, then loosen the integration.

    Raises
    ------
    InputError : no model and no integration keeps the request.
    """
    search = _Search(runs, reference)
    runs.begin("plane")
    search.plane()
    runs.begin("rigid bodies")
    choice = search.rigid_bodies(search.base)
    runs.begin("shape functions")
    choice = search.fewer_shapes(choice)
    runs.begin("terms")
    choice = search.fewer_terms(choice)
    runs.begin("integration")
    accepted = fastest_setting(runs, reference, choice, FULL_SHARE)
    if accepted is None:
        choice = reference.choice
        accepted = fastest_setting(runs, reference, choice, FULL_SHARE)
    if accepted is None:
        raise refuse_accuracy("no integrator keeps it", "a larger error")
    errors = estimate_errors(accepted.errors, reference)
    return SelectedModel(choice, accepted, tuple(search.measured), errors)


def estimate_errors(errors: Array, reference: Reference) -> Array:
    """Return estimated errors (n,) from differences to the reference."""
    return ERROR_SAFETY * errors + reference.difference_uncertainty


class _Search:
    """Comparison of models at one tight tolerance.

    base : the full model, reduced to the plane if possible
    """

    def __init__(self, runs: Runs, reference: Reference) -> None:
        self.runs, self.reference = runs, reference
        self.base = reference.choice
        self.measured: list[MeasuredReduction] = []

    def plane(self) -> None:
        """Reduce a spatial scene to the plane if nothing leaves it."""
        scene, candidate = self.runs.scene, Candidate("", SPACE)
        if (
            scene.dimension == "planar"
            or planar_scene(scene) is None
            or self._leaves_plane()
        ):
            return
        if self.share_of_candidate(candidate) <= PLANE_SHARE:
            self.base = self.base.without(candidate)

    def _leaves_plane(self) -> bool:
        """Return whether an out-of-plane output is larger than allowed."""
        result, names = self.reference.result, self.runs.names
        scene, sids = self.runs.scene, self.runs.sids
        recorded = expand_names(scene.outputs.record, scene, sids, "outputs.record")
        if any(map(is_out_of_plane, set(recorded) - set(names))):
            return True
        columns = self.runs.columns(self.reference.choice, result)
        sizes = dict(zip(names, np.abs(columns).max(axis=0), strict=True))
        kinds: dict[str, float] = {}
        for name, size in sizes.items():
            unit = unit_of(name, scene)
            kinds[unit] = max(kinds.get(unit, 0.0), size)
        return any(
            size > IN_PLANE * kinds[unit_of(name, scene)]
            for name, size in sizes.items()
            if is_out_of_plane(name) and name not in self.reference.left_out
        )

    def used_share(self, choice: Choice) -> float:
        """Return the share of the allowed error that a model uses."""
        finest, setting = self.reference.choice, self.reference.setting
        return self.reference.used_share(self.runs.difference(finest, choice, setting))

    def share_of_candidate(
        self, candidate: Candidate, of: Choice | None = None
    ) -> float:
        """Return the share of the allowed error that one simplification uses alone.

        The result is stored in `measured`.

        Parameters
        ----------
        of : model that is simplified, default the finest one
        """
        whole = of or self.base
        less = whole.without(candidate)
        errors = self._missing_output_errors(whole, less)
        if self.reference.used_share(errors) <= MODEL_SHARE:
            errors = self.runs.difference(whole, less, self.reference.setting)
        self.measured.append(MeasuredReduction(candidate, errors))
        return self.reference.used_share(errors)

    def _missing_output_errors(self, whole: Choice, less: Choice) -> Array:
        """Return errors (n,) of outputs that a model does not have; they are zero
        there, so no run is needed.
        """
        names, result = (
            self.runs.names,
            self.runs.attempt(whole, self.reference.setting),
        )
        if result is None or all(map(less.has_output, names)):
            return np.zeros(len(names))
        sizes = np.abs(self.runs.columns(whole, result)).max(axis=0)
        return np.where([*map(less.has_output, names)], 0.0, sizes)

    def rigid_bodies(self, choice: Choice) -> Choice:
        """Make bodies rigid, those with the smallest error first."""
        bodies = [Candidate(n, FLEXIBILITY) for n, kept in choice.kept if kept]
        return self._without_together(choice, bodies, RIGID_SHARE, RIGID_SHARE)

    def fewer_shapes(self, choice: Choice) -> Choice:
        """Omit shape functions of the other bodies, those with the smallest error
        first.
        """
        whole, choice = choice, self._without_groups(choice)
        base = None if choice == whole else choice
        costs = {c: self.share_of_candidate(c, base) for c in shapes_of(choice)}
        order = sorted(
            (c for c in costs if costs[c] <= SHAPE_SHARE), key=costs.__getitem__
        )
        sums = accumulate((costs[c] for c in order), initial=self.used_share(choice))
        guess = sum(total <= SHAPE_SHARE for total in sums) - 1
        count = self._largest_removable_group(choice, order, max(guess, 0))
        choice = choice.without(*order[:count])
        for candidate in order[count + 1 : count + 1 + MAX_LATER_TRIALS]:
            less = choice.without(candidate)
            choice = less if self.used_share(less) <= SHAPE_SHARE else choice
        return choice

    def _without_groups(self, choice: Choice) -> Choice:
        """Omit groups of shape functions with little elastic energy."""
        for name, kept in choice.kept:
            waiting = self._by_energy(name, kept)
            count = len(waiting) // 2
            while len(waiting) > MAX_SINGLE_SHAPES and count > 1:
                numbers = tuple(sorted(waiting[:count]))
                group = Candidate(name, SHAPES, numbers=numbers)
                less = choice.without(group)
                if self.used_share(less) > GROUP_SHARE:
                    count //= 2
                    continue
                self.share_of_candidate(group, choice)
                choice, waiting = less, waiting[count:]
                count = len(waiting) // 2
        return choice

    def _by_energy(self, name: str, numbers: tuple[int, ...]) -> list[int]:
        """Return shape functions ordered by their elastic energy, smallest first."""
        shares = self.reference.result.bodies[name].energy_shares if numbers else ()
        order = (
            sorted(zip(shares, numbers, strict=True))
            if len(numbers) > MAX_SINGLE_SHAPES
            else []
        )
        return [number for _, number in order]

    def _largest_removable_group(
        self, choice: Choice, order: list[Candidate], guess: int
    ) -> int:
        """Return how many of the first candidates can be omitted together, from a first
        guess.
        """
        fits, fails = 0, len(order) + 1
        count = guess
        while fails - fits > 1:
            if not 0 < count < fails:
                count = (fits + fails) // 2
            if self.used_share(choice.without(*order[:count])) <= SHAPE_SHARE:
                fits, count = count, count + 1
            else:
                fails, count = count, count - 1
            if not fits < count < fails:
                count = (fits + fails) // 2
        return fits

    def fewer_terms(self, choice: Choice) -> Choice:
        """Omit terms of the bodies that remain flexible."""
        flexible = [n for n, kept in choice.kept if kept]
        terms_of = bodies_with_stiffening(self.runs.scene, self.runs.sids, choice.flat)
        terms = [Candidate(n, STIFFENING) for n in flexible if terms_of.get(n)]
        choice = self._without_together(choice, terms, TERM_SHARE, MODEL_SHARE)
        without_terms = [
            n for n in flexible if n not in terms_of or n in choice.unstiffened
        ]
        squares = [
            Candidate(n, QUADRATIC) for n in without_terms if n in choice.quadratic
        ]
        return self._without_together(choice, squares, TERM_SHARE, MODEL_SHARE)

    def _without_together(
        self, choice: Choice, candidates: list[Candidate], single: float, whole: float
    ) -> Choice:
        """Omit candidates that use at most `single` alone and at most `whole`
        together.
        """
        costs = {c: self.share_of_candidate(c) for c in candidates}
        for candidate in sorted(costs, key=costs.__getitem__):
            if costs[candidate] > single:
                break
            less = choice.without(candidate)
            if self.used_share(less) <= whole:
                choice = less
        return choice
