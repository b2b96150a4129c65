"""Floquet analysis: small motions about a periodic motion, eq. (50).

The variational equations are those of the run itself: its stages, linearised, map a
change of the start to a change of the end in one pass. Both are resolved in the free
directions (y, w) of `state_matrix` at the start, to which the motion returns.

A multiplier determines its frequency but for multiples of 1 / T. The motion of a mode
p(t) exp(lambda t) is observed at points of all bodies, in inertial axes and in those of
the bodies; its largest harmonic names the frequency in either.

References
----------
A. H. Nayfeh, D. T. Mook: Nonlinear Oscillations, 1979, sections 5.2 and 5.3.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import (
    Diagnostic,
    WithDiagnostics,
    diagnose,
    without,
)
from sidtool.formats.sid_mass import skew

from ..analyses.joint_friction import equations_at
from ..analyses.linearisation import growth_notes, operating_point
from ..analyses.state_matrix import linear_equations, small_motions
from ..initial_state.integrator_start import run_settings
from ..integrators import batch_evaluation
from ..spatial import system_arrays as at
from ..system.characteristic_sizes import coordinate_sizes
from ..system.errors import SimulationError
from ..system.system import System
from ..system.work_arrays import new_memory, new_work_arrays, raise_pending
from .frozen_run import StructureChange, record_grid, run_on_grid
from .linearised_run import LinearisedRun, NotLinearisable
from .motion_derivatives import MotionDerivatives, ParameterChange
from .position_rates import PositionRates, position_rates

#: Method of the run over one period, and its steps at first and at most. They are
#: halved until multipliers have no more error than the tolerance: the error control of
#: a run would choose steps for the motion alone.
METHOD, FIRST_STEPS, MAX_STEPS, TOLERANCE = "radau13", 32, 2048, 1e-9
#: Their change is larger than their error by more than this: the order is 13.
CHANGE = 100.0
#: Numbers in the derivatives of the states of a run at most.
MAX_NUMBERS = 40_000_000
#: Bodies that move by more than this part of others take part in a mode.
TAKES_PART = 1e-6
#: Error of multipliers from which on it is reported.
REPORTED_ERROR = 1e-6
#: A motion returns if it misses its start by less, in sizes of the mechanism.
RETURN_TOLERANCE = 1e-6
#: Change of the states in which equations are compared, relative to their sizes: those
#: of a motion at rest may depend on time only besides it.
COMPARED_CHANGE = 1e-2
#: Multipliers that differ by less are those of one, of which the mean is accurate:
#: rounding moves a double one by its square root.
EQUAL_MULTIPLIERS = 3e-4
#: Multipliers are larger than one beyond this.
GROWTH = 1e-6


@dataclass(frozen=True, eq=False)
class FloquetModes(WithDiagnostics):
    """Small motions about a periodic motion.

    Attributes
    ----------
    period
        [s]
    multipliers : (n,)
        Complex factors by which modes grow in a period, one of each pair, the largest
        first.
    exponents : (n,)
        Logarithm of the multipliers over the period [1/s], -inf for a multiplier of
        zero; the imaginary part is known but for multiples of 2 pi / period.
    inertial_frequencies, rotating_frequencies : (n,)
        [Hz] of the largest harmonic of the displacements in inertial axes, and in those
        of the bodies; NaN for a multiplier of zero. Other sensors may show others, by
        multiples of 1 / period apart.
    monodromy : (2 d, 2 d)
        Changes of the free coordinates and velocities after a period, scaled.
    error
        Estimate of that of the multipliers.
    is_stable
        Whether no multiplier is larger than one.
    diagnostics
        What has to be known of it; `notes` and `warnings` give it as sentences.
    """

    period: float
    multipliers: np.ndarray
    exponents: np.ndarray
    inertial_frequencies: Array
    rotating_frequencies: Array
    monodromy: Array
    error: float
    is_stable: bool
    diagnostics: tuple[Diagnostic, ...] = field(default=())


def floquet_modes(system: System, longer: System) -> FloquetModes:
    """Multipliers of the motion of a scene whose time span is one period.

    Parameters
    ----------
    longer
        The same scene over two periods.

    Raises
    ------
    InputError
        The start cannot be assembled.
    SimulationError
        The motion does not return to its start or its equations do not repeat (N741),
        or it has no variational equations (N742).
    """
    point = operating_point(system, "start")
    longer = operating_point(longer, "start").system
    count, error = FIRST_STEPS, np.inf
    period = _Period(point.system, longer, count)
    while error > TOLERANCE and count < MAX_STEPS and 2 * period.size < MAX_NUMBERS:
        count *= 2
        finer = _Period(point.system, longer, count)
        error = _largest_distance(finer.multipliers, period.multipliers) / CHANGE
        period = finer
    values = period.multipliers
    chosen = [k for k, value in enumerate(values) if value.imag >= 0.0]
    chosen.sort(
        key=lambda k: (-round(float(abs(values[k])), 9), abs(np.angle(values[k])))
    )
    values, vectors = values[chosen], period.vectors[:, chosen]
    with np.errstate(divide="ignore"):
        growth = np.log(np.abs(values)) / period.span
    exponents = growth + 1j * (np.angle(values + 0.0) / period.span)
    inertial, rotating = period.frequencies(exponents, vectors)
    sizes = _mean_sizes(values)
    found = (
        *point.law_diagnostics,
        *_growth_notes(sizes, period.span),
        *((diagnose("N743", error=error),) if error > REPORTED_ERROR else ()),
    )
    return FloquetModes(
        period=period.span,
        multipliers=values,
        exponents=exponents,
        inertial_frequencies=inertial,
        rotating_frequencies=rotating,
        monodromy=period.monodromy,
        error=error,
        is_stable=bool((sizes <= 1.0 + GROWTH).all()),
        diagnostics=without(found, system.scene.diagnostics.ignore),
    )


def _largest_distance(values: np.ndarray, others: np.ndarray) -> float:
    """Largest distance of a value from the nearest of others."""
    distances = np.abs(values[:, None] - others).min(axis=1, initial=np.inf)
    return float(distances.max(initial=0.0))


def _linearised_period(system: System, count: int) -> LinearisedRun:
    """The run of a scene in equal steps, linearised about itself.

    Raises
    ------
    SimulationError : it has no variational equations (N742).
    """
    time = system.scene.time
    settings = run_settings(system, METHOD, None, (time.end - time.start) / count, None)
    try:
        grid = record_grid(system, settings)
        return LinearisedRun(run_on_grid(system, grid), grid)
    except (NotLinearisable, StructureChange) as error:
        raise SimulationError(diagnose("N742", reason=error.reason)) from None


def _check_return(run: LinearisedRun, z: Array, v: Array) -> None:
    """Check that the motion returns to its start, but for whole revolutions.

    Raises
    ------
    SimulationError : it does not (N741).
    """
    system, steps = run.system, run.motion.steps
    last_z, last_v = steps.z[-1], steps.v[-1]
    sizes = coordinate_sizes(system)
    period = run.times[-1] - run.times[0]
    first, last = _poses(system, z, v), _poses(system, last_z, last_v)
    worst, where = 0.0, ""
    bodies = zip(system.arrays.body, system.bodies, first, last, strict=True)
    for row, body, a, b in bodies:
        if not row[at.NV]:
            continue
        u, end = int(row[at.VEL]), int(row[at.VEL] + row[at.NV])
        speeds = np.abs(last_v - v)[u:end] / sizes[u:end] * period
        moves = np.abs(b - a) / system.length
        elastic = slice(row[at.POS] + row[at.NP] - row[at.NQ], row[at.POS] + row[at.NP])
        bends = np.abs(last_z - z)[elastic] / sizes[end - int(row[at.NQ]) : end]
        parts = np.concatenate([speeds, moves, bends])
        if parts.max(initial=0.0) > worst:
            worst, where = float(parts.max()), body.name
    if worst > RETURN_TOLERANCE:
        reason = f"{where} misses its start"
        raise SimulationError(
            diagnose("N741", period=period, size=worst, reason=reason)
        )


def _check_equations(run: LinearisedRun, longer: System) -> None:
    """Check that states near the motion have the same accelerations a period later.

    Parameters
    ----------
    longer : the system of the run over two periods

    Raises
    ------
    SimulationError : they do not (N741), or have none (N742).
    """
    system, period = run.system, run.times[-1] - run.times[0]
    states = run.stages.selected(run.s * np.arange(run.n_steps) + run.s // 2)
    sizes = coordinate_sizes(system)
    random = np.random.default_rng(0).standard_normal((2, *states.v.shape))
    moves, speeds = COMPARED_CHANGE * sizes * random
    Z = position_rates(system, states.z, states.v).Z
    z, v = states.z.copy(), states.v + speeds / period
    z[:, : run.nz] += (Z @ moves[:, :, None])[:, :, 0]
    work, memory = new_work_arrays(longer), new_memory(longer, 0)
    found = np.zeros((2, *v.shape))
    for a, times in zip(found, (states.times, states.times + period), strict=True):
        status = batch_evaluation.accelerations_of_states(
            *(run.kernels, longer.arrays, work, memory, longer.clocks(times), times),
            *(z, v, a, np.zeros((len(times), run.m))),
        )
        raise_pending(longer)
        if status != 0:
            reason = "a singular configuration"
            raise SimulationError(diagnose("N742", reason=reason))
    found *= period**2 / sizes
    largest = np.abs(found).max(axis=(0, 1))
    changes = np.abs(found[1] - found[0]).max(axis=0) / np.maximum(largest, 1.0)
    if changes.max(initial=0.0) > RETURN_TOLERANCE:
        k = int(changes.argmax())
        ends = system.arrays.body[:, at.VEL] + system.arrays.body[:, at.NV]
        body = system.bodies[int((ends <= k).argmin())].name
        reason = f"forces or drives that move {body} do not repeat"
        size = float(changes[k])
        raise SimulationError(diagnose("N741", period=period, size=size, reason=reason))


def _poses(system: System, z: Array, v: Array) -> list[Array]:
    """Position of each body, and of its axes of the size of the mechanism; of states
    of laws none."""
    Z = position_rates(system, z[None], v[None]).Z[0]
    axes = 2 if system.planar else 3
    found = []
    for row in system.arrays.body:
        p, u = int(row[at.POS]), int(row[at.VEL])
        count = axes if row[at.RD] >= axes else 0
        R = Z[p : p + count, u : u + count]
        found.append(np.concatenate([z[p : p + count], R.ravel() * system.length]))
    return found


class _Period:
    """The small motions over one period, computed in equal steps.

    Attributes
    ----------
    span : [s]
    size : numbers in the derivatives of all states
    monodromy, multipliers, vectors
    tangents, velocities : (steps + 1, nv, columns) changes at the ends of the steps
    """

    def __init__(self, system: System, longer: System, count: int) -> None:
        run = self._run = _linearised_period(system, count)
        system = run.system
        self.span = float(run.times[-1] - run.times[0])
        z, v = (part[0].copy() for part in run.starts)
        _check_return(run, z, v)
        _check_equations(run, longer)
        mechanics = equations_at(system, float(run.times[0]), z, v)
        mechanics.set_scale(z, stiffness=0.0)
        small = small_motions(mechanics, linear_equations(mechanics, z, v))
        scale = mechanics.scale[:, None]
        moved, speeds = small.position_directions, small.velocity_directions
        self.size = 0
        self.multipliers: np.ndarray = np.zeros(0)
        self.vectors: np.ndarray = np.zeros((0, 0))
        if not moved.shape[1]:  # nothing can move
            self.monodromy = np.zeros((0, 0))
            return
        rates = position_rates(system, z[None], v[None])
        self._follow(np.concatenate([rates.Z[0] @ (scale * moved), scale * speeds]))
        end = np.concatenate([self.tangents[-1] / scale, self.velocities[-1] / scale])
        both = np.vstack([moved, speeds])
        self.monodromy = np.linalg.lstsq(both, end, rcond=None)[0]
        self.multipliers, self.vectors = np.linalg.eig(self.monodromy)

    def _follow(self, start: Array) -> None:
        """Follow changes (nz + nv, columns) of the start."""
        run = self._run
        dz, dv = MotionDerivatives(run).direct(_start_changes(run, start))
        self.size = dz.size + dv.size
        points, steps = run.motion.points.count, run.motion.steps
        # the beginnings of all steps, and the end
        rows = np.append(points * np.arange(run.n_steps), points * run.n_steps - 1)
        self._rates: PositionRates = position_rates(
            run.system, steps.z[rows], steps.v[rows]
        )
        self.tangents = self._rates.to_tangent @ dz[rows, : run.nz]
        self.velocities = dv[rows]

    def frequencies(
        self, exponents: np.ndarray, vectors: np.ndarray
    ) -> tuple[Array, Array]:
        """Frequencies (n,) [Hz] of the largest harmonic in inertial and body axes.

        In inertial axes that of bodies that do not rotate, in body axes that of bodies
        that do, if they take part.
        """
        if not len(exponents):
            return np.zeros(0), np.zeros(0)
        resting: list[Array] = []
        turning: list[Array] = []
        inertial: list[Array] = []
        for is_turning, fixed, own in self._bodies():
            inertial.append(fixed)
            (turning if is_turning else resting).append(own)
        t = self._run.times[:-1] - self._run.times[0]
        orders = np.fft.fftfreq(len(t), 1.0 / len(t))
        found, known = [], np.isfinite(exponents)
        exponents = np.where(known, exponents, 0.0)
        for first, second in ((resting, inertial), (turning, resting)):
            chosen = np.zeros(len(exponents))
            size = np.zeros(len(exponents))
            for parts in (second, first):
                if not parts:
                    continue
                motion = np.concatenate(parts, axis=1)[:-1] @ vectors
                periodic = motion * np.exp(-exponents * t[:, None])[:, None, :]
                harmonics = np.linalg.norm(np.fft.fft(periodic, axis=0), axis=1)
                takes_part = harmonics.max(axis=0) > TAKES_PART * size
                size = harmonics.max(axis=0)
                chosen = np.where(takes_part, orders[harmonics.argmax(axis=0)], chosen)
            hertz = np.abs(exponents.imag / (2.0 * np.pi) + chosen / self.span)
            found.append(np.where(known, hertz, np.nan))
        return found[0], found[1]

    def _bodies(self) -> Iterator[tuple[bool, Array, Array]]:
        """Whether a body rotates; displacements and rotations (steps + 1, components,
        columns) of it in inertial axes and in its own."""
        system, v = self._run.system, self._run.starts[1][0]
        axes = 2 if system.planar else 3
        for row, data in zip(system.arrays.body, system.bodies, strict=True):
            rd, p, u = int(row[at.RD]), int(row[at.POS]), int(row[at.VEL])
            if rd < axes:
                continue
            R = self._rates.Z[:, p : p + axes, u : u + axes]
            part = self.tangents[:, u : u + int(row[at.NV])]
            is_turning = bool(np.abs(v[u + axes : u + rd]).max(initial=0.0) > 0.0)
            yield is_turning, R @ part[:, :axes], part[:, :axes]
            turned = system.length * part[:, axes:rd]
            yield is_turning, (R @ turned if rd == 6 else turned), turned
            for node in data.sid.nodes if row[at.NQ] else ():
                own = part[:, :axes] + node.phi.m0[:axes] @ part[:, rd:]
                if system.planar and rd == 3:
                    across = np.array([[-node.position[1]], [node.position[0]]])
                    own = own + across @ part[:, 2:3]
                elif rd == 6:
                    own = own - skew(node.position) @ part[:, 3:6]
                yield is_turning, R @ own, own


def _start_changes(run: LinearisedRun, start: Array) -> list[ParameterChange]:
    """Changes of the start alone, a column each."""
    nothing = ParameterChange(
        residual=np.zeros((len(run.stages.times), run.nv + run.m)),
        rates=None,
        stretch=np.zeros(run.n_steps),
        constraint=np.zeros((run.n_steps - 1, 2 * run.m)),
        start=np.zeros(run.nz + run.nv),
        step=0.0,
        systems=(run.system, run.system),
        times=(run.times, run.times),
        relative_error=0.0,
    )
    return [replace(nothing, start=column) for column in start.T]


def _mean_sizes(values: np.ndarray) -> Array:
    """Sizes (n,) of multipliers, of nearly equal ones that of their mean."""
    near = np.abs(values[:, None] - values) <= EQUAL_MULTIPLIERS * np.abs(values)
    mirrored = np.abs(values[:, None] - values.conj()) <= EQUAL_MULTIPLIERS * np.abs(
        values
    )
    total = near @ values + (mirrored & ~near) @ values.conj()
    return np.abs(total) / (near.sum(axis=1) + (mirrored & ~near).sum(axis=1))


def _growth_notes(sizes: Array, period: float) -> Iterator[Diagnostic]:
    """Modes that grow (N714)."""
    rates = np.log(np.maximum(sizes, 1.0)) / period
    yield from growth_notes(sizes > 1.0 + GROWTH, rates)
