"""Static starts of what rotates on springs, bushings and flexible shafts.

References: the Jeffcott (Laval) rotor with unbalance, whose centre whirls by
m e w^2 / (k - m w^2 + i c w) at the speed of the shaft (G. Genta, Dynamics of Rotating
Systems, 2005, section 2.3), and closed forms of its kind.
"""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.result import Result
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, linearise, simulate
from sidtool.solver.system.system import System
from tests.codes import codes, only, with_code
from tests.solver.scenes import compiled, polynomial, scene

MASS, OFFSET, STIFFNESS, COUPLING, G = 10.0, 1e-4, 1e6, 1e4, 9.81


def started(bodies: dict[str, Any], record: list[str], **more: Any) -> System:
    sids = more.pop("sids", {})
    described = scene(
        bodies,
        more.pop("joints", {}),
        more.pop("drives", {}),
        end=more.pop("end", 0.2),
        steps=200,
        record=record,
        initial={"state": "static"},
        accuracy={"rtol": 1e-9},
        **{"dimension": "spatial"} | more,
    )
    return compiled(described, **sids)


def whirl(result: Result, y: str, z: str, speed: float) -> tuple[complex, complex]:
    """Centre and rotating part of a motion that is a circle but for rounding."""
    c = result[y] + 1j * result[z]
    both = np.column_stack([np.ones_like(c), np.exp(1j * speed * result.t)])
    found = np.linalg.lstsq(both, c, rcond=None)[0]
    assert np.abs(c - both @ found).max() < 1e-6 * abs(found[1])
    return complex(found[0]), complex(found[1])


