"""Differences between Linux, macOS and Windows."""

import errno
import os
import platform
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path, PureWindowsPath
from typing import Any

WINDOWS = sys.platform == "win32"
MACOS = sys.platform == "darwin"
#: What users know the signals by that end a program. Windows has no SIGHUP and lets
#: no other program send SIGTERM; the others have no SIGBREAK.
ENDING_SIGNALS = {
    "SIGINT": "Ctrl-C",
    "SIGTERM": "SIGTERM",
    "SIGHUP": "the end of its terminal",
    "SIGBREAK": "Ctrl-Break or the end of its console",
}
#: For how long and how often a file is replaced that another program holds [s].
PATIENCE, PAUSE = 2.0, 0.05
#: How often the parent of a process is looked for where it cannot be waited for [s].
PARENT_PAUSE = 1.0
#: What stands between the options of a command on several lines; shells of Windows have
#: no common sign for that, and read one line.
LINE_CONTINUATION = " " if WINDOWS else " \\\n    "
#: Windows waits for at most 63 processes, two of which are those of a pool itself.
MAX_POOL_PROCESSES = 61 if WINDOWS else 10_000
#: Windows ends a program so long after its console was closed [s].
CLOSING = 5.0
#: Error numbers of Windows: refused, as the file is open in another program.
_SHARING_VIOLATION, _LOCK_VIOLATION, _ACCESS_DENIED = 32, 33, 5
#: Longer paths are refused by Windows unless they are extended or it is set up for
#: them; folders have to leave room for a name of 8.3 characters.
LONGEST_PATH, LONGEST_FOLDER = 259, 247
#: Permissions to write that others than the owner may have.
OF_OTHERS = stat.S_IWGRP | stat.S_IWOTH
#: Permissions of a new file, of which the system takes the umask off.
USUAL, PRIVATE = 0o666, 0o600
_DEVICES = {"CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"} | {
    f"{port}{digit}" for port in ("COM", "LPT") for digit in "123456789\xb9\xb2\xb3"
}


# Files

Handler = Any
DEFAULT, IGNORED = signal.SIG_DFL, signal.SIG_IGN
INTERRUPT = signal.SIGINT


class Untrusted(PermissionError):
    """Another user may have written a file that only this one is to have written."""


def create_file(folder: Path, prefix: str, suffix: str, mode: int = PRIVATE) -> Path:
    """A new empty file; the system takes the umask off its mode.

    `tempfile.mkstemp` never ends in a folder of Windows that cannot be written
    (CPython issue 66305).

    Raises
    ------
    OSError : the folder does not exist or cannot be written to.
    """
    while True:
        path = folder / f"{prefix}{os.urandom(4).hex()}{suffix}"
        try:
            with open(path, "xb", opener=lambda p, flags: os.open(p, flags, mode)):
                return path
        except FileExistsError:
            continue


def create_folder(parent: Path, prefix: str, suffix: str = "") -> Path:
    """Create a new folder with an unpredictable name that only this user may enter.

    Raises
    ------
    OSError : the parent does not exist or cannot be written to.
    """
    while True:
        path = parent / f"{prefix}{os.urandom(8).hex()}{suffix}"
        try:
            path.mkdir(mode=0o700)
            return path
        except FileExistsError:
            continue


def read_trusted(path: Path, like: Path | None = None) -> bytes:
    """Read a file that only this user or the administrator can have written.

    File and folder must belong to one of them and not be writable by others, as
    OpenSSH asks of its files. The access control lists of Windows are not examined.

    Parameters
    ----------
    like : a folder that is trusted as it is: its owner and its writers are trusted

    Raises
    ------
    Untrusted : others can have written it.
    OSError : it cannot be read.
    """
    if WINDOWS:
        return path.read_bytes()
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        _check_trusted_folder(os.fstat(folder), path.parent, like)
        file = os.open(path.name, os.O_RDONLY | os.O_NONBLOCK, dir_fd=folder)
    finally:
        os.close(folder)
    with open(file, "rb") as stream:
        _check_trusted(os.fstat(file), path, like)
        return stream.read()


