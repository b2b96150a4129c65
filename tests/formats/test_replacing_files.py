"""Files that cannot take their place, and what systems say differently."""

from __future__ import annotations

import errno
import os
import re
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.storage import operating_system
from sidtool.formats.storage.atomic import atomic_path, temporary_folder
from sidtool.formats.storage.operating_system import (
    cache_folder,
    has_ended,
    is_open_in_other_program,
    is_writable_folder,
    processors,
    replace_file,
    windows_path_problem,
)
from tests.places import posix


def test_a_whole_file_is_kept_beside_a_target_that_it_cannot_replace(
    tmp_path: Path,
) -> None:
    """Here a folder has taken the name meanwhile; on Windows another program may."""
    target = tmp_path / "motion.h5"
    (tmp_path / "motion.new1.h5").write_bytes(b"earlier")
    with pytest.raises(OSError) as raised, atomic_path(target) as temporary:
        temporary.write_bytes(b"new")
        (target / "inner").mkdir(parents=True)
    assert raised.value.filename == str(target)
    assert "motion.new2.h5" in raised.value.strerror
    assert (tmp_path / "motion.new2.h5").read_bytes() == b"new"
    assert (tmp_path / "motion.new1.h5").read_bytes() == b"earlier"
    assert not list(tmp_path.glob(".*.part"))


def test_what_can_be_computed_anew_is_not_kept_beside(tmp_path: Path) -> None:
    target = tmp_path / "kernel"
    with pytest.raises(OSError), atomic_path(target, keep_beside=False) as temporary:
        temporary.write_bytes(b"new")
        (target / "inner").mkdir(parents=True)
    assert [path.name for path in tmp_path.iterdir()] == ["kernel"]


@pytest.mark.parametrize("refusals", [0, 3])
def test_a_file_that_is_held_for_a_moment_is_replaced(
    refusals: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows says so by its error 32 while an antivirus program reads a new file."""
    usual, refused = os.replace, []

    def replace(source: Any, target: Any) -> None:
        if len(refused) < refusals:
            error = PermissionError(13, "Permission denied")
            error.winerror = 32  # type: ignore[attr-defined]
            refused.append(error)
            raise error
        usual(source, target)

    monkeypatch.setattr(operating_system.os, "replace", replace)
    (tmp_path / "new").write_bytes(b"new")
    (tmp_path / "old").write_bytes(b"old")
    replace_file(tmp_path / "new", tmp_path / "old")
    assert (tmp_path / "old").read_bytes() == b"new" and len(refused) == refusals


@pytest.mark.skipif(sys.platform != "win32", reason="others replace open files")
def test_a_file_that_another_has_open_stays_and_the_new_one_is_beside(
    tmp_path: Path,
) -> None:
    target = tmp_path / "table.csv"
    target.write_bytes(b"old")
    assert not is_open_in_other_program(target)
    with target.open("rb"):
        assert is_open_in_other_program(target)
        with pytest.raises(OSError), atomic_path(target) as temporary:
            temporary.write_bytes(b"new")
    assert target.read_bytes() == b"old"
    assert (tmp_path / "table.new1.csv").read_bytes() == b"new"


def test_a_file_that_cannot_be_removed_does_not_hide_why_it_was_to_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a full disk libhdf5 leaves its file open; Windows does not remove that."""

    def refuse(path: Path, missing_ok: bool = False) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    target = tmp_path / "motion.h5"
    target.write_bytes(b"old")
    for write in (atomic_path, temporary_folder):
        with monkeypatch.context() as patch, pytest.raises(OSError) as caught:
            patch.setattr(Path, "unlink", refuse)
            patch.setattr(Path, "rmdir", refuse)
            with write(target):
                raise OSError(errno.ENOSPC, "No space left on device")
        assert caught.value.errno == errno.ENOSPC
    assert target.read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 3
    with atomic_path(target) as temporary:
        temporary.write_bytes(b"new")
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize(
    "path",
    [
        "con",
        "NUL.h5",
        "C:\\work\\com1.csv",
        "lpt3 .toml",
        "folder./file",
        "trailing ",
        "a?b.h5",
        "con/motion.h5",
        "part:stream",
    ],
)
def test_windows_has_no_file_of_such_a_name(path: str) -> None:
    assert windows_path_problem(path)


@pytest.mark.parametrize(
    "path",
    [
        "motion.h5",
        "C:\\work\\motion.h5",
        "C:motion.h5",
        "\\\\server\\share\\motion.h5",
        "..\\.\\console.csv",
        "com10.h5",
        "\N{GREEK SMALL LETTER OMEGA} 1.toml",
        ".hidden",
    ],
)
def test_windows_may_have_a_file_of_such_a_name(path: str) -> None:
    assert windows_path_problem(path) == ""


def test_names_are_asked_for_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(operating_system, "WINDOWS", True)
    with pytest.raises(InputError, match="device"), atomic_path(tmp_path / "nul.h5"):
        pytest.fail("a device was opened")


def test_processes_that_have_ended() -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    assert has_ended(process.pid)
    waiting = [sys.executable, "-c", "input()"]
    with subprocess.Popen(waiting, stdin=subprocess.PIPE) as process:
        assert not has_ended(process.pid) and not has_ended(os.getpid())
    assert 1 <= processors() <= (os.cpu_count() or 1)


def test_folders_that_can_be_written(tmp_path: Path) -> None:
    assert is_writable_folder(tmp_path) and not list(tmp_path.iterdir())
    assert not is_writable_folder(tmp_path / "none")
    (tmp_path / "file").write_bytes(b"")
    assert not is_writable_folder(tmp_path / "file")


def test_the_cache_is_where_a_system_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "local"))
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    found = {}
    for windows, macos in ((False, False), (False, True), (True, False)):
        monkeypatch.setattr(operating_system, "WINDOWS", windows)
        monkeypatch.setattr(operating_system, "MACOS", macos)
        found[windows, macos] = cache_folder()
    assert found[False, False] == tmp_path / ".cache" / "sidtool"
    assert found[False, True] == tmp_path / "Library" / "Caches" / "sidtool"
    assert found[True, False] == tmp_path / "local" / "sidtool" / "Cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "sidtool"


@posix
@pytest.mark.parametrize("mask", [0o022, 0o077])
def test_new_files_have_the_usual_permissions(
    mask: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mask of the process is not changed: other threads create files, too."""
    before = os.umask(mask)
    try:
        with monkeypatch.context() as patched:
            patched.setattr(os, "umask", lambda new: pytest.fail("umask was changed"))
            with atomic_path(tmp_path / "new") as temporary:
                temporary.write_bytes(b"new")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "new").stat().st_mode) == 0o666 & ~mask


@posix
def test_what_is_poured_into_a_pipe_waits_in_a_private_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "there").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "there"))
    with atomic_path(Path(os.devnull)) as temporary:
        folder = temporary.parent
        assert folder.parent == tmp_path / "there"
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        temporary.write_bytes(b"new")
    assert list((tmp_path / "there").iterdir()) == []


@posix
def test_folders_of_killed_runs_are_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with atomic_path(Path(os.devnull)) as temporary:
        name = temporary.parent.name
    gone = tmp_path / re.sub(r"-\d+-", f"-{2**22 + 1}-", name)
    gone.mkdir()
    (gone / "rest").write_bytes(b"rest")
    with atomic_path(Path(os.devnull)):
        pass
    assert not gone.exists()
