"""Friction from the load of a joint: when it sticks and slips, and where it stops."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.sid import SID
from sidtool.solver import compile_scene, run
from sidtool.solver.afterwards import replay
from sidtool.solver.analyses.linear import linearise
from sidtool.solver.analyses.static import static_equilibrium
from sidtool.solver.errors import SimulationError
from tests.bodies import Cloud

from .joint_scenes import scene
from .stick_slip import Rub

G = 9.81
RTOL = 1e-9
INDEX_1 = ("radau5", "radau9", "radau13", "dop853", "auto")


def simulate(
    dimension: str,
    end: float,
    sids: dict[str, SID] | None = None,
    method: str = "radau9",
    rtol: float = RTOL,
    step: float | None = None,
    **tables: Any,
) -> Result:
    system = compile_scene(scene(dimension, end, **tables), ".", sids or {})
    return run.simulate(system, integrator=method, rtol=rtol, step=step)


def vector(dimension: str, x: float, y: float) -> list[float]:
    return [x, y] if dimension == "planar" else [x, y, 0.0]


def changes(result: Result, joint: str) -> list[tuple[str, float]]:
    return [(e.kind, e.t) for e in result.events if e.name == joint]


def assert_changes(
    result: Result, joint: str, known: list[tuple[str, float, float]], tol: float
) -> None:
    """The same changes at the same times, at places that the first output tells."""
    found = [e for e in result.events if e.name == joint]
    assert [e.kind for e in found] == [kind for kind, _, _ in known]
    for event, (_, t, x) in zip(found, known, strict=True):
        assert event.t == pytest.approx(t, abs=tol)
        assert event.values[0] == pytest.approx(x, abs=tol)


def assert_balanced(result: Result, tol: float) -> None:
    balance = result.values[:, result.names.index("energy.balance")]
    lost = result.values[:, result.names.index("energy.dissipated")]
    assert lost[-1] > 0.0
    assert np.ptp(balance) < tol * lost[-1]
    assert np.all(np.diff(lost) > -tol * lost[-1])


ENERGIES = ["energy.balance", "energy.dissipated"]

# --- a block on an incline ---------------------------------------------------------

SLOPE, MASS, MU, REST = 0.2, 2.0, 0.3, 0.4
WEIGHT, LOAD = MASS * G * np.sin(SLOPE), MASS * G * np.cos(SLOPE)
RAMP, PEAK, DOWN = 10.0, 2.0, 3.0


def block_on_incline(dimension: str, **options: Any) -> Result:
    """A pull that grows, falls to zero at 3 s and stays there; gravity is turned."""
    pieces = [
        {"from": 0.0, "to": PEAK, "coefficients": [0.0, RAMP]},
        {"from": PEAK, "to": DOWN, "coefficients": [20.0, -20.0]},
        {"from": DOWN, "to": 4.0, "coefficients": [0.0]},
    ]
    inertia = 0.1 if dimension == "planar" else [0.1, 0.1, 0.1]
    markers = ["ground", "block"]
    if options.pop("swapped", False):
        markers.reverse()
    law = {"coefficient": MU, "static": REST, **options.pop("law", {})}
    kind = {"type": options.pop("kind", "prismatic")}
    outputs = ["rail.displacement", "rail.friction", "rail.normal_force"]
    return simulate(
        dimension,
        4.0,
        gravity=vector(dimension, -G * np.sin(SLOPE), -G * np.cos(SLOPE)),
        bodies={"block": {"mass": MASS, "inertia": inertia}},
        joints={"rail": {**kind, "markers": markers, "friction": law}},
        forces={
            "pull": {
                "type": "force",
                "marker": "block",
                "force": vector(dimension, 1.0, 0.0),
                "function": {"type": "polynomial", "pieces": pieces},
            }
        },
        outputs={"record": [*outputs, "rail.sticking", *ENERGIES, "rail.fx"]},
        **options,
    )


def exact_incline() -> tuple[float, float, float]:
    """Breakaway, stop, and the way between them, from cubic polynomials."""
    loose = (WEIGHT + REST * LOAD) / RAMP
    resist = WEIGHT + MU * LOAD
    speed = (RAMP * (PEAK**2 - loose**2) / 2 - resist * (PEAK - loose)) / MASS
    way = RAMP / MASS * (PEAK**3 / 6 - loose**2 * PEAK / 2 + loose**3 / 3)
    way -= resist / MASS * (PEAK - loose) ** 2 / 2
    way += speed + (20.0 / 3.0 - resist / 2.0) / MASS
    speed += (10.0 - resist) / MASS
    stop = DOWN + speed * MASS / resist
    return loose, stop, way + speed**2 * MASS / resist / 2.0


@pytest.mark.parametrize("method", INDEX_1)
def test_block_breaks_away_and_stops_when_coulomb_says(method: str) -> None:
    result = block_on_incline("planar", method=method)
    loose, stop, way = exact_incline()
    found = changes(result, "rail")
    assert [kind for kind, _ in found] == ["slip", "stick"]
    assert [t for _, t in found] == pytest.approx([loose, stop], abs=1e-9)
    place, friction, load, sticks, *_, along = result.values.T
    assert place[-1] == pytest.approx(way, abs=1e-8)
    before, after = result.t < loose, result.t > stop
    np.testing.assert_allclose(place[before], 0.0, atol=1e-14)
    np.testing.assert_allclose(place[after], place[-1], atol=1e-14)  # no creep
    np.testing.assert_array_equal(sticks, (before | after).astype(float))
    np.testing.assert_allclose(load, LOAD, rtol=1e-10)
    np.testing.assert_allclose(friction[before], WEIGHT - RAMP * result.t[before])
    np.testing.assert_allclose(friction[~(before | after)], -MU * LOAD)
    np.testing.assert_allclose(along, friction, rtol=1e-12)
    assert_balanced(result, 1e-9)


def test_block_with_the_trapezoidal_rule() -> None:
    result = block_on_incline("planar", method="trapezoidal", rtol=1e-5)
    loose, stop, _ = exact_incline()
    times = [t for _, t in changes(result, "rail")]
    assert times == pytest.approx([loose, stop], abs=1e-5)


def test_block_in_fixed_steps() -> None:
    """The instants are found inside steps of 20 ms, and the steps go on from there."""
    result = block_on_incline("planar", method="radau5", step=0.02)
    loose, stop, way = exact_incline()
    times = [t for _, t in changes(result, "rail")]
    assert times == pytest.approx([loose, stop], abs=1e-9)
    assert result.values[-1, 0] == pytest.approx(way, abs=1e-9)


def test_outputs_afterwards_are_those_of_the_run() -> None:
    """Nothing but states is kept: what sticks in them follows from them."""
    result = pendulum("planar", 3.0)
    names = ["pin.friction", "pin.normal_force", "pin.angle"]
    found = replay(result, names).outputs()
    for name in names:
        known = result.values[:, result.names.index(name)]
        np.testing.assert_allclose(found[name], known, rtol=1e-9, atol=1e-12)
    result = block_on_incline("planar")
    found = replay(result, ["rail.*"]).outputs()
    np.testing.assert_allclose(found["rail.friction"], result.values[:, 1], rtol=1e-9)
    np.testing.assert_array_equal(found["rail.sticking"], result.values[:, 3])


@pytest.mark.parametrize(
    ("dimension", "options"),
    [
        ("planar", {"swapped": True}),
        ("planar", {"kind": "point_on_line"}),
        ("spatial", {}),
        ("spatial", {"swapped": True}),
    ],
)
def test_block_said_differently_moves_the_same(
    dimension: str, options: dict[str, Any]
) -> None:
    """Markers exchanged, plane as space, a joint that also lets the block turn."""
    sign = -1.0 if "swapped" in options else 1.0
    result = block_on_incline(dimension, **options)
    loose, stop, way = exact_incline()
    times = [t for _, t in changes(result, "rail")]
    assert times == pytest.approx([loose, stop], abs=1e-9)
    assert sign * result.values[-1, 0] == pytest.approx(way, abs=1e-8)
    assert_balanced(result, 1e-9)


def test_generalised_alpha_refuses_friction_by_name() -> None:
    with pytest.raises(InputError, match="knows no friction of joints .rail."):
        block_on_incline("planar", method="generalised_alpha")


# --- a block on a rail that rocks: the load follows the motion ----------------------


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_block_on_a_rocking_rail(dimension: str) -> None:
    """N = m (g cos + 2 theta' x' + theta'' x) of the rail's angle theta."""
    top, omega, start, width = 0.45, 5.0, 0.3, 0.15

    def theta(t: float) -> tuple[float, float, float]:
        s, c = np.sin(omega * t), np.cos(omega * t)
        return top * s, top * omega * c, -top * omega**2 * s

    def mu(v: float) -> float:
        return MU + (REST - MU) * float(np.exp(-((v / width) ** 2)))

    def load(t: float, x: float, v: float) -> float:
        angle, rate, push = theta(t)
        return abs(G * np.cos(angle) + 2.0 * rate * v + push * x)

    def need(t: float, x: float) -> float:
        angle, rate, _ = theta(t)
        return float(G * np.sin(angle) - rate**2 * x)

    known = Rub(
        need,
        lambda t, x: REST * load(t, x, 0.0),
        lambda t, x, v, s: -need(t, x) - s * mu(v) * load(t, x, v),
    ).motion(start, 0.0, 6.0)
    inertia = 0.1 if dimension == "planar" else [0.1, 0.1, 0.1]
    drive = {"type": "harmonic", "amplitude": top, "angular_frequency": omega}
    result = simulate(
        dimension,
        6.0,
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "rail": {"mass": 1.0, "inertia": inertia},
            "block": {
                "mass": MASS,
                "inertia": inertia,
                "initial": {
                    "position": vector(dimension, start, 0.0),
                    "velocity": vector(dimension, 0.0, top * omega * start),
                    "angular_velocity": top * omega
                    if dimension == "planar"
                    else [0.0, 0.0, top * omega],
                },
            },
        },
        joints={
            "hinge": {"type": "revolute", "markers": ["ground", "rail"]},
            "slide": {
                "type": "prismatic",
                "markers": ["rail", "block"],
                "friction": {
                    "coefficient": MU,
                    "static": REST,
                    "stribeck_velocity": width,
                },
            },
        },
        drives={"rock": {"joint": "hinge", "function": drive}},
        outputs={"record": ["slide.displacement", "hinge.mz", *ENERGIES]},
    )
    assert len(known) > 6
    assert_changes(result, "slide", known, 2e-8)
    assert_balanced(result, 1e-8)


