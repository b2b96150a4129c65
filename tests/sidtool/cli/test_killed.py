"""Runs that are killed: nothing half-written, nothing left that stays."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from sidtool.cli.main import run
from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.storage.operating_system import has_ended
from tests.codes import unwrapped
from tests.places import SLIDER_CRANK, posix
from tests.processes import Ended, PythonProcess

#: The command line, stopped in the midst of writing its output. It sleeps in pieces: a
#: signal just before a call to sleep is answered after that call only.
STOPPED = """
import os, sys, time
from importlib import import_module
from sidtool.cli.main import main

module = import_module({module!r})

def stop(*arguments, **more):
    print("writing", flush=True)
    for _ in range(6000):
        time.sleep(0.01)

{stop} = stop
sys.argv[1:] = {arguments!r}
main()
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("slider_crank.toml", "rod_q4.SID_FEM"):
        shutil.copy(SLIDER_CRANK / name, tmp_path / name)
    return tmp_path


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def killed(
    folder: Path,
    arguments: list[str],
    number: int | None,
    stop: str = "module.flush_to_disk",
    module: str = "sidtool.formats.storage.atomic",
) -> Ended:
    """A command that gets a signal, or is killed without one, while it writes."""
    code = STOPPED.format(arguments=arguments, stop=stop, module=module)
    with PythonProcess(code, folder) as process:
        if process.wait_for_line("writing"):
            process.kill() if number is None else process.send_signal(number)
        return process.wait()


#: Ctrl-C when the first module of the command line is imported.
EARLY = """
import signal, sys
from sidtool import command

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "sidtool.cli.main":
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Finder())
command.main()
"""
#: A second Ctrl-C while the first one is answered.
TWICE = """
import signal, sys
from sidtool import command
from sidtool.cli import main

def interrupt(*arguments, **named):
    try:
        signal.raise_signal(signal.SIGINT)
    finally:
        signal.raise_signal(signal.SIGINT)

main.cli.main = interrupt
command.main()
"""
#: The exit status of a process that is ended by force.
KILLED = -signal.SIGTERM if sys.platform == "win32" else -9
CONVERT = ["convert", "rod_q4.SID_FEM", "-o", "rod.h5"]


@posix
@pytest.mark.parametrize(
    ("name", "status"), [("SIGTERM", 143), ("SIGHUP", 129), ("SIGINT", 130)]
)
def test_a_terminated_run_cleans_up(name: str, status: int, folder: Path) -> None:
    before = names(folder)
    done = killed(folder, CONVERT, signal.Signals[name])
    assert done.status == status, done.stderr
    assert done.stderr.strip().count("\n") == 0
    assert names(folder) == before


@posix
def test_a_factorisation_can_be_ended(folder: Path) -> None:
    """It runs beside the main thread, which is torn down while it goes on."""
    shutil.copy(SLIDER_CRANK / "rod_q4.toml", folder)
    before, module = names(folder), "sidtool.eigensolvers.factorisation"
    command = ["convert", "rod_q4.toml", "-o", "rod.h5"]
    done = killed(folder, command, signal.SIGTERM, "module.splu", module)
    assert done.status == 143, done.stderr
    assert done.stderr.strip().splitlines()[-1] == "sidtool: ended by a signal"
    assert names(folder) == before


@posix
@pytest.mark.parametrize("arguments", [["-c", EARLY], ["-c", TWICE]])
def test_ctrl_c_while_modules_are_imported_and_again_after_it(
    arguments: list[str],
) -> None:
    """Nothing is said of the program's own lines (there was a traceback)."""
    done = subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        encoding="utf-8",
    )
    assert (done.returncode, done.stderr) == (-signal.SIGINT, "")


