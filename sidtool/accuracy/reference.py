"""The motion that errors are measured against: every choice at its finest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, unit_of
from sidtool.formats.sid import Array

from ..study import moves
from ..study.reference import MUCH
from .candidates import Choice
from .flat import in_plane, is_across
from .runs import Runs, Setting, apart
from .wanted import Request

#: The uncertainty of the reference is at most this part of what is allowed.
PART = 0.05
#: Of the request, the tolerance at which models are compared; at most and at least.
SHARPER, LOOSEST, TIGHTEST = 1e-2, 1e-4, 1e-11
#: The reference may be as far off as the looser run.
SAFETY = 2.0
#: Of the variation: what rounding alone does between two tight runs of one motion,
#: which different methods, factorisations and processors share in part.
ROUNDING = 5e-12
#: Errors are taken to fall like the tolerance: to this part of what is needed, for the
#: reference and for models that are compared; by how much it changes at most and least.
AIM, AIM_OF_MODELS, MOST, LEAST = 0.1, 0.5, 1e-5, 0.2
#: The part of the time at whose rows both are compared with a run as tight as can be.
START = 1.0 / 16.0
#: Two methods tell how far each is right; the second one is asked for this more.
MEASURING, CHECKING, MORE = "radau9", "radau13", 0.1


@dataclass(frozen=True, eq=False)
class Reference:
    """The finest model, and what may differ from it.

    Attributes
    ----------
    choice : the finest model
    result : its run
    setting : how models are integrated to be compared with each other
    variation : (n,) greatest less least value of each output
    allowed : (n,) errors that are asked for, infinite where only rounding is seen
    uncertainty : (n,) twice the difference of the run by `MEASURING` to the reference,
        and rounding
    blur : (n,) the same of a looser one, by which models are compared
    left_out : outputs that hold rounding only
    units : (n,)
    rounding : (n,) what it may leave of each output, see `rounding_levels`
    meshes : (n,) what meshes of bodies and modes that they lack add
    digits : (n,) what the digits of files leave open
    frames : (n,) what the frames change that bodies were put in
    """

    choice: Choice
    result: Result
    setting: Setting
    variation: Array
    allowed: Array
    uncertainty: Array
    blur: Array
    left_out: tuple[str, ...]
    units: tuple[str, ...]
    rounding: Array
    meshes: Array
    digits: Array
    frames: Array

    def worst(self, errors: Array) -> int:
        """The output of which errors use most."""
        shares = np.full(len(errors), -1.0)
        np.divide(errors, self.allowed, out=shares, where=np.isfinite(self.allowed))
        return int(shares.argmax())

    def with_meshes(self, errors: Array) -> Reference:
        """With what the meshes of bodies and modes that they lack add, (n,)."""
        return replace(self, meshes=errors)

    @property
    def resolution(self) -> Array:
        """What differences of two models do not show, (n,)."""
        return np.maximum(self.uncertainty, self.blur)

    @property
    def doubt(self) -> Array:
        """What a difference to the reference does not show, (n,)."""
        return self.uncertainty + self.meshes + self.digits + self.frames

    def use(self, errors: Array) -> float:
        """The largest share of what is allowed, 1 for all of it."""
        counts = np.isfinite(self.allowed)
        return float((errors[counts] / self.allowed[counts]).max())


def make_reference(runs: Runs, choice: Choice, request: Request) -> Reference:
    """The finest model, integrated as tightly as the request asks for.

    Its uncertainty is twice the difference of two methods of different order, of which
    the tighter one is the reference, and the part of rounding that these may share.
    They also step over oscillations from the start that are too small for their
    tolerances: these are seen in the first rows, integrated much more tightly.

    Raises
    ------
    InputError : an output cannot be predicted as exactly as is asked for, or none
        moves.
    SimulationError : the run stopped early.
    """
    first = rtol = first_rtol(request)
    start = _tight_start(runs, choice)
    while True:
        setting = Setting(MEASURING, rtol)
        tighter = Setting(CHECKING, max(MORE * rtol, 0.1 * TIGHTEST))
        found = of_two_runs(runs, choice, request, setting, tighter)
        found = _with_start(runs, found, start)
        use = found.use(found.uncertainty)
        if use <= PART:
            return _as_loosely(runs, found, first)
        if rtol <= TIGHTEST:
            found = _without_rounding(found, request)
            if found.use(found.uncertainty) <= PART:
                return found
            raise _unpredictable(request, found)
        rtol = max(TIGHTEST, _next(rtol, AIM * PART / use))


def _without_rounding(found: Reference, request: Request) -> Reference:
    """Without relative requests of outputs that cannot be predicted, and vary by less
    than what rounding may make of their terms; with them where nothing else is left."""
    absolute = np.array([t.absolute for t in request.tolerances.values()])
    rounding = found.uncertainty > PART * found.allowed
    rounding &= ~absolute & (found.variation <= MUCH * found.rounding)
    allowed = np.where(rounding, np.inf, found.allowed)
    if not np.isfinite(allowed).any():
        return found
    names = np.array(request.names)[rounding].tolist()
    return replace(found, allowed=allowed, left_out=(*found.left_out, *names))


def _next(rtol: float, share: float) -> float:
    """A tolerance at which errors are about a share of what they are at this one."""
    return rtol * float(np.clip(share, MOST, LEAST))


def _as_loosely(runs: Runs, found: Reference, rtol: float) -> Reference:
    """With models compared at the first tolerance, or at the one that this asks for, if
    that does: outputs that hold rounding only, as momenta that are conserved, are known
    as such at tight tolerances alone, and ask for none."""
    while rtol > found.setting.rtol / LEAST:
        setting = Setting(MEASURING, rtol)
        run = found.choice, runs.tight(found.choice, setting)
        blur = SAFETY * runs.between(run, (found.choice, found.result))
        use = found.use(blur)
        if use <= PART:
            return replace(found, setting=setting, blur=blur)
        rtol = _next(rtol, AIM_OF_MODELS * PART / use)
    return found


def _tight_start(runs: Runs, choice: Choice) -> tuple[Array, Array] | None:
    """Times and outputs of the first rows, if they can be had."""
    time = runs.scene.time
    if time.output_step is None:
        return None
    rows = np.ceil(START * (time.end - time.start) / time.output_step)
    part = runs.until(min(time.end, float(time.start + rows * time.output_step)))
    found = part.attempt(choice, Setting(CHECKING, TIGHTEST))
    return None if found is None else (found.t, part.columns(choice, found))


def _with_start(
    runs: Runs, reference: Reference, start: tuple[Array, Array] | None
) -> Reference:
    """With what it errs in its first rows, twice over."""
    if start is None:
        return reference
    count, result = len(start[0]), reference.result
    columns = runs.columns(reference.choice, result)
    errors = apart(start, (result.t[:count], columns[:count]))
    errors = np.where(np.isfinite(errors), SAFETY * errors, 0.0)
    return replace(reference, uncertainty=np.maximum(reference.uncertainty, errors))


def of_two_runs(
    runs: Runs, choice: Choice, request: Request, setting: Setting, tighter: Setting
) -> Reference:
    """The tighter of two runs as a reference.

    Raises
    ------
    InputError : no output moves.
    SimulationError : a run stopped early.
    """
    coarse, fine = runs.tight(choice, setting), runs.tight(choice, tighter)
    found = of_one_run(runs, choice, request, tighter)
    between = SAFETY * runs.between((choice, coarse), (choice, fine))
    return replace(found, setting=setting, uncertainty=between + found.uncertainty)


def of_one_run(
    runs: Runs, choice: Choice, request: Request, setting: Setting
) -> Reference:
    """A run as a reference, of which no more than rounding is open yet.

    Raises
    ------
    InputError : no output moves.
    SimulationError : the run stopped early.
    """
    result = runs.tight(choice, setting)
    values = runs.columns(choice, result)
    variation = np.ptp(values, axis=0)
    rounding = runs.rounding(choice, result)
    moving = moves(request.names, values, variation, rounding)
    largest = np.abs(values).max(axis=0)
    moving &= ~zero_across(runs.scene, request.names, largest, rounding)
    absolute = np.array([t.absolute for t in request.tolerances.values()])
    judged = moving | absolute
    if not judged.any():
        raise InputError(
            "no output can be told from rounding",
            place="accuracy.wanted",
            expected="outputs that move",
        )
    nothing = np.zeros(len(request.names))
    return Reference(
        choice=choice,
        result=result,
        setting=setting,
        variation=variation,
        allowed=np.where(judged, request.allowed(variation), np.inf),
        uncertainty=ROUNDING * variation,
        blur=nothing,
        left_out=tuple(np.array(request.names)[~judged].tolist()),
        units=tuple(unit_of(name, runs.scene) for name in request.names),
        rounding=rounding,
        meshes=nothing,
        digits=nothing,
        frames=nothing,
    )


def zero_across(
    scene: SceneFile, names: tuple[str, ...], largest: Array, rounding: Array
) -> NDArray[np.bool_]:
    """(n,) outputs across the plane of a scene that can be written in it, where they
    are as good as zero.

    largest, rounding : (n,) their absolute values, and what rounding may leave of them
    """
    if scene.dimension == "planar" or in_plane(scene) is None:
        return np.zeros(len(names), dtype=bool)
    return np.array([*map(is_across, names)]) & (largest <= MUCH * rounding)


def first_rtol(request: Request) -> float:
    """The first tolerance to try: absolute requests show what they need."""
    relative = [t.value for t in request.tolerances.values() if not t.absolute]
    wanted = min(relative, default=1.0)
    return float(np.clip(SHARPER * wanted, TIGHTEST, LOOSEST))


def _unpredictable(request: Request, found: Reference) -> InputError:
    worst = int((found.uncertainty / found.allowed).argmax())
    name, off = request.names[worst], found.uncertainty[worst]
    return InputError(
        f"{name} cannot be predicted as exactly as is asked for: two references at "
        f"{TIGHTEST:.0e} differ by {off:.1e} where {found.allowed[worst]:.1e} may be "
        "wrong",
        place="accuracy.wanted",
        expected="a larger error, a shorter time span, or other outputs",
    )
