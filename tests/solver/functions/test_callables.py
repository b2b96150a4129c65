"""Functions of programs: no part of them is lost, and jumps are told."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyder, polyval
from scipy.interpolate import make_interp_spline

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.solver import Timed, compile_scene, simulate
from sidtool.solver.diagnostics.result_notes import callable_notes
from sidtool.solver.diagnostics.run_summary import describe
from sidtool.solver.functions.callables import Derivatives, interpolate_callable
from tests.solver.dynamics.test_drives import cart
from tests.solver.dynamics.test_forces import pushed

Function = Callable[[float], float]
SPAN = (2.0, 12.0)
#: Pulses of height 1 on [0, 1], and their integrals.
PULSES: dict[str, tuple[Function, float]] = {
    "half sine": (lambda x: math.sin(math.pi * x), 2.0 / math.pi),
    "raised cosine": (lambda x: 0.5 - 0.5 * math.cos(2.0 * math.pi * x), 0.5),
    "triangle": (lambda x: 1.0 - abs(2.0 * x - 1.0), 0.5),
    "trapezium": (lambda x: min(1.0, 10.0 * x, 10.0 * (1.0 - x)), 0.9),
    "smooth": (lambda x: (4.0 * x * (1.0 - x)) ** 6, 4.0**6 / 12012.0),
}


def pulse(shape: str, begin: float, width: float, height: float = 500.0) -> Function:
    form = PULSES[shape][0]

    def value(t: float) -> float:
        x = (t - begin) / width
        return height * form(x) if 0.0 < x < 1.0 else 0.0

    return value


def impulse(program: Derivatives) -> float:
    """The integral over the span of what is made of a function."""
    edges, terms, _ = interpolate_callable(program, SPAN, "forces.push.function", False)
    powers = np.arange(terms.shape[1])
    even = np.where(powers % 2 == 0, 1.0 / (powers + 1), 0.0)
    return float(np.diff(edges) @ terms @ even)


@pytest.mark.parametrize("part", [0.07, 3e-4])
@pytest.mark.parametrize("shape", PULSES)
def test_no_pulse_is_lost(shape: str, part: float) -> None:
    """Its impulse is the exact one, wherever it lies."""
    random = np.random.default_rng([int(1e6 * part), list(PULSES).index(shape)])
    width = part * (SPAN[1] - SPAN[0])
    for begin in random.uniform(SPAN[0], SPAN[1] - width, 2):
        found = impulse(pulse(shape, begin, width))
        assert found == pytest.approx(500.0 * width * PULSES[shape][1], rel=1e-6)


@pytest.mark.parametrize("part", [1e-5, 1e-7])
def test_where_a_feature_is_named_it_may_be_as_short_as_one_likes(part: float) -> None:
    width = part * (SPAN[1] - SPAN[0])
    for begin in (4.1, 7.7654321):
        given = pulse("raised cosine", begin, width)
        for times in ((begin, begin + width), (begin + 0.4 * width,)):
            found = impulse(Timed(given, times=times))
            assert found == pytest.approx(250.0 * width, rel=1e-4)


def test_a_shorter_feature_can_be_asked_for() -> None:
    random = np.random.default_rng(7)
    for begin in random.uniform(3.0, 11.0, 2):
        given = pulse("half sine", begin, 2e-4)
        found = impulse(Timed(given, shortest=2e-4))
        assert found == pytest.approx(0.1 * 2.0 / math.pi, rel=1e-6)


@pytest.mark.parametrize("shortest", [0.0, 1e-6, float("nan")])
def test_what_cannot_be_looked_for_is_told(shortest: float) -> None:
    with pytest.raises(InputError, match="cannot be looked for; expected at least"):
        impulse(Timed(math.sin, shortest=shortest))


def test_the_shortest_feature_that_is_not_missed_is_reported() -> None:
    system = compile_scene(pushed({"type": "callable"}), forces={"push": math.sin})
    (found,) = callable_notes(system)
    assert (found.code, found.subject) == ("N328", "push")
    assert found.data["shortest"] == pytest.approx(1.0 / 4096.0, rel=1e-3)
    assert found.line in describe(system)


@pytest.mark.parametrize("begin", [0.137, 0.5, 0.8811])
def test_a_short_force_moves_what_it_pushes(begin: float) -> None:
    """By its impulse over the mass."""
    given = {"push": pulse("half sine", begin, 0.05, 20.0)}
    system = compile_scene(pushed({"type": "callable"}, "actuator"), forces=given)
    result = simulate(system, rtol=1e-8)
    speed = result.velocities[-1, 0]
    assert speed == pytest.approx(20.0 * 0.05 * 2.0 / math.pi / 2.0, rel=1e-6)


@pytest.mark.parametrize(
    ("given", "pieces"),
    [
        (lambda t: 0.0, 1),
        (lambda t: -3.7, 1),
        (lambda t: 1.0 + t - 0.3 * t**5, 1),
        (math.sin, 8),
        (lambda t: math.sin(40.0 * t), 256),
    ],
)
def test_what_is_smooth_stays_cheap(given: Function, pieces: int) -> None:
    edges, _, kinks = interpolate_callable(given, SPAN, "drives.motor.function")
    assert len(edges) <= pieces + 1
    assert kinks == ()


#: Halving meets some of these times exactly.
PLACES = [0.5, 0.125, 0.3]


@pytest.mark.parametrize("t0", PLACES)
@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda t: 0.5 * (t > 0.0), "jumps by 0.5"),
        (lambda t: 0.5 * (t >= 0.0), "jumps by 0.5"),
        (lambda t: math.cos(t) + (t if t > 0.0 else 0.0), "rate by (1|0.99999.) "),
        (lambda t: 1e-4 * abs(t) - t, "jumps in its rate by 0.0002"),
    ],
)
def test_no_place_of_a_jump_is_overlooked(
    given: Function, message: str, t0: float
) -> None:
    content = cart("planar", {"type": "callable"})
    with pytest.raises(InputError, match=message) as told:
        compile_scene(content, drives={"motor": lambda t: float(given(t - t0))})
    named = float(str(told.value).split("t = ")[1].split(" s")[0])
    assert named == pytest.approx(t0, abs=1e-4)


@pytest.mark.parametrize("t0", PLACES)
def test_no_force_that_jumps_is_taken(t0: float) -> None:
    with pytest.raises(InputError, match="the callable jumps by 3 at"):
        interpolate_callable(
            lambda t: 3.0 * (t >= t0), (0.0, 1.0), "forces.a.function", False
        )


@pytest.mark.parametrize("t0", PLACES)
@pytest.mark.parametrize("power", [1, 2])
def test_kinks_are_stepped_to_wherever_they_are(power: int, t0: float) -> None:
    def given(t: float) -> float:
        return float(max(t - t0, 0.0) ** power)

    _, _, kinks = interpolate_callable(given, (0.0, 1.0), "forces.a.function", False)
    assert kinks == pytest.approx((t0,), abs=1e-9)


def acceleration(edges: Array, terms: Array, times: Array) -> Array:
    """Of an interpolant; powers of x from -1 to 1 in each piece."""
    k = np.clip(np.searchsorted(edges, times) - 1, 0, len(terms) - 1)
    half = 0.5 * np.diff(edges)[k]
    twice = polyder(terms, 2, axis=1)[k]
    x = (times - edges[k]) / half - 1.0
    return np.asarray(polyval(x, twice.T, tensor=False)) / half**2


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("degree", [3, 5])
def test_a_drive_by_a_spline_has_the_acceleration_of_the_spline(
    degree: int, seed: int
) -> None:
    """Everywhere, right beside its knots as well, which are where steps end."""
    random = np.random.default_rng([degree, seed])
    times = np.array([0.0, *np.sort(random.uniform(0.05, 0.75, 4 + seed)), 0.8])
    spline = make_interp_spline(times, random.normal(size=len(times)), k=degree)
    knots = np.unique(spline.t)
    edges, terms, kinks = interpolate_callable(
        lambda t: float(spline(t)), (0.0, 0.8), "drives.a.function"
    )
    if degree == 3:
        assert len(terms) < 2 * len(knots)
        assert kinks == pytest.approx(tuple(knots[1:-1]), abs=1e-9)
    beside = knots[1:-1, None] + [-1e-5, -1e-6, -1e-8, 1e-8, 1e-6, 1e-5]
    looks = np.concatenate([random.uniform(0.0, 0.8, 500), beside.ravel()])
    exact = spline.derivative(2)(looks)
    gap = np.abs(acceleration(edges, terms, looks) - exact).max()
    assert gap < 1e-7 * np.abs(exact).max()


def bent(shape: str, power: int, t0: float, t: float) -> float:
    """Smooth, and from t0 on more by the power of the time since then."""
    added = max(t - t0, 0.0) ** power
    return {
        "zero": added,
        "cosine": math.cos(9.0 * t) + 3.0 * added,
        "growing": math.exp(2.0 * t) - added,
    }[shape]


@pytest.mark.parametrize("shape", ["zero", "cosine", "growing"])
@pytest.mark.parametrize("power", [1, 2, 3])
def test_jumps_up_to_the_third_derivative_are_found_wherever_they_are(
    power: int, shape: str
) -> None:
    """At random places, also close to both ends, and steps end at them."""
    random = np.random.default_rng([power, len(shape)])
    for t0 in (*random.uniform(0.02, 0.78, 2), random.uniform(0.02, 0.04)):
        edges, terms, kinks = interpolate_callable(
            lambda t, t0=t0: bent(shape, power, t0, t),  # type: ignore[misc]
            (0.0, 0.8),
            "forces.a.function",
            False,
        )
        assert kinks == pytest.approx((t0,), abs=1e-7)
        assert len(terms) < 8
        if shape == "cosine":
            looks = np.linspace(0.0, 0.8, 200)
            since = np.maximum(looks - t0, 0.0)
            jump = 3.0 * power * (power - 1) * since ** max(power - 2, 0) * (since > 0)
            exact = -81.0 * np.cos(9.0 * looks) + jump
            assert acceleration(edges, terms, looks) == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize("seed", range(2))
def test_smooth_functions_have_no_kinks_however_quick(seed: int) -> None:
    random = np.random.default_rng(seed)
    for width in 10.0 ** random.uniform(-3.0, 0.0, 4):
        middle, omega = random.uniform(0.05, 0.75), random.uniform(1.0, 60.0)
        functions = (
            lambda t, x=middle, w=width: math.exp(-(((t - x) / w) ** 2)),
            lambda t, x=middle, w=width: 1.0 / (1.0 + ((t - x) / w) ** 2),
            lambda t, x=middle, w=width: math.tanh((t - x) / w),
            lambda t, omega=omega: math.sin(omega * t * t),
        )
        for function in functions:
            _, _, kinks = interpolate_callable(
                function, (0.0, 0.8), "forces.a.function", False
            )
            assert kinks == ()


def test_jumps_of_the_fourth_derivative_are_followed_found_or_not() -> None:
    """No claim that each is an end of steps: values and accelerations are right."""
    random = np.random.default_rng(4)
    for t0 in random.uniform(0.05, 0.75, 4):
        edges, terms, kinks = interpolate_callable(
            lambda t, t0=t0: bent("cosine", 4, t0, t),  # type: ignore[misc]
            (0.0, 0.8),
            "forces.a.function",
            False,
        )
        assert len(kinks) <= 1
        looks = np.linspace(0.0, 0.8, 300)
        jump = 36.0 * np.maximum(looks - t0, 0.0) ** 2
        exact = -81.0 * np.cos(9.0 * looks) + jump
        assert acceleration(edges, terms, looks) == pytest.approx(exact, abs=1e-5)


def test_a_quick_but_smooth_change_of_speed_is_no_kink() -> None:
    """Within 1/2000 of the run."""

    def given(t: float) -> float:
        return 1e-4 * float(np.logaddexp(0.0, (t - 0.37) / 1e-4))

    content: Any = cart("planar", {"type": "callable"})
    system = compile_scene(content, drives={"motor": given})
    result = simulate(system)
    wanted: Array = np.array([given(t) for t in result.t])
    assert np.abs(result.values[:, 0] - wanted).max() < 1e-10