# --- a pendulum with friction in its bearing ----------------------------------------

ROD = {"m": 1.5, "l": 0.4, "I": 0.03, "r": 0.05, "start": 1.2}
SWING = ROD["I"] + ROD["m"] * ROD["l"] ** 2


def pendulum(dimension: str, end: float, **options: Any) -> Result:
    start, arm = ROD["start"], ROD["l"]
    plane = dimension == "planar"
    at = "angle" if plane else "axis_angle"
    markers = ["ground", "bob.pin"]
    if options.pop("swapped", False):
        markers.reverse()
    law = {"coefficient": MU, "static": REST, "radius": ROD["r"]}
    return simulate(
        dimension,
        end,
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "bob": {
                "mass": ROD["m"],
                "inertia": ROD["I"] if plane else [0.02, 0.025, ROD["I"]],
                "markers": {"pin": {"position": vector(dimension, 0.0, arm)}},
                "initial": {
                    "position": vector(
                        dimension, arm * np.sin(start), -arm * np.cos(start)
                    ),
                    at: start if plane else [0.0, 0.0, start],
                },
            }
        },
        joints={"pin": {"type": "revolute", "markers": markers, "friction": law}},
        outputs={
            "record": ["pin.angle", "pin.friction", "pin.normal_force", *ENERGIES]
        },
        **options,
    )


