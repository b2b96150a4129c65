"""Motions that are known beside the solver, small and fast ones, and errors of runs.

Each case is a scene and its motion: in closed form, or from equations of its own that
SciPy's DOP853 integrates far more tightly than any run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

from sidtool.formats.base.sid import Array, Taylor
from sidtool.formats.result import Result
from sidtool.formats.sid_files import read_sid
from sidtool.solver.system.system import System
from tests.places import SLIDER_CRANK
from tests.solver.scenes import compiled, scene, slender_rod

Motion = dict[str, Array]
#: Kinds of outputs: errors are relative to the largest motion of one.
KINDS = {"x": "place", "y": "place", "z": "place", "angle": "angle"}
FINE = 1e-13


@dataclass(frozen=True)
class Case:
    """A scene, and its recorded outputs as functions of times (nt,)."""

    make: Callable[[], System]
    motion: Callable[[Array], Motion]


def relative_error(case: Case, result: Result) -> float:
    """The largest error of each kind of output, relative to its largest variation."""
    exact = case.motion(result.t)
    ranges: dict[str, float] = {}
    errors: dict[str, float] = {}
    for name, values in exact.items():
        kind = KINDS.get(name.rsplit(".", 1)[1], "deformation")
        off = float(np.abs(result[name] - values).max())
        errors[kind] = max(errors.get(kind, 0.0), off)
        moved = float(np.abs(values - values[0]).max())
        ranges[kind] = max(ranges.get(kind, 0.0), moved)
    return max(error / ranges[kind] for kind, error in errors.items())


def solve(slope: Any, start: list[float], times: Array) -> Array:
    found = solve_ivp(
        slope, (0.0, times[-1]), start, "DOP853", times, rtol=FINE, atol=1e-16
    )
    assert found.success
    return np.asarray(found.y)


# --- oscillators ------------------------------------------------------------------

#: Of all oscillators [rad/s], and how long they swing [s].
OMEGA, SWING = 20.0, 2.0


def on_rail(amplitude: float, away: float, start: str) -> Case:
    """A rod of 1 m and 2 kg on a rail, `away` from the origin, held by a spring.

    It starts displaced, struck, or at rest under a load.
    """
    rod = slender_rod(1.0, 2.0, position=[away, 0.0])
    forces: dict[str, Any] = {
        "spring": {
            "type": "spring_damper",
            "joint": "rail",
            "stiffness": 2.0 * OMEGA**2,
        }
    }
    if start == "displaced":
        rod["initial"]["position"] = [away + amplitude, 0.0]
    elif start == "struck":
        rod["initial"]["velocity"] = [OMEGA * amplitude, 0.0]
    else:
        push = [2.0 * OMEGA**2 * amplitude, 0.0]
        forces["push"] = {"type": "force", "marker": "rod.a", "force": push}

    def motion(t: Array) -> Motion:
        shape = {
            "displaced": np.cos(OMEGA * t),
            "struck": np.sin(OMEGA * t),
            "loaded": 1.0 - np.cos(OMEGA * t),
        }
        return {"rod.x": away + amplitude * shape[start]}

    def make() -> System:
        return compiled(
            scene(
                {"rod": rod},
                {"rail": {"type": "prismatic", "markers": ["ground.foot", "rod.a"]}},
                end=SWING,
                steps=40,
                record=["rod.x"],
                ground={"markers": {"foot": {"position": [away, 0.0]}}},
                forces=forces,
            )
        )

    return Case(make, motion)


def on_hinge(amplitude: float) -> Case:
    """A rod of 1 m on a hinge with a spring about it."""
    stiffness = 2.0 / 3.0 * OMEGA**2

    def make() -> System:
        spring = {"type": "spring_damper", "joint": "hinge", "stiffness": stiffness}
        return compiled(
            scene(
                {"rod": slender_rod(1.0, 2.0, angle=amplitude)},
                {"hinge": {"type": "revolute", "markers": ["ground", "rod.a"]}},
                end=SWING,
                steps=40,
                record=["rod.angle", "rod.b.y"],
                forces={"spring": spring},
            )
        )

    def motion(t: Array) -> Motion:
        angle = amplitude * np.cos(OMEGA * t)
        return {"rod.angle": angle, "rod.b.y": np.sin(angle)}

    return Case(make, motion)


def on_bushing(amplitude: float) -> Case:
    """A rod of 1 m in space on a bushing at its centre of mass, pulled aside."""
    aside = amplitude * np.array([0.6, 0.0, 0.8])

    def make() -> System:
        rod = {
            "mass": 2.0,
            "inertia": [0.01, 0.2, 0.2],
            "markers": {"end": {"position": [0.5, 0.0, 0.0]}},
            "initial": {"position": aside.tolist()},
        }
        k = 2.0 * OMEGA**2
        bushing = {
            "type": "bushing",
            "markers": ["ground", "rod"],
            "stiffness": [k, k, k, 10.0, 20.0, 30.0],
        }
        return compiled(
            scene(
                {"rod": rod},
                end=SWING,
                steps=40,
                record=["rod.x", "rod.z"],
                dimension="spatial",
                forces={"bushing": bushing},
            )
        )

    def motion(t: Array) -> Motion:
        swing = np.cos(OMEGA * t)
        return {"rod.x": aside[0] * swing, "rod.z": aside[2] * swing}

    return Case(make, motion)


def clamped(amplitude: float) -> Case:
    """The founding rod, undamped, held at its first node: it vibrates in two modes."""
    sid = read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")
    sid = replace(sid, De=Taylor(np.zeros_like(sid.De.m0)))
    squares, modes = eigh(sid.Ke.m0, sid.Me.m0)
    shapes = modes[:, :2] / np.abs(modes[:, :2]).max(axis=0) * [1.0, -0.3] * amplitude
    omega = np.sqrt(squares[:2])
    names = [f"rod.q{i + 1}" for i in range(sid.nq)]

    def make() -> System:
        body = {
            "sid": "-",
            "markers": {"foot": 1},
            "initial": {"elastic": shapes.sum(axis=1).tolist()},
        }
        return compiled(
            scene(
                {"rod": body},
                {"clamp": {"type": "fixed", "markers": ["ground", "rod.foot"]}},
                end=12.0 * np.pi / omega[0],
                steps=40,
                record=names,
            ),
            rod=sid,
        )

    def motion(t: Array) -> Motion:
        swing = shapes @ np.cos(np.outer(omega, t))
        return dict(zip(names, swing, strict=True))

    return Case(make, motion)
