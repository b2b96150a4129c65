"""Write a file completely or not at all.

Files that are written piece by piece and replace their target when complete.
"""

import io
import os
import re
import shutil
import stat
import tempfile
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

from ..base.errors import InputError
from .operating_system import (
    ENDING_SIGNALS,
    PRIVATE,
    USUAL,
    create_file,
    create_folder,
    extended_path,
    flush_to_disk,
    handle_signal,
    has_ended,
    is_open_in_other_program,
    is_own_folder,
    path_problem,
    present_signals,
    process_list,
    replace_file,
    set_mode,
    signal_handler,
)
from .unreadable import failure_reason

#: Bytes of a target's name that its temporary file takes over.
MAX_NAME_LENGTH = 120
TEMPORARY_PREFIX = ".part"
#: Names of temporary files and folders, see `_new_temporary`.
LEFTOVER_PATTERN = re.compile(
    r"\..*\.(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-\w+\.part", re.S
)

#: Temporary files of this process that are being written.
_living: set[Path] = set()
_lock = threading.Lock()

#: Bytes that are held in memory together.
PAGE = 4096


class StoredUnderOtherName(OSError):
    """Raised when a complete file could not replace another one and is stored beside
    it.
    """


@contextmanager
def atomic_path(
    target: str | os.PathLike[str], keep_beside: bool = True, mode: int | None = None
) -> Iterator[Path]:
    """Yield a temporary path beside `target`; it replaces `target` only on success.

    A killed or failing run leaves the file at `target` unchanged. A symbolic link
    remains one: its target is replaced. An existing file keeps its mode. Devices
    and pipes are not replaced but written to.

    Parameters
    ----------
    target : the file
    keep_beside : store a complete file under another name if it cannot replace
        `target`, as on Windows while another program has that open; else it is removed
    mode : permissions of the file, less the umask, instead of the usual ones or those
        of the file that it replaces

    Raises
    ------
    InputError : the folder does not exist or cannot be written to, or a file cannot
        have this name.
    KeptBeside : it cannot replace `target`; states where it is instead.
    OSError : the file cannot be written completely, as on a full disk; it names
        `target`.
    """
    given_path = target = Path(target)
    if problem := path_problem(target):
        raise InputError(problem, source=target, expected="another name")
    file_mode = _file_mode(target)
    stream = file_mode is not None and not stat.S_ISREG(file_mode)
    if not stream:
        target = extended_path(Path(os.path.realpath(target)))
    if stream and target.is_dir():
        raise InputError("is a folder", source=target, expected="the name of a file")
    if mode is None:
        mode = USUAL if file_mode is None else PRIVATE
    else:
        file_mode = None
    if stream:
        with temporary_folder(Path(tempfile.gettempdir()) / target.name) as folder:
            temporary = create_file(folder, "", "")
            yield temporary
            _copy_into_device(temporary, target)
        return
    temporary = _create_temporary(target, mode)
    try:
        yield temporary
        flush_to_disk(temporary)
        if file_mode is not None:
            set_mode(temporary, file_mode)
        _move_into_place(temporary, target, given_path if keep_beside else None)
    except StoredUnderOtherName:
        raise
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, os.fspath(given_path)) from error
    finally:
        _remove_temporary(temporary)


@contextmanager
def temporary_folder(target: Path) -> Iterator[Path]:
    """Yield a new folder beside `target` that only this user may enter.

    It is removed at the end with the files in it; that of a killed process by the next
    process that writes into the same folder.

    Raises
    ------
    InputError : nothing can be created there.
    OSError : a file in it cannot be written, as on a full disk; it names `target`.
    """
    folder = _new_temporary(
        target, lambda prefix: create_folder(target.parent, prefix, TEMPORARY_PREFIX)
    )
    try:
        yield folder
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, error.strerror, os.fspath(target)) from error
    finally:
        _remove_temporary(folder)


def _move_into_place(temporary: Path, target: Path, given_path: Path | None) -> None:
    """Replace the target, or store the file beside it if `named` is set."""
    try:
        replace_file(temporary, target)
    except OSError as error:
        if given_path is None:
            raise
        names = (f"{target.stem}.new{n}{target.suffix}" for n in count(1))
        other = next(p for p in map(target.with_name, names) if not p.exists())
        replace_file(temporary, other)
        problem = f"cannot be replaced ({failure_reason(error)})"
        if is_open_in_other_program(target):
            problem = "is open in another program"
        text = f"{problem}: it is as before, and what was to replace it is {other.name}"
        raise StoredUnderOtherName(error.errno, text, os.fspath(given_path)) from error


