"""Studies on a Dask cluster of two workers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from sidtool.cli.main import run
from sidtool.study import run_study

from ..accuracy.arms import swinging
from .parts import ONE, written


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    import distributed

    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as made:
        yield made.scheduler_address


@pytest.mark.needs("dask")
def test_a_cluster_of_two_workers_gives_the_same_result(
    cluster: str, models: list[Path], tmp_path: Path
) -> None:
    axes = {"modes": (1, 2)}
    given: dict[str, Any] = {"models": {"arm": models[1:]}, "settings": ONE}
    here = run_study(swinging(0.3), axes, **given)
    there = run_study(
        swinging(0.3), axes, dask=cluster, keep=tmp_path / "kept", **given
    )
    assert [p.choices for p in there.points] == [p.choices for p in here.points]
    for one, other in zip(here.points, there.points, strict=True):
        assert other.error == pytest.approx(one.error, rel=1e-6, abs=1e-9)
        assert other.steps == one.steps


@pytest.mark.needs("dask")
def test_the_command_computes_on_the_cluster(
    cluster: str, models: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second command reads all points of the cluster and prints the same result."""
    command = [
        "study",
        str(written(tmp_path)),
        "--over",
        "modes=1:2,terms=none:quadratic",
    ]
    command += ["--rtol", "1e-6", "--json", "-o", str(tmp_path / "out")]
    assert run([*command, "--dask", cluster]) == 0
    there = json.loads(capsys.readouterr().out)
    points = sorted((tmp_path / "out" / "points").iterdir())
    assert run([*command, "--jobs", "1"]) == 0
    here = json.loads(capsys.readouterr().out)
    assert sorted((tmp_path / "out" / "points").iterdir()) == points
    assert len(there["points"]) == 4
    assert [p["error"] for p in there["points"]] == [p["error"] for p in here["points"]]
