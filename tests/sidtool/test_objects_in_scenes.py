"""SIDs and models as objects in scenes, where files name other files."""

from __future__ import annotations

from pathlib import Path

import pytest

import sidtool
from sidtool.formats.base.sid import SID
from tests.places import SLIDER_CRANK

from .models import QM6, rod


@pytest.fixture(scope="module")
def model() -> sidtool.Model:
    return sidtool.Model.checked(rod({**QM6, "elements": [12, 2]}).file_data(), "rod")


@pytest.fixture(scope="module")
def sid(model: sidtool.Model) -> SID:
    return model.convert()


def scene(body: object) -> sidtool.Scene:
    return sidtool.Scene.load(SLIDER_CRANK / "slider_crank.toml").with_(
        {"bodies.rod": body, "time.end": 0.02, "outputs.record": ["piston.x", "rod.q1"]}
    )


MARKERS: dict[str, int | str] = {"crank_pin": 1, "piston_pin": 2}


def test_objects_are_simulated_as_their_files_are(
    model: sidtool.Model, sid: SID, tmp_path: Path
) -> None:
    """In each way: of the body's class, as a table, changed later, compiled."""
    sidtool.write(tmp_path / "rod.SID_FEM", sid)
    file = sidtool.SidBody(sid=str(tmp_path / "rod.SID_FEM"), markers=MARKERS)
    expected = scene(file).simulate()
    of_sid = sidtool.SidBody(sid=sid, markers=MARKERS)
    of_model = sidtool.SidBody(model=model, markers=MARKERS)
    table = {"sid": sid, "markers": MARKERS}
    changed = scene(of_sid).with_({"rod.rigid": False})
    for created in (scene(of_sid), scene(of_model), scene(table), changed):
        result = created.simulate()
        assert result.values == pytest.approx(expected.values, rel=1e-9, abs=1e-12)
        assert result.sids["rod"].nq == sid.nq
    run = scene(of_model).compile().run({"time.end": 0.02})
    assert run.values == pytest.approx(expected.values, rel=1e-9, abs=1e-12)
    assert len(scene(of_sid).linearise()["frequency"])


def test_other_sids_replace_an_object(sid: SID, model: sidtool.Model) -> None:
    created = scene(sidtool.SidBody(sid=sid, markers=MARKERS))
    thick = model.with_({"geometry.thickness": 0.05}).convert()
    run = created.simulate(sids={"rod": thick})
    assert run.sids["rod"].mass == thick.mass != sid.mass


def test_a_result_with_an_object_is_whole(sid: SID, tmp_path: Path) -> None:
    run = scene(sidtool.SidBody(sid=sid, markers=MARKERS)).simulate()
    run.save(tmp_path / "run.h5")
    again = sidtool.read(tmp_path / "run.h5")
    assert again["rod.crank_pin.x"] == pytest.approx(run["rod.crank_pin.x"])


def test_a_scene_with_an_object_is_not_saved(sid: SID, tmp_path: Path) -> None:
    created = scene(sidtool.SidBody(sid=sid, markers=MARKERS))
    with pytest.raises(sidtool.InputError, match="given as an object") as caught:
        created.save(tmp_path / "scene.toml")
    assert caught.value.place == "bodies.rod.sid"
    assert not (tmp_path / "scene.toml").exists()