def _file_mode(target: Path) -> int | None:
    try:
        return target.stat().st_mode
    except OSError:
        return None


def _create_temporary(target: Path, mode: int) -> Path:
    """A new temporary file in the folder of `target`, and no rests of killed runs."""
    return _new_temporary(
        target,
        lambda prefix: create_file(target.parent, prefix, TEMPORARY_PREFIX, mode),
    )


def _new_temporary(target: Path, create: Callable[[str], Path]) -> Path:
    """Create a temporary file or folder, after removal of leftovers beside it."""
    # whole characters, as Windows and macOS have no names with parts of one
    short = target.name.encode("utf-8", "ignore")[:MAX_NAME_LENGTH].decode(
        "utf-8", "ignore"
    )
    prefix = f".{short}.{_machine_name()}-{os.getpid()}-"
    with _lock:
        try:
            path = create(prefix)
        except OSError as error:
            raise InputError(
                f"cannot write here ({failure_reason(error)})",
                source=target,
                expected="an existing folder with permission to write",
            ) from error
        _living.add(path)
        _remove_leftovers(target.parent)
    return path


@cache
def _machine_name() -> str:
    """Return a name of the machine or container whose process numbers are ours."""
    return f"{zlib.crc32(process_list().encode()):08x}"


def _remove_leftovers(folder: Path) -> None:
    """Remove temporary files of processes that have ended, as far as possible."""
    with suppress(OSError), os.scandir(folder) as entries:
        for path in [
            Path(e.path) for e in entries if e.name.endswith(TEMPORARY_PREFIX)
        ]:
            if _is_leftover(path):
                with suppress(OSError):
                    _remove(path)


def _remove_temporary(path: Path) -> None:
    """Remove what this process has written, or leave it to the next one.

    Windows removes no open file, as libhdf5 leaves one on a full disk.
    """
    with suppress(OSError):
        _remove(path)
    _living.discard(path)


def _remove(path: Path) -> None:
    """Removes a temporary file, or a folder of them."""
    if is_own_folder(path):
        for file in path.iterdir():
            file.unlink(missing_ok=True)
        path.rmdir()
    else:
        path.unlink(missing_ok=True)


def _is_leftover(path: Path) -> bool:
    match = LEFTOVER_PATTERN.fullmatch(path.name)
    if match is None or match["machine"] != _machine_name():
        return False
    process = int(match["process"])
    if process == os.getpid():
        return path not in _living
    return has_ended(process)


def _copy_into_device(source: Path, target: Path) -> None:
    """Writes a file into a device or a pipe."""
    with source.open("rb") as reader, target.open("wb", buffering=0) as writer:
        shutil.copyfileobj(reader, writer)


class Discarded(Exception):
    """Raised to discard what was written."""


