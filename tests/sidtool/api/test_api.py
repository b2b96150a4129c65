"""The public face: what a script does with sidtool in a few lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sidtool
from tests.places import SLIDER_CRANK


def test_every_public_name_exists() -> None:
    for name in sidtool.__all__:
        assert callable(getattr(sidtool, name))
    with pytest.raises(AttributeError):
        _ = sidtool.nothing


def test_a_sid_from_a_model_is_written_and_read(tmp_path: Path) -> None:
    sid = sidtool.convert(SLIDER_CRANK / "rod_q4.toml")
    sidtool.write(tmp_path / "rod.h5", sid)
    back = sidtool.read(tmp_path / "rod.h5")
    assert np.array_equal(back.Ke.m0, sid.Ke.m0)
    assert not any(check.failed for check in sidtool.validate(back))
    assert sidtool.compare(back, sid, tolerance=1e-9).passed
    assert sidtool.repair(back)[1] == ()


def test_public_functions_stay_functions_after_use() -> None:
    """No submodule may take the name of a public function when it is imported."""
    sidtool.validate(SLIDER_CRANK / "rod_q4.SID_FEM")
    sidtool.convert(SLIDER_CRANK / "rod_q4.toml")
    for name in sidtool.__all__:
        assert callable(getattr(sidtool, name)), name


def test_a_simulation_with_a_sid_from_memory(tmp_path: Path) -> None:
    sid = sidtool.read(SLIDER_CRANK / "rod_iga.SID_FEM")
    result = sidtool.simulate(
        SLIDER_CRANK / "slider_crank.toml", sids={"rod": sid}, rtol=1e-4
    )
    sidtool.write(tmp_path / "r.csv", result)
    sidtool.write(tmp_path / "r.h5", result)
    back = sidtool.read(tmp_path / "r.h5")
    assert np.array_equal(back["piston.x"], result["piston.x"])
    assert (tmp_path / "r.csv").read_text(encoding="utf-8").startswith("t,piston.x,")


def test_wrong_input_names_its_file() -> None:
    with pytest.raises(sidtool.InputError, match=r"none\.toml.*no such file"):
        sidtool.simulate("none.toml")
    with pytest.raises(sidtool.InputError, match=r"rod_q4\.toml"):
        sidtool.simulate(SLIDER_CRANK / "rod_q4.toml")
