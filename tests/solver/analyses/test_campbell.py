"""Campbell diagrams: modes followed over a parameter, and critical speeds."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import sidtool
from sidtool.cli.main import run
from tests.codes import codes, only, unwrapped

from .state_space_scenes import pendulum

#: A disc at the end of a massless shaft, which a hub turns (Stodola and Green): mass
#: [kg], inertia across and along the axis [kg m^2], bending stiffness and length of the
#: shaft.
MASS, ACROSS, ALONG = 10.0, 0.06, 0.1
EI, LENGTH = 1.2e4, 0.6
K11, K12, K22 = 12 * EI / LENGTH**3, -6 * EI / LENGTH**2, 4 * EI / LENGTH


def overhung(speed: float = 0.0) -> sidtool.Scene:
    spin = {"initial": {"angular_velocity": [0.0, 0.0, "speed"]}}
    K = np.diag([K11, K11, 1e9, K22, K22, 1e6])
    K[0, 4] = K[4, 0] = K12
    K[1, 3] = K[3, 1] = -K12
    shaft: dict[str, Any] = {"type": "bushing", "markers": ["hub", "disc"]}
    shaft |= {"stiffness": K.tolist(), "damping": [0.0] * 6}
    return sidtool.Scene(
        dimension="spatial",
        parameters={"speed": speed},
        time={"end": 1.0, "output_step": 0.1},
        bodies={
            "hub": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]} | spin,
            "disc": {"mass": MASS, "inertia": [ACROSS, ACROSS, ALONG]} | spin,
        },
        joints={"axle": {"type": "revolute", "markers": ["ground", "hub"]}},
        drives={
            "motor": {
                "joint": "axle",
                "of": "rate",
                "function": {"type": "constant", "value": "speed"},
            }
        },
        forces={"shaft": shaft},
    )


def whirl_frequencies(speed: float) -> np.ndarray:
    """Roots of (K11 - m w^2) (K22 - A w^2 + C W w) = K12^2, backward whirl negative."""
    product = np.polymul([-MASS, 0.0, K11], [-ACROSS, ALONG * speed, K22])
    return np.sort(np.roots(np.polysub(product, [K12**2])).real)


def critical(order: float, direction: int) -> list[float]:
    """Speeds W at which the roots above are order W, forward or backward."""
    gyroscopic = direction * ALONG * order - ACROSS * order**2
    product = np.polymul([-MASS * order**2, K11], [gyroscopic, K22])
    squares = np.roots(np.polysub(product, [K12**2]))
    return [math.sqrt(x) for x in squares.real if x > 0.0]


def test_whirl_and_critical_speeds_of_an_overhung_rotor() -> None:
    """Roots at all speeds, by continuous branches; critical speeds of two orders."""
    speeds = np.linspace(0.0, 900.0, 5)
    found = sidtool.campbell(
        overhung(), {"parameters.speed": speeds}, orders=(1.0, 2.0)
    )
    assert_allclose(found.speeds, speeds)
    omega = 2.0 * np.pi * found.inertial_frequencies
    sign = np.where(found.whirl == "backward", -1.0, 1.0)
    for n, speed in enumerate(speeds):
        whirls = found.whirl[n] != ""
        expected = whirl_frequencies(speed)
        if speed:
            assert_allclose(np.sort((sign * omega)[n, whirls]), expected, rtol=1e-8)
        else:
            assert_allclose(np.sort(omega[n])[:4], np.sort(np.abs(expected)), rtol=1e-8)
    for k in np.flatnonzero((found.whirl[1:] != "").all(axis=0)):
        assert len({*found.whirl[1:, k]}) == 1
        assert np.all(np.diff(omega[1:, k]) * sign[1, k] > 0.0)
    for order in (1.0, 2.0):
        for direction, name in ((1, "forward"), (-1, "backward")):
            own = [
                each.speed
                for each in found.critical_speeds
                if each.order == order and each.whirl == name
            ]
            expected = [x for x in critical(order, direction) if x < speeds[-1]]
            assert_allclose(sorted(own), sorted(expected), rtol=1e-8)
    assert codes(found) == []


@pytest.mark.parametrize("speed", [60.0, 420.0])
def test_an_unbalance_bends_the_rotor_as_its_closed_form_says(speed: float) -> None:
    """Below and above the critical speed, per unbalance: (K11 - m W^2) r + K12 a = W^2
    and K12 r + (K22 + (C - A) W^2) a = 0, stiffened by the gyroscopic moment."""
    data = overhung(speed).file_data()
    for name, force in (("fx", [1.0, 0.0, 0.0]), ("fy", [0.0, 1.0, 0.0])):
        data["forces"][name] = {
            "type": "force",
            "marker": "disc",
            "force": force,
            "function": {"type": "input", "name": name},
        }
    data["inputs"] = {"fx": {"unit": "N"}, "fy": {"unit": "N"}}
    outputs = ["disc.x", "disc.y", "disc.rotation_x", "disc.rotation_y"]
    space = sidtool.Scene.checked(data, "rotor").state_space(
        outputs=outputs, about="start"
    )
    hertz = [speed / (2.0 * math.pi)]
    found = space.response(hertz, "fx - 1j*fy", unbalance=True).values[0]
    K = [
        [K11 - MASS * speed**2, K12],
        [K12, K22 + (ALONG - ACROSS) * speed**2],
    ]
    r, angle = np.linalg.solve(K, [speed**2, 0.0])
    expected = [r, -1j * r, 1j * angle, angle]
    assert_allclose(found, expected, rtol=1e-8, atol=1e-10)


#: Rigid rotor: mass [kg], inertia along and across [kg m^2], bearings from its centre
#: [m]; their stiffness [N/m] and damping [N s/m], yy, yz, zy, zz, at both speeds.
BODY, POLAR, DIAMETRAL, BEARINGS = 30.0, 0.4, 1.0, (-0.3, 0.5)
RANGE = (60.0, 600.0)
STIFFNESS = np.array([[2.0, 2.2], [2.5, 0.5], [-1.9, -2.3], [1.2, 0.7]]) * 1e6
DAMPING = np.array([[16.0, 31.0], [4.0, 1.0], [3.0, 4.0], [17.0, 24.0]]) * 1e3


def on_films(speed: float) -> sidtool.Scene:
    names = ("yy", "yz", "zy", "zz")
    tables = {
        f"{letter}{name}": {"x": RANGE, "values": row.tolist()}
        for letter, rows in (("k", STIFFNESS), ("c", DAMPING))
        for name, row in zip(names, rows, strict=True)
    }

    def matrix(letter: str) -> list[list[Any]]:
        rows: list[list[Any]] = [[0.0] * 6 for _ in range(6)]
        for n, name in enumerate(names):
            rows[1 + n // 2][1 + n % 2] = f"lookup({letter}{name}, speed)"
        return rows

    films = {"stiffness": matrix("k"), "damping": matrix("c"), "shaft": "x"}
    markers = {
        n: {"position": [x, 0.0, 0.0]} for n, x in zip("ab", BEARINGS, strict=True)
    }
    return sidtool.Scene(
        dimension="spatial",
        parameters={"speed": speed},
        time={"end": 1.0, "output_step": 0.1},
        tables=tables,
        ground={"markers": markers},
        bodies={
            "rotor": {
                "mass": BODY,
                "inertia": [POLAR, DIAMETRAL, DIAMETRAL],
                "markers": markers,
                "initial": {"angular_velocity": ["speed", 0.0, 0.0]},
            }
        },
        joints={
            "thrust": {
                "type": "point_on_plane",
                "markers": ["ground", "rotor"],
                "axis": [1.0, 0.0, 0.0],
            }
        },
        forces={
            n: {"type": "bushing", "markers": [f"ground.{n}", f"rotor.{n}"]} | films
            for n in "ab"
        },
    )


def film_frequencies(speed: float) -> np.ndarray:
    """Angular frequencies, ascending, of y, z and rotations about y and z."""
    K, C = (
        np.array([np.interp(speed, RANGE, row) for row in rows]).reshape(2, 2)
        for rows in (STIFFNESS, DAMPING)
    )
    # A film moves by y + x tz, z - x ty.
    ways = [np.array([[1, 0, 0, x], [0, 1, -x, 0]]) for x in BEARINGS]
    stiffness, damping = (sum(w.T @ m @ w for w in ways) for m in (K, C))
    damping[2, 3] += POLAR * speed
    damping[3, 2] -= POLAR * speed
    inverse = np.diag(1.0 / np.array([BODY, BODY, DIAMETRAL, DIAMETRAL]))
    A = np.block(
        [[np.zeros((4, 4)), np.eye(4)], [-inverse @ stiffness, -inverse @ damping]]
    )
    return np.sort(np.linalg.eigvals(A).imag)


def test_critical_speeds_between_two_values_far_apart() -> None:
    """Modes on films change much between them: shapes alone do not determine which of
    them crosses the speed. Found are all crossings of frequencies of 4 x 4 matrices."""
    speeds = np.linspace(*RANGE, 541)
    gaps = np.array([film_frequencies(w) - w for w in speeds])
    expected = [
        brentq(lambda w, k=k: film_frequencies(w)[k] - w, *speeds[n : n + 2])
        for n, k in np.argwhere(gaps[:-1] * gaps[1:] < 0.0)
    ]
    assert len(expected) >= 2
    found = sidtool.campbell(on_films(60.0), {"parameters.speed": RANGE})
    speeds = np.sort([each.speed for each in found.critical_speeds])
    assert_allclose(speeds, np.sort(expected), rtol=1e-6)


def masses_on_springs(
    stiffness: Sequence[Any], coupling: Any, k: float
) -> sidtool.Scene:
    """Bodies of 1 kg that move along x on springs, neighbours coupled."""
    names = [f"b{i}" for i in range(len(stiffness))]
    pairs = [
        ("ground", name, value) for name, value in zip(names, stiffness, strict=True)
    ]
    pairs += [(*pair, coupling) for pair in zip(names, names[1:], strict=False)]
    return sidtool.Scene(
        dimension="planar",
        parameters={"k": k},
        time={"end": 1.0, "output_step": 0.1},
        bodies={name: {"mass": 1.0, "inertia": 1.0} for name in names},
        joints={
            f"j{name}": {"type": "prismatic", "markers": ["ground", name]}
            for name in names
        },
        forces={
            f"s{i}": {
                "type": "bushing",
                "markers": [a, b],
                "stiffness": [value, 0.0, 0.0],
                "damping": [0.0] * 3,
            }
            for i, (a, b, value) in enumerate(pairs)
        },
    )


def test_modes_whose_frequencies_cross_are_followed() -> None:
    scene = masses_on_springs(["k", 200.0], 0.0, 100.0)
    k = np.linspace(100.0, 400.0, 7)
    found = sidtool.campbell(scene, {"parameters.k": k}, about="static")
    expected = np.column_stack([np.sqrt(k), np.full(7, math.sqrt(200.0))])
    assert_allclose(2.0 * np.pi * found.inertial_frequencies, expected, rtol=1e-9)
    assert_allclose(found.agreement, 1.0)
    assert found.critical_speeds == ()
    assert list(found.to_dataframe().columns) == ["mode 1", "mode 2"]


def test_a_bearing_follows_a_table_of_the_parameter() -> None:
    data = masses_on_springs(["k"], 0.0, 1.0).file_data()
    data["forces"]["s0"]["stiffness"] = ["lookup(mount, k)", 0.0, 0.0]
    data["tables"] = {"mount": {"x": [0.0, 4.0], "values": [100.0, 300.0]}}
    scene = sidtool.Scene.checked(data, "test")
    found = sidtool.campbell(scene, "parameters.k=1:3:3", about="static")
    expected = np.sqrt([[150.0], [200.0], [250.0]])
    assert_allclose(2.0 * np.pi * found.inertial_frequencies, expected, rtol=1e-9)


def test_modes_that_mix_between_values_are_noted() -> None:
    """Three masses apart, and a chain, whose first mode has a third of each."""
    scene = masses_on_springs([99.0, 100.0, 101.0], "k", 1e-9)
    found = sidtool.campbell(scene, {"parameters.k": [1e-9, 1e6]}, about="static")
    data = only(found, "N724").data
    assert data["agreement"] == pytest.approx(1 / 3, rel=1e-4)
    fine = {"parameters.k": np.concatenate([[1e-9], np.geomspace(0.1, 1e6, 12)])}
    assert codes(sidtool.campbell(scene, fine, about="static")) == []


def test_a_value_without_modes_is_named() -> None:
    scene = masses_on_springs(["k"], 0.0, 1.0).with_({"gravity": [9.81, 0.0]})
    with pytest.raises(sidtool.SimulationError) as error:
        sidtool.campbell(scene, {"parameters.k": [0.0, 100.0]}, about="static")
    assert error.value.code == "N729"
    assert error.value.data["value"] == 0.0


@pytest.mark.parametrize(
    ("over", "place"),
    [
        ("parameters.k=1:2", "--over"),
        ("parameters.k=3", "--over"),
        ({"parameters.k": [1.0, 2.0], "time.end": [1.0, 2.0]}, "--over"),
        ({"parameters.k": [1.0, "a"]}, "--over"),
        ({"parameters.none": [1.0, 2.0]}, "parameters"),
    ],
)
def test_a_key_that_cannot_be_varied_is_refused(over: Any, place: str) -> None:
    with pytest.raises(sidtool.InputError) as error:
        sidtool.campbell(masses_on_springs(["k"], 0.0, 1.0), over)
    assert place in str(error.value.place)


def test_the_command_writes_tables_data_and_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    overhung().save(tmp_path / "rotor.toml")
    words = ["analyse", "modes", str(tmp_path / "rotor.toml"), "--about", "start"]
    words += ["--over", "parameters.speed=100:200:3"]
    assert run([*words, "-o", str(tmp_path / "c.json")]) == 0
    assert f"{critical(1.0, 1)[0]:.6g}" in capsys.readouterr().out
    data = json.loads((tmp_path / "c.json").read_text(encoding="utf-8"))
    first = data["modes"][0]["inertial_frequency"]
    found = sidtool.campbell(tmp_path / "rotor.toml", "parameters.speed=100:200:2")
    for name in ("c.csv", "c.png"):
        found.save(tmp_path / name)
    rows = (tmp_path / "c.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].startswith("parameters.speed,speed [rad/s],mode1.inertial")
    assert [float(row.split(",")[2]) for row in rows[1:]] == [first[0], first[-1]]
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    assert run([*words, "--orders", "1,x"]) == 2
    assert "--orders" in unwrapped(capsys.readouterr().err)


def test_a_scene_without_rotation_has_no_critical_speeds() -> None:
    found = sidtool.campbell(pendulum(), "bodies.arm.mass=1:2:3", about="static")
    assert found.critical_speeds == () and not found.speeds.any()
