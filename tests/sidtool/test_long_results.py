"""Results of many rows: written while the run goes on, in any blocks, whole or not."""

from __future__ import annotations

import shutil
import signal
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.base.errors import InputError
from sidtool.formats.result import InMemory, read_result
from sidtool.formats.result.data import ROWS_PER_BLOCK, TABLES, Columns, Rows
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.plot import results
from sidtool.solver import compile_scene, simulate
from sidtool.solver.output import dense_output
from sidtool.solver.simulation import (
    replay as replay_module,
    simulate as simulate_module,
)
from sidtool.view.motion import sample_motion
from tests.places import SLIDER_CRANK, posix
from tests.processes import PythonProcess

RECORD = ["piston.x", "energy.balance", "energy.supplied", "crank_pin.f*", "rod.q*"]
EVENTS = {
    "out": {"quantity": "piston.x", "value": 1.05},
    "bent": {"quantity": "rod.q1", "value": 0.0, "direction": "rising"},
    "fast": {"quantity": "piston.vx", "value": -1.0},
}
STOP = {"quantity": "piston.x", "value": 0.97, "action": "stop", "count": 2}


def described(
    rows: int, rtol: float = 1e-4, end: float = 2.1, **more: object
) -> SceneFile:
    """The slider-crank with so many output steps, in most of its time."""
    data = read_scene(SLIDER_CRANK / "slider_crank.toml").model_dump(exclude_none=True)
    data["time"] = {"end": end, "output_step": end / rows}
    data["accuracy"] |= {"rtol": rtol}
    return SceneFile.model_validate(data | more)


