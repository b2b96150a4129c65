"""Starts in relative equilibrium, and starts that are far from one."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.result import Result
from sidtool.solver import compile_scene, inverse_dynamics, linearise, simulate
from sidtool.solver.system.system import System
from tests.bodies import Cloud
from tests.codes import codes, only, with_code
from tests.solver.scenes import compiled, polynomial, scene
from tests.steel_bars import steel_bar

WAVE = np.sqrt(2.1e11 / 7850.0)
#: Codes of bodies that vibrate from the start on.
FAR = ("N219", "N220")


def stout_bar() -> SID:
    return steel_bar(width=0.5, height=0.4, elements=24, modes=16)


def spun(sid: SID, rate: float, state: str, **more: Any) -> Any:
    """The bar on a hub that turns at a constant rate from the start on."""
    joints = {"hub": {"type": "revolute", "markers": ["ground", "bar.a"]}}
    drives = {"motor": {"joint": "hub", "function": polynomial(0.3, rate)}}
    body = {"sid": "-", "markers": {"a": 1, "b": 2}} | more.pop("body", {})
    described = scene(
        {"bar": body},
        joints,
        drives,
        end=0.01,
        record=["bar.b.ux", "bar.b.uy"],
        initial={"state": state},
        accuracy={"rtol": 1e-7},
        **more,
    )
    return simulate(compiled(described, bar=sid))


@pytest.mark.parametrize("rate", [150.0, -400.0])
def test_a_spinning_bar_starts_stretched(rate: float) -> None:
    """E u'' + rho w^2 (x + u) = 0 between the axis and the free end: u(L) is
    tan(k L) / k - L with k = w / c. It stays so, and is told to ring otherwise."""
    sid = stout_bar()
    steady, sudden = spun(sid, rate, "static"), spun(sid, rate, "stated")
    k = abs(rate) / WAVE
    stretch = np.tan(k) / k - 1.0
    assert steady["bar.b.ux"] == pytest.approx(stretch, rel=1e-3)
    assert np.ptp(steady["bar.b.ux"]) < 1e-6 * stretch
    assert np.ptp(sudden["bar.b.ux"]) > stretch
    assert not with_code(steady, *FAR)
    assert only(sudden, *FAR).subject == "bar"


def turning(rate: float, how: str) -> dict[str, Any]:
    """A drive of the hub at a constant rate, said in several ways."""
    constant = {"type": "constant", "value": rate}
    return {
        "value": {"function": polynomial(0.3, rate)},
        "rate": {"of": "rate", "start": 0.3, "function": constant},
        "polynomial": {"of": "rate", "start": 0.3, "function": polynomial(rate)},
        "formula": {
            "of": "rate",
            "start": 0.3,
            "function": {"type": "expression", "value": f"{rate / 2}*2"},
        },
        "acceleration": {
            "of": "acceleration",
            "start": 0.3,
            "start_rate": rate,
            "function": constant | {"value": 0.0},
        },
    }[how]


def on_a_hub(how: str, state: str, dimension: str, keep_joints: bool = False) -> System:
    """A disc with the bar on it, at 250 rad/s from the start on."""
    turn = {"mass": 5.0, "inertia": 0.2 if dimension == "planar" else [0.2] * 3}
    joints = {
        "axle": {"type": "revolute", "markers": ["ground", "disc"]},
        "weld": {"type": "fixed", "markers": ["disc", "bar.a"]},
    }
    described = scene(
        {"disc": turn, "bar": {"sid": "-", "markers": {"a": 1, "b": 2}}},
        joints,
        {"motor": {"joint": "axle"} | turning(250.0, how)},
        dimension=dimension,
        end=0.01,
        record=["bar.b.ux", "bar.b.uy", "weld.fx" if keep_joints else "disc.angle"],
        initial={"state": state},
        accuracy={"rtol": 1e-7},
    )
    sids = {"bar": stout_bar()}
    return compile_scene(described, sids=sids, keep_joints=keep_joints)


@cache
def run_on_a_hub(how: str) -> Result:
    return simulate(on_a_hub(how, "static", "planar"))


@cache
def analyses_on_a_hub(how: str, dimension: str) -> tuple[Array, Array]:
    """Frequencies about the start, and forces of the weld of inverse dynamics."""
    system = on_a_hub(how, "stated", dimension, keep_joints=True)
    forces = inverse_dynamics(system, quasi_static=True)["weld.fx"]
    return linearise(system, about="start").frequencies, forces


@pytest.mark.parametrize("how", ["rate", "polynomial", "formula", "acceleration"])
def test_a_constant_rate_has_the_steady_start_of_its_angle(how: str) -> None:
    """u(L) = tan(k L) / k - L, see above, without vibration; the run goes on as with
    the angle, and so do modes about the start and inverse dynamics."""
    k = 250.0 / WAVE
    stretch = np.tan(k) / k - 1.0
    runs = [run_on_a_hub(by) for by in (how, "value")]
    for run in runs:
        assert run["bar.b.ux"] == pytest.approx(stretch, rel=1e-3)
        for output in ("bar.b.ux", "bar.b.uy"):
            assert np.ptp(run[output]) < 1e-6 * stretch
        # the SID lacks stiffening: w^2 / w1^2 of a clamped bar, in the plane
        softening = (250.0 / (1.8751**2 * WAVE * 0.4 / np.sqrt(12.0))) ** 2
        assert codes(run) == ["N404", "N221"]
        moved = only(run, "N221")  # the drive begins at 0.3 rad
        assert "disc by 0.3 rad" in moved.data["changes"]  # type: ignore[operator]
        assert only(run, "N404").data["ratio"] == pytest.approx(-softening, rel=0.1)
    assert runs[0]["disc.angle"] == pytest.approx(0.3 + 250.0 * runs[0].t, rel=1e-7)
    for dimension in ("planar", "spatial"):
        (this, force), (that, known) = (
            analyses_on_a_hub(by, dimension) for by in (how, "value")
        )
        assert this == pytest.approx(that, rel=1e-9)
        assert force == pytest.approx(known, rel=1e-9, abs=1e-6)


def test_a_rate_that_follows_the_motion_has_no_steady_start() -> None:
    """A law that reads an output is no function of the time, and is said not to be."""
    law = {"type": "expression", "value": "250 - 0*disc.angle"}
    system = on_a_hub("value", "stated", "planar")
    drive = {"joint": "axle", "of": "rate", "start": 0.3, "function": law}
    described = system.scene.with_({"drives.motor": drive})
    led = compile_scene(described, sids={"bar": stout_bar()}, keep_joints=True)
    with pytest.raises(InputError, match="no function of the motion"):
        inverse_dynamics(led, quasi_static=True)


@pytest.mark.parametrize(
    ("frame", "ends", "speed"), [("tangent", 1, 8.0), ("chord", 2, 12.0)]
)
def test_a_fast_blade_starts_in_its_sag(frame: str, ends: int, speed: float) -> None:
    """Its bending is stiffened by several times Ke: corrections by Ke alone led away.

    Published frequencies out of the plane: A. D. Wright, C. E. Smith, R. W. Thresher,
    J. L. C. Wang, J. Appl. Mech. 49 (1982), table 2, by sqrt(EI / rho A L^4).
    """
    flapping = {8.0: 9.2568, 12.0: 13.170}[speed]
    unit = np.sqrt(2.1e11 / 7850.0 * 0.02**2 / 12)
    both = ["root", "tip"]
    frames = {
        "tangent": {"marker": "root", "clamp": ["start"]},
        "chord": {"markers": both},
    }
    blade = steel_bar(
        elements=20,
        frame={"type": frame} | frames[frame],
        reduction={"method": "craig_bampton", "interfaces": both[-ends:], "modes": 8},
        stiffening={},
    )
    described = scene(
        {"blade": {"sid": "-", "markers": {"root": 1, "tip": 2}}},
        {"hub": {"type": "revolute", "markers": ["ground", "blade.root"]}},
        {"spin": {"joint": "hub", "function": polynomial(0.0, speed * unit)}},
        dimension="spatial",
        gravity=[0.0, 0.0, -9.81],
        end=0.02,
        record=["hub.fz", "blade.tip.z"],
        initial={"state": "static"},
    )
    system = compile_scene(described, sids={"blade": blade}, keep_joints=True)
    seen = 2.0 * np.pi * linearise(system, "start").frequencies / unit
    assert np.min(np.abs(seen - flapping)) < 2e-3 * flapping
    result = simulate(compiled(described, blade=blade))
    sag = -result["blade.tip.z"]
    assert np.all(sag > 0.0) and np.ptp(sag) < 1e-4 * sag[0]
    weight = 9.81 * 7850.0 * 0.02**2
    assert result["hub.fz"] == pytest.approx(weight, rel=1e-4)


@pytest.mark.parametrize("state", ["static", "stated"])
def test_a_clamped_bar_under_gravity(state: str) -> None:
    """At rest only where it starts so; it says by how much it is away, about
    rho g A L^4 / (8 E I) of 1 m. A deformation that the scene states is meant."""
    sid = stout_bar()
    joints = {"wall": {"type": "fixed", "markers": ["ground", "bar.a"]}}
    body = {"sid": "-", "markers": {"a": 1, "b": 2}, "shape_functions": [1, 2, 3]}
    for stated in (False, True):
        if stated:
            body["initial"] = {"elastic": [0.0, 0.0, 0.0]}
        described = scene(
            {"bar": body},
            joints,
            end=0.01,
            gravity=[0.0, -9.81],
            record=["bar.b.uy"],
            initial={"state": state},
        )
        result = simulate(compiled(described, bar=sid))
        found = with_code(result, *FAR)
        assert bool(found) == (state == "stated" and not stated)
        sag = 7850.0 * 9.81 * 0.2 / (8 * 2.1e11 * 0.5 * 0.4**3 / 12)
        for diagnostic in found:
            assert diagnostic.subject == "bar" and diagnostic.code == "N219"
            assert diagnostic.data["share"] == pytest.approx(sag, rel=0.1)


@pytest.mark.parametrize("height", [0.004, 0.02])
def test_a_start_far_from_equilibrium_is_a_warning_from_one_per_cent_on(
    height: float,
) -> None:
    """The sag of a clamped steel bar of 1 m under gravity, rho g A L^4 / (8 E I)."""
    described = scene(
        {"bar": {"sid": "-", "markers": {"a": 1}}},
        {"wall": {"type": "fixed", "markers": ["ground", "bar.a"]}},
        end=0.05,
        gravity=[0.0, -9.81],
    )
    result = simulate(compiled(described, bar=steel_bar(height=height)))
    sag = 7850.0 * 9.81 / (8.0 * 2.1e11 * height**2 / 12.0)
    found = only(result, *FAR)
    assert (found.code, found.subject) == ("N220" if sag > 0.01 else "N219", "bar")
    assert found.severity == ("warning" if sag > 0.01 else "info")
    assert found.data["share"] == pytest.approx(sag, rel=0.02)
    assert "static" in found.remedy


def thrown(
    sid: SID, rate: float, speed: float, quadratic: bool | None = None, **tables: Any
) -> System:
    """The bar with an initial angular velocity, and velocity along y, in space."""
    initial = {"angular_velocity": [0.0, 0.0, rate], "velocity": [0.0, speed, 0.0]}
    bar: dict[str, Any] = {"sid": "-", "markers": {"a": 1, "b": 2}, "initial": initial}
    bodies = {"bar": bar | {"quadratic_inertia": quadratic}}
    described = scene(
        bodies | tables.pop("bodies", {}),
        tables.pop("joints", {}),
        dimension="spatial",
        end=0.003,
        record=["bar.b.ux", "bar.b.uy"],
        initial={"state": "static"},
        accuracy={"rtol": 1e-8},
        **tables,
    )
    return compiled(described, bar=sid)


@pytest.mark.parametrize("rate", [-250.0])
def test_a_bar_that_is_thrown_spinning_starts_stretched(rate: float) -> None:
    """On a hinge as one that is driven; free, each half stretches from the middle."""
    sid, k = stout_bar(), abs(rate) / WAVE
    halves = 2.0 * np.tan(k / 2.0) / k - 1.0
    for joints, speed, stretch, close in (
        ({"joints": HINGE}, 0.0, np.tan(k) / k - 1.0, 1e-3),
        ({}, -rate * sid.mdCM.m0[0, 0] / sid.mass, halves, 1e-2),
    ):
        steady = simulate(thrown(sid, rate, speed, **joints))
        assert steady["bar.b.ux"] == pytest.approx(stretch, rel=close)
        assert np.ptp(steady["bar.b.ux"]) < 1e-6 * stretch


def test_a_satellite_with_panel_starts_in_steady_spin() -> None:
    """About the axis of the greatest inertia of the whole, which is free."""
    sid, rate = stout_bar(), 60.0
    hub = {"mass": 2.0e3, "inertia": [90.0, 90.0, 400.0]}
    speed = -rate * sid.mdCM.m0[0, 0] / (sid.mass + 2.0e3)
    spin = {"angular_velocity": [0, 0, rate], "velocity": [0, speed, 0]}
    seat = {"seat": {"type": "fixed", "markers": ["hub", "bar.a"]}}
    bodies = {"hub": hub | {"initial": spin}}
    steady = simulate(thrown(sid, rate, speed, bodies=bodies, joints=seat))
    assert steady["bar.b.ux"][0] > 1e-6
    assert np.ptp(steady["bar.b.ux"]) < 1e-5 * steady["bar.b.ux"][0]
    assert np.abs(steady["bar.b.uy"]).max() < 1e-5 * steady["bar.b.ux"][0]


def test_a_spin_too_fast_for_a_soft_bar_says_that_it_starts_as_at_rest() -> None:
    system = thrown(stout_bar(), 2.0 * WAVE, 0.0, quadratic=False, joints=HINGE)
    assert only(system, "N224").subject == "bar"


HINGE = {"hub": {"type": "revolute", "markers": ["ground", "bar.a"]}}


@pytest.mark.parametrize("speed", [2.0, -3.0])
def test_a_cart_that_rubs_starts_bent_forward(speed: float) -> None:
    """It is braked by mu g, and with it a mass on a spring of its own and a block that
    friction holds on that: the spring is bent by (m + block) mu g / k, and stays so."""
    frame, mass, block, stiffness, mu, g = 1.5, 0.5, 0.3, 80.0, 0.25, 9.81
    back = -0.1  # what the frame goes back where the spring is bent by 1
    phi = np.zeros((3, 3, 1))
    phi[:, 0, 0] = 1.0 + back, back, back
    c = np.array([[0.0, 0.05, 0.0], [0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]])
    masses = np.array([mass, 0.5 * frame, 0.5 * frame])
    stiff = np.array([[stiffness]])
    sid = Cloud(masses, c, phi, np.zeros_like(phi)).sid(stiff, np.zeros((1, 1)), 2)
    moving = {"velocity": [speed, 0.0]}
    ends = {"rail": ["ground", "cart.2"], "top": ["cart.1", "block"]}
    described = scene(
        {
            "cart": {"sid": "-", "initial": moving},
            "block": {
                "mass": block,
                "inertia": 0.01,
                "initial": moving | {"position": [0.0, 0.05]},
            },
        },
        {
            name: {
                "type": "prismatic",
                "markers": markers,
                "friction": {"coefficient": mu, "static": 2.0 * mu},
            }
            for name, markers in ends.items()
        },
        end=0.3,
        gravity=[0.0, -g],
        record=["cart.q1", "top.sticking", "rail.sticking"],
        initial={"state": "static"},
        accuracy={"rtol": 1e-9},
    )
    result = simulate(compiled(described, cart=sid))
    bent = np.sign(speed) * (mass + block) * mu * g / stiffness
    assert result["cart.q1"] == pytest.approx(bent, rel=1e-6)
    assert (result["top.sticking"] == 1.0).all()
    assert not (result["rail.sticking"] == 1.0).any()


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_spinning_bar_that_its_hinge_brakes_starts_without_vibration(
    dimension: str,
) -> None:
    """Its elastic coordinates follow the speed, which friction of the pin takes, from
    the deformation by the loads of the spin and of the braking on."""
    sid = steel_bar(width=0.1, height=0.08, elements=8, modes=4)
    law = {"coefficient": 0.4, "radius": 0.02}
    planar = dimension == "planar"
    hub = {"type": "revolute", "markers": ["ground", "bar.a"], "friction": law}
    q = {}
    for state in ("static", "stated"):
        spin = {"angular_velocity": -70.0 if planar else [0.0, 0.0, -70.0]}
        body = {"sid": "-", "markers": {"a": 1, "b": 2}, "initial": spin}
        described = scene(
            {"bar": body},
            {"hub": hub},
            dimension=dimension,
            end=0.02,
            record=["bar.b.uy", "hub.friction"],
            initial={"state": state},
            accuracy={"rtol": 1e-8},
        )
        result = simulate(compiled(described, bar=sid))
        q[state] = result["bar.b.uy"]
        if state == "static":
            assert "N224" not in codes(result)
    assert abs(q["static"][0]) > 1e-5
    wobble = np.ptp(np.diff(q["static"], 2))
    assert wobble < 1e-2 * np.ptp(np.diff(q["stated"], 2))


@pytest.mark.parametrize(("modes", "rubs"), [(4, 0.0), (10, 0.0), (4, 0.05)])
def test_how_far_a_hinged_bar_starts_that_a_torque_turns(
    modes: int, rubs: float
) -> None:
    """Its inertia loads rho A a x with a = 3 T / (rho A L^3) bend its end by
    11/40 T L^2 / (E I), however much its light end at first turns against it. A little
    friction of its pin, which breaks loose, makes no difference."""
    sid = steel_bar(width=0.02, height=0.01, elements=24, modes=modes)
    torque = {"type": "actuator", "joint": "hub", "function": polynomial(0.5)}
    hub: dict[str, Any] = {"type": "revolute", "markers": ["ground", "bar.a"]}
    if rubs:
        hub["friction"] = {"coefficient": rubs, "radius": 1e-3}
    described = scene(
        {"bar": {"sid": "-", "markers": {"a": 1, "b": 2}}},
        {"hub": hub},
        forces={"motor": torque},
        end=0.05,
        record=["bar.b.uy"],
    )
    result = simulate(compiled(described, bar=sid))
    found = only(result, *FAR)
    bent = 11.0 / 40.0 * 0.5 / (2.1e11 * 0.02 * 0.01**3 / 12.0)
    assert found.data["share"] == pytest.approx(bent, rel=0.1)
    assert found.code == ("N220" if bent > 0.01 else "N219")


@pytest.mark.parametrize("reduction", ["modal", "craig_bampton"])
@pytest.mark.parametrize("rate", [0.05, 5.0])
def test_blades_far_from_the_ground_start_stretched(
    rate: float, reduction: str
) -> None:
    """u(L) = rho w^2 / E (r L^2 / 2 + L^3 / 3), without vibration; bending shapes alone
    stay straight. What rounding leaves of the forces is no lack of equilibrium."""
    height, radius = 90.0, 0.3
    hub = {"mass": 5.0, "inertia": [0.2] * 3, "markers": {}}
    bodies: dict[str, Any] = {
        "hub": hub | {"initial": {"position": [0.0, 0.0, height]}}
    }
    joints: dict[str, Any] = {
        "axle": {
            "type": "revolute",
            "axis": [1, 0, 0],
            "markers": ["ground.top", "hub"],
        }
    }
    for k, angle in enumerate(2.0 * np.pi * np.arange(3) / 3.0):
        # the axis of the bar, x, along the radius; to seven digits, as people write it
        half = np.array([np.cos(angle / 2), np.sin(angle / 2)]) / np.sqrt(2.0)
        turn = np.round([half[0], half[1], -half[0], -half[1]], 7)
        root = np.round([0.0, -np.sin(angle), np.cos(angle)], 7) * radius
        pose = {"quaternion": turn.tolist()}
        hub["markers"][f"root{k}"] = pose | {"position": root.tolist()}
        at = (root + [0.0, 0.0, height]).tolist()
        bodies[f"blade{k}"] = {
            "sid": "-",
            "markers": {"root": 1, "tip": 2},
            "initial": pose | {"position": at},
        }
        joints[f"root{k}"] = {
            "type": "fixed",
            "markers": [f"hub.root{k}", f"blade{k}.root"],
        }
    stretches = reduction == "craig_bampton"
    shapes = {"interfaces": ["tip"], "modes": 2} if stretches else {"modes": 6}
    blade = steel_bar(
        elements=20, reduction={"method": reduction} | shapes, stiffening={}
    )
    described = scene(
        bodies,
        joints,
        {"motor": {"joint": "axle", "function": polynomial(0.0, rate)}},
        dimension="spatial",
        ground={"markers": {"top": {"position": [0.0, 0.0, height]}}},
        end=0.01,
        record=["blade0.tip.ux", "blade1.tip.ux", "blade2.tip.ux"],
        initial={"state": "static"},
    )
    run = simulate(compiled(described, blade0=blade, blade1=blade, blade2=blade))
    stretch = rate**2 / WAVE**2 * (radius / 2.0 + 1.0 / 3.0)
    expected = stretch if stretches else 0.0
    assert run.values == pytest.approx(expected, abs=1e-6 * stretch + 1e-14)
