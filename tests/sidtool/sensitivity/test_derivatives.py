"""Derivatives of motions against closed solutions, Taylor remainders, structure."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq, minimize
from scipy.special import ellipk

import sidtool
from sidtool.api.motion_problem import RunOptions
from sidtool.api.sensitivity import parse_problem
from sidtool.sensitivity.differences import differentiate, rounding_of
from tests.codes import codes, only

from . import scenes
from .scenes import G

pytestmark = pytest.mark.filterwarnings("ignore::sidtool.DiagnosticWarning")

NODES, WEIGHTS = np.polynomial.legendre.leggauss(60)


def position(t: Any, m: Any, k: Any, c: Any, rest: Any, x0: Any, v0: Any) -> Any:
    """A damped oscillator."""
    decay, w = c / 2 / m, np.sqrt(k / m - (c / 2 / m) ** 2 + 0j)
    sine = (v0 + decay * (x0 - rest)) / w
    return rest + np.exp(-decay * t) * (
        (x0 - rest) * np.cos(w * t) + sine * np.sin(w * t)
    )


def velocity(t: Any, m: Any, k: Any, c: Any, rest: Any, x0: Any, v0: Any) -> Any:
    """Its velocity."""
    decay, w = c / 2 / m, np.sqrt(k / m - (c / 2 / m) ** 2 + 0j)
    cosine, sine = x0 - rest, (v0 + decay * (x0 - rest)) / w
    return np.exp(-decay * t) * (
        (w * sine - decay * cosine) * np.cos(w * t)
        - (decay * sine + w * cosine) * np.sin(w * t)
    )


OSCILLATOR = {
    "block.mass": 2.0,
    "spring.stiffness": 50.0,
    "spring.damping": 0.4,
    "spring.rest": 0.4,
    "block.initial.position[0]": 0.5,
    "block.initial.velocity[0]": 0.3,
}
EXACT: dict[str, Callable[..., Any]] = {
    "final(block.x)": lambda *p: position(2.0, *p),
    "value(block.vx, 1.3)": lambda *p: velocity(1.3, *p),
    "mean(block.x)": lambda *p: position(1 + NODES, *p) @ WEIGHTS / 2,
    "integral(block.x)": lambda *p: position(1 + NODES, *p) @ WEIGHTS,
    "rms(block.vx)": lambda *p: np.sqrt(velocity(1 + NODES, *p) ** 2 @ WEIGHTS / 2),
    "norm(block.vx, 4)": lambda *p: (
        (velocity(1 + NODES, *p) ** 4 @ WEIGHTS / 2) ** 0.25
    ),
    "frequency(1)": lambda m, k, *_: np.sqrt(k / m) / 2 / np.pi,
    "damping_ratio(1)": lambda m, k, c, *_: c / 2 / np.sqrt(k * m),
    "mass(block)": lambda m, *_: m,
    "static(block.x)": lambda m, k, c, rest, *_: rest,
}


def test_mass_spring_by_every_parameter() -> None:
    """Against the complex step through the closed solution; errors are estimated."""
    found = sidtool.sensitivity(
        scenes.oscillator(), [*OSCILLATOR], [*EXACT], integrator="radau9"
    )
    for i, (name, formula) in enumerate(EXACT.items()):
        is_mode = name.endswith("(1)")  # rounding of eigenvalues is larger
        noise = 5e-6 if is_mode else 1e-7
        for j in range(3 if is_mode else len(OSCILLATOR)):
            numbers = [*map(complex, OSCILLATOR.values())]
            numbers[j] += 1e-30j
            exact = complex(formula(*numbers)).imag / 1e-30
            size = max(abs(exact), 1e-2 * abs(found.values[i] / found.point[j]))
            error = abs(found.derivatives[i, j] - exact)
            assert error < noise * size
            assert error < 10.0 * found.errors[i, j] + 0.1 * noise * size


def test_extrema_at_their_instant() -> None:
    """x = rest +- A without damping: dA = ((x0 - rest) dx0 + v0 dv0 / w^2 ...) / A."""
    found = sidtool.sensitivity(
        scenes.oscillator(damping=0.0),
        ["spring.rest", "block.initial.position[0]", "block.initial.velocity[0]"],
        ["max(block.x)", "min(block.x)"],
    )
    w = 5.0
    amplitude = math.hypot(0.1, 0.3 / w)
    by_position, by_velocity = 0.1 / amplitude, 0.3 / w**2 / amplitude
    exact = [
        [1 - by_position, by_position, by_velocity],
        [1 + by_position, -by_position, -by_velocity],
    ]
    assert found.values == pytest.approx([0.4 + amplitude, 0.4 - amplitude], rel=1e-9)
    assert found.derivatives == pytest.approx(np.array(exact), rel=1e-6)


def test_the_time_in_which_an_oscillation_settles() -> None:
    """The last time at which the closed solution crosses the edge of the band."""
    band, names = 0.02, list(OSCILLATOR)
    point = OSCILLATOR | {"spring.damping": 6.0}
    found = sidtool.sensitivity(
        scenes.oscillator(damping=6.0), names, f"settling_time(block.x, {band})"
    )

    def settling(*p: float) -> float:
        def beyond(t: Any) -> Any:
            return abs((position(t, *p) - position(2.0, *p)).real) - band

        t = np.linspace(0.0, 2.0, 2001)
        last = int(np.flatnonzero(beyond(t) > 0.0)[-1])
        return float(brentq(beyond, t[last], t[last + 1], xtol=1e-15))

    numbers = np.array([*point.values()])
    assert found.values[0] == pytest.approx(settling(*numbers), rel=1e-8)
    for j, size in enumerate(numbers):
        change = np.zeros(len(numbers))
        change[j] = 1e-4 * size
        near = settling(*(numbers + change)) - settling(*(numbers - change))
        far = settling(*(numbers + 2 * change)) - settling(*(numbers - 2 * change))
        exact = (8.0 * near - far) / (12.0 * change[j])
        assert found.derivatives[0, j] == pytest.approx(exact, rel=1e-6, abs=1e-8)


def test_what_never_leaves_the_band_has_settled_at_the_start() -> None:
    found = sidtool.sensitivity(
        scenes.oscillator(), "spring.damping", "settling_time(block.x, 1.0)"
    )
    assert found.values[0] == 0.0 and found.derivatives[0, 0] == 0.0


def test_a_pendulum_that_an_event_stops() -> None:
    """A quarter of the period is sqrt(L / g) K(1/2), in proportion to sqrt(L / g)."""
    found = sidtool.sensitivity(
        scenes.pendulum(), ["parameters.length", "gravity[1]", "bob.mass"], "end_time"
    )
    quarter = math.sqrt(1.0 / G) * ellipk(0.5)
    assert found.values[0] == pytest.approx(quarter, rel=1e-9)
    exact = [0.5 * quarter, 0.5 * quarter / G, 0.0]
    assert found.derivatives[0] == pytest.approx(exact, rel=1e-9, abs=1e-11)


def test_friction_that_holds_a_block() -> None:
    """It slides v^2 / 2 mu g; the instant at which it stops moves with the numbers."""
    found = sidtool.sensitivity(
        scenes.sliding_block(),
        ["guide.friction.coefficient", "block.initial.velocity[0]", "gravity[1]"],
        "final(block.x)",
    )
    x = 9.0 / (2 * 0.3 * G)
    assert found.derivatives[0] == pytest.approx([-x / 0.3, 2 * x / 3, x / G], rel=1e-8)


def test_a_corner_of_a_force() -> None:
    """A block is in contact for half a period; corner and contact time move."""
    found = sidtool.sensitivity(
        scenes.bumper(),
        ["block.mass", "bumper.rest", "bumper.table.force[0]"],
        ["final(block.x)", "min(block.x)"],
    )
    w = 10.0
    assert found.values == pytest.approx(
        [0.3 + 2.0 - 0.7 - math.pi / w, 0.3 - 1 / w], rel=1e-9
    )
    by_w = np.array([math.pi / w**2, 1 / w**2])[:, None]
    exact = by_w * [-w / 4, 0.0, -w / 400] + np.array([[0, 2, 0], [0, 1, 0]])
    assert found.derivatives == pytest.approx(exact, rel=1e-6)


def test_initial_values_against_the_state_transition_matrix() -> None:
    keys = ["block.initial.position[0]", "block.initial.velocity[0]"]
    found = sidtool.sensitivity(
        scenes.oscillator(), keys, ["final(block.x)", "final(block.vx)"]
    )
    A = np.array([[0.0, 1.0], [-25.0, -0.2]])
    assert found.derivatives == pytest.approx(expm(2.0 * A), rel=1e-9)
    assert np.linalg.det(found.derivatives) == pytest.approx(math.exp(-0.4), rel=1e-9)


CRANK = "examples/slider_crank/slider_crank.toml"


@pytest.mark.parametrize("integrator", ["radau9", "trapezoidal", "generalised_alpha"])
def test_taylor_remainders_fall_fourfold(integrator: str) -> None:
    """J(x + h) - J(x) - h J'(x) is of second order in h, on the grid of the run."""
    problem = parse_problem(
        sidtool.Scene.load(CRANK).with_({"time.end": 0.5}),
        ["crank.markers.pin.position[0]", "piston.mass"],
        ["max_abs(rod.q1)", "rms(rod.q1)", "max_abs(crank_pin.fx)"],
        RunOptions(integrator=integrator, step=0.01),
    )
    point = problem.at(problem.x0)
    found = point.sensitivities()
    direction = np.array([0.01, 1.0])
    slope = found.derivatives @ direction
    remainders = []
    for h in (0.5, 0.25, 0.125):
        values = point.neighbour(problem.x0 + h * direction)[:3]
        remainders.append(values - found.values - h * slope)
    ratios = np.array(remainders[:-1]) / np.array(remainders[1:])
    assert (ratios > 3.6).all() and (ratios < 4.5).all()