def known_pendulum(end: float) -> list[tuple[str, float, float]]:
    """theta'' depends on the load, and the load on theta''."""
    m, arm, r = ROD["m"], ROD["l"], ROD["r"]

    def load(angle: float, rate: float, push: float) -> float:
        along = G * np.cos(angle) + arm * rate**2
        return float(m * np.hypot(along, G * np.sin(angle) + arm * push))

    def slide(t: float, angle: float, rate: float, s: float) -> float:
        weight = m * G * arm * np.sin(angle)

        def left(push: float) -> float:
            return float(SWING * push + weight + s * MU * r * load(angle, rate, push))

        return float(brentq(left, -500.0, 500.0, xtol=1e-15))

    return Rub(
        lambda t, angle: m * G * arm * float(np.sin(angle)),
        lambda t, angle: REST * r * load(angle, 0.0, 0.0),
        slide,
    ).motion(ROD["start"], 0.0, end)


@pytest.mark.parametrize(
    ("dimension", "method", "swapped"),
    [
        ("planar", "radau9", False),
        ("planar", "auto", True),
        ("spatial", "radau9", True),
        ("spatial", "auto", False),
    ],
)
def test_pendulum_with_friction_in_its_bearing(
    dimension: str, method: str, swapped: bool
) -> None:
    end = 5.0
    known = [change for change in known_pendulum(end) if change[1] > 0.0]
    sign = -1.0 if swapped else 1.0
    result = pendulum(dimension, end, method=method, swapped=swapped)
    assert len(known) > 5
    assert_changes(result, "pin", [(k, t, sign * x) for k, t, x in known], 1e-9)
    assert_balanced(result, 1e-8)


