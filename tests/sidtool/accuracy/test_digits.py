"""What the digits of a SID file leave open, against the body with all digits."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.accuracy import sid_rounding
from sidtool.accuracy.reference_run import make_reference
from sidtool.accuracy.sid_rounding import (
    NumberFormat,
    printed_digits,
    with_rounding_error,
)
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import NODE_SHAPES, SID, Array, Node, Taylor
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.measurement import cache
from sidtool.measurement.candidates import finest_model
from sidtool.measurement.request import requested
from sidtool.measurement.runs import Runs
from sidtool.solver import compile_scene
from sidtool.solver.system.system import System
from tests.bodies import particle_body
from tests.codes import with_code

from .arms import cantilever, spun, swinging


@pytest.fixture(autouse=True)
def _own_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path / "kept")


def reprinted(sid: SID, text: str) -> SID:
    """A SID whose numbers were printed with this format, by nothing of sidtool."""

    def part(values: Array | None) -> Array | None:
        if values is None:
            return None
        return np.array([float(text % v) for v in values.ravel()]).reshape(values.shape)

    def block(one: Taylor | None) -> Taylor | None:
        if one is None:
            return None
        return replace(one, m0=part(one.m0), m1=part(one.m1), mn=part(one.mn))

    def node(one: Node) -> Node:
        return replace(one, **{name: block(getattr(one, name)) for name in NODE_SHAPES})

    blocks = {name: block(one) for name, one in sid.blocks.items()}
    nodes = tuple(map(node, sid.nodes))
    return replace(sid, mass=float(text % sid.mass), nodes=nodes, **blocks)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("%.5e", NumberFormat(6, False)),
        ("%.8e", NumberFormat(9, False)),
        ("%.6f", NumberFormat(6, True)),
        ("%.16e", None),
    ],
)
def test_printed_digits_are_found_from_the_numbers(
    text: str, expected: NumberFormat | None
) -> None:
    for sid in (cantilever(3), cantilever(3, stiffened=True)):
        assert printed_digits(reprinted(sid, text)) == expected


def test_files_of_ours_have_twelve_digits_also_as_copies(tmp_path: Path) -> None:
    write_sid(tmp_path / "arm.SID_FEM", cantilever(3))
    once = read_sid(tmp_path / "arm.SID_FEM")
    write_sid(tmp_path / "arm.h5", once)
    assert (
        printed_digits(once)
        == printed_digits(read_sid(tmp_path / "arm.h5"))
        == NumberFormat(12, False)
    )


@pytest.mark.parametrize("case", ["falls", "spins", "particles"])
def test_changes_by_digits_stay_below_their_estimate(case: str) -> None:
    """Nor told far above it: of roundings the signs are not known."""
    scene, sid = swinging(0.6), cantilever(3)
    if case == "spins":
        scene, sid = spun(1.0, 4.0), cantilever(3, stiffened=True)
    elif case == "particles":
        sid = particle_body(4, 9, planar=True, seed=5)
        Ke = np.diag([4e3, 9e3, 6e5, 5e6])
        sid = replace(sid, Ke=Taylor(Ke), De=Taylor(2e-4 * Ke))
    exact = columns(scene, sid)
    ratios = []
    for text in ("%.4e", "%.8e", "%.6f"):
        poor = reprinted(sid, text)
        changes = np.abs(columns(scene, poor) - exact).max(axis=0)
        estimates = digits_told(scene, poor)
        judged = estimates > 0.0
        assert judged.any()
        ratios += (estimates[judged] / changes[judged]).tolist()
    assert min(ratios) >= 1.0 and np.median(ratios) < 40.0


def columns(scene: SceneFile, sid: SID) -> Array:
    """Outputs of a tight run, (nt, n)."""
    result = sidtool.simulate(
        scene, sids={"arm": sid}, integrator="radau13", rtol=1e-11
    )
    return np.column_stack([result[name] for name in scene.outputs.record])


def digits_told(scene: SceneFile, sid: SID) -> Array:
    """What the search says of the digits, (n,)."""

    def compiled(content: SceneFile, sids: Mapping[str, SID]) -> System:
        return compile_scene(content, ".", sids)

    sids = {"arm": sid}
    request = requested(scene, sids, 1e-4)
    runs = Runs(scene, sids, compiled, request.names)
    reference = make_reference(runs, finest_model(scene, sids), request)
    reference = replace(reference, allowed=1e9 * reference.allowed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sid_rounding, "MOTION_MAGNIFICATION", 1e30)
        return with_rounding_error(runs, reference)[0].digits


def test_all_digits_are_no_part_of_the_budget() -> None:
    result = sidtool.simulate(swinging(0.4), sids={"arm": cantilever(3)}, accuracy=1e-3)
    assert "digits" not in [line.part for line in result.accuracy.budget]
    assert not with_code(result, "N611")


def test_twelve_digits_cost_no_run(tmp_path: Path) -> None:
    write_sid(tmp_path / "arm.SID_FEM", cantilever(3))
    poor = read_sid(tmp_path / "arm.SID_FEM")
    scene = swinging(0.4)
    result = sidtool.simulate(scene, sids={"arm": poor}, accuracy=1e-3)
    whole = sidtool.simulate(scene, sids={"arm": cantilever(3)}, accuracy=1e-3)
    assert result.accuracy.runs == whole.accuracy.runs
    assert not with_code(result, "N611")


def test_too_few_digits_are_refused_for_a_tight_request() -> None:
    poor = reprinted(cantilever(3), "%.3e")
    with pytest.raises(InputError, match=r"N617.*N611") as refused:
        sidtool.simulate(swinging(0.4), sids={"arm": poor}, accuracy=1e-6)
    assert "files with more digits" in str(refused.value)


def test_the_table_has_a_line_of_digits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sid(tmp_path / "arm.h5", reprinted(cantilever(3), "%.5e"))
    content = swinging(0.4).model_dump(mode="json", by_alias=True, exclude_none=True)
    content["bodies"]["arm"]["sid"] = "arm.h5"
    (tmp_path / "scene.json").write_text(json.dumps(content), encoding="utf-8")
    result = str(tmp_path / "result.h5")
    command = ["simulate", str(tmp_path / "scene.json"), "--accuracy", "1e-1"]
    assert run([*command, "-o", result]) == 0
    assert run(["info", result, "-v"]) == 0
    text = capsys.readouterr().out
    assert "N611 arm" in text and "(6 digits)" in text
