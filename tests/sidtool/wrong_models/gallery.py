"""Small models with one physical mistake each, and what has to be said of it.

`MISTAKES` holds, by what went wrong, a function that makes the attempt and the words
(patterns, in any order) that name what is wrong, where, and what would do.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import sidtool
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.solver.scenes import polynomial, scene, slender_rod
from tests.steel_bars import bar_data, steel_bar

Attempt = Callable[[], str]
MISTAKES: dict[str, tuple[Attempt, tuple[str, ...]]] = {}


def mistake(*words: str) -> Callable[[Attempt], Attempt]:
    """Enters an attempt under its name."""

    def entered(attempt: Attempt) -> Attempt:
        MISTAKES[attempt.__name__] = attempt, words
        return attempt

    return entered


# What was said -------------------------------------------------------------------


def simulated(described: Any, **sids: SID) -> str:
    """Why a run was refused or stopped, or its diagnostics with their codes."""
    try:
        result = sidtool.simulate(described, sids=sids)
    except InputError as error:
        return str(error)
    except sidtool.SimulationError as error:
        found = error.result.diagnostics if error.result is not None else ()
        return "\n".join([str(error), *(each.line for each in found)])
    verdicts = [body.after for body in result.bodies.values()]
    return "\n".join([*(each.line for each in result.diagnostics), *verdicts])


def converted(data: Any) -> str:
    """Why a conversion was refused, or its diagnostics with their codes."""
    try:
        sid = sid_from_model(validate_data(data, ModelFile))
    except InputError as error:
        return str(error)
    return "\n".join(each.line for each in sid.diagnostics)


# Parts ---------------------------------------------------------------------------


def plate_data(**changes: Any) -> Any:
    """A clamped strip of 1 m x 0.1 m, 10 mm thick."""
    data = bar_data()
    data["geometry"] = {
        "type": "nurbs",
        "degrees": [1, 1],
        "knots": [[0, 0, 1, 1], [0, 0, 1, 1]],
        "control_points": [[[0, 0], [0, 0.1]], [[1, 0], [1, 0.1]]],
        "thickness": 0.01,
    }
    data["discretisation"] = {"type": "q4", "elements": [20, 2]}
    data["frame"] = {"type": "tangent", "marker": "root", "clamp": "left"}
    data["markers"] = {
        "root": {"node": 1, "edge": "left", "at": 0.5},
        "tip": {"node": 2, "edge": "right", "at": 0.5},
    }
    return data | changes


@functools.cache
def bar() -> SID:
    return steel_bar()


def material(**changes: float) -> Any:
    return {"material": bar_data()["material"] | changes}


FLEXIBLE = {"sid": "bar", "markers": {"a": 1, "b": 2}}


def hinge(a: str, b: str) -> dict[str, Any]:
    return {"type": "revolute", "markers": [a, b]}


def clamped(sid: SID, **more: Any) -> str:
    """The flexible bar, clamped to the ground."""
    joints = {"wall": {"type": "fixed", "markers": ["ground", "bar.a"]}}
    body = FLEXIBLE | more.pop("body", {})
    return simulated(scene({"bar": body}, joints, **more), bar=sid)


def pendulum(body: Any = None, drive: Any = None, **more: Any) -> str:
    """A rigid rod on a hinge."""
    drives = {"motor": {"joint": "pin", "function": drive}} if drive else {}
    joints = {"pin": hinge("ground", "rod.a")}
    return simulated(scene({"rod": body or slender_rod(1.0)}, joints, drives, **more))


def slider_crank(change: Callable[[Any], None], sid: SID | None = None) -> str:
    """A crank of 0.1 m, a rod of 1 m (rigid, or with a SID) and a piston, after a
    change."""
    rod = slender_rod(1.0, position=[0.1, 0.0])
    if sid is not None:
        rod = FLEXIBLE | {"initial": {"position": [0.1, 0.0]}}
    described = {
        "bodies": {
            "crank": slender_rod(0.1, 0.3),
            "rod": rod,
            "piston": {"mass": 5.0, "initial": {"position": [1.1, 0.0]}},
        },
        "joints": {
            "bearing": hinge("ground", "crank.a"),
            "crank_pin": hinge("crank.b", "rod.a"),
            "piston_pin": hinge("rod.b", "piston"),
            "slider": {"type": "point_on_line", "markers": ["ground", "piston"]},
        },
        "drives": {"motor": {"joint": "bearing", "function": polynomial(0.0, 6.0)}},
        "ground": {"markers": {}},
        "end": 0.3,
    }
    change(described)
    sids = {"rod": sid} if sid is not None else {}
    return simulated(scene(**described), **sids)