def test_pendulum_comes_to_rest_beside_the_lowest_point() -> None:
    known = known_pendulum(12.0)
    assert known[-1][0] == "stick"
    assert abs(known[-1][2]) > 0.01
    result = pendulum("planar", 12.0)
    assert changes(result, "pin")[-1] == ("stick", pytest.approx(known[-1][1]))
    assert result.values[-1, 0] == pytest.approx(known[-1][2], abs=1e-8)


# --- other laws and loads ------------------------------------------------------------


def bead(dimension: str, law: dict[str, Any], function: dict[str, Any]) -> Result:
    """A point mass on a line, pushed along it and to and fro across it."""
    return simulate(
        dimension,
        2.0,
        bodies={
            "bead": {
                "mass": 0.5,
                "initial": {"velocity": vector(dimension, 3.0, 0.0)},
            }
        },
        joints={
            "wire": {
                "type": "point_on_line",
                "markers": ["ground", "bead"],
                "friction": law,
            }
        },
        forces={
            "across": {
                "type": "force",
                "marker": "bead",
                "force": vector(dimension, 0.0, 1.0),
                "function": function,
            }
        },
        outputs={"record": ["wire.displacement_rate", "wire.normal_force", *ENERGIES]},
    )


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_load_that_changes_its_sign(dimension: str) -> None:
    """m v = m v0 - mu A int |sin wt|; nothing happens where the load is zero."""
    size, omega = 2.0, 7.0
    function = {"type": "harmonic", "amplitude": size, "angular_frequency": omega}
    result = bead(dimension, {"coefficient": MU}, function)
    halves, rest = np.divmod(omega * result.t, np.pi)
    work = size / omega * (2.0 * halves + 1.0 - np.cos(rest))
    np.testing.assert_allclose(result.values[:, 0], 3.0 - MU / 0.5 * work, atol=3e-8)
    load = size * np.abs(np.sin(omega * result.t))
    np.testing.assert_allclose(result.values[:, 1], load, atol=1e-7)
    assert not changes(result, "wire")
    assert_balanced(result, 1e-7)


def test_viscous_friction_beside_the_dry_one() -> None:
    """m v' = -mu F - d v, to the stop at (m / d) ln(1 + d v0 / (mu F))."""
    force, viscous = 4.0, 0.7
    law = {"coefficient": MU, "viscous": viscous}
    result = bead("planar", law, {"type": "constant", "value": force})
    stop = 0.5 / viscous * np.log(1.0 + viscous * 3.0 / (MU * force))
    assert changes(result, "wire") == [("stick", pytest.approx(stop, abs=1e-9))]


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_belt_with_stribeck_friction(dimension: str) -> None:
    """A block that a spring holds on a moving belt sticks and slips for ever."""
    stiffness, belt, width = 40.0, 0.5, 0.2

    def mu(v: float) -> float:
        return MU + (0.6 - MU) * float(np.exp(-((v / width) ** 2)))

    # y: displacement of the block on the belt; its place is y + belt t
    rub = Rub(
        lambda t, y: stiffness * (y + belt * t),
        lambda t, y: 0.6 * MASS * G,
        lambda t, y, v, s: -stiffness * (y + belt * t) / MASS - s * mu(v) * G,
    )
    known = rub.motion(0.0, 0.0, 6.0)
    assert len(known) > 5
    inertia = 0.1 if dimension == "planar" else [0.1, 0.1, 0.1]
    line = {
        "type": "polynomial",
        "pieces": [{"from": 0.0, "coefficients": [0.0, belt]}],
    }
    result = simulate(
        dimension,
        6.0,
        gravity=vector(dimension, 0.0, -G),
        ground={"markers": {"wall": {"position": vector(dimension, -5.0, 0.0)}}},
        bodies={
            "belt": {"mass": 1.0, "inertia": inertia},
            "block": {
                "mass": MASS,
                "inertia": inertia,
                "initial": {"velocity": vector(dimension, belt, 0.0)},
            },
        },
        joints={
            "track": {"type": "prismatic", "markers": ["ground", "belt"]},
            "top": {
                "type": "prismatic",
                "markers": ["belt", "block"],
                "friction": {
                    "coefficient": MU,
                    "static": 0.6,
                    "stribeck_velocity": width,
                },
            },
        },
        drives={"run": {"joint": "track", "function": line}},
        forces={
            "spring": {
                "type": "spring_damper",
                "markers": ["ground.wall", "block"],
                "rest": 5.0,
                "stiffness": stiffness,
            }
        },
        outputs={"record": ["top.displacement", "track.fx", *ENERGIES]},
    )
    assert_changes(result, "top", known, 2e-8)
    assert_balanced(result, 1e-8)


