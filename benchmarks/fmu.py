"""Functional mock-up units: time of a call, and difference from the own run."""

from __future__ import annotations

import ctypes
import random
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import sidtool
from tests.sidtool.fmu.importer import OK, Instance, Library

from .machine import describe_machine
from .peers.exudyn_slider_crank import run as exudyn_run
from .report import Report, Table

EXAMPLE = Path(__file__).parents[1] / "examples" / "slider_crank" / "slider_crank.toml"
LENGTHS = (1e-1, 1e-2, 1e-3, 1e-4)
END, REPETITIONS = 1.9, 3
HEADER = (
    *("communication step [s]", "calls", "FMU, us a call", "FMU, us a step"),
    *("plant in Python, us a call", "largest difference"),
)


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """The founding slider-crank with a load on the piston; nothing is plotted.

    Processor time of the calls that advance, the least of some repetitions; outputs are
    read at every tenth of a second.
    """
    scene = _scene()
    with tempfile.TemporaryDirectory() as made:
        file = Path(made) / "machine.fmu"
        unit = scene.fmu(file)
        library = Library(file, Path(made) / "unpacked")
        own = [scene.simulate() for _ in range(REPETITIONS)]
        seconds = min(float(result.counters["seconds"]) for result in own)
        steps = int(own[0].counters["steps"])
        rows = []
        for length in LENGTHS:
            rows.append(_row(library, scene, length, own[0], steps))
            say(f"  {length:g} s: {rows[-1][2]} us a call")
        jumps = _seconds_with_jumps(library)
        fixed = _fixed_steps(Path(made))
    sizes = (f"{name} {size / 1e3:.0f} kB" for name, size in unit.libraries.items())
    remarks = [
        f"The run of sidtool itself: {steps} steps, {1e6 * seconds / steps:.1f} us "
        "each. The unit makes the same steps at each communication step. Differences "
        "are those of all outputs at every tenth of a second, relative to the largest "
        "value.",
        f"With a load that jumps each millisecond: {1e6 * jumps:.0f} us a call. "
        f"The file has {unit.size / 1e3:.0f} kB, its library {', '.join(sizes)}.",
        fixed,
    ]
    caption = "Microseconds of a processor:"
    return Report(
        title="The founding slider-crank as a functional mock-up unit",
        tables=[Table(caption, HEADER, rows, True)],
        remarks=remarks,
        machine=describe_machine(),
    )


def _scene() -> sidtool.Scene:
    load = {"type": "force", "marker": "piston", "force": [1.0, 0.0]}
    return sidtool.Scene.load(EXAMPLE).with_(
        {
            "time.end": END,
            "time.output_step": 0.1,
            "accuracy.integrator": "radau9",
            "accuracy.rtol": 1e-6,
            "inputs.load": {"initial": 1.0},
            "forces.load": load | {"function": {"type": "input", "name": "load"}},
        }
    )


def _row(
    library: Library,
    scene: sidtool.Scene,
    length: float,
    own: sidtool.Result,
    steps: int,
) -> Sequence[str]:
    calls, every = round(END / length), round(0.1 / length)
    best, rows = np.inf, [list[float]()]
    for _ in range(REPETITIONS):
        seconds, rows = _seconds(Instance(library), calls, length, every)
        best = min(best, seconds)
    plant = scene.compile().plant()
    began = time.process_time()
    for _ in range(calls):
        plant.advance(length)
    in_python = time.process_time() - began
    values = np.array(rows)
    sizes = [np.abs(own[name]).max() for name in own.names]
    expected = np.column_stack([own[name][1:] for name in own.names])
    difference = (np.abs(values - expected) / sizes).max()
    times = (best / calls, best / steps, in_python / calls)
    return [f"{length:g}", str(calls), *(f"{1e6 * t:.3g}" for t in times)] + [
        f"{difference:.0e}"
    ]


def _seconds(
    instance: Instance, calls: int, length: float, every: int
) -> tuple[float, list[list[float]]]:
    """Time of the calls, and the outputs after every so many of them."""
    step, address = (
        instance.library.function("DoStep"),
        ctypes.c_void_p(instance.address),
    )
    step.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int]
    seconds, rows = 0.0, []
    for first in range(0, calls, every):
        began = time.process_time()
        for k in range(first, first + every):
            step(address, k * length, length, 1)
        seconds += time.process_time() - began
        rows.append(instance.get())
    return seconds, rows


def _fixed_steps(folder: Path, step: float = 1e-3) -> str:
    """Time of a fixed step without load: unit, own run, and Exudyn if it is there."""
    calls, sid = round(END / step), sidtool.read(EXAMPLE.parent / "rod_q4.SID_FEM")
    scene = sidtool.Scene.load(EXAMPLE).with_(
        {
            "time": {"end": END, "output_step": 0.1},
            "accuracy": {"integrator": "radau5", "step": step},
        }
    )
    scene.fmu(folder / "fixed.fmu")
    library = Library(folder / "fixed.fmu", folder / "fixed")

    def least(run: Callable[[], object]) -> float:
        seconds = []
        for _ in range(REPETITIONS):
            began = time.process_time()
            run()
            seconds.append(time.process_time() - began)
        return 1e6 * min(seconds) / calls

    compiled = scene.compile()
    of_unit = least(lambda: _seconds(Instance(library), calls, step, calls))
    times = f"{of_unit:.3g} us in the unit, {least(compiled.run):.3g} in sidtool"
    try:
        times += f", {least(lambda: exudyn_run(sid, step, END, 0.1)):.3g} in Exudyn"
    except ImportError:
        times += "; Exudyn is not installed"
    return f"Fixed steps of {1e3 * step:g} ms with radau5: {times}."


def _seconds_with_jumps(library: Library, length: float = 1e-3) -> float:
    """Time of a call with another input each time."""
    rng, instance, calls = random.Random(0), Instance(library), 1000
    values = [rng.uniform(-1.0, 1.0) for _ in range(calls)]
    began = time.process_time()
    for k, value in enumerate(values):
        instance.set("load", value)
        assert instance.step(k * length, length) == OK
    return (time.process_time() - began) / calls
