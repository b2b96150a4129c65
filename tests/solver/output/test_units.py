"""Units of outputs: of every output of every example, and as they scale.

A scene that is said in other units of length, mass and time has the same motion, and
each of its outputs is multiplied by what its unit says.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from sidtool.formats.scene import SceneFile, read_scene, unit_of
from sidtool.formats.scene.units import FORCES
from sidtool.formats.scene.wildcards import known_outputs
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene, simulate
from sidtool.solver.system.joints import PLANAR, SPATIAL
from tests.places import EXAMPLES

SCENES = sorted(
    path
    for path in EXAMPLES.glob("*/*.toml")
    if "sidtool scene" in path.read_text(encoding="utf-8")
)
#: What stands at the end of names, and the unit; None where the scene decides.
EXPECTED = {
    r"[xyz]": "m",
    r"u[xyz]": "m",
    r"v[xyz]": "m/s",
    r"a[xyz]": "m/s²",
    r"w[xyz]": "rad/s",
    r"angle(_[12])?": "rad",
    r"angle(_[12])?_rate": "rad/s",
    r"displacement|length": "m",
    r"(displacement|length)_rate": "m/s",
    r"f[xyz]": "N",
    r"m[xyz]": "N m",
    r"normal_force": "N",
    r"sticking": "",
    r"quaternion_[0-3]": "",
    r"rotation_[xyz]": "rad",
    r"momentum_[xyz]": "kg m/s",
    r"angular_momentum_[xyz]": "kg m²/s",
    r"energy\.\w+": "J",
    r"constraint\.\w+": "",
    r"momentum\.[xyz]": "kg m/s",
    r"angular_momentum\.[xyz]": "kg m²/s",
    r"force": "N",
    r"torque": "N m",
    r"power": "W",
    r"v?q\d+": "",
    r"sigma_\w\w|von_mises|peak_von_mises|norm_von_mises": "Pa",
    r"N|V[yz]": "N",
    r"T|M[yz]": "N m",
    r"inputs\.wind": "N",
    r"inputs\.(left|right)": "m",
}
#: Of single outputs, as the text of the example says.
SINGLE = {
    "con_rod: gas.value": "",  # times components in N
    "con_rod: main_bearing.f1": "N",
    "con_rod: main_bearing.f2": "N",
    "controlled_arm: motor.value": "N m",
    "controlled_arm: motor.state.integral": "rad s",
    "controlled_arm: motor.state.derivative": "rad/s",
}


def expected(name: str) -> str | None:
    last = name.rpartition(".")[2]
    for pattern in sorted(EXPECTED, key=lambda p: r"\." not in p):
        unit = EXPECTED[pattern]
        if re.fullmatch(pattern, name if r"\." in pattern else last):
            return unit
    return None


@pytest.mark.parametrize("path", SCENES, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_every_output_of_the_examples_has_its_unit(path: Any) -> None:
    scene = read_scene(path)
    names = [*known_outputs(scene, {}), *scene.outputs.record]
    for name in names:
        if "*" in name:
            continue
        found, known = unit_of(name, scene), expected(name)
        if known is None:
            ends = (".value", ".friction", ".deflection", ".rate")
            decided = name.endswith(ends) or re.fullmatch(r".*\.f\d+", name)
            assert decided or ".state." in name
            force = scene.forces.get(name.partition(".")[0])
            scales = name.endswith(".value") and force is not None
            scales = scales and force.type == "force"
            units = (
                ("",) if scales else ("N", "N m", "rad s", "rad/s", "rad", "m", "m/s")
            )
            assert found in units, name
        else:
            assert found == known, name
    for key, unit in SINGLE.items():
        example, _, name = key.partition(": ")
        if example == path.parent.name:
            assert unit_of(name, scene) == unit


#: New units of length, mass and time in old ones: no two products of them are alike.
LENGTH, MASS, TIME = 1e-3, 1e3, 2.0


def number_of(unit: str) -> float:
    """How many new units an old one is."""
    m, kg, s = 1 / LENGTH, 1 / MASS, 1 / TIME
    newton = kg * m / s**2
    base = {
        "m": m,
        "kg": kg,
        "s": s,
        "N": newton,
        "J": newton * m,
        "W": newton * m / s,
        "rad": 1.0,
    }
    base |= {"s²": s**2, "m²": m**2, "Pa": newton / m**2}
    above, _, below = unit.partition("/")
    top = np.prod([base[word] for word in above.split()])
    return float(top / (base[below] if below else 1.0))


def said(
    joint: dict[str, Any],
    planar: bool,
    units: bool,
    more: dict[str, Any],
    record: list[str],
) -> SceneFile:
    """A body on a joint, in SI units or in new ones."""

    def amount(value: Any, unit: str) -> Any:
        factor = number_of(unit) if units else 1.0
        return (np.array(value) * factor).tolist()

    place = [0.3, 0.0] if planar else [0.3, 0.1, -0.2]
    weight = [1.0, -9.0] if planar else [1.0, -9.0, 3.0]
    inertia: Any = 0.02 if planar else [0.02, 0.03, 0.04]
    joint = {k: amount(*v) if isinstance(v, tuple) else v for k, v in joint.items()}
    rubs = joint.get("friction")
    if rubs:
        sized = {"radius": amount(*rubs["radius"])} if "radius" in rubs else {}
        joint["friction"] = rubs | sized
    body = {
        "mass": amount(2.0, "kg"),
        "inertia": amount(inertia, "kg m²"),
        "markers": {"end": {"position": amount(place, "m")}},
    }
    data: dict[str, Any] = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar" if planar else "spatial",
        "gravity": amount(weight, "m/s²"),
        "time": {k: amount(v, "s") for k, v in (("end", 0.05), ("output_step", 0.01))},
        "accuracy": {"rtol": 1e-9},
        "bodies": {"a": body},
        "joints": {"j": {"markers": ["ground", "a.end"], **joint}},
        "outputs": {"record": record},
    }
    for table, parts in more.items():
        data[table] = {
            name: {k: v(units) if callable(v) else v for k, v in part.items()}
            for name, part in parts.items()
        }
    return validate_data(data, SceneFile)


def assert_units(
    joint: dict[str, Any], planar: bool, more: dict[str, Any], extra: list[str]
) -> None:
    plain = said(joint, planar, False, more, [])
    found = dict.fromkeys((*known_outputs(plain, {}), *extra))
    names = [name for name in found if not name.startswith("constraint")]
    one, other = (
        simulate(compile_scene(said(joint, planar, units, more, names)))
        for units in (False, True)
    )
    for name, column, scaled in zip(names, one.values.T, other.values.T, strict=True):
        factor = number_of(unit_of(name, plain) or "rad")
        size = np.abs(column).max()
        if size > 1e-9:
            error = np.abs(scaled / factor - column).max()
            assert error < 1e-5 * size, (name, factor, np.abs(scaled).max() / size)
    seen = [n for n, c in zip(names, one.values.T, strict=True) if abs(c).max() > 1e-9]
    assert set(extra) <= set(seen)


KINDS = [*((name, True) for name in PLANAR), *((name, False) for name in SPATIAL)]


@pytest.mark.parametrize(("kind", "planar"), KINDS)
def test_multipliers_of_joints_scale_as_their_units(kind: str, planar: bool) -> None:
    more = {"screw": {"pitch": (0.1, "m")}}
    joint = {"type": kind, **more.get(kind, {})}
    rows = {"fixed": 3, "prismatic": 2} if planar else {}
    rows |= {} if planar else {"fixed": 6, "prismatic": 5, "revolute": 5}
    rows |= {} if planar else {"cylindrical": 4, "screw": 5, "universal": 4}
    rows |= {} if planar else {"planar": 3}
    count = rows.get(kind, FORCES[kind][not planar])
    assert_units(joint, planar, {}, [f"j.f{k + 1}" for k in range(count)])


@pytest.mark.parametrize("turns", [True, False])
def test_laws_friction_and_drives_scale_as_their_units(turns: bool) -> None:
    """A hinge or a guide that rubs, and a controller with a filter."""
    push, way = ("N m", "rad") if turns else ("N", "m")
    stiff = number_of(push) / number_of(way)
    gains = {"p": 3.0, "i": 2.0, "d": 1.0}
    joint = {"type": "revolute" if turns else "prismatic"}
    name = "angle" if turns else "displacement"
    rubs: dict[str, Any] = {"coefficient": 0.01}
    if turns:
        rubs["radius"] = (0.01, "m")

    def law(scaled: bool) -> dict[str, Any]:
        per = (1.0, number_of("s")) if scaled else (1.0, 1.0)
        factor = stiff if scaled else 1.0
        return {
            "type": "pid",
            "measured": f"j.{name}",
            "reference": 0.1 * (number_of(way) if scaled else 1.0),
            "p": gains["p"] * factor,
            "i": gains["i"] * factor / per[1],
            "d": gains["d"] * factor * per[1],
            "filter": 0.02 * per[1],
        }

    extra = ["motor.value", "motor.state.integral", "motor.state.derivative"]
    assert_units(
        joint | {"friction": rubs},
        True,
        {"forces": {"motor": {"type": "actuator", "joint": "j", "function": law}}},
        [*extra, "j.friction", "j.normal_force"],
    )
    drive = {"type": "polynomial", "pieces": [{"from": 0.0, "coefficients": [0.0, 0]}]}

    def moved(scaled: bool) -> dict[str, Any]:
        factor = number_of(way) / number_of("s") ** 2 if scaled else 1.0
        return drive | {"pieces": [{"from": 0.0, "coefficients": [0.0, 0.0, factor]}]}

    drives = {"drives": {"d": {"joint": "j", "function": moved}}}
    assert_units(joint, True, drives, ["d.f1"])


def test_gears_and_couplings_have_units_of_what_they_couple() -> None:
    joint = {"markers": ["ground", "a"]}
    scene = validate_data(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "planar",
            "time": {"end": 1.0, "output_step": 0.1},
            "bodies": {"a": {"mass": 1.0, "inertia": 1.0}, "b": {"mass": 1.0}},
            "joints": {
                "hinge": {"type": "revolute", **joint},
                "guide": {"type": "prismatic", "markers": ["ground", "b"]},
                "rack": {"type": "gear", "joints": ["hinge", "guide"], "ratio": 0.1},
                "wheel": {"type": "gear", "joints": ["guide", "hinge"], "ratio": 9.0},
                "sum": {
                    "type": "coupling",
                    "joints": ["guide", "hinge"],
                    "weights": [1.0, -0.1],
                },
            },
        },
        SceneFile,
    )
    names = ("rack.f1", "wheel.f1", "sum.f1")
    assert [unit_of(name, scene) for name in names] == ["N", "N m", ""]
