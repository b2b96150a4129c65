"""From a scene and a wanted accuracy to the scene that is simulated."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from sidtool.formats.result import AccuracyReport, OutputError, Result, Sink
from sidtool.formats.result.rows import Columns, Rows
from sidtool.formats.scene import SceneFile, expanded, unit_of
from sidtool.formats.scene.wanted import told
from sidtool.formats.sid import SID

from ..rigid import told_left_out, told_rigid
from . import cached
from .budget import budget
from .candidates import as_scene, finest, recording, stiffened
from .choose import Chosen, choose
from .outside import check_inside
from .reference import Reference, make_reference
from .runs import Compile, Runs
from .sentences import decisions, remarks
from .wanted import Request, Wanted, requested

Say = Callable[[str], None]


@dataclass(frozen=True)
class Plan:
    """What is simulated: the scene with its integrator, and what it came to."""

    scene: SceneFile
    report: AccuracyReport

    @property
    def told(self) -> list[str]:
        """Sentences for the notes of the result."""
        return [*told_rigid(self.scene), *told_left_out(self.scene)]

    def certified(self, result: Result) -> Result:
        """The result of the run with its errors."""
        return replace(result, accuracy=self.report)


class Certified:
    """A sink whose result carries its errors."""

    def __init__(self, sink: Sink, plan: Plan) -> None:
        self._sink, self._plan = sink, plan

    def begin(self, columns: Columns, most: int) -> None:
        self._sink.begin(columns, most)

    def add(self, rows: Rows) -> None:
        self._sink.add(rows)

    def finish(self, result: Result) -> None:
        self._sink.finish(self._plan.certified(result))


def planned(
    scene: SceneFile,
    sids: Mapping[str, SID],
    wanted: Wanted,
    compile_: Compile,
    *,
    keep: bool = True,
    say: Say | None = None,
) -> Plan:
    """The cheapest model and integration whose errors are within what is wanted.

    The second time nothing is searched.

    Parameters
    ----------
    scene : with whatever it leaves out itself; its rtol and integrator do not count
    sids : of all bodies that have one
    wanted : see `[accuracy] wanted`
    compile_ : makes a system of a scene
    keep : False where the scene is not all that is simulated, as with callables
    say : told what is being run

    Raises
    ------
    OutsideTheory : a body leaves what its SID describes.
    InputError : an output cannot be predicted as exactly as that, or the scene cannot
        be simulated.
    SimulationError : the finest model cannot be run to its end.
    """
    key = cached.key_of(scene, sids, wanted) if keep else ""
    kept = cached.read(key) if keep else None
    if kept is not None:
        report = kept.report.model_copy(update={"searched": False})
        return Plan(_with_sids_of(kept.scene, scene), report)
    began = time.perf_counter()
    request = requested(scene, sids, wanted)
    runs = Runs(scene, sids, compile_, request.names, say or _silent)
    reference = make_reference(runs, finest(scene, sids), request)
    check_inside(reference.result)
    terms = stiffened(scene, sids)
    chosen = choose(runs, reference, terms)
    report = AccuracyReport(
        wanted=told(wanted),
        outputs=_outputs(request, reference, chosen),
        budget=budget(runs, reference, chosen),
        decisions=(made := decisions(request, reference, chosen)),
        sentences=(
            *(decision.sentence for decision in made),
            *remarks(request, reference, sids, terms),
            *_not_recorded(scene, sids, chosen),
        ),
        runs=runs.count,
        seconds=time.perf_counter() - began,
    )
    plan = Plan(chosen_scene(scene, sids, chosen), report)
    if keep:
        cached.write(key, cached.Kept(scene=plan.scene, report=report))
    return plan


def chosen_scene(
    scene: SceneFile, sids: Mapping[str, SID], chosen: Chosen
) -> SceneFile:
    """The scene of the chosen model, that records what of its outputs there is."""
    found = as_scene(scene, chosen.choice, sids)
    known = tuple(filter(chosen.choice.knows, _recorded(scene, sids)))
    setting = chosen.found.setting
    accuracy = found.accuracy.model_copy(
        update={"integrator": setting.integrator, "rtol": setting.rtol}
    )
    return recording(found.model_copy(update={"accuracy": accuracy}), known)


def _not_recorded(
    scene: SceneFile, sids: Mapping[str, SID], chosen: Chosen
) -> tuple[str, ...]:
    """A sentence about outputs that the chosen model does not have."""
    names = [n for n in _recorded(scene, sids) if not chosen.choice.knows(n)]
    return (f"not recorded, as left out: {', '.join(names)}",) if names else ()


def _recorded(scene: SceneFile, sids: Mapping[str, SID]) -> tuple[str, ...]:
    """Recorded outputs, with wildcards expanded; q* and f* stand as they are."""
    return expanded(scene.outputs.record, scene, sids, "outputs.record")


def _with_sids_of(kept: SceneFile, scene: SceneFile) -> SceneFile:
    """The kept scene with title and files of this one, which have the same content."""
    bodies = {
        name: body.model_copy(update={"sid": scene.bodies[name].sid})  # type: ignore[union-attr]
        if name in scene.flexible
        else body
        for name, body in kept.bodies.items()
    }
    return kept.model_copy(update={"bodies": bodies, "title": scene.title})


def _outputs(
    request: Request, reference: Reference, chosen: Chosen
) -> tuple[OutputError, ...]:
    rows = zip(
        request.names,
        chosen.errors,
        reference.variation,
        reference.allowed,
        strict=True,
    )
    return tuple(
        OutputError(
            name=name,
            unit=unit_of(name),
            error=float(error),
            variation=float(variation),
            allowed=float(allowed),
        )
        for name, error, variation, allowed in rows
        if name not in reference.left_out
    )


def _silent(_: str) -> None:
    return None
