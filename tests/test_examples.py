"""Every example runs by its own commands, and moves as mechanics says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid
from scipy.interpolate import BSpline
from scipy.linalg import eigh
from scipy.optimize import brentq

import sidtool
from sidtool.pipeline.examples import EXAMPLE_TITLES
from sidtool.pipeline.files import kind_of
from tests.places import EXAMPLES

from .codes import only
from .commands import blocks
from .example_runs import IN_OTHER_FILE, check_files, result_of

FOLDERS = sorted(path.name for path in EXAMPLES.iterdir() if path.is_dir())
FILES = sorted(EXAMPLES.glob("*/*.toml")) + sorted(EXAMPLES.glob("*/rod_*.SID_FEM"))


@pytest.mark.parametrize("name", sorted(set(FOLDERS) - set(IN_OTHER_FILE)))
def test_the_commands_run_and_leave_no_tracked_file_changed(ran, name: str) -> None:
    check_files(ran(name))


@pytest.mark.parametrize("name", FOLDERS)
def test_every_folder_explains_itself(name: str) -> None:
    """A sketch or an equation, then numbered steps with commands."""
    text = (EXAMPLES / name / "README.md").read_text(encoding="utf-8")
    languages = [language for language, _, _ in blocks(text)]
    assert languages[0] == "" and languages[1:].count("sh") >= 2
    assert all(f"\n{step}. " in text for step in range(1, languages.count("sh") + 1))
    assert f"({name})" in (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert name in EXAMPLE_TITLES or name == "rod_in_space"


@pytest.mark.parametrize(
    "path", [path for path in FILES if kind_of(path) == "model"], ids=lambda p: p.stem
)
def test_models_convert_to_sids_without_errors(ran, path: Path) -> None:
    """A beam has rotary inertia in Me and not in Oe, of which I12 warns."""
    folder = ran(path.parent.name)
    names = (folder / f"{path.stem}{ending}" for ending in (".SID_FEM", ".h5"))
    created = next((name for name in names if name.exists()), None)
    sid = created or sidtool.convert(path)
    failed = {c.id for c in sidtool.validate(sid) if c.failed}
    of_beam = sidtool.Model.load(path).discretisation.type == "beam"
    assert failed <= ({"I12"} if of_beam else set())


def test_the_bar_deflects_and_vibrates_by_beam_theory(ran) -> None:
    result = result_of(ran("beam"))
    EI, line, L = 2.1e11 * 0.02 * 0.01**3 / 12, 7850 * 0.02 * 0.01, 1.0
    sag = line * 9.81 * L**4 / (8 * EI)
    y = result["bar.tip.y"]
    assert y.min() == pytest.approx(-2 * sag, rel=0.03)  # damped, of several modes
    assert y.mean() == pytest.approx(-sag, rel=0.02)
    first = (1.8751041 / L) ** 2 * np.sqrt(EI / line) / (2 * np.pi)
    at = result.t[np.flatnonzero((y[1:-1] < y[:-2]) & (y[1:-1] < y[2:])) + 1]
    assert np.diff(at).mean() == pytest.approx(1 / first, rel=0.01)


def test_the_blade_lags_as_the_exact_beam_does(ran) -> None:
    """-0.5737868 m of a geometrically exact beam; SIDs have an error of 0.1 % (three
    modes).
    """
    folder = ran("spinning_blade")
    result = result_of(folder)
    assert result["blade.tip.uy"].min() == pytest.approx(-0.574443, rel=2e-4)
    plain = np.loadtxt(folder / "plain.csv", delimiter=",", skiprows=1)
    assert np.abs(plain).max() > 1e9


def test_the_steady_blade_has_the_frequency_of_a_rotating_beam(ran) -> None:
    """Lead-lag at the speed parameter 6: 4.263225 (spectral method), 3.516015 at rest;
    three fixed shapes are 0.1 to 0.2 % too stiff."""
    scene = ran("spinning_blade") / "steady.toml"
    modes = sidtool.linearise(scene, about="start").frequencies.min()
    unit = np.sqrt(1.4e4 / (1.2 * 10.0**4)) / (2 * np.pi)
    assert 1.0 < modes / (4.263225 * unit) < 1.002


def test_the_turbine_carries_its_weight_and_the_centrifugal_force(ran) -> None:
    """Masses and centre of mass of the tables; 12.1 rpm."""
    result = result_of(ran("wind_turbine"))
    blade = 17608.83
    weight = 9.81 * (347460.2 + 240000.0 + 56780.0 + 3 * blade)
    assert result["foundation.fz"].mean() == pytest.approx(weight, rel=1e-4)
    angle = result["shaft.angle"]
    along = np.cos(angle) * result["root1.fz"] - np.sin(angle) * result["root1.fy"]
    pull = blade * 1.2671**2 * (1.5 + 20.521)
    assert -along.mean() == pytest.approx(pull, rel=5e-3)
    assert np.ptp(along) / 2 == pytest.approx(9.81 * blade, rel=0.01)
    base = np.stack([result[f"tower.s1.{q}"] for q in ("N", "Vy", "Vz", "My", "Mz")])
    joint = [result[f"foundation.{q}"] for q in ("fz", "fx", "fy", "mx", "my")]
    size = np.abs(joint).max(axis=1)[:, None]
    assert (np.abs(base + joint) < 1e-9 * size).all()


def test_the_satellite_keeps_its_momenta_and_turns_as_far_as_a_rigid_one(ran) -> None:
    result = result_of(ran("satellite"))
    for axis in "xyz":
        assert np.abs(result[f"angular_momentum.{axis}"]).max() < 1e-7
    inertia = 80.0 + 2 * (10.0002 + 2 * 4.8 * 0.6 * 1.25 + 4.8 * 0.6**2)
    after = result["hub.rotation_y"][result.t > 10.0]
    assert after.mean() == pytest.approx(4.0 * 5.0**2 / inertia, rel=2e-3)
    assert np.ptp(result["right.end.uz"][result.t > 10.0]) > 1e-5  # still swinging


def test_the_rocker_turns_back_where_crank_and_coupler_are_in_line(ran) -> None:
    result = result_of(ran("four_bar"))
    rigid = sidtool.read(ran("four_bar") / "rigid.h5")
    dead = [
        np.arccos((D**2 - 0.4**2 - 0.25**2) / (2 * 0.4 * 0.25)) for D in (0.25, 0.45)
    ]
    angle = result["rocker_bearing.angle"]
    assert angle.max() == pytest.approx(dead[0], abs=1e-4)
    assert angle.min() == pytest.approx(dead[1], abs=1e-4)
    times = [event.t for event in result.events if event.name == "dead_position"]
    others = [event.t for event in rigid.events if event.name == "dead_position"]
    assert len(times) == 6 and np.allclose(times, others, atol=1e-8)
    assert result.t[-1] == pytest.approx(0.25 + 6 * np.pi / 20, abs=1e-9)
    assert 1e-5 < np.abs(result["coupler.middle.uy"]).max() < 1e-3


def test_the_geared_shafts_twist_as_three_inertias_on_two_springs(ran) -> None:
    """Linear twist between the ends of the shafts, all seen from the motor."""
    scene = ran("gear_train") / "scene.toml"
    polar = np.pi * 0.016**4 / 32
    k, J = 2.1e11 / 2.6 * polar / 0.4, 7850 * polar * 0.4
    ends = np.array([[1 / 3, 1 / 6], [1 / 6, 1 / 3]]) * J
    M, K = np.diag([0.002, 1e-4 + 0.008 / 9, 0.2 / 9]), np.zeros((3, 3))
    for first, share in ((0, 1.0), (1, 1 / 9)):
        M[first : first + 2, first : first + 2] += share * ends
        K[first : first + 2, first : first + 2] += (
            share * k * np.array([[1, -1], [-1, 1]])
        )
    hertz = np.sqrt(eigh(K, M, eigvals_only=True)[1:]) / (2 * np.pi)
    modes = np.sort(sidtool.linearise(scene).frequencies)
    assert modes[modes > 1.0][:2] == pytest.approx(hertz, rel=1e-6)
    result = result_of(ran("gear_train"))
    mean = 10.0 / M.sum() * (0.2 - 0.0005)
    assert result["motor_bearing.angle_rate"][-1] == pytest.approx(mean, rel=0.2)
    assert np.allclose(
        result["load_bearing.angle"][-1],
        -result["motor_bearing.angle"][-1] / 3,
        rtol=0.02,
    )


def test_the_cam_loads_the_tappet_as_a_rigid_valve_train_does(ran) -> None:
    """Force of the spring and of 0.38 kg, within the vibration of the rocker arm."""
    folder = ran("valve_train")
    result = result_of(folder)
    angle = np.clip(np.abs(150.0 * result.t - 2.0) / np.radians(60.0), 0, 1)
    s = 1 - angle
    lift = 8e-3 * s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)
    bend = 8e-3 * (420 * s**2 - 1680 * s**3 + 2100 * s**4 - 840 * s**5)
    rate = 150.0 / np.radians(60.0)
    rocker = 7850 * 0.014 * 0.012 * 0.075 * (0.075**2 / 12 + 0.0075**2) / 0.03**2
    mass = 0.12 + 1.5**2 * 0.09 + rocker
    rigid = 1.5 * (250.0 + 25000.0 * 1.5 * lift) + mass * bend * rate**2
    force = result["cam.force"]
    assert force[0] == pytest.approx(rigid[0], rel=0.006)
    assert np.sqrt(np.mean((force - rigid) ** 2)) < 0.05 * rigid.max()
    assert force.min() > 0.0
    assert sidtool.read(folder / "flying.h5")["cam.force"].min() == 0.0


def test_the_press_takes_the_work_of_forming_from_its_flywheel(ran) -> None:
    """452 J: a rise over 1 mm and a line over 19 mm; and what the guides rub off."""
    result = result_of(ran("press"))
    lowest = 10.0 + 0.019 * (2e4 + 1e4 * 0.019 / 0.029 / 2)
    first = result.t < 0.4
    assert -result["energy.supplied"][first][-1] == pytest.approx(lowest, rel=2e-3)
    rubbed = trapezoid(np.abs(result["guide.friction"] * result["slide.vy"]), result.t)
    assert result["energy.dissipated"][-1] == pytest.approx(rubbed, rel=0.02)
    balance = result["energy.balance"]
    assert np.ptp(balance) < 1e-6 * balance[0]
    turns = [event.t for event in result.events if event.kind == "slip"]
    speeds = np.interp(turns, result.t, result["slide.vy"])
    assert len(turns) == 2 and np.abs(speeds).max() < 7e-3


def test_the_feed_axis_follows_and_gives_way_as_its_stiffnesses_say(ran) -> None:
    """Following error v / Kp; stretch, twist and controller under the cutting force."""
    result = result_of(ran("feed_axis"))
    t, x = result.t, result["table.x"] - 0.6
    behind = 0.2 * 0.49 - np.interp(0.49, t, x)
    assert behind == pytest.approx(0.2 / 40, rel=1e-6)
    area, polar, E = np.pi * 0.032**2 / 4, np.pi * 0.032**4 / 32, 2.1e11
    lead = 0.01 / (2 * np.pi)
    flexibility = 0.6 / (E * area) + lead**2 * (0.6 / (E / 2.6 * polar) + 1 / 320)
    assert np.interp(0.89, t, x) - x[-1] == pytest.approx(2000 * flexibility, rel=1e-4)
    assert result["controller.torque"][-1] == pytest.approx(2000 * lead, rel=1e-5)


def test_the_rotor_runs_up_as_jeffcotts(ran) -> None:
    """A mass on two springs that turns; 17/35 of the shaft go with the disc."""
    result = result_of(ran("run_up"))
    m, e, c = 10.0, 1e-4, 60.0
    shaft, stiffness = (
        7850 * np.pi * 1e-4 * 0.6,
        48 * 2.1e11 * np.pi / 4 * 1e-8 / 0.6**3,
    )
    M, J = m + 17 / 35 * shaft, 0.05 + shaft * 1e-4 / 2

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        y, z, angle, vy, vz, w = state
        cos, sin = m * e * np.cos(angle), m * e * np.sin(angle)
        mass = np.array([[M, 0, -sin], [0, M, cos], [-sin, cos, J + m * e**2]])
        force = [
            cos * w**2 - stiffness * y - c * vy,
            sin * w**2 - stiffness * z - c * vz,
            4,
        ]
        return np.array([vy, vz, w, *np.linalg.solve(mass, force)])

    way = solve_ivp(
        rates, (0, 3), np.zeros(6), "DOP853", result.t, rtol=1e-8, atol=1e-11
    ).y
    whirl = np.hypot(result["disc.y"], result["disc.z"])
    expected = np.hypot(way[0], way[1])
    assert whirl.max() == pytest.approx(expected.max(), rel=0.005)
    assert result.t[whirl.argmax()] == pytest.approx(
        result.t[expected.argmax()], abs=0.01
    )
    assert result["disc.wx"][-1] == pytest.approx(way[5, -1], rel=1e-4)


def test_the_load_of_a_rigid_crane_is_a_spherical_pendulum(ran) -> None:
    """d.(a - support) + v.v = 0 with a = g + s d; shaping leaves less than half."""
    folder = ran("slewing_crane")

    def support(t: float) -> np.ndarray:
        s = min(t / 10, 1.0)
        angle = np.pi / 2 * s**3 * (10 - 15 * s + 6 * s**2)
        rate = np.pi / 2 * (30 * s**2 - 60 * s**3 + 30 * s**4) / 10
        gain = np.pi / 2 * (60 * s - 180 * s**2 + 120 * s**3) / 100
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        on = np.array([-np.sin(angle), np.cos(angle), 0.0])
        rest = np.array([0.0, 0.0, 15.0])
        return np.stack(
            [20 * out + rest, 20 * rate * on, 20 * (gain * on - rate**2 * out)]
        )

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        place, speed, gain = support(t)
        d, v, g = state[:3] - place, state[3:] - speed, np.array([0.0, 0.0, -9.81])
        return np.concatenate([state[3:], g - (v @ v + d @ (g - gain)) / (d @ d) * d])

    rigid = sidtool.read(folder / "rigid.h5")
    start = [20.0, 0.0, 9.0, 0.0, 0.0, 0.0]
    way = solve_ivp(rates, (0, 25), start, "DOP853", rigid.t, rtol=1e-9, atol=1e-9).y
    found = np.stack([rigid[f"load.{axis}"] for axis in "xyz"])
    assert np.abs(found - way[:3]).max() < 1e-5
    swing = {}
    for name in ("result", "shaped", "rigid"):
        run = sidtool.read(folder / f"{name}.h5")
        distance = [run[f"load.{axis}"] - run[f"jib.tip.{axis}"] for axis in "xy"]
        swing[name] = np.hypot(*distance)[run.t > 14.0].max()
    assert swing["result"] == pytest.approx(swing["rigid"], rel=0.05)
    assert swing["shaped"] < 0.4 * swing["result"]


def test_the_axle_carries_the_van_and_bends_between_its_springs(ran) -> None:
    result = result_of(ran("vehicle_axle"))
    area = np.pi / 4 * (0.07**2 - 0.058**2)
    line, inertia = 7850 * area * 9.81, np.pi / 64 * (0.07**4 - 0.058**4)
    weight = 750.0 * 9.81 + 1.6 * line
    assert result["left_tyre.fy"][0] == pytest.approx(weight / 2, rel=1e-3)
    wheel = weight / 2 - 25.0 * 9.81
    at_spring = 0.3 * wheel - line * 0.3**2 / 2
    middle = 0.8 * wheel - line * 0.8**2 / 2 - 0.5 * 700.0 * 9.81 / 2
    peak = max(at_spring, middle) * 0.035 / inertia
    assert result["axle.peak_von_mises"][0] == pytest.approx(peak, rel=0.005)
    assert result["left_tyre.fy"].min() == 0.0 < result["right_tyre.fy"].min()


def test_the_mast_answers_the_wind_as_den_hartogs_damper(ran) -> None:
    """Both peaks are sqrt(1 + 2 / mu) static deflections; the mast has more modes."""
    folder = ran("tuned_damper")
    inertia = np.pi / 64 * (0.2**4 - 0.188**4)
    height = np.sqrt(1 + 2 / 0.05) / (3 * 2.1e11 * inertia / 12.0**3)
    table = np.loadtxt(folder / "response.csv", delimiter=",", skiprows=1)
    low = table[table[:, 0] < 2.0]
    size = low[:, 1]
    peaks = size[1:-1][(size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])]
    assert peaks == pytest.approx([height, height], rel=0.02)
    bare, damped = (
        sidtool.read(folder / f"{n}.h5")["head.x"] for n in ("bare", "result")
    )
    assert np.abs(damped[-200:]).max() < 0.05 * np.abs(bare[-200:]).max()


def test_the_platform_of_the_delta_robot_is_where_three_spheres_meet(ran) -> None:
    folder = ran("delta_robot")
    rigid, result = sidtool.read(folder / "rigid.h5"), result_of(folder)
    out = np.radians([0.0, 120.0, 240.0])
    for k in range(0, len(rigid.t), 100):
        angle = np.array([rigid[f"motor{i}.angle"][k] for i in (1, 2, 3)])
        reach = 0.2 - 0.05 + 0.3 * np.cos(angle)
        centres = np.column_stack(
            [reach * np.cos(out), reach * np.sin(out), -0.3 * np.sin(angle)]
        )
        place = np.array([rigid[f"platform.{axis}"][k] for axis in "xyz"])
        distances = np.linalg.norm(place - centres, axis=1)
        assert distances == pytest.approx(0.8, abs=1e-8)  # digits of the scene
        assert place[2] < centres[:, 2].min()
    for axis in "xyz":
        assert np.abs(rigid[f"platform.rotation_{axis}"]).max() < 1e-8
        difference = np.abs(result[f"platform.{axis}"] - rigid[f"platform.{axis}"])
        assert difference.max() < 2e-3
    assert 1e-4 < np.abs(result["arm1.elbow.uz"]).max() < 1e-3


def test_the_scara_sags_as_a_tapering_beam_and_follows_as_two_rods(ran) -> None:
    """Timoshenko's cantilever under the tool and its own weight; both links as rigid
    rods with a PD controller at each joint, of which the rate passes a lag."""
    folder = ran("scara")
    result, rigid = result_of(folder), sidtool.read(folder / "rigid.h5")
    L, b, density, E, g, part = 0.25, 0.04, 2700.0, 7e10, 9.81, 2.0
    x = np.linspace(0.0, L, 4001)
    h = 0.02 - 0.01 * x / L
    line = density * b * h
    beyond = np.array([trapezoid(line[k:], x[k:]) for k in range(0, len(x), 20)])
    beyond_x = [trapezoid((line * x)[k:], x[k:]) for k in range(0, len(x), 20)]
    x, h, line = x[::20], h[::20], line[::20]
    shear = g * (part + beyond)
    moment = g * (part * (L - x) + np.array(beyond_x) - beyond * x)
    bending = moment * (L - x) / (E * b * h**3 / 12)
    sag = trapezoid(bending + shear / (5 / 6 * E / 2.66 * b * h), x)
    assert result["link.tool.uz"][0] == pytest.approx(-sag, rel=0.03)  # a wide beam

    mass, centre = beyond[0], beyond_x[0] / beyond[0]
    about_elbow = trapezoid(line * (x**2 + b**2 / 12), x) + part * L**2 + 0.001
    first = mass * centre + part * L
    arm = 0.09 + 7.0 * 0.19**2 + (mass + part) * 0.3**2
    p, d, lag = np.array([4000.0, 1000.0]), np.array([120.0, 30.0]), 0.0005
    ends = np.array([0.9, -1.4])

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        q, w, past = state[:2], state[2:4], state[4:]
        s = min(t / 0.4, 1.0)
        error = ends * s**3 * (10.0 - 15.0 * s + 6.0 * s**2) - q
        torque = p * error + d * (error - past) / lag
        c, sine = np.cos(q[1]), 0.3 * first * np.sin(q[1])
        both = about_elbow + 0.3 * first * c
        M = np.array([[arm + 2 * both - about_elbow, both], [both, about_elbow]])
        force = [sine * w[1] * (2 * w[0] + w[1]), -sine * w[0] ** 2]
        return np.concatenate(
            [w, np.linalg.solve(M, torque + force), (error - past) / lag]
        )

    options = {"method": "Radau", "rtol": 1e-9, "atol": 1e-11, "t_eval": rigid.t}
    states = solve_ivp(rates, (0.0, rigid.t[-1]), np.zeros(6), **options).y
    for k, joint in enumerate(("shoulder", "elbow")):
        assert rigid[f"{joint}.angle"] == pytest.approx(states[k], abs=2e-6)


def test_the_journal_has_the_load_of_ocvirk_and_whirls(ran) -> None:
    """Load and attitude of the short bearing; eigenvalues and motions of four equations
    in polar coordinates of the journal."""
    folder = ran("journal_bearing")
    c, disc, journal, k, d, g = 1e-4, 20.0, 2.0, 1e7, 100.0, 9.81
    film = 0.02 * 0.025 * 0.025**3 / (2 * c**2)

    def rates(state: np.ndarray, speed: float) -> np.ndarray:
        place, velocity = state[:4].reshape(2, 2), state[4:].reshape(2, 2)
        x, v = (a[0] + 1j * a[1] for a in (place[1], velocity[1]))
        e, along = abs(x) / c, x / abs(x)
        growth, wedge = (v / along).real / c, speed - 2 * (v / x).imag
        radial = -2 * e**2 * abs(wedge) / (1 - e**2) ** 2
        radial -= np.pi * growth * (1 + 2 * e**2) / (1 - e**2) ** 2.5
        across = np.pi * e * wedge / (2 * (1 - e**2) ** 1.5)
        across += 4 * e * growth / (1 - e**2) ** 2
        push = film * (radial + 1j * across) * along
        shaft = k * (place[1] - place[0]) + d * (velocity[1] - velocity[0])
        weight = np.array([0.0, -g])
        bent = (
            shaft / disc + weight,
            ([push.real, push.imag] - shaft) / journal + weight,
        )
        return np.concatenate([state[4:], *bent])

    def rest(speed: float) -> np.ndarray:
        def excess(e: float) -> float:
            force = np.sqrt(16 * e**2 + np.pi**2 * (1 - e**2)) * e / (1 - e**2) ** 2
            return film * speed / 2 * force - (disc + journal) * g

        e = brentq(excess, 1e-6, 0.99, xtol=1e-15)
        attitude = np.arctan2(np.pi * np.sqrt(1 - e**2), 4 * e)
        x, y = c * e * np.sin(attitude), -c * e * np.cos(attitude)
        return np.array([x, y - disc * g / k, x, y, 0, 0, 0, 0])

    table = np.genfromtxt(folder / "modes.csv", delimiter=",", names=True)
    for row in table[:: len(table) - 1]:
        at, steps = rest(row["parametersspeed"]), np.repeat([1e-9, 1e-6], 4)
        ends = [
            [rates(at + h * step, row["parametersspeed"]) for h in (1, -1)]
            for step in np.diag(steps)
        ]
        matrix = np.array(
            [(a - b) / (2 * h) for (a, b), h in zip(ends, steps, strict=True)]
        ).T
        values = np.linalg.eigvals(matrix)
        least = min(values[values.imag > 1.0], key=lambda s: abs(s.imag))
        frequency = row["mode1inertial_frequency_Hz"]
        assert frequency == pytest.approx(least.imag / (2 * np.pi), rel=1e-5)
        ratio = -least.real / abs(least)
        assert row["mode1damping_ratio"] == pytest.approx(ratio, rel=1e-5)
    assert table["mode1damping_ratio"][0] > 0.0 > table["mode1damping_ratio"][-1]
    speeds = [100.0, 600.0, 800.0, 900.0]
    diagram = sidtool.campbell(folder / "scene.toml", {"parameters.speed": speeds})
    growing = only(diagram, "N714")
    assert growing.subject == "mode 1, parameters.speed = 800 to 900"
    assert growing.data["rate"] == pytest.approx(least.real, rel=1e-4)

    for name, speed in (("result", 300.0), ("whirl", 800.0)):
        result = sidtool.read(folder / f"{name}.h5")
        start = rest(speed) + np.eye(8)[4] * 1e-3
        times = result.t[result.t <= 0.05]
        states = solve_ivp(
            lambda t, y, speed=speed: rates(y, speed),
            (0.0, 0.05),
            start,
            t_eval=times,
            method="Radau",
            rtol=1e-9,
            atol=1e-13,
        ).y
        outputs = ("disc.x", "disc.y", "journal.x", "journal.y")
        for output, found in zip(outputs, states[:4], strict=True):
            assert result[output][: len(times)] == pytest.approx(found, abs=1e-5 * c)
    x = result["journal.x"] + 1j * result["journal.y"]
    turns = np.diff(np.unwrap(np.angle(x[-400:]))).sum() / (2 * np.pi)
    assert turns / (result.t[-1] - result.t[-400]) == pytest.approx(65.0, abs=2.0)


def test_the_motor_torque_balances_gravity(ran) -> None:
    result = result_of(ran("controlled_arm"))
    assert result["shoulder.angle"][-1] == pytest.approx(0.8, abs=3e-3)
    arm = 2700 * 2.24e-4
    torque = 9.81 * (2.0 + 0.5 + arm / 2) * np.cos(0.8)
    assert result["motor.value"][-1] == pytest.approx(torque, rel=0.01)
    assert np.abs(result["motor.value"]).max() <= 60.0
    sampled = np.loadtxt(
        ran("controlled_arm") / "sampled.csv", delimiter=",", skiprows=1
    )
    same = result["shoulder.angle"][: len(sampled)]
    assert np.abs(sampled[:, 1] - same).max() < 0.02


def test_the_mast_is_that_of_its_matrices(ran) -> None:
    """Statics and the lowest modes of (M, K) held at the foot, without sidtool."""
    folder = ran("imported_matrices")
    arrays = np.load(folder / "mast.npz")
    K, M = (np.zeros((99, 99)) for _ in range(2))
    for matrix, name in ((K, "stiffness"), (M, "mass")):
        rows = arrays[name]
        matrix[rows[:, 0].astype(int), rows[:, 1].astype(int)] = rows[:, 2]
    free = np.arange(9, 99)
    K, M = K[np.ix_(free, free)], M[np.ix_(free, free)]
    hertz = np.sqrt(eigh(K, M, eigvals_only=True)[:2]) / (2 * np.pi)
    sid = sidtool.read(folder / "mast.SID_FEM")
    squares = eigh(sid.Ke.m0, sid.Me.m0, eigvals_only=True)[:2]
    assert np.sqrt(squares) / (2 * np.pi) == pytest.approx(hertz, rel=1e-3)
    push = np.zeros(90)
    push[-8::3] = 200.0 / 3
    settled = np.linalg.solve(K, push)[-8::3].mean()
    result = result_of(folder)
    later = result["antenna.y"][result.t > 0.2]
    assert later.mean() == pytest.approx(settled, rel=0.03)
    assert result["foundation.mz"][result.t > 0.2].mean() == pytest.approx(
        -200.0 * 4.0, rel=0.03
    )


def test_the_piston_pin_carries_gas_less_inertia(ran) -> None:
    """F = p A - m a with the exact acceleration of a rigid crank drive."""
    result = result_of(ran("con_rod"))
    r, rod, speed = 0.04, 0.15, 100 * np.pi
    a = speed * result.t
    root = np.sqrt(rod**2 - r**2 * np.sin(a) ** 2)
    x = r * np.cos(a) + root
    squares = r**4 * np.sin(a) ** 2 * np.cos(a) ** 2
    acceleration = -(speed**2) * (
        r * np.cos(a) + r**2 * np.cos(2 * a) / root + squares / root**3
    )
    gas = 5e-3 * 1e5 * ((0.09 / (0.2 - x)) ** 1.35 - 1)
    force = 0.5 * acceleration + gas
    assert np.abs(result["piston.x"] - x).max() < 2e-5
    found = result["piston_pin.fx"]
    assert np.abs(found - force).max() < 0.03 * np.abs(force).max()
    # The eyes have more than the nominal stress of the narrowest section.
    width = 2 * 0.018 * np.sin(np.radians(42.0))
    nominal = np.abs(force).max() / (width * 0.018)
    assert nominal < result["rod.peak_von_mises"].max() < 8 * nominal
    # At the top dead centre the shank carries the pin's force less its own inertia.
    part = result.sids["rod"].section("shank").part
    centre = part.mdCM.m0[0, 0] / part.mass
    inertia = -part.mass * r * speed**2 * (1 + r / rod * centre / rod)
    shank = -(result["piston_pin.fx"][0] + inertia)
    assert result["rod.shank.N"][0] == pytest.approx(shank, rel=1e-4)
    assert abs(result["rod.shank.Vy"][0]) < 1e-6 * abs(shank)


def test_the_robot_holds_its_weight_and_reaches_its_pose(ran) -> None:
    result = result_of(ran("robot_arm"))
    link = 2700 * 0.8 * (0.05**2 - 0.044**2)
    g = 9.81
    torque = g * (link * 0.4 + link * 1.2 + 5.0 * 1.7)
    assert result["shoulder_motor.my"][0] == pytest.approx(-torque, rel=2e-3)
    EI = 7e10 * (0.05**4 - 0.044**4) / 12
    # The forearm at the start: its own weight, payload and its moment at the flange.
    line, L = link * g / 0.8, 0.8
    sag = line * L**4 / (8 * EI) + 5 * g * L**3 / (3 * EI) + 5 * g * 0.1 * L**2 / 2 / EI
    assert result["forearm.tip.uz"][0] == pytest.approx(-sag, rel=0.03)
    radius = 0.8 * (np.cos(0.8) + np.cos(0.6))
    height = 0.4 + 0.8 * (np.sin(0.8) - np.sin(0.6))
    pose = [radius * np.cos(1.5), radius * np.sin(1.5), height]
    reached = [result[f"payload.{axis}"][-1] for axis in "xyz"]
    assert reached == pytest.approx(pose, abs=5e-3)
    stress = torque * 0.025 / (EI / 7e10)
    assert result["upper.peak_von_mises"][0] == pytest.approx(stress, rel=0.35)


def test_the_founding_example_has_its_known_motion(ran) -> None:
    result = result_of(ran("slider_crank"))
    at = np.searchsorted(result.t, 1.5 - 1e-9)
    assert result["piston.x"][at] == pytest.approx(1.0847993728, abs=1e-8)


def test_the_light_rod_reaches_its_limit_of_stress(ran) -> None:
    """The norm of the stress over output times; the mass by the area of the outline."""
    folder = ran("light_rod")
    found = json.loads((folder / "history.json").read_text(encoding="utf-8"))
    assert found["converged"] and found["is_feasible"]
    result = result_of(folder)
    stress = result["rod.peak_von_mises"]
    norm = (trapezoid(stress**12, result.t) / np.ptp(result.t)) ** (1 / 12)
    assert norm == pytest.approx(50e6, rel=0.02)
    # Control points of a quadratic spline weigh with the integrals of their functions.
    x, y = np.array([0.0, 0.025, 0.075, 0.125, 0.15]), np.array([16, 14, 12, 10, 10])
    y = 1e-3 * y + np.array(
        [0.0, *(found["best"]["x"][n] for n in ("shoulder", "middle")), 0.0, 0.0]
    )
    knots = [0, 0, 0, 1 / 3, 2 / 3, 1, 1, 1]
    u = np.linspace(0.0, 1.0, 2001)
    curve = BSpline(knots, np.column_stack([x, y]), 2)(u)
    area = 2.0 * trapezoid(curve[:, 1], curve[:, 0])
    mass = 7850.0 * found["best"]["x"]["thickness"] * area
    assert found["best"]["values"]["mass(rod)"] == pytest.approx(mass, rel=1e-5)
    assert mass < 0.41 * found["history"][0]["values"][0]


def test_the_arm_settles_in_half_the_time_of_a_uniform_one(ran) -> None:
    """From output times, 5 ms apart; the mass by the integral of the squared side."""
    folder = ran("arm_link")
    found = json.loads((folder / "history.json").read_text(encoding="utf-8"))
    assert found["converged"] and found["is_feasible"]
    objective = "settling_time(link.tip.uz, 2e-4)"
    times = [found["history"][0]["values"][0], found["best"]["values"][objective]]
    for name, expected in zip(("uniform", "result"), times, strict=True):
        result = sidtool.read(folder / f"{name}.h5")
        y = result["link.tip.uz"]
        settled = result.t[np.flatnonzero(np.abs(y - y[-1]) > 2e-4)[-1]]
        assert settled <= expected <= settled + 0.005
    assert times[1] < 0.52 * times[0]
    side = 0.03 + np.array([*found["best"]["x"].values()])
    squares = side[:-1] ** 2 + side[:-1] * side[1:] + side[1:] ** 2
    mass = 2700.0 * 0.6 * squares.sum() / 3.0
    assert found["best"]["values"]["mass(link)"] == pytest.approx(mass, rel=1e-9)


def test_the_crane_carries_its_load_by_its_strut(ran) -> None:
    """At the start moments about the pin at the head, with the weight of boom, strut
    (half of it at the seat) and load."""
    result = result_of(ran("jib_crane"))
    g, load, boom = 9.81, 200.0, 7850.0 * (0.08 * 0.16 - 0.068 * 0.148)
    strut = 7850.0 * np.pi * (0.03**2 - 0.026**2) * 1.5 * np.sqrt(2)
    moment = 3.0 * load + 3.0 * boom * 1.5 + strut / 2 * 1.5
    normal = -g * moment / (1.5 * np.sqrt(0.5))
    assert result["crane.strut.s3.N"][0] == pytest.approx(normal, rel=1e-4)
    bending = g * (1.5 * load + 1.5 * boom * 0.75)
    assert abs(result["crane.outer_boom.s1.My"][0]) == pytest.approx(bending, rel=1e-9)
    assert result["load.y"].max() > 2.9
