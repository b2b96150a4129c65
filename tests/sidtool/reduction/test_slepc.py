"""Two processes of mpirun give the SID that one process gives without SLEPc."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.cli.main import run
from sidtool.formats.base.sid import SID
from sidtool.formats.sid_files import read_sid
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import unwrapped

from ..models import rod_data

COMMAND = [sys.executable, "-c", "from sidtool.cli.main import main; main()"]


def held_rod() -> dict[str, Any]:
    """Clamped, and too large to be solved as a dense problem."""
    return dict(rod_data({"type": "q4", "elements": [60, 4]}))


def mpirun(folder: Path, *groups: list[str]) -> subprocess.CompletedProcess[str]:
    """Start groups of (processes, arguments...) as one run."""
    words: list[str] = []
    for count, *arguments in groups:
        words += [":"] if words else []
        words += ["-n", count, *COMMAND, *arguments]
    environment = os.environ | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "OMP_NUM_THREADS": "1",
    }
    return subprocess.run(
        ["mpirun", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        encoding="utf-8",
    )


def free_rod() -> dict[str, Any]:
    """Free, its right edge a rigid piece: rigid motions, constraints, static loads."""
    tied = {"node": 2, "edge": "right", "at": 0.5}
    return dict(
        rod_data(
            {"type": "q4", "elements": [60, 4]},
            frame={"type": "buckens"},
            markers={
                "crank_pin": {
                    "node": 1,
                    "edge": "left",
                    "at": 0.5,
                    "tie": {"type": "rigid", "to": "left"},
                },
                "piston_pin": tied | {"tie": {"type": "rigid", "to": "right"}},
            },
            reduction={
                "method": "craig_bampton",
                "interfaces": ["crank_pin", "piston_pin"],
                "modes": 3,
            },
        )
    )


def write(folder: Path, name: str, data: dict[str, Any]) -> Path:
    path = folder / f"{name}.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def compare(found: SID, expected: SID) -> None:
    """Every block to 1e-9; mass-normalised shape functions make all but Ke of size 1.

    The stiffness is of the size of its largest entry.
    """
    for name in ("J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe", "Ke"):
        one, other = getattr(found, name), getattr(expected, name)
        for a, b in ((one.m0, other.m0), (one.m1, other.m1)):
            if b is None:
                assert a is None
                continue
            scale = max(1.0, np.abs(b).max())
            assert_allclose(a, b, rtol=1e-9, atol=1e-9 * scale, err_msg=name)
    for node, own in zip(found.nodes, expected.nodes, strict=True):
        for a, b in ((node.phi.m0, own.phi.m0), (node.psi.m0, own.psi.m0)):
            assert_allclose(a, b, rtol=1e-9, atol=1e-9)
    assert found.labels == expected.labels


@pytest.mark.needs("mpirun", "slepc4py")
def test_two_processes_give_the_serial_sid(tmp_path: Path) -> None:
    """A clamped rod by its modes; a free one by Craig and Bampton."""
    for name, data in (("held", held_rod()), ("free", free_rod())):
        path = write(tmp_path, name, data)
        output = tmp_path / f"{name}.h5"
        done = mpirun(
            tmp_path, ["2", "convert", path.name, "-o", output.name, "--engine=slepc"]
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.count("modes;") == 1
        compare(read_sid(output), sid_from_model(path))


@pytest.mark.needs("mpirun", "slepc4py")
def test_one_bad_process_ends_all_with_its_message(tmp_path: Path) -> None:
    write(tmp_path, "good", held_rod())
    end = ["-o", "x.h5", "--engine=slepc"]
    done = mpirun(
        tmp_path, ["1", "convert", "good.json", *end], ["1", "convert", "no.json", *end]
    )
    assert done.returncode != 0  # mpirun's own: that of the process it misses first
    assert done.stderr.count("sidtool:") == 1
    assert "sidtool: no.json: there is no such file" in done.stderr
    assert not (tmp_path / "x.h5").exists()


@pytest.mark.needs("mpirun", "slepc4py")
def test_processes_that_work_alone_are_refused(tmp_path: Path) -> None:
    write(tmp_path, "good", held_rod())
    done = mpirun(tmp_path, ["2", "convert", "good.json", "-o", "x.h5"])
    assert done.returncode == 2
    assert "expected slepc, the engine that shares the work" in done.stderr
    assert not (tmp_path / "x.h5").exists()


def test_without_slepc4py_the_engine_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "slepc4py", None)
    path = write(tmp_path, "good", held_rod())
    arguments = ["convert", str(path), "-o", str(tmp_path / "x.h5"), "--engine=slepc"]
    assert run(arguments) == 2
    error = unwrapped(capsys.readouterr().err)
    assert "the engine slepc needs slepc4py" in error and "large_parts" in error


def test_mpirun_is_noticed(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("PMI_SIZE", "3")
    path = write(tmp_path, "good", held_rod())
    assert run(["convert", str(path), "-o", str(tmp_path / "x.h5")]) == 2
    assert "mpirun started 3 processes" in unwrapped(capsys.readouterr().err)
