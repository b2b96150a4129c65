"""Formulas where numbers stand, changes by dotted keys, and what `save` writes."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.expressions import evaluate_number
from sidtool.formats.toml.files import parse_settings
from sidtool.formats.toml.tables import toml_text
from tests.places import EXAMPLES

SCENE = """
format = "sidtool scene"
version = 1
dimension = "planar"

[parameters]
n = 3
m = "2*n"
length = 0.5

[time]
end = "m/n"
output_step = 0.1

[bodies.rod]
mass = "m*length"
inertia = "m*length**3/12"
centre_of_mass = ["length/2", 0.0]
markers.tip = { position = ["length", "-length*0"] }

[joints.pin]
type = "revolute"
markers = ["ground", "rod"]

[drives.turn]
joint = "pin"
function.type = "polynomial"
function.pieces = [{ from = 0, coefficients = [0, "2*pi*n"] }]

[forces.push]
type = "actuator"
joint = "pin"
function = { type = "expression", value = "-n*pin.angle", parameters = { k = "m^2" } }

[outputs]
record = ["rod.x"]
"""


def written(folder: Path, text: str = SCENE) -> Path:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_formulas_are_the_numbers_that_they_stand_for(tmp_path: Path) -> None:
    scene = SceneFile.load(written(tmp_path))
    rod: Any = scene.bodies["rod"]
    assert (rod.mass, rod.inertia) == (3.0, 6 * 0.5**3 / 12)
    assert rod.centre_of_mass == (0.25, 0.0) and scene.time.end == 2.0
    drive: Any = scene.drives["turn"].function
    assert drive.pieces[0].coefficients[1] == 2 * math.pi * 3
    law: Any = scene.forces["push"].function  # type: ignore[union-attr]
    assert law.known == {"n": 3, "m": 6, "length": 0.5, "k": 36}
    assert law.value == "-n*pin.angle"


def test_changed_parameters_change_all_that_follows(tmp_path: Path) -> None:
    scene = SceneFile.load(written(tmp_path))
    other = scene.with_({"parameters.n": 5, "n": 4, "rod.mass": 7.5})
    assert other.parameters == {"n": 4, "m": 8, "length": 0.5}
    assert other.bodies["rod"].mass == 7.5  # type: ignore[union-attr]
    assert other.bodies["rod"].inertia == 8 * 0.5**3 / 12  # type: ignore[union-attr]
    assert scene.parameters["n"] == 3
    piece = "drives.turn.function.pieces[0].coefficients[1]"
    drive: Any = scene.with_({piece: "n"}).drives["turn"].function
    assert drive.pieces[0].coefficients == (0, 3)


def test_formulas_where_one_number_stands_for_a_list(tmp_path: Path) -> None:
    """They were refused there: `stiffness = "10*n"`, `ratio = "n/100"`."""
    more = """
[bodies.boom]
sid = "boom.SID_FEM"
damping = { type = "modal", ratio = "n/100" }

