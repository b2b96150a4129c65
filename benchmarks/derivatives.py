"""Derivatives of the founding slider-crank: cost and errors; intervals of fits."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

import sidtool

from .latency import EXAMPLE
from .machine import describe_machine
from .report import Report, Table

#: Variables of the scene and of the model of the rod, and functionals.
VARIABLES = (
    "parameters.n",
    "piston.mass",
    "crank.markers.pin.position[0]",
    "rod.model.geometry.thickness",
    "rod.model.material.youngs_modulus",
    "rod.model.geometry.control_points[1][0][1]",
)
FUNCTIONALS = (
    "max_abs(rod.q1)",
    "rms(rod.q1)",
    "max_abs(crank_pin.fx)",
    "final(rod.q1)",
)
#: The crank speed as a parameter, and the rod by its model.
CHANGES = {
    "parameters.n": 6.0,
    "drives.crank_angle.function.pieces[0].end": ["2*pi*n", "2*pi*n", 0.0, 0.0],
    "drives.crank_angle.function.pieces[1].coefficients": ["2*pi*n", "2*pi*n"],
    "rod.model": "rod_q4.toml",
}
#: Tolerance of the reference, runs to time.
FINE, TIMED = 1e-10, 20
#: Numbers of variables of which the cost is measured, and how often.
COUNTS, TURNS = (1, 10, 60, 1000), 5
#: Numbers of the scene whose cost is measured, one and all of them.
NUMBERS = (
    "piston.mass",
    "crank.mass",
    "crank.inertia",
    "crank.centre_of_mass[0]",
    "crank.centre_of_mass[1]",
    "crank.markers.bearing.position[0]",
    "crank.markers.bearing.position[1]",
    "crank.markers.pin.position[0]",
    "crank.markers.pin.position[1]",
)
#: Measurements of each scene, noise relative to the range of the output.
TRIALS, NOISE = {"block": 1000, "bar": 200}, 0.01


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Derivatives at the tolerance of the scene against those of fine runs."""
    scene = sidtool.Scene.load(EXAMPLE).with_(CHANGES)
    rows = []
    for variable in VARIABLES:
        began = time.process_time()
        found = sidtool.sensitivity(scene, variable, FUNCTIONALS, jobs=1)
        seconds, one = time.process_time() - began, _seconds_of_a_run(scene)
        fine = sidtool.sensitivity(scene, variable, FUNCTIONALS, rtol=FINE)
        size = np.abs(fine.derivatives[:, 0])
        estimate = (found.errors[:, 0] / size)[:3].max()
        away = (np.abs(found.derivatives[:, 0] - fine.derivatives[:, 0]) / size)[
            :3
        ].max()
        share = [f"{x:.4g}" for x in found.relative[:, 0]]
        cells = [
            f"{found.runs}",
            f"{seconds / one:.1f}",
            f"{estimate:.0e}",
            f"{away:.0e}",
        ]
        rows.append([variable, *share, *cells])
        say(f"  {variable}: {found.runs} runs, {seconds:.2f} s")
    costs = _costs(sidtool.Scene.load(EXAMPLE), say)
    header = [
        "variable",
        *FUNCTIONALS,
        "runs",
        "time / run",
        "estimate",
        "to rtol 1e-10",
    ]
    caption = (
        "Per cent of a functional for one per cent of a variable (none for a control "
        "point of 0); runs, and their time over that of one `compiled.run`; largest "
        "estimated relative error of the first three derivatives, and their largest "
        "distance to those at rtol 1e-10:"
    )
    caption_of_costs = (
        "Cost of all derivatives of `max_abs(rod.q1)` of the founding slider-crank by "
        "the mass of the piston and groups of it, and of each further of nine masses "
        "and positions, in turns with one `compiled.run`: median of the ratios of "
        "processor times:"
    )
    cost_header = ["method", *map(str, COUNTS), "further number"]
    caption_of_fits = (
        "Identification from 101 noisy values of a position (noise 1 % of its range): "
        "95 % intervals that contain the true value:"
    )
    fits = ["scene", "number", "measurements", "intervals"]
    return Report(
        title="Derivatives of motions, intervals of identified numbers",
        tables=[
            Table(caption, header, rows, True),
            Table(caption_of_costs, cost_header, costs, True),
            Table(caption_of_fits, fits, _coverage(TRIALS, say), True),
        ],
        machine=describe_machine(),
    )


