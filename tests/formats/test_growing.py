"""Files that are written piece by piece: on full disks, under signals, in any order."""

from __future__ import annotations

import io
import random
import signal
import stat
import tempfile
from contextlib import ExitStack
from pathlib import Path

import h5py
import numpy as np
import pytest

from sidtool.formats.storage import atomic
from sidtool.formats.storage.atomic import GrowingFile, undisturbed
from sidtool.formats.storage.hdf5_files import SealedFile, check_seal, write_sealed
from tests.places import posix


class Small(io.FileIO):
    """A file on a disk with little room."""

    room = 0

    def write(self, data: object) -> int:
        piece = memoryview(data)  # type: ignore[arg-type]
        count = min(len(piece), self.room - self.tell())
        if piece and count <= 0:
            raise OSError(28, "No space left on device")
        return super().write(piece[:count])


def little_room(monkeypatch: pytest.MonkeyPatch, room: int, full: Path) -> None:
    """One folder has room for so many bytes only."""
    opened = atomic._opened

    def limited(target: Path) -> tuple[ExitStack, io.FileIO]:
        stack, file = opened(target)
        if target.parent == full:
            file.close()
            file = Small(str(file.name), "r+b")
            file.room = room
            stack.callback(file.close)
        return stack, file

    monkeypatch.setattr(atomic, "_opened", limited)


@pytest.mark.parametrize("room", [0, 5000, 70_000, 1 << 20])
def test_it_reads_back_what_was_written_with_or_without_room(
    room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    little_room(monkeypatch, room, tmp_path)
    chance, right = random.Random(room), io.BytesIO()
    file = GrowingFile(tmp_path / "file")
    for _ in range(500):
        at, size = chance.randrange(200_000), chance.randrange(9000)
        file.seek(at)
        right.seek(at)
        if chance.random() < 0.5:
            piece = chance.randbytes(size)
            assert file.write(piece) == right.write(piece)
        else:
            assert file.read(size) == right.read(size)
        assert file.tell() == right.tell()
    assert (file.error is None) == (room == 1 << 20)
    if file.error is None:
        file.close()
        assert (tmp_path / "file").read_bytes() == right.getvalue()
    else:
        with pytest.raises(OSError, match="No space left"):
            file.close()
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("room", [0, 600, 3000, 30_000])
def test_a_full_disk_ends_no_hdf5_file_half_written(
    room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """libhdf5 ended the process when a file could not grow."""
    little_room(monkeypatch, room, tmp_path)

    def fill(file: h5py.File) -> None:
        for k in range(50):
            file.create_group(f"group{k}")["data"] = np.arange(500.0)

    with pytest.raises(OSError, match="No space left"):
        write_sealed(tmp_path / "file.h5", fill)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("room", [0, 700, 30_000])
def test_a_file_without_room_goes_on_elsewhere(
    room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(there))
    little_room(monkeypatch, room, here)
    file = SealedFile(here / "file.h5", use_fallback_folder=True)
    for k in range(10):
        file.put(lambda h5, k=k: h5.create_dataset(f"d{k}", data=np.full(999, k)))
    file.close()
    (folder,) = there.iterdir()
    assert list(folder.iterdir()) == [folder / "file.h5"] == [file.target.target]
    assert file.target.moved is not None and list(here.iterdir()) == []
    check_seal(folder / "file.h5")
    with h5py.File(folder / "file.h5") as h5:
        assert all((h5[f"d{k}"][()] == k).all() for k in range(10))


@posix
def test_what_others_plant_elsewhere_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The name of a result in the folder for temporary files can be foreseen."""
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    (here / "mine").write_text("mine", encoding="utf-8")
    (there / "file").symlink_to(here / "mine")
    (there / "gone").symlink_to(here / "planted")
    monkeypatch.setattr(tempfile, "tempdir", str(there))
    little_room(monkeypatch, 10, here)
    for name in ("file", "gone"):
        file = GrowingFile(here / name, use_fallback_folder=True)
        file.write(b"x" * 100)
        file.close()
        folder = file.target.parent
        assert folder.parent == there and folder.name != there / name
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert file.target.read_bytes() == b"x" * 100
    assert list(here.iterdir()) == [here / "mine"]
    assert (here / "mine").read_text(encoding="utf-8") == "mine"


def test_what_is_discarded_elsewhere_leaves_no_trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(there))
    little_room(monkeypatch, 10, here)
    file = GrowingFile(here / "file", use_fallback_folder=True)
    file.write(b"x" * 100)
    assert len(list(there.iterdir())) == 1
    file.discard()
    assert list(here.iterdir()) == list(there.iterdir()) == []


def test_signals_wait_until_libhdf5_has_returned(tmp_path: Path) -> None:
    """What they raise is raised after it, and the file is still sound."""

    def fill(file: h5py.File) -> None:
        signal.raise_signal(signal.SIGINT)
        for k in range(1000):
            file[f"d{k}"] = np.arange(10.0)
        done.append(len(file))

    done: list[int] = []
    file = SealedFile(tmp_path / "file.h5")
    with pytest.raises(KeyboardInterrupt):
        file.put(fill)
    assert done == [1000]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    file.close()
    check_seal(tmp_path / "file.h5")


def test_without_signals_nothing_waits() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with undisturbed():
        pass
    assert signal.getsignal(signal.SIGTERM) is before
