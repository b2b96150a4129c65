"""Outputs that states determine are evaluated from files of runs with Python
callables.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.pipeline.extra_outputs import outputs_at
from sidtool.plot.results import draw_result
from tests.codes import unwrapped

R, INERTIA, MASS, STIFFNESS = 0.4, 0.05, 1.5, 60.0
OMEGA = np.sqrt(STIFFNESS / MASS)
LEFT = {"type": "callable"}


def angle(t: float) -> float:
    """Neither a polynomial nor a sine."""
    return float(0.3 * np.sin(5.0 * t) * np.exp(-t))


def angle_acceleration(t: np.ndarray) -> np.ndarray:
    return 0.3 * np.exp(-t) * (-24.0 * np.sin(5.0 * t) - 10.0 * np.cos(5.0 * t))


def pulling(t: float) -> float:
    return float(2.0 / (1.0 + t))


def block(record: list[str], **force: Any) -> dict[str, Any]:
    """On a straight line, 0.02 m from where its spring, if it has one, is at rest."""
    return {
        "dimension": "planar",
        "gravity": [0.0, 0.0],
        "time": {"end": 1.0, "output_step": 0.02},
        "bodies": {
            "block": {"mass": MASS, "inertia": 1.0, "initial": {"position": [0.02, 0]}}
        },
        "joints": {
            "slide": {
                "type": "prismatic",
                "markers": ["ground", "block"],
                "axis": [1.0, 0.0],
            }
        },
        "forces": {"pull": {**force}},
        "outputs": {"record": record},
    }


WHEEL: dict[str, Any] = {
    "dimension": "planar",
    "gravity": [0.0, 0.0],
    "time": {"end": 2.0, "output_step": 0.05},
    "bodies": {
        "wheel": {
            "mass": 2.0,
            "inertia": INERTIA,
            "markers": {"rim": {"position": [R, 0.0]}},
        }
    },
    "joints": {"hub": {"type": "revolute", "markers": ["ground", "wheel"]}},
    "drives": {
        "motor": {"joint": "hub", "function": {"type": "constant", "value": 0.0}}
    },
    "outputs": {"record": ["wheel.rim.x"]},
}


def filed(result: sidtool.Result, folder: Path) -> sidtool.Result:
    result.save(folder / "r.h5")
    return sidtool.read(folder / "r.h5")


@pytest.mark.parametrize("start", ["the file says another motion", "it leaves it open"])
def test_a_drive_of_a_callable_is_known_afterwards(start: str, tmp_path: Path) -> None:
    """The file's own function was evaluated: a wheel at rest in place of one that
    swings."""
    scene = sidtool.Scene(**WHEEL)
    if "open" in start:
        scene = scene.with_({"motor.function": {"type": "callable"}})
    result = filed(scene.simulate(drives={"motor": angle}), tmp_path)
    f = np.array([angle(t) for t in result.t])
    np.testing.assert_allclose(result["wheel.rim.y"], R * np.sin(f), atol=1e-10)
    torque = INERTIA * angle_acceleration(result.t)
    np.testing.assert_allclose(result["motor.mz"], torque, atol=1e-7)
    t = np.linspace(0.0, 2.0, 333)
    between = outputs_at(result, ["wheel.rim.y", "motor.mz"], t)
    f = np.array([angle(x) for x in t])
    np.testing.assert_allclose(between["wheel.rim.y"], R * np.sin(f), atol=1e-10)
    torque = INERTIA * angle_acceleration(t)
    np.testing.assert_allclose(between["motor.mz"], torque, atol=1e-6)
    again = sidtool.Scene.of_result(result).simulate()  # needs no program any more
    np.testing.assert_array_equal(again.values, result.values)


def test_a_force_of_a_callable_is_known_afterwards(tmp_path: Path) -> None:
    force = {"type": "force", "marker": "block", "force": [3.0, 0.0]}
    scene = sidtool.Scene(**block(["block.x"], **force))
    result = filed(scene.simulate(forces={"pull": pulling}), tmp_path)
    expected = 3.0 * np.array([pulling(t) for t in result.t])
    np.testing.assert_allclose(result["block.ax"], expected / MASS, rtol=1e-9)
    np.testing.assert_allclose(result["pull.fx"], expected, rtol=1e-12)
    v = 6.0 * np.log1p(result.t) / MASS
    np.testing.assert_allclose(result["block.vx"], v, atol=1e-6)


@pytest.fixture(scope="module")
def sprung() -> sidtool.Result:
    """A law of a program that is a spring."""
    scene = sidtool.Scene(
        **block(["block.x", "block.ax"], type="actuator", joint="slide", function=LEFT)
    )
    law = sidtool.Law(lambda t, y: -STIFFNESS * y[0], ["slide.displacement"])
    return scene.simulate(forces={"pull": law}, rtol=1e-9)


def test_outputs_without_a_law_need_no_law(
    sprung: sidtool.Result, tmp_path: Path
) -> None:
    result = filed(sprung, tmp_path)
    phase = OMEGA * result.t
    np.testing.assert_allclose(result["block.x"], 0.02 * np.cos(phase), atol=1e-9)
    speed = -0.02 * OMEGA * np.sin(phase)
    np.testing.assert_allclose(result["block.vx"], speed, atol=1e-8)
    np.testing.assert_allclose(result["energy.kinetic"], MASS * speed**2 / 2, atol=1e-8)
    t = np.linspace(0.0, 1.0, 777)
    between = outputs_at(result, ["slide.displacement", "block.vx"], t)
    exact = 0.02 * np.cos(OMEGA * t)
    np.testing.assert_allclose(between["slide.displacement"], exact, atol=2e-8)
    speed = -0.02 * OMEGA * np.sin(OMEGA * t)
    np.testing.assert_allclose(between["block.vx"], speed, atol=5e-5)


def test_outputs_that_need_the_law_are_refused_by_name(
    sprung: sidtool.Result, tmp_path: Path
) -> None:
    result = filed(sprung, tmp_path)
    names = ["block.ay", "slide.fy", "pull.fx", "pull.value"]
    for name in names:
        with pytest.raises(InputError, match=rf"{name} depends on the law of pull"):
            result[name]
    own = sprung.outputs(names)  # the run itself has the law
    law = sidtool.Law(lambda t, y: -STIFFNESS * y[0], ["slide.displacement"])
    given = sidtool.outputs(result, names, forces={"pull": law})
    for name in names:
        assert np.isfinite(own[name]).all()
        np.testing.assert_allclose(given[name], own[name], atol=1e-12)


def test_recorded_accelerations_are_drawn_without_the_law(
    sprung: sidtool.Result, tmp_path: Path
) -> None:
    result = filed(sprung, tmp_path)
    page, _ = draw_result(result)
    curves = {axes.get_ylabel(): axes.lines[0] for axes in page.axes}
    (line,) = [line for label, line in curves.items() if "block.ax" in label]
    exact = -0.02 * OMEGA**2 * np.cos(OMEGA * line.get_xdata())
    chord = 0.02 * OMEGA**4 * 0.02**2 / 8  # straight lines between output times
    assert np.abs(line.get_ydata() - exact).max() < 1.01 * chord + 1e-6


def test_commands_on_the_file_of_such_a_run(
    sprung: sidtool.Result,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    sprung.save("r.h5")
    for words in (
        "outputs r.h5 --add block.v*,slide.displacement_rate -o more.h5",
        "animate r.h5 -o page.html --outputs block.vx",
        "export r.h5 -o m.vtkhdf",
        "report r.h5 -o m.html",
        "plot r.h5 -o m.svg --kind energy",
    ):
        assert run(words.split()) == 0, unwrapped(capsys.readouterr().err)
    speed = sidtool.read("more.h5")["block.vx"]
    phase = OMEGA * sprung.t
    np.testing.assert_allclose(speed, -0.02 * OMEGA * np.sin(phase), atol=1e-8)
    capsys.readouterr()
    assert run(["outputs", "r.h5", "--add", "slide.fy"]) == 2
    assert "slide.fy depends on the law of pull" in unwrapped(capsys.readouterr().err)


def test_sampled_laws_are_drawn_between_output_times(tmp_path: Path) -> None:
    """Positions and velocities between output times need no held values: a force
    that is held for 0.25 s accelerates evenly (output times beside its jump are left
    out: velocities are interpolated by their neighbours)."""
    law = {"type": "expression", "value": "6*slide.displacement", "sample_time": 0.25}
    content = block(["block.x"], type="actuator", joint="slide", function=law)
    result = filed(sidtool.Scene(**content).simulate(), tmp_path)
    t = np.linspace(0.0, 0.2, 60)
    found = outputs_at(result, ["block.x", "block.vx"], t)
    a = 6 * 0.02 / MASS
    np.testing.assert_allclose(found["block.vx"], a * t, atol=1e-9)
    np.testing.assert_allclose(found["block.x"], 0.02 + a * t**2 / 2, atol=1e-9)
    with pytest.raises(InputError, match=r"pull.value depends on what pull holds"):
        outputs_at(result, ["pull.value"], t)


def test_a_servo_by_a_law_is_known_afterwards(tmp_path: Path) -> None:
    """x'' = 9 (1 - x) - 6 x', by a formula and by a law that a file does not hold:
    between times without accelerations, of the third order."""
    formula = {"type": "expression", "value": "9*(1 - value) - 6*rate"}
    law = sidtool.Law(
        lambda t, y: 9.0 * (1.0 - y[0]) - 6.0 * y[1],
        ["slide.displacement", "slide.displacement_rate"],
    )
    for function, drives in ((formula, None), (LEFT, {"servo": law})):
        described = block(["block.x"])
        del described["forces"]
        described["bodies"]["block"]["initial"] = {}
        servo = {"joint": "slide", "of": "acceleration", "function": function}
        described["drives"] = {"servo": servo}
        result = sidtool.Scene(**described).simulate(drives=drives)
        read = filed(result, tmp_path)
        t = result.t
        x = 1.0 - (1.0 + 3.0 * t) * np.exp(-3.0 * t)
        force = MASS * 9.0 * (1.0 - 3.0 * t) * np.exp(-3.0 * t)
        assert read["block.x"] == pytest.approx(x, abs=1e-5)
        assert result["servo.fx"] == pytest.approx(force, abs=1e-3)
        between = outputs_at(read, ["block.vx"], t[:-1] + 0.01)["block.vx"]
        rate = 9.0 * (t + 0.01) * np.exp(-3.0 * (t + 0.01))
        third = 9.0 * 9.0 * 3.0 * 0.02**3 / 6.0
        assert between == pytest.approx(rate[:-1], abs=third if drives else 1e-6)
        if drives is None:
            assert read["servo.fx"] == pytest.approx(force, abs=1e-3)
        else:
            with pytest.raises(InputError, match="law of servo, which a program gave"):
                read["servo.fx"]
