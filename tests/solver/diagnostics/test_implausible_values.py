"""Values that are hardly meant have a diagnostic; values beside them have none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.diagnostics import Diagnostic
from sidtool.solver.diagnostics.implausible_values import implausible_value_warnings
from tests.solver.scenes import compiled, polynomial, scene, slender_rod
from tests.steel_bars import steel_bar

PIN = {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}}


def found(described: Any, **sids: Any) -> list[Diagnostic]:
    return list(implausible_value_warnings(compiled(described, **sids)))


def pendulum(rod: Any = None, drive: Any = None, **more: Any) -> list[Diagnostic]:
    """A rod of 1 m on a pin."""
    drives = {"motor": {"joint": "pin"} | drive} if drive else {}
    return found(scene({"rod": rod or slender_rod(1.0)}, PIN, drives, **more))


@pytest.mark.parametrize(("gravity", "wanted"), [(9810.0, ["N201"]), (9.81, [])])
def test_gravity_in_other_units(gravity: float, wanted: list[str]) -> None:
    diagnostics = pendulum(gravity=[0.0, -gravity])
    assert [each.code for each in diagnostics] == wanted
    for each in diagnostics:
        assert each.data["gravity"] == gravity and each.units["gravity"] == "m/s2"
        assert each.data["ratio"] == pytest.approx(1000.0)


@pytest.mark.parametrize(
    ("angle", "subject"), [(90.0, "bodies.rod.initial.angle"), (61.0, ""), (1.5, "")]
)
def test_angles_in_degrees(angle: float, subject: str) -> None:
    """Whole multiples of 30 or 45 above one turn."""
    diagnostics = pendulum(slender_rod(1.0, angle=angle))
    assert [(each.code, each.subject) for each in diagnostics] == (
        [("N202", subject)] if subject else []
    )
    for each in diagnostics:
        assert each.severity == "info" and each.data["value"] == angle
        assert each.data["radians"] == pytest.approx(np.pi / 2)


def test_drives_and_controllers_in_degrees() -> None:
    """The end of a smooth step, the start of a servo, the reference of a controller."""
    rise = {"type": "smooth_step", "from": 0.0, "to": 1.0, "end": 360.0}
    spin = {"type": "constant", "value": 7.0}
    drives = ({"function": rise}, {"of": "rate", "start": 90.0, "function": spin})
    for drive, value in zip(drives, (360.0, 90.0), strict=True):
        (each,) = pendulum(drive=drive)
        assert (each.code, each.subject) == ("N202", "drives.motor")
        assert each.data["value"] == value
    law = {"type": "pid", "measured": "pin.angle", "reference": 45.0, "p": 1.0}
    motor = {"type": "actuator", "joint": "pin", "function": law}
    (each,) = pendulum(forces={"motor": motor})
    assert (each.code, each.subject) == ("N202", "reference of motor")


@pytest.mark.parametrize(("length", "wanted"), [(300.0, ["N203"]), (30.0, [])])
def test_joined_bodies_of_very_different_size(length: float, wanted: list[str]) -> None:
    """300 m and 1 m; 30 to 1 is possible."""
    bodies = {"rod": slender_rod(1.0), "arm": slender_rod(length, position=[1.0, 0.0])}
    joints = PIN | {"elbow": {"type": "revolute", "markers": ["rod.b", "arm.a"]}}
    diagnostics = found(scene(bodies, joints))
    assert [each.code for each in diagnostics] == wanted
    for each in diagnostics:
        assert (each.subject, each.data["other"]) == ("arm", "rod")
        assert each.data["joint"] == "elbow"
        assert each.data["size"] == pytest.approx(length)
        assert each.data["other_size"] == pytest.approx(1.0)


@pytest.mark.parametrize(("largest", "wanted"), [(2.1, ["N204"]), (2.0, [])])
def test_moments_of_inertia_of_no_body(largest: float, wanted: list[str]) -> None:
    """The largest principal moment is at most the sum of the two others."""
    body = {"mass": 1.0, "inertia": [1.0, largest, 1.0]}
    diagnostics = found(scene({"arm": body}, dimension="spatial"))
    assert [each.code for each in diagnostics] == wanted
    for each in diagnostics:
        assert each.subject == "arm"
        assert each.data["moments"] == pytest.approx([1.0, 1.0, largest])


@pytest.mark.parametrize(("inertia", "wanted"), [(8.3e4, ["N205"]), (83.0, [])])
def test_inertia_in_other_units(inertia: float, wanted: list[str]) -> None:
    """kg mm2 in place of kg m2: a radius of gyration of 289 m in a rod of 1 m."""
    diagnostics = pendulum(slender_rod(1.0) | {"inertia": inertia})
    assert [each.code for each in diagnostics] == wanted
    for each in diagnostics:
        assert each.subject == "rod" and each.data["extent"] == pytest.approx(1.0)
        assert each.data["radius"] == pytest.approx(np.sqrt(inertia), rel=1e-3)


@pytest.mark.parametrize("key", ["stiffness", "damping"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_negative_stiffness_and_damping(key: str, sign: float) -> None:
    spring = {"type": "spring_damper", "joint": "pin", "stiffness": 5.0, "damping": 1.0}
    spring[key] = sign * 3.0
    diagnostics = pendulum(forces={"spring": spring})
    if sign > 0.0:
        assert diagnostics == []
        return
    (each,) = diagnostics
    assert (each.code, each.subject) == ("N206", "spring")
    assert (each.data["key"], each.data["value"]) == (key, -3.0)


@pytest.mark.parametrize("end", ["rod.b", "ground"])
def test_a_spring_between_two_markers_of_a_rigid_body(end: str) -> None:
    spring = {"type": "spring_damper", "markers": ["rod.a", end], "stiffness": 5.0}
    diagnostics = pendulum(forces={"spring": spring})
    assert [(each.code, each.subject) for each in diagnostics] == (
        [("N207", "spring")] if end == "rod.b" else []
    )
    assert all(each.data["body"] == "rod" for each in diagnostics)


@pytest.mark.parametrize(("end", "wanted"), [(1e-5, ["N208"]), (1.0, [])])
def test_a_run_too_short_for_any_vibration(end: float, wanted: list[str]) -> None:
    """The first mode of a clamped steel bar, 20 mm high and 1 m long: 16.7 Hz."""
    joints = {"wall": {"type": "fixed", "markers": ["ground", "bar.a"]}}
    body = {"sid": "-", "markers": {"a": 1}}
    diagnostics = found(scene({"bar": body}, joints, end=end), bar=steel_bar())
    assert [each.code for each in diagnostics] == wanted
    first = 1.8751**2 * np.sqrt(2.1e11 / 7850.0 * 0.02**2 / 12.0) / (2.0 * np.pi)
    for each in diagnostics:
        assert each.subject == "bar" and each.data["span"] == end
        assert each.data["periods"] == pytest.approx(end * first, rel=1e-2)


@pytest.mark.parametrize(("rate", "wanted"), [(3000.0, ["N209"]), (300.0, [])])
def test_rates_in_revolutions_per_minute(rate: float, wanted: list[str]) -> None:
    diagnostics = pendulum(drive={"function": polynomial(0.0, rate)}, end=0.01)
    assert [each.code for each in diagnostics] == wanted
    for each in diagnostics:
        assert each.subject == "motor" and each.data["rate"] == pytest.approx(rate)
        assert each.data["radians"] == pytest.approx(rate * 2.0 * np.pi / 60.0)
        assert each.data["speed"] == pytest.approx(rate * float(each.data["size"]))