def _costs(scene: sidtool.Scene, say: Callable[[str], None]) -> list[list[str]]:
    """Rows: method, cost of the derivatives by some numbers of variables in runs, cost
    of each further number of the scene.
    """
    rows = []
    for method in ("direct", "adjoint", "differences"):
        row = [method]
        for count in COUNTS:
            names = ["piston.mass"]
            names += [f"v{k}=piston.mass:{1 + k}" for k in range(1, count)]
            if method == "differences" and count > 1:
                row.append("")
                continue
            row.append(f"{_cost(scene, names, method):.1f}")
        more = [_cost(scene, NUMBERS[:n], method) for n in (1, len(NUMBERS))]
        row.append(f"{(more[1] - more[0]) / (len(NUMBERS) - 1):.2f}")
        say(f"  {method}: {', '.join(row[1:])} runs")
        rows.append(row)
    return rows


def _cost(scene: sidtool.Scene, names: Sequence[str], method: str) -> float:
    """Derivatives by some variables, in runs: median of the turns."""
    ratios = []
    for _ in range(TURNS):
        one, began = _seconds_of_a_run(scene), time.process_time()
        sidtool.sensitivity(scene, names, FUNCTIONALS[0], jobs=1, method=method)
        ratios.append((time.process_time() - began) / one)
    return statistics.median(ratios)


def _seconds_of_a_run(scene: sidtool.Scene) -> float:
    compiled, seconds = scene.compile(), []
    for _ in range(TIMED):
        began = time.process_time()
        compiled.run({"piston.mass": 5.0})
        seconds.append(time.process_time() - began)
    return statistics.median(seconds)


def _block() -> tuple[sidtool.Scene, dict[str, float], dict[str, float], str]:
    """A block on a spring: scene, true numbers, first guesses, measured output."""
    spring = {"type": "spring_damper", "markers": ["ground", "block"], "rest": 0.4}
    initial = {"position": [0.5, 0.0], "velocity": [0.3, 0.0]}
    scene = sidtool.Scene(
        dimension="planar",
        gravity=[0.0, 0.0],
        time={"end": 2.0, "output_step": 0.02},
        bodies={"block": {"mass": 2.0, "initial": initial}},
        joints={"guide": {"type": "point_on_line", "markers": ["ground", "block"]}},
        forces={"spring": spring | {"stiffness": 50.0, "damping": 0.4}},
    )
    true = {"spring.stiffness": 50.0, "spring.damping": 0.4}
    return scene, true, {"spring.stiffness": 52.0, "spring.damping": 0.5}, "block.x"


def _bar(
    changes: Mapping[str, float] = MappingProxyType({}),
) -> tuple[sidtool.Scene, dict[str, float], dict[str, float], str]:
    """A clamped bar released under its weight, the same."""
    folder = EXAMPLE.parents[1] / "beam"
    coarse = {"discretisation.elements": 6, "reduction.modes": 4, "damping.beta": 1e-3}
    model = sidtool.Model.load(folder / "beam.toml").with_(coarse | dict(changes))
    scene = sidtool.Scene.load(folder / "scene.toml").with_(
        {"bar.model": model, "time.end": 0.5}
    )
    true = {"material.youngs_modulus": 2.1e11, "damping.beta": 1e-3}
    guess = {"material.youngs_modulus": 2.0e11, "damping.beta": 1.3e-3}
    return scene, true, guess, "bar.tip.y"


def _coverage(trials: dict[str, int], say: Callable[[str], None]) -> list[list[str]]:
    """Rows: scene, number, trials, intervals that contain the true value."""
    rows = []
    for name, count in trials.items():
        scene, true, guess, output = _block() if name == "block" else _bar()
        prefix = "" if name == "block" else "bar.model."
        changed = scene.with_(guess) if name == "block" else _bar(guess)[0]
        exact = scene.with_({"outputs.record": [output]}).simulate(rtol=FINE)
        values = exact[output]
        noise = NOISE * np.ptp(values)
        inside = dict.fromkeys(true, 0)
        for trial in range(count):
            errors = noise * np.random.default_rng(trial).standard_normal(len(values))
            measured = {"t": exact.t, output: values + errors}
            keys = [f"{prefix}{key}" for key in true]
            found = sidtool.identify(changed, keys, measured, jobs=1)
            for key, value in true.items():
                low, high = found.intervals[f"{prefix}{key}"]
                inside[key] += int(low < value < high)
        say(f"  intervals of the {name}: {inside} of {count}")
        rows += [[name, key, f"{count}", f"{n}"] for key, n in inside.items()]
    return rows