def test_a_load_from_elastic_coordinates() -> None:
    """A mass that bounces on a sliding body: N = M g + m q'', known with q(t)."""
    frame, mass, stiffness, speed = 1.5, 0.5, 80.0, 2.0
    phi = np.zeros((3, 3, 1))
    phi[2, 1] = 1.0
    c = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0], [0.0, 0.05, 0.0]])
    masses = np.array([0.5 * frame, 0.5 * frame, mass])
    sid = Cloud(masses, c, phi, np.zeros_like(phi)).sid(
        np.array([[stiffness]]), np.zeros((1, 1)), 1
    )
    omega, whole = np.sqrt(stiffness / mass), frame + mass
    sag, top = -mass * G / stiffness, 0.05

    def impulse(t: float) -> float:
        return whole * G * t - mass * omega * top * float(np.sin(omega * t))

    stop = float(
        brentq(lambda t: whole * speed - MU * impulse(t), 0.0, 2.0, xtol=1e-15)
    )
    result = simulate(
        "planar",
        1.0,
        {"cart": sid},
        gravity=[0.0, -G],
        bodies={
            "cart": {
                "sid": "cart",
                "initial": {"velocity": [speed, 0.0], "elastic": [sag + top]},
            }
        },
        joints={
            "rail": {
                "type": "prismatic",
                "markers": ["ground", "cart.1"],
                "friction": {"coefficient": MU},
            }
        },
        outputs={"record": ["rail.normal_force", *ENERGIES]},
    )
    load = whole * G - mass * omega**2 * top * np.cos(omega * result.t)
    np.testing.assert_allclose(result.values[:, 0], load, atol=1e-6)
    assert changes(result, "rail") == [("stick", pytest.approx(stop, abs=1e-8))]
    assert_balanced(result, 1e-7)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_guide_of_some_length_carries_moments_at_its_ends(dimension: str) -> None:
    """Pulled h above its guide, a block tilts: |N/2 + F h/l| + |N/2 - F h/l|."""
    pull, height, length = 3.0, 0.5, 0.1
    inertia = 0.1 if dimension == "planar" else [0.1, 0.1, 0.1]
    result = simulate(
        dimension,
        0.1,
        gravity=vector(dimension, 0.0, -1.0),
        bodies={
            "block": {
                "mass": MASS,
                "inertia": inertia,
                "markers": {"top": {"position": vector(dimension, 0.0, height)}},
            }
        },
        joints={
            "rail": {
                "type": "prismatic",
                "markers": ["ground", "block"],
                "friction": {"coefficient": 0.2, "length": length},
            }
        },
        forces={
            "pull": {
                "type": "force",
                "marker": "block.top",
                "force": vector(dimension, pull, 0.0),
            }
        },
        outputs={"record": ["rail.normal_force", "rail.friction", "rail.sticking"]},
    )
    load = 2.0 * pull * height / length
    expected = np.tile([load, -pull, 1.0], (len(result.t), 1))
    np.testing.assert_allclose(result.values, expected, rtol=1e-9)


# --- what has no answer --------------------------------------------------------------


