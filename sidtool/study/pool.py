"""Tasks of a study on all cores, in one process, or on a cluster of Dask."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager
from typing import Any, TypeVar

from sidtool.formats.errors import InputError
from sidtool.formats.progress import listening
from sidtool.formats.storage.operating_system import (
    ENDING_SIGNALS,
    IGNORED,
    end_with,
    handle_signal,
    present_signals,
)

Task = TypeVar("Task")
Found = TypeVar("Found")
#: How often a signal is looked for [s].
LOOK = 0.5
#: One thread for linear algebra in each process.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Ended(Exception):
    """A signal ended a study; what was finished is kept."""


class Here(Executor):
    """Does each task at once, in this process."""

    def submit(  # type: ignore[override]
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> Future[Any]:
        done: Future[Any] = Future()
        with listening(None):  # As of all others, only their end is told.
            done.set_result(fn(*args, **kwargs))
        return done


@contextmanager
def pool(jobs: int, dask: str | None) -> Iterator[tuple[Executor, int]]:
    """What takes tasks, and how many at a time.

    Parameters
    ----------
    jobs : processes; 1 for this one
    dask : address of the scheduler of a cluster, which is used instead

    Raises
    ------
    InputError : there is no cluster, or Dask is not installed.
    """
    if dask is not None:
        with _cluster(dask) as found:
            yield found
    elif jobs == 1:
        yield Here(), 1
    else:
        with _processes(jobs) as executor:
            yield executor, jobs


@contextmanager
def _processes(jobs: int) -> Iterator[Executor]:
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    others = set(multiprocessing.active_children())
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(jobs, context, _begin, (os.getpid(),))
    try:
        yield executor
        executor.shutdown()
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - others:
            process.kill()
        raise
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _begin(parent: int) -> None:
    """Signals that end a study are the parent's matter, also where they are sent to
    all processes; without it the process ends."""
    for number in present_signals(ENDING_SIGNALS):
        handle_signal(number, IGNORED)
    end_with(parent)


@contextmanager
def _cluster(address: str) -> Iterator[tuple[Executor, int]]:
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "needs the packages dask and distributed",
            place="--dask",
            expected='them beside sidtool: pip install "sidtool[cluster]"',
        ) from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise InputError(
            f"there is no scheduler of Dask at {address}: {error}",
            place="--dask",
            expected="an address such as tcp://host:8786",
        ) from None
    try:
        threads = sum(client.nthreads().values())
        if not threads:
            raise InputError(
                f"the cluster at {address} has no workers",
                place="--dask",
                expected="workers, from `dask worker ADDRESS --nthreads 1`",
            )
        yield client.get_executor(pure=False), threads
    finally:
        client.close()


def each(
    executor: Executor,
    width: int,
    do: Callable[[Task], Found],
    tasks: Iterator[Task],
    stop: Callable[[], str],
) -> Iterator[tuple[Task, Found]]:
    """Tasks with what they found, as they are done; the next is taken then.

    width : tasks that are under way together
    stop : says why to end, if at all

    Raises
    ------
    Ended : that it said.
    """
    under_way: dict[Future[Found], Task] = {}
    left = True
    while True:
        while left and len(under_way) < width:
            task = next(tasks, None)
            left = task is not None
            if task is not None:
                under_way[executor.submit(do, task)] = task
        if not under_way:
            return
        done, _ = wait(under_way, timeout=LOOK, return_when=FIRST_COMPLETED)
        for future in done:
            yield under_way.pop(future), future.result()
        if why := stop():
            raise Ended(why)
