"""Functions of time that are sums, and ramps with a sine."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.solver import compile_scene, simulate
from sidtool.solver.dynamics.drives import function_value
from tests.solver.scenes import scene, slender_rod

RAMP = {"type": "sine_ramp", "from": 0.3, "to": 1.1, "start": 0.2, "end": 1.5}
SPIN = {**RAMP, "of": "rate", "offset": -0.4}
WAVE = {"type": "harmonic", "amplitude": 0.7, "frequency": 1.9, "phase": 0.3}
SUM = {"type": "sum", "parts": [SPIN, WAVE, RAMP, {"type": "constant", "value": 2.0}]}


def driven(function: dict[str, Any]) -> Any:
    made = scene(
        {"rod": slender_rod(1.0)},
        {"hinge": {"type": "revolute", "markers": ["ground", "rod.a"]}},
        {"turn": {"joint": "hinge", "function": function}},
        end=2.0,
        steps=16,
        record=["hinge.angle", "hinge.angle_rate", "turn.mz"],
    )
    return compile_scene(made, keep_joints=True)


def exact(times: Array) -> tuple[Array, Array, Array]:
    """The sum and two derivatives; the ramp of a rate integrated by numbers."""
    length, change, turn = 0.8, 1.3, 2.0 * np.pi

    def ramp(t: Array) -> Array:
        x = np.clip((t - 0.3) / length, 0.0, 1.0)
        return np.asarray(0.2 + change * (x - np.sin(turn * x) / turn))

    x = np.clip((times - 0.3) / length, 0.0, 1.0)
    pace = change / length * (1.0 - np.cos(turn * x))
    bend = change * turn / length**2 * np.sin(turn * x)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    angle = np.full(len(times), -0.4)
    for k, t in enumerate(times):
        cuts = [0.3, min(max(t, 0.3), 1.1), t] if t > 0.3 else [0.3, t]
        for a, b in zip(cuts, cuts[1:], strict=False):
            places = 0.5 * (a + b) + 0.5 * (b - a) * nodes
            angle[k] += 0.5 * (b - a) * weights @ ramp(places)
    omega = turn * 1.9
    wave = 0.7 * np.sin(omega * times + 0.3)
    rate = 0.7 * omega * np.cos(omega * times + 0.3)
    return (
        angle + wave + ramp(times) + 2.0,
        ramp(times) + rate + pace,
        pace - omega**2 * wave + bend,
    )


def test_a_sum_has_the_values_and_derivatives_of_its_parts() -> None:
    system = driven(SUM)
    times = np.linspace(0.0, 2.0, 41)
    found = np.array([function_value.py_func(system.arrays, 0, t, t) for t in times]).T
    for values, wanted in zip(found, exact(times), strict=True):
        assert np.abs(values - wanted).max() < 1e-11 * np.abs(wanted).max()
    assert {0.3, 1.1} <= set(system.breaks)


def test_a_driven_rod_follows_a_sum() -> None:
    result = simulate(driven(SUM), rtol=1e-8)
    angle, rate, acceleration = exact(result.t)
    inertia = 1.0 / 12.0 + 0.25
    for column, wanted in enumerate((angle, rate, inertia * acceleration)):
        off = np.abs(result.values[:, column] - wanted).max()
        assert off < 1e-7 * np.abs(wanted).max()


def test_a_spin_up_is_one_function() -> None:
    """That of rotating beams: W / T (t^2 / 2 + (T / 2 pi)^2 (cos(2 pi t / T) - 1))."""
    W, T = 6.0, 1.5
    spin = {"type": "sine_ramp", "from": 0.0, "to": T, "end": W, "of": "rate"}
    result = simulate(driven(spin), rtol=1e-9)
    t, k = result.t, 2.0 * np.pi / T
    wanted = W / T * (0.5 * t**2 + (np.cos(k * t) - 1.0) / k**2)
    wanted = np.where(t < T, wanted, W * (t - 0.5 * T))
    assert np.abs(result.values[:, 0] - wanted).max() < 1e-10 * wanted.max()


def test_sums_scale_forces() -> None:
    """A force by a sum moves a mass as the forces by its parts do together."""

    def pushed(*functions: dict[str, Any]) -> Array:
        forces = {
            f"push_{k}": {
                "type": "force",
                "marker": "mass",
                "force": [1.0, 0.0],
                "function": function,
            }
            for k, function in enumerate(functions)
        }
        made = scene(
            {"mass": {"mass": 1.3}},
            end=1.7,
            steps=10,
            record=["mass.x"],
            forces=forces,
        )
        return simulate(compile_scene(made), rtol=1e-9).values

    one = pushed({"type": "sum", "parts": [RAMP, WAVE]}, SPIN)
    three = pushed(RAMP, WAVE, SPIN)
    assert np.abs(three).max() > 0.1
    assert np.abs(one - three).max() < 1e-8 * np.abs(three).max()


JUMP = {
    "type": "polynomial",
    "pieces": [
        {"from": 0.0, "to": 1.0, "coefficients": [0.0]},
        {"from": 1.0, "coefficients": [1.0]},
    ],
}


@pytest.mark.parametrize(
    ("function", "words"),
    [
        ({"type": "sum", "parts": []}, "parts"),
        ({"type": "sum", "parts": [{**RAMP, "to": 0.3}]}, r"parts\[0\].to: found 0.3"),
        ({**RAMP, "offset": 1.0}, "offset: is given with a ramp of the value"),
        ({"type": "sum", "parts": [{"type": "callable"}]}, "parts"),
        ({"type": "sum", "parts": [WAVE, JUMP]}, r"parts\[1\]: jumps by 1"),
    ],
)
def test_sums_and_ramps_that_are_not_sound(
    function: dict[str, Any], words: str
) -> None:
    with pytest.raises((InputError, ValueError), match=words):
        driven(function)
