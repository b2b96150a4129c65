"""What a run has to say of its integrator, its loops and its outputs, by code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.result import Result
from sidtool.solver import compile_scene, linearise, simulate, static_equilibrium
from sidtool.solver.system.errors import SimulationError
from sidtool.solver.system.system import System
from tests.codes import HasDiagnostics, codes, only, with_code
from tests.solver.scenes import compiled, polynomial, scene, slender_rod
from tests.steel_bars import steel_bar

from .test_body_measures import EULER, cantilever, fixed


@pytest.mark.parametrize("gain", [50.0, 2.0])
def test_a_sampled_loop_that_runs_away(gain: float) -> None:
    """x' of 1.5 kg held back by -gain v for 0.2 s at a time: v is multiplied by
    1 - 0.2 gain / 1.5 each time."""
    law = {"type": "expression", "value": f"-{gain}*block.vx", "sample_time": 0.2}
    rail = {"type": "prismatic", "markers": ["ground", "block"], "axis": [1.0, 0.0]}
    motor = {"type": "actuator", "joint": "rail", "function": law}
    block = {"mass": 1.5, "inertia": 1.0, "initial": {"velocity": [1.0, 0.0]}}
    described = scene(
        {"block": block},
        {"rail": rail},
        forces={"motor": motor},
        end=4.0,
        steps=20,
        record=["block.x"],
    )
    result = simulate(compiled(described))
    unstable = abs(1.0 - 0.2 * gain / 1.5) > 1.0
    assert ("N512" in codes(result)) == unstable
    if unstable:
        found = only(result, "N512")
        assert found.subject == "motor" and found.data["periods"] == (0.2,)
        way = np.abs(result["block.x"] - result["block.x"][0]).max()
        assert found.data["largest"] == pytest.approx(way, rel=1e-6)


def vibrating(damped: bool) -> Result:
    """The cantilever in its first mode, and a little in its third."""
    sid = cantilever()
    damping = np.diag([0.0, 0.0, 20.0 if damped else 0.0])
    start = {"elastic": [1e-2, 0.0, 1e-5]}
    described = scene(
        {"beam": {"sid": "-", "markers": {"root": 1}, "initial": start}},
        {"hub": {"type": "fixed", "markers": ["ground", "beam.root"]}},
        end=8.0,
        steps=100,
    )
    system = compiled(described, beam=replace(sid, De=Taylor(damping)))
    return simulate(system, rtol=1e-8)


def test_a_small_vibration_that_decides_the_steps() -> None:
    """Energies by k q^2 / 2: (61.70 / 3.516)^2 1e-6, 3e-4 of that of the first mode."""
    assert "N322" not in codes(vibrating(damped=True))
    found = only(vibrating(damped=False), "N322")
    assert found.subject == "beam" and found.severity == "info"
    assert found.data["number"] == 3
    assert found.data["frequency"] == pytest.approx(61.6972 / (2 * np.pi), rel=2e-2)
    share = (61.6972 / 3.516015 * 1e-3) ** 2
    assert found.data["share"] == pytest.approx(share, rel=0.3)
    assert 1.5 <= found.data["steps_per_period"] <= 60.0


def slider_crank(second: float) -> Result:
    """A steel rod on a crank that turns at 6 rad/s; a second drive turns the crank pin,
    which the angle of the rod decides already."""
    bodies: dict[str, Any] = {
        "crank": slender_rod(0.1, 0.3),
        "rod": {"sid": "-", "markers": {"a": 1, "b": 2}},
        "piston": {"mass": 5.0, "initial": {"position": [1.1, 0.0]}},
    }
    bodies["rod"]["initial"] = {"position": [0.1, 0.0]}
    joints = {
        "bearing": {"type": "revolute", "markers": ["ground", "crank.a"]},
        "crank_pin": {"type": "revolute", "markers": ["crank.b", "rod.a"]},
        "piston_pin": {"type": "revolute", "markers": ["rod.b", "piston"]},
        "slider": {"type": "point_on_line", "markers": ["ground", "piston"]},
    }
    drives = {"motor": {"joint": "bearing", "function": polynomial(0.0, 6.0)}}
    if second:
        function = polynomial(0.0, second)
        drives["second"] = {"joint": "crank_pin", "function": function}
    described = scene(bodies, joints, drives, end=0.1)
    return simulate(compiled(described, rod=steel_bar()))


@pytest.mark.parametrize("second", [-3.0, 0.0])
def test_joints_that_deform_a_body(second: float) -> None:
    result = slider_crank(second)
    assert ("N330" in codes(result)) == bool(second)
    for each in with_code(result, "N330"):
        assert each.subject == "rod"
        assert all(name in str(each.data["reason"]) for name in ("motor", "second"))


def stressed(sid: SID, peaks: bool) -> SID:
    """With stress per coordinate at its nodes, which are known to be peaks or not."""
    sigma = Taylor(np.zeros((6, 1)), np.ones((sid.nq, 6, 1)))
    nodes = tuple(replace(node, sigma=sigma) for node in sid.nodes)
    return replace(sid, nodes=nodes, has_peak_nodes=peaks)


@pytest.mark.parametrize("peaks", [False, True])
def test_the_largest_stress_of_nodes_that_are_no_peaks(peaks: bool) -> None:
    sid = stressed(steel_bar(), peaks)
    described = scene(
        {"bar": {"sid": "-", "markers": {"a": 1}}},
        {"wall": {"type": "fixed", "markers": ["ground", "bar.a"]}},
        end=1e-4,
        steps=1,
        record=["bar.peak_von_mises"],
    )
    result = simulate(compiled(described, bar=sid))
    assert ("N430" in codes(result)) != peaks
    for each in with_code(result, "N430"):
        assert (each.subject, each.data["count"]) == ("bar", len(sid.nodes))


def test_a_continued_run_judges_its_bodies_as_one_run() -> None:
    """A load that grows with time: what its first part says of the column is not said
    twice, and where it was continued is told."""
    push = {
        "type": "force",
        "marker": "beam.tip",
        "force": [-EULER, 0.0],
        "function": polynomial(0.0, 1000.0),
    }
    forces = {"push": push}
    whole, first = (
        fixed(cantilever(), end=end, forces=forces, steps=steps)
        for end, steps in ((2e-3, 20), (1.5e-3, 15))
    )
    begun = simulate(first)
    result = simulate(whole, unfinished=begun)
    assert result.completed and result.t[-1] == pytest.approx(2e-3)
    assert only(result, "N317").t == pytest.approx(1.5e-3)
    assert "N317" not in codes(begun) and "N317" not in codes(simulate(whole))
    assert only(begun, "N408").data["factor"] == pytest.approx(1.5, rel=1e-2)
    assert only(result, "N408").data["factor"] == pytest.approx(2.0, rel=1e-2)


@pytest.mark.parametrize("analyse", [simulate, static_equilibrium, linearise])
def test_codes_that_a_scene_ignores_are_not_reported(
    analyse: Callable[[System], HasDiagnostics],
) -> None:
    """Gravity of 9810 m/s2 and an angle of 90 rad, of which one is meant."""
    pin = {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}}
    described = scene(
        {"rod": slender_rod(1.0, angle=90.0)}, pin, gravity=[0.0, -9810.0], end=1e-3
    )
    for ignored in ([], ["N201"], ["n201", "202"]):
        changed = described.with_({"diagnostics.ignore": ignored})
        found = analyse(compile_scene(changed, keep_joints=True))
        wanted = {"N201", "N202"} - {"N" + code.strip("nN") for code in ignored}
        assert {"N201", "N202"} & set(codes(found)) == wanted
    with pytest.raises(InputError, match="N999"):
        described.with_({"diagnostics.ignore": ["N999"]})


def test_a_run_that_stops_has_its_diagnostics() -> None:
    """What was found until then is with the error."""
    law = {"type": "expression", "value": "sqrt(0.5 - body.x)"}
    body = {"mass": 1.0, "inertia": 1.0, "initial": {"angle": 90.0}}
    body["initial"]["velocity"] = [1.0, 0.0]
    push = {"type": "force", "marker": "body", "force": [1.0, 0.0], "function": law}
    system = compiled(scene({"body": body}, forces={"push": push}))
    with pytest.raises(SimulationError) as stop:
        simulate(system)
    assert stop.value.result is not None and not stop.value.result.completed
    assert "N202" in codes(stop.value.result)
