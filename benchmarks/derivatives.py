"""Derivatives of the founding slider-crank: cost and errors; intervals of fits."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path

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
#: Tolerance of the reference, runs to time, trials of the identification.
FINE, TIMED, TRIALS = 1e-10, 20, 1000
TRUE, NOISE = {"spring.stiffness": 50.0, "spring.damping": 0.4}, 2e-3


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Derivatives at the tolerance of the scene against those of fine runs."""
    scene = sidtool.Scene.load(EXAMPLE).with_(CHANGES)
    rows = []
    for variable in VARIABLES:
        found = sidtool.sensitivity(scene, variable, FUNCTIONALS, jobs=1)
        one, seconds = _seconds_of_a_run(scene), found.seconds
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
    inside = _coverage(say)
    counts = [[key, f"{inside[key]} of {TRIALS}"] for key in TRUE]
    caption_of_fits = (
        "Identification of a block on a spring from 101 noisy positions "
        f"({1e3 * NOISE:g} mm, amplitude 117 mm): 95 % intervals that contain the true "
        "value:"
    )
    return Report(
        title="Derivatives of motions, intervals of identified numbers",
        tables=[
            Table(caption, header, rows, True),
            Table(caption_of_fits, ["number", "intervals"], counts, True),
        ],
        machine=describe_machine(),
    )


def _seconds_of_a_run(scene: sidtool.Scene) -> float:
    compiled, seconds = scene.compile(), []
    for _ in range(TIMED):
        began = time.perf_counter()
        compiled.run({"piston.mass": 5.0})
        seconds.append(time.perf_counter() - began)
    return statistics.median(seconds)


def _coverage(say: Callable[[str], None]) -> dict[str, int]:
    """How many intervals contain the true value, by number."""
    spring = {"type": "spring_damper", "markers": ["ground", "block"], "rest": 0.4}
    initial = {"position": [0.5, 0.0], "velocity": [0.3, 0.0]}
    scene = sidtool.Scene(
        dimension="planar",
        gravity=[0.0, 0.0],
        time={"end": 2.0, "output_step": 0.02},
        bodies={"block": {"mass": 2.0, "initial": initial}},
        joints={"guide": {"type": "point_on_line", "markers": ["ground", "block"]}},
        forces={"spring": spring | {"stiffness": 50.0, "damping": 0.4}},
        outputs={"record": ["block.x"]},
    )
    true = scene.simulate(rtol=FINE)
    guess = scene.with_({"spring.stiffness": 52.0, "spring.damping": 0.5})
    inside = dict.fromkeys(TRUE, 0)
    for trial in range(TRIALS):
        noise = NOISE * np.random.default_rng(trial).standard_normal(len(true.t))
        measured = {"t": true.t, "block.x": true["block.x"] + noise}
        found = sidtool.identify(guess, list(TRUE), measured, jobs=1)
        for key, value in TRUE.items():
            low, high = found.intervals[key]
            inside[key] += int(low < value < high)
    say(f"  intervals: {inside}")
    return inside