def test_a_gradient_for_scipy() -> None:
    """The spring constant with which a block is at x = 0.35 m after 1.3 s."""
    scene = scenes.oscillator().with_({"time.end": 1.3})
    values = sidtool.gradient(scene, ["spring.stiffness"], ["final(block.x)"])
    value, slope = values(values.x0)
    assert value.shape == (1,) and slope.shape == (1, 1)
    function = sidtool.gradient(scene, "spring.stiffness", "final(block.x)")

    def square(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = function(x)
        return (value - 0.35) ** 2, 2 * (value - 0.35) * slope

    found = minimize(square, function.x0, jac=True, method="BFGS", tol=1e-10)
    numbers = 2.0, found.x[0], 0.4, 0.4, 0.5, 0.3
    assert position(1.3, *numbers).real == pytest.approx(0.35, abs=1e-6)


def test_two_peaks_with_other_derivatives() -> None:
    """|x| of an oscillation about zero is largest on both sides; rest moves one up."""
    spring = {"type": "spring_damper", "joint": "guide", "stiffness": 50.0}
    guide = scenes.GUIDE | {"type": "prismatic", "axis": [1.0, 0.0]}
    scene = scenes.scene(
        bodies={"block": scenes.block(0.1, 0.0) | {"inertia": 0.1}},
        joints={"guide": guide},
        forces={"spring": spring},
    )
    found = sidtool.sensitivity(scene, "spring.rest", "max_abs(block.x)")
    assert only(found, "N736").data["difference"] > 0.5


def test_a_large_error_is_reported() -> None:
    """Long fixed steps pass a corner of a force: the run is not smooth there."""
    scene = scenes.bumper(step=0.05)
    found = sidtool.sensitivity(scene, "bumper.rest", "final(block.x)")
    assert "N737" in codes(found)


def test_breaks_that_coincide() -> None:
    """Two forces begin to grow at once: x(2) = sum a_i (2 - t_i)^3 / 6 m."""

    def growing(rate: float, start: str) -> dict[str, Any]:
        before = {"from": 0.0, "to": start, "coefficients": [0.0]}
        after = {"from": start, "coefficients": [0.0, rate]}
        pieces = {"type": "polynomial", "pieces": [before, after]}
        force = {"type": "force", "marker": "block", "force": [1.0, 0.0]}
        return force | {"function": pieces}

    scene = scenes.scene(
        parameters={"first": 1.0, "second": 1.0},
        bodies={"block": scenes.block(0.0, 0.0)},
        joints={"guide": scenes.GUIDE},
        forces={"a": growing(3.0, "first"), "b": growing(5.0, "second")},
    )
    found = sidtool.sensitivity(scene, "parameters.*", "final(block.x)")
    assert found.values[0] == pytest.approx(8.0 / 12.0)
    assert found.derivatives[0] == pytest.approx([-3.0 / 4.0, -5.0 / 4.0], rel=1e-6)


def test_no_derivative_where_a_block_just_sticks() -> None:
    """With less friction it slides, with more it stays: only one side moves."""
    push = {"type": "force", "marker": "block", "force": [0.3 * 2.0 * G, 0.0]}
    scene = scenes.sliding_block().with_(
        {"forces": {"push": push}, "block.initial.velocity[0]": 0.0}
    )
    key = "guide.friction.coefficient"
    found = sidtool.sensitivity(scene, key, "final(block.x)")
    assert only(found, "N735").subject == key
    assert np.isnan(found.derivatives).all()


def test_no_derivative_by_a_number_that_must_not_change_alone() -> None:
    """Where the velocity of a drive would jump, a scene is refused."""
    first = {"from": 0.0, "to": 1.0, "coefficients": [0.0, 1.0]}
    second = {"from": 1.0, "coefficients": [1.0, 1.0]}
    drive = {"type": "polynomial", "pieces": [first, second]}
    scene = scenes.scene(
        bodies={"block": scenes.block(0.0, 1.0)},
        joints={"guide": scenes.GUIDE},
    )
    scene = scene.with_(
        {"drives.x": {"marker": "block", "coordinate": "x", "function": drive}}
    )
    key = "drives.x.function.pieces[1].coefficients[1]"
    found = sidtool.sensitivity(scene, key, "final(block.x)")
    assert only(found, "N735").subject == key
    assert np.isnan(found.derivatives[0, 0])
    with pytest.raises(sidtool.InputError):
        sidtool.gradient(scene, key, "final(block.x)")([1.0])


def test_past_a_singular_configuration() -> None:
    found = sidtool.sensitivity(
        scenes.folding_crank(), "parameters.w", "final(piston.x)"
    )
    assert only(found, "N738").t == pytest.approx(math.pi / 2, abs=0.15)
    exact = -2.0 * 2.0 * math.sin(2.0)
    assert found.derivatives[0, 0] == pytest.approx(exact, rel=1e-5)


def test_a_functional_that_oscillates_with_a_variable() -> None:
    """J = sin(c p) / c + p^2 of a large c: steps that do not resolve it see noise."""
    c = 3e5

    def evaluate(points: Any) -> list[np.ndarray]:
        return [np.array([math.sin(c * p) / c + p * p]) for p in points]

    values, size = evaluate([0.1])[0], 0.1
    noise = rounding_of(evaluate, 0.1, 1e-6, values)
    found = differentiate(evaluate, 0.1, size, values, np.array([1e-6]), noise)
    error = abs(found.derivatives[0] - math.cos(c * 0.1) - 0.2)
    assert error < 1e-5 and error < 3.0 * found.errors[0]
