"""Equilibria, natural modes and inverse dynamics against runs of the same scene."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.solver import inverse_dynamics, linearise, static_equilibrium
from sidtool.solver.system.errors import SimulationError
from tests.metamorphic.generator import functions
from tests.metamorphic.generator.case import (
    Case,
    Table,
    Values,
    compiled,
    measured,
    run,
    times,
)
from tests.metamorphic.generator.poses import Pose
from tests.metamorphic.generator.said import copied, kind, with_table
from tests.metamorphic.generator.scenes import settled
from tests.metamorphic.generator.states import started_at, with_corners

#: Equilibria that a process keeps.
KEPT = 100
#: Speeds of a small motion [m/s], [rad/s], and its length [s].
SMALL, SPAN, ROWS = 1e-4, 1.0, 300
#: Unstable equilibria grow faster than this [1/s]; a run then leaves them by itself.
UNSTABLE = 0.5
#: A motion that decays slower than this [1/s] is not waited for.
SLOW, MOST = 1.0, 16.0


def held(case: Case) -> Case:
    """The scene at rest, its drives and forces as at its start."""
    table = copied(case)
    start = table["time"]["start"]
    for part in (*table["drives"].values(), *table["forces"].values()):
        if "function" in part:
            value = functions.value(part["function"])(start)
            part["function"] = {"type": "constant", "value": value}
    for body in table["bodies"].values():
        for key in ("velocity", "angular_velocity", "elastic_velocity"):
            if key in body["initial"]:
                body["initial"][key] = np.zeros_like(body["initial"][key]).tolist()
    return with_corners(with_table(case, table))


@lru_cache(KEPT)
def equilibrium(case: Case) -> tuple[Case, Values] | None:
    """The scene in its static equilibrium, if there is one, and its measures there."""
    seen = held(case)
    try:
        result = static_equilibrium(compiled(seen, keep_joints=True)).result()
    except SimulationError:
        return None
    values = measured(seen, result)
    return with_table(seen, started_at(seen, seen, values, -1)), values


@lru_cache(KEPT)
def eigenvalues(resting: Case) -> Array:
    system = compiled(resting, keep_joints=True)
    return linearise(system, "start").eigenvalues


def small_motion(case: Case, rng: np.random.Generator) -> float | None:
    """What a small motion about the equilibrium has besides its natural modes.

    Relative to the motion. The equilibrium of `static` is the start of a run, the
    exponentials of `modes` are fitted to what the run records.
    """
    found = equilibrium(case)
    if found is None:
        return None
    resting, exact = found
    values = eigenvalues(resting)
    if values.real.max(initial=0.0) > UNSTABLE:
        return None
    table = copied(resting)
    table["time"] = {"start": 0.0, "end": SPAN, "output_step": SPAN / ROWS}
    _push(table, SMALL, rng)
    moving = settled(with_table(resting, table))
    course = run(moving, rtol=1e-10)
    t = times(moving)
    basis = [np.ones_like(t), t]
    for value in values:
        wave = np.exp(value * t)
        basis += [wave.real, wave.imag]
    A = np.column_stack(basis)
    A /= np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    signals = [v - v[:1] for k, v in course.items() if kind(k) in ("x", "q")]
    joined = np.hstack(signals)
    left = joined - A @ np.linalg.lstsq(A, joined, rcond=1e-12)[0]
    size = np.abs(joined).max()
    return float(np.abs(left).max() / size) if size > 1e-3 * SMALL else None


def rest(case: Case) -> float | None:
    """How far a damped run that begins in the static equilibrium moves away.

    Relative to the size of a metre and of a radian, with dampers on all bodies.
    """
    found = equilibrium(case)
    if found is None or eigenvalues(found[0]).real.max(initial=0.0) > UNSTABLE:
        return None
    course = run(damped(found[0]), rtol=1e-10)
    return max(
        float(np.abs(course[k] - found[1][k][-1]).max()) for k in _places(course)
    )


def settles(case: Case, rng: np.random.Generator) -> float | None:
    """How far from the static equilibrium a damped run ends that began beside it."""
    found = equilibrium(case)
    if found is None:
        return None
    resting, exact = found
    slow = damped(resting)
    rate = -eigenvalues(slow).real.max(initial=-np.inf)
    if not SLOW < rate < np.inf:
        return None
    table = copied(slow)
    end = min(MOST, 16.0 / rate)
    table["time"] = {"start": 0.0, "end": end, "output_step": end}
    _push(table, 0.05, rng)
    course = run(settled(with_table(slow, table)), rtol=1e-8)
    return max(
        float(np.abs(course[k][-1] - exact[k][-1]).max()) for k in _places(course)
    )


def _push(table: Table, size: float, rng: np.random.Generator) -> None:
    for body in table["bodies"].values():
        for key in ("velocity", "angular_velocity", "elastic_velocity"):
            if key in body["initial"]:
                count = np.shape(body["initial"][key])
                body["initial"][key] = (size * rng.normal(size=count)).tolist()


def _places(values: Values) -> list[str]:
    return [name for name in values if kind(name) in ("x", "q")]


def weightless(case: Case, rng: np.random.Generator) -> Case:
    """The case without gravity and functions of time, with each body on a spring that
    is loaded at the start: springs of one scene differ a hundredfold."""
    table, planar = copied(held(case)), case.planar
    table["gravity"] = np.zeros_like(table["gravity"]).tolist()
    for name, body in table["bodies"].items():
        marker = f"{name}.n2" if name in case.sids else name
        firm = float(10.0 ** rng.uniform(1.0, 3.0))
        turning = 0.3 * firm
        keys = ("position", "angle" if planar else "matrix")
        place = {k: v for k, v in body["initial"].items() if k in keys}
        shift = 0.05 * rng.normal(size=len(place["position"]))
        place["position"] = (np.array(place["position"]) + shift).tolist()
        if name in case.sids:
            node = case.sids[name].node(case.node(marker)).position
            away = Pose.of(body["initial"]).then(Pose(node, np.eye(3))).x
            place["position"] = (away[: len(shift)] + shift).tolist()
        table["ground"]["markers"][f"spring{name}"] = place
        stiffness = [firm] * 2 + [turning] if planar else [firm] * 3 + [turning] * 3
        table["forces"][f"spring{name}"] = {
            "type": "bushing",
            "markers": [f"ground.spring{name}", marker],
            "stiffness": stiffness,
            "damping": [0.0] * len(stiffness),
        }
    return with_table(case, table)


def damped(case: Case) -> Case:
    """The case with dampers between each body and the ground."""
    table, planar = copied(case), case.planar
    for name, body in table["bodies"].items():
        marker = f"{name}.n1" if name in case.sids else name
        keys = ("position", "angle" if planar else "matrix")
        place = {k: v for k, v in body["initial"].items() if k in keys}
        table["ground"]["markers"][f"damper{name}"] = place
        damping = [5.0, 5.0, 0.5] if planar else [5.0] * 3 + [0.5] * 3
        if name in case.sids:
            body["damping"] = {"type": "modal", "ratio": 0.3}
        table["forces"][f"damper{name}"] = {
            "type": "bushing",
            "markers": [f"ground.damper{name}", marker],
            "stiffness": [0.0] * len(damping),
            "damping": damping,
        }
    return with_table(case, table)


def inverse(case: Case) -> Values:
    """What inverse dynamics says of a scene in which all that moves is driven."""
    return measured(case, inverse_dynamics(compiled(case, keep_joints=True)))


def with_drive_forces(case: Case) -> Case:
    """The multipliers of the drives are measured, too."""
    loads = tuple(f"{name}.f1" for name in case.table["drives"])
    return replace(case, measures=(*case.measures, *loads))
