"""Runs that a signal ends keep what they computed, and go on as if nothing had been."""

from __future__ import annotations

import shutil
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.api.interrupts import stop_on_signals
from sidtool.cli.main import run
from tests.codes import unwrapped
from tests.places import SLIDER_CRANK
from tests.processes import Ended, PythonProcess

#: The command line, whose run gets a signal when it has passed a time.
AT = """
import signal, sys
import sidtool.solver.simulation.run_loop as run
from sidtool.solver.simulation import preparation
from sidtool.solver.output import dense_output
from sidtool.cli.main import main

preparation.STEPS_PER_REPORT = 1
dense_output.STEPS_PER_CHUNK = dense_output.ENDS_PER_CHUNK = 1
before = run.Run._make_steps

def steps(self):
    code = before(self)
    if self.current_time > {t} and not hasattr(self, "signalled"):
        self.signalled = True
        signal.raise_signal({number})
    return code

run.Run._make_steps = steps
sys.argv[1:] = {arguments!r}
main()
"""


def ended(folder: Path, t: float, number: int, *arguments: str) -> Ended:
    code = AT.format(t=t, number=int(number), arguments=["simulate", *arguments])
    with PythonProcess(code, folder) as process:
        return process.wait()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("slider_crank.toml", "rod_q4.SID_FEM"):
        shutil.copy(SLIDER_CRANK / name, tmp_path / name)
    return tmp_path


