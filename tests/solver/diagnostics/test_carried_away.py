"""Springs and loads that are asked about, and sound ones that are not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.diagnostics import Diagnostic
from sidtool.solver import simulate
from sidtool.solver.diagnostics.implausible_values import stiffness_warnings
from tests.solver.scenes import compiled, scene, slender_rod

GRAVITY = [0.0, -9.81]


def hung(
    stiffness: float,
    end: float,
    spatial: bool,
    mass: float = 10.0,
    guide: dict[str, Any] | None = None,
) -> Any:
    """A body on a spring, which it stretches when it is let go, in a joint if any."""
    places = [0.0, -0.5, 0.0] if spatial else [0.0, -0.5]
    gravity = [*GRAVITY, 0.0] if spatial else GRAVITY
    inertia: Any = [0.1, 0.1, 0.1] if spatial else 0.1
    body = {"mass": mass, "inertia": inertia, "initial": {"position": places}}
    spring = {"type": "spring_damper", "stiffness": stiffness, "rest": 0.5}
    spring |= {"joint": "guide"} if guide else {"markers": ["ground", "body"]}
    more = {"dimension": "spatial"} if spatial else {}
    described = scene(
        {"body": body},
        {"guide": guide} if guide else {},
        forces={"spring": spring},
        gravity=gravity,
        end=end,
        **more,
    )
    return compiled(described)


def asked(system: Any) -> list[Diagnostic]:
    found = simulate(system).diagnostics
    return [each for each in found if each.code in ("N217", "N218")]


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize(
    ("stiffness", "end", "mass", "slip"),
    [
        (2e3, 1.0, 10.0, False),
        (20.0, 1.5, 10.0, True),  # 2 N/mm for 20 N/mm
        (20.0, 1.5, 0.02, False),  # a letter balance
        (150.0, 2.0, 10.0, False),  # soft: 0.65 m, but it swings within the run
        (20.0, 0.2, 10.0, False),  # too short to tell
    ],
)
def test_a_spring_that_lets_its_load_fall(
    stiffness: float, end: float, mass: float, slip: bool, spatial: bool
) -> None:
    """Asked about where m g / k is beyond the mechanism and 2 pi sqrt(m / k) beyond the
    run, and it has fallen."""
    found = asked(hung(stiffness, end, spatial, mass))
    assert len(found) == int(slip)
    if slip:
        period = 2.0 * np.pi * np.sqrt(mass / stiffness)
        assert found[0].code == "N217" and found[0].subject == "spring"
        assert found[0].data["period"] == pytest.approx(period)
        sag = mass * 9.81 / stiffness
        fall = sag * (1.0 - np.cos(2.0 * np.pi * end / period))
        assert found[0].data["displacement"] == pytest.approx(fall, rel=1e-3)
        assert 0.5 < found[0].data["sag"] < sag  # by the mean acceleration


@pytest.mark.parametrize("stiffness", [2e3, 20.0])
@pytest.mark.parametrize("spatial", [False, True])
def test_a_spring_in_a_guide_is_asked_about_as_a_free_one(
    spatial: bool, stiffness: float
) -> None:
    """The same fall, along a prismatic joint in place of a line of markers."""
    guide = {
        "type": "prismatic",
        "markers": ["ground", "body"],
        "axis": [0.0, -1.0, 0.0] if spatial else [0.0, -1.0],
    }
    free, guided = (asked(hung(stiffness, 1.5, spatial, guide=g)) for g in ({}, guide))
    assert guided == free
    assert len(free) == int(stiffness < 1e3)


def test_weak_springs_of_driven_and_resting_parts_are_sound() -> None:
    """One that only brings back what a drive moves, and one beside a strong one."""
    rod = slender_rod(1.0)
    weak = {"type": "spring_damper", "joint": "pin", "stiffness": 1e-3}
    strong = {"type": "spring_damper", "joint": "pin", "stiffness": 900.0}
    pin = {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}}
    piece = {"from": 0.0, "coefficients": [0.0, 40.0]}
    drive = {"joint": "pin", "function": {"type": "polynomial", "pieces": [piece]}}
    driven = scene({"rod": rod}, pin, {"motor": drive}, forces={"back": weak}, end=0.5)
    assert asked(compiled(driven)) == []
    held = {"back": weak, "hold": strong}
    beside = scene({"rod": rod}, pin, forces=held, gravity=GRAVITY, end=0.5)
    assert asked(compiled(beside)) == []


def test_a_pendulum_with_a_weak_torsion_spring_is_sound() -> None:
    weak = {"type": "spring_damper", "joint": "pin", "stiffness": 0.01}
    pin = {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}}
    described = scene(
        {"rod": slender_rod(1.0)}, pin, forces={"back": weak}, gravity=GRAVITY, end=1.0
    )
    assert asked(compiled(described)) == []


def test_fast_bodies_without_loads_are_sound() -> None:
    """A satellite that starts at 7600 m/s, with a thruster of 1 N."""
    body = {"mass": 500.0, "inertia": 90.0, "initial": {"velocity": [7600.0, 0.0]}}
    thrust = {"type": "force", "marker": "sat", "force": [1.0, 0.0]}
    described = scene({"sat": body}, {}, forces={"thruster": thrust}, end=1.0)
    assert asked(compiled(described)) == []


@pytest.mark.parametrize(
    ("element", "wanted"),
    [
        ({"stiffness": 1e9, "damping": 1e4}, []),  # a stiff bearing
        ({"stiffness": 1e14}, ["N210"]),
        ({"damping": 1e9}, ["N211"]),
    ],
)
def test_only_what_nobody_builds_is_too_stiff(
    element: dict[str, float], wanted: list[str]
) -> None:
    bodies = {"body": {"mass": 10.0, "inertia": 0.1}}
    spring = {"type": "spring_damper", "markers": ["ground.o", "body"], **element}
    ground = {"markers": {"o": {"position": [0.3, 0.4]}}}
    described = scene(bodies, {}, forces={"spring": spring}, ground=ground)
    found = list(stiffness_warnings(compiled(described)))
    assert [each.code for each in found] == wanted


def test_a_load_in_wrong_units_makes_a_body_too_fast() -> None:
    """1e6 N on 1 kg for 10 ms: 10 km/s; below 2 km/s nothing is asked."""
    body = {"mass": 1.0, "inertia": 1.0}
    for force, wanted in ((1e6, ["N218"]), (1e5, [])):
        push = {"type": "force", "marker": "body", "force": [force, 0.0]}
        system = compiled(scene({"body": body}, {}, forces={"push": push}, end=0.01))
        found = asked(system)
        assert [each.code for each in found] == wanted
        for each in found:
            assert each.subject == "body" and each.data["loads"] == ("push",)
            assert each.data["speed"] == pytest.approx(1e4)
