"""Tasks of a study: conversions and runs, on all cores or a cluster, with a cache."""

from __future__ import annotations

import json
import multiprocessing
import os
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import use_listener
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import from_data
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.storage.operating_system import (
    MAX_POOL_PROCESSES,
    busy_seconds,
    end_with_parent,
    hold_ending_signals,
    ignore_ending_signals,
)

from ..pipeline.model_cache import model_digest
from .cache import cache_key
from .outputs import (
    MAX_REPEATS,
    MIN_TOTAL_SECONDS,
    RunRecord,
    failed_run,
    record_run,
    timed_run,
)
from .variants import Setting

if TYPE_CHECKING:
    from sidtool.solver.system.system import System

Programs = Mapping[str, Mapping[str, Any] | None]
#: Integrators whose kernels this process has loaded, by the dimension of scenes.
_LOADED_KERNELS: set[tuple[str, str]] = set()

#: Interval between checks for a signal [s].
SIGNAL_INTERVAL = 0.5
#: One thread for linear algebra in each process.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
#: Version of the measurement; stored points of another version are not used.
METHOD_VERSION = 5
#: Keys of [accuracy] that a setting replaces.
SETTING = {"integrator", "rtol", "step", "wanted"}


@dataclass(frozen=True, eq=False)
class ConversionOutcome:
    """Result and cost of a conversion; `message` states why there is no SID.

    Attributes
    ----------
    dofs : degrees of freedom of its mesh
    seconds : processor time of the whole conversion
    """

    sid: SID | None
    dofs: int = 0
    seconds: float = 0.0
    message: str = ""


def convert_model(model: ModelFile) -> ConversionOutcome:
    """Convert a model; short conversions are timed twice, the second time with
    loaded modules.
    """
    from ..pipeline.model_to_sid import finite_element_model, sid_from_model

    try:
        dofs = finite_element_model(model).ndof
        seconds: list[float] = []
        while len(seconds) < 2 and sum(seconds) < MIN_TOTAL_SECONDS:
            began = time.perf_counter(), time.process_time()
            sid = sid_from_model(model)
            passed = time.perf_counter() - began[0]
            seconds.append(busy_seconds(passed, time.process_time() - began[1]))
    except InputError as error:
        return ConversionOutcome(None, message=str(error))
    return ConversionOutcome(sid, dofs, min(seconds))


@dataclass(frozen=True, eq=False)
class RunTask:
    """A scene with its outputs that is run; not timed where once is enough.

    programs : see `compile_task`
    """

    scene: SceneFile
    sids: Mapping[str, SID]
    setting: Setting
    once: bool = False
    programs: Programs = field(default_factory=dict)


def compile_task(
    scene: SceneFile, sids: Mapping[str, SID], programs: Programs
) -> System:
    """Compile the scene of a task with its callables."""
    from sidtool.solver import compile_scene

    drives, forces = (programs.get(key) for key in ("drives", "forces"))
    return compile_scene(scene, Path("."), sids, drives=drives, forces=forces)


def run_task(task: RunTask) -> RunRecord:
    """Return the record of a run, or of its failure."""
    from sidtool.solver.system.errors import SimulationError

    try:
        system = compile_task(task.scene, task.sids, task.programs)
        kernels = task.setting.integrator, task.scene.dimension
        if kernels not in _LOADED_KERNELS and not task.once:
            timed_run(system, task.setting, repeats=1)
            _LOADED_KERNELS.add(kernels)
        result, seconds = timed_run(
            system, task.setting, 1 if task.once else MAX_REPEATS
        )
    except InputError as error:
        return failed_run(str(error))
    except SimulationError as error:
        more = () if error.result is None else error.result.diagnostics
        return failed_run(str(error), (*error.diagnostics, *more))
    reference = system if task.once else None
    return record_run(result, seconds, system=reference)


Task = TypeVar("Task")
Found = TypeVar("Found")


class StudyInterrupted(Exception):
    """Raised when a signal ended a study; finished points are stored."""