[forces.spring]
type = "spring_damper"
joint = "pin"
stiffness = "10*n"
damping = ["n", 0, "2*n"]
"""
    scene = SceneFile.load(written(tmp_path, SCENE + more))
    for n, found in ((3, scene), (5, scene.with_({"n": 5}))):
        spring: Any = found.forces["spring"]
        assert spring.stiffness == (10.0 * n,)
        assert spring.damping == (n, 0, 2 * n)
        damping: Any = found.bodies["boom"].damping  # type: ignore[union-attr]
        assert damping.ratio == (n / 100,)
    scene.save(tmp_path / "same.toml")
    assert SceneFile.load(tmp_path / "same.toml") == scene
    with pytest.raises(InputError, match="spring.stiffness.*a number, or a formula"):
        scene.with_({"spring.stiffness": "10*unknown"})


def test_saved_files_keep_formulas_that_still_hold(tmp_path: Path) -> None:
    scene = SceneFile.load(written(tmp_path))
    scene.save(tmp_path / "same.toml")
    assert tomllib.loads(
        (tmp_path / "same.toml").read_text(encoding="utf-8")
    ) == tomllib.loads(SCENE)
    assert SceneFile.load(tmp_path / "same.toml") == scene
    by_hand = scene.model_copy(update={"parameters": {"n": 3.0, "m": 1.0}})
    data = by_hand.file_data()
    assert data["bodies"]["rod"]["mass"] == 3.0
    assert data["time"]["end"] == 2.0


@pytest.mark.parametrize("path", sorted(EXAMPLES.rglob("*.toml")), ids=str)
def test_examples_are_the_same_after_saving(path: Path, tmp_path: Path) -> None:
    kind = tomllib.loads(path.read_text(encoding="utf-8"))["format"]
    if kind in ("sidtool reference", "sidtool design"):
        pytest.skip("is read only")
    file = SceneFile if kind == "sidtool scene" else ModelFile
    read = file.load(path)
    read.save(tmp_path / "other.toml")
    again = file.load(tmp_path / "other.toml")
    for body in getattr(read, "flexible", ()):
        bodies = [s.bodies[body] for s in (read, again)]
        files = [each.sid or each.model for each in bodies]
        one, other = (s.folder / f for s, f in zip((read, again), files, strict=True))
        assert one.resolve() == other.resolve()
    same = read.file_data() | {"bodies": None}
    assert same == again.file_data() | {"bodies": None}


def test_models_count_by_formulas() -> None:
    model = ModelFile.load(EXAMPLES / "slider_crank" / "rod_q4.toml")
    made = model.with_(
        {
            "parameters": {"n": 4},
            "discretisation.elements": ["n*10", "n"],
            "geometry.thickness": "0.01*n",
            "reduction.modes": "n - 1",
            "markers.crank_pin.node": "n",
        }
    )
    assert made.discretisation.elements == (40, 4)  # type: ignore[union-attr]
    assert type(made.reduction.modes) is int  # type: ignore[union-attr]
    assert made.geometry.thickness == 0.04  # type: ignore[union-attr]
    with pytest.raises(InputError, match=r"modes.*'n/3' gives 1.33.*whole"):
        made.with_({"reduction.modes": "n/3"})


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"rod.mass": "2*q"}, r"bodies.rod.mass: found '2\*q'.*reads 'q'.*n, m, leng"),
        ({"rod.mass": "5 kg"}, "bodies.rod.mass: found '5 kg'; expected a number, or"),
        ({"rod.mass": "1/(n-3)"}, "bodies.rod.mass: .*no finite value"),
        ({"rod.mass": "sqrt(-n)"}, "bodies.rod.mass: .*no finite value"),
        ({"rod.mass": "(-n)**0.5"}, "bodies.rod.mass: .*no finite value"),
        ({"rod.mass": "t"}, "bodies.rod.mass: .*reads 't'"),
        ({"rod.mass": "-n"}, "bodies.rod.mass: found -3.0, which is '-n'; .*greater"),
        ({"m": "x"}, "parameters.m: found 'x'"),
        ({"parameters": {"a": "b", "b": 1}}, "parameters.a: found 'b'"),
        ({"rood.mass": 1}, "rood.mass: there is nothing named 'rood'; expected rod"),
        ({"rod.mas": 1}, "bodies.rod.mas: is not a known key; expected mass"),
        ({"time.end.x": 1}, "time.end.x: is not there"),
        ({"outputs.record[4]": "rod.y"}, "record.4.: is not there"),
        ({"time..end": 1}, "'time..end' is no key"),
    ],
)
def test_what_does_not_fit_is_told_with_its_key(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    path = written(tmp_path)
    with pytest.raises(InputError, match=message):
        SceneFile.load(path).with_(changes)
    with pytest.raises(InputError, match=message) as told:
        SceneFile.load(path, changes)
    assert told.value.source == str(path)


def test_settings_of_the_command_line() -> None:
    given = ["a.b=2", "c = [1, 2]", "d=2*n", "e=radau5", "f=true", "g='2'"]
    assert parse_settings(given) == {
        "a.b": 2,
        "c": [1, 2],
        "d": "2*n",
        "e": "radau5",
        "f": True,
        "g": "2",
    }
    for wrong in ("a", "=2", "a="):
        with pytest.raises(InputError, match="KEY=VALUE"):
            parse_settings([wrong])


@pytest.mark.parametrize(
    "text, value",
    [
        ("2*pi*n", 2 * math.pi * 6),
        ("-n**2 + 2^3^2", -36 + 512),
        ("atan2(1, -1) - clip(7, 0, n)", math.atan2(1, -1) - 6),
        ("max(1, n, 2) / min(4, 3)", 2.0),
        ("abs(-n) * sign(-2) + log(exp(1))", -5.0),
    ],
)
def test_numbers_of_formulas(text: str, value: float) -> None:
    assert evaluate_number(text, {"n": 6.0}) == pytest.approx(value, rel=1e-14)


def test_texts_of_all_kinds_come_back_from_toml() -> None:
    odd = 'quote " back \\ tab \t del \x7f line \n umlaut \u00fc end'
    data = {
        "plain": odd,
        "with.dot": 1e-300,
        "": -0.0,
        "yes": True,
        "numbers": [[0.1 + 0.2, 1e22], [-(2**62)]],
        "long": [{"from": float(k), "name": odd} for k in range(9)],
        "table": {"empty": {}, "deep": {"deeper": {"deepest": {"a b": [1]}}}},
    }
    assert tomllib.loads(toml_text(data)) == data