def make_trusted_folder(folder: Path, like: Path | None = None) -> None:
    """Make a folder for files that `read_trusted` is to read, if it is not there.

    Others lose the permission to write to one that this user owns.

    Raises
    ------
    Untrusted : it belongs to another user.
    OSError : it cannot be made.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o755, exist_ok=True)
    if WINDOWS:
        return
    status = folder.lstat()
    own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid()
    if own and status.st_mode & OF_OTHERS and like is None:
        folder.chmod(stat.S_IMODE(status.st_mode) & ~OF_OTHERS)
    _check_trusted_folder(folder.stat(), folder, like)


def _check_trusted_folder(
    status: os.stat_result, path: Path, like: Path | None
) -> None:
    """Check a folder, and the link that may refer to it."""
    _check_trusted(status, path, like)
    link = path.lstat()
    if stat.S_ISLNK(link.st_mode):
        _check_trusted(link, path, like)


def _check_trusted(status: os.stat_result, path: Path, like: Path | None) -> None:
    owners, writable = {0, os.geteuid()}, status.st_mode & OF_OTHERS
    if like is not None:
        trusted = like.stat()
        owners.add(trusted.st_uid)
        writable &= ~trusted.st_mode
    problem = "belongs to another user" if status.st_uid not in owners else ""
    if writable and not problem and not stat.S_ISLNK(status.st_mode):
        problem = "others may write to it"
    if problem:
        raise Untrusted(errno.EACCES, problem, os.fspath(path))


def is_own_folder(path: Path) -> bool:
    """Whether a path is a folder of this user, and no link to one."""
    status = path.lstat()
    return stat.S_ISDIR(status.st_mode) and (WINDOWS or status.st_uid == os.geteuid())


def flush_to_disk(path: Path) -> None:
    """Wait until a file is on its disk; Windows flushes only what may be written."""
    with path.open("rb+") as stream:
        os.fsync(stream.fileno())


def set_mode(path: Path, mode: int) -> None:
    """Permissions of a file; on Windows they are those of its folder."""
    if not WINDOWS:
        path.chmod(stat.S_IMODE(mode))


def replace_file(source: Path, target: Path) -> None:
    """Give a file or folder its name, in place of the file that has it.

    On Windows a file that is open elsewhere cannot be replaced: antivirus programs and
    indexes hold new files for a moment, so that it is tried again for two seconds.

    Raises
    ------
    OSError : `target` cannot be replaced; both files are as before.
    """
    if is_read_only(target):
        raise PermissionError(errno.EACCES, "is read-only", os.fspath(target))
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return os.replace(source, target)
        except OSError as error:
            if not _is_locked(error) or time.monotonic() > deadline:
                raise
        time.sleep(PAUSE)


def _is_locked(error: OSError) -> bool:
    codes = _SHARING_VIOLATION, _LOCK_VIOLATION, _ACCESS_DENIED
    return getattr(error, "winerror", None) in codes


def is_open_in_other_program(path: Path) -> bool:
    """Whether a file cannot be replaced now, as another program has it open.

    Only Windows refuses that. To give a file its own name changes nothing there, and
    asks for all that replacing it does.
    """
    if not WINDOWS or not path.is_file():
        return False
    try:
        os.rename(path, path)
    except OSError as error:
        return _is_locked(error)
    return False


def is_read_only(path: Path) -> bool:
    """Whether a file cannot be replaced because of its own attribute, as on Windows."""
    if not WINDOWS:
        return False
    try:
        return not path.stat().st_mode & stat.S_IWRITE
    except OSError:
        return False


def is_writable_folder(folder: Path) -> bool:
    """Check whether files can be created in a folder; on Windows by trying."""
    if not folder.is_dir():
        return False
    if not WINDOWS:
        return os.access(folder, os.W_OK)
    try:
        create_file(folder, ".sidtool-", ".tmp").unlink()
    except OSError:
        return False
    return True


def extended_path(path: Path) -> Path:
    """The same path, in the form that Windows takes at any length."""
    text = os.path.abspath(path)
    if not WINDOWS or len(text) <= LONGEST_FOLDER or text.startswith("\\\\?\\"):
        return path
    if text.startswith("\\\\"):
        return Path("\\\\?\\UNC\\" + text[2:])
    return Path("\\\\?\\" + text)


def path_from(folder: Path, path: Path) -> str:
    """Return a path relative to a folder, or absolute if it is on another drive."""
    try:
        return os.path.relpath(path, folder)
    except ValueError:  # of Windows: no path leads from C: to D:
        return str(path.resolve())


def path_problem(path: Path) -> str:
    """Why this system has no file of such a name; empty if it may have one."""
    return windows_path_problem(os.fspath(path)) if WINDOWS else ""


def length_problem(path: Path) -> str:
    """That a path is too long for a Windows that is not set up for long ones."""
    length = len(os.path.abspath(path))
    if not WINDOWS or length <= LONGEST_PATH:
        return ""
    return f"has {length} characters, of which Windows takes {LONGEST_PATH}"


def windows_path_problem(path: str) -> str:
    """The same for Windows: devices, forbidden characters, dots that it drops."""
    pure = PureWindowsPath(path)
    for part in pure.parts[1:] if pure.anchor else pure.parts:
        stem = part.partition(".")[0].rstrip(" ").upper()
        if stem in _DEVICES:
            return f"{part!r} is the name of a device of Windows"
        if part in (".", ".."):
            continue
        if part[-1] in ". ":
            return f"{part!r} ends with a dot or space, which Windows drops"
        invalid = [c for c in part if c in '<>:"|?*' or ord(c) < 32]
        if invalid:
            return f"{part!r} holds {invalid[0]!r}, which Windows forbids in names"
    return ""


def cache_folder() -> Path | None:
    """Return the cache folder of this user.

    XDG_CACHE_HOME decides on all systems. Else it is ~/.cache on Linux,
    ~/Library/Caches on macOS, and LOCALAPPDATA on Windows.

    Returns
    -------
    the folder, or None if the user has no home
    """
    chosen = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if chosen.is_absolute():
        return chosen / "sidtool"
    local = Path(os.environ.get("LOCALAPPDATA", ""))
    if WINDOWS and local.is_absolute():
        return local / "sidtool" / "Cache"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    return home / ("Library/Caches" if MACOS else ".cache") / "sidtool"


#: Path of the standard output as a file; Windows has none.
STANDARD_OUTPUT = None if WINDOWS else "/dev/stdout"


def is_closed_pipe(error: OSError) -> bool:
    """Check whether the reader of the output has ended; Windows calls that invalid."""
    if isinstance(error, BrokenPipeError):
        return True
    return WINDOWS and error.errno == errno.EINVAL and error.filename is None


# Processes


def system_and_processor() -> tuple[str, str]:
    """Names of the system ("linux", "win32", "darwin") and of the processor, in lower
    case.
    """
    return sys.platform, platform.machine().lower()


def processors() -> int:
    """How many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def release_free_memory() -> None:
    """Return memory to the system that the allocator of C keeps for later (glibc)."""
    import ctypes

    if not (WINDOWS or MACOS):
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def busy_seconds(passed: float, busy: float) -> float:
    """Return the part of an elapsed time [s] in which a processor worked for this
    program.

    Parameters
    ----------
    busy : difference of two readings of `time.thread_time` or `time.process_time`,
        which Windows updates 64 times a second only; an interval shorter than some such
        steps counts fully
    """
    step = 1.0 / 64.0 if WINDOWS else 0.0
    return passed if passed < 10.0 * step else min(busy, passed)


