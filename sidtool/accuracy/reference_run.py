"""Reference of the accuracy search: the finest model, tightly integrated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.result import OutputError, Result
from sidtool.formats.scene import SceneFile, unit_of

from ..measurement.candidates import Choice, is_out_of_plane, planar_scene
from ..measurement.points import MUCH, is_varying
from ..measurement.request import Request, refuse_accuracy
from ..measurement.runs import Runs, Setting, max_difference

#: Largest uncertainty of the reference relative to the allowed error.
UNCERTAINTY_SHARE = 0.05
#: Ratio of the comparison tolerance to the request; its largest and smallest value.
COMPARISON_RTOL_RATIO, MAX_COMPARISON_RTOL, MIN_COMPARISON_RTOL = 1e-2, 1e-4, 1e-11
#: Safety factor: the reference may have the same error as the looser run.
REFERENCE_SAFETY = 2.0
#: Effect of rounding on two tight runs of one motion, relative to the variation;
#: different methods, factorisations and processors share a part of it.
RUN_ROUNDING = 5e-12
#: Errors are assumed proportional to the tolerance. Target fraction of the required
#: error, for the reference and for compared models; limits of the change of tolerance.
AIMED_SHARE, AIMED_SHARE_OF_MODELS, MIN_RTOL_CHANGE, MAX_RTOL_CHANGE = (
    0.1,
    0.5,
    1e-5,
    0.2,
)
#: Fraction of the time span at whose output times both are compared with the tightest
#: run.
START_FRACTION = 1.0 / 16.0
#: Two methods whose difference estimates the error of each; the second one has this
#: fraction of the tolerance.
MEASURING_INTEGRATOR, CHECKING_INTEGRATOR, CHECKING_RTOL_RATIO = (
    "radau9",
    "radau13",
    0.1,
)


@dataclass(frozen=True, eq=False)
class Reference:
    """The finest model and its uncertainty.

    Attributes
    ----------
    choice : the finest model
    result : its run
    setting : integration of models that are compared with each other
    variation : (n,) range of each output
    allowed : (n,) requested errors, infinite if the output is only rounding
    uncertainty : (n,) twice the difference of the run by `MEASURING_INTEGRATOR` to the
        reference, and rounding
    comparison_uncertainty : (n,) the same for the looser run with `setting`
    left_out : outputs that are only rounding
    units : (n,) units of the outputs
    rounding : (n,) effect of rounding on each output, see `rounding_levels`
    meshes : (n,) errors by the meshes of bodies and by missing modes
    digits : (n,) errors by the printed digits of files
    frames : (n,) changes by other frames of bodies
    """

    choice: Choice
    result: Result
    setting: Setting
    variation: Array
    allowed: Array
    uncertainty: Array
    comparison_uncertainty: Array
    left_out: tuple[str, ...]
    units: tuple[str, ...]
    rounding: Array
    meshes: Array
    digits: Array
    frames: Array

    def worst_output(self, errors: Array) -> int:
        """Return the index of the output with the largest share of its allowed
        error.
        """
        shares = np.full(len(errors), -1.0)
        np.divide(errors, self.allowed, out=shares, where=np.isfinite(self.allowed))
        return int(shares.argmax())

    def largest_error(self, names: Sequence[str], errors: Array) -> OutputError:
        """Return the error with the largest share of what is allowed.

        Parameters
        ----------
        names, errors : (n,) outputs and their errors
        """
        row = self.worst_output(errors)
        return OutputError(
            name=names[row],
            unit=self.units[row],
            error=float(errors[row]),
            variation=float(self.variation[row]),
            allowed=float(self.allowed[row]),
        )

    def with_mesh_errors(self, errors: Array) -> Reference:
        """Return the reference with the errors (n,) by meshes and missing modes."""
        return replace(self, meshes=errors)

    @property
    def resolution(self) -> Array:
        """Return the differences (n,) of two models below which they are
        indistinguishable.
        """
        return np.maximum(self.uncertainty, self.comparison_uncertainty)

    @property
    def difference_uncertainty(self) -> Array:
        """Return the uncertainty (n,) of a difference to the reference."""
        return self.uncertainty + self.meshes + self.digits + self.frames

    def used_share(self, errors: Array) -> float:
        """Return the largest ratio of an error to the allowed error."""
        counts = np.isfinite(self.allowed)
        return float((errors[counts] / self.allowed[counts]).max())


def make_reference(runs: Runs, choice: Choice, request: Request) -> Reference:
    """Run the finest model as tightly as the request needs.

    Its uncertainty is twice the difference of two methods of different order, of which
    the tighter one is the reference, and the part of rounding that both may share.
    Both also step over initial oscillations that are too small for their tolerances;
    these are found in the first rows, integrated much more tightly.

    Raises
    ------
    InputError : an output cannot be predicted with the requested accuracy, or no output
        varies.
    SimulationError : the run stopped early.
    """
    first = rtol = initial_rtol(request)
    start = _tight_first_rows(runs, choice)
    while True:
        setting = Setting(MEASURING_INTEGRATOR, rtol)
        tighter = Setting(
            CHECKING_INTEGRATOR,
            max(CHECKING_RTOL_RATIO * rtol, 0.1 * MIN_COMPARISON_RTOL),
        )
        reference = reference_of_two_runs(runs, choice, request, setting, tighter)
        reference = _with_initial_error(runs, reference, start)
        use = reference.used_share(reference.uncertainty)
        if use <= UNCERTAINTY_SHARE:
            return _at_sufficient_tolerance(runs, reference, first)
        if rtol <= MIN_COMPARISON_RTOL:
            reference = _without_rounding(reference, request)
            if reference.used_share(reference.uncertainty) <= UNCERTAINTY_SHARE:
                return reference
            raise _is_unpredictable(request, reference)
        rtol = max(
            MIN_COMPARISON_RTOL,
            _next_tolerance(rtol, AIMED_SHARE * UNCERTAINTY_SHARE / use),
        )


def _without_rounding(reference: Reference, request: Request) -> Reference:
    """Drop relative requests for unpredictable outputs below the rounding of their
    terms.

    They remain if nothing else is requested.
    """
    absolute = np.array([t.absolute for t in request.tolerances.values()])
    rounding = reference.uncertainty > UNCERTAINTY_SHARE * reference.allowed
    rounding &= ~absolute & (reference.variation <= MUCH * reference.rounding)
    allowed = np.where(rounding, np.inf, reference.allowed)
    if not np.isfinite(allowed).any():
        return reference
    names = np.array(request.names)[rounding].tolist()
    return replace(reference, allowed=allowed, left_out=(*reference.left_out, *names))


def _next_tolerance(rtol: float, share: float) -> float:
    """Return a tolerance that changes the errors to about a share of the present
    ones.
    """
    return rtol * float(np.clip(share, MIN_RTOL_CHANGE, MAX_RTOL_CHANGE))


def _at_sufficient_tolerance(
    runs: Runs, reference: Reference, rtol: float
) -> Reference:
    """Return the reference with models compared at the loosest sufficient tolerance.

    That is the first tolerance, or the one that this reference needs. Outputs that are
    only rounding, as conserved momenta, are recognised at tight tolerances alone, and
    need none.
    """
    while rtol > reference.setting.rtol / MAX_RTOL_CHANGE:
        setting = Setting(MEASURING_INTEGRATOR, rtol)
        run = reference.choice, runs.tight_run(reference.choice, setting)
        blur = REFERENCE_SAFETY * runs.max_differences(
            run, (reference.choice, reference.result)
        )
        use = reference.used_share(blur)
        if use <= UNCERTAINTY_SHARE:
            return replace(reference, setting=setting, comparison_uncertainty=blur)
        rtol = _next_tolerance(rtol, AIMED_SHARE_OF_MODELS * UNCERTAINTY_SHARE / use)
    return reference


def _tight_first_rows(runs: Runs, choice: Choice) -> tuple[Array, Array] | None:
    """Return times and outputs of the first rows from a very tight run, or None."""
    time = runs.scene.time
    if time.output_step is None:
        return None
    rows = np.ceil(START_FRACTION * (time.end - time.start) / time.output_step)
    part = runs.shortened_to(min(time.end, float(time.start + rows * time.output_step)))
    result = part.attempt(choice, Setting(CHECKING_INTEGRATOR, MIN_COMPARISON_RTOL))
    return None if result is None else (result.t, part.columns(choice, result))


def _with_initial_error(
    runs: Runs, reference: Reference, start: tuple[Array, Array] | None
) -> Reference:
    """Return the reference with twice its error in the first rows."""
    if start is None:
        return reference
    count, result = len(start[0]), reference.result
    columns = runs.columns(reference.choice, result)
    errors = max_difference(start, (result.t[:count], columns[:count]))
    errors = np.where(np.isfinite(errors), REFERENCE_SAFETY * errors, 0.0)
    return replace(reference, uncertainty=np.maximum(reference.uncertainty, errors))


def reference_of_two_runs(
    runs: Runs, choice: Choice, request: Request, setting: Setting, tighter: Setting
) -> Reference:
    """Return the tighter of two runs as the reference.

    Raises
    ------
    InputError : no output moves.
    SimulationError : a run stopped early.
    """
    coarse, fine = runs.tight_run(choice, setting), runs.tight_run(choice, tighter)
    reference = reference_of_one_run(runs, choice, request, tighter)
    between = REFERENCE_SAFETY * runs.max_differences((choice, coarse), (choice, fine))
    return replace(
        reference, setting=setting, uncertainty=between + reference.uncertainty
    )


def reference_of_one_run(
    runs: Runs, choice: Choice, request: Request, setting: Setting
) -> Reference:
    """Return a run as the reference; its uncertainty is rounding only so far.

    Raises
    ------
    InputError : no output moves.
    SimulationError : the run stopped early.
    """
    result = runs.tight_run(choice, setting)
    values = runs.columns(choice, result)
    variation = np.ptp(values, axis=0)
    rounding = runs.rounding(choice, result)
    moving = is_varying(request.names, values, variation, rounding)
    largest = np.abs(values).max(axis=0)
    moving &= ~out_of_plane_zeros(runs.scene, request.names, largest, rounding)
    absolute = np.array([t.absolute for t in request.tolerances.values()])
    judged = moving | absolute
    if not judged.any():
        raise refuse_accuracy(
            "no output varies by more than rounding", "outputs that move"
        )
    nothing = np.zeros(len(request.names))
    return Reference(
        choice=choice,
        result=result,
        setting=setting,
        variation=variation,
        allowed=np.where(judged, request.allowed(variation), np.inf),
        uncertainty=RUN_ROUNDING * variation,
        comparison_uncertainty=nothing,
        left_out=tuple(np.array(request.names)[~judged].tolist()),
        units=tuple(unit_of(name, runs.scene) for name in request.names),
        rounding=rounding,
        meshes=nothing,
        digits=nothing,
        frames=nothing,
    )


def out_of_plane_zeros(
    scene: SceneFile, names: tuple[str, ...], largest: Array, rounding: Array
) -> NDArray[np.bool_]:
    """Return a mask (n,) of out-of-plane outputs that are zero except for rounding.

    largest, rounding : (n,) largest absolute values, and effect of rounding
    """
    if scene.dimension == "planar" or planar_scene(scene) is None:
        return np.zeros(len(names), dtype=bool)
    return np.array([*map(is_out_of_plane, names)]) & (largest <= MUCH * rounding)


def initial_rtol(request: Request) -> float:
    """Return the first tolerance to try, from the requested errors."""
    relative = [t.value for t in request.tolerances.values() if not t.absolute]
    wanted = min(relative, default=1.0)
    return float(
        np.clip(
            COMPARISON_RTOL_RATIO * wanted, MIN_COMPARISON_RTOL, MAX_COMPARISON_RTOL
        )
    )


def _is_unpredictable(request: Request, reference: Reference) -> InputError:
    worst = int((reference.uncertainty / reference.allowed).argmax())
    name, off = request.names[worst], reference.uncertainty[worst]
    return refuse_accuracy(
        f"two integrators at rtol {MIN_COMPARISON_RTOL:.0e} differ by {off:.1e} in "
        f"{name}, {reference.allowed[worst]:.1e} allowed",
        "a larger error, a shorter time span, or other outputs",
    )
