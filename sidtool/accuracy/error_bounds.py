"""A posteriori error bounds for bodies whose frames are fully prescribed.

Their elastic coordinates obey M q'' + D(t) q' + K(t) q = f(t), theory, section 15. Any
motion u leaves a residual R there, and the energy norm of its error obeys eq. (36). The
motion here is a tight run of the selected model, extended to all shape functions and
interpolated between its states; the static response to its residual is subtracted from
the error before that is bounded. So omitted shape functions and terms are covered. The
difference of the selected run from that motion is measured at the output times.

Source: Ruiner, Fehr, Haasdonk, Eberhard, Acta Mech. Sin. 28 (2012) 854, for linear
systems of second order with a constant stiffness.

Contribution of each kind of choice to the error and to the saved time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.linalg import eigh

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.base.stress import COMPONENTS
from sidtool.formats.result import BudgetLine
from sidtool.formats.scene import SidBody, parse_output
from sidtool.formats.scene.outputs import ELASTIC

from ..measurement.candidates import (
    Choice,
    scene_of_model,
    with_all_shapes,
    with_all_terms,
    with_recorded_outputs,
)
from ..measurement.runs import Runs, Setting
from .reference_run import Reference
from .selection import SelectedModel

if TYPE_CHECKING:
    from sidtool.solver.analyses.dense_equations import DenseEquations
    from sidtool.solver.system.system import System

#: Intervals between states of the selected run: first number and largest number. It is
#: doubled while the bound decreases to this factor.
MIN_INTERVALS, MAX_INTERVALS, SUFFICIENT_DECREASE = 128, 4096, 0.7
#: Relative tolerance for linear and for constant equations.
LINEARITY_TOLERANCE = 1e-7
#: Tolerance for negative damping, relative to critical damping.
DAMPING_ROUNDING = 1e-12
#: Intervals between samples of a varying stiffness: first and largest number. The
#: number is doubled until the interpolation error at the probe times changes an energy
#: by at most `MAX_ENERGY_CHANGE` in the run.
MIN_SAMPLES, MAX_SAMPLES, PROBE_COUNT, MAX_ENERGY_CHANGE = 32, 1024, 12, 0.01


def error_budget(
    runs: Runs,
    reference: Reference,
    chosen: SelectedModel,
    theory: Array,
    seen_by: str = "two methods",
) -> tuple[BudgetLine, ...]:
    """Build the error budget: a line for each kind of choice, the reference and the
    sum.

    Each choice is switched alone: the selected model against the one with this choice
    at its finest, both integrated tightly; the selected integration against a tight
    one. The last line is the selected run against the reference, with the uncertainty
    of the reference. The terms neglected by linear theory follow below.

    Parameters
    ----------
    theory : (n,) terms neglected by linear theory, zero where they were not measured
    seen_by : text on how the errors of the reference are known
    """
    lines = _BudgetLines(runs, reference, chosen)
    whole, setting = chosen.choice, chosen.accepted_run.setting
    shapes = with_all_shapes(whole, reference.choice)
    terms = with_all_terms(whole, reference.choice)
    integration_error = runs.max_differences(
        (whole, runs.attempt(whole, setting)),
        (whole, runs.attempt(whole, reference.setting)),
    )
    tight = runs.seconds(whole, reference.setting)
    method = f"{setting.integrator}, rtol {setting.rtol:.2g}"
    meshes = (lines.line("mesh", "of models", reference.meshes, None),)
    frames = (lines.line("frames", "not their own", reference.frames, None),)
    left_out = (lines.line("theory", "small deformations", theory, None),)
    digits = (lines.line("digits", "of files", reference.digits, None),)
    return (
        *(meshes if reference.meshes.any() else ()),
        *(lines.plane() if whole.flat else ()),
        lines.choice_line("shape functions", _shapes_text(whole, reference), shapes),
        lines.choice_line("terms", _terms_text(whole, reference), terms),
        lines.line(
            "integration", method, integration_error + reference.resolution, tight
        ),
        lines.line("reference", seen_by, reference.uncertainty, None),
        *(digits if reference.digits.any() else ()),
        *(frames if reference.frames.any() else ()),
        lines.line("all together", "as run", chosen.errors, None),
        *(left_out if theory.any() else ()),
    )


class _BudgetLines:
    def __init__(self, runs: Runs, reference: Reference, chosen: SelectedModel) -> None:
        self.runs, self.reference, self.chosen = runs, reference, chosen

    def plane(self) -> tuple[BudgetLine, ...]:
        """Return the line of the planar reduction: finest planar against spatial
        model.
        """
        space, setting = self.reference.choice, self.chosen.accepted_run.setting
        plane = replace(space, flat=True)
        errors = self.runs.difference(plane, space, self.reference.setting)
        seconds = self.runs.seconds(space, setting)
        text = "planar, for spatial"
        return (self.line("space", text, errors + self.reference.resolution, seconds),)

    def choice_line(self, part: str, text: str, finer: Choice) -> BudgetLine:
        """Return the line of the choices that `finer` replaces by the finest ones."""
        setting, choice = self.chosen.accepted_run.setting, self.chosen.choice
        if finer == choice:
            nothing = np.zeros(len(self.runs.names))
            return self.line(part, text, nothing, self.chosen.accepted_run.seconds)
        errors = self.runs.difference(choice, finer, self.reference.setting)
        seconds = self.runs.seconds(finer, setting)
        return self.line(part, text, errors + self.reference.resolution, seconds)

    def line(
        self, part: str, text: str, errors: Array, finest: float | None
    ) -> BudgetLine:
        pairs = zip(self.runs.names, errors, self.reference.allowed, strict=True)
        return BudgetLine(
            part=part,
            choice=text,
            errors={n: float(e) for n, e, a in pairs if np.isfinite(a)},
            seconds=self.chosen.accepted_run.seconds,
            finest=None if finest is None or not np.isfinite(finest) else finest,
        )


def _shapes_text(choice: Choice, reference: Reference) -> str:
    """Return a text such as "3 of 8, rod rigid"."""
    all_ = dict(reference.choice.kept)
    kept = sum(len(numbers) for _, numbers in choice.kept)
    total = sum(map(len, all_.values()))
    rigid = [n for n, numbers in choice.kept if all_[n] and not numbers]
    return ", ".join([f"{kept} of {total}", *(f"{name} rigid" for name in rigid)])


def _terms_text(choice: Choice, reference: Reference) -> str:
    flexible = {n for n, kept in choice.kept if kept}
    unstiffened = sorted(choice.unstiffened & flexible)
    simple = sorted((reference.choice.quadratic - choice.quadratic) & flexible)
    parts = [f"{n} without geometric stiffening" for n in unstiffened]
    parts += [f"{n} without quadratic inertia" for n in simple]
    return ", ".join(parts) or "all"


#: Integration of the motion that the bounds are based on.
BASE_SETTING = Setting("radau13", 1e-11)


@dataclass(frozen=True, eq=False)
class _Norms:
    """Representation of an output as a linear function of the elastic coordinates or
    rates.

    rows : (k, n); the error of the output is at most the length of rows @ error
    """

    rows: Array
    rates: bool


def error_bounds(
    runs: Runs, whole: Choice, chosen: Choice, setting: Setting
) -> dict[str, float]:
    """Return bounds by output for the errors with respect to the full SIDs.

    The result is empty if frames are not prescribed or the equations are not linear.
    Outputs that are not linear functions of the elastic coordinates have no bound.

    Parameters
    ----------
    whole : all shape functions and terms
    chosen, setting : the selected run; it is compared with a tight one
    """
    scene, sids = runs.scene, runs.sids
    system = runs.compile(
        with_recorded_outputs(scene_of_model(scene, whole, sids), ()), sids
    )
    full = make_elastic_equations(system)
    if full is None:
        return {}
    norms = {n: _norms(n, full, sids) for n in runs.names}
    known_norms = {n: norm for n, norm in norms.items() if norm is not None}
    tight, loose_run = runs.attempt(chosen, BASE_SETTING), runs.attempt(chosen, setting)
    if not known_norms or tight is None:
        return {}
    pairs = zip(
        runs.names,
        runs.max_differences((chosen, tight), (chosen, loose_run)),
        strict=True,
    )
    integration = {name: float(error) for name, error in pairs}
    bounds: dict[str, float] = {}
    count = _minimum_intervals(full, chosen)
    while count <= MAX_INTERVALS:
        finer = _bounds(full, runs, chosen, known_norms, count)
        helped = not bounds or any(
            finer[n] < SUFFICIENT_DECREASE * bounds[n] for n in known_norms
        )
        bounds = {n: min(finer[n], bounds.get(n, np.inf)) for n in known_norms}
        if not helped:
            break
        count *= 2
    return {n: bound + integration[n] for n, bound in bounds.items()}


def _minimum_intervals(full: ElasticEquations, chosen: Choice) -> int:
    """Return the number of intervals that resolves the fastest selected shape
    function.
    """
    kept_columns = [
        full.names.index(f"{n}.q{k}") for n, numbers in chosen.kept for k in numbers
    ]
    if not kept_columns:
        return MIN_INTERVALS
    some = np.ix_(kept_columns, kept_columns)
    squares = eigh(full.samples.symmetric[0][some], full.M[some], eigvals_only=True)
    time = full.system.scene.time
    return int(
        np.clip(
            (time.end - time.start) * np.sqrt(squares[-1]),
            MIN_INTERVALS,
            MAX_INTERVALS / 2,
        )
    )


def _norms(name: str, full: ElasticEquations, sids: Mapping[str, SID]) -> _Norms | None:
    output = parse_output(name)
    if output.owner not in full.columns:
        return None
    where, sid = full.columns[output.owner], sids[output.owner]
    rates, quantity = output.quantity.startswith("v"), output.quantity
    if not output.marker:
        if not ELASTIC.fullmatch(quantity) or quantity.endswith("*"):
            return None
        rows = np.eye(sid.nq)[[int(quantity.lstrip("vq")) - 1]]
    else:
        node = sid.node(full.nodes[output.owner].get(output.marker, output.marker))
        if quantity in ("ux", "uy", "uz"):
            rows = node.phi.m0[["ux", "uy", "uz"].index(quantity)][None]
        elif quantity in ("x", "y", "z"):
            rows = node.phi.m0
        elif quantity.startswith("sigma_") and node.sigma is not None:
            component = COMPONENTS.index(quantity.removeprefix("sigma_"))
            rows = node.sigma.first_order(sid.nq)[:, component, 0][None]
        else:
            return None
    wide = np.zeros((len(rows), full.n))
    wide[:, where] = rows
    return _Norms(wide, rates)


def _bounds(
    full: ElasticEquations,
    runs: Runs,
    chosen: Choice,
    norms: Mapping[str, _Norms],
    count: int,
) -> dict[str, float]:
    """Return the bounds of a tight run of the chosen model at `count` + 1 times."""
    time = runs.scene.time
    t = np.linspace(time.start, time.end, count + 1)
    states = _full_coordinates(full, runs, chosen, t)
    K = full.samples.at(t, full.samples.symmetric)
    residual = full.residual(t, *states)
    static = make_interp_spline(t, np.linalg.solve(K, residual[..., None])[..., 0], k=5)
    halves = 0.5 * (t[1:] + t[:-1])
    there = [
        full.residual(times, *(x + static(times, nu=k) for k, x in enumerate(motion)))
        for times, motion in ((t, states), (halves, _interval_midpoints(t, *states)))
    ]
    size, middle = (full.weighted_norm(r) for r in there)
    pushes = (t[1:] - t[:-1]) * (size[1:] + 4.0 * middle + size[:-1]) / 6.0
    start = full.start()
    errors = [states[k][0] + static(t[0], nu=k) - start[k] for k in (0, 1)]
    y = np.empty(len(t))
    y[0] = np.sqrt(errors[1] @ full.M @ errors[1] + errors[0] @ K[0] @ errors[0])
    growth = full.growth_factors(t)
    for k, push in enumerate(pushes):
        y[k + 1] = (y[k] + push) * growth[k]
    return {
        n: _largest_residual_term(norm, full, static, t, K, y)
        for n, norm in norms.items()
    }


def _largest_residual_term(
    norm: _Norms, full: ElasticEquations, static: object, t: Array, K: Array, y: Array
) -> float:
    """Return |c s| and |c| in the inverse metric times y, eq. (37), maximal over
    time.
    """
    taken = np.linalg.norm(static(t, nu=int(norm.rates)) @ norm.rows.T, axis=1)  # type: ignore[operator]
    metric = np.broadcast_to(full.M, K.shape) if norm.rates else K
    squares = norm.rows @ np.linalg.solve(metric, norm.rows.T[None])
    return float((taken + np.sqrt(np.linalg.eigvalsh(squares)[:, -1]) * y).max())


def _full_coordinates(
    full: ElasticEquations, runs: Runs, chosen: Choice, t: Array
) -> tuple[Array, Array, Array]:
    """Return q, q', q'' (nt, n) of all shape functions from those of the selected
    model.
    """
    from sidtool.solver import simulate

    less = with_recorded_outputs(scene_of_model(runs.scene, chosen, runs.sids), ())
    times = {"output_step": None, "output_times": tuple(t.tolist())}
    time = less.time.model_copy(update=times)
    system = runs.compile(less.model_copy(update={"time": time}), runs.sids)
    result = simulate(
        system, integrator=BASE_SETTING.integrator, rtol=BASE_SETTING.rtol
    )
    kept_columns = [full.names.index(name) for name in result.position_names]
    own = make_elastic_equations(system)
    q, v, a = (np.zeros((len(t), full.n)) for _ in range(3))
    q[:, kept_columns], v[:, kept_columns] = result.positions, result.velocities
    if own is not None and kept_columns:
        a[:, kept_columns] = own.accelerations(t, result.positions, result.velocities)
    return q, v, a


def _interval_midpoints(
    t: Array, q: Array, v: Array, a: Array
) -> tuple[Array, Array, Array]:
    """Interpolate position, rate and acceleration at interval midpoints (degree 5)."""
    h = (t[1:] - t[:-1])[:, None]
    q0, q1, v0, v1, a0, a1 = q[:-1], q[1:], v[:-1], v[1:], a[:-1], a[1:]
    place = (q0 + q1) / 2 + 5 * h / 32 * (v0 - v1) + h**2 / 64 * (a0 + a1)
    rate = 15 / 8 * (q1 - q0) / h - 7 / 16 * (v0 + v1) + h / 32 * (a1 - a0)
    return place, rate, 1.5 * (v1 - v0) / h - (a0 + a1) / 4


@dataclass(frozen=True, eq=False)
class MatrixSamples:
    """Samples of K and D (nt, n, n), and the largest interpolation error found
    [1/s].
    """

    times: Array
    K: Array
    D: Array
    max_interpolation_error: float = 0.0

    @cached_property
    def symmetric(self) -> Array:
        return np.asarray(0.5 * (self.K + np.swapaxes(self.K, 1, 2)))

    def at(self, t: Array, values: Array) -> Array:
        """Interpolate linearly at other times."""
        times = self.times
        place = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        x = ((t - times[place]) / (times[place + 1] - times[place]))[:, None, None]
        return np.asarray((1.0 - x) * values[place] + x * values[place + 1])


@dataclass(frozen=True, eq=False)
class ElasticEquations:
    """M q'' = f(t) - D(t) q' - K(t) q of all flexible bodies of a scene.

    names : of the elastic coordinates
    columns : columns of each body
    nodes : nodes of markers, by body
    """

    system: System
    mechanics: DenseEquations
    M: Array
    names: tuple[str, ...]
    columns: dict[str, slice]
    nodes: dict[str, dict[str, str]]

    @property
    def n(self) -> int:
        return len(self.M)

    def forces(self, t: Array, q: Array, v: Array) -> Array:
        """Return f - D v - K q (nt, n) at times (nt,) and states (nt, n)."""
        mechanics, values = self.mechanics, np.empty((len(t), self.n))
        times, intervals = t.tolist(), self.system.clocks(t).tolist()
        for row, force in enumerate(values):
            mechanics.t, mechanics.work.interval_time[0] = times[row], intervals[row]
            mechanics.evaluate(q[row], v[row])
            force[:] = mechanics.force
        return values

    def force(self, t: float, q: Array, v: Array) -> Array:
        """Return f - D v - K q (n,) at one state."""
        return self.forces(np.array([t]), q[None], v[None])[0]

    def accelerations(self, t: Array, q: Array, v: Array) -> Array:
        """(nt, n)"""
        return np.asarray(np.linalg.solve(self.M, self.forces(t, q, v).T).T)

    def residual(self, t: Array, q: Array, v: Array, a: Array) -> Array:
        """Return the residual (nt, n) f - D v - K q - M a."""
        return self.forces(t, q, v) - a @ self.M

    def weighted_norm(self, residual: Array) -> Array:
        """Return the norms (nt,) in the metric of the inverse mass matrix."""
        return np.sqrt((residual * np.linalg.solve(self.M, residual.T).T).sum(axis=1))

    def start(self) -> tuple[Array, Array]:
        """Return q and q' at the start of a run."""
        from sidtool.solver.initial_state.assembly import assemble

        state = assemble(self.system)[1]
        return state.z, state.v

    def linear_part(self, t: float) -> tuple[Array, Array]:
        """Return K and D (n, n) at a time."""
        n = self.n
        states, times = np.zeros((2 * n + 1, 2 * n)), np.full(2 * n + 1, t)
        steps = 1.0 / np.sqrt(self.M.diagonal())
        states[1:] = np.diag(np.tile(steps, 2))
        rest, *moved = self.forces(times, states[:, :n], states[:, n:])
        K, D = (rest - np.array(moved)).reshape(2, n, n) / steps[:, None]
        return K.T.copy(), D.T.copy()

    @cached_property
    def samples(self) -> MatrixSamples:
        """Return samples of K and D over time, only two if they are constant."""
        time = self.system.scene.time
        generator = np.random.default_rng(1)
        probes = generator.uniform(time.start, time.end, PROBE_COUNT)
        there = np.array([self.linear_part(t)[0] for t in probes])
        known: dict[float, tuple[Array, Array]] = {}
        count = 1
        while True:
            times = np.linspace(time.start, time.end, count + 1)
            for t in times.tolist():
                if t not in known:
                    known[t] = self.linear_part(t)
            parts = [known[t] for t in times.tolist()]
            K, D = (np.array([part[k] for part in parts]) for k in (0, 1))
            off = self._interpolation_error(MatrixSamples(times, K, D), probes, there)
            if (
                off * (time.end - time.start) <= MAX_ENERGY_CHANGE
                or count >= MAX_SAMPLES
            ):
                return MatrixSamples(times, K, D, off)
            count = max(2 * count, MIN_SAMPLES)

    def _interpolation_error(
        self, samples: MatrixSamples, probes: Array, there: Array
    ) -> float:
        """Return the largest error found of stiffnesses interpolated between the
        samples.

        Parameters
        ----------
        probes, there : other times (nt,), and the stiffnesses (nt, n, n) then
        """
        root = np.linalg.cholesky(samples.symmetric[0])
        between = samples.at(probes, samples.K)
        return max(map(self.stiffness_norm, there - between, [root] * PROBE_COUNT))

    def stiffness_norm(self, change: Array, root: Array) -> float:
        """Return the norm of a part of K (n, n) between both energy norms; `root` is
        that of K.
        """
        mass = np.linalg.cholesky(self.M)
        scaled = np.linalg.solve(mass, np.linalg.solve(root, change.T).T)
        return float(np.linalg.norm(scaled, 2))

    def growth_factors(self, t: Array) -> Array:
        """Return factors (nt - 1,) by which the energy norm may grow in each interval.
        Each factor is the square root of the largest growth of the stiffness, times exp
        of half the part of K that is not symmetric or not known between samples.
        """
        samples = self.samples
        K = samples.at(t, samples.symmetric)
        ratios = np.linalg.eigvals(np.linalg.solve(K[:-1], K[1:])).real.max(axis=1)
        roots = np.linalg.cholesky(samples.symmetric)
        skew = samples.K - samples.symmetric
        sizes = list(map(self.stiffness_norm, skew, roots))
        parts = (np.interp(times, samples.times, sizes) for times in (t[:-1], t[1:]))
        most = np.maximum(*parts) + 2.0 * samples.max_interpolation_error
        return np.asarray(
            np.sqrt(np.maximum(ratios, 1.0)) * np.exp(most * np.diff(t) / 2)
        )

    def is_applicable(self) -> bool:
        """Return whether the equations are linear, K is positive, and damping is not
        negative.
        """
        time = self.system.scene.time
        generator = np.random.default_rng(0)
        for t in np.linspace(time.start, time.end, 4):
            K, D = self.linear_part(t)
            q, v = generator.normal(size=(2, self.n)) / np.sqrt(self.M.diagonal())
            q = q * np.sqrt(self.M.diagonal() / np.abs(K.diagonal()))
            zero = np.zeros(self.n)
            rest = self.force(t, zero, zero)
            expected = rest - K @ q - D @ v
            off = np.abs(self.force(t, q, v) - expected).max()
            mass = self.mechanics.mass
            if off > LINEARITY_TOLERANCE * (
                np.abs(expected).max() + np.abs(rest).max()
            ):
                return False
            if np.abs(mass - self.M).max() > LINEARITY_TOLERANCE * np.abs(self.M).max():
                return False
        parts = [self.linear_part(t) for t in np.linspace(time.start, time.end, 9)]
        K, D = (np.array([part[k] for part in parts]) for k in (0, 1))
        lowest = [np.linalg.eigvalsh(0.5 * (k + k.T))[0] for k in K]
        damping = [np.linalg.eigvalsh(0.5 * (d + d.T))[0] for d in D]
        rounding = DAMPING_ROUNDING * np.sqrt(np.abs(K).max() * np.abs(self.M).max())
        return bool(min(lowest) > 0.0 and min(damping) >= -rounding)


