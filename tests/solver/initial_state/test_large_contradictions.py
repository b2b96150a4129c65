"""Contradictions in scenes too large to try joints one by one."""

from __future__ import annotations

from typing import Any

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.solver import compile_scene
from sidtool.solver.initial_state.assembly import assemble
from tests.solver.scenes import polynomial

from .networks import LINK, hanging_chain


def turned_twice(k: int, first: list[float], second: list[float]) -> dict[str, Any]:
    """Two drives of one angle, that of joint k."""
    marker = {"marker": f"l{k}.a", "reference": f"l{k - 1}.b", "coordinate": "angle"}
    return {
        "one": {"joint": f"j{k}", "function": polynomial(*first)},
        "other": {**marker, "function": polynomial(*second)},
    }


def test_two_drives_that_contradict_each_other_in_a_long_chain_are_named() -> None:
    """The drives alone, of 170 joints: without either the rest can be met."""
    drives = turned_twice(85, [0.2], [0.1])
    system = compile_scene(hanging_chain(170, drives=drives))
    with pytest.raises(InputError, match="one and other contradict each other") as told:
        assemble(system)
    assert "j8" not in str(told.value)


def test_two_rates_that_contradict_each_other_in_a_long_chain_are_named() -> None:
    drives = turned_twice(31, [0.2, 1.0], [0.2, 1.5])
    system = compile_scene(hanging_chain(110, drives=drives))
    with pytest.raises(InputError, match="one and other contradict each other"):
        assemble(system)


def test_how_far_a_long_chain_ends_from_its_pin_is_told() -> None:
    """The pin is out of reach by 0.7 m: every joint of the chain has a part in that."""
    count, beyond = 160, 0.7
    pin = {"position": [count * LINK + beyond, 0.0]}
    end = {"type": "revolute", "markers": ["ground.pin", f"l{count - 1}.b"]}
    made = hanging_chain(count, joints={"end": end}, ground={"markers": {"pin": pin}})
    with pytest.raises(InputError) as error:
        assemble(compile_scene(made))
    assert "and 157 others contradict each other" in str(error.value)
    assert "l159.b (end) come no nearer than 0.7 m" in str(error.value)