class SerialExecutor(Executor):
    """Executor that runs each task immediately in the current process."""

    def submit(  # type: ignore[override]
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> Future[Any]:
        done: Future[Any] = Future()
        with use_listener(
            None
        ):  # as for other executors, only the end of a task is reported
            done.set_result(fn(*args, **kwargs))
        return done


class _ProcessExecutor(ProcessPoolExecutor):
    """Pool whose processes ignore the signals that end a study, also while they start.

    The process of the study handles these signals, and ends its workers.
    """

    def __init__(self, jobs: int) -> None:
        context = multiprocessing.get_context("spawn")
        with hold_ending_signals():
            super().__init__(jobs, context, _start_worker, (os.getpid(),))

    def submit(  # type: ignore[override]
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> Future[Any]:
        with hold_ending_signals():  # this starts processes
            return super().submit(fn, *args, **kwargs)


@contextmanager
def make_executor(jobs: int, dask: str | None) -> Iterator[tuple[Executor, int]]:
    """Return the executor, and the number of simultaneous tasks.

    Parameters
    ----------
    jobs : processes; 1 for this one
    dask : address of the scheduler of a cluster, which is used instead

    Raises
    ------
    InputError : there is no cluster, or Dask is not installed.
    """
    if dask is not None:
        with _dask_cluster(dask) as cluster:
            yield cluster
    elif jobs == 1:
        yield SerialExecutor(), 1
    else:
        width = min(jobs, MAX_POOL_PROCESSES)
        with _process_pool(width) as executor:
            yield executor, width


@contextmanager
def _process_pool(jobs: int) -> Iterator[Executor]:
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    others = set(multiprocessing.active_children())
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    executor = _ProcessExecutor(jobs)
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


def _start_worker(parent: int) -> None:
    """Ignore signals that end a study, and end with the process of the study."""
    ignore_ending_signals()
    end_with_parent(parent)


@contextmanager
def _dask_cluster(address: str) -> Iterator[tuple[Executor, int]]:
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


def as_completed(
    executor: Executor,
    width: int,
    do: Callable[[Task], Found],
    tasks: Iterator[Task],
    stop: Callable[[], str],
) -> Iterator[tuple[Task, Found]]:
    """Yield tasks with their results as they are completed; then submit the next ones.

    Parameters
    ----------
    width : number of tasks in progress
    stop : returns a reason to end, or an empty text

    Raises
    ------
    StudyInterrupted : `stop` returned a reason.
    ChildProcessError : a process of the executor was ended from outside.
    """
    under_way: dict[Future[Found], Task] = {}
    left = True
    try:
        while True:
            while left and len(under_way) < width:
                task = next(tasks, None)
                left = task is not None
                if task is not None:
                    under_way[executor.submit(do, task)] = task
            if not under_way:
                return
            done, _ = wait(
                under_way, timeout=SIGNAL_INTERVAL, return_when=FIRST_COMPLETED
            )
            for future in done:
                yield under_way.pop(future), future.result()
            if why := stop():
                raise StudyInterrupted(why)
    except BrokenExecutor:
        if why := stop():  # the signal ended a process of the executor, too
            raise StudyInterrupted(why) from None
        raise ChildProcessError(
            "a process of the study was ended from outside, as when memory is full"
        ) from None


class PointCache:
    """Store of finished points in a folder; without a folder nothing is stored.

    folder : created with the first point
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder

    def load_run(self, task: RunTask) -> RunRecord | None:
        """Return the stored run of a task, or None."""
        stored = self._read(_run_key(task))
        if stored is None:
            return None
        numbers, values = stored
        times = np.array(numbers.pop("times"))
        for key in ("names", "rounding"):
            numbers[key] = tuple(numbers[key])
        numbers["diagnostics"] = tuple(map(from_data, numbers["diagnostics"]))
        return RunRecord(values=values, times=times, **numbers)

    def store_run(self, task: RunTask, record: RunRecord) -> None:
        numbers = {
            "names": record.names,
            "rounding": record.rounding,
            "seconds": record.seconds,
            "steps": record.steps,
            "message": record.message,
            "diagnostics": [each.as_data() for each in record.diagnostics],
            "times": record.times.tolist(),
        }
        self._write(_run_key(task), numbers, record.values)

    def converted(self, model: ModelFile) -> ConversionOutcome | None:
        """Return the stored conversion of a model, or None."""
        stored = self._read(_model_key(model))
        if stored is None or self.folder is None:
            return None
        conversion = ConversionOutcome(None, **stored[0])
        if conversion.message:
            return conversion
        with suppress(InputError):
            return replace(conversion, sid=read_sid(self._sid(model)))
        return None

    def store_conversion(self, model: ModelFile, conversion: ConversionOutcome) -> None:
        numbers = {
            "dofs": conversion.dofs,
            "seconds": conversion.seconds,
            "message": conversion.message,
        }
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        if conversion.sid is not None:
            write_sid(self._sid(model), conversion.sid)
        self._write(_model_key(model), numbers, np.zeros((0, 0)))

    def _sid(self, model: ModelFile) -> Path:
        assert self.folder is not None
        return self.folder / f"{_model_key(model)}.h5"

    def _read(self, key: str) -> tuple[dict[str, Any], np.ndarray] | None:
        if self.folder is None:
            return None
        try:
            with np.load(self.folder / f"{key}.npz", allow_pickle=False) as file:
                return json.loads(str(file["numbers"])), file["values"]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def _write(self, key: str, numbers: dict[str, Any], values: np.ndarray) -> None:
        if self.folder is None:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        with (
            atomic_path(self.folder / f"{key}.npz", keep_beside=False) as temporary,
            temporary.open("wb") as stream,
        ):
            np.savez(stream, numbers=np.array(json.dumps(numbers)), values=values)


def _run_key(task: RunTask) -> str:
    accuracy = task.scene.accuracy.model_dump_json(exclude=SETTING)
    how = METHOD_VERSION, task.setting, task.once, accuracy
    return f"run-{cache_key(task.scene, task.sids, how, {})}"


def _model_key(model: ModelFile) -> str:
    return f"body-{METHOD_VERSION}-{model_digest(model)}"
