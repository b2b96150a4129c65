"""What a mechanism does depends on nothing that is a matter of description.

The founding slider-crank (planar, flexible) and a flexible mechanism in space, each
transformed in every way of `transformed`: elastic coordinates, distances and sizes of
forces stay what they are, up to the tolerance of the run.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.result import Result
from sidtool.formats.scene import Placement, SceneFile, read_scene
from sidtool.formats.sid_files import read_sid
from sidtool.solver import compile_scene, simulate
from tests.places import SLIDER_CRANK
from tests.solver import transformed as other
from tests.solver.dynamics.joint_scenes import soft_body
from tests.solver.scenes import scene as small_scene

RTOL, SAME = 1e-9, 1e-7
Case = tuple[dict[str, Any], dict[str, SID]]


def slider_crank() -> Case:
    """The founding example: its last half second, at full speed."""
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    table = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    table["time"] = {"end": 1.5, "output_step": 0.05}
    record = [f"rod.q{k}" for k in range(1, 6)]
    record += ["piston.x", "piston.y", "crank.pin.x", "crank.pin.y"]
    record += ["crank_pin.fx", "crank_pin.fy", "slider.fx", "slider.fy"]
    table["outputs"] = {"record": record}
    return table, {"rod": read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")}


def arm_in_space() -> Case:
    """A flexible arm on a skew axle, a rigid bob on a universal joint, a spring."""
    sid = soft_body(False, seed=3)
    axle = [0.3, -0.5, 0.2]
    root = np.array(axle) - sid.node("2").position
    tip = (root + sid.node("1").position).tolist()
    table = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "spatial",
        "time": {"start": 0.0, "end": 1.5, "output_step": 0.05},
        "gravity": [1.0, 2.0, -9.0],
        "ground": {
            "markers": {
                "axle": {"position": axle},
                "spring": {"position": [0.0, 1.0, 3.0]},
            }
        },
        "bodies": {
            "arm": {
                "sid": "arm",
                "markers": {"tip": "1", "axle": "2"},
                "quadratic_inertia": True,
                "initial": {"position": root.tolist()},
            },
            "bob": {
                "mass": 2.0,
                "inertia": [0.3, 0.4, 0.2],
                "centre_of_mass": [0.1, 0.0, -0.4],
                "markers": {"end": {"position": [0.0, 0.0, -0.8]}},
                "initial": {"position": tip},
            },
        },
        "joints": {
            "axle": {
                "type": "revolute",
                "markers": ["ground.axle", "arm.axle"],
                "axis": [1.0, 2.0, 0.5],
            },
            "tip": {
                "type": "universal",
                "markers": ["arm.tip", "bob"],
                "axis": [1.0, 0.0, 0.0],
                "second_axis": [0.0, 1.0, 0.0],
            },
        },
        "drives": {},
        "forces": {
            "spring": {
                "type": "spring_damper",
                "markers": ["ground.spring", "bob.end"],
                "rest": 2.0,
                "stiffness": 30.0,
                "damping": 0.5,
            }
        },
        "outputs": {
            "record": ["arm.q1", "arm.q2", "bob.x", "bob.y", "bob.z"]
            + [f"bob.end.{a}" for a in "xyz"]
            + [f"{j}.f{a}" for j in ("axle", "tip") for a in "xyz"]
        },
    }
    return table, {"arm": sid}


CASES = {"slider crank": slider_crank, "arm in space": arm_in_space}


def run(table: dict[str, Any], sids: dict[str, SID]) -> Result:
    system = compile_scene(SceneFile.model_validate(table), SLIDER_CRANK, sids)
    return simulate(system, integrator="radau9", rtol=RTOL)


def measures(result: Result, names: dict[str, str] | None = None) -> dict[str, Array]:
    """What no description changes: q, distances between points, sizes of forces."""
    names = names or {name: name for name in result.names}
    found: dict[str, Array] = {}
    vectors: dict[str, list[Array]] = {}
    for name, mine in names.items():
        owner, quantity = name.rsplit(".", 1)
        if quantity[0] == "q":
            found[name] = result[mine]
        else:
            key = f"{owner}.force" if quantity[0] == "f" else owner
            vectors.setdefault(key, []).append(result[mine])
    points = {k: np.array(v) for k, v in vectors.items() if not k.endswith(".force")}
    for key, parts in vectors.items():
        if key.endswith(".force"):
            found[key] = np.linalg.norm(np.array(parts), axis=0)
    first, *rest = points.values()
    for key, point in zip(list(points)[1:], rest, strict=True):
        found[key] = np.linalg.norm(point - first, axis=0)
        found[f"path of {key}"] = np.linalg.norm(point - point[:, :1], axis=0)
    return found


@pytest.fixture(scope="module")
def expected() -> dict[str, dict[str, Array]]:
    return {name: measures(run(*case())) for name, case in CASES.items()}


def compare(found: dict[str, Array], exact: dict[str, Array]) -> None:
    """Forces follow accelerations, which have the error of positions times frequency
    squared."""
    assert found.keys() == exact.keys()
    deformation = max(abs(v).max() for k, v in exact.items() if ".q" in k)
    for key, value in exact.items():
        size = deformation if ".q" in key else abs(value).max()
        bound = (100.0 if key.endswith("force") else 1.0) * SAME
        assert found[key] == pytest.approx(value, abs=bound * size), key


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("shift", [0.0, 1e3], ids=["turned", "turned, far away"])
def test_no_place_and_no_direction_is_special(
    name: str, shift: float, expected: dict[str, dict[str, Array]]
) -> None:
    table, sids = CASES[name]()
    planar = table["dimension"] == "planar"
    turn = Placement(angle=2.1) if planar else Placement(axis_angle=(0.4, -1.1, 0.7))
    away = [shift, -2.0 * shift] if planar else [shift, -2.0 * shift, 0.5 * shift]
    compare(measures(run(other.moved(table, away, turn), sids)), expected[name])


@pytest.mark.parametrize("name", CASES)
def test_names_mean_nothing(name: str, expected: dict[str, dict[str, Array]]) -> None:
    table, sids = CASES[name]()
    new = other.renamed(table)
    names = dict(zip(table["outputs"]["record"], new["outputs"]["record"], strict=True))
    bodies = {f"n{body[::-1]}": sid for body, sid in sids.items()}
    compare(measures(run(new, bodies), names), expected[name])


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("change", [other.reordered, other.reversed_joints])
def test_no_body_is_the_first(
    name: str, change: Any, expected: dict[str, dict[str, Array]]
) -> None:
    table, sids = CASES[name]()
    compare(measures(run(change(table), sids)), expected[name])


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize(
    "units",
    [other.Units(1e3, 1e-3), other.Units(1e3, 1e3, 1e3), other.Units(1e-3, 1.0)],
    ids=["mm t s", "mm g ms", "km kg s"],
)
def test_no_unit_is_special(
    name: str, units: other.Units, expected: dict[str, dict[str, Array]]
) -> None:
    table, sids = CASES[name]()
    bodies = {body: other.sid_in(sid, units) for body, sid in sids.items()}
    found = measures(run(other.in_units(table, units), bodies))
    for key in found:
        if key.endswith(".force"):
            found[key] = found[key] / units.force
        elif ".q" not in key:
            found[key] = found[key] / units.length
    compare(found, expected[name])


def linkage(size: float) -> SceneFile:
    """Crank, coupler and rocker in space, the axes of their hinges skew.

    Falls in the time that it takes at 1 m, since gravity is as large as the mechanism.
    """
    corners = {"crank": (0.0, 0.0, 0.0), "coupler": (0.3, 0.0, 0.0)}
    head, far = np.array([0.7, 0.9, 0.5]), np.array([1.0, 0.1, -0.2])
    ends = {"crank": np.array(corners["coupler"]), "coupler": head, "rocker": head}
    bodies: dict[str, Any] = {}
    for name, end in ends.items():
        start = np.array(corners.get(name, far))
        edge = end - start
        across = (np.eye(3) * (edge @ edge) - 0.97 * np.outer(edge, edge)) / 12.0
        bodies[name] = {
            "mass": 1.0,
            "inertia": (size**2 * across).tolist(),
            "centre_of_mass": (0.5 * size * edge).tolist(),
            "markers": {"tip": {"position": (size * edge).tolist()}},
            "initial": {"position": (size * start).tolist()},
        }
    bodies["crank"]["initial"]["angular_velocity"] = [0.0, 0.0, 6.0]

    def joint(kind: str, *markers: str, **more: Any) -> dict[str, Any]:
        return {"type": kind, "markers": list(markers), **more}

    joints = {
        "base": joint("revolute", "ground", "crank", axis=[0.0, 0.0, 1.0]),
        "ball": joint("spherical", "crank.tip", "coupler"),
        "cross": joint("universal", "coupler.tip", "rocker.tip", axis=[1.0, 0.0, 0.0]),
        "pivot": joint("revolute", "ground.far", "rocker", axis=[0.6, 0.0, 0.8]),
    }
    return small_scene(
        bodies,
        joints,
        record=[f"coupler.tip.{axis}" for axis in "xyz"],
        dimension="spatial",
        gravity=[0.0, -9.81 * size, 0.0],
        ground={"markers": {"far": {"position": (size * far).tolist()}}},
    )


@pytest.mark.parametrize("size", [2.0**-20, 2.0**-13, 2.0**10])
def test_no_size_is_special(size: float) -> None:
    """Constraints between directions are as closed as at 1 m, whatever the lengths.

    Lengths and angles are in the same sums, which round otherwise at another size: of
    151 steps on Linux one more is taken on Windows.
    """
    exact = simulate(compile_scene(linkage(1.0)), rtol=RTOL)
    found = simulate(compile_scene(linkage(size)), rtol=RTOL)
    assert found.values == pytest.approx(size * exact.values, abs=0.1 * RTOL * size)
    assert abs(found.counters["steps"] - exact.counters["steps"]) <= 1


def test_a_rigid_body_has_no_favourite_point(
    expected: dict[str, dict[str, Array]],
) -> None:
    """The crank described from its pin, turned by a right angle."""
    table, sids = slider_crank()
    crank = table["bodies"]["crank"]
    crank["centre_of_mass"] = [0.0, -0.05]
    crank["markers"] = {
        "bearing": {"position": [0.0, -0.1], "angle": 0.5 * np.pi},
        "pin": {"position": [0.0, 0.0]},
    }
    crank["initial"] = {"position": [0.1, 0.0], "angle": -0.5 * np.pi}
    compare(measures(run(table, sids)), expected["slider crank"])


def test_a_planar_scene_moves_alike_in_space(
    expected: dict[str, dict[str, Array]],
) -> None:
    table, sids = slider_crank()
    exact = expected["slider crank"]
    compare(measures(run(in_space(table), sids)), exact)
    turn = Placement(axis_angle=(1.0, 0.5, -0.3))
    tilted = other.moved(in_space(table), [1.0, 2.0, 3.0], turn)
    compare(measures(run(tilted, sids)), exact)


def in_space(table: dict[str, Any]) -> dict[str, Any]:
    """The slider-crank with six coordinates of each frame; it can only move flat."""
    new = copy.deepcopy(table)
    new["dimension"] = "spatial"
    crank = new["bodies"]["crank"]
    crank["inertia"] = [1e-5, crank["inertia"], crank["inertia"]]
    crank["centre_of_mass"].append(0.0)
    for marker in crank["markers"].values():
        marker["position"].append(0.0)
    for body in ("rod", "piston"):
        new["bodies"][body]["initial"]["position"].append(0.0)
    new["joints"]["piston_pin"]["type"] = "coincident"
    new["joints"]["slider"] = {
        "type": "point_on_plane",
        "markers": ["ground", "piston"],
        "axis": [0.0, 1.0, 0.0],
    }
    record = new["outputs"]["record"]
    new["outputs"]["record"] = record + ["piston.z", "crank.pin.z"]
    new["outputs"]["record"] += ["crank_pin.fz", "slider.fz"]
    return new