class GrowingFile:
    """A file beside `target` until `close`; `discard` removes it.

    Parameters
    ----------
    use_fallback_folder : when the disk is full, continue in a new folder for temporary
        files, which only this user may enter

    Attributes
    ----------
    target : path of the file when closed, another folder after it had to move
    moved : reason why it had to move
    error : reason why the file is incomplete

    Raises
    ------
    InputError : see `atomic_path`.
    """

    def __init__(
        self, target: str | os.PathLike[str], use_fallback_folder: bool = False
    ) -> None:
        self.target, self._use_fallback_folder = Path(target), use_fallback_folder
        self.moved: OSError | None = None
        self.error: OSError | None = None
        self._at = self._size = 0
        self._unwritten_pages: dict[int, bytearray] = {}
        self._stack, self._file = _opened(self.target)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        begin = (0, self._at, self._size)[whence]
        self._at = begin + offset
        return self._at

    def tell(self) -> int:
        return self._at

    def write(self, data: Any) -> int:
        """Never raises; `check` does."""
        piece = memoryview(data).cast("B")
        try:
            self._put(piece)
        except OSError as error:
            self._save(error, piece)
        self._at += len(piece)
        self._size = max(self._size, self._at)
        return len(piece)

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        view = view[: max(0, self._size - self._at)]
        view[:] = self._stored(self._at, len(view))
        for page, inner, outer in _pages(self._at, len(view)):
            if page in self._unwritten_pages:
                view[outer] = self._unwritten_pages[page][inner]
        self._at += len(view)
        return len(view)

    def read(self, size: int) -> bytes:
        data = bytearray(size)
        return bytes(data[: self.readinto(data)])

    def readable(self) -> bool:
        return True

    def truncate(self, size: int) -> int:
        """The file grows by itself."""
        self._size = size
        if not self._unwritten_pages and os.fstat(self._file.fileno()).st_size > size:
            self._file.truncate(size)
        return size

    def flush(self) -> None:
        """Nothing waits here."""

    def check(self) -> None:
        """Raises why the file is not whole, if so."""
        if self.error is not None:
            raise self.error

    def close(self) -> None:
        """Move the file to its target.

        Raises
        ------
        OSError : it is incomplete, or cannot be moved; nothing is left.
        """
        if self.error is not None:
            self.discard()
            raise self.error
        self._stack.close()

    def discard(self) -> None:
        _discard(self._stack)

    def _put(self, piece: memoryview) -> None:
        """An unbuffered file may take a part and refuse the rest with the next call."""
        self.check()
        self._file.seek(self._at)
        while piece:
            piece = piece[self._file.write(piece) :]

    def _save(self, error: OSError, piece: memoryview) -> None:
        """Moves once, if that helps; else the piece stays in memory."""
        if self.error is None and self._use_fallback_folder and self.moved is None:
            self.moved = error
            if self._move():
                self.write(piece)
                self._at -= len(piece)
                return
        if self.error is None:
            name = os.fspath(self.target)
            self.error = OSError(error.errno, failure_reason(error), name)
        for page, inner, outer in _pages(self._at, len(piece)):
            if page not in self._unwritten_pages:
                self._unwritten_pages[page] = self._stored(page * PAGE, PAGE)
            self._unwritten_pages[page][inner] = piece[outer]

    def _stored(self, begin: int, count: int) -> bytearray:
        """Return the content on the disk, zeros beyond it."""
        stored = bytearray(count)
        view = memoryview(stored)
        self._file.seek(begin)
        while view and (read := self._file.readinto(view)):
            view = view[read:]
        return stored

    def _move(self) -> bool:
        """Continue in a new folder for temporary files, unless the file is there
        already.
        """
        parent = Path(tempfile.gettempdir())
        if parent.resolve() == self.target.parent.resolve():
            return False
        with ExitStack() as trial:
            try:
                folder = create_folder(parent, "sidtool-")
                trial.callback(_remove_empty, folder)
                other = folder / self.target.name
                opened, file = _opened(other)
                trial.push(opened)
                self._file.seek(0)
                shutil.copyfileobj(self._file, file)
            except (OSError, InputError):
                _discard(trial)
                return False
            stack = trial.pop_all()
        _discard(self._stack)
        self.target, self._stack, self._file = other, stack, file
        return True


def _pages(begin: int, count: int) -> Iterator[tuple[int, slice, slice]]:
    """Pages that some bytes lie on, where in the page and where among the bytes."""
    for page in range(begin // PAGE, -(-(begin + count) // PAGE)):
        first = max(begin, page * PAGE)
        last = min(begin + count, (page + 1) * PAGE)
        inner = slice(first - page * PAGE, last - page * PAGE)
        yield page, inner, slice(first - begin, last - begin)


def _opened(target: Path) -> tuple[ExitStack, io.FileIO]:
    with ExitStack() as stack:
        path = stack.enter_context(atomic_path(target))
        file = stack.enter_context(path.open("w+b", buffering=0))
        return stack.pop_all(), file


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


def _discard(stack: ExitStack) -> None:
    reason = Discarded()
    stack.__exit__(Discarded, reason, None)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Signals that end a run wait: none raises in what libhdf5 calls."""
    waiting: list[tuple[int, Any]] = []
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        before = {n: signal_handler(n) for n in present_signals(ENDING_SIGNALS)}
        before = {n: handler for n, handler in before.items() if callable(handler)}
    for number in before:
        handle_signal(
            number, lambda *signal_arguments: waiting.append(signal_arguments)
        )
    try:
        yield
    finally:
        for number, handler in before.items():
            handle_signal(number, handler)
        for number, frame in waiting:
            before[number](number, frame)