def test_the_next_run_removes_files_of_a_killed_one(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    before = names(folder)
    assert killed(folder, CONVERT, None).status == KILLED
    (rest,) = names(folder) - before
    assert rest.endswith(".part") and not (folder / "rod.h5").exists()
    assert run(["convert", "rod_q4.SID_FEM", "-o", "other.h5"]) == 0
    assert names(folder) == before | {"other.h5"}


SIMULATE = ["simulate", "slider_crank.toml", "--set", "time.end=0.1"]


@pytest.mark.parametrize(
    ("module", "stop", "table_is_complete"),
    [
        ("sidtool.formats.result.hdf5", "ResultFile.add", False),
        ("sidtool.formats.storage.atomic", "flush_to_disk", False),
        ("sidtool.formats.result.hdf5", "ResultFile.finish", True),
    ],
)
def test_a_killed_simulation_writes_no_half_file(
    module: str,
    stop: str,
    table_is_complete: bool,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each target is as before or complete, and the next run removes the rests."""
    monkeypatch.chdir(folder)
    result, table = folder / "r.h5", folder / "r.csv"
    for target in (result, table):
        target.write_bytes(b"as before")
    before = names(folder)
    command = [*SIMULATE, "--force", "-o", result.name, "-o", table.name]
    assert killed(folder, command, None, f"module.{stop}", module).status == KILLED
    assert result.read_bytes() == b"as before"
    assert (table.read_bytes() != b"as before") == table_is_complete
    rests = names(folder) - before
    assert rests and all(name.endswith(".part") for name in rests)
    assert run([*SIMULATE, "-o", "other.h5", "-o", "other.csv"]) == 0
    assert names(folder) == before | {"other.h5", "other.csv"}
    if table_is_complete:
        assert table.read_bytes() == (folder / "other.csv").read_bytes()


def gone() -> int:
    """The number of a process that has ended."""
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    return process.pid


@pytest.mark.parametrize(
    ("rename", "stays"),
    [
        (lambda name: name, True),
        (lambda name: name.replace(f"-{os.getpid()}-", f"-{gone()}-"), False),
        pytest.param(  # Windows has no process 1
            lambda name: name.replace(f"-{os.getpid()}-", "-1-"), True, marks=posix
        ),
        (lambda name: name.replace(f"-{os.getpid()}-", f"-{2**70}-"), True),
        (lambda name: "another" + name, True),
        (lambda name: name.replace(".part", ".part.bak"), True),
        (lambda name: ".thesis.part", True),
    ],
)
def test_only_rests_of_processes_that_are_gone_are_removed(
    rename: Callable[[str], str], stays: bool, tmp_path: Path
) -> None:
    """Not what others write just now, nor what only has a similar name."""
    with atomic_path(tmp_path / "first") as first:
        other = tmp_path / rename(first.name)
        other.write_text("text", encoding="utf-8")
        with atomic_path(tmp_path / "second") as second:
            second.write_text("2", encoding="utf-8")
        assert other.exists() == stays
        first.write_text("1", encoding="utf-8")
    assert (tmp_path / "first").read_text(encoding="utf-8") == "1"


def test_temporary_files_of_a_running_process_are_kept(tmp_path: Path) -> None:
    waiting = [sys.executable, "-c", "input()"]
    with (
        atomic_path(tmp_path / "first") as first,
        subprocess.Popen(waiting, stdin=subprocess.PIPE) as process,
    ):
        running = f"-{process.pid}-"
        other = tmp_path / first.name.replace(f"-{os.getpid()}-", running)
        other.write_text("text", encoding="utf-8")
        with atomic_path(tmp_path / "second") as second:
            second.write_text("2", encoding="utf-8")
        assert other.exists()
        process.communicate(b"\n")
        first.write_text("1", encoding="utf-8")


def test_temporary_files_of_another_machine_are_kept(tmp_path: Path) -> None:
    """Its processes cannot be seen from here."""
    rest = tmp_path / f".rod.h5.01234567-{gone()}-abcdefgh.part"
    rest.write_text("", encoding="utf-8")
    with atomic_path(tmp_path / "file") as temporary:
        temporary.write_text("", encoding="utf-8")
    assert rest.exists()


def test_names_may_be_as_long_as_before(tmp_path: Path) -> None:
    for name in ("n" * 255, "\N{GREEK SMALL LETTER OMEGA}" * 127):
        with atomic_path(tmp_path / name) as temporary:
            temporary.write_text("text", encoding="utf-8")
        assert (tmp_path / name).read_text(encoding="utf-8") == "text"


STUDY = ["study", "slider_crank.toml", "-o", "deep/study", "--integrator", "radau9"]
STUDY += ["--rtol", "1e-3", "--jobs", "1", "--set", "time.end=0.1"]


@pytest.mark.parametrize(
    ("module", "stop"),
    [("sidtool.api.study", "study"), ("sidtool.plot.studies", "plot_study")],
)
def test_a_killed_study_leaves_no_folder_half_filled(
    module: str, stop: str, folder: Path
) -> None:
    """Before its runs there is no folder yet; while it plots no text either."""
    done = killed(folder, STUDY, None, f"module.{stop}", module)
    assert done.status == KILLED
    created = names(folder) - {"slider_crank.toml", "rod_q4.SID_FEM"}
    if stop == "study":
        assert created == set()
    assert not any(name.endswith((".txt", ".png")) for name in created)


def test_a_study_first_refuses_a_folder_that_cannot_be_made(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert run([*STUDY[:3], "slider_crank.toml/study"]) == 2
    assert "cannot be a folder to write to" in unwrapped(capsys.readouterr().err)


COMPILING = """
import os, sys, time
os.environ["NUMBA_CACHE_DIR"] = {cache!r}
from sidtool.cli.main import main
from sidtool.solver.compiler import precompile

precompile.HELPER = {helper!r}
started = precompile._new_process
def new():
    process = started()
    print(process.pid, flush=True)
    return process
precompile._new_process = new
precompile.all_groups = lambda loops: [("a:a",), ("b:b",)]
precompile._is_cached = lambda name: False
precompile._compile_here = lambda name: time.sleep(60)
precompile.processors = lambda: 2
sys.argv[1:] = ["warmup"]
main()
"""
#: A compiling process with a kernel that takes a minute.
SLOW = (
    "import sys, time; sys.path.insert(0, sys.argv[1]); import sidtool; "
    "from sidtool.solver.compiler import precompile; "
    "precompile._compile_here = lambda name: time.sleep(60); "
    "precompile.serve_compilation(int(sys.argv[2]))"
)


#: One that does nothing yet, as while it imports modules, and so cannot see an end.
ASLEEP = "import time; time.sleep(60)"
windows = pytest.mark.skipif(sys.platform != "win32", reason="behaviour of Windows")


@pytest.mark.parametrize(
    ("name", "helper"),
    [
        pytest.param("SIGTERM", SLOW, marks=posix),
        pytest.param("SIGINT", SLOW, marks=posix),
        ("", SLOW),
        pytest.param("", ASLEEP, marks=windows),
    ],
)
def test_compiling_processes_end_with_their_parent(
    name: str, helper: str, tmp_path: Path
) -> None:
    """A process that is inside a kernel also ends with its parent, which may be killed
    without a signal.
    """
    code = COMPILING.format(helper=helper, cache=str(tmp_path))
    with PythonProcess(code, tmp_path) as process:
        number = int(process.wait_for_line())
        time.sleep(0.3)
        process.send_signal(signal.Signals[name]) if name else process.kill()
        process.wait()
    deadline = time.monotonic() + 30
    while _alive(number) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _alive(number)


def _alive(process: int) -> bool:
    """Return whether a process runs; a zombie does not."""
    if sys.platform == "win32":
        return not has_ended(process)
    try:
        text = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except OSError:
        return False
    return text.rpartition(")")[2].split()[0] != "Z"


def test_threads_do_not_take_each_others_files_for_rests(tmp_path: Path) -> None:
    def write(k: int) -> None:
        for n in range(40):
            with atomic_path(tmp_path / f"{k}.{n}") as temporary:
                temporary.write_text("text", encoding="utf-8")

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(write, range(4)))
    assert len(names(tmp_path)) == 160