def door(hinges: int, **law: Any) -> dict[str, Any]:
    places = {f"h{k}": {"position": [0.0, 0.0, 0.4 * k]} for k in range(hinges)}
    law = {"coefficient": 0.1, "radius": 0.01, **law}
    return {
        "gravity": [0.0, -G, 0.0],
        "ground": {"markers": places},
        "bodies": {
            "door": {"mass": 3.0, "inertia": [0.2, 0.2, 0.2], "markers": places}
        },
        "joints": {
            f"hinge{k}": {
                "type": "revolute",
                "markers": [f"ground.h{k}", f"door.h{k}"],
                **({"friction": law} if k == 0 else {}),
            }
            for k in range(hinges)
        },
        "outputs": {"record": ["hinge0.normal_force"]},
    }


def test_an_indeterminate_load_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="hinge0 is statically indeterminate") as error:
        simulate("spatial", 0.1, **door(2))
    assert "hinge1" in str(error.value)
    simulate("spatial", 0.1, **door(1))


def test_redundant_constraints_that_do_not_load_the_bearing_are_no_matter() -> None:
    """Four spatial revolute joints in a plane: what lies along their axes is redundant.

    The load across them is determined, and the motion that of the planar scene.
    """

    def four_bar(dimension: str) -> Result:
        plane = dimension == "planar"
        inertia = 0.02 if plane else [0.02, 0.02, 0.02]
        corners = [(0.0, 0.0), (0.0, 0.5), (0.9, 0.8), (1.0, 0.0)]
        bodies, joints = {}, {}
        for k, name in enumerate(("left", "top", "right")):
            (x0, y0), (x1, y1) = corners[k], corners[k + 1]
            half = [(x1 - x0) / 2, (y1 - y0) / 2]
            bodies[name] = {
                "mass": 1.0 + k,
                "inertia": inertia,
                "markers": {
                    "a": {"position": vector(dimension, -half[0], -half[1])},
                    "b": {"position": vector(dimension, *half)},
                },
                "initial": {
                    "position": vector(dimension, (x0 + x1) / 2, (y0 + y1) / 2)
                },
            }
        ends = ["ground", "left.a", "left.b", "top.a", "top.b", "right.a", "right.b"]
        pairs = zip(ends[::2], [*ends[1::2], "ground.end"], strict=True)
        law = {"coefficient": 0.3, "radius": 0.04}
        for k, pair in enumerate(pairs):
            joints[f"pin{k}"] = {
                "type": "revolute",
                "markers": list(pair),
                "friction": law,
            }
        return simulate(
            dimension,
            1.0,
            gravity=vector(dimension, 0.0, -G),
            ground={"markers": {"end": {"position": vector(dimension, 1.0, 0.0)}}},
            bodies=bodies,
            joints=joints,
            outputs={"record": [f"pin{k}.angle" for k in range(4)] + ENERGIES},
        )

    plane, space = four_bar("planar"), four_bar("spatial")
    assert_balanced(plane, 1e-8)
    np.testing.assert_allclose(space.values[:, :4], plane.values[:, :4], atol=1e-7)
    assert len(changes(plane, "pin0")) == len(changes(space, "pin0"))


def leaning_rod(mu: float, angle: float, spin: float, speed: float) -> Result:
    """Painleve's rod: its tip slides over the ground that it leans forward on."""
    half = 0.5
    x, y = half * np.cos(angle), half * np.sin(angle)
    return simulate(
        "planar",
        0.1,
        gravity=[0.0, -G],
        bodies={
            "rod": {
                "mass": 1.0,
                "inertia": 1.0 / 12.0,
                "markers": {"tip": {"position": [-half, 0.0]}},
                "initial": {
                    "position": [x, y],
                    "angle": angle,
                    "velocity": [-speed - spin * y, spin * x],
                    "angular_velocity": spin,
                },
            }
        },
        joints={
            "floor": {
                "type": "point_on_line",
                "markers": ["ground", "rod.tip"],
                "friction": {"coefficient": mu},
            }
        },
        outputs={"record": ["rod.angle", "floor.normal_force"]},
    )


