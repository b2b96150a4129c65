"""Bounds of errors, where there are any: bodies whose frames are fully prescribed.

Their elastic coordinates obey M q'' + D(t) q' + K(t) q = f(t), theory, section 15. Any
motion u leaves a residual R there, and the norm of the energy of its error obeys eq.
(36). The motion here is a tight run of the chosen model, lifted to all shape functions
and interpolated between its states; the static answer to its residual is taken out of
the error before that is bounded. So shape functions and terms that were left out are
covered. How far the chosen run is from that motion is seen at the output times.

Source: Ruiner, Fehr, Haasdonk, Eberhard, Acta Mech. Sin. 28 (2012) 854, for linear
systems of second order with a constant stiffness.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.linalg import eigh

from sidtool.formats.scene import parse_output
from sidtool.formats.scene.outputs import ELASTIC
from sidtool.formats.sid import SID, Array
from sidtool.formats.stress import COMPONENTS

from .candidates import Choice, as_scene, recording
from .elastic_equations import Elastic, elastic_equations
from .runs import Runs, Setting

#: How the motion that bounds start from is integrated.
TIGHT = Setting("radau13", 1e-11)
#: Intervals between states of the chosen run, doubled while that helps by `HELPS`.
FEWEST, MOST, HELPS = 128, 4096, 0.7


@dataclass(frozen=True, eq=False)
class _Norms:
    """How an output is a linear function of elastic coordinates, or of their rates.

    rows : (k, n); the error of the output is at most the length of rows @ error
    """

    rows: Array
    rates: bool


def bounds(
    runs: Runs, whole: Choice, chosen: Choice, setting: Setting
) -> dict[str, float]:
    """Bounds of the errors of outputs against all that the SIDs have, by name.

    Empty where frames are not prescribed or the equations are not linear; outputs that
    are no linear functions of the elastic coordinates have none.

    Parameters
    ----------
    whole : all shape functions and terms
    chosen, setting : the run that is judged; it is compared with a tight one
    """
    scene, sids = runs.scene, runs.sids
    system = runs.compile(recording(as_scene(scene, whole, sids), ()), sids)
    full = elastic_equations(system)
    if full is None:
        return {}
    norms = {n: _norms(n, full, sids) for n in runs.names}
    told = {n: norm for n, norm in norms.items() if norm is not None}
    tight, loose = runs.attempt(chosen, TIGHT), runs.attempt(chosen, setting)
    if not told or tight is None:
        return {}
    pairs = zip(runs.names, runs.between((chosen, tight), (chosen, loose)), strict=True)
    integration = {name: float(error) for name, error in pairs}
    found: dict[str, float] = {}
    count = _fewest(full, chosen)
    while count <= MOST:
        finer = _bounds(full, runs, chosen, told, count)
        helped = not found or any(finer[n] < HELPS * found[n] for n in told)
        found = {n: min(finer[n], found.get(n, np.inf)) for n in told}
        if not helped:
            break
        count *= 2
    return {n: bound + integration[n] for n, bound in found.items()}


def _fewest(full: Elastic, chosen: Choice) -> int:
    """Intervals that resolve the fastest shape function that is kept."""
    kept = [
        full.names.index(f"{n}.q{k}") for n, numbers in chosen.kept for k in numbers
    ]
    if not kept:
        return FEWEST
    some = np.ix_(kept, kept)
    squares = eigh(full.samples.symmetric[0][some], full.M[some], eigvals_only=True)
    time = full.system.scene.time
    return int(
        np.clip((time.end - time.start) * np.sqrt(squares[-1]), FEWEST, MOST / 2)
    )


def _norms(name: str, full: Elastic, sids: Mapping[str, SID]) -> _Norms | None:
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
    full: Elastic, runs: Runs, chosen: Choice, norms: Mapping[str, _Norms], count: int
) -> dict[str, float]:
    """Bounds of a tight run of the chosen model, known at `count` + 1 times."""
    time = runs.scene.time
    t = np.linspace(time.start, time.end, count + 1)
    states = _lifted(full, runs, chosen, t)
    K = full.samples.at(t, full.samples.symmetric)
    residual = full.residual(t, *states)
    static = make_interp_spline(t, np.linalg.solve(K, residual[..., None])[..., 0], k=5)
    halves = 0.5 * (t[1:] + t[:-1])
    there = [
        full.residual(times, *(x + static(times, nu=k) for k, x in enumerate(motion)))
        for times, motion in ((t, states), (halves, _halfway(t, *states)))
    ]
    size, middle = (full.size_of(r) for r in there)
    pushes = (t[1:] - t[:-1]) * (size[1:] + 4.0 * middle + size[:-1]) / 6.0
    start = full.start()
    errors = [states[k][0] + static(t[0], nu=k) - start[k] for k in (0, 1)]
    y = np.empty(len(t))
    y[0] = np.sqrt(errors[1] @ full.M @ errors[1] + errors[0] @ K[0] @ errors[0])
    growth = full.growths(t)
    for k, push in enumerate(pushes):
        y[k + 1] = (y[k] + push) * growth[k]
    return {n: _worst(norm, full, static, t, K, y) for n, norm in norms.items()}


def _worst(
    norm: _Norms, full: Elastic, static: object, t: Array, K: Array, y: Array
) -> float:
    """|c s| and |c| in the inverse metric times y, eq. (37), at its largest in time."""
    taken = np.linalg.norm(static(t, nu=int(norm.rates)) @ norm.rows.T, axis=1)  # type: ignore[operator]
    metric = np.broadcast_to(full.M, K.shape) if norm.rates else K
    squares = norm.rows @ np.linalg.solve(metric, norm.rows.T[None])
    return float((taken + np.sqrt(np.linalg.eigvalsh(squares)[:, -1]) * y).max())


def _lifted(
    full: Elastic, runs: Runs, chosen: Choice, t: Array
) -> tuple[Array, Array, Array]:
    """q, q', q'' (nt, n) of all shape functions, of those that the model keeps."""
    from sidtool.solver import simulate

    less = recording(as_scene(runs.scene, chosen, runs.sids), ())
    times = {"output_step": None, "output_times": tuple(t.tolist())}
    time = less.time.model_copy(update=times)
    system = runs.compile(less.model_copy(update={"time": time}), runs.sids)
    found = simulate(system, integrator=TIGHT.integrator, rtol=TIGHT.rtol)
    kept = [full.names.index(name) for name in found.position_names]
    own = elastic_equations(system)
    q, v, a = (np.zeros((len(t), full.n)) for _ in range(3))
    q[:, kept], v[:, kept] = found.positions, found.velocities
    if own is not None and kept:
        a[:, kept] = own.accelerations(t, found.positions, found.velocities)
    return q, v, a


def _halfway(t: Array, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Position, rate and acceleration in the middle of each interval, of degree 5."""
    h = (t[1:] - t[:-1])[:, None]
    q0, q1, v0, v1, a0, a1 = q[:-1], q[1:], v[:-1], v[1:], a[:-1], a[1:]
    place = (q0 + q1) / 2 + 5 * h / 32 * (v0 - v1) + h**2 / 64 * (a0 + a1)
    rate = 15 / 8 * (q1 - q0) / h - 7 / 16 * (v0 + v1) + h / 32 * (a1 - a0)
    return place, rate, 1.5 * (v1 - v0) / h - (a0 + a1) / 4
