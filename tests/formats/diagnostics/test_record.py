"""Diagnostics keep their content in files, in JSON and as warnings of Python."""

import json
import pickle
import warnings
from pathlib import Path

import h5py
import pytest

import sidtool
from sidtool.formats.diagnostics import (
    Diagnostic,
    diagnose,
    each_once,
    from_data,
    plain_text,
    without,
)
from sidtool.formats.diagnostics.hdf5 import read_diagnostics, write_diagnostics
from sidtool.formats.diagnostics.record import warn_of

FOUND = (
    diagnose("N411", "blade", t=1.5, deflection=0.28, limit=0.1),
    diagnose("N329", t=0.25, joints=("pin", "gear"), count=1),
    diagnose(
        "N221",
        changes=("rod by 0.12 m",),
        bodies=("rod",),
        linear=(0.12,),
        angular=(0.0,),
    ),
    plain_text("a note of an older file"),
)


def content(diagnostic: Diagnostic) -> tuple[object, ...]:
    d = diagnostic
    return (d, d.data, d.units, d.t, d.remedy, d.severity)


def test_a_table_of_a_file_holds_all_of_them(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "r.h5", "w") as file:
        write_diagnostics(file, FOUND)
        read = read_diagnostics(file["diagnostics"])
        assert list(map(content, read)) == list(map(content, FOUND))
        file["other"] = [1.0, 2.0]
        with pytest.raises(TypeError):
            read_diagnostics(file["other"])


def test_json_and_pickle_hold_all_of_them() -> None:
    for each in FOUND:
        again = from_data(json.loads(json.dumps(each.as_data())))
        assert content(again) == content(each)
        assert content(pickle.loads(pickle.dumps(each))) == content(each)
    record = FOUND[0].as_data()
    assert record["code"] == "N411" and record["severity"] == "warning"
    assert record["data"]["deflection"] == {"value": 0.28, "unit": "1"}


def test_codes_are_ignored_but_errors_are_not() -> None:
    error = Diagnostic("N411", "error", "no number")
    assert without((*FOUND, error), ["N411"]) == (*FOUND[1:], error)
    assert each_once((*FOUND, *FOUND)) == FOUND


def test_python_filters_them_by_code() -> None:
    with pytest.warns(sidtool.DiagnosticWarning) as caught:
        warn_of(FOUND[0])
    warning = caught[0].message
    assert isinstance(warning, sidtool.DiagnosticWarning)
    assert warning.code == "N411" and warning.data["deflection"] == 0.28
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "N411")
        warn_of(FOUND[0])
