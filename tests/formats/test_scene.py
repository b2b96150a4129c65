"""Scene files: what is accepted means what it says, the rest is refused by its key."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import (
    Piece,
    Placement,
    SceneFile,
    as_3d,
    coefficients,
    marker_reference,
    orientation_matrix,
    output_times,
    parse_output,
    read_scene,
)
from sidtool.formats.toml.reading import validate_data
from tests.places import ROOT

EXAMPLE = ROOT / "examples/slider_crank/slider_crank.toml"

SPATIAL = """
format = "sidtool scene"
version = 1
dimension = "spatial"
gravity = [0, 0, -9.81]
time = { end = 1, output_times = [0, 0.5, 1] }
[bodies.top]
mass = 1
inertia = [1, 1, 2]
markers.tip = { position = [0, 0, -1], axis_angle = [0, 0, 0.3] }
initial = { quaternion = [1, 0, 0, 0], angular_velocity = [0, 0, 5] }
[joints.tip]
type = "coincident"
markers = ["ground", "top.tip"]
[outputs]
record = ["top.x", "top.tip.vz", "tip.f1"]
"""


def planar() -> dict[str, Any]:
    return tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))


def spatial() -> dict[str, Any]:
    return tomllib.loads(SPATIAL)


def changed(data: dict[str, Any], key: str, value: object) -> dict[str, Any]:
    """The data with one dotted key set, or deleted when the value is `None`."""
    *tables, last = [int(k) if k.isdigit() else k for k in key.split("/")]
    table: Any = data
    for name in tables:
        table = table.setdefault(name, {}) if isinstance(table, dict) else table[name]
    if value is None:
        del table[last]
    else:
        table[last] = value
    return data


def test_the_example_is_valid() -> None:
    scene = read_scene(EXAMPLE)
    assert list(scene.bodies) == ["crank", "rod", "piston"]
    assert scene.outputs.record[0] == "piston.x"


def test_a_spatial_scene_is_valid() -> None:
    scene = validate_data(spatial(), SceneFile)
    assert output_times(scene).tolist() == [0, 0.5, 1]


def test_a_scene_survives_json() -> None:
    for data in (planar(), spatial()):
        scene = validate_data(data, SceneFile)
        text = scene.model_dump_json(by_alias=True, exclude_none=True)
        assert SceneFile.model_validate_json(text) == scene


PIECES = "drives/crank_angle/function/pieces"


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("time/end", None, "time.end: is missing"),
        ("time/end", -1.0, "time.end: found -1.0; expected a time after the start"),
        ("time/output_step", 0, "time.output_step: found 0; expected a number greater"),
        ("time/output_times", [0.0], "time: both are given"),
        ("accuracy/rtol", 0.0, "accuracy.rtol: found 0"),
        (
            "dimension",
            "flat",
            "dimension: found 'flat'; expected 'planar' or 'spatial'",
        ),
        ("gravity", [0, 0, -9.81], "gravity: found 3 components; expected 2"),
        ("gravity", [0, "g"], r"gravity\[1\]: found 'g'; expected a number"),
        ("bodies", {}, "bodies: .*at least 1"),
        (
            "bodies/piston/mass",
            -5.0,
            "bodies.piston.mass: found -5.0; .*greater than 0",
        ),
        ("bodies/piston/mass", "5 kg", "bodies.piston.mass: found '5 kg'; .*a number"),
        ("bodies/piston/mass", None, "bodies.piston.mass: is missing; .*or `sid`"),
        ("bodies/crank/inertia", -1, "bodies.crank.inertia: is negative"),
        ("bodies/crank/inertia", [1, 1, 1], "bodies.crank.inertia: does not fit"),
        ("bodies/crank/inertia", "x", "bodies.crank.inertia: found 'x'; .*a number"),
        ("bodies/crank/colour", "red", "bodies.crank.colour: is not a known key"),
        ("bodies/ground", {"mass": 1}, "bodies.ground: 'ground' cannot be a name"),
        ("bodies/a.b", {"mass": 1}, "'a.b' cannot be a name"),
        ("bodies/bearing", {"mass": 1}, "joints.bearing: is also the name of one"),
        ("bodies/crank/markers/x", {}, "bodies.crank.markers.x: 'x' cannot be a name"),
        (
            "bodies/crank/markers/pin",
            {"axis_angle": [0, 0, 1]},
            "bodies.crank.markers.pin.axis_angle: is not for a planar scene",
        ),
        (
            "bodies/crank/markers/pin",
            {"position": [1, 2, 3]},
            "bodies.crank.markers.pin.position: found 3 components",
        ),
        (
            "bodies/crank/initial",
            {"elastic": [1.0]},
            "bodies.crank.initial.elastic: is not a known key",
        ),
        (
            "bodies/crank/initial",
            {"angular_velocity": [0, 0, 1]},
            "angular_velocity: does not fit a planar scene",
        ),
        ("bodies/rod/sid", "", "bodies.rod.sid: found ''"),
        ("joints/slider/type", "slide", "joints.slider.type: found 'slide'"),
        ("joints/slider/markers/1", "pistn", "no body 'pistn'; .*perhaps piston"),
        ("joints/slider/markers/1", "crank.pn", "no marker 'pn'; .*perhaps pin"),
        (
            "joints/slider/markers/1",
            "rod",
            "rod is flexible; expected one of its nodes",
        ),
        (
            "joints/slider/markers/1",
            "rod.mid",
            r"markers\[1\]: rod has no marker 'mid'",
        ),
        ("joints/slider/markers/1", "a.b.c", "found 'a.b.c'; expected BODY.MARKER"),
        ("joints/slider/markers", ["ground"], "one more entry"),
        ("joints/slider/markers", ["ground", "ground"], "both are on ground"),
        ("joints/slider/axis", [0, 0], "joints.slider.axis: has no direction"),
        ("joints/slider/axis", [0, 1e-300], "joints.slider.axis: has no direction"),
        ("joints/slider/axis", [1, 0, 0], "joints.slider.axis: found 3 components"),
        ("joints/bearing/axis", [0, 1], "joints.bearing.axis: is not for planar"),
        ("drives/crank_angle/joint", "baring", "no joint 'baring'; .*perhaps bearing"),
        ("drives/crank_angle/coordinate", "length", "found 'length'; expected angle"),
        ("drives/crank_angle/joint", None, "drives.crank_angle: neither is given"),
        ("drives/crank_angle/marker", "crank.pin", "drives.crank_angle: both are"),
        (f"{PIECES}/1/from", 2.5, r"pieces\[1\].from: found 2.5; .*before it, 2.0"),
        (f"{PIECES}/0/from", 0.5, r"pieces\[0\].from: begins at 0.5"),
        (f"{PIECES}/0/to", None, r"pieces\[0\].to: is missing"),
        (f"{PIECES}/0/to", -2.0, r"pieces\[0\].to: found -2.0"),
        (f"{PIECES}/0/end", None, r"pieces\[0\]: is not one polynomial"),
        (f"{PIECES}/1/start", [1.0], r"pieces\[1\]: is not one polynomial"),
        (f"{PIECES}/1/to", 2.5, r"pieces\[1\].to: ends at 2.5; .*end of the sim"),
        ("drives/crank_angle/function/type", "sine", "found 'sine'.*'polynomial'"),
        ("drives/second", {}, "drives.second.function: is missing"),
        (
            "outputs/record/0",
            "piston",
            r"outputs.record\[0\]: found 'piston'; .*piston.x",
        ),
        (
            "outputs/record/0",
            "piston.speed",
            "found 'piston.speed'; expected a quantity",
        ),
        ("outputs/record/0", "pistn.x", "no body 'pistn'; .*perhaps piston"),
        ("outputs/record/0", "piston.q1", "piston is rigid"),
        ("outputs/record/0", "crank.pn.x", "no marker 'pn'"),
        (
            "outputs/record/0",
            "slidr.f1",
            "no joint, .* 'slidr'; .*perhaps slider",
        ),
        ("version", 2, "version: found 2; expected 1"),
        ("format", "sidtool model", "format: found 'sidtool model'"),
    ],
)
def test_a_wrong_key_of_a_planar_scene(key: str, value: object, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        validate_data(changed(planar(), key, value), SceneFile, source="s.toml")
    assert str(raised.value).startswith("s.toml: ")


def test_a_joint_is_driven_once() -> None:
    data = planar()
    data["drives"]["again"] = data["drives"]["crank_angle"]
    with pytest.raises(InputError, match="driven by crank_angle already"):
        validate_data(data, SceneFile)


TIP = "bodies/top/markers/tip"


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("bodies/top/inertia", 1.0, "does not fit a spatial scene"),
        ("bodies/top/inertia", [[1, 1, 0], [0, 1, 0], [0, 0, 1]], "is not symmetric"),
        ("bodies/top/inertia", [[1, 2, 0], [2, 1, 0], [0, 0, 1]], "is negative"),
        (TIP, {"angle": 1.0}, "angle: is not for a spatial scene"),
        (TIP, {"quaternion": [1, 1, 0, 0]}, "quaternion: is not a unit quaternion"),
        (TIP, {"matrix": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "is not a rotation"),
        (
            TIP,
            {"quaternion": [1, 0, 0, 0], "axis_angle": [0, 0, 1]},
            "quaternion: is given with axis_angle",
        ),
        ("bodies/top/initial", {"angular_velocity": 1.0}, "does not fit a spatial"),
        ("time/output_times", [0.0, 0.5, 0.5], "0.5 follows 0.5"),
        ("time/output_times", [0.0, 2.0], "output_times: found 2.0"),
    ],
)
def test_a_wrong_key_of_a_spatial_scene(key: str, value: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        validate_data(changed(spatial(), key, value), SceneFile, source="s.toml")


@pytest.mark.parametrize(
    ("start", "place"),
    [
        ({"states": {"motor.state.sum": 1.0}}, "initial.states.motor.state.sum"),
        ({"states": {"motor.state": 1.0}}, "initial.states.motor.state"),
        ({"states": {"motor.angle": 1.0}}, "initial.states.motor.angle"),
        ({"states": {"slider.state.x": 1.0}}, "initial.states.slider.state.x"),
        ({"rotations": {"sldier.angle": 7.0}}, "initial.rotations.sldier.angle"),
    ],
)
def test_a_static_start_begins_with_states_that_exist(
    start: dict[str, Any], place: str
) -> None:
    """A wrong name would leave the search at another start without a word."""
    motor = {
        "type": "actuator",
        "joint": "slider",
        "function": {
            "type": "expression",
            "value": "work",
            "states": {"work": {"rate": "1.0"}},
        },
    }
    data = planar() | {"forces": {"motor": motor}}
    good = {"state": "static", "states": {"motor.state.work": 2.0}}
    validate_data(data | {"initial": good}, SceneFile)
    # Laws of drives count rotations of bodies as laws of forces do.
    counted = {"state": "static", "rotations": {"crank_angle.turn_z": 7.0}}
    validate_data(data | {"initial": counted}, SceneFile)
    with pytest.raises(InputError) as raised:
        validate_data(data | {"initial": {"state": "static", **start}}, SceneFile)
    assert raised.value.place == place
    result = {"state": "result", "file": "other.h5"}
    validate_data(data | {"initial": {**result, **start}}, SceneFile)


@pytest.mark.parametrize(
    ("function", "place"),
    [
        ({"terms": {"k": "1"}, "parameters": {"k": 1.0}}, "terms.k"),
        ({"terms": {"k": "1"}, "states": {"k": {"rate": "1"}}}, "states.k"),
        ({"terms": {"sin": "1"}}, "terms.sin"),
        ({"terms": {"a.b": "1"}}, "terms.a.b"),
        ({"terms": {"k": "2*"}}, "terms.k"),
        ({"terms": {"k": "lookup(none, t)"}}, "terms.k"),
    ],
)
def test_a_wrong_term_of_a_formula(function: dict[str, Any], place: str) -> None:
    law = {"type": "expression", "value": "2*t"} | function
    motor = {"type": "actuator", "joint": "slider", "function": law}
    with pytest.raises(InputError) as raised:
        validate_data(planar() | {"forces": {"motor": motor}}, SceneFile)
    assert raised.value.place == f"forces.motor.function.{place}"


def test_a_table_over_no_second_variable_is_refused() -> None:
    """As many values as x, but no y: neither one variable nor a grid."""
    table = {"x": [0.0, 0.5], "y": [], "values": [0.0, 0.1]}
    with pytest.raises(InputError) as raised:
        validate_data(planar() | {"tables": {"k": table}}, SceneFile)
    assert raised.value.place == "tables.k.y"


def test_output_times_hit_the_end_and_the_written_decimals() -> None:
    times = output_times(read_scene(EXAMPLE))
    assert len(times) == 301
    assert times[-1] == 3.0
    assert times[29] == 0.29 and times[150] == 1.5
    odd = changed(planar(), "time/output_step", 0.7)
    assert np.allclose(
        output_times(validate_data(odd, SceneFile)), [0, 0.7, 1.4, 2.1, 2.8]
    )


@pytest.mark.parametrize(
    ("place", "value"),
    [("output_step", 1e-12), ("output_step", 1e-308), ("end", 1e49)],
)
def test_the_number_of_output_times_is_bounded(place: str, value: float) -> None:
    """Also where it is more than a floating-point number can tell."""
    data = changed(planar(), f"time/{place}", value)
    with pytest.raises(InputError, match="output_step: asks for"):
        output_times(validate_data(data, SceneFile))


values = st.lists(st.floats(-10, 10), min_size=1, max_size=4)


@given(start=values, end=values, begin=st.floats(-5, 5), length=st.floats(0.1, 10))
def test_a_hermite_piece_takes_its_end_values(
    start: list[float], end: list[float], begin: float, length: float
) -> None:
    data = {"from": begin, "to": begin + length, "start": start, "end": end}
    piece = Piece.model_validate(data)
    polynomial = np.polynomial.Polynomial(coefficients(piece))
    assert piece.to is not None
    for at, given_values in ((0.0, start), (piece.to - begin, end)):
        for order, wanted in enumerate(given_values):
            found = polynomial.deriv(order)(at) if order else polynomial(at)
            scale = max(abs(v) * length**k for k, v in enumerate([*start])) + max(
                abs(v) * length**k for k, v in enumerate([*end])
            )
            assert abs(found - wanted) * length**order <= 1e-9 * max(scale, 1e-9)


def test_orientations_agree() -> None:
    angle = 0.7
    cosine, sine = np.cos(angle), np.sin(angle)
    wanted = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    half = (float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2)))
    rows: Any = tuple(map(tuple, wanted.tolist()))
    for placement in (
        Placement(angle=angle),
        Placement(axis_angle=(0.0, 0.0, angle)),
        Placement(quaternion=half),
        Placement(matrix=rows),
    ):
        assert np.allclose(orientation_matrix(placement), wanted, atol=1e-15)
    assert np.array_equal(orientation_matrix(None), np.eye(3))
    assert np.array_equal(orientation_matrix(Placement()), np.eye(3))


def test_rotation_vector_turns_about_its_axis() -> None:
    third = 2 * np.pi / 3 / np.sqrt(3)
    matrix = orientation_matrix(Placement(axis_angle=(third, third, third)))
    assert np.allclose(matrix @ np.eye(3), np.roll(np.eye(3), 1, axis=0), atol=1e-15)


def test_vectors_of_the_plane() -> None:
    assert as_3d((1.0, 2.0)).tolist() == [1, 2, 0]
    assert as_3d(None).tolist() == [0, 0, 0]


def test_references() -> None:
    assert marker_reference("crank.pin") == ("crank", "pin")
    assert marker_reference("ground") == ("ground", "")
    assert parse_output("rod.vq12") == ("rod", "", "vq12")
    assert parse_output("rod.pin.ax") == ("rod", "pin", "ax")
    for wrong in ("", ".pin", "crank.", "a.b.c"):
        with pytest.raises(InputError):
            marker_reference(wrong)


SPOILERS = [
    "",
    "-1",
    "nan",
    "inf",
    "1e999",
    "[]",
    "{}",
    '"',
    "'x'",
    "true",
    "\x00",
    "é",
]


@given(
    position=st.floats(0, 1, exclude_max=True),
    removed=st.integers(0, 60),
    inserted=st.sampled_from(SPOILERS),
    spatial_scene=st.booleans(),
)
@settings(max_examples=200, deadline=None)
def test_a_spoiled_scene_is_refused_or_still_a_scene(
    tmp_path_factory: pytest.TempPathFactory,
    position: float,
    removed: int,
    inserted: str,
    spatial_scene: bool,
) -> None:
    """Never anything but a scene or one message."""
    text = SPATIAL if spatial_scene else EXAMPLE.read_text(encoding="utf-8")
    place = int(position * len(text))
    path = tmp_path_factory.getbasetemp() / "spoiled.toml"
    path.unlink(missing_ok=True)  # to shorten a file takes much longer
    path.write_text(text[:place] + inserted + text[place + removed :], encoding="utf-8")
    try:
        scene = read_scene(path)
    except InputError as error:
        assert str(error).startswith(str(path))
    else:
        assert isinstance(scene, SceneFile)


@pytest.mark.parametrize("value", [1e160, -1e300, "10^200"])
@pytest.mark.parametrize("place", ["bodies/rod/initial/position", "gravity"])
def test_numbers_whose_products_overflow_are_refused(place: str, value: Any) -> None:
    """They ended the assembly in a traceback (SVD did not converge)."""
    data = changed(planar(), place, [value, 0.0])
    with pytest.raises(InputError, match="at most 1e\\+50 in size") as error:
        validate_data(data, SceneFile)
    assert place.replace("/", ".") in str(error.value)


def test_a_piece_of_any_length_has_coefficients() -> None:
    """Of a rise of 2 in T, c_k = 2 (10, -15, 6) / T^k."""
    ends = {"start": [0.0] * 3, "end": [2.0, 0.0, 0.0]}
    for T in (2.0, 1e49):
        piece = Piece.checked({"from": -T, "to": 0.0, **ends}, "piece")
        expected = [0.0] * 3 + [20.0 / T**3, -30.0 / T**4, 12.0 / T**5]
        assert np.allclose(coefficients(piece), expected, rtol=1e-9, atol=1e-300)
    piece = Piece.checked(
        {"from": -1e50, "to": 1e50, "start": [0.0] * 4, "end": [2.0, 0.0, 0.0, 0.0]},
        "piece",
    )
    assert np.isfinite(coefficients(piece)).all()
