"""What is hardly meant is asked about, and what means nothing is not said."""

from __future__ import annotations

from typing import Any

import pytest

from sidtool.formats.result import FlexibleBody
from sidtool.formats.stiffening import Stiffening
from sidtool.solver.advice.asked.unlikely import unlikely
from sidtool.solver.advice.stopping import explained
from tests.solver.scenes import compiled, scene, slender_rod


def asked(gain: float, measured: str, coefficient: float, radius: float) -> list[str]:
    """Of a pendulum on a pin that rubs, with a controller."""
    law = {"type": "pid", "measured": measured, "reference": 0.3, "p": gain}
    motor = {"type": "actuator", "joint": "pin", "function": law}
    pin: dict[str, Any] = {"type": "revolute", "markers": ["ground", "rod.a"]}
    pin["friction"] = {"coefficient": coefficient, "radius": radius}
    described = scene({"rod": slender_rod(1.0)}, {"pin": pin}, forces={"motor": motor})
    return list(unlikely(compiled(described)))


@pytest.mark.parametrize(
    ("gain", "measured", "coefficient", "radius", "words"),
    [
        (9.0, "pin.angle", 0.3, 0.02, ()),
        (9.0, "pin.angle", 1.5, 0.4, ()),
        (-9.0, "rod.angle", 0.3, 0.02, ()),  # what it drives may turn it either way
        (-2.0, "pin.angle", 0.3, 0.02, ("motor drives pin.angle away",)),
        (9.0, "pin.angle", 30.0, 0.02, ("per cent",)),
        (9.0, "pin.angle", 0.3, 20.0, ("in mm",)),
    ],
)
def test_only_what_is_hardly_meant_is_asked_about(
    gain: float, measured: str, coefficient: float, radius: float, words: tuple[str]
) -> None:
    found = asked(gain, measured, coefficient, radius)
    assert len(found) == len(words)
    for text, word in zip(found, words, strict=True):
        assert word in text


def test_percentages_after_lost_inertia_are_not_told() -> None:
    """Loads there are those of no body: it "diverged, -9.5e9 %"."""
    huge = Stiffening(-9.5e7, "rotation", False, diverges=True)
    body = FlexibleBody(10.0, (), huge, found=huge)
    lost = "stopped at t = 1 s; rod has deformed so far that its inertia is lost"
    assert explained(lost, {"rod": body}) == lost
    other = explained("stopped at t = 1 s: a step", {"rod": body})
    assert "deformed without bound" in other and "%" not in other
    plain = Stiffening(-2.5, "rotation", False, diverges=True)
    body = FlexibleBody(10.0, (), plain, found=plain)
    assert "diverges, -250 %" in explained("stopped at t = 1 s", {"rod": body})
