"""Random scenes with a requested accuracy: are the estimated errors right?

The generator is that of `tests/metamorphic`. Each seed draws a request, from 1e-1 to
1e-5, of all outputs or of three of them. What the search promises is compared with a
run that it has never seen: every term and shape function, radau13 at 1e-12.
`python -m benchmarks.accuracy FIRST LAST [FILE]` judges the scenes of these seeds
alone, prints a line for each, and keeps verdicts in FILE: what is in there is not
judged again. The page is made of `accuracy.judged` beside it in the same way.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from sidtool.accuracy.plan import make_accuracy_plan
from sidtool.formats.base.sid import SID
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.measurement.cache import METHOD_VERSION as SEARCH
from sidtool.measurement.candidates import finest_model, scene_of_model
from sidtool.measurement.runs import OutsideTheory
from sidtool.solver import compile_scene, simulate
from sidtool.solver.system.system import System
from tests.metamorphic.generator.case import Case, scene_of
from tests.metamorphic.generator.scenes import random_scene

from .machine import describe_machine
from .report import Report, Table

#: Seeds that no defect was found with.
FIRST, SCENES = 2000, 200
#: Exponents of requests, and outputs of those that name some.
SHARPEST, LOOSEST, NAMED = -5.0, -1.0, 3
#: The generator drew what cannot be said, such as a rod without length.
NO_SCENE = "no scene"
METHOD, TIGHT = "radau13", 1e-12
#: Errors below this part of the variation are those of the comparison itself.
ROUNDING = 1e-10


@dataclass(frozen=True)
class Verdict:
    """Of one scene: the request, and estimate and error of each output, relative.

    refused : why there is no number, if there is none
    retained : shape functions that were chosen, and how many there are
    seconds : of the search, of the chosen run and of the finest one
    """

    seed: int
    wanted: float
    refused: str = ""
    estimates: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    retained: tuple[int, int] = (0, 0)
    runs: int = 0
    seconds: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def ratios(self) -> list[float]:
        """Return the ratio of estimate to error, for resolved errors."""
        pairs = zip(self.estimates, self.errors, strict=True)
        return [e / max(error, ROUNDING) for e, error in pairs if e > ROUNDING]

    @property
    def use(self) -> float:
        """The largest error over the request."""
        return max(self.errors, default=0.0) / self.wanted


def judged(seed: int) -> Verdict:
    """Estimates and errors of the scene of a seed."""
    rng = np.random.default_rng([19, seed])
    expected = float(10.0 ** rng.uniform(SHARPEST, LOOSEST))
    try:
        case = random_scene(seed)
    except ValueError as error:
        return Verdict(seed, expected, f"{NO_SCENE}: {error}")
    scene = scene_of(case)
    if rng.random() < 0.5:
        names = tuple(dict.fromkeys(rng.choice(scene.outputs.record, NAMED).tolist()))
        outputs = scene.outputs.model_copy(update={"record": names})
        scene = scene.model_copy(update={"outputs": outputs})
    return compared(case, scene, expected, seed)


def compared(case: Case, scene: SceneFile, wanted: float, seed: int = 0) -> Verdict:
    """The promise of the search beside what a run that it never saw says."""

    def compiled(content: SceneFile, sids: Mapping[str, SID]) -> System:
        return compile_scene(content, ".", sids, drives=case.drives, forces=case.forces)

    began = time.perf_counter()
    try:
        plan = make_accuracy_plan(scene, case.sids, wanted, compiled, keep=False)
    except OutsideTheory as outside:
        return Verdict(seed, wanted, f"outside: {outside.problem}")
    except Exception as stop:
        return Verdict(seed, wanted, f"{type(stop).__name__}: {stop}")
    took = time.perf_counter() - began
    result = simulate(compiled(plan.scene, plan.sids))
    whole = scene_of_model(scene, finest_model(scene, case.sids), case.sids)
    exact = simulate(compiled(whole, case.sids), integrator=METHOD, rtol=TIGHT)
    retained = [d.kept for d in plan.report.decisions if d.what == "shape function"]
    estimates, errors = [], []
    for output in plan.report.outputs:
        estimates.append(output.relative)
        errors.append(_error(output.name, result, exact) / output.variation)
    return Verdict(
        seed,
        wanted,
        "",
        estimates,
        errors,
        (sum(retained), len(retained)),
        plan.report.runs,
        (took, float(result.counters["seconds"]), float(exact.counters["seconds"])),
    )


def _error(name: str, found: Result, exact: Result) -> float:
    """Largest difference at the times that both have; what was left out is zero."""
    count = min(len(found.t), len(exact.t))
    same = np.abs(found.t[:count] - exact.t[:count]) <= 1e-9 * np.ptp(exact.t)
    values = found[name] if name in found.names else np.zeros(len(found.t))
    return float(np.abs(values[:count] - exact[name][:count])[same].max())


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """All seeds, told one by one."""
    seeds = range(FIRST, FIRST + SCENES)
    return report(judge_all(seeds, folder / f"{name}.judged", say))


def judge_all(
    seeds: Iterable[int], path: Path | None, say: Callable[[str], None]
) -> list[Verdict]:
    """Verdicts of all seeds; those that a file holds of this search are not repeated.

    path : one verdict a line, behind the number of the search
    """
    known: dict[int, Verdict] = {}
    if path is not None and path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            search, verdict = json.loads(line)
            if search == SEARCH:
                known[verdict["seed"]] = Verdict(**verdict)
    verdicts = []
    for seed in seeds:
        verdict = known.get(seed)
        if verdict is None:
            verdict = judged(seed)
            if path is not None:
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([SEARCH, asdict(verdict)]) + "\n")
        say(verdict_text(verdict))
        verdicts.append(verdict)
    return verdicts


def verdict_text(verdict: Verdict) -> str:
    """A line about one scene."""
    head = f"seed {verdict.seed}: {verdict.wanted:.1e}"
    if verdict.refused:
        return f"{head}, {verdict.refused[:140]}"
    ratios = verdict.ratios or [1.0]
    return (
        f"{head}, {len(verdict.errors)} outputs, error {verdict.use:.2g} of it, "
        f"estimate / error {min(ratios):.3g} to {max(ratios):.3g}, "
        f"{verdict.retained[0]} of {verdict.retained[1]} shape functions, "
        f"{verdict.runs} runs in {verdict.seconds[0]:.1f} s, "
        f"{verdict.seconds[1]:.3f} s for {verdict.seconds[2]:.3f} s"
    )


def report(verdicts: list[Verdict]) -> Report:
    """How often estimates hold, and how sharp they are."""
    numbers = [v for v in verdicts if not v.refused]
    ratios = np.array([r for v in numbers for r in v.ratios])
    verdicts = [v for v in verdicts if not v.refused.startswith(NO_SCENE)]
    outside = sum(v.refused.startswith("outside") for v in verdicts)
    within = sum(v.use <= 1.0 for v in numbers)
    below = [(v.seed, min(v.ratios)) for v in numbers if v.ratios and min(v.ratios) < 1]
    rows = [
        ["scenes with numbers", str(len(numbers))],
        ["outside of the theory, refused", str(outside)],
        ["refused otherwise", str(len(verdicts) - outside - len(numbers))],
        ["outputs", str(len(ratios))],
        ["errors above their estimate", str(int((ratios < 1.0).sum()))],
        ["scenes within the request", str(within)],
        ["estimate / error, median", f"{np.median(ratios):.2f}"],
        ["estimate / error, 95 % quantile", f"{np.quantile(ratios, 0.95):.2f}"],
        ["estimate / error, largest", f"{ratios.max():.3g}"],
        ["error / request, median", f"{np.median([v.use for v in numbers]):.2f}"],
    ]
    found = ", ".join(f"{seed} ({ratio:.3f})" for seed, ratio in below) or "none"
    remark = f"Seeds with an error above its estimate: {found}."
    return Report(
        title=f"{len(verdicts)} random scenes that are asked for an accuracy",
        tables=[Table("requests from 1e-1 to 1e-5", ["what", "number"], rows)],
        remarks=[remark],
        machine=describe_machine(),
    )


if __name__ == "__main__":
    first, last, *files = sys.argv[1:]
    kept = Path(files[0]) if files else None
    judge_all(range(int(first), int(last)), kept, lambda line: print(line, flush=True))
