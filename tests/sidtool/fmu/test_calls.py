"""Calls of kernels in C have the arguments of the kernels; no compiler is needed."""

from __future__ import annotations

import re
from importlib.resources import files

import pytest

from sidtool.fmu import linking


def arguments(source: str, begin: int) -> list[str]:
    """Arguments of a call whose parenthesis opens before `begin`."""
    depth, found = 0, [""]
    for letter in source[begin:]:
        depth += (letter in "([") - (letter in ")]")
        if depth < 0:
            break
        if letter == "," and depth == 0:
            found.append("")
        else:
            found[-1] += letter
    return [text.strip() for text in found]


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("integrator", linking.UNIT_INTEGRATORS)
def test_calls_pass_what_kernels_take(planar: bool, integrator: str) -> None:
    """ARRAY1 to ARRAY3 pass an array with as many dimensions, all else one value."""
    kernels = {
        name: [getattr(argument, "ndim", 0) for argument in signature.args]
        for name, _, signature in linking.library_kernels(planar, integrator)
    }
    source = (files("sidtool.fmu") / "plant.c").read_text(encoding="utf-8")
    calls = list(re.finditer(rf"\b({linking.PREFIX}\w+)\(", source))
    assert len(calls) >= 7
    for call in calls:
        given = [
            int(text[5]) if text.startswith("ARRAY") else 0
            for text in arguments(source, call.end())
        ]
        assert given == kernels[call[1]], call[1]
