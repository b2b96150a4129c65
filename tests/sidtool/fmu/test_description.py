"""modelDescription.xml: variables, units and structure; FMPy's opinion of units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sidtool.fmu.model_description import base_units, unit_name
from tests.sidtool.fmu.conftest import slider_crank
from tests.sidtool.fmu.importer import Library

UNITS = {
    "N m": ("N.m", {"kg": 1, "m": 2, "s": -2}),
    "m/s\u00b2": ("m/s2", {"m": 1, "s": -2}),
    "kg m\u00b2/s": ("kg.m2/s", {"kg": 1, "m": 2, "s": -1}),
    "N m s/rad": ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
    "W": ("W", {"kg": 1, "m": 2, "s": -3}),
    "1/s": ("1/s", {"s": -1}),
}


@pytest.mark.parametrize("unit", UNITS)
def test_units_are_products_of_base_units(unit: str) -> None:
    name, exponents = UNITS[unit]
    assert unit_name(unit) == name
    known = base_units(unit)
    assert known is not None and {k: n for k, n in known.items() if n} == exponents


def test_unknown_units_are_names_alone() -> None:
    assert base_units("furlong") is None


@pytest.mark.needs("cc")
def test_variables_are_described(slider: Library) -> None:
    """The input with its start value, outputs with units, default experiment."""
    root, is_2 = slider.description, slider.version == "2.0"
    variables = {v.get("name"): v for v in root.find("ModelVariables")}  # type: ignore
    load, acceleration = variables["load"], variables["piston.ax"]
    kind = (load[0], acceleration[0]) if is_2 else (load, acceleration)
    assert load.get("causality") == "input" and float(kind[0].get("start")) == 5.0
    assert kind[0].get("unit") == "N" and kind[1].get("unit") == "m/s2"
    units = {u.get("name"): u[0].attrib for u in root.find("UnitDefinitions")}
    assert units["m/s2"] == {"m": "1", "s": "-2"}
    experiment = root.find("DefaultExperiment")
    assert experiment is not None and float(experiment.get("stopTime", "")) == 0.5
    count = len(slider.outputs)
    structure = root.find("ModelStructure")
    assert structure is not None
    parts = [len(part) for part in structure] if is_2 else [len(structure) // 2] * 2
    assert parts == [count, count]


@pytest.mark.needs("cc", "fmpy")
def test_fmpy_finds_no_problem_and_runs_the_unit(slider: Library, file: Path) -> None:
    """Its validation, and its simulation against a run of sidtool."""
    from fmpy import simulate_fmu
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(file)) == []
    found = simulate_fmu(str(file), step_size=0.01, output_interval=0.01)
    result = slider_crank().simulate()
    assert np.abs(found["piston.x"] - result["piston.x"]).max() < 1e-12