def rotor(
    speed: float,
    stiffness: tuple[float, float] = (STIFFNESS, STIFFNESS),
    damping: float = 0.0,
    driven: bool = False,
    stated: bool = True,
    drag: float = 0.0,
    **more: Any,
) -> System:
    """A disc on a bearing about x, turned by a motor behind a torsional coupling."""
    disc: dict[str, Any] = {
        "mass": MASS,
        "inertia": [0.05, 0.03, 0.03],
        "centre_of_mass": [0.0, OFFSET, 0.0],
    }
    if stated:
        disc["initial"] = {"angular_velocity": [speed, 0.0, 0.0]}
    bearing = {
        "type": "bushing",
        "markers": ["ground", "disc"],
        "shaft": "x",
        "stiffness": [1e7, *stiffness, 0.0, 2e4, 2e4],
        "damping": [0.0, damping, damping, drag, 0.0, 0.0],
    }
    bodies, forces = {"disc": disc}, {"bearing": bearing}
    if driven:
        bodies["motor"] = {"mass": 1.0, "inertia": [0.01, 0.01, 0.01]}
        hinge = {"type": "revolute", "markers": ["ground", "motor"], "axis": [1, 0, 0]}
        drive = {"joint": "hinge", "function": polynomial(speed), "of": "rate"}
        more |= {"joints": {"hinge": hinge}, "drives": {"drive": drive}}
        forces["coupling"] = {
            "type": "bushing",
            "markers": ["motor", "disc"],
            "shaft": "x",
            "stiffness": [0.0, 0.0, 0.0, COUPLING, 0.0, 0.0],
            "damping": [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        }
    return started(bodies, ["disc.y", "disc.z", "disc.wx"], forces=forces, **more)


@pytest.mark.parametrize("speed", [80.0, -200.0, 500.0])
def test_a_disc_whirls_at_its_speed_below_and_above_the_critical_one(
    speed: float,
) -> None:
    system = rotor(speed, gravity=[-G, 0.0, 0.0])
    assert "N224" not in codes(system)
    result = simulate(system)
    centre, radius = whirl(result, "disc.y", "disc.z", speed)
    load = MASS * speed**2
    assert radius == pytest.approx(load * OFFSET / (STIFFNESS - load), rel=1e-6)
    assert abs(centre) < 1e-6 * abs(radius)
    assert result["disc.wx"] == pytest.approx(speed, rel=1e-9)


@pytest.mark.parametrize("stated", [True, False])
def test_a_driven_disc_whirls_behind_its_unbalance(stated: bool) -> None:
    """By the angle that the damping of the bearing makes, and behind the motor by the
    twist of the coupling, whose torque is that of the drag. What is on the shaft of a
    motor turns with it where no velocity is stated."""
    speed, damping, drag = 80.0, 500.0, 2.0
    system = rotor(speed, damping=damping, driven=True, stated=stated, drag=drag)
    assert "N224" not in codes(system)
    result = simulate(system)
    centre, radius = whirl(result, "disc.y", "disc.z", speed)
    load = MASS * speed**2
    expected = load * OFFSET / (STIFFNESS - load + 1j * damping * speed)
    expected *= np.exp(-1j * drag * speed / COUPLING)
    assert radius == pytest.approx(expected, rel=1e-6)
    assert abs(centre) < 1e-6 * abs(radius)


@pytest.mark.parametrize("driven", [True, False])
def test_a_rigid_rotor_turns_about_its_sagged_axis(driven: bool) -> None:
    """Its weight changes its speed in each turn by about g m e / (I w^2), 3e-5."""
    speed = 80.0
    system = rotor(speed, driven=driven, gravity=[0.0, 0.0, -G])
    assert "N224" not in codes(system)
    result = simulate(system)
    c = result["disc.y"] + 1j * result["disc.z"] + 1j * MASS * G / STIFFNESS
    load = MASS * speed**2
    expected = load * OFFSET / (STIFFNESS - load)
    assert np.abs(c) == pytest.approx(expected, rel=1e-3)


def test_bearings_of_two_stiffnesses_allow_no_steady_rotation() -> None:
    for driven in (False, True):
        system = rotor(80.0, (STIFFNESS, 1.01 * STIFFNESS), driven=driven)
        assert "disc" in only(system, "N224").subject


def test_a_scene_too_large_for_the_search_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sidtool.solver.analyses.steady_rotation.MAX_COORDINATES", 5)
    for stated in (True, False):
        found = with_code(rotor(30.0, stated=stated), "N224")
        assert ["disc" in each.subject for each in found] == [True] * stated


def test_a_housing_that_whirls_is_told() -> None:
    """It goes round with the rotor in it and does not turn: no relative equilibrium."""
    disc = {
        "mass": MASS,
        "inertia": [0.05, 0.03, 0.03],
        "centre_of_mass": [0.0, OFFSET, 0.0],
        "initial": {"angular_velocity": [80.0, 0.0, 0.0]},
    }
    bodies = {"disc": disc, "housing": {"mass": 20.0, "inertia": [1.0, 1.0, 1.0]}}
    springs = [1e7, STIFFNESS, STIFFNESS, 1e5, 1e5, 1e5]
    bearing = {
        "type": "bushing",
        "shaft": "x",
        "stiffness": [*springs[:3], 0, 2e4, 2e4],
    }
    feet = {"type": "bushing", "stiffness": springs}
    forces = {
        "bearing": bearing | {"markers": ["housing", "disc"]},
        "feet": feet | {"markers": ["ground", "housing"]},
    }
    system = started(bodies, ["disc.y"], forces=forces)
    assert "N224" in codes(system)


def test_a_skew_disc_tilts_back() -> None:
    """The moment (Ip - Id) w^2 of the angle between its normal and the axis of
    rotation is borne by the springs against tilting."""
    Ip, Id, skew, stiffness, speed = 0.06, 0.03, 1e-3, 5e3, 120.0
    c, s = np.cos(skew), np.sin(skew)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    disc = {
        "mass": 3.0,
        "inertia": (turn @ np.diag([Ip, Id, Id]) @ turn.T).tolist(),
        "initial": {"angular_velocity": [speed, 0.0, 0.0]},
        "markers": {"tip": {"position": [1.0, 0.0, 0.0]}},
    }
    bearing = {
        "type": "bushing",
        "markers": ["ground", "disc"],
        "shaft": "x",
        "stiffness": [1e6, 1e6, 1e6, 0.0, stiffness, stiffness],
    }
    system = started(
        {"disc": disc}, ["disc.tip.y", "disc.tip.z"], forces={"b": bearing}
    )
    _, radius = whirl(simulate(system), "disc.tip.y", "disc.tip.z", speed)
    moment = (Ip - Id) * speed**2
    assert radius == pytest.approx(-moment * skew / (stiffness + moment), rel=1e-4)


def test_a_disc_whirls_in_the_plane() -> None:
    speed, stiffness = 60.0, 4e4
    disc = {
        "mass": 2.0,
        "inertia": 0.01,
        "centre_of_mass": [1e-3, 0.0],
        "initial": {"angular_velocity": speed},
    }
    spring = {
        "type": "bushing",
        "markers": ["ground", "disc"],
        "stiffness": [stiffness, stiffness, 0.0],
    }
    system = started(
        {"disc": disc},
        ["disc.x", "disc.y"],
        forces={"spring": spring},
        dimension="planar",
    )
    _, radius = whirl(simulate(system), "disc.x", "disc.y", speed)
    load = 2.0 * speed**2
    assert radius == pytest.approx(load * 1e-3 / (stiffness - load), rel=1e-6)


def test_a_mass_on_a_driven_wheel_stretches_its_spring() -> None:
    """k (r - r0) = m r w^2; its velocity is not stated."""
    rest, stiffness, speed = 0.3, 1e4, 50.0
    bodies = {
        "wheel": {"mass": 5.0, "inertia": [0.1, 0.1, 0.1]},
        "bob": {"mass": 1.0, "initial": {"position": [rest, 0.0, 0.0]}},
    }
    joints = {
        "hub": {"type": "revolute", "markers": ["ground", "wheel"], "axis": [0, 0, 1]},
        "guide": {
            "type": "point_on_line",
            "markers": ["wheel", "bob"],
            "axis": [1, 0, 0],
        },
    }
    spring = {
        "type": "spring_damper",
        "markers": ["wheel", "bob"],
        "rest": rest,
        "stiffness": stiffness,
    }
    system = started(
        bodies,
        ["bob.x", "bob.y"],
        joints=joints,
        drives={"spin": {"joint": "hub", "function": polynomial(0.0, speed)}},
        forces={"spring": spring},
    )
    _, radius = whirl(simulate(system), "bob.x", "bob.y", speed)
    assert radius == pytest.approx(rest * stiffness / (stiffness - speed**2), rel=1e-6)


def test_a_free_pair_on_a_spring_keeps_its_distance() -> None:
    """It drifts and spins with nothing around it: k (d - d0) = m d w^2 with the reduced
    mass m."""
    masses, rest, stiffness, speed = np.array([4.0, 1.0]), 0.5, 2e3, 20.0
    places = np.array([-masses[1], masses[0]]) * rest / masses.sum()
    bodies = {
        name: {
            "mass": mass,
            "inertia": [0.1, 0.1, 0.3],
            "initial": {
                "position": [x, 0.0, 0.0],
                "velocity": [0.3, 0.2 + speed * x, 0.1],
                "angular_velocity": [0.0, 0.0, speed],
            },
        }
        for name, mass, x in zip(("hub", "bob"), masses, places, strict=True)
    }
    guide = {"type": "prismatic", "markers": ["hub", "bob"], "axis": [1, 0, 0]}
    spring = {
        "type": "spring_damper",
        "joint": "guide",
        "rest": rest,
        "stiffness": stiffness,
    }
    system = started(
        bodies,
        ["guide.displacement", "hub.z"],
        joints={"guide": guide},
        forces={"spring": spring},
    )
    result = simulate(system)
    load = masses.prod() / masses.sum() * speed**2
    expected = rest * stiffness / (stiffness - load)
    assert result["guide.displacement"] == pytest.approx(expected, rel=1e-6)
    assert result["hub.z"] == pytest.approx(0.1 * result.t, abs=1e-9)


@pytest.mark.parametrize(
    ("joint", "speed", "angle"),
    [("distance", 1.5, 0.9), ("universal", 1.5, 0.0)],
)
def test_a_load_on_a_turning_jib_hangs_outwards(
    joint: str, speed: float, angle: float
) -> None:
    """The weight balances the centrifugal force about the tip, and modes are those of
    x'' + 2 W x x' = grad(W^2 r^2 / 2 - g z) on the sphere, seen from the jib.

    A load that a universal joint holds has inertia, and starts upright. Nobody states
    a velocity of the load.
    """
    R, L, m, A, C = 4.0, 3.0, 3.0, 0.02, 0.04
    held = joint == "universal"
    place = [R + L * np.sin(angle), 0.0, -L * np.cos(angle)]
    load: dict[str, Any] = {"mass": m, "initial": {"position": place}}
    rope: dict[str, Any] = {"type": joint, "markers": ["jib.tip", "load"]}
    if held:
        load |= {"inertia": [A, C, C], "markers": {"top": {"position": [0, 0, L]}}}
        rope |= {"markers": ["jib.tip", "load.top"]}
    jib = {"mass": 100.0, "inertia": [1.0, 5.0, 5.0]}
    jib |= {"markers": {"tip": {"position": [R, 0.0, 0.0]}}}
    jib |= {"initial": {"angular_velocity": [0.0, 0.0, speed]}}
    motor = {"joint": "tower", "function": polynomial(0.0, speed)}
    tower = {"type": "revolute", "markers": ["ground", "jib"]}
    system = started(
        {"jib": jib, "load": load},
        ["load.x", "load.y", "load.z"],
        joints={"tower": tower, "rope": rope},
        drives={"motor": motor},
        gravity=[0.0, 0.0, -G],
    )
    result = simulate(system)
    radius = np.hypot(result["load.x"], result["load.y"])
    out = float(np.arcsin((radius[0] - R) / L))
    excess = (A - C if held else 0.0) * np.sin(out) * np.cos(out)
    centrifugal = speed**2 * (m * radius[0] * L * np.cos(out) + excess)
    assert m * G * L * np.sin(out) == pytest.approx(centrifugal, rel=1e-8)
    assert np.ptp(radius) < 1e-7
    assert "N224" not in codes(result)
    if not held:
        stretch = G / np.cos(out)  # of the rope, by L
        M = np.diag([stretch / L - speed**2 * np.cos(out) ** 2, stretch / L - speed**2])
        coriolis = 2.0 * speed * np.cos(out) * np.array([[0.0, -1.0], [1.0, 0.0]])
        matrix = np.block([[np.zeros((2, 2)), np.eye(2)], [-M, -coriolis]])
        expected = np.unique(np.abs(np.linalg.eigvals(matrix).imag).round(9))
        whole = compile_scene(system.scene, keep_joints=True)
        found = linearise(whole, about="start").rotating_frequencies
        assert np.sort(2.0 * np.pi * found) == pytest.approx(expected, rel=1e-6)


@cache
def light_shaft() -> SID:
    """Of 0.8 m and 20 mm diameter, its mass a millionth of that of the disc."""
    d = 0.02
    ends = {"left": 0.0, "mid": 0.5, "right": 1.0}
    data = {
        "format": "sidtool model",
        "version": 1,
        "material": {
            "youngs_modulus": 2.1e11,
            "poissons_ratio": 0.3,
            "density": MASS * 1e-6 / (0.8 * np.pi * d**2 / 4),
        },
        "geometry": {
            "type": "beam",
            "start": [0, 0, 0],
            "end": [0.8, 0, 0],
            "section": {
                "shape": "general",
                "area": np.pi * d**2 / 4,
                "iy": np.pi * d**4 / 64,
                "iz": np.pi * d**4 / 64,
            },
        },
        "discretisation": {"type": "beam", "elements": 4},
        "markers": {
            name: {"node": k + 1, "parameters": [x]}
            for k, (name, x) in enumerate(ends.items())
        },
        "frame": {"type": "chord", "markers": ["left", "right"]},
        "reduction": {"method": "attachment", "interfaces": list(ends), "modes": 0},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sid_from_model(ModelFile.model_validate(data))


def shaft_with_disc(speed: float, bearing: float, **more: Any) -> System:
    """The disc in the middle of a shaft in two bearings."""
    spin = [speed, 0.0, 0.0]
    bodies = {
        "shaft": {
            "sid": "-",
            "markers": {"left": 1, "mid": 2, "right": 3},
            "initial": {"angular_velocity": spin},
        },
        "disc": {
            "mass": MASS,
            "inertia": [0.05, 0.025, 0.025],
            "centre_of_mass": [0.0, OFFSET, 0.0],
            "initial": {"position": [0.4, 0.0, 0.0], "angular_velocity": spin},
        },
    }
    joints: dict[str, Any] = {
        "shrink": {"type": "fixed", "markers": ["shaft.mid", "disc"]}
    }
    markers = {"left": 0.0, "right": 0.8}
    forces = {
        name: {
            "type": "bushing",
            "markers": [f"ground.{name}", f"shaft.{name}"],
            "shaft": "x",
            "stiffness": [1e8 * (name == "left"), bearing, bearing, 0.0, 0.0, 0.0],
        }
        for name in markers
        if bearing
    }
    if not bearing:
        joints["left"] = {
            "type": "coincident",
            "markers": ["ground.left", "shaft.left"],
        }
        joints["right"] = {
            "type": "point_on_line",
            "markers": ["ground.left", "shaft.right"],
            "axis": [1, 0, 0],
        }
    return started(
        bodies,
        ["disc.y", "disc.z"],
        joints=joints,
        forces=forces,
        ground={
            "markers": {n: {"position": [x, 0.0, 0.0]} for n, x in markers.items()}
        },
        sids={"shaft": light_shaft()},
        end=0.05,
        **more,
    )


@pytest.mark.parametrize(("speed", "bearing"), [(80.0, 5e5), (600.0, 5e5), (80.0, 0.0)])
def test_a_disc_on_a_flexible_shaft_whirls(speed: float, bearing: float) -> None:
    """Shaft and bearings are springs in series; without bearings the ends are held."""
    system = shaft_with_disc(speed, bearing)
    assert "N224" not in codes(system)
    _, radius = whirl(simulate(system), "disc.y", "disc.z", speed)
    soft = 0.8**3 / (48 * 2.1e11 * np.pi * 0.02**4 / 64)
    k = 1.0 / (soft + (0.5 / bearing if bearing else 0.0))
    load = MASS * speed**2
    assert radius == pytest.approx(load * OFFSET / (k - load), rel=1e-4)


def test_a_flexible_shaft_that_sags_has_no_steady_rotation() -> None:
    """It deforms anew in each turn."""
    system = shaft_with_disc(80.0, 5e5, gravity=[0.0, 0.0, -G])
    assert "shaft" in only(system, "N224").subject


@pytest.mark.parametrize(("foot", "carrier"), [("ground", "ground"), ("tower", "jib")])
def test_a_load_hangs_outwards_beside_a_fast_rotor(foot: str, carrier: str) -> None:
    """On a slow jib: tan(out) = W^2 r / g, whatever else turns, and on which body."""
    R, L, speed = 3.0, 2.0, 1.2
    turning = {"angular_velocity": [0.0, 0.0, speed]}
    jib: dict[str, Any] = {"mass": 100.0, "inertia": [1.0, 5.0, 5.0]}
    jib |= {"markers": {"tip": {"position": [R, 0.0, 0.0]}}, "initial": turning}
    load = {"mass": 2.0, "initial": {"position": [R, 0.0, -L]}}
    rotor: dict[str, Any] = {"mass": 1.0, "inertia": [0.01, 0.01, 0.02]}
    rotor |= {"initial": {"angular_velocity": [0.0, 0.0, 50.0]}}
    bodies = {"jib": jib, "load": load, "rotor": rotor}
    joints: dict[str, Any] = {
        "slewing": {"type": "revolute", "markers": [foot, "jib"]},
        "rope": {"type": "distance", "markers": ["jib.tip", "load"]},
        "bearing": {"type": "revolute", "markers": [carrier, "rotor"]},
    }
    if foot == "tower":
        bodies["tower"] = {"mass": 50.0, "inertia": [5.0, 5.0, 5.0]}
        joints["foot"] = {"type": "fixed", "markers": ["ground", "tower"]}
    system = started(
        bodies,
        ["load.x", "load.y"],
        joints=joints,
        drives={"motor": {"joint": "slewing", "function": polynomial(0.0, speed)}},
        gravity=[0.0, 0.0, -G],
        time={"end": 0.01, "output_step": 0.01},
    )
    result = simulate(system)
    radius = float(np.hypot(result["load.x"][0], result["load.y"][0]))
    out = np.arcsin((radius - R) / L)
    assert np.tan(out) == pytest.approx(speed**2 * radius / G, rel=1e-8)
    assert "N224" not in codes(result)


@pytest.mark.parametrize(("speed", "angle"), [(6.0, 5.0), (14.0, 30.0)])
def test_a_governor_swings_out(speed: float, angle: float) -> None:
    """tan(out) = w^2 (r + l sin(out)) / g from arms within the unstable rotation.

    It started there, or with crossed arms, of which the rotation is unstable, too.
    """
    r, length, start = 0.05, 0.3, np.deg2rad(angle)
    hub: dict[str, Any] = {"mass": 1.0, "inertia": [0.01, 0.01, 0.02]}
    hub |= {"initial": {"angular_velocity": [0.0, 0.0, speed]}}
    bodies, joints = {"hub": hub}, {"axle": {"type": "revolute"}}
    joints["axle"] |= {"markers": ["ground", "hub"], "axis": [0.0, 0.0, 1.0]}
    markers = {}
    for name, side in (("left", -1.0), ("right", 1.0)):
        markers[name] = {"position": [side * r, 0.0, 0.0]}
        reach = side * (r + length * np.sin(start))
        bodies[name] = {
            "mass": 1.0,
            "inertia": [1e-4, 1e-4, 1e-4],
            "markers": {"pin": {"position": [0.0, 0.0, length]}},
            "initial": {
                "position": [reach, 0.0, -length * np.cos(start)],
                "axis_angle": [0.0, -side * start, 0.0],
            },
        }
        pin = {"type": "revolute", "markers": [f"hub.{name}", f"{name}.pin"]}
        joints[f"{name}_pin"] = {**pin, "axis": [0.0, 1.0, 0.0]}
    hub["markers"] = markers
    record = ["left.x", "right.x"]
    system = started(bodies, record, joints=joints, gravity=[0.0, 0.0, -G], end=1.0)
    result = simulate(system)
    out = np.arcsin((result["right.x"][0] - r) / length)
    expected = speed**2 * (r + length * np.sin(out)) / G
    assert out > 0.0
    assert np.tan(out) == pytest.approx(expected, rel=1e-8)
    radius = result["right.x"].max()  # after half a turn or more it is there again
    assert radius == pytest.approx(r + length * np.sin(out), rel=1e-3)
    assert not {"N224", "N225"} & set(codes(result))


@pytest.mark.parametrize("speed", [50.0, 210.0, 400.0])
def test_an_unstable_steady_rotation_is_named(speed: float) -> None:
    """A sleeping top: A s^2 - i C w s - m g l = 0 of its tilt, in axes at rest."""
    distance, inertia = 0.1, [0.002, 0.002, 0.001]
    top: dict[str, Any] = {"mass": 1.0, "inertia": inertia}
    top["markers"] = {"tip": {"position": [0.0, 0.0, -distance]}}
    spin = [0.0, 0.0, speed]
    top["initial"] = {"position": [0.0, 0.0, distance], "angular_velocity": spin}
    joints = {"pivot": {"type": "spherical", "markers": ["ground", "top.tip"]}}
    system = started({"top": top}, ["top.z"], joints=joints, gravity=[0.0, 0.0, -G])
    A, gyroscopic = inertia[0] + distance**2, inertia[2] * speed
    growth = np.roots([A, -1j * gyroscopic, -G * distance]).real.max()
    if growth > 1e-9:
        assert only(system, "N225").data["rate"] == pytest.approx(growth, rel=1e-6)
    else:
        assert "N225" not in codes(system)
