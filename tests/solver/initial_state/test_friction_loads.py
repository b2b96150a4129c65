"""Joints whose constant is that of the start hold like those that state it.

The load of a joint with friction is refused where constraints share it, and its
friction where they keep it from moving.
"""

from __future__ import annotations

import math
from typing import Any

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.solver import compile_scene, simulate
from tests.solver.scenes import scene

RUB = {"coefficient": 0.2, "radius": 0.1}
GRAVITY = [0.0, -9.81]


def bar(x: float, y: float, **markers: list[float]) -> dict[str, Any]:
    named = {name: {"position": place} for name, place in markers.items()}
    start = {"position": [x, y]}
    return {"mass": 0.5, "inertia": 0.05, "markers": named, "initial": start}


def pin(one: str, other: str, **more: Any) -> dict[str, Any]:
    return {"type": "revolute", "markers": [one, other], **more}


def parallel_cranks(**third: Any) -> Any:
    """A coupler on two cranks and a third, parallel link: three share its load."""
    coupler = bar(0.3, 1.0, b=[1.0, 0.0], c=[2.0, 0.0])
    return scene(
        {
            "a": bar(0.0, 0.0, end=[0.3, 1.0]),
            "b": bar(1.0, 0.0, end=[0.3, 1.0]),
            "coupler": coupler,
        },
        {
            "ga": pin("ground", "a"),
            "gb": pin("ground.b", "b"),
            "ea": pin("a.end", "coupler", friction=RUB),
            "eb": pin("b.end", "coupler.b"),
            "third": {
                "type": "distance",
                "markers": ["ground.c", "coupler.c"],
                **third,
            },
        },
        end=0.02,
        gravity=GRAVITY,
        ground={
            "markers": {
                n: {"position": [x, 0.0]} for n, x in zip("bc", (1.0, 2.0), strict=True)
            }
        },
    )


def rigid_triangle(**strut: Any) -> Any:
    """Two bars and a strut between them: the pin between the bars cannot turn."""
    return scene(
        {
            "a": bar(0.0, 0.0, end=[1.0, 0.0], middle=[0.5, 0.0]),
            "b": bar(1.0, 0.0, top=[0.3, 0.6]),
        },
        {
            "left": pin("ground", "a"),
            "pin": pin("a.end", "b", friction=RUB),
            "strut": {"type": "distance", "markers": ["a.middle", "b.top"], **strut},
        },
        end=0.02,
        gravity=GRAVITY,
    )


def geared(**gear: Any) -> Any:
    """Two gears of different ratio between two wheels: neither can turn."""
    gears = {
        f"gear{k}": {"type": "gear", "joints": ["ga", "gb"], "ratio": ratio, **gear}
        for k, ratio in enumerate((-2, -1))
    }
    joints = {"ga": pin("ground", "a", friction=RUB), "gb": pin("ground.b", "b")}
    ground = {"markers": {"b": {"position": [1.0, 0.0]}}}
    bodies = {"a": bar(0.0, 0.0), "b": bar(1.0, 0.0)}
    return scene(bodies, joints | gears, end=0.02, gravity=GRAVITY, ground=ground)


@pytest.mark.parametrize("third", [{}, {"length": math.hypot(0.3, 1.0)}])
def test_a_shared_load_is_refused(third: dict[str, float]) -> None:
    with pytest.raises(InputError, match="load of ea is statically indeterminate"):
        simulate(compile_scene(parallel_cranks(**third)))


@pytest.mark.parametrize("strut", [{}, {"length": math.hypot(0.8, 0.6)}])
def test_a_pin_that_a_strut_holds_is_refused(strut: dict[str, float]) -> None:
    with pytest.raises(InputError, match="other joints keep it from moving"):
        simulate(compile_scene(rigid_triangle(**strut)))


@pytest.mark.parametrize("gear", [{}, {"offset": 0.0}])
def test_a_pin_that_gears_hold_is_refused(gear: dict[str, float]) -> None:
    with pytest.raises(InputError, match="other joints keep it from moving"):
        simulate(compile_scene(geared(**gear)))
