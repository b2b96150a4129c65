"""Compilation of all kernels before they are needed, in parallel processes.

Kernels are compiled at first use and cached on disk. A caller that is about to use many
of them requests all at once, so that every processor compiles a part.
"""

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
from typing import Any

from sidtool.formats.base.progress import has_listener, report_stage
from sidtool.formats.storage.operating_system import end_with_parent, processors

from . import kernel_cache

Say = Callable[[str], None]

#: Entry kernels as module:name, in groups that one process compiles, as they share
#: inner kernels.
Group = tuple[str, ...]
Groups = deque[Group]
NEWTON: Group = (
    "linear.newton_matrix:newton_factor",
    "linear.newton_matrix:newton_solve",
)
PLANAR_EQUATIONS: list[Group] = [
    ("dynamics.equations_of_motion:linearise_in_plane",),
    ("dynamics.equations_of_motion:evaluate_in_plane",),
    ("dynamics.equations_of_motion:complete_in_plane",),
    ("dynamics.output_quantities:write_forces_in_plane",),
]
SPATIAL_EQUATIONS: list[Group] = [
    ("dynamics.equations_of_motion:linearise_in_space",),
    ("dynamics.equations_of_motion:evaluate_in_space",),
    ("dynamics.equations_of_motion:complete_in_space",),
    ("dynamics.output_quantities:write_forces_in_space",),
]
#: Energies and momenta of bodies, in plane and in space: few scenes ask for them.
BODY_OUTPUTS: tuple[Group, Group] = (
    ("dynamics.output_quantities:write_bodies_in_plane",),
    ("dynamics.output_quantities:write_bodies_in_space",),
)
MASS_SOLVERS: Group = (
    "linear.accelerations:solve_accelerations",
    "linear.accelerations:project_once",
)
COORDINATES: Group = (
    "spatial.coordinates:rate",
    "spatial.coordinates:retract",
    "linear.newton_matrix:store_linearisation",
    "dynamics.drives:function_values",
)
SAMPLING: Group = (
    "integrators.output_sampling:sample",
    "integrators.output_sampling:evaluate_start",
    "integrators.output_sampling:evaluate_friction",
    "integrators.output_sampling:evaluate_jacobians",
    "linear.driven_joint_reactions:driven_joint_reactions",
)
#: Derivatives of motions: few programs ask for them.
DERIVATIVES: Group = tuple(
    f"integrators.batch_evaluation:{name}"
    for name in (
        "accelerations_of_states",
        "residuals_of_states",
        "constraints_of_states",
        "linearise_states",
        "solve_columns",
        "slope_derivatives",
        "rates_of_states",
        "linearise_projections",
    )
) + ("integrators.linearised_steps:march",)
#: Entry kernels that were found on disk, or compiled, once, and what runs needed.
_available: set[object] = set()
#: Fewer kernels than this are compiled where they are used.
MIN_FOR_PROCESSES = 3
#: Seconds between two looks at what other processes have done.
PROGRESS_INTERVAL = 0.2
#: New objects between two searches for garbage in a process that only compiles.
GARBAGE_THRESHOLD = 500_000
#: What another process runs: the package of this one, whatever is in the
#: working folder; all else is looked for where every program looks.
HELPER = (
    "import sys; sys.path.insert(0, sys.argv[1]); import sidtool; "
    "del sys.path[0]; from sidtool.solver.compiler.precompile "
    "import serve_compilation; serve_compilation(int(sys.argv[2]))"
)
#: Settings of numba there: what it does not optimise is optimised once, as a whole.
SETTINGS = {"NUMBA_OPT": "0", "NUMBA_DISABLE_JIT": "0"}


def print_compiling(text: str) -> None:
    """Shows a person who waits the reason, at a terminal, a prompt or in a notebook."""
    if sys.stderr.isatty() or hasattr(sys, "ps1") or "ipykernel" in sys.modules:
        print(f"sidtool: {text}", file=sys.stderr, flush=True)


def ensure_compiled(
    planar: bool, step_loops: Iterable[str], bodies: bool, say: Say = print_compiling
) -> None:
    """Compiles what runs need and is not on disk yet, on all processors.

    Parameters
    ----------
    step_loops
        The entry kernels of the integrators, as module:name.
    bodies
        Whether energies or momenta of bodies are recorded.
    say
        Told once, and only when something has to be compiled.
    """
    loops = tuple(step_loops)
    key = planar, bodies, loops
    if key in _available:
        return
    equations = list(PLANAR_EQUATIONS if planar else SPATIAL_EQUATIONS)
    if bodies:
        equations.append(BODY_OUTPUTS[0 if planar else 1])
    _compile(_missing(_groups(loops, equations)), say)
    _available.add(key)


