"""Signals from files, and tables that formulas look up."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose

import sidtool
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.units import parse_unit, split_unit
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.formats.scene.signal_files import read_columns
from sidtool.formats.toml.reading import validate_data
from sidtool.formats.toml.tables import toml_text

T = np.linspace(0.0, 1.0, 41)
Z = 0.1 * np.sin(6.0 * T)


def cart(function: Any = None, **tables: Any) -> dict[str, Any]:
    """A cart on a rail, driven or pushed, with a second one behind a force."""
    data: dict[str, Any] = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": 1.0, "output_step": 0.05},
        "accuracy": {"rtol": 1e-8},
        "bodies": {
            "a": {"mass": 2.0, "inertia": 0.1},
            "b": {
                "mass": 1.0,
                "inertia": 0.1,
                "initial": {"position": [0.3, 0.0], "velocity": [1.5, 0.0]},
            },
        },
        "joints": {
            "ra": {"type": "prismatic", "markers": ["ground", "a"]},
            "rb": {"type": "prismatic", "markers": ["ground", "b"]},
        },
        "outputs": {"record": ["ra.displacement", "rb.displacement"]},
    }
    if function is not None:
        data["drives"] = {"road": {"joint": "ra", "function": function}}
    return data | tables


def simulated(data: dict[str, Any]) -> Result:
    return sidtool.simulate(validate_data(data, SceneFile))


def formula(value: str, **tables: Any) -> dict[str, Any]:
    force = {
        "type": "actuator",
        "joint": "rb",
        "function": {"type": "expression", "value": value},
    }
    record = ["rb.displacement", "pull.value"]
    forces = {"pull": force}
    return cart(forces=forces, outputs={"record": record}, tables=tables)


def test_a_file_is_the_table_of_its_numbers(tmp_path: Path) -> None:
    """Beside the scene, and the result needs it no more."""
    table = np.column_stack([T, Z * 1000, T])
    np.savetxt(
        tmp_path / "road.csv", table, "%.17g", ",", header="t [s],z [mm],w", comments=""
    )
    function = {"type": "table", "file": "road.csv", "time": "t", "value": "z"}
    path = tmp_path / "scene.toml"
    path.write_text(toml_text(cart(function | {"scale": 1e-3})), encoding="utf-8")
    scene = read_scene(path)
    (tmp_path / "road.csv").unlink()
    result = sidtool.simulate(scene)
    inline = {
        "type": "table",
        "times": T.tolist(),
        "values": (Z * 1000 * 1e-3).tolist(),
    }
    assert_allclose(result.values, simulated(cart(inline)).values, atol=1e-15)
    assert_allclose(result["ra.displacement"], 0.1 * np.sin(6 * result.t), atol=1e-6)
    later = sidtool.outputs(result, "a.vx")["a.vx"]
    assert_allclose(later, 0.6 * np.cos(6 * result.t), atol=1e-3)


def test_held_linear_and_smooth(tmp_path: Path) -> None:
    """A force over time; held values are those of the last time before."""
    np.savetxt(tmp_path / "f.csv", np.column_stack([T, Z]), "%.17g", ",")
    for interpolation, expected in (
        ("hold", lambda t: Z[np.searchsorted(T, t, side="right") - 1]),
        ("linear", lambda t: np.interp(t, T, Z)),
        ("smooth", lambda t: 0.1 * np.sin(6 * t)),
    ):
        function = {"type": "table", "file": str(tmp_path / "f.csv")}
        function["interpolation"] = interpolation
        pull = {"type": "actuator", "joint": "rb", "function": function}
        data = cart(forces={"pull": pull}, outputs={"record": ["pull.value"]})
        data["time"]["output_step"] = 0.0125
        result = simulated(data)
        between = slice(1, -1, 2)  # a jump itself belongs to both sides
        found, t = result["pull.value"][between], result.t[between]
        assert_allclose(found, expected(t), atol=1e-6)
    with pytest.raises(InputError, match="jumps"):
        simulated(
            cart(
                {
                    "type": "table",
                    "file": str(tmp_path / "f.csv"),
                    "interpolation": "hold",
                }
            )
        )


def test_inputs_take_files(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "f.csv", np.column_stack([T, Z]), "%.17g", ",")
    signal = {"file": str(tmp_path / "f.csv"), "interpolation": "linear"}
    pull = {
        "type": "actuator",
        "joint": "rb",
        "function": {"type": "input", "name": "u"},
    }
    result = simulated(
        cart(
            inputs={"u": signal},
            forces={"pull": pull},
            outputs={"record": ["inputs.u"]},
        )
    )
    assert_allclose(result["inputs.u"], np.interp(result.t, T, Z), atol=1e-12)


def test_columns_of_files(tmp_path: Path) -> None:
    """Separators, headers with units, numbers, HDF5, and results of sidtool."""
    file = tmp_path / "a.csv"
    for text in ("t;z [m]\n0;1\n1;2\n", "# comment\nt\tz (m)\n0\t1\n\n1\t2\n"):
        file.write_text(text, encoding="utf-8")
        found = read_columns(file, ["t", "z"])
        assert found == [((0.0, 1.0), ""), ((1.0, 2.0), "m")]
    file.write_text("t,z\n0,1,\n1,2,\n", encoding="utf-8")
    assert read_columns(file, ["z"])[0].values == (1.0, 2.0)
    file.write_text("0 5 1\n1 5 2\n", encoding="utf-8")
    assert read_columns(file, [None, 3]) == [((0.0, 1.0), ""), ((1.0, 2.0), "")]
    with h5py.File(tmp_path / "a.h5", "w") as stored:
        stored["run/t"], stored["run/z"] = [0.0, 1.0], [1.0, 2.0]
    assert read_columns(tmp_path / "a.h5", ["run/t", "run/z"])[1].values == (1.0, 2.0)
    result = simulated(cart())
    sidtool.write(tmp_path / "r.h5", result)
    t, x = read_columns(tmp_path / "r.h5", [None, "rb.displacement"])
    assert t.values == tuple(result.t)
    assert x.values == tuple(result["rb.displacement"])


@pytest.mark.parametrize(
    ("head", "per_second", "per_metre"),
    [
        ("t [ms],z [mm]", 1e3, 1e3),
        ("t (s),z (m)", 1.0, 1.0),
        ("t [min],z [in]", 1.0 / 60.0, 1.0 / 0.0254),
        ("t,z", 1.0, 1.0),
        ("t [\u00b5s],z [cm]", 1e6, 1e2),
        ("t [ms] z [mm]", 1e3, 1e3),
        ("t(ms)   z(mm)", 1e3, 1e3),
    ],
)
def test_columns_are_in_the_units_of_their_header(
    head: str, per_second: float, per_metre: float, tmp_path: Path
) -> None:
    """The same motion, 0.1 sin(6 t) in m and s; the drive does not know of its file."""
    table = np.column_stack([T * per_second, Z * per_metre])
    np.savetxt(
        tmp_path / "road.csv",
        table,
        "%.17g",
        "," if "," in head else " ",
        header=head,
        comments="",
        encoding="utf-8",
    )
    function = {"type": "table", "file": str(tmp_path / "road.csv")}
    result = simulated(cart(function))
    assert_allclose(result["ra.displacement"], 0.1 * np.sin(6 * result.t), atol=1e-6)


def test_datasets_are_in_the_units_of_their_attributes(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "road.h5", "w") as stored:
        stored["t"], stored["z"] = 1e3 * T, 1e3 * Z
        stored["t"].attrs["units"], stored["z"].attrs["unit"] = "ms", np.bytes_("mm")
    function = {"type": "table", "file": str(tmp_path / "road.h5")}
    result = simulated(cart(function | {"time": "t", "value": "z"}))
    assert_allclose(result["ra.displacement"], 0.1 * np.sin(6 * result.t), atol=1e-6)


def test_lookups_are_in_the_units_of_their_header(tmp_path: Path) -> None:
    """A damper by its data sheet: kN over mm/s."""
    file = tmp_path / "damper.csv"
    file.write_text("v [mm/s],f [kN]\n-2000,-0.004\n2000,0.004\n", encoding="utf-8")
    table = {"file": str(file), "x": "v", "values": "f"}
    found = simulated(formula("-lookup(d, rb.displacement_rate)", d=table))
    damping = 2.0  # N s/m, mass 1 kg, from 0.3 m with 1.5 m/s
    exact = 0.3 + 1.5 / damping * (1.0 - np.exp(-damping * found.t))
    assert_allclose(found["rb.displacement"], exact, atol=1e-6)


@pytest.mark.parametrize(
    ("unit", "head", "values"),
    [("N", "t [ms],f [kN]", [2000.0, 5000.0]), ("V", "t [ms],u [V]", [2.0, 5.0])],
)
def test_inputs_are_in_their_own_unit(
    unit: str, head: str, values: list[float], tmp_path: Path
) -> None:
    file = tmp_path / "f.csv"
    file.write_text(f"{head}\n0,2\n500,5\n", encoding="utf-8")
    inputs = {"u": {"unit": unit, "file": str(file)}}
    record = {"record": ["inputs.u"]}
    result = simulated(cart(inputs=inputs, outputs=record))
    middle = result.t < 0.5 - 1e-9
    assert_allclose(result["inputs.u"][middle], values[0])
    assert_allclose(result["inputs.u"][result.t > 0.5 + 1e-9], values[1])


@pytest.mark.parametrize(
    ("unit", "factor", "dimension"),
    [
        ("N m s", 1.0, "kg m^2/s"),
        ("Nms/rad", 1.0, "kg m^2/(s rad)"),
        ("m s", 1.0, "s m"),
        ("kNm", 1e3, "J"),
        ("mNm", 1e-3, "J"),
        ("N/(mm/s)", 1e3, "kg/s"),
        ("kN/(m/ms)", 1.0, "kg/s"),
        ("N/(mm s)", 1e3, "Pa m/s"),
        ("rev/min", 2 * np.pi / 60, "rad/s"),
        ("1/ms", 1e3, "Hz"),
    ],
)
def test_units_of_several_factors(unit: str, factor: float, dimension: str) -> None:
    """Blanks separate, parentheses group: m s is no millisecond."""
    found, same = parse_unit(unit), parse_unit(dimension)
    assert found and same and found.exponents == same.exponents
    assert found.factor == pytest.approx(factor, rel=1e-14)
    for head in (f"c [{unit}]", f"c ({unit}) "):
        assert split_unit(head) == ("c", unit)


def test_parentheses_of_units_are_in_pairs() -> None:
    assert [parse_unit(text) for text in ("N/(m", "N/m)", "()")] == [None] * 3


@pytest.mark.parametrize(
    ("head", "column"),
    [
        ("t [mm],z", "times"),
        ("t,z [g]", "values"),
        ("t [s],z [min]", "values"),
        ("t,z [1/min]", "values"),
    ],
)
def test_units_that_do_not_fit_are_refused(
    head: str, column: str, tmp_path: Path
) -> None:
    """Times are times; g is a mass and gravity, 1/min a frequency and a speed. A scale
    says what the values are.
    """
    file = tmp_path / "a.csv"
    file.write_text(f"{head}\n0,1\n1,2\n", encoding="utf-8")
    function = {"type": "table", "file": str(file)}
    with pytest.raises(InputError) as caught:
        validate_data(cart(function), SceneFile)
    assert caught.value.place == f"the column of {column}"
    if "mm" not in head:
        scene = validate_data(cart(function | {"scale": 0.5}), SceneFile)
        assert scene.drives["road"].function.values == (0.5, 1.0)


@pytest.mark.parametrize(
    ("unit", "taken"),
    [
        ("kN", "m"),
        ("deg", "m"),
        ("m/s", "m"),
        ("mm", ""),
        ("furlong", ""),
    ],
)
def test_a_drive_takes_the_dimension_of_its_coordinate(
    unit: str, taken: str, tmp_path: Path
) -> None:
    """Where values would be metres, a file of other units is refused."""
    file = tmp_path / "f.csv"
    file.write_text(f"t [s],f [{unit}]\n0,0\n0.5,1\n1,0\n", encoding="utf-8")
    table = {"type": "table", "file": str(file)}
    inputs = {"u": {"file": str(file), "interpolation": "smooth"}}
    for place, data in {
        "drives.road.function.file": cart(table),
        "drives.road.function.parts[0].file": cart({"type": "sum", "parts": [table]}),
        "inputs.u.file": cart({"type": "input", "name": "u"}, inputs=inputs),
    }.items():
        if not taken:
            validate_data(data, SceneFile)
            continue
        with pytest.raises(InputError) as caught:
            validate_data(data, SceneFile)
        assert caught.value.place == place
    scaled = cart(table | {"scale": 1e-3})
    validate_data(scaled, SceneFile)


@pytest.mark.parametrize(("of", "unit"), [("rate", "m/s"), ("acceleration", "m/s^2")])
def test_a_drive_of_a_rate_takes_a_velocity(of: str, unit: str, tmp_path: Path) -> None:
    file = tmp_path / "f.csv"
    for column, fits in ((unit, True), ("m", False), ("kN", False)):
        file.write_text(f"t [s],f [{column}]\n0,0\n1,1\n", encoding="utf-8")
        data = cart({"type": "table", "file": str(file)})
        data["drives"]["road"]["of"] = of
        if fits:
            validate_data(data, SceneFile)
        else:
            with pytest.raises(InputError) as caught:
                validate_data(data, SceneFile)
            assert caught.value.place == "drives.road.function.file"


def pushed(unit: str, **changes: Any) -> dict[str, Any]:
    """A cart that an input pushes alone."""
    function = {"type": "input", "name": "u"}
    push = {"type": "actuator", "joint": "rb", "function": function} | changes
    return cart(inputs={"u": {"initial": 2.0, "unit": unit}}, forces={"push": push})


@pytest.mark.parametrize(
    ("unit", "factor"), [(None, 1.0), ("N", 1.0), ("kN", 1e-3), ("mm", 0.0), ("V", 0.0)]
)
def test_outputs_of_a_result_have_their_unit(
    unit: str | None, factor: float, tmp_path: Path
) -> None:
    """A recorded force is converted to the unit of an input, or refused."""
    pushing = pushed("N") | {"outputs": {"record": ["push.force"]}}
    sidtool.write(tmp_path / "r.h5", simulated(pushing))
    table = {"unit": unit, "file": str(tmp_path / "r.h5"), "value": "push.force"}
    data = formula("u") | {"inputs": {"u": {k: v for k, v in table.items() if v}}}
    if factor:
        scene = validate_data(data, SceneFile)
        assert_allclose(scene.inputs["u"].values, 2.0 * factor)
    else:
        with pytest.raises(InputError) as caught:
            validate_data(data, SceneFile)
        assert caught.value.place == "the column of values"
    drive = cart({"type": "table", "file": table["file"], "value": "push.force"})
    with pytest.raises(InputError) as caught:
        validate_data(drive, SceneFile)
    assert caught.value.place == "drives.road.function.file"


def test_an_input_has_the_unit_of_what_takes_it() -> None:
    """2 kN would act as 2 N: refused; a formula may convert, and a vector of 1 kN."""
    assert simulated(pushed("N"))["push.force"][-1] == 2.0
    assert simulated(pushed("V"))["push.force"][-1] == 2.0
    for unit in ("kN", "N m", "mm"):
        with pytest.raises(InputError, match="takes N, not"):
            validate_data(pushed(unit), SceneFile)
    formula_ = {"type": "expression", "value": "1000*u"}
    assert simulated(pushed("kN", function=formula_))["push.force"][-1] == 2000.0
    point = pushed("kN")
    force = {"type": "force", "marker": "b", "function": {"type": "input", "name": "u"}}
    point["forces"]["push"] = force | {"force": [1.0, 0.0]}
    with pytest.raises(InputError, match="SI unit"):
        validate_data(point, SceneFile)
    point["forces"]["push"] = force | {"force": [1000.0, 0.0]}
    assert_allclose(simulated(point)["push.fx"][-1], 2000.0)
    drive = {"joint": "ra", "of": "acceleration", "function": force["function"]}
    for unit, fits in (("m/s^2", True), ("m/s\u00b2", True), ("mm/s^2", False)):
        data = cart(inputs={"u": {"unit": unit}}, drives={"servo": drive})
        if fits:
            validate_data(data, SceneFile)
        else:
            with pytest.raises(InputError, match="takes m/s"):
                validate_data(data, SceneFile)


@pytest.mark.parametrize(
    ("text", "value", "expected"),
    [
        ("t,z\n0,1\n1,2\n", "zz", "has not column 'zz'; expected z"),
        ("t,z\n0,1\n1,x\n", "z", "line 3: found '1 x'; expected a number in column 2"),
        ("t,z\n0,1\n1\n", "z", "line 3: found '1'; expected a number in column 2"),
        ("0,1\n1,2\n", 3, "has not column 3; expected 1 to 2"),
        ("t,z [m],z [mm]\n0,1,1\n1,2,2\n", "z", "has 2 columns 'z'; expected one"),
        ("t,z\n0,1\n0,5,1,2\n", "z", "line 3: found 4 cells; expected 2"),
        ("t,z\n0,1\n1,1,234.5\n", "z", "line 3: found 3 cells; expected 2"),
        ("# nothing\n", "z", "holds no values"),
    ],
)
def test_files_without_the_column(
    tmp_path: Path, text: str, value: Any, expected: str
) -> None:
    file = tmp_path / "a.csv"
    file.write_text(text, encoding="utf-8")
    function = {"type": "table", "file": str(file), "value": value}
    with pytest.raises(InputError) as caught:
        validate_data(cart(function), SceneFile)
    assert str(caught.value).startswith(f"{file}: {expected}")


def test_a_table_of_one_variable_is_its_formula() -> None:
    """A spring that stiffens in steps of slope; beyond the table its end holds."""
    table = {"x": [-1.0, 0.0, 0.2, 0.5], "values": [4.0, 10.0, 30.0, 35.0]}
    looked_up = simulated(
        formula("-lookup(k, rb.displacement)*rb.displacement", k=table)
    )
    x = "clip(rb.displacement, -1, 0.5)"
    pieces = f"10 + 6*min({x}, 0) + 100*clip({x}, 0, 0.2) + 50/3*max({x} - 0.2, 0)"
    written = simulated(formula(f"-({pieces})*rb.displacement"))
    assert np.ptp(looked_up["rb.displacement"]) > 0.5
    assert_allclose(looked_up.values, written.values, atol=1e-6)


def test_a_table_of_two_variables_is_bilinear(tmp_path: Path) -> None:
    """From a file with one row for each point, in any order."""
    rows = [
        (x, v, 20 + 8 * x + 3 * v + 2 * x * v)
        for v in (-9.0, 0.0, 9.0)
        for x in (4.0, -4.0)
    ]
    np.savetxt(tmp_path / "k.csv", rows, "%.17g", ",", header="x,v,k", comments="")
    table = {"file": str(tmp_path / "k.csv"), "x": "x", "y": "v", "values": "k"}
    x, v = "rb.displacement", "rb.displacement_rate"
    looked_up = simulated(formula(f"-lookup(k, {x}, {v})*{x}", k=table))
    written = simulated(formula(f"-(20 + 8*{x} + 3*{v} + 2*{x}*{v})*{x}"))
    assert_allclose(looked_up.values, written.values, atol=1e-7)


@pytest.mark.parametrize("about", ["start", "static"])
def test_equations_linearised_with_tables(about: str) -> None:
    """Slopes of tables are in the state matrix; a static equilibrium reads tables where
    its variables are.
    """
    pulled = {
        "one": ("-lookup(k, rb.displacement)", "-(2 + 7*rb.displacement)"),
        "two": (
            "-lookup(g, rb.displacement, rb.displacement_rate)",
            "-(2 + 7*rb.displacement + 3*rb.displacement_rate)",
        ),
    }
    k = {"x": [-1.0, 1.0], "values": [-5.0, 9.0]}
    g = {"x": [-2.0, 2.0], "y": [-9.0, 9.0], "values": [[-39.0, 15.0], [-11.0, 43.0]]}
    for table, written in pulled.values():
        matrices = []
        for text in (table, written):
            data = formula(text, k=k, g=g)
            data["bodies"]["b"]["initial"] = {"position": [-2.0 / 7.0, 0.0]}
            scene = validate_data(data, SceneFile)
            matrices.append(sidtool.linearise(scene, about=about).eigenvalues)
        assert_allclose(matrices[0], matrices[1], atol=1e-6)


def test_drives_follow_smooth_tables() -> None:
    """A cam: the lift over an angle that grows with time, by value and derivatives."""
    angle = np.linspace(-1.0, 7.0, 81)
    cam = {"x": angle.tolist(), "values": (0.1 * np.sin(angle)).tolist()}
    law = {"type": "expression", "value": "lookup(cam, 6*t)"}
    smooth = cam | {"interpolation": "smooth"}
    data = cart(law, tables={"cam": smooth})
    data["outputs"]["record"] += ["a.vx", "a.ax"]
    result = simulated(data)
    t = result.t
    assert_allclose(result["ra.displacement"], 0.1 * np.sin(6 * t), atol=1e-6)
    assert_allclose(result["a.vx"], 0.6 * np.cos(6 * t), atol=1e-4)
    assert_allclose(result["a.ax"], -3.6 * np.sin(6 * t), atol=1e-2)
    for wrong in ({"cam": cam}, {"cam": cam | {"interpolation": "hold"}}):
        with pytest.raises(InputError, match="the table cam"):
            simulated(cart(law, tables=wrong))


@pytest.mark.parametrize(
    ("value", "table", "expected"),
    [
        ("lookup(kk, t)", {}, "there is no table 'kk'; expected an existing table"),
        ("lookup(k, t, t)", {}, "lookup(k, ...) has 2 variables; expected 1"),
        ("lookup(k)", {}, "expected a variable behind the table of lookup"),
        ("lookup(3, t)", {}, "expected the name of a table"),
        ("lookup(k, t)", {"x": [0.0, 0.0]}, "tables.k.x: does not grow"),
        (
            "lookup(k, t)",
            {"values": [1.0]},
            "tables.k.values: has 1 numbers; expected 2",
        ),
        ("lookup(k, t)", {"x": "speed"}, "tables.k.x: names a column without a file"),
    ],
)
def test_lookups_that_are_not_sound(
    value: str, table: dict[str, Any], expected: str
) -> None:
    k = {"x": [0.0, 1.0], "values": [1.0, 2.0]} | table
    with pytest.raises(InputError) as caught:
        validate_data(formula(value, k=k), SceneFile)
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("lookup(k, n)", 2.25),
        ("2*lookup(k, 10) + 1", 7.0),
        ("lookup(steps, n)", 2.0),
        ("lookup(steps, 3)", 3.0),
        ("lookup(grid, n, 0.25)", 1.5 + 2 * 0.25 + 4 * 1.5 * 0.25),
    ],
)
def test_numbers_of_a_scene_look_up_tables(
    text: str, expected: float, tmp_path: Path
) -> None:
    """At parameters, which they follow; the file keeps the formula."""
    line = {"x": [0.0, 1.0, 3.0], "values": [1.0, "2*n - 1", 3.0]}
    x, y = np.array([1.0, 2.0]), np.array([0.0, 1.0])
    grid = x[:, None] + 2.0 * y + 4.0 * x[:, None] * y
    data = formula(
        "t",
        k=line,
        steps=line | {"interpolation": "hold"},
        grid={"x": [1.0, 2.0], "y": [0.0, 1.0], "values": grid.tolist()},
    )
    data["parameters"] = {"n": 1.5}
    data["bodies"]["a"]["mass"] = text
    scene = validate_data(data, SceneFile)
    assert_allclose(scene.bodies["a"].mass, expected)
    read = sidtool.Scene.checked(data, "test")
    read.save(tmp_path / "s.toml")
    assert text in (tmp_path / "s.toml").read_text(encoding="utf-8")
    changed = read.with_({"parameters.n": 1.0})
    assert text != "lookup(k, n)" or changed.bodies["a"].mass == 1.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("lookup(none, 1)", "a table out of k"),
        ("lookup(k, 1, 2)", "over 2 of 1 variables"),
        ("lookup(k, 0.5)", "a smooth table"),
    ],
)
def test_lookups_of_numbers_that_are_not_sound(text: str, expected: str) -> None:
    k = {"x": [0.0, 1.0], "values": [1.0, 2.0], "interpolation": "smooth"}
    data = formula("t", k=k)
    data["bodies"]["a"]["mass"] = text
    with pytest.raises(InputError, match=expected):
        validate_data(data, SceneFile)


@pytest.mark.parametrize(
    ("head", "n", "expected"),
    [
        ("x,k [kgf/mm]", 1.5, ["N245"]),
        ("x [furlong],k [N/mm]", 1.5, ["N245"]),
        ("x [-],k [N/mm]", 2.5, ["N246"]),
        ("x [1],k", 0.5, ["N246"]),
        ("x,k [N/mm]", 1.5, []),
        ("x,k [N/mm]", np.nextafter(2.0, 3.0), []),  # its end, but for rounding
    ],
)
def test_numbers_that_a_table_may_not_mean_are_warned_of(
    head: str, n: float, expected: list[str], tmp_path: Path
) -> None:
    """An unknown unit, and a parameter outside of the table."""
    file = tmp_path / "k.csv"
    file.write_text(f"{head}\n1,3\n2,5\n", encoding="utf-8")
    data = formula("t", k={"file": str(file), "x": "x", "values": "k"})
    data["parameters"] = {"n": n}
    data["bodies"]["a"]["mass"] = "lookup(k, n)"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        validate_data(data, SceneFile)
    found = {each.message.code for each in caught}
    assert sorted(found) == expected


def test_a_scene_with_a_file_is_itself_after_saving(tmp_path: Path) -> None:
    """Numbers are saved in SI units, without the unit of their file."""
    file = tmp_path / "z.csv"
    file.write_text("t [s],z [mm]\n0,3\n1,5\n2,6\n", encoding="utf-8")
    signal = {"type": "table", "file": str(file), "time": "t", "value": "z"}
    scene = sidtool.Scene.checked(cart(signal), "test")
    scene.save(tmp_path / "s.toml")
    assert "[mm]" not in (tmp_path / "s.toml").read_text(encoding="utf-8")
    assert sidtool.Scene.load(tmp_path / "s.toml") == scene
