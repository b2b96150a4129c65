"""Derivatives of linearised runs: direct, adjoint, and what cannot be linearised."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.special import ellipk

import sidtool
from sidtool.api.motion_problem import Point, RunOptions
from sidtool.api.sensitivity import parse_problem
from sidtool.sensitivity.seeds import functional_seeds, linear_functional
from sidtool.solver.simulation.linearised_run import LinearisedRun, NotLinearisable
from sidtool.solver.simulation.motion_derivatives import MotionDerivatives
from tests.places import EXAMPLES
from tests.steel_bars import steel_bar

from . import scenes
from .scenes import G

CRANK = "examples/slider_crank/slider_crank.toml"


def radau(scene: sidtool.Scene, **changes: Any) -> sidtool.Scene:
    """The scene with an integrator that is linearised."""
    return scene.with_({"accuracy.integrator": "radau9"} | changes)


def heavy_top() -> sidtool.Scene:
    """A spinning body in space on a ball joint, with a point mass on a spring that is
    fixed to it.
    """
    top = {
        "mass": 3.0,
        "inertia": [0.05, 0.05, 0.02],
        "markers": {"foot": {"position": [0.0, 0.0, -0.3]}},
        "initial": {
            "position": [0.0, 0.3 * math.sin(0.5), 0.3 * math.cos(0.5)],
            "axis_angle": [-0.5, 0.0, 0.0],
            "angular_velocity": [0.0, 15.0, 27.0],
        },
    }
    spring = {"type": "spring_damper", "markers": ["top", "bob"], "stiffness": 300.0}
    bob = {"mass": 0.4, "initial": {"position": [0.3, 0.2, 0.4]}}
    return sidtool.Scene(
        dimension="spatial",
        gravity=[0.0, 0.0, -G],
        time={"end": 0.3, "output_step": 0.1},
        accuracy={"rtol": 1e-7, "integrator": "radau9"},
        bodies={"top": top, "bob": bob},
        joints={"ball": {"type": "spherical", "markers": ["ground", "top.foot"]}},
        forces={"spring": spring | {"rest": 0.2, "damping": 2.0}},
    )


def swinging_guide() -> sidtool.Scene:
    """A block on a guide that turns: a direction on one body acts on the other."""
    guide = {
        "mass": 1.5,
        "inertia": 0.2,
        "centre_of_mass": [0.2, 0.0],
        "initial": {"angle": -0.4, "angular_velocity": 1.0},
    }
    start = {"position": [0.5 * math.cos(0.4), -0.5 * math.sin(0.4)]}
    return radau(
        scenes.scene(
            gravity=[0.0, -G],
            time={"end": 0.5, "output_step": 0.1},
            accuracy={"rtol": 1e-10},
            bodies={"guide": guide, "block": {"mass": 0.7, "initial": start}},
            joints={
                "pin": {"type": "revolute", "markers": ["ground", "guide"]},
                "slide": {"type": "point_on_line", "markers": ["guide", "block"]},
            },
        )
    )


def point_of(
    scene: sidtool.Scene, keys: list[str], functionals: list[str], method: str = "auto"
) -> Point:
    problem = parse_problem(scene, keys, functionals, RunOptions(method=method))
    return problem.at(problem.x0)


def test_adjoint_and_direct_are_transposes() -> None:
    """For any seeds; masses, a length that moves constraints, the duration."""
    keys = ["piston.mass", "crank.markers.pin.position[0]", "time.end"]
    scene = sidtool.Scene.load(CRANK).with_({"time.end": 0.2})
    point = point_of(scene, keys, ["rms(rod.q1)"])
    assert point.history is not None and point.grid is not None
    run = LinearisedRun(point.history.motion, point.grid)
    assert not len(run.directions)
    derivatives = MotionDerivatives(run)
    changes = []
    for k, value in enumerate(point.x):
        one = np.eye(len(keys))[k]
        pair = [point.neighbour_along(one, e * value) for e in (1e-5, -1e-5)]
        change = derivatives.parameter_change((pair[0], pair[1]), 1e-5 * value, value)
        changes.append(change)
    undefined = replace(changes[0], start=changes[0].start * np.nan)
    with pytest.raises(NotLinearisable):
        derivatives.direct([undefined])
    z, v = derivatives.direct(changes)
    states = np.concatenate([z[:, : run.nz], v], axis=1)
    seeds = np.random.default_rng(0).standard_normal((*states.shape[:2], 2))
    gradient = derivatives.adjoint(seeds)
    for k, change in enumerate(changes):
        direct = np.einsum("nr,nrc->c", states[:, :, k], seeds)
        assert gradient.along(change) == pytest.approx(direct, rel=1e-10)


@pytest.mark.parametrize(
    ("scene", "keys", "functionals"),
    [
        (
            heavy_top(),
            ["top.mass", "top.markers.foot.position[2]", "spring.stiffness"],
            ["final(bob.x)", "rms(top.wx)", "max_abs(ball.fz)", "value(top.z, 0.2)"],
        ),
        (
            swinging_guide(),
            ["block.mass", "gravity[1]", "guide.centre_of_mass[0]"],
            ["final(block.x)", "mean(guide.wz)", "max_abs(pin.fx)"],
        ),
        (
            sidtool.Scene.load(CRANK).with_({"time.end": 0.2}),
            ["piston.mass", "crank.markers.pin.position[0]"],
            ["rms(rod.q1)", "max_abs(crank_pin.fx)", "norm(rod.q1, 4)"],
        ),
    ],
    ids=["top", "guide", "crank"],
)
def test_against_differences_of_runs(
    scene: sidtool.Scene, keys: list[str], functionals: list[str]
) -> None:
    """In space and in plane, with joints and forces between bodies that turn."""
    found = {
        method: point_of(scene, keys, functionals, method).sensitivities()
        for method in ("adjoint", "direct", "differences")
    }
    adjoint = found["adjoint"]
    exact = adjoint.derivatives
    size = np.abs(np.divide.outer(adjoint.values, adjoint.point))
    size = np.maximum(size, np.abs(exact))
    assert (np.abs(found["direct"].derivatives - exact) < 1e-9 * size).all()
    assert (np.abs(found["differences"].derivatives - exact) < 1e-8 * size).all()
    for method, one in found.items():
        assert set(one.methods.values()) == {method}
        error = np.abs(one.derivatives - exact)
        assert (error < 10.0 * (one.errors + found["adjoint"].errors)).all()


@pytest.mark.parametrize("method", ["adjoint", "direct"])
def test_a_pendulum_by_its_length(method: str) -> None:
    """At a quarter of the period x = -v (t - T/4), T/4 = sqrt(L / g) K(1/2)."""
    quarter = math.sqrt(1.0 / G) * ellipk(0.5)
    scene = radau(scenes.pendulum(), **{"time.end": quarter, "events": {}})
    keys = ["parameters.length", "gravity[1]", "bob.mass", "time.end"]
    found = sidtool.sensitivity(scene, keys, "final(bob.x)", method=method)
    v = math.sqrt(2.0 * G)
    exact = [0.5 * v * quarter, 0.5 * v * quarter / G, 0.0, -v]
    assert found.derivatives[0] == pytest.approx(exact, rel=1e-8, abs=1e-9)
    assert set(found.methods.values()) == {method} and not found.reason
    assert found.runs == 1


@pytest.mark.parametrize("method", ["adjoint", "direct"])
def test_the_state_transition_matrix(method: str) -> None:
    keys = ["block.initial.position[0]", "block.initial.velocity[0]"]
    found = sidtool.sensitivity(
        radau(scenes.oscillator()),
        keys,
        ["final(block.x)", "final(block.vx)"],
        method=method,
    )
    A = np.array([[0.0, 1.0], [-25.0, -0.2]])
    assert found.derivatives == pytest.approx(expm(2.0 * A), rel=1e-9)


def test_a_break_that_moves() -> None:
    """A force that grows from t1 on: x(2) = a (2 - t1)^3 / 6 m."""
    before = {"from": 0.0, "to": "first", "coefficients": [0.0]}
    after = {"from": "first", "coefficients": [0.0, 3.0]}
    function = {"type": "polynomial", "pieces": [before, after]}
    force = {"type": "force", "marker": "block", "force": [1.0, 0.0]}
    scene = scenes.scene(
        parameters={"first": 1.0},
        bodies={"block": scenes.block(0.0, 0.0)},
        joints={"guide": scenes.GUIDE},
        forces={"a": force | {"function": function}},
    )
    found = sidtool.sensitivity(
        radau(scene),
        ["parameters.first", "time.end"],
        "final(block.x)",
        method="direct",
    )
    assert found.derivatives[0] == pytest.approx([-3.0 / 4.0, 3.0 / 4.0], rel=1e-8)


def test_what_is_not_linearised() -> None:
    """With friction differences of runs are taken and the reason is stated; a method of
    the linearised run is refused.
    """
    keys, of = ["block.initial.velocity[0]"], "final(block.x)"
    scene = radau(scenes.sliding_block())
    found = sidtool.sensitivity(scene, keys, of)
    assert set(found.methods.values()) == {"differences"}
    assert found.reason == "joint friction" and "joint friction" in found.report()
    assert found.data()["methods"] == {keys[0]: "differences"}
    with pytest.raises(sidtool.InputError, match="joint friction"):
        sidtool.sensitivity(scene, keys, of, method="adjoint")
    with pytest.raises(sidtool.InputError, match="auto, adjoint"):
        sidtool.sensitivity(scene, keys, of, method="tangent")


def test_functionals_with_and_without_a_motion() -> None:
    found = sidtool.sensitivity(
        radau(scenes.oscillator()),
        ["block.mass"],
        ["mass(block)", "final(block.x)", "frequency(1)"],
        method="direct",
    )
    f = math.sqrt(50.0 / 2.0) / 2.0 / math.pi
    assert found.derivatives[[0, 2], 0] == pytest.approx([1.0, -f / 4.0], rel=1e-5)


def test_an_event_that_ends_the_run() -> None:
    """A quarter of the period, at the lowest point of a pendulum; direct alone."""
    keys = ["parameters.length", "gravity[1]", "bob.mass"]
    of = ["end_time", "final(bob.vx)", "mean(bob.y)"]
    scene = radau(scenes.pendulum(), **{"accuracy.rtol": 1e-10})
    found = sidtool.sensitivity(scene, keys, of, method="direct")
    quarter, v = math.sqrt(1.0 / G) * ellipk(0.5), -math.sqrt(2.0 * G)
    mean = found.values[2]  # in proportion to the length
    exact = [
        [quarter / 2.0, quarter / 2.0 / G, 0.0],
        [v / 2.0, -v / 2.0 / G, 0.0],
        [mean, 0.0, 0.0],
    ]
    assert found.derivatives == pytest.approx(np.array(exact), rel=1e-9, abs=1e-9)
    assert set(found.methods.values()) == {"direct"}
    with pytest.raises(sidtool.InputError, match="an event ends"):
        sidtool.sensitivity(scene, keys, of, method="adjoint")


def test_many_variables_take_the_adjoint() -> None:
    scene = sidtool.Scene.load(CRANK).with_({"time.end": 0.05})
    found = point_of(scene, ["bodies.*"], ["value(rod.q1, 0.04)"]).sensitivities()
    assert len(found.variables) > 8
    assert set(found.methods.values()) == {"adjoint"}
    direct = point_of(scene, ["bodies.*"], ["value(rod.q1, 0.04)"], "direct")
    exact = direct.sensitivities().derivatives
    size = np.abs(exact).max()
    assert found.derivatives == pytest.approx(exact, rel=1e-8, abs=1e-9 * size)


@pytest.mark.parametrize("method", ["adjoint", "direct"])
def test_a_screw(method: str) -> None:
    """Both terms of its constraint belong to one body; z = -g t^2 m p^2 / 2 (m p^2 + I)
    with p, the way per radian.
    """
    mass, inertia, pitch, t = 2.0, 0.03, 0.4, 0.5
    nut = {"mass": mass, "inertia": [0.02, 0.02, inertia]}
    screw = {"type": "screw", "markers": ["ground", "nut"], "axis": [0.0, 0.0, 1.0]}
    scene = sidtool.Scene(
        dimension="spatial",
        gravity=[0.0, 0.0, -G],
        time={"end": t, "output_step": 0.1},
        accuracy={"rtol": 1e-9, "integrator": "radau9"},
        bodies={"nut": nut},
        joints={"screw": screw | {"pitch": pitch}},
    )
    keys = ["nut.mass", "nut.inertia[2]", "screw.pitch"]
    found = sidtool.sensitivity(scene, keys, "final(nut.z)", method=method)
    p = pitch / 2.0 / math.pi
    total = mass * p**2 + inertia
    z = -G * t**2 / 2.0 * mass * p**2 / total
    shares = [
        1 / mass - p**2 / total,
        -1 / total,
        2 / pitch * (1 - mass * p**2 / total),
    ]
    assert found.values[0] == pytest.approx(z, rel=1e-9)
    assert found.derivatives[0] == pytest.approx(z * np.array(shares), rel=1e-8)


@pytest.mark.parametrize("method", ["adjoint", "direct"])
def test_a_static_start(method: str) -> None:
    """A mass that rests on a spring, x = rest + m g / k, for all time."""
    rest = {"gravity": [3.0, 0.0], "initial.state": "static"}
    rest["block.initial.velocity"] = [0.0, 0.0]
    scene = radau(scenes.oscillator(), **rest)
    keys = ["block.mass", "spring.stiffness", "spring.rest", "gravity[0]"]
    found = sidtool.sensitivity(scene, keys, "final(block.x)", method=method)
    exact = [3.0 / 50.0, -6.0 / 50.0**2, 1.0, 2.0 / 50.0]
    assert found.values[0] == pytest.approx(0.4 + 6.0 / 50.0, rel=1e-9)
    assert found.derivatives[0] == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize("method", ["adjoint", "direct"])
def test_a_stiff_contact_that_is_never_lost(method: str) -> None:
    """It gives way by 20 um, a metre from the origin: differences of coordinates stay
    within the contact. A mass on a spring, pushed by F sin(w t).
    """
    k, w, F, end = 1e6, 500.0, 5.0, 0.3
    table = {"deflection": [-1e-3, 0.0, 1.0], "force": [-k * 1e-3, 0.0, 0.0]}
    push = {"type": "force", "marker": "block", "force": [0.0, -1.0]}
    harmonic = {"type": "harmonic", "amplitude": F, "angular_frequency": w}
    scene = scenes.scene(
        gravity=[0.0, -G],
        time={"end": end, "output_step": 0.1},
        accuracy={"rtol": 1e-9},
        initial={"state": "static"},
        bodies={
            "block": {"mass": 2.0, "inertia": 0.1, "initial": {"position": [0.0, 1.0]}}
        },
        joints={
            "guide": {
                "type": "prismatic",
                "markers": ["ground", "block"],
                "axis": [0.0, 1.0],
            }
        },
        forces={
            "contact": {
                "type": "spring_damper",
                "joint": "guide",
                "rest": 1.0,
                "table": table,
            },
            "push": push | {"function": harmonic},
        },
    )

    def force(m: complex) -> complex:
        own = np.sqrt(k / m)
        x = -F / m / (own**2 - w**2) * (np.sin(w * end) - w / own * np.sin(own * end))
        return m * G - k * x

    of = "final(contact.force)"
    found = sidtool.sensitivity(radau(scene), ["block.mass"], of, method=method)
    assert found.values[0] == pytest.approx(force(2.0), rel=1e-6)
    assert found.derivatives[0, 0] == pytest.approx(
        np.imag(force(2.0 + 1e-20j)) / 1e-20, rel=1e-5
    )
    assert set(found.methods.values()) == {method}


@pytest.mark.parametrize(
    "value",
    [
        "sign(block.x + 9)",
        "-clip(20*block.x, -3, 3)",
        "-abs(block.x)",
        "lookup(k, block.x)",
        "max(1 - block.x, 0)",
    ],
)
def test_formulas_with_corners_take_differences(value: str) -> None:
    scene = radau(
        scenes.oscillator(),
        tables={"k": {"x": [-1.0, 0.0, 1.0], "values": [0.0, 1.0, 0.0]}},
        **{
            "forces.law": {
                "type": "actuator",
                "joint": "guide",
                "function": {"type": "expression", "value": value},
            }
        },
    )
    with pytest.raises(sidtool.InputError, match="a formula with corners"):
        sidtool.sensitivity(scene, ["block.mass"], "final(block.x)", method="direct")
    smooth = scene.with_(
        {
            "tables.k.interpolation": "smooth",
            "forces.law.function.value": "lookup(k, block.x)",
        }
    )
    found = sidtool.sensitivity(smooth, ["block.mass"], "final(block.x)")
    assert set(found.methods.values()) == {"direct"}


@pytest.mark.parametrize(
    "scene",
    [heavy_top(), sidtool.Scene.load(CRANK).with_({"time.end": 0.2})],
    ids=["space", "driven"],
)
def test_rates_of_constraints_by_positions(scene: sidtool.Scene) -> None:
    """From the rate of the constraint Jacobian along the motion: those of differences
    of the rates of the constraints, at fixed velocities.
    """
    body = next(iter(scene.bodies))
    point = point_of(scene, [f"{body}.mass"], [f"final({body}.x)"])
    assert point.history is not None and point.grid is not None
    run = LinearisedRun(point.history.motion, point.grid)
    derivatives = MotionDerivatives(run)
    found, ends = derivatives._projection, derivatives.ends
    for k in range(run.nv):
        parts = []
        for sign in (1.0, -1.0):
            z = ends.z.copy()
            z[:, : run.nz] += sign * 1e-6 * found.Z[:, :, k]
            parts.append(
                run.constraints(run.system, replace(ends, z=z), run.work)[:, run.m :]
            )
        expected = (parts[0] - parts[1]) / 2e-6
        size = 1.0 + np.abs(expected).max()
        assert np.abs(found.rates[:, k] - expected).max() < 1e-8 * size


def test_stresses_of_small_deformations() -> None:
    """A steel beam swings and carries a mass: the equivalent stress, a root of squares,
    is curved on the scale of itself, far below a step of 1e-6 of the length.

    Checked beside differences of whole runs by the mass that it carries.
    """
    bar = steel_bar(
        elements=4,
        reduction={"method": "craig_bampton", "interfaces": ["tip"], "modes": 1},
        stress={},
    )
    scene = sidtool.Scene.checked(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "planar",
            "gravity": [0.0, -G],
            "time": {"end": 0.05, "output_step": 0.01},
            "accuracy": {"rtol": 1e-9, "integrator": "radau9"},
            "bodies": {
                "bar": {
                    "sid": "-",
                    "markers": {"a": 1, "b": 2},
                },
                "bob": {"mass": 0.3, "initial": {"position": [1.0, 0.0]}},
            },
            "joints": {
                "hinge": {"type": "revolute", "markers": ["ground", "bar.a"]},
                "end": {"type": "coincident", "markers": ["bar.b", "bob"]},
            },
        },
        "scene",
    )
    found = {
        method: sidtool.sensitivity(
            scene,
            ["bob.mass", "gravity[1]"],
            "final(bar.norm_von_mises)",
            method=method,
            sids={"bar": bar},
        ).derivatives[0]
        for method in ("adjoint", "direct")
    }
    assert found["adjoint"] == pytest.approx(found["direct"], rel=1e-6)
    h = 1e-3
    ends = [
        sidtool.simulate(scene.with_({"bob.mass": 0.3 + step}), sids={"bar": bar})
        for step in (h, -h)
    ]
    values = [end["bar.norm_von_mises"][-1] for end in ends]
    change = (values[0] - values[1]) / (2 * h)
    assert found["adjoint"][0] == pytest.approx(change, rel=1e-4)


def test_an_output_depends_on_its_own_coordinates_alone() -> None:
    """A position of a body in space: of all coordinates of the scene on one."""
    point = point_of(heavy_top(), ["top.mass"], ["mean(bob.y)"], method="adjoint")
    assert point.history is not None and point.grid is not None
    run = LinearisedRun(point.history.motion, point.grid)
    (term,) = point.terms
    steps = run.coordinate_steps
    linear = linear_functional(term.functional, point.history, term.peak)
    seeds = functional_seeds(linear, point.history, steps, run.nz)
    assert np.count_nonzero(np.abs(seeds).max(axis=0)) == 1


def test_rows_of_rounding_do_not_ask_for_differences() -> None:
    """The satellite turns in a plane: rows of what crosses it hold rounding only."""
    panels = {f"{side}.model": "panel.toml" for side in ("left", "right")}
    scene = sidtool.Scene.load(EXAMPLES / "satellite" / "scene.toml")
    point = point_of(
        scene.with_(panels | {"time.end": 1.0}), ["hub.mass"], ["mean(hub.wy)"]
    )
    assert point.history is not None and point.grid is not None
    run = LinearisedRun(point.history.motion, point.grid)
    assert 0 < len(run.directions) < (run.nz + run.nv) / 2


def test_a_load_that_begins_to_turn_on_an_elastic_arm() -> None:
    """Its quaternion is constant at first: differences by its components take steps of
    the whole motion. Beside differences of runs; the load in the arm's frame moves no
    constraint.
    """
    bar = steel_bar(elements=4, modes=2)
    load = {
        "mass": 2.0,
        "inertia": [0.01, 0.02, 0.02],
        "initial": {"position": [1, 0, 0]},
    }
    scene = sidtool.Scene.checked(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial",
            "gravity": [0.0, 0.0, -G],
            "time": {"end": 0.6, "output_step": 0.1},
            "accuracy": {"rtol": 1e-6, "integrator": "radau9"},
            "bodies": {
                "bar": {"sid": "-", "markers": {"a": 1, "b": 2}},
                "load": load | {"centre_of_mass": [0.05, 0.02, 0.0]},
            },
            "joints": {
                "hinge": {
                    "type": "revolute",
                    "markers": ["ground", "bar.a"],
                    "axis": [0.0, 0.0, 1.0],
                },
                "end": {"type": "fixed", "markers": ["bar.b", "load"]},
            },
            "drives": {
                "motor": {
                    "joint": "hinge",
                    "function": {
                        "type": "smooth_step",
                        "from": 0.1,
                        "to": 0.5,
                        "end": 1.5,
                    },
                }
            },
        },
        "scene",
    )
    functionals = ["final(load.z)", "max_abs(motor.mz)", "final(load.x)"]
    found = {
        method: sidtool.sensitivity(
            scene, ["load.mass"], functionals, method=method, sids={"bar": bar}
        )
        for method in ("differences", "direct", "adjoint")
    }
    expected = found.pop("differences").derivatives
    for each in found.values():
        assert each.derivatives == pytest.approx(expected, rel=1e-8)