def ensure_step_loop(step_loop: str) -> None:
    """Compiles a step loop that a run turns out to need."""
    if not _is_cached(step_loop):
        text = "compiling the steps past singular positions, once"
        report_stage(text) if has_listener() else print_compiling(text)
        _compile_here(step_loop)


def precompile_all(step_loops: Iterable[str], say: Say | None = None) -> int:
    """Compiles all kernels, with these step loops; how many had to be compiled."""
    missing = _missing(all_groups(step_loops))
    _compile(missing, say, at_least=1)
    _compile_queue(deque(_missing(missing)), [])  # what another process could not keep
    return sum(map(len, missing))


def all_groups(step_loops: Iterable[str]) -> list[Group]:
    """All entry kernels, with these of the integrators."""
    equations = [*SPATIAL_EQUATIONS, *PLANAR_EQUATIONS, *BODY_OUTPUTS]
    return [*_groups(sorted(step_loops), equations), DERIVATIVES]


def _groups(step_loops: Iterable[str], equations: list[Group]) -> list[Group]:
    """Neighbours share inner kernels; the slowest are at the ends."""
    loops = [(loop,) for loop in step_loops]
    return [*equations, SAMPLING, COORDINATES, MASS_SOLVERS, NEWTON, *loops]


def _missing(groups: Iterable[Group]) -> list[Group]:
    """What of them is not on disk."""
    missing = [tuple(n for n in group if not _is_cached(n)) for group in groups]
    return [group for group in missing if group]


def _compile(
    groups: list[Group], say: Say | None, at_least: int = MIN_FOR_PROCESSES
) -> None:
    """On all processors, if what they compile can be kept on disk for this one."""
    count = sum(map(len, groups))
    is_announced = count >= max(at_least, 1)
    if is_announced and say is not None and not has_listener():
        say(f"compiling {count} kernels, once (a minute or less)")
    queue, done = deque(groups), list[Group]()
    width = processors() if is_announced and kernel_cache.is_writable() else 0

    def report() -> None:
        if count:
            report_stage("compiling, once", sum(map(len, done)) / count)

    with _helpers(queue, min(len(groups), width), done, report):
        pass
    _compile_queue(queue, done, report)


def _compile_queue(
    queue: Groups, done: list[Group], report: Callable[[], None] | None = None
) -> None:
    """Compiles here until no group is left."""
    while True:
        if report is not None:
            report()
        try:
            group = queue.popleft()
        except IndexError:
            return
        for name in group:
            _compile_here(name)
        done.append(group)


@contextmanager
def _helpers(
    queue: Groups, number: int, done: list[Group], report: Callable[[], None]
) -> Iterator[None]:
    """Other processes that compile what is in the queue; none outlives the block."""
    processes: list[subprocess.Popen[str]] = []
    threads = []
    try:
        for k in range(number):
            processes.append(_new_process())
            take = queue.pop if k % 2 else queue.popleft
            feeding = (take, processes[-1], done)
            threads.append(threading.Thread(target=_feed_process, args=feeding))
            threads[-1].start()
        yield
        while alive := [thread for thread in threads if thread.is_alive()]:
            report()
            alive[0].join(PROGRESS_INTERVAL)
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


def _feed_process(
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
    if name not in _available:
        kernel = find_kernel(name)
        if not all(kernel.is_cached(signature) for signature in kernel.signatures):
            return False
        _available.add(name)
    return True


def find_kernel(name: str) -> Any:
    """The entry kernel of a name, as module:name in `solver`."""
    module, _, kernel = name.partition(":")
    return getattr(import_module(f"sidtool.solver.{module}"), kernel)


def _compile_here(name: str) -> None:
    kernel = find_kernel(name)
    for signature in kernel.signatures:
        kernel.address(signature)


def serve_compilation(parent: int) -> None:
    """Compiles the kernels named on standard input, answering each line with one.

    It ends with its input, and with `parent` also while it compiles. No thread reads
    the input: Windows would have every library wait for that which is loaded meanwhile.
    """
    gc.set_threshold(GARBAGE_THRESHOLD)
    end_with_parent(parent)
    for line in sys.stdin:
        for name in line.split():
            _compile_here(name)
        print("done", flush=True)
