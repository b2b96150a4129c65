"""Equilibria and natural modes as users have them: tables, units, displays."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import pytest

import sidtool
from sidtool.formats.diagnostics.record import warn_caller

GRAVITY, MASS, LENGTH = 9.81, 2.0, 0.5


@pytest.fixture(scope="module")
def pendulum() -> sidtool.Scene:
    return sidtool.Scene(
        title="A <pendulum>",
        dimension="planar",
        gravity=[0.0, -GRAVITY],
        time=sidtool.Time(end=1.0, output_step=0.1),
        bodies={
            "bob": sidtool.RigidBody(
                mass=MASS,
                inertia=1e-9,
                markers={"pin": {"position": [0.0, LENGTH]}},
                initial={"position": [0.0, -LENGTH]},
            )
        },
        joints={"pin": sidtool.Revolute(markers=["ground", "bob.pin"])},
        outputs=sidtool.Outputs(record=["pin.angle", "pin.fy", "bob.y"]),
    )


def test_an_equilibrium_is_a_table_with_units(pendulum: sidtool.Scene) -> None:
    equilibrium = pendulum.static_equilibrium()
    assert isinstance(equilibrium.result(), sidtool.Result)
    rows = {name: (value, unit) for name, value, unit in equilibrium.rows()}
    assert rows["bob.y"] == (pytest.approx(-LENGTH), "m")
    assert abs(rows["pin.fy"][0]) == pytest.approx(MASS * GRAVITY)
    assert rows["pin.fy"][1] == rows["pin.f2"][1] == "N"
    assert rows["pin.angle"][1] == "rad"
    assert len(repr(equilibrium)) < 80 and "pendulum" in repr(equilibrium)
    page = equilibrium._repr_html_()
    assert "<td>N</td>" in page and "&lt;pendulum&gt;" in page


def test_natural_modes_are_a_table(pendulum: sidtool.Scene) -> None:
    modes = pendulum.linearise()
    hertz = math.sqrt(GRAVITY / LENGTH) / (2 * math.pi)
    assert modes.frequencies == pytest.approx([hertz], rel=1e-6)
    assert repr(modes) == f"<Linearisation: 1 mode, {hertz:.4g} Hz>"
    assert f"<td>{hertz:.6g}</td>" in modes._repr_html_()


def test_tables_of_pandas(pendulum: sidtool.Scene) -> None:
    table = pendulum.static_equilibrium().to_dataframe()
    assert table.loc["bob.y", "value"] == pytest.approx(-LENGTH)
    assert table.loc["bob.y", "unit"] == "m"
    modes = pendulum.linearise().to_dataframe()
    assert list(modes.index) == [1]
    assert modes.attrs["units"]["frequency"] == "Hz"


def test_warnings_name_the_line_of_the_caller(tmp_path: Path) -> None:
    """However deep inside they are: they named lines of sidtool."""
    model = sidtool.Model.load(
        Path(sidtool.__file__).parents[1] / "examples/beam/beam.toml"
    ).with_({"reduction.modes": 1, "material.density": 7.85})
    with warnings.catch_warnings(record=True) as observed:
        warnings.simplefilter("always")
        model.convert()
        warn_caller(UserWarning("here"))
    assert len(observed) > 1
    assert {Path(w.filename).name for w in observed} == {Path(__file__).name}


def test_missing_tables_list_their_types() -> None:
    section = {"shape": "rectangle", "height": 0.1, "width": 0.1}
    ends = {"start": [0, 0, 0], "end": [1, 0, 0]}
    geometry = {"type": "beam", "section": section, **ends}
    with pytest.raises(sidtool.InputError, match="discretisation: is missing") as error:
        sidtool.Model(geometry=geometry)
    assert "q4" in str(error.value.expected) and "iga" in str(error.value.expected)


def test_results_and_states_behave_like_dictionaries(pendulum: sidtool.Scene) -> None:
    result = pendulum.with_({"time.end": 0.1}).simulate()
    assert list(result) == list(result.keys()) == ["pin.angle", "pin.fy", "bob.y"]
    assert len(result) == 3 and "bob.y" in result and "bob.x" not in result
    assert {name: len(column) for name, column in result.items()} == dict.fromkeys(
        result, 2
    )
    assert bool(pendulum.with_({"outputs.record": [], "time.end": 0.1}).simulate())
    equilibrium = pendulum.static_equilibrium()
    assert (
        [name for name, _, _ in equilibrium.rows()]
        == list(equilibrium)
        == list(equilibrium.keys())
    )
    assert len(equilibrium) == len(equilibrium.rows()) and "pin.f2" in equilibrium
    assert equilibrium["bob.y"] == pytest.approx(-LENGTH)
    modes = pendulum.linearise()
    assert "frequency" in modes and len(modes) == len(list(modes))
    assert modes["frequency"] == pytest.approx(modes.frequencies)
    with pytest.raises(sidtool.InputError, match="damping_ratio"):
        modes["frequencies"]


def test_an_equilibrium_answers_every_output(pendulum: sidtool.Scene) -> None:
    """Of a bob that a spring pulls aside: horizontal forces of both are equal."""
    spring = {"type": "spring_damper", "markers": ["ground.wall", "bob"]}
    pulled = pendulum.with_(
        {
            "ground.markers.wall": {"position": [1.0, -LENGTH]},
            "forces.spring": {**spring, "stiffness": 9.0},
        }
    )
    equilibrium = pulled.static_equilibrium()
    result = equilibrium.result()
    assert result["bob.x"][0] > 0.1 and equilibrium["bob.ax"] == pytest.approx(
        0.0, abs=1e-9
    )
    assert equilibrium["pin.fx"] == pytest.approx(-equilibrium["spring.fx"], rel=1e-9)
    length = math.hypot(1.0 - equilibrium["bob.x"], LENGTH + equilibrium["bob.y"])
    assert equilibrium["spring.length"] == pytest.approx(length, rel=1e-12)
    assert equilibrium["spring.force"] == pytest.approx(-9.0 * length, rel=1e-12)
    assert set(result.outputs("pin.*")) >= {"pin.fx", "pin.f1", "pin.torque"}
    with pytest.raises(sidtool.InputError, match="bob"):
        equilibrium["bib.x"]
