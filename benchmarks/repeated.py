"""Runs of one scene with other numbers: what they cost beside the solution."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import sidtool
from sidtool.solver.simulation.run_loop import Run

from .latency import EXAMPLE
from .machine import describe_machine
from .report import Report, Table

RUNS = 40


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """The founding scene, `simulate` and `CompiledScene.run` by turns.

    Processor time of the thread; the solution is all step loops with what they keep,
    and whatever is recorded of its rows.
    """
    scene = sidtool.Scene.load(EXAMPLE)
    compiled = scene.compile()
    kinds: dict[str, Callable[[int], Mapping[str, Any]]] = {
        "the same numbers": lambda k: {},
        "a mass": lambda k: {"crank.mass": 0.3 + 1e-3 * k},
        "a place in a body": lambda k: {"crank.markers.pin.position": [0.1, 1e-6 * k]},
        "an initial position": lambda k: {"rod.initial.position": [0.1, 1e-6 * k]},
        "the end of a drive": lambda k: {
            "crank_angle.function.pieces[0].end[0]": 37.69911184307752 + 1e-13 * k
        },
    }
    rows = []
    for kind, numbers in kinds.items():
        anew, again = [], []
        for k in range(1, RUNS + 1):  # none with the numbers of the scene
            changes = numbers(k)
            anew.append(_times_outside_solution(partial(_anew, scene, changes)))
            again.append(_times_outside_solution(partial(compiled.run, changes)))
        one, other = (min(column[0] for column in part) for part in (anew, again))
        solved = min(total - beside for beside, total in again)
        cells = [f"{1e3 * x:.2f}" for x in (solved, one, other)]
        rows.append([kind, *cells, f"{one / other:.1f}"])
        say(f"  {kind}: {cells[1]} and {cells[2]} ms beside {cells[0]} ms")
    header = ["what changes", "solution", "simulate", "compiled", "ratio"]
    caption = (
        "Processor milliseconds of a run: its solution, and what it costs beside that "
        "by `simulate` with its notes and by `CompiledScene.run` "
        f"(least of {RUNS}, by turns)."
    )
    return Report(
        title="Repeated runs of the founding slider-crank from Python",
        tables=[Table(caption, header, rows, True)],
        machine=describe_machine(),
    )


def _anew(scene: sidtool.Scene, changes: Mapping[str, Any]) -> Any:
    """Compile the scene with changes, run it and read its notes."""
    return scene.with_(changes).simulate().notes


def _times_outside_solution(work: Callable[[], Any]) -> tuple[float, float]:
    """Return the seconds outside the solution, and the total."""
    with _solutions() as spent:
        began = time.thread_time()
        work()
        total = time.thread_time() - began
    return total - sum(spent), total


@contextmanager
def _solutions() -> Iterator[list[float]]:
    """The processor seconds of the solutions inside."""
    spent: list[float] = []
    known: tuple[Callable[..., Any], ...] = Run.integrate, Run.finish

    def timed(work: Callable[..., Any]) -> Callable[..., Any]:
        def measured(*arguments: Any, **named: Any) -> Any:
            began = time.thread_time()
            try:
                return work(*arguments, **named)
            finally:
                spent.append(time.thread_time() - began)

        return measured

    own: Any = Run
    own.integrate, own.finish = map(timed, known)
    try:
        yield spent
    finally:
        own.integrate, own.finish = known
