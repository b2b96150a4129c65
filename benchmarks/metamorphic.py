"""Random scenes, each said in all ways: how many move the same.

The generator and the ways are those of `tests/metamorphic`, which takes 40 scenes and a
quarter of the ways. `python -m benchmarks.metamorphic FIRST LAST` judges the scenes of
these seeds and prints every pair that is not equal.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from sidtool.formats.errors import InputError
from sidtool.solver.errors import SimulationError
from tests.metamorphic import invariants
from tests.metamorphic.case import Case, Values
from tests.metamorphic.case import run as run_case
from tests.metamorphic.scenes import random_scene
from tests.metamorphic.transformations import (
    TRANSFORMATIONS,
    WITHIN,
    difference,
    said,
)

from .machine import describe_machine, use_one_thread
from .report import Report, Table

SCENES = 500
RTOL = 1e-7
WORKERS = 2
ORIGINAL = "as it is"
#: What every motion keeps, and the largest violation.
KEPT = {
    "energy": (invariants.energy, WITHIN * RTOL),
    "kinetic energy of the particles": (invariants.kinetic, 1e-12),
    "momenta and impulses of each body": (invariants.impulses, 3e-4),
}


@dataclass(frozen=True)
class Verdict:
    """Of one scene said in one way; error is relative, or the run stopped."""

    seed: int
    way: str
    equal: bool
    error: float = 0.0
    where: str = ""


def judged(seed: int) -> list[Verdict]:
    """The verdicts about all ways in which a scene can be said."""
    try:
        case = random_scene(seed)
        exact = run_case(case, rtol=RTOL)
    except (InputError, SimulationError) as error:
        return [Verdict(seed, ORIGINAL, False, where=str(error))]
    found = [Verdict(seed, ORIGINAL, True)]
    for way in TRANSFORMATIONS:
        found += _way(seed, way, case, exact)
    for way, (law, bound) in KEPT.items():
        try:
            error = law(case, RTOL)
        except (InputError, SimulationError) as stop:
            found.append(Verdict(seed, way, False, where=str(stop)))
            continue
        if error is not None:
            found.append(Verdict(seed, way, error < bound, error))
    return found


def _way(seed: int, way: str, case: Case, exact: Values) -> list[Verdict]:
    try:
        other = said(way, case, seed)
        if other is None:
            return []
        values = other.back(run_case(other.case, rtol=RTOL, **other.settings))
    except (InputError, SimulationError) as stop:
        return [Verdict(seed, way, False, where=str(stop))]
    error, where = difference(values, exact, other.first)
    equal = error < WITHIN * RTOL + other.slack(exact)
    return [Verdict(seed, way, equal, error, where)]


def judge_all(seeds: Iterable[int], say: Callable[[str], object]) -> list[Verdict]:
    """All verdicts; those that are not equal are told at once."""
    verdicts = []
    with ProcessPoolExecutor(WORKERS, get_context("spawn"), use_one_thread) as pool:
        for some in pool.map(judged, seeds):
            verdicts += some
            for v in some:
                if not v.equal:
                    say(f"  {v.seed} {v.way}: {v.error:.2e} {v.where}")
    return verdicts


def tabled(verdicts: list[Verdict]) -> Table:
    rows = []
    for way in dict.fromkeys([ORIGINAL, *TRANSFORMATIONS, *KEPT]):
        mine = [v for v in verdicts if v.way == way]
        seeds = [str(v.seed) for v in mine if not v.equal]
        more = f" and {len(seeds) - 8} more" if len(seeds) > 8 else ""
        counts = [str(len(mine)), str(len(mine) - len(seeds))]
        rows.append([way, *counts, ", ".join(seeds[:8]) + more])
    counts = [str(len(verdicts)), str(sum(v.equal for v in verdicts))]
    rows.append(["all", *counts, ""])
    head = ["said differently", "scenes", "equal", "seeds that are not"]
    return Table(f"rtol {RTOL:g}, equal within ten times", head, rows)


def run(folder: Path, name: str, say: Callable[[str], object]) -> Report:
    verdicts = judge_all(range(SCENES), say)
    return Report(
        title=f"{SCENES} random scenes said differently",
        tables=[tabled(verdicts)],
        machine=describe_machine(),
    )


if __name__ == "__main__":
    use_one_thread()
    first, last = map(int, sys.argv[1:3])
    print(
        tabled(
            judge_all(range(first, last), lambda text: print(text, flush=True))
        ).text()
    )
