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
from collections.abc import Callable, Iterable
from importlib import import_module
from queue import Empty, Queue

Say = Callable[[str], None]

#: Entry kernels as module:name, in groups that one process compiles, as they share
#: inner kernels; the slowest groups first.
Group = tuple[str, ...]
NEWTON: Group = ("kernels.newton:newton_factor", "kernels.newton:newton_solve")
PLANAR: list[Group] = [
    ("kernels.planar_forces:linearise",),
    ("kernels.planar_forces:evaluate",),
]
SPATIAL: list[Group] = [
    ("kernels.spatial_forces:linearise",),
    ("kernels.spatial_forces:evaluate",),
]
MASS: Group = ("kernels.newton:solve_accelerations", "kernels.newton:project_once")
COORDINATES: Group = (
    "kernels.coordinates:rate",
    "kernels.coordinates:retract",
    "kernels.newton:remember",
)
RECORDING: Group = ("integrators.recording:sample", "integrators.recording:begin")
#: Fewer kernels than this are compiled where they are used.
WORTH_PROCESSES = 3
#: New objects between two searches for garbage in a process that only compiles.
GARBAGE_THRESHOLD = 500_000


def say_compiling(text: str) -> None:
    """Tells a person who waits why; nobody waits where there is no terminal."""
    if sys.stderr.isatty():
        print(f"sidtool: {text}", file=sys.stderr, flush=True)


def ensure(planar: bool, step_loops: Iterable[str], say: Say = say_compiling) -> None:
    """Compiles what runs need and is not on disk yet, on all processors.

    Parameters
    ----------
    step_loops : the entry kernels of the integrators, as module:name
    say : told once, and only when something has to be compiled
    """
    equations = PLANAR if planar else SPATIAL
    _compile(_missing(_groups(step_loops, equations)), say)


def ensure_loop(step_loop: str) -> None:
    """Compiles a step loop that a run turns out to need."""
    if not _is_cached(step_loop):
        say_compiling("compiling the steps past singular positions, once")
        _compile_here(step_loop)


def warm_up(say: Say | None = None) -> int:
    """Compiles all kernels of all integrators; the number that had to be compiled."""
    missing = _missing(all_groups())
    _compile(missing, say, at_least=1)
    return sum(map(len, missing))


def all_groups() -> list[Group]:
    """All entry kernels."""
    from .integrators import INTEGRATORS

    methods = INTEGRATORS.values()
    loops = {loop for m in methods for loop in (m.step_loop, m.passing_loop) if loop}
    return _groups(sorted(loops), [*SPATIAL, *PLANAR])


def _groups(step_loops: Iterable[str], equations: list[Group]) -> list[Group]:
    """The slowest first."""
    loops = [(loop,) for loop in step_loops]
    return [*loops, NEWTON, *equations, MASS, RECORDING, COORDINATES]


def _missing(groups: Iterable[Group]) -> list[Group]:
    """What of them is not on disk."""
    left = [tuple(n for n in group if not _is_cached(n)) for group in groups]
    return [group for group in left if group]


def _compile(
    groups: list[Group], say: Say | None, at_least: int = WORTH_PROCESSES
) -> None:
    count = sum(map(len, groups))
    if count < at_least:
        for name in (name for group in groups for name in group):
            _compile_here(name)
        return
    if say is not None:
        say(f"compiling {count} kernels, once (half a minute or less)")
    queue: Queue[Group] = Queue()
    for group in groups:
        queue.put(group)
    helpers = [
        threading.Thread(target=_help, args=(queue,))
        for _ in range(min(len(groups), os.cpu_count() or 1) - 1)
    ]
    for helper in helpers:
        helper.start()
    _work(queue)
    for helper in helpers:
        helper.join()


def _work(queue: Queue[Group]) -> None:
    """Compiles here until no group is left."""
    while True:
        try:
            group = queue.get_nowait()
        except Empty:
            return
        for name in group:
            _compile_here(name)


def _help(queue: Queue[Group]) -> None:
    """Feeds another process with names until none is left.

    A process that dies is no harm: what it did not compile is compiled at first use.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdin is not None and process.stdout is not None
    try:
        while True:
            process.stdin.write(" ".join(queue.get_nowait()) + "\n")
            process.stdin.flush()
            if not process.stdout.readline():
                return
    except (Empty, BrokenPipeError):
        return
    finally:
        process.stdin.close()
        process.stdout.close()
        process.wait()


def _is_cached(name: str) -> bool:
    kernel = _find(name)
    return all(kernel.is_cached(signature) for signature in kernel.signatures)


def _find(name: str):  # type: ignore[no-untyped-def]
    module, _, kernel = name.partition(":")
    return getattr(import_module(f"solver.{module}"), kernel)


def _compile_here(name: str) -> None:
    kernel = _find(name)
    for signature in kernel.signatures:
        kernel.compiled(signature)


def _serve(lines: Iterable[str]) -> None:
    """Compiles the kernels named on standard input, answering each with a line."""
    gc.set_threshold(GARBAGE_THRESHOLD)
    for line in lines:
        for name in line.split():
            _compile_here(name)
        print("done", flush=True)


if __name__ == "__main__":
    _serve(sys.stdin)