def test_a_run_continues_after_two_signals(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The motion differs by the error of the run from that without a break."""
    command = ["slider_crank.toml", "-o", "result.h5", "--continue", "--set"]
    command += ["time.end=0.6", "-o", "table.csv"]
    for t, number in ((0.2, signal.SIGTERM), (0.41, signal.SIGINT)):
        done = ended(folder, t, number, *command)
        assert done.status == 128 + number, done.stderr
        assert "ended by" in done.stderr and "N319" in done.stderr
        assert "Traceback" not in done.stderr
        part = sidtool.read(folder / "result.h5")
        assert not part.completed and "ended by" in part.message
        assert t < part.t[-1] < t + 0.1
    monkeypatch.chdir(folder)
    assert run(["simulate", *command]) == 0
    whole = sidtool.read(folder / "result.h5")
    scene = sidtool.Scene.load("slider_crank.toml", {"time.end": 0.6})
    plain, exact = scene.simulate(), scene.simulate(rtol=1e-11)
    assert whole.completed and whole.message == ""
    np.testing.assert_array_equal(whole.t, plain.t)
    for name in ("piston.x", "rod.q1"):
        scale = np.ptp(exact[name])
        assert np.abs(whole[name] - exact[name]).max() < 1e-5 * scale
    assert len(np.loadtxt("table.csv", delimiter=",", skiprows=1)) == len(plain.t)
    assert run(["simulate", *command]) == 0


def pendulum(**more: Any) -> sidtool.Scene:
    """A pendulum with a damper, whose energies and turns are summed along the run."""
    pin = sidtool.Revolute(markers=["ground", "bar.pin"])
    damper = sidtool.SpringDamper(joint="pin", damping=0.05)
    given: dict[str, Any] = {
        "dimension": "planar",
        "gravity": [0.0, -9.81],
        "time": sidtool.Time(end=3.0, output_step=0.1),
        "bodies": {
            "bar": sidtool.RigidBody(
                mass=1.0,
                inertia=0.1,
                markers={"pin": sidtool.Marker(position=[-0.5, 0.0])},
                initial={"position": [0.5, 0.0], "angular_velocity": 9.0},
            )
        },
        "joints": {"pin": pin},
        "forces": {"damper": damper},
        "events": {"low": sidtool.Event(quantity="bar.vx", count=4)},
        "outputs": sidtool.Outputs(record=["pin.angle", "energy.*", "bar.vx"]),
    }
    return sidtool.Scene(**given | more)


def interrupted(scene: sidtool.Scene, after: float) -> sidtool.Result:
    """What Ctrl-C leaves that comes once some time has passed."""

    def told(t: float) -> None:
        if t > after:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(sidtool.Interrupted) as caught:
        scene.simulate(progress=told)
    result: sidtool.Result = caught.value.result
    return result


@pytest.mark.parametrize("others", [[], ["dissipated"], ["supplied"]])
def test_an_interrupted_balance_holds_the_energies_so_far(
    others: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Recorded alone it goes on as in one run, and what is beside it, too."""
    monkeypatch.setattr("sidtool.solver.output.dense_output.STEPS_PER_CHUNK", 2)
    record = [f"energy.{name}" for name in ("balance", *others)]
    push = sidtool.Actuator(
        joint="pin",
        function=sidtool.Expression(value="2*sin(3*t) - 0.1*pin.angle_rate"),
    )
    damper = pendulum().forces["damper"]
    scene = pendulum(
        outputs=sidtool.Outputs(record=record), forces={"damper": damper, "push": push}
    )
    part = interrupted(scene, 1.13)
    whole = scene.simulate(unfinished=part)
    exact = scene.simulate(rtol=1e-11)
    for name in record:
        np.testing.assert_allclose(whole[name], exact[name], atol=1e-4)


def test_sums_revolutions_and_events_continue(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sidtool.solver.output.dense_output.STEPS_PER_CHUNK", 2)
    scene = pendulum()
    part = interrupted(scene, 1.13)
    assert not part.completed and 1.1 < part.t[-1] < 1.6
    whole, exact = scene.simulate(unfinished=part), scene.simulate(rtol=1e-11)
    np.testing.assert_array_equal(whole.t, exact.t)
    for name in exact.names:
        scale = max(np.ptp(exact[name]), 1.0)
        np.testing.assert_allclose(whole[name], exact[name], atol=2e-5 * scale)
    assert np.abs(whole["energy.balance"] - whole["energy.balance"][0]).max() < 2e-5
    times = [[e.t for e in result.events] for result in (whole, exact)]
    assert len(times[0]) == 4 and len(part.events) in (1, 2, 3)
    np.testing.assert_allclose(*times, atol=1e-5)


def test_a_complete_run_is_extended_to_a_later_end(tmp_path: Path) -> None:
    """Within the tolerance of the run that goes straight through, also from a file and
    where the former end is between two output times."""
    scene = pendulum()
    exact = scene.simulate(rtol=1e-11)
    for end in (1.5, 1.13):
        path, table = tmp_path / f"{end}.h5", tmp_path / "table.csv"
        scene.with_({"time.end": end}).save(tmp_path / "scene.toml")
        command = ["simulate", str(tmp_path / "scene.toml"), "-o", str(path)]
        command += ["--continue"]
        assert run(command) == 0
        before = sidtool.read(path)
        events = [e.t for e in before.events]
        assert before.completed and len(events) >= 1
        assert run(command) == 0
        assert len(sidtool.read(path).t) == len(before.t)
        assert run([*command, "--set", "time.end=3.0", "-o", str(table)]) == 0
        whole = sidtool.read(path)
        np.testing.assert_allclose(whole.t, exact.t, rtol=1e-14, atol=0)
        assert whole.completed and len(np.loadtxt(table, skiprows=1, delimiter=","))
        for name in exact.names:
            scale = max(np.ptp(exact[name]), 1.0)
            np.testing.assert_allclose(whole[name], exact[name], atol=2e-5 * scale)
        np.testing.assert_array_equal(
            whole["pin.angle"][: len(before.t)], before["pin.angle"]
        )
        times = [[e.t for e in result.events] for result in (whole, exact)]
        np.testing.assert_allclose(*times, atol=1e-5)


def test_runs_that_cannot_be_extended_give_the_reason() -> None:
    scene = pendulum(events={"low": sidtool.Event(quantity="bar.vx", action="stop")})
    stopped = scene.simulate()
    with pytest.raises(sidtool.InputError, match="an event ended it"):
        scene.with_({"time.end": 4.0}).simulate(unfinished=stopped)
    whole = pendulum().simulate()
    with pytest.raises(sidtool.InputError, match="time.end"):
        pendulum().with_({"time.end": 2.0}).simulate(unfinished=whole)
    later = {"time.end": 4.0, "time.output_step": 0.2}
    with pytest.raises(sidtool.InputError, match="output_step"):
        pendulum().with_(later).simulate(unfinished=whole)


def test_runs_that_cannot_continue_give_the_reason() -> None:
    scene = pendulum()
    part = interrupted(scene, 0.0)
    for other, message in (
        (scene.with_({"bar.mass": 1.1}), r": bodies.bar.mass \(1.0 there, 1.1 here\)"),
        (
            scene.with_({"accuracy.rtol": 1e-7}),
            r"another scene, or of other options: accuracy.rtol \(1e-06 there, 1e-07",
        ),
    ):
        with pytest.raises(sidtool.InputError, match=message):
            other.simulate(unfinished=part)
    with pytest.raises(sidtool.InputError, match="is complete"):
        scene.simulate(unfinished=scene.simulate())
    assert run(["simulate", "x.toml", "--continue"]) == 2


def test_a_second_signal_is_answered_as_before() -> None:
    with pytest.raises(KeyboardInterrupt), stop_on_signals("SIGINT") as requested:
        assert requested() == ""
        signal.raise_signal(signal.SIGINT)
        assert requested() == "ended by Ctrl-C"
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_ends_the_search_for_a_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """There is nothing to keep yet: it was heard by the run after the search only."""

    def search(*_: object, **__: object) -> None:
        signal.raise_signal(signal.SIGINT)
        time.sleep(5.0)

    monkeypatch.setattr("sidtool.api.prepared_scene.plan_for", search)
    path = tmp_path / "r.h5"
    words = ["simulate", str(SLIDER_CRANK / "slider_crank.toml"), "--accuracy", "1e-2"]
    assert run([*words, "-o", str(path)]) == 130
    assert not path.exists() and "interrupted" in unwrapped(capsys.readouterr().err)