@pytest.mark.parametrize("stop", [{}, {"stop": STOP}])
@pytest.mark.parametrize(
    ("method", "rtol", "end"),
    [("radau9", 1e-4, 2.1), ("generalised_alpha", 1e-2, 1.0)],
)
def test_blocks_of_rows_change_nothing(
    method: str,
    rtol: float,
    end: float,
    stop: dict[str, object],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Windows of two rows, which grow in every step, against all rows in one.

    Only energies that are integrals are summed up in other groups.
    """
    more = {"outputs": {"record": RECORD}, "events": EVENTS | stop, "title": "t"}
    scene = described(150, rtol, end, **more)
    system = compile_scene(scene, SLIDER_CRANK)
    monkeypatch.setattr(dense_output, "ROWS_PER_BLOCK", 10_000)
    whole = simulate(system, integrator=method)
    monkeypatch.setattr(dense_output, "MIN_TIMES", 1)
    monkeypatch.setattr(dense_output, "MAX_WINDOW_NUMBERS", 1)
    assert dense_output.OutputTimeBuffer(range(150), 30).size == 2  # type: ignore[arg-type]
    parts = simulate(system, integrator=method)
    exact = [not name.startswith("energy") for name in whole.names]
    for table in ("t", "positions", "velocities"):
        assert np.array_equal(getattr(whole, table), getattr(parts, table))
    assert np.array_equal(whole.values[:, exact], parts.values[:, exact])
    np.testing.assert_allclose(parts.values, whole.values, rtol=1e-8, atol=1e-8)
    assert [(e.name, e.kind, e.t) for e in whole.events] == [
        (e.name, e.kind, e.t) for e in parts.events
    ]
    for one, other in zip(whole.events, parts.events, strict=True):
        np.testing.assert_allclose(other.values, one.values, rtol=1e-8, atol=1e-8)
    if not stop:  # steps behind the end are counted, too
        assert parts.counters["steps"] == whole.counters["steps"]
    assert (parts.message, parts.notes) == (whole.message, whole.notes)
    a, b = whole.bodies["rod"], parts.bodies["rod"]
    assert a.found is not None and b.found is not None
    assert b.found.sentence() == a.found.sentence()
    assert (b.found.time, b.deflection) == (a.found.time, a.deflection)
    assert np.array_equal(a.amplitudes, b.amplitudes)
    np.testing.assert_allclose(b.energy_shares, a.energy_shares, rtol=1e-9)


def test_the_energy_supplied_is_that_of_the_motion_however_many_rows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its balance closes with 4 rows and with 500, of which some are held at a time."""
    monkeypatch.setattr(dense_output, "ROWS_PER_BLOCK", 64)
    for rows in (3, 500):
        system = compile_scene(
            described(rows, outputs={"record": RECORD}), SLIDER_CRANK
        )
        result = simulate(system, rtol=1e-8)
        supplied, balance = result["energy.supplied"], result["energy.balance"]
        assert supplied[-1] > 20.0
        assert np.ptp(balance) < 1e-6 * supplied[-1]


PEAK = """
import resource
from sidtool.cli.main import run
assert run({arguments!r}) == 0
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def peak(folder: Path, rows: int) -> float:
    """Megabytes that `simulate` takes for so many rows."""
    text = (SLIDER_CRANK / "slider_crank.toml").read_text(encoding="utf-8")
    (folder / "s.toml").write_text(
        text.replace("output_step = 0.01", f"output_step = {3.0 / rows!r}"),
        encoding="utf-8",
    )
    shutil.copy(SLIDER_CRANK / "rod_q4.SID_FEM", folder)
    arguments = ["simulate", "s.toml", "--rtol", "1e-4", "-o", "r.h5", "-o", "r.csv"]
    with PythonProcess(PEAK.format(arguments=arguments), folder) as process:
        done = process.wait()
    assert done.status == 0, done.stderr
    return float(done.stdout.split()[-1]) / 1024


@posix
def test_memory_does_not_grow_with_the_rows(tmp_path: Path) -> None:
    """12 MB of results took 123 MB more than 0.4 MB of them."""
    few, many = peak(tmp_path, 1000), peak(tmp_path, 25_000)
    assert (tmp_path / "r.h5").stat().st_size > 5.7e6
    assert many - few < 10.0
    result = read_result(tmp_path / "r.h5")
    assert len(result.t) == 25_001
    with (tmp_path / "r.csv").open(encoding="utf-8") as lines:
        assert sum(1 for _ in lines) == 25_002


class Nowhere(InMemory):
    """Counts rows and keeps none."""

    def begin(self, columns: Columns, most: int) -> None:
        self.count, self.longest = 0, 0

    def add(self, rows: Rows) -> None:
        self.count += len(rows.t)
        self.longest = max(self.longest, len(rows.t))


def test_a_step_of_many_rows_is_recorded_in_parts() -> None:
    """With 180 000 rows a step has 10 000; all of their samples were held at once.

    What grows is the states of one step: 17 numbers a row, thrice while there is no
    room.
    """
    peaks = []
    for rows in (30_000, 180_000):
        system, sink = compile_scene(described(rows, 1e-2), SLIDER_CRANK), Nowhere()
        tracemalloc.start()
        steps = simulate(system, into=sink).counters["steps"]
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert sink.count == rows + 1 and sink.longest <= ROWS_PER_BLOCK
        assert sink.count > 1000 * steps or rows < 100_000
    assert peaks[1] - peaks[0] < 6e6


def test_the_files_are_those_of_the_result_in_memory(tmp_path: Path) -> None:
    result = sidtool.simulate(described(9000), base_folder=SLIDER_CRANK)
    sidtool.write(tmp_path / "r.h5", result)
    back = read_result(tmp_path / "r.h5")
    for table, names in TABLES.items():
        assert np.array_equal(getattr(back, table), getattr(result, table))
        assert getattr(back, names) == getattr(result, names)
    assert np.array_equal(back.t, result.t)


SIMULATE = """
import sys
from sidtool.cli.main import main
sys.argv[1:] = ["simulate", "s.toml", "-o", "r.h5", "-o", "r.csv"]
main()
"""


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_is_ended_in_a_step_of_many_rows_keeps_them(
    number: signal.Signals, tmp_path: Path
) -> None:
    text = (SLIDER_CRANK / "slider_crank.toml").read_text(encoding="utf-8")
    scene = tmp_path / "s.toml"
    scene.write_text(
        text.replace("output_step = 0.01", "output_step = 3e-7"), encoding="utf-8"
    )
    shutil.copy(SLIDER_CRANK / "rod_q4.SID_FEM", tmp_path)
    with PythonProcess(SIMULATE, tmp_path) as process:
        while sum(p.stat().st_size for p in tmp_path.glob(".*.part")) < 1_000_000:
            assert process.is_alive()
            time.sleep(0.02)
        process.send_signal(number)
        done = process.wait()
    assert done.status == 128 + number and "ended by" in done.stderr
    files = {"s.toml", "rod_q4.SID_FEM", "r.h5", "r.csv"}
    assert {p.name for p in tmp_path.iterdir()} == files
    result = read_result(tmp_path / "r.h5")
    assert not result.completed and 1000 < len(result.t) < 1_000_000
    assert result.t[-1] < 0.3


class Full(InMemory):
    """Has no room for the third block."""

    count = 0

    def add(self, rows: Rows) -> None:
        self.count += 1
        if self.count == 3:
            raise OSError(28, "No space left on device")


def test_a_sink_that_fails_ends_the_run() -> None:
    system, sink = compile_scene(described(20_000), SLIDER_CRANK), Full()
    with pytest.raises(OSError, match="No space"):
        simulate(system, into=sink)
    assert sink.count == 3


def test_the_rows_of_a_run_go_to_its_sink(monkeypatch: pytest.MonkeyPatch) -> None:
    sink = InMemory()
    result = simulate_module.simulate(
        compile_scene(described(100), SLIDER_CRANK), into=sink
    )
    assert len(result.t) == 0 and result.values.shape == (0, len(result.names))
    assert len(sink.arrays()["t"]) == 101
    with pytest.raises(InputError, match="rho"):
        simulate_module.simulate(
            compile_scene(described(100), SLIDER_CRANK), integrator="rho"
        )


def test_outputs_of_a_result_are_evaluated_in_blocks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also forces of a joint, and momenta; all rows at once took 7 times the memory."""
    scene = described(100, end=0.5, outputs={"record": ["piston.x"]})
    result = simulate(compile_scene(scene, SLIDER_CRANK))
    names = ("piston.vx", "rod.q*", "crank_pin.f*", "rod.momentum_x", "crank.angle")
    whole = replay_module.replay(result, names).outputs()
    monkeypatch.setattr(replay_module, "_ROWS_AT_ONCE", 7)
    parts = replay_module.replay(result, names).outputs()
    assert list(parts) == list(whole) and len(whole) > len(names)
    for name, values in whole.items():
        np.testing.assert_allclose(parts[name], values, rtol=1e-9, atol=1e-9)


def test_pictures_sample_their_own_times_only(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = described(200, end=0.5, outputs={"record": ["piston.x"]})
    result = simulate(compile_scene(scene, SLIDER_CRANK))
    sizes = []
    sample = replay_module.Replay.samples

    def record(again: replay_module.Replay, times: Any = None) -> Any:
        sizes.append(len(again.t) if times is None else len(times))
        return sample(again, times)

    monkeypatch.setattr(replay_module.Replay, "samples", record)
    assert len(sample_motion(result, most=20).t) == 20
    assert max(sizes) == 20


def test_curves_of_large_states_have_fewer_points() -> None:
    t = np.linspace(0.0, 1.0, 11)
    for numbers in (6, 10_000, 100_000):
        points = results._dense_times(t, numbers)
        assert np.isin(t, points).all()
        assert len(points) >= min(2000, 5_000_000 // numbers)
        assert (len(points) - 20) * numbers <= 5_000_000