def test_friction_without_a_solution_is_told() -> None:
    """1 + 3 cos^2 - 3 mu sin cos is zero at tan = (3 mu - sqrt(9 mu^2 - 16)) / 2.

    Beyond it the load pulls (P. Painleve 1895); towards it, it grows without bound.
    """
    mu = 2.0
    least = float(np.arctan((3.0 * mu - np.sqrt(9.0 * mu**2 - 16.0)) / 2.0))
    with pytest.raises(SimulationError, match="at t = 0 s: friction has no solution"):
        leaning_rod(mu, least + 0.05, 0.0, 1.0)
    with pytest.raises(SimulationError, match="friction .floor. has no sol") as error:
        leaning_rod(mu, 0.45, 4.0, 4.0)
    reached = error.value.result
    assert reached.values[-1, 0] == pytest.approx(least, abs=1e-6)
    assert reached.values[-1, 1] > 1e6


@pytest.mark.parametrize(
    ("law", "what"),
    [
        ({"radius": None}, "radius: is missing"),
        ({"static": 0.05}, "static: is 0.05, below"),
        ({"stribeck_velocity": 0.1}, "stribeck_velocity: has no coefficient"),
        ({"coefficient": -0.1}, "coefficient"),
    ],
)
def test_laws_that_make_no_sense(law: dict[str, Any], what: str) -> None:
    tables = door(1, **law)
    friction = tables["joints"]["hinge0"]["friction"]
    tables["joints"]["hinge0"]["friction"] = {
        key: value for key, value in friction.items() if value is not None
    }
    with pytest.raises(InputError, match=what):
        simulate("spatial", 0.1, **tables)


def test_equilibrium_is_told_to_be_without_friction() -> None:
    tables = door(1)
    tables["joints"]["hinge0"]["friction"]["coefficient"] = 0.5
    system = compile_scene(scene("spatial", 1.0, **tables), ".", keep_joints=True)
    found = static_equilibrium(system)
    assert "without friction" in " ".join(found.notes)
    load = found.result().values[0, 0]
    assert load == pytest.approx(3.0 * G, rel=1e-9)
    held = linearise(system)
    assert len(held.eigenvalues) == 0
    assert "friction holds hinge0" in " ".join(held.notes)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_two_joints_that_hold_one_motion_break_loose_together(dimension: str) -> None:
    """A rack on its guide and a wheel in its bearing: limits add up, at rest and after.

    No force tells what part of the pull each of them holds.
    """
    wheel, rack, inertia, big, pin, ramp = 3.0, 2.0, 0.04, 0.25, 0.02, 8.0
    end = 2.0
    space = inertia if dimension == "planar" else [0.1, 0.1, inertia]
    line = {"type": "polynomial", "pieces": [{"from": 0.0, "coefficients": [0.0, 1.0]}]}
    law = {"coefficient": 0.2, "static": 0.3}
    result = simulate(
        dimension,
        end,
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "rack": {"mass": rack, "inertia": space},
            "wheel": {"mass": wheel, "inertia": space},
        },
        joints={
            "guide": {
                "type": "prismatic",
                "markers": ["ground", "rack"],
                "friction": law,
            },
            "bearing": {
                "type": "revolute",
                "markers": ["ground", "wheel"],
                "friction": {**law, "radius": pin},
            },
            "teeth": {
                "type": "coupling",
                "joints": ["guide", "bearing"],
                "weights": [1.0, -big],
            },
        },
        forces={
            "pull": {
                "type": "force",
                "marker": "rack",
                "force": vector(dimension, ramp, 0.0),
                "function": line,
            }
        },
        outputs={
            "record": [
                "guide.displacement",
                "guide.friction",
                "bearing.friction",
                *ENERGIES,
            ]
        },
    )
    limit = G * (rack + wheel * pin / big)
    loose = 0.3 * limit / ramp
    for joint in ("guide", "bearing"):
        assert changes(result, joint) == [("slip", pytest.approx(loose, abs=1e-9))]
    place, guide, bearing, *_ = result.values.T
    stuck = result.t < loose
    held = guide[stuck] + bearing[stuck] / big
    np.testing.assert_allclose(held, -ramp * result.t[stuck], atol=1e-9)
    since = result.t[~stuck] - loose
    pushed = ramp * (result.t[~stuck] ** 3 - loose**3) / 6.0
    pushed -= ramp * loose**2 * since / 2.0 + 0.2 * limit * since**2 / 2.0
    way = pushed / (rack + inertia / big**2)
    np.testing.assert_allclose(place[~stuck], way, atol=1e-8)
    assert_balanced(result, 1e-8)
