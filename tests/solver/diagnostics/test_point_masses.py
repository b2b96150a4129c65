"""A point mass takes no torque: what would turn another body against it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sidtool
from sidtool.formats.base.errors import InputError
from sidtool.solver import compile_scene, describe


def scene(
    dimension: str = "planar", inertia: float | None = None, **tables: Any
) -> sidtool.Scene:
    """A rotor that spins freely at 1 rad/s, and a mass at its arm of 1 m."""
    spatial = dimension == "spatial"
    own = [0.1, 0.1, 0.1] if spatial else 0.1
    end = [1.0, 0.0, 0.0] if spatial else [1.0, 0.0]
    spin = [0.0, 0.0, 1.0] if spatial else 1.0
    mass: dict[str, Any] = {"mass": 1.0, "initial": {"position": end}}
    if inertia is not None:
        mass["inertia"] = [inertia] * 3 if spatial else inertia
    rotor = {
        "mass": 1.0,
        "inertia": own,
        "initial": {"angular_velocity": spin},
        "markers": {"end": {"position": end}},
    }
    joints = {"axle": {"type": "revolute", "markers": ["ground", "rotor"]}}
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": dimension,
        "time": {"end": 1.0, "output_step": 0.1},
        "bodies": {"rotor": rotor, "bead": mass},
        "joints": joints | tables.pop("joints", {}),
        "outputs": {"record": ["axle.angle", "angular_momentum.z"]},
    }
    return sidtool.Scene.checked(data | tables, "test")


PIN = {"pin": {"type": "revolute", "markers": ["rotor.end", "bead"]}}
RAIL = {"rail": {"type": "prismatic", "markers": ["rotor", "bead"]}}
LINE = {"rail": {"type": "point_on_line", "markers": ["rotor", "bead"]}}
SPRING = {"type": "spring_damper", "joint": "pin", "stiffness": 50.0}
MOTOR = {
    "type": "actuator",
    "joint": "pin",
    "function": {"type": "constant", "value": 1.0},
}
CASES = {
    "spring": {"joints": PIN, "forces": {"a": SPRING}},
    "motor": {"joints": PIN, "forces": {"a": MOTOR}},
    "brake": {
        "joints": PIN,
        "forces": {
            "a": {"type": "friction", "joint": "pin", "force": 1.0, "speed": 0.1}
        },
    },
    "friction": {
        "joints": {
            "pin": PIN["pin"] | {"friction": {"coefficient": 0.2, "radius": 0.1}}
        }
    },
    "rail": {"joints": RAIL},
    "drive": {
        "joints": PIN,
        "drives": {
            "a": {
                "joint": "pin",
                "function": {"type": "harmonic", "amplitude": 1.0, "frequency": 1.0},
            }
        },
    },
}


@pytest.mark.parametrize("case", sorted(CASES))
def test_torques_on_a_point_mass_are_refused(case: str) -> None:
    """They turned the rotor against an orientation that the mass does not have."""
    with pytest.raises(InputError, match=r"a point mass.*bodies\.bead\.inertia"):
        sidtool.simulate(scene(**CASES[case]))
    found = sidtool.simulate(scene(inertia=0.2, **CASES[case]))
    momentum = found["angular_momentum.z"]
    assert_allclose(momentum, momentum[0], rtol=1e-5)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_bushings_hold_point_masses_by_forces(dimension: str) -> None:
    forces = 2 if dimension == "planar" else 3
    rotations = 1 if dimension == "planar" else 3
    for twist in (0.0, 5.0):
        stiffness = [1e3] * forces + [twist] * rotations
        markers = ["rotor.end", "bead"]
        mount = {"type": "bushing", "markers": markers, "stiffness": stiffness}
        if twist:
            with pytest.raises(InputError, match="zeros for rotations"):
                sidtool.simulate(scene(dimension, forces={"mount": mount}))
        else:
            found = sidtool.simulate(scene(dimension, forces={"mount": mount}))
            momentum = found["angular_momentum.z"]
            assert_allclose(momentum, momentum[0], rtol=1e-5)


def test_a_bead_on_a_line_lets_the_rod_turn() -> None:
    """Its angular momentum is kept, the angle not held."""
    found = sidtool.simulate(scene(joints=LINE))
    assert found["axle.angle"][-1] > 0.5
    assert np.ptp(found["angular_momentum.z"]) < 1e-6


def test_the_guide_of_a_piston_takes_the_torque_of_its_pin() -> None:
    """A rod falls from its pin in a piston on a rail. With a spring of the pin that the
    piston carries it swings as on a wall: I w' = -k a about the pin, so that
    cos(sqrt(k / I) t) is its angle; the piston is heavy.
    """
    stiffness, inertia = 3.0, 0.1 + 0.5 * 0.2**2
    rod = {
        "mass": 0.5,
        "inertia": 0.1,
        "markers": {"pin": {"position": [-0.2, 0.0]}},
        "initial": {"position": [0.2, 0.0]},
    }
    spring = {"type": "spring_damper", "joint": "pin", "stiffness": stiffness}
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": 1.0, "output_step": 0.05},
        "bodies": {"rod": rod, "piston": {"mass": 1e9}},
        "joints": {
            "guide": {"type": "point_on_line", "markers": ["ground", "piston"]},
            "pin": {"type": "revolute", "markers": ["piston", "rod.pin"]},
        },
        "forces": {"spring": spring | {"rest": -0.1}},
        "outputs": {"record": ["pin.angle"]},
    }
    found = sidtool.simulate(sidtool.Scene.checked(data, "test"), rtol=1e-8)
    wanted = -0.1 * (1.0 - np.cos(np.sqrt(stiffness / inertia) * found.t))
    assert_allclose(found["pin.angle"], wanted, atol=1e-6)


def test_what_does_not_turn_may_guide_a_point_mass() -> None:
    carriage = {"mass": 2.0, "inertia": 0.1}
    rails = {
        "floor": {"type": "prismatic", "markers": ["ground", "carriage"]},
        "mast": {"type": "prismatic", "markers": ["carriage", "bead"]},
        "wall": {"type": "prismatic", "markers": ["ground", "stone"]},
    }
    bodies = {
        "carriage": carriage,
        "bead": {"mass": 1.0, "initial": {"velocity": [1.0, 0.0]}},
        "stone": {"mass": 1.0},
    }
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": 1.0, "output_step": 0.5},
        "bodies": bodies,
        "joints": rails,
        "outputs": {"record": ["bead.x"]},
    }
    found = sidtool.simulate(sidtool.Scene.checked(data, "test"))
    assert_allclose(found["bead.x"], found.t, atol=1e-9)


def free_body(
    joint: dict[str, Any], dimension: str = "spatial", **bead: Any
) -> sidtool.Scene:
    """A body that tumbles without loads, a mass beside its centre joined to it."""
    spatial = dimension == "spatial"
    point = [0.3, 0.2, 0.1] if spatial else [0.3, 0.2]
    spin = [0.7, 0.4, 0.3] if spatial else 0.7
    body = {
        "mass": 1.0,
        "inertia": [1.0, 2.0, 2.5] if spatial else 1.0,
        "initial": {"angular_velocity": spin},
        "markers": {"end": {"position": point}},
    }
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": dimension,
        "time": {"end": 1.0, "output_step": 0.1},
        "bodies": {"body": body, "bead": {"mass": 2.0} | bead},
        "joints": {"joint": {"markers": ["body.end", "bead"]} | joint},
        "outputs": {"record": ["angular_momentum.*"]},
    }
    data["bodies"]["bead"].setdefault("initial", {"position": point})
    return sidtool.Scene.checked(data, "test")


def refused(scene: sidtool.Scene) -> str:
    """The refused key, and what the error expects."""
    with pytest.raises(InputError, match="a point mass") as caught:
        sidtool.simulate(scene)
    assert caught.value.place is not None
    return caught.value.place + ": " + (caught.value.expected or "")


def keeps_angular_momentum(scene: sidtool.Scene) -> bool:
    found = sidtool.simulate(scene, rtol=1e-8)
    momenta = np.array([found[name] for name in found.names])
    assert len(momenta) and np.abs(momenta).max() > 0.1
    return float(np.ptp(momenta, axis=1).max()) < 1e-6


@pytest.mark.parametrize(
    ("joint", "freer"),
    [
        ("revolute", "spherical"),
        ("cylindrical", "point_on_line"),
        ("universal", "spherical"),
        ("planar", "point_on_plane"),
        ("screw", None),
    ],
)
def test_a_point_mass_does_not_hold_the_axis_of_a_body(
    joint: str, freer: str | None
) -> None:
    """No load acts: the angular momentum of the joined pair is constant. Joints whose
    axis the point mass would hold are refused."""
    pitch = {"pitch": 0.1} if joint == "screw" else {}
    what = refused(free_body({"type": joint} | pitch))
    assert what.startswith("joints.joint:")
    if freer is not None:
        assert f'"{freer}"' in what
        assert keeps_angular_momentum(free_body({"type": freer}))


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_line_belongs_to_the_body_that_turns(dimension: str) -> None:
    """One that a mass carries would push the body without a torque on the mass."""
    joint = {"type": "point_on_line"}
    assert keeps_angular_momentum(free_body(joint, dimension))
    swapped = joint | {"markers": ["bead", "body.end"]}
    assert "bead as second marker" in refused(free_body(swapped, dimension))


HARMONIC = {"type": "harmonic", "amplitude": 0.1, "frequency": 1.0}


def linked(markers: list[str], link: dict[str, Any], dimension: str) -> sidtool.Scene:
    """The body and the mass with a bushing (of forces) or a drive in place of a joint,
    0.1 m apart."""
    apart = [0.4, 0.2, 0.1] if dimension == "spatial" else [0.4, 0.3]
    joint = {"type": "coincident"}
    data = free_body(joint, dimension, initial={"position": apart}).file_data()
    del data["joints"]
    if "stiffness" in link:
        data["forces"] = {"link": {"type": "bushing", "markers": markers} | link}
    else:
        reference, marker = markers
        drive = {"reference": reference, "marker": marker, "function": HARMONIC}
        data["drives"] = {"link": drive | link}
    return sidtool.Scene.checked(data, "test")


def of_all_axes(dimension: str, *values: float) -> list[float]:
    return [*values[: 2 if dimension == "planar" else 3], *[0.0] * 3][
        : 3 if dimension == "planar" else 6
    ]


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("case", ["uneven", "damped", "drive"])
def test_axes_belong_to_the_body_that_turns(case: str, dimension: str) -> None:
    """Bushings and drives act along axes of their first marker. On axes of a mass
    they pushed beside its centre: 0.2 of 1.3 kg m^2/s within a second."""
    even = of_all_axes(dimension, 100.0, 100.0, 100.0)
    link: dict[str, Any] = {
        "uneven": {"stiffness": of_all_axes(dimension, 100.0, 10.0, 50.0)},
        "damped": {"stiffness": even, "damping": even},
        "drive": {"coordinate": "x"},
    }[case]
    assert keeps_angular_momentum(linked(["body.end", "bead"], link, dimension))
    assert "bead as " in refused(linked(["bead", "body.end"], link, dimension))
    central = linked(["bead", "body.end"], {"stiffness": even}, dimension)
    assert keeps_angular_momentum(central)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("markers", [["bead", "body"], ["body", "bead"]])
def test_no_drive_turns_a_body_against_a_point_mass(
    markers: list[str], dimension: str
) -> None:
    link: dict[str, Any] = {"coordinate": "angle"}
    if dimension == "spatial":
        link = {"coordinate": "rotation", "axis": [0.0, 0.0, 1.0]}
    assert refused(linked(markers, link, dimension)).startswith("drives.link:")


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("joint", ["coincident", "fixed"])
def test_markers_off_the_centre_of_a_point_mass_are_refused(
    joint: str, dimension: str
) -> None:
    assert keeps_angular_momentum(free_body({"type": joint}, dimension))
    arm = [0.1, 0.0, 0.0][: 3 if dimension == "spatial" else 2]
    beside = {"type": joint, "markers": ["body.end", "bead.arm"]}
    scene = free_body(beside, dimension, markers={"arm": {"position": arm}})
    assert "a marker at its centre" in refused(scene)


def test_a_mass_on_an_arm_is_no_pendulum() -> None:
    """A point mass has no rotation: an arm between it and its joint is refused."""
    data = scene().file_data() | {"gravity": [0.0, -9.81]}
    arm = {"arm": {"position": [-1.0, 0.0]}}
    start = {"position": [1.0, 0.0]}
    data["bodies"] = {"bead": {"mass": 1.0, "markers": arm, "initial": start}}
    data["joints"] = {"pin": {"type": "revolute", "markers": ["ground", "bead.arm"]}}
    del data["outputs"]
    assert refused(sidtool.Scene.checked(data, "test")).startswith("joints.pin:")
    data["bodies"]["bead"]["inertia"] = 1e-9
    swings = sidtool.simulate(sidtool.Scene.checked(data, "test"))
    assert np.ptp(swings["bead.y"]) > 0.5


def test_spatial_pins_may_repeat_what_other_joints_hold() -> None:
    """The rotor turns about z, and its bead on a pin about z has a place only."""
    for pin in ({}, {"axis": [0.0, 0.0, 1.0]}):
        found = sidtool.simulate(scene("spatial", joints={"pin": PIN["pin"] | pin}))
        assert_allclose(found["axle.angle"], found.t, atol=1e-6)
    across = {"pin": PIN["pin"] | {"axis": [0.0, 1.0, 0.0]}}
    assert refused(scene("spatial", joints=across)).startswith("joints.pin:")


def test_a_centre_of_mass_beyond_all_numbers_is_refused() -> None:
    """Steiner's moment of inertia, m r^2, would be infinite."""
    data = scene().file_data()
    data["bodies"]["bead"] |= {"centre_of_mass": [1e300, 0.0], "inertia": 1.0}
    with pytest.raises(InputError, match=r"bodies\.bead\.centre_of_mass"):
        sidtool.Scene.checked(data, "test").compile()


def test_an_inertia_beyond_all_sizes_of_its_mass_is_described() -> None:
    """Its radius of gyration is 1e150 m, the cube of which is no number."""
    data = scene().file_data()
    data["bodies"]["bead"] |= {"mass": 1e-300, "inertia": 1.0}
    system = compile_scene(sidtool.Scene.checked(data, "test"))
    assert any(line.startswith("total mass: 1 kg") for line in describe(system))
