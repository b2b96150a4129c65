"""Files that commands write: never over what they read, wholly or not at all."""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from sidtool.cli.main import run
from sidtool.formats.result import read_result
from sidtool.formats.sid_files import read_sid
from sidtool.formats.storage import atomic, operating_system
from sidtool.formats.storage.atomic import atomic_path
from tests.codes import unwrapped
from tests.places import SLIDER_CRANK, posix
from tests.processes import PythonProcess


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("slider_crank.toml", "rod_q4.SID_FEM", "rod_q4.toml"):
        shutil.copy(SLIDER_CRANK / name, tmp_path / name)
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir()) if p.is_file()}


def refused(arguments: list[str], folder: Path, capsys: pytest.CaptureFixture) -> str:
    """Exit status 2, one message, and nothing changed."""
    before = contents(folder)
    assert run(arguments) == 2
    assert contents(folder) == before
    (line,) = unwrapped(capsys.readouterr().err).splitlines()
    return line


@pytest.mark.parametrize(
    "arguments",
    [
        ["simulate", "slider_crank.toml", "-o", "slider_crank.toml"],
        ["simulate", "slider_crank.toml", "-o", "rod_q4.SID_FEM"],
        pytest.param(["simulate", "slider_crank.toml", "-o", "link.h5"], marks=posix),
        ["simulate", "slider_crank.toml", "-o", "./rod_q4.SID_FEM", "--force"],
        ["analyse", "static", "slider_crank.toml", "-o", "rod_q4.SID_FEM"],
        ["convert", "rod_q4.toml", "-o", "rod_q4.toml", "--force"],
        ["convert", "rod_q4.SID_FEM", "-o", "rod_q4.SID_FEM", "--repair"],
    ],
    ids=" ".join,
)
def test_inputs_are_not_replaced(
    arguments: list[str],
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    """Also through a link, under another spelling, and with --force."""
    monkeypatch.chdir(folder)
    if "link.h5" in arguments:
        (folder / "link.h5").symlink_to("rod_q4.SID_FEM")
    text = refused(arguments, folder, capsys)
    assert "is read by this command and would be replaced" in text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["-o", "r.h5", "-o", "./r.h5"], "is what -o writes, too"),
        (["-o", "r.h5", "-o", "other.h5"], "r.h5 and other.h5 would be the same"),
        (["-o", "r.csv", "-o", "other.csv"], "expected one .h5 and one .csv at most"),
        (["-o", "r.csv", "--continue"], "needs the file of the run"),
        (["-o", "scene.toml"], "which the ending .toml does not say"),
        (["-o", "-"], "is no file name here"),
        (["-o", "notes.h5"], "is there and is not a result (HDF5) of sidtool's"),
        (["-o", "notes.csv"], "is there and is not a table (CSV) of sidtool's"),
    ],
)
def test_implausible_targets_are_refused(
    options: list[str],
    words: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    monkeypatch.chdir(folder)
    for name in ("notes.csv", "notes.h5"):
        (folder / name).write_text("years of work\n", encoding="utf-8")
    assert words in refused(["simulate", "slider_crank.toml", *options], folder, capsys)


def test_a_sid_of_another_program_is_replaced_with_force_only(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has all that a SID has, but not the mark of our own files in its title."""
    monkeypatch.chdir(folder)
    path = folder / "other.SID_FEM"
    own = (folder / "rod_q4.SID_FEM").read_text(encoding="utf-8")
    foreign = re.sub(r" \[sidtool.*\]", "", own, count=1)
    path.write_text(foreign, encoding="utf-8")
    arguments = ["convert", "rod_q4.SID_FEM", "-o", "other.SID_FEM"]
    assert "is there and is not" in refused(arguments, folder, capsys)
    path.write_text(own, encoding="utf-8")
    assert run([*arguments[:1], str(folder / arguments[1]), "-o", str(path)]) == 0
    path.write_text(foreign, encoding="utf-8")
    again = ["convert", str(folder / "rod_q4.SID_FEM"), "-o", str(path), "--force"]
    assert run(again) == 0
    assert "[sidtool" in path.read_text(encoding="utf-8")


def test_own_files_are_replaced_and_others_with_force(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    arguments = ["simulate", "slider_crank.toml", "--rtol", "1e-3", "-o", "r.h5"]
    arguments += ["-o", "r.csv"]
    assert [run(arguments) for _ in range(2)] == [0, 0]
    (folder / "r.h5").write_text("notes", encoding="utf-8")
    assert run(arguments) == 2
    assert run([*arguments, "--force"]) == 0
    assert read_result(folder / "r.h5").completed


@posix
def test_links_and_file_modes_are_kept(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A link is followed; what it points to is replaced and keeps its permissions."""
    monkeypatch.chdir(folder)
    (folder / "store").mkdir()
    real, link = folder / "store" / "rod.h5", folder / "rod.h5"
    link.symlink_to("store/rod.h5")
    for _ in range(2):
        assert run(["convert", "rod_q4.SID_FEM", "-o", "rod.h5"]) == 0
        assert link.is_symlink() and read_sid(real).nq == 5
        real.chmod(0o640)
    assert stat.S_IMODE(real.stat().st_mode) == 0o640


@posix
def test_pipes_are_written_to(folder: Path) -> None:
    """A named pipe stays one, and its reader gets the whole SID."""
    pipe, found = folder / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: found.append(pipe.read_bytes()))
    reader.start()
    assert run(["convert", str(folder / "rod_q4.SID_FEM"), "-o", str(pipe)]) == 0
    reader.join(10.0)
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    target = folder / "written.SID_FEM"
    assert run(["convert", str(folder / "rod_q4.SID_FEM"), "-o", str(target)]) == 0
    assert found == [target.read_bytes()]


@posix
def test_the_standard_output_can_be_named(folder: Path) -> None:
    command = [sys.executable, "-m", "sidtool", "convert", "rod_q4.SID_FEM"]
    done = subprocess.run(
        [*command, "-o", "/dev/stdout"],
        cwd=folder,
        stdout=subprocess.PIPE,
        check=True,
        timeout=120,
    )
    assert b"end part" in done.stdout


LIMITED = """
import contextlib, io, json, os, resource, tempfile
from sidtool.cli.main import run
tempfile.tempdir, most = os.getcwd(), resource.getrlimit(resource.RLIMIT_FSIZE)[1]
for arguments in {calls!r}:
    size, *words = arguments
    errors = io.StringIO()
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
    with contextlib.redirect_stderr(errors):
        status = run(words)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    with open("found.jsonl", "a") as found:
        print(json.dumps([status, errors.getvalue()]), file=found)
"""


@posix
def test_a_limit_on_file_sizes_leaves_nothing_half_written(folder: Path) -> None:
    """One message, exit status 1, no temporary files; existing files are unchanged."""
    (folder / "rod.h5").write_bytes(b"\x89SID\r\n\x1a\n")
    (folder / "rod.SID_FEM").write_bytes(b"refmod")
    before = contents(folder)
    convert = ["convert", "rod_q4.SID_FEM", "--force", "-o"]
    targets = ("rod.h5", "rod.SID_FEM")
    calls = [[size, *convert, t] for size in (0, 600, 20_000) for t in targets]
    with PythonProcess(LIMITED.format(calls=calls), folder) as process:
        assert process.wait().status == 0, process.read("stderr")
    written = (folder / "found.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(written) == len(calls)
    for line in written:
        status, errors = json.loads(line)
        assert status == 1 and errors.count("\n") == 1 and "File too large" in errors
    (folder / "found.jsonl").unlink()
    assert contents(folder) == before


def test_temporary_names_hold_whole_characters(tmp_path: Path) -> None:
    """Of long names a part is taken, and a Greek letter has two bytes."""
    target = tmp_path / f"x{'κ' * 100}.csv"
    with atomic_path(target) as temporary:
        assert temporary.name.encode("utf-8")  # no half of a letter
        temporary.write_text("t\n", encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == [target.name]


def test_a_failing_block_leaves_the_target_alone(tmp_path: Path) -> None:
    target = tmp_path / "file"
    target.write_text("old", encoding="utf-8")
    with pytest.raises(RuntimeError), atomic_path(target) as temporary:
        temporary.write_text("new", encoding="utf-8")
        raise RuntimeError
    assert contents(tmp_path) == {"file": b"old"}


@pytest.mark.parametrize("name", ["motion.h5", "motion.csv"])
def test_a_result_that_cannot_replace_its_target_is_stored(
    name: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A folder takes its name during the run, as on Windows a program may open it."""
    monkeypatch.chdir(folder)
    usual = operating_system.flush_to_disk

    def flush_to_disk(path: Path) -> None:
        usual(path)
        (folder / name / "inner").mkdir(parents=True)

    monkeypatch.setattr(atomic, "flush_to_disk", flush_to_disk)
    short = ["--set", "time.end=0.1"]
    assert run(["simulate", "slider_crank.toml", *short, "-o", name]) == 1
    told, stored = capsys.readouterr(), name.replace(".", ".new1.")
    assert "nothing was kept" not in told.err and stored in told.err
    assert (folder / stored).stat().st_size > 100
    if name.endswith(".h5"):
        assert read_result(folder / stored).t[-1] == pytest.approx(0.1)
