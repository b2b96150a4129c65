"""Random scenes, each said in all ways: how many move the same.

The generator and the ways are those of `tests/metamorphic`, which takes 40 scenes and a
quarter of the ways. `python -m benchmarks.metamorphic FIRST LAST` judges the scenes of
these seeds alone; with `rubbing` behind them those of `generator/rubbing.py`, there,
trees with friction in their joints and laws of outputs. What was judged is kept in a
file beside the result, by seed, and is not judged again as long as no source has
changed.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

from tests.metamorphic.generator.case import run as run_case
from tests.metamorphic.generator.differences import promised, variation
from tests.metamorphic.generator.rubbing import rubbing_scene
from tests.metamorphic.generator.scenes import random_scene
from tests.metamorphic.invariants import violations
from tests.metamorphic.ways.transformations import TRANSFORMATIONS, compared

from .machine import describe_machine, use_one_thread
from .report import Report, Table

SCENES = 500
RTOL = 1e-7
WORKERS = 2
ORIGINAL = "as it is"
LAWS = "what every motion keeps"
#: Seeds that a table names, and scenes between two lines of progress.
NAMED, TOLD = 8, 10
ROOT = Path(__file__).parents[1]
SOURCES = ("solver", "formats", "sidtool", "tests/metamorphic", "tests/bodies.py")


@dataclass(frozen=True)
class Verdict:
    """Of one scene said in one way: its difference, and what is allowed.

    A run that stopped says why in `where` and has no difference.

    halved : how often the drives of the scene were halved, for its loops to follow
    """

    seed: int
    way: str
    error: float | None = None
    allowed: float = 0.0
    where: str = ""
    halved: int = 0

    @property
    def ratio(self) -> float:
        return float("inf") if self.error is None else self.error / self.allowed

    @property
    def equal(self) -> bool:
        return self.ratio < 1.0


def judged(seed: int, rubs: bool = False) -> list[Verdict]:
    """The verdicts about all ways in which a scene can be said.

    rubs : whether it is one with friction in joints

    Whatever stops a run, foreseen or not, is a verdict: the others go on.
    """
    sizes = promised if rubs else variation
    try:
        case = rubbing_scene(seed) if rubs else random_scene(seed)
        exact = run_case(case, rtol=RTOL)
    except Exception as stop:
        return [_stopped(seed, ORIGINAL, stop)]
    found = [Verdict(seed, ORIGINAL, 0.0, 1.0, halved=case.halved)]
    for way in TRANSFORMATIONS:
        try:
            verdict = compared(way, case, exact, seed, RTOL, sizes)
        except Exception as stop:
            found.append(_stopped(seed, way, stop))
            continue
        if verdict is not None:
            found.append(Verdict(seed, way, *verdict))
    try:
        laws = violations(case, RTOL)
    except Exception as stop:
        return [*found, _stopped(seed, LAWS, stop)]
    return [*found, *(Verdict(seed, name, *law) for name, law in laws.items())]


def _stopped(seed: int, way: str, stop: Exception) -> Verdict:
    return Verdict(seed, way, where=f"{type(stop).__name__}: {stop}")


def judge_all(
    seeds: Iterable[int],
    kept: Path,
    say: Callable[[str], object],
    rubs: bool = False,
) -> list[Verdict]:
    """Return all verdicts; print those that differ at once.

    kept : file of what was judged, one line per scene below one of the sources
    """
    seeds, begin = list(seeds), time.monotonic()
    known = _known(kept)
    waiting = [seed for seed in seeds if seed not in known]
    if len(waiting) < len(seeds):
        say(f"  {len(seeds) - len(waiting)} of {len(seeds)} scenes were judged before")
    context = get_context("spawn")
    with ProcessPoolExecutor(WORKERS, context, use_one_thread) as pool:
        running = [pool.submit(judged, seed, rubs) for seed in waiting]
        for count, done in enumerate(as_completed(running), start=1):
            verdicts = done.result()
            known[verdicts[0].seed] = verdicts
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps([asdict(v) for v in verdicts]) + "\n")
            for v in verdicts:
                if not v.equal:
                    say(f"  scene {v.seed}, {v.way}: {verdict_text(v)}")
            if count % TOLD == 0 or count == len(waiting):
                minutes = (time.monotonic() - begin) / 60.0
                say(f"  {count} of {len(waiting)} scenes in {minutes:.1f} min")
    return [verdict for seed in seeds for verdict in known[seed]]


def _known(kept: Path) -> dict[int, list[Verdict]]:
    """What was judged with the sources as they are; else the file begins anew."""
    digest = hashlib.sha256()
    for source in SOURCES:
        path = ROOT / source
        for file in [path] if path.is_file() else sorted(path.rglob("*.py")):
            digest.update(file.read_bytes())
    stamp = json.dumps(digest.hexdigest())
    lines = kept.read_text(encoding="utf-8").splitlines() if kept.is_file() else []
    if not lines or lines[0] != stamp:
        kept.write_text(stamp + "\n", encoding="utf-8")
        lines = []
    scenes = [[Verdict(**v) for v in json.loads(line)] for line in lines[1:]]
    return {verdicts[0].seed: verdicts for verdicts in scenes}


def verdict_text(v: Verdict) -> str:
    if v.error is None:
        return v.where
    return f"{v.error:.2e} of {v.allowed:.0e} allowed, {v.where}"


def tabled(verdicts: list[Verdict]) -> Table:
    """Per way: scenes, those that are equal, and the worst of these."""
    rows = []
    for way in dict.fromkeys([ORIGINAL, *TRANSFORMATIONS, *(v.way for v in verdicts)]):
        rows.append([way, *_row([v for v in verdicts if v.way == way])])
    rows.append(["all", *_row(verdicts)])
    head = ["said differently", "scenes", "equal", "worst / allowed", "not equal"]
    return Table(f"rtol {RTOL:g}, equal within ten times", head, rows)


def _row(verdicts: list[Verdict]) -> list[str]:
    seeds = list(dict.fromkeys(str(v.seed) for v in verdicts if not v.equal))
    equal = sum(v.equal for v in verdicts)
    worst = max((v.ratio for v in verdicts), default=0.0)
    ratio = "stopped" if worst == float("inf") else f"{worst:.2g}"
    return [str(len(verdicts)), str(equal), ratio, _named(seeds)]


def _named(seeds: list[str]) -> str:
    more = f" and {len(seeds) - NAMED} more" if len(seeds) > NAMED else ""
    return ", ".join(seeds[:NAMED]) + more


def ends(verdicts: list[Verdict]) -> Table:
    """How each scene ended: none is left out."""
    scenes = [v for v in verdicts if v.way == ORIGINAL]
    groups: dict[str, list[str]] = {}
    for v in scenes:
        times = f"with drives halved {v.halved} times, for loops to follow"
        ran = f"runs, {times}" if v.halved else "runs as drawn"
        groups.setdefault(ran if v.equal else v.where, []).append(str(v.seed))
    rows = [[end, str(len(seeds)), _named(seeds)] for end, seeds in groups.items()]
    return Table("How the scenes end", ["end", "scenes", "seeds"], rows)


def run(folder: Path, name: str, say: Callable[[str], object]) -> Report:
    verdicts = judge_all(range(SCENES), folder / f"{name}.judged", say)
    return Report(
        title=f"{SCENES} random scenes said differently",
        tables=[tabled(verdicts), ends(verdicts)],
        machine=describe_machine(),
    )


if __name__ == "__main__":
    use_one_thread()
    first, last = map(int, sys.argv[1:3])
    rubs = sys.argv[3:] == ["rubbing"]
    kept = ROOT / "benchmarks" / "results" / "metamorphic.judged"
    kept = kept.with_stem("rubbing") if rubs else kept

    def tell(text: str) -> None:
        print(text, flush=True)

    verdicts = judge_all(range(first, last), kept, tell, rubs)
    tell(f"{tabled(verdicts).text()}\n\n{ends(verdicts).text()}")