def make_elastic_equations(system: System) -> ElasticEquations | None:
    """Return the elastic equations of a scene whose frames are all prescribed, else
    None.

    None also if a control law measures the motion, or the equations are not linear.
    """
    from sidtool.solver.analyses.dense_equations import DenseEquations
    from sidtool.solver.spatial import system_arrays as at

    scene, time = system.scene, system.scene.time
    tables = zip(system.bodies, system.arrays.body, strict=True)
    moving = [(data, row) for data, row in tables if row[at.NV]]
    free = any(data.sid.nq != row[at.NV] for data, row in moving)
    if (
        system.n_rows
        or system.n_rotation_counters
        or free
        or system.friction_joints
        or not moving
    ):
        return None
    if system.n_positions != system.n_velocities or any(
        e.control for e in system.forces
    ):
        return None
    clock = float(system.clocks(np.array([time.start]))[0])
    mechanics = DenseEquations(system, time.start, clock)
    n = system.n_velocities
    mechanics.evaluate(np.zeros(n), np.zeros(n))
    names, columns, nodes = [], {}, {}
    for data, row in moving:
        columns[data.name] = slice(row[at.VEL], row[at.VEL] + data.sid.nq)
        body = scene.bodies[data.name]
        assert isinstance(body, SidBody)
        nodes[data.name] = dict(body.markers)
        names += [f"{data.name}.q{k}" for k in data.coordinate_numbers]
    equations = ElasticEquations(
        system, mechanics, mechanics.mass, tuple(names), columns, nodes
    )
    return equations if equations.is_applicable() else None
