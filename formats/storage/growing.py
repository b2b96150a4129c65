"""Files that are written piece by piece and replace their target when complete."""

import io
import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from ..base.errors import InputError
from .atomic import atomic_path
from .operating_system import (
    ENDING_SIGNALS,
    create_folder,
    handle_signal,
    present_signals,
    signal_handler,
)
from .unreadable import failure_reason

#: Bytes that are held in memory together.
PAGE = 4096


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