@cache
def process_list() -> str:
    """A name for those who count the same processes: a machine, or a container."""
    if sys.platform == "win32":
        return os.environ.get("COMPUTERNAME", "")
    name = os.uname().nodename
    with suppress(OSError):
        name += os.readlink("/proc/self/ns/pid")
    return name


def has_ended(process: int) -> bool:
    """Whether no process has this number; False if that cannot be known."""
    if sys.platform == "win32":
        return _has_ended_on_windows(process)
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    return False


def end_with_parent(parent: int) -> None:
    """End this process as soon as `parent`, which started it, has ended."""

    def watch() -> None:
        _wait_for_end(parent)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _wait_for_end(parent: int) -> None:
    if sys.platform == "win32":
        _wait_on_windows(parent)
    else:
        while os.getppid() == parent:
            time.sleep(PARENT_PAUSE)


# `os.kill(process, 0)` ends a process of Windows, and `os.getppid` goes on telling the
# number of a parent that has ended. A handle can be asked and waited for.
if sys.platform == "win32":
    _SYNCHRONIZE, _NO_SUCH_PROCESS, _ENDED, _ALWAYS = 0x00100000, 87, 0, 0xFFFFFFFF
    _EXTENDED_LIMITS, _KILL_ON_JOB_CLOSE = 9, 0x2000
    #: Words of JOBOBJECT_EXTENDED_LIMIT_INFORMATION on 64 bits; which of them is flags.
    _JOB_LIMITS_SIZE, _JOB_FLAGS = 36, 4

    def _kernel() -> Any:
        import ctypes
        from ctypes import wintypes

        kernel = ctypes.WinDLL("kernel32", use_last_error=True)
        kernel.OpenProcess.restype = wintypes.HANDLE
        kernel.OpenProcess.argtypes = wintypes.DWORD, wintypes.BOOL, wintypes.DWORD
        kernel.WaitForSingleObject.argtypes = wintypes.HANDLE, wintypes.DWORD
        kernel.WaitForSingleObject.restype = wintypes.DWORD
        kernel.CloseHandle.argtypes = (wintypes.HANDLE,)
        return kernel

    def _has_ended_on_windows(process: int) -> bool:
        import ctypes

        if process >= 1 << 32:
            return False
        kernel = _kernel()
        handle = kernel.OpenProcess(_SYNCHRONIZE, False, process)
        if not handle:
            return ctypes.get_last_error() == _NO_SUCH_PROCESS
        try:
            return bool(kernel.WaitForSingleObject(handle, 0) == _ENDED)
        finally:
            kernel.CloseHandle(handle)

    def _wait_on_windows(process: int) -> None:
        kernel = _kernel()
        handle = kernel.OpenProcess(_SYNCHRONIZE, False, process)
        if handle:
            kernel.WaitForSingleObject(handle, _ALWAYS)


