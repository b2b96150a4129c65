"""Modes of rotors of three and more blades in multi-blade coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eig

import sidtool
from sidtool.formats.base.sid import Array
from tests.codes import codes, with_code

#: Hinges of the blades from the axis, their centres from the hinges [m], mass [kg] and
#: inertia [kg m^2] of a blade, stiffness of a hinge [N m/rad].
OFFSET, ARM, BLADE, INERTIA, LAG = 0.1, 0.5, 2.0, 0.05, 60.0
#: Mass of support and hub [kg], stiffness of the support along x and y [N/m].
SUPPORT, KX, KY = 13.0, 4e3, 9e3


def lagging_rotor(
    speed: float, count: int, damping: float = 0.0, **changes: Any
) -> sidtool.Scene:
    """Blades with hinges for lead and lag on a support of two stiffnesses: ground
    resonance of helicopters."""
    bodies: dict[str, Any] = {"support": {"mass": 10.0, "inertia": 1.0}}
    joints: dict[str, Any] = {
        "axle": {"type": "revolute", "markers": ["support", "hub"]}
    }
    base = {"stiffness": [KX, KY, 1e4], "damping": [damping, damping, 0.0]}
    forces: dict[str, Any] = {
        "base": {"type": "bushing", "markers": ["ground", "support"]} | base
    }
    hinges = {}
    for k in range(count):
        angle = 2 * np.pi * k / count
        out = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-out[1], out[0]])
        bodies[f"blade{k}"] = {
            "mass": BLADE,
            "inertia": INERTIA,
            "markers": {"root": {"position": [-ARM, 0.0]}},
            "initial": {
                "position": ((OFFSET + ARM) * out).tolist(),
                "velocity": (speed * (OFFSET + ARM) * across).tolist(),
                "angle": angle,
                "angular_velocity": speed,
            },
        }
        hinges[f"hinge{k}"] = {"position": (OFFSET * out).tolist(), "angle": angle}
        joints[f"lag{k}"] = {
            "type": "revolute",
            "markers": [f"hub.hinge{k}", f"blade{k}.root"],
        }
        forces[f"spring{k}"] = {
            "type": "spring_damper",
            "joint": f"lag{k}",
            "stiffness": LAG,
            "damping": 0.01 * damping,
        }
    bodies["hub"] = {
        "mass": 3.0,
        "inertia": 0.2,
        "markers": hinges,
        "initial": {"angular_velocity": speed},
    }
    motion = {"type": "constant", "value": speed}
    scene = sidtool.Scene(
        dimension="planar",
        time={"end": 1.0, "output_step": 0.1},
        bodies=bodies,
        joints=joints,
        forces=forces,
        drives={"motor": {"joint": "axle", "of": "rate", "function": motion}},
    )
    return scene.with_(changes) if changes else scene


def textbook(speed: float, count: int, damping: float = 0.0) -> Array:
    """Eigenvalues of Coleman and Feingold's equations: x and y of the hub, and the
    cyclic lag angles in axes that do not turn.

    With S the static, J the moment of inertia of a blade about its hinge, of support
    and all blades the mass M:
    M x'' + c x' + Kx x - (N / 2) S ys'' = 0,  M y'' + c y' + Ky y + (N / 2) S yc'' = 0,
    J (yc'' + 2 W ys' - W^2 yc) + d (yc' + W ys) + (k + e S W^2) yc + S y'' = 0, and
    likewise of ys with -x''.
    """
    S, J = BLADE * ARM, INERTIA + BLADE * ARM**2
    total = SUPPORT + count * BLADE
    half, lag = count / 2, 0.01 * damping
    M = np.diag([total, total, J, J])
    M[0, 3], M[1, 2] = -half * S, half * S
    M[2, 1], M[3, 0] = S, -S
    C = np.diag([damping, damping, lag, lag])
    C[2, 3], C[3, 2] = 2 * J * speed, -2 * J * speed
    stiffness = LAG + OFFSET * S * speed**2 - J * speed**2
    K = np.diag([KX, KY, stiffness, stiffness])
    K[2, 3], K[3, 2] = lag * speed, -lag * speed
    zero, one = np.zeros((4, 4)), np.eye(4)
    A = np.block([[zero, one], [-K, -C]])
    B = np.block([[one, zero], [zero, M]])
    return np.asarray(eig(A, B, right=False))


@pytest.mark.parametrize(
    ("speed", "count", "damping"),
    [(10.0, 3, 0.0), (18.0, 4, 0.0), (18.0, 5, 30.0), (26.0, 3, 30.0)],
)
def test_ground_resonance_is_that_of_coleman_and_feingold(
    speed: float, count: int, damping: float
) -> None:
    modes = sidtool.linearise(lagging_rotor(speed, count, damping), about="start")
    for value in textbook(speed, count, damping):
        if value.imag >= 0.0:
            assert np.abs(modes.eigenvalues - value).min() < 1e-6 * abs(value)
    assert with_code(modes, "N744")


@pytest.mark.parametrize("speed", [6.0, 14.0, 30.0])
def test_blades_on_a_round_support_have_one_frequency_in_inertial_axes(
    speed: float,
) -> None:
    """Of a support without directions the complex motion x + i y = exp(i w t) has
    (K - M w^2) (k + e S W^2 - J (w - W)^2) = (N / 2) S^2 w^4, backward for w < 0."""
    round_support = {"forces.base.stiffness": [KX, KX, 1e4]}
    modes = sidtool.linearise(lagging_rotor(speed, 3, **round_support), about="start")
    S, J, w = BLADE * ARM, INERTIA + BLADE * ARM**2, np.poly1d([1.0, 0.0])
    support = KX - (SUPPORT + 3 * BLADE) * w**2
    lag = LAG + OFFSET * S * speed**2 - J * (w - speed) ** 2
    whirling = [each != "" for each in modes.whirl]
    signs = [-1.0 if each == "backward" else 1.0 for each in modes.whirl]
    found = np.sort((signs * modes.inertial_frequencies)[whirling]) * 2 * np.pi
    expected = np.sort((support * lag - 1.5 * S**2 * w**4).roots.real)
    assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("count", [3, 4])
def test_multipliers_are_those_of_floquet(count: int) -> None:
    """The rotor on unequal springs has periodic equations; here they are constant."""
    scene = lagging_rotor(18.0, count, 20.0)
    found = sidtool.floquet(scene, 2 * np.pi / 18.0)
    modes = sidtool.linearise(scene, about="start")
    for value, hertz in zip(modes.eigenvalues, modes.inertial_frequencies, strict=True):
        multiplier = np.exp(value * found.period)
        both = np.stack([found.multipliers, found.multipliers.conj()])
        near = np.abs(both - multiplier).min(axis=0)
        k = int(near.argmin())
        assert near[k] < 1e-6
        orders = (hertz - found.inertial_frequencies[k]) * found.period
        sums = (hertz + found.inertial_frequencies[k]) * found.period
        assert min(abs(x - round(x)) for x in (orders, sums)) < 1e-4


def test_a_start_beside_a_steady_rotation_has_the_modes_of_the_rotation() -> None:
    """Springs that are loaded at the start accelerate the blades there. Nothing damps
    them or feeds them: about the rotation with hinges bent by b, in which the springs
    bear the centrifugal moment e S W^2 sin b, no mode grows."""
    speed, lag = 10.0, 0.02
    rest = lag + OFFSET * BLADE * ARM * speed**2 * np.sin(lag) / LAG
    loaded = {f"forces.spring{k}.rest": rest for k in range(3)}
    bent = dict[str, Any](loaded)
    for k in range(3):
        azimuth, angle = 2 * np.pi * k / 3, 2 * np.pi * k / 3 + lag
        centre = OFFSET * np.exp(1j * azimuth) + ARM * np.exp(1j * angle)
        velocity = 1j * speed * centre
        bent[f"bodies.blade{k}.initial"] = {
            "position": [float(centre.real), float(centre.imag)],
            "velocity": [float(velocity.real), float(velocity.imag)],
            "angle": float(angle),
            "angular_velocity": speed,
        }
    beside, steady = (
        sidtool.linearise(lagging_rotor(speed, 3, **changes), about="start")
        for changes in (loaded, bent)
    )
    assert np.abs(beside.damping_ratios).max() < 1e-8
    assert "N714" not in codes(beside)
    assert_allclose(beside.eigenvalues, steady.eigenvalues, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("travel", [0.0, 3.0])
def test_what_does_not_turn_does_not_whirl(travel: float) -> None:
    """A body on a trolley, under its weight beside its equilibrium: w^2 = k / m."""
    start = {"initial": {"velocity": [travel, 0.0, 0.0]}}
    k = [100.0, 400.0, 900.0]
    scene = sidtool.Scene(
        dimension="spatial",
        gravity=[0.0, 0.0, -9.81],
        time={"end": 1.0, "output_step": 0.1},
        bodies={
            "trolley": {"mass": 5.0, "inertia": [1.0] * 3} | start,
            "load": {"mass": 1.0, "inertia": [1.0] * 3} | start,
        },
        joints={"rail": {"type": "prismatic", "markers": ["ground", "trolley"]}},
        drives={
            "motor": {
                "joint": "rail",
                "of": "rate",
                "function": {"type": "constant", "value": travel},
            }
        },
        forces={
            "springs": {
                "type": "bushing",
                "markers": ["trolley", "load"],
                "stiffness": [*k, 1e3, 1e3, 1e3],
            }
        },
    )
    modes = sidtool.linearise(scene, about="start")
    assert {*modes.whirl} == {""}
    assert_allclose(2 * np.pi * modes.frequencies[:3], np.sqrt(k), rtol=1e-6)


def flapping_rotor(speed: float) -> sidtool.Scene:
    """Three blades with flap hinges in space, on a support that tilts and moves."""
    bodies: dict[str, Any] = {
        "support": {"mass": 8.0, "inertia": [0.4, 0.6, 0.5]},
        "hub": {
            "mass": 3.0,
            "inertia": [0.1, 0.1, 0.2],
            "initial": {"angular_velocity": [0.0, 0.0, speed]},
            "markers": {},
        },
    }
    joints: dict[str, Any] = {
        "axle": {"type": "revolute", "markers": ["support", "hub"]}
    }
    stiffness = [4e3, 9e3, 2e4, 300.0, 500.0, 1e4]
    forces: dict[str, Any] = {
        "base": {
            "type": "bushing",
            "markers": ["ground", "support"],
            "stiffness": stiffness,
            "damping": [20.0, 20.0, 20.0, 1.0, 1.0, 1.0],
        }
    }
    for k in range(3):
        angle = 2 * np.pi * k / 3
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        across = np.array([-out[1], out[0], 0.0])
        turn = [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
        bodies["hub"]["markers"][f"hinge{k}"] = {
            "position": (OFFSET * out).tolist(),
            "quaternion": turn,
        }
        bodies[f"blade{k}"] = {
            "mass": BLADE,
            "inertia": [0.002, INERTIA, INERTIA],
            "markers": {"root": {"position": [-ARM, 0.0, 0.0]}},
            "initial": {
                "position": ((OFFSET + ARM) * out).tolist(),
                "quaternion": turn,
                "velocity": (speed * (OFFSET + ARM) * across).tolist(),
                "angular_velocity": [0.0, 0.0, speed],
            },
        }
        joints[f"flap{k}"] = {
            "type": "revolute",
            "markers": [f"hub.hinge{k}", f"blade{k}.root"],
            "axis": [0.0, 1.0, 0.0],
        }
        forces[f"spring{k}"] = {
            "type": "spring_damper",
            "joint": f"flap{k}",
            "stiffness": 40.0,
            "damping": 0.2,
        }
    motion = {"type": "constant", "value": speed}
    return sidtool.Scene(
        dimension="spatial",
        time={"end": 1.0, "output_step": 0.1},
        bodies=bodies,
        joints=joints,
        forces=forces,
        drives={"motor": {"joint": "axle", "of": "rate", "function": motion}},
    )


def test_flapping_blades_in_space_have_the_multipliers_of_floquet() -> None:
    """Cyclic flap couples with the tilt of the support, collective flap with heave."""
    scene, speed = flapping_rotor(15.0), 15.0
    found = sidtool.floquet(scene, 2 * np.pi / speed)
    modes = sidtool.linearise(scene, about="start")
    assert with_code(modes, "N744")
    both = np.concatenate([found.multipliers, found.multipliers.conj()])
    for value in modes.eigenvalues:
        assert np.abs(both - np.exp(value * found.period)).min() < 1e-6
    assert len(modes.eigenvalues) == len(found.multipliers) == 9


def test_rotors_that_have_no_such_coordinates_are_refused() -> None:
    """Two blades, and three of which one is heavier."""
    heavier = lagging_rotor(18.0, 3, **{"bodies.blade1.mass": 2.2})
    for scene in (lagging_rotor(18.0, 2), heavier):
        with pytest.raises(sidtool.SimulationError) as caught:
            sidtool.linearise(scene, about="start")
        assert {"N718", "N713"} <= set(codes(caught.value))


def test_a_campbell_diagram_of_ground_resonance() -> None:
    """Whirl: the lag mode goes backward below and forward above its own frequency."""
    speeds = [10.0, 18.0]
    found = [sidtool.linearise(lagging_rotor(s, 3), about="start") for s in speeds]
    slowest = [int(modes.inertial_frequencies.argmin()) for modes in found]
    whirl = [m.whirl[k] for m, k in zip(found, slowest, strict=True)]
    assert whirl == ["backward", "forward"]
    for modes, k, speed in zip(found, slowest, speeds, strict=True):
        sign = 1.0 if whirl[speeds.index(speed)] == "backward" else -1.0
        turning = abs(sign * modes.inertial_frequencies[k] + speed / (2 * np.pi))
        assert_allclose(modes.rotating_frequencies[k], turning, rtol=1e-9)


def test_blades_need_no_marker_but_their_roots() -> None:
    """On a hub that only turns, patterns of three blades have the frequency of one
    blade in its axes, and that less the speed, alone and with it in inertial axes."""
    speed, blades = 15.0, {}
    model = sidtool.Model(
        material={"youngs_modulus": 7e10, "poissons_ratio": 0.3, "density": 2700.0},
        geometry={
            "type": "beam",
            "start": [0.0, 0.0, 0.0],
            "end": [2.0, 0.0, 0.0],
            "section": {"shape": "rectangle", "height": 0.05, "width": 0.02},
        },
        discretisation={"type": "beam", "elements": 8},
        frame={"type": "tangent", "marker": "root", "clamp": "start"},
        markers={"root": {"node": 1, "edge": "start"}},
        reduction={"method": "modal", "modes": 2},
        stiffening={},
    )
    base, sid = flapping_rotor(speed), sidtool.convert(model)
    joints: dict[str, Any] = {
        "axle": {"type": "revolute", "markers": ["ground", "hub"]}
    }
    for k in range(3):
        start = base.bodies[f"blade{k}"].initial
        hinge = base.bodies["hub"].markers[f"hinge{k}"]
        blades[f"blade{k}"] = {
            "sid": sid,
            "markers": {"root": 1},
            "initial": {
                "position": hinge.position,
                "quaternion": hinge.quaternion,
                "angular_velocity": start.angular_velocity,
            },
        }
        joints[f"root{k}"] = {
            "type": "fixed",
            "markers": [f"hub.hinge{k}", f"blade{k}.root"],
        }
    every = sidtool.Scene(
        dimension="spatial",
        time={"end": 1.0, "output_step": 0.1},
        bodies={"hub": base.bodies["hub"], **blades},
        joints=joints,
        drives=base.drives,
    )
    one = sidtool.Scene(
        dimension="spatial",
        time={"end": 1.0, "output_step": 0.1},
        bodies={"hub": base.bodies["hub"], "blade0": blades["blade0"]},
        joints={key: joints[key] for key in ("axle", "root0")},
        drives=base.drives,
    )
    alone = sidtool.linearise(one, about="start").frequencies
    modes = sidtool.linearise(every, about="start")
    assert_allclose(np.sort(modes.rotating_frequencies), np.repeat(alone, 3), rtol=1e-6)
    turn = speed / (2 * np.pi)
    expected = np.sort(np.add.outer(alone, [-turn, 0.0, turn]).ravel())
    assert_allclose(np.sort(modes.inertial_frequencies), expected, rtol=1e-6)
    order = np.argsort(modes.inertial_frequencies)
    names = {-turn: "backward", 0.0: "", turn: "forward"}
    found = [modes.whirl[k] for k in order]
    pairs = sorted((f + shift, names[shift]) for f in alone for shift in names)
    assert found == [name for _, name in pairs]


def test_springs_of_a_rotor_in_space_have_no_corners() -> None:
    """Forces at rest are 0: the rounding of centrifugal ones is no corner."""
    speed, axis = 8.0, {"axis": [0.0, 0.0, 1.0]}
    spin = {"angular_velocity": [0.0, 0.0, speed]}
    hub: dict[str, Any] = {"mass": 3.0, "inertia": [0.2] * 3, "markers": {}}
    bodies: dict[str, Any] = {"support": {"mass": 10.0, "inertia": [1.0] * 3}}
    joints: dict[str, Any] = {
        "axle": {"type": "revolute", "markers": ["support", "hub"]} | axis
    }
    base = {
        "markers": ["ground", "support"],
        "stiffness": [4e3, 9e3, 1e5, 1e4, 1e4, 1e4],
    }
    forces: dict[str, Any] = {"base": {"type": "bushing"} | base}
    for k in range(3):
        turn = {"axis_angle": [0.0, 0.0, 2 * np.pi * k / 3]}
        out = np.array([np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3), 0.0])
        start = {
            "position": (0.6 * out).tolist(),
            "velocity": (0.6 * speed * np.cross([0.0, 0.0, 1.0], out)).tolist(),
        }
        bodies[f"blade{k}"] = {
            "mass": 2.0,
            "inertia": [0.05] * 3,
            "markers": {"root": {"position": [-0.5, 0.0, 0.0]}},
            "initial": start | turn | spin,
        }
        hub["markers"][f"hinge{k}"] = {"position": (0.1 * out).tolist()} | turn
        ends = [f"hub.hinge{k}", f"blade{k}.root"]
        joints[f"lag{k}"] = {"type": "revolute", "markers": ends} | axis
        spring = {"type": "spring_damper", "joint": f"lag{k}", "stiffness": 60.0}
        forces[f"spring{k}"] = spring
    motion = {"type": "constant", "value": speed}
    scene = sidtool.Scene(
        dimension="spatial",
        time={"end": 1.0, "output_step": 0.1},
        bodies=bodies | {"hub": hub | {"initial": spin}},
        joints=joints,
        forces=forces,
        drives={"motor": {"joint": "axle", "of": "rate", "function": motion}},
    )
    assert "N745" not in codes(sidtool.linearise(scene, about="start"))
