"""Compiling kernels once, side by side, before they are needed.

Kernels are compiled at first use and kept on disk. Whoever is about to use many of
them asks for all at once, so that every processor compiles a part.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from sidtool.formats.progress import is_heard, reached
from sidtool.formats.storage.operating_system import end_with, processors

from .compiler import stored

Say = Callable[[str], None]

#: Entry kernels as module:name, in groups that one process compiles, as they share
#: inner kernels.
Group = tuple[str, ...]
Groups = deque[Group]
NEWTON: Group = ("linear.newton:newton_factor", "linear.newton:newton_solve")
PLANAR: list[Group] = [
    ("equations.equations:linearise_in_plane",),
    ("equations.equations:evaluate_in_plane",),
    ("equations.equations:complete_in_plane",),
    ("equations.told:tell_forces_in_plane",),
]
SPATIAL: list[Group] = [
    ("equations.equations:linearise_in_space",),
    ("equations.equations:evaluate_in_space",),
    ("equations.equations:complete_in_space",),
    ("equations.told:tell_forces_in_space",),
]
#: Energies and momenta of bodies, in plane and in space: few scenes ask for them.
BODIES: tuple[Group, Group] = (
    ("equations.told:tell_bodies_in_plane",),
    ("equations.told:tell_bodies_in_space",),
)
MASS: Group = (
    "linear.accelerations:solve_accelerations",
    "linear.accelerations:project_once",
)
COORDINATES: Group = (
    "space.coordinates:rate",
    "space.coordinates:retract",
    "linear.newton:remember",
    "equations.drives:drive_values",
)
RECORDING: Group = (
    "integrators.recording:sample",
    "integrators.recording:begin",
    "integrators.recording:rub",
    "integrators.recording:jacobians",
    "linear.carried_joints:forces_of_carriers",
)
#: Entry kernels that were found on disk, or compiled, once, and what runs needed.
_seen: set[object] = set()
#: Fewer kernels than this are compiled where they are used.
WORTH_PROCESSES = 3
#: Seconds between two looks at what other processes have done.
TOLD = 0.2
#: New objects between two searches for garbage in a process that only compiles.
GARBAGE_THRESHOLD = 500_000
#: What another process runs: the package of this one, whatever stands in the
#: working folder; all else is looked for where every program looks.
HELPER = (
    "import sys; sys.path.insert(0, sys.argv[1]); import sidtool; "
    "del sys.path[0]; from sidtool.solver.warmup import serve; serve(int(sys.argv[2]))"
)
#: Settings of numba there: what it does not optimise is optimised once, as a whole.
SETTINGS = {"NUMBA_OPT": "0", "NUMBA_DISABLE_JIT": "0"}


def say_compiling(text: str) -> None:
    """Tells a person who waits why, at a terminal, a prompt or in a notebook."""
    if sys.stderr.isatty() or hasattr(sys, "ps1") or "ipykernel" in sys.modules:
        print(f"sidtool: {text}", file=sys.stderr, flush=True)


def ensure(
    planar: bool, step_loops: Iterable[str], bodies: bool, say: Say = say_compiling
) -> None:
    """Compiles what runs need and is not on disk yet, on all processors.

    Parameters
    ----------
    step_loops : the entry kernels of the integrators, as module:name
    bodies : whether energies or momenta of bodies are recorded
    say : told once, and only when something has to be compiled
    """
    loops = tuple(step_loops)
    wanted = planar, bodies, loops
    if wanted in _seen:
        return
    equations = list(PLANAR if planar else SPATIAL)
    if bodies:
        equations.append(BODIES[0 if planar else 1])
    _compile(_missing(_groups(loops, equations)), say)
    _seen.add(wanted)


def ensure_loop(step_loop: str) -> None:
    """Compiles a step loop that a run turns out to need."""
    if not _is_cached(step_loop):
        text = "compiling the steps past singular positions, once"
        reached(text) if is_heard() else say_compiling(text)
        _compile_here(step_loop)


def warm_up(step_loops: Iterable[str], say: Say | None = None) -> int:
    """Compiles all kernels, with these step loops; how many had to be compiled."""
    missing = _missing(all_groups(step_loops))
    _compile(missing, say, at_least=1)
    _work(deque(_missing(missing)), [])  # what another process could not keep
    return sum(map(len, missing))


def all_groups(step_loops: Iterable[str]) -> list[Group]:
    """All entry kernels, with these of the integrators."""
    return _groups(sorted(step_loops), [*SPATIAL, *PLANAR, *BODIES])


def _groups(step_loops: Iterable[str], equations: list[Group]) -> list[Group]:
    """Neighbours share inner kernels; the slowest stand at the ends."""
    loops = [(loop,) for loop in step_loops]
    return [*equations, RECORDING, COORDINATES, MASS, NEWTON, *loops]


def _missing(groups: Iterable[Group]) -> list[Group]:
    """What of them is not on disk."""
    left = [tuple(n for n in group if not _is_cached(n)) for group in groups]
    return [group for group in left if group]


def _compile(
    groups: list[Group], say: Say | None, at_least: int = WORTH_PROCESSES
) -> None:
    """On all processors, if what they compile can be kept on disk for this one."""
    count = sum(map(len, groups))
    many = count >= max(at_least, 1)
    if many and say is not None and not is_heard():
        say(f"compiling {count} kernels, once (half a minute or less)")
    queue, done = deque(groups), list[Group]()
    width = processors() if many and stored.is_writable() else 0

    def tell() -> None:
        if count:
            reached("compiling, once", sum(map(len, done)) / count)

    with _helpers(queue, min(len(groups), width), done, tell):
        pass
    _work(queue, done, tell)


def _work(
    queue: Groups, done: list[Group], tell: Callable[[], None] | None = None
) -> None:
    """Compiles here until no group is left."""
    while True:
        if tell is not None:
            tell()
        try:
            group = queue.popleft()
        except IndexError:
            return
        for name in group:
            _compile_here(name)
        done.append(group)


@contextmanager
def _helpers(
    queue: Groups, number: int, done: list[Group], tell: Callable[[], None]
) -> Iterator[None]:
    """Other processes that compile what is in the queue; none outlives the block."""
    processes: list[subprocess.Popen[str]] = []
    threads = []
    try:
        for k in range(number):
            processes.append(_new_process())
            take = queue.pop if k % 2 else queue.popleft
            feeding = (take, processes[-1], done)
            threads.append(threading.Thread(target=_feed, args=feeding))
            threads[-1].start()
        yield
        while alive := [thread for thread in threads if thread.is_alive()]:
            tell()
            alive[0].join(TOLD)
    finally:
        for process in processes:
            process.kill()
        for thread in threads:
            thread.join()
        for process in processes:
            process.communicate()


def _new_process() -> subprocess.Popen[str]:
    spec = find_spec("sidtool")
    assert spec is not None and spec.origin is not None
    root = Path(spec.origin).parents[1]
    return subprocess.Popen(
        [sys.executable, "-P", "-c", HELPER, str(root), str(os.getpid())],
        env=os.environ | SETTINGS,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        encoding="utf-8",
    )


def _feed(
    take: Callable[[], Group], process: subprocess.Popen[str], done: list[Group]
) -> None:
    """Gives another process names until none is left.

    Half of the processes begin at one end and half at the other, so that each gets
    groups that share inner kernels. A process that dies is no harm: what it did not
    compile is compiled at first use.
    """
    assert process.stdin is not None and process.stdout is not None
    try:
        while True:
            group = take()
            process.stdin.write(" ".join(group) + "\n")
            process.stdin.flush()
            if not process.stdout.readline():
                return
            done.append(group)
    except (IndexError, OSError):  # a closed pipe is an invalid argument on Windows
        return


def _is_cached(name: str) -> bool:
    if name not in _seen:
        kernel = _find(name)
        if not all(kernel.is_cached(signature) for signature in kernel.signatures):
            return False
        _seen.add(name)
    return True


def _find(name: str):  # type: ignore[no-untyped-def]
    module, _, kernel = name.partition(":")
    return getattr(import_module(f"sidtool.solver.{module}"), kernel)


def _compile_here(name: str) -> None:
    kernel = _find(name)
    for signature in kernel.signatures:
        kernel.address(signature)


def serve(parent: int) -> None:
    """Compiles the kernels named on standard input, answering each line with one.

    It ends with its input, and with `parent` also while it compiles. No thread reads
    the input: Windows would have every library wait for that which is loaded meanwhile.
    """
    gc.set_threshold(GARBAGE_THRESHOLD)
    end_with(parent)
    for line in sys.stdin:
        for name in line.split():
            _compile_here(name)
        print("done", flush=True)
