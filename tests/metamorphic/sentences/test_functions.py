"""What runs say of functions of time is true: excitation, breaks, events, programs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.formats.result import Excitation
from sidtool.formats.scene import SceneFile
from sidtool.report.result import MAX_EVENTS, event_rows, run_summary
from sidtool.solver import compile_scene, describe, simulate
from sidtool.solver.diagnostics.excitation import drive_history, excitation
from tests.codes import only
from tests.metamorphic.generator import functions
from tests.metamorphic.generator.case import Table
from tests.metamorphic.generator.ingredients import function
from tests.solver.scenes import compiled, scene

END = 0.8


def pushed(*given: Table | Any, end: float = END, scale: float = 1.0) -> Excitation:
    """Of a body that forces push; callables are functions as well."""
    programs = {f"push{i}": f for i, f in enumerate(given) if callable(f)}
    forces = {
        f"push{i}": {
            "type": "force",
            "marker": "body",
            "force": [0.0, scale],
            "function": {"type": "constant", "value": 1.0} if callable(f) else f,
        }
        for i, f in enumerate(given)
    }
    described = scene({"body": {"mass": 1.0, "inertia": 1.0}}, end=end, forces=forces)
    system = compile_scene(described, forces=programs)
    return excitation(system, drive_history(system))


def by_hand(f: Any, end: float) -> float:
    """Frequency of a harmonic of the same range and curvature, by differences [Hz]."""
    t = np.linspace(0.0, end, 4001)
    values = np.array([f(x) for x in t])
    curvature = np.abs(np.diff(values, 2)).max() / (t[1] - t[0]) ** 2
    return math.sqrt(2.0 * curvature / np.ptp(values)) / (2.0 * math.pi)


@pytest.mark.parametrize("seed", range(5))
def test_the_excitation_is_as_fast_as_the_function_however_it_is_said(
    seed: int,
) -> None:
    """Alone, beside a slow harmonic, as polynomials, and given by a program."""
    random = np.random.default_rng([28, seed])
    given = function(random, 1.0, 0.5, END)
    slow = {"type": "harmonic", "amplitude": 1.0, "frequency": 1e-3}
    if given["type"] == "harmonic":
        given["angular_frequency"] += 2.0 * math.pi / END  # a whole period at least
    value = functions.value(given)
    found = pushed(given)
    exact = by_hand(value, END)
    if given["type"] == "harmonic":
        assert found.frequency == pytest.approx(given["angular_frequency"] / 2 / np.pi)
    assert found.frequency == pytest.approx(exact, rel=0.1)
    for other in (functions.as_polynomial(given), value):
        assert pushed(slow, other).frequency == pytest.approx(exact, rel=0.1)
        assert pushed(slow, other).by == "push1"


@pytest.mark.parametrize("seed", range(4))
def test_what_does_not_push_excites_nothing(seed: int) -> None:
    """A function that is nothing or constant, or of a force that is nothing."""
    random = np.random.default_rng([29, seed])
    given = function(random, 1.0, 0.5, END)
    flat = {"type": "constant", "value": float(random.normal())}
    assert pushed(functions.scaled(given, 0.0)).frequency == 0.0
    assert pushed(given, scale=0.0).frequency == 0.0
    assert pushed(flat).frequency == 0.0
    assert pushed(given, flat).frequency == pushed(given).frequency


@pytest.mark.parametrize("seed", range(4))
def test_a_triangular_wave_excites_with_its_frequency(seed: int) -> None:
    """By pieces that are straight, or by a program; not only what is curved."""
    random = np.random.default_rng([30, seed])
    frequency, size = float(random.uniform(2.0, 40.0)), float(random.uniform(0.1, 9.0))
    half = 0.5 / frequency
    edges = half * np.arange(math.ceil(END / half) + 1)
    pieces = [
        {
            "from": float(a),
            "to": float(b),
            "coefficients": [size * (k % 2), size * (1 - 2 * (k % 2)) / half],
        }
        for k, (a, b) in enumerate(zip(edges, edges[1:], strict=False))
    ]

    def wave(t: float) -> float:
        return size * float(np.abs((t / half + 1.0) % 2.0 - 1.0))

    slow = {"type": "harmonic", "amplitude": 1.0, "frequency": 0.01}
    for given in ({"type": "polynomial", "pieces": pieces}, wave):
        found = pushed(slow, given)
        assert found.by == "push1"
        assert found.frequency == pytest.approx(frequency, rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_what_a_program_hides_is_as_short_as_is_told(seed: int) -> None:
    """A bump that lasts as long as is told is seen wherever it lies, one of a
    hundredth of it may be missed; speeds after it by the impulse."""
    random = np.random.default_rng([31, seed])
    described = scene(
        {"body": {"mass": 2.0, "inertia": 1.0}},
        end=END,
        forces={
            "push": {
                "type": "force",
                "marker": "body",
                "force": [1.0, 0.0],
                "function": {"type": "constant", "value": 1.0},
            }
        },
        record=["body.vx"],
    )
    quiet = compile_scene(described, forces={"push": lambda t: 0.0 * t})
    diagnostic = only(simulate(quiet), "N328")
    assert diagnostic.line in describe(quiet)
    shortest = float(str(diagnostic.data["shortest"]))
    speeds = []
    for width in (1.05 * shortest, 0.01 * shortest):
        middle = float(random.uniform(0.1, 0.9)) * END

        def bump(t: float, width: float = width, middle: float = middle) -> float:
            x = 2.0 * (t - middle) / width
            return float((1.0 - x * x) ** 4 / width) if abs(x) < 1.0 else 0.0

        result = simulate(compile_scene(described, forces={"push": bump}), rtol=1e-8)
        speeds.append(result["body.vx"][-1] / (0.25 * 256.0 / 315.0))
    assert speeds[0] == pytest.approx(1.0, rel=1e-3)
    assert abs(speeds[1] - 1.0) < 1e-3 or speeds[1] == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_every_event_is_told_or_counted_beside_breaks(seed: int) -> None:
    """Crossings of a body that a table with many breaks drives, by the table itself."""
    random = np.random.default_rng([32, seed])
    count, level = int(random.integers(4, 40)), float(random.uniform(-0.3, 0.3))
    times = np.linspace(0.0, END, count)
    values = 0.5 * np.append([0.0], random.uniform(-1.0, 1.0, count - 1))
    curve = {"type": "table", "times": times.tolist(), "values": values.tolist()}
    described = scene(
        {"cart": {"mass": 1.0, "inertia": 1.0}},
        {
            "rail": {
                "type": "prismatic",
                "axis": [1.0, 0.0],
                "markers": ["ground", "cart"],
            }
        },
        {"motor": {"joint": "rail", "function": curve}},
        end=END,
        events={"gate": {"quantity": "cart.x", "value": level}},
    )
    result = simulate(compiled(described), rtol=1e-7)
    t = np.linspace(0.0, END, 40001)
    above = functions.pieces(curve)(t) > level
    crossed = t[1:][above[1:] != above[:-1]]
    found = [event.t for event in result.events if event.name == "gate"]
    assert found == pytest.approx(crossed, abs=1e-4)
    lines = [line.split(maxsplit=1) for line in run_summary(result).splitlines()]
    told = [float(text.split("t = ")[1].split()[0]) for n, text in lines if n == "gate"]
    assert told == pytest.approx(crossed[:MAX_EVENTS], abs=1e-4)
    more = [text for name, text in lines if name == "..."]
    hidden = len(crossed) - MAX_EVENTS
    plural = "s" if hidden > 1 else ""
    assert more == ([f"and {hidden} event{plural} later"] if hidden > 0 else [])
    breaks = sum(event.kind == "break" for event in result.events)
    rows = [
        (name, kind.removesuffix("s")) for name, kind, _ in event_rows(result.events)
    ]
    text = "break" if breaks == 1 else f"{breaks} break"
    assert breaks == 0 or ("motor", text) in rows


def test_an_event_at_the_instant_of_a_stop_is_told() -> None:
    """Two quantities that are the same, one of which ends the run, in both orders."""
    for names in (("a", "b"), ("b", "a")):
        actions = dict(zip(names, ("stop", "record"), strict=True))
        events = {
            name: {"quantity": "ball.y", "value": -0.3, "action": actions[name]}
            for name in ("a", "b")
        }
        falling = scene(
            {"ball": {"mass": 1.0, "inertia": 1.0}}, gravity=[0.0, -9.81], events=events
        )
        text = run_summary(simulate(compiled(SceneFile.model_validate(falling))))
        assert f"event {names[0]} ended the run" in text
        for name in names:
            assert any(
                line.split()[:2] == [name, "falling"] for line in text.splitlines()
            )