def end_children_with_this_process() -> None:
    """Have Windows end the processes that this one starts as soon as it ends.

    They belong to a job from their beginning, so that those end, too, that do not look
    for their parent yet. Windows closes the job with its only handle, and ends what is
    in it. On other systems nothing is done.
    """
    if sys.platform == "win32":
        import ctypes
        from ctypes import wintypes

        kernel = _kernel()
        kernel.CreateJobObjectW.restype = wintypes.HANDLE
        kernel.GetCurrentProcess.restype = wintypes.HANDLE
        kernel.AssignProcessToJobObject.argtypes = wintypes.HANDLE, wintypes.HANDLE
        kernel.SetInformationJobObject.argtypes = (
            wintypes.HANDLE,
            ctypes.c_int,
            wintypes.LPVOID,
            wintypes.DWORD,
        )
        limits = (wintypes.DWORD * _JOB_LIMITS_SIZE)()
        limits[_JOB_FLAGS] = _KILL_ON_JOB_CLOSE
        job = kernel.CreateJobObjectW(None, None)
        if kernel.SetInformationJobObject(
            job, _EXTENDED_LIMITS, limits, ctypes.sizeof(limits)
        ):
            kernel.AssignProcessToJobObject(job, kernel.GetCurrentProcess())


# Signals


def present_signals(names: Any) -> list[signal.Signals]:
    """Return those of the named signals that this system has."""
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


def signal_name(number: int) -> str:
    """Return the usual name of a signal."""
    name = signal.Signals(number).name
    return ENDING_SIGNALS.get(name, name)


def signal_handler(number: int) -> Handler:
    """Return the current handler of a signal."""
    return signal.getsignal(number)


def handle_signal(number: int, handler: Handler) -> Handler:
    """Answer a signal with `handler(number, frame)`; what answered it before."""
    return signal.signal(number, handler)


@contextmanager
def hold_ending_signals() -> Iterator[None]:
    """Let signals that end a program wait, also in processes that are started inside.

    Such a process holds them until it calls `ignore_ending_signals`. Otherwise a signal
    to all processes of a terminal or a job ends it while it imports modules. Windows
    cannot hold signals.
    """
    if sys.platform == "win32":
        yield
        return
    held = present_signals(ENDING_SIGNALS)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, held)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_ending_signals() -> None:
    """Ignore signals that end a program, and forget those that were held."""
    numbers = present_signals(ENDING_SIGNALS)
    for number in numbers:
        signal.signal(number, IGNORED)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)


def is_usual_interrupt(handler: Handler) -> bool:
    """Check whether Ctrl-C has the default handler of Python or the system."""
    return handler in (signal.default_int_handler, signal.SIG_DFL)


def handle_console_close() -> None:
    """Answer the end of a console as SIGBREAK, and use the seconds that are left.

    Windows ends a program when its handler returns, and after five seconds at latest.
    """
    if sys.platform == "win32":
        import _thread
        import ctypes

        close_events = (
            2,
            5,
            6,
        )  # CTRL_CLOSE_EVENT, CTRL_LOGOFF_EVENT, CTRL_SHUTDOWN_EVENT

        def on_close(kind: int) -> bool:
            if kind not in close_events:
                return False
            _thread.interrupt_main(signal.SIGBREAK)
            time.sleep(CLOSING)
            return True

        handler = ctypes.WINFUNCTYPE(ctypes.c_int, ctypes.c_uint)(on_close)
        _kept_handlers.append(handler)
        ctypes.WinDLL("kernel32").SetConsoleCtrlHandler(handler, True)


#: Of functions that Windows calls, as long as the process lives.
_kept_handlers: list[Callable[..., Any]] = []
