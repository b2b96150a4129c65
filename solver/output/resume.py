"""Continuation of an interrupted run: its last state, its rows and its energy sums."""

import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import diagnose, each_once
from sidtool.formats.result import Result
from sidtool.formats.result.accuracy_report import BODY_CODES
from sidtool.formats.result.data import TABLES, Rows, iterate_rows
from sidtool.formats.scene import OutputTimes
from sidtool.formats.storage.cache import differing_entries

from ..initial_state.assembly import StateVectors
from ..initial_state.integrator_start import (
    RunSettings,
    constraint_tolerances,
    scene_with_settings,
)
from ..system.system import System
from . import energies
from .columns import position_names, velocity_names
from .reactions import restore_eliminated_joints
from .samples import EvaluatedForces, StateSampler

#: Output times differ by more than this part of the time span.
DIFFERENT_TIME = 1e-12
#: Dissipated energy first.
_SUMS = ("energy.dissipated", "energy.supplied")
BALANCE = "energy.balance"


@dataclass(frozen=True, eq=False)
class ResumeState:
    """What a run goes on from.

    Attributes
    ----------
    t, start
        The last state of that run.
    done
        Its result at the output times until then.
    energy_sums
        Energies dissipated and supplied until t [J].
    """

    t: float
    start: StateVectors
    done: Result
    energy_sums: Array

    def join(self, rest: Result) -> Result:
        """The result of the whole run; its tables are those of the rest."""
        counters = {
            name: value + self.done.counters.get(name, 0)
            for name, value in rest.counters.items()
        }
        drift = {
            name: max(value, self.done.drift.get(name, 0.0))
            for name, value in rest.drift.items()
        }
        # The bodies of all parts are judged together.
        previous = [d for d in self.done.diagnostics if d.code not in BODY_CODES]
        return replace(
            rest,
            counters=counters,
            drift=drift,
            events=(*self.done.events, *rest.events),
            diagnostics=each_once(
                (*rest.diagnostics, *previous, diagnose("N317", t=self.t))
            ),
        )


def resume_state(system: System, settings: RunSettings, result: Result) -> ResumeState:
    """What a result leaves to do that is unfinished, or complete to an earlier end.

    Raises
    ------
    InputError
        It is complete, of another scene, SID or setting, or its last state does not
        hold all that the rest of the run needs.
    """
    if not len(result.t):
        raise InputError("holds no state", expected="a run that began")
    _check_same_run(system, settings, result)
    if result.completed:
        _check_extended(system, result)
    for table, names in (
        ("position", position_names(system)),
        ("velocity", velocity_names(system)),
    ):
        if getattr(result, f"{table}_names") != tuple(names):
            raise InputError(
                f"its {table} columns are not those of the scene",
                expected="a result of this version of sidtool",
            )
    if any(element.sample_period for element in system.forces):
        raise InputError(
            "laws of the scene hold values between samples, which are not kept",
            expected="laws without sample_time, or a run from the start",
        )
    times = OutputTimes(system.scene)[:]
    tolerance = DIFFERENT_TIME * (system.scene.time.end - system.scene.time.start)
    later = np.searchsorted(times, result.t).clip(0, len(times) - 1)
    earlier = np.maximum(later - 1, 0)
    distances = np.abs(times[[earlier, later]] - result.t)
    is_output_time = distances.min(axis=0) <= tolerance
    count = int(is_output_time.sum())
    if (
        count > len(times)
        or (np.abs(times[:count] - result.t[is_output_time]) > tolerance).any()
    ):
        raise InputError(
            "was recorded at other times",
            place="time.output_step",
            expected="the output times that the run was begun with",
        )
    tables = {name: getattr(result, name)[is_output_time] for name in TABLES}
    events = tuple(event for event in result.events if event.t <= result.t[-1])
    done = replace(result, t=result.t[is_output_time], events=events, **tables)
    start = StateVectors(result.positions[-1].copy(), result.velocities[-1].copy())
    return ResumeState(
        float(result.t[-1]), start, done, _energy_sums(system, settings, result)
    )


def previous_rows(state: ResumeState) -> list[Rows]:
    """The rows of the unfinished run, block by block."""
    return list(iterate_rows(state.done))


def _check_extended(system: System, result: Result) -> None:
    """Raise a complete run that has no later end, or that an event has ended."""
    before = json.loads(result.scene)["time"]["end"]
    end = system.scene.time.end
    if ended_by_event(result):
        raise InputError(
            f"an event ended it at t = {result.t[-1]:.9g} s",
            place="completed",
            expected="an unfinished run, or one that reached its end",
        )
    if not end > before:
        raise InputError(
            f"is complete to t = {before:.9g} s",
            place="completed",
            expected="an unfinished run, or a later time.end",
        )


def ended_by_event(result: Result) -> bool:
    """True if an event of the scene ended the run."""
    scene = json.loads(result.scene or "{}")
    ends = {n for n, e in scene.get("events", {}).items() if e["action"] == "stop"}
    return any(e.name in ends and e.t >= result.t[-1] for e in result.events)


def _with_time(before: dict[str, Any], now: dict[str, Any]) -> dict[str, Any]:
    """The first scene with the end of the second one, if that is not earlier; with its
    output times and tables of inputs, too, if they begin with those of the first."""
    old, new = before.get("time", {}), now["time"]
    time = dict(old)
    if new["end"] > old.get("end", new["end"]):
        time["end"] = new["end"]
    times, more = old.get("output_times"), new.get("output_times")
    if times and more and more[: len(times)] == times:
        time["output_times"] = more
    inputs = {
        name: _extended_input(signal, now.get("inputs", {}).get(name, signal))
        for name, signal in before.get("inputs", {}).items()
    }
    return before | {"time": time} | ({"inputs": inputs} if inputs else {})


def _extended_input(before: dict[str, Any], now: dict[str, Any]) -> dict[str, Any]:
    """The later one of two inputs if its table begins with that of the first; a smooth
    curve through more points is another one."""
    parts = ("times", "values")
    if before.get("interpolation") == "smooth" or not all(p in now for p in parts):
        return before
    known = {p: before.get(p, []) for p in parts}
    begins = all(now[p][: len(known[p])] == known[p] for p in parts)
    return {**before, **{p: now[p] for p in parts}} if begins else before


def _changed_keys(before: Any, now: Any, key: str = "") -> list[str]:
    """Keys whose values differ between two scenes, with both values if short."""
    if before == now:
        return []
    if isinstance(before, dict) and isinstance(now, dict):
        names = dict.fromkeys([*before, *now])
        changes = (
            _changed_keys(before.get(n), now.get(n), f"{key}.{n}") for n in names
        )
        return [text for texts in changes for text in texts]
    before_text, now_text = json.dumps(before), json.dumps(now)
    values = (
        f" ({before_text} there, {now_text} here)"
        if len(before_text + now_text) < 60
        else ""
    )
    return [key.removeprefix(".") + values]


def _check_same_run(system: System, settings: RunSettings, result: Result) -> None:
    now = scene_with_settings(system.scene, settings)
    if result.scene != now:
        scene = json.loads(now)
        previous_scene = _with_time(json.loads(result.scene or "{}"), scene)
        changed = _changed_keys(previous_scene, scene)
    else:
        changed = []
    if changed:
        raise InputError(
            f"is of another scene, or of other options: {', '.join(changed[:3])}"
            + (", ..." if len(changed) > 3 else ""),
            place="unfinished run",
            expected="the scene and the options that the run was begun with",
        )
    for name, sid in system.sids.items():
        before = result.sids.get(name)
        changed = ["all of it"] if before is None else differing_entries(before, sid)
        if changed:
            more = ", ..." if len(changed) > 3 else ""
            raise InputError(
                f"was begun with another SID of {name}: other numbers in "
                f"{', '.join(changed[:3])}{more}",
                place=f"sids.{name}",
                expected="the same SIDs",
            )


def _energy_sums(system: System, settings: RunSettings, result: Result) -> Array:
    """Energies until the last state; zero where no output needs them.

    The balance gives their difference, also where it was recorded alone.
    """
    known = {n: result[n][-1] for n in _SUMS if n in result.names}
    if BALANCE in result.names and len(known) < len(_SUMS):
        lost_less_given = result[BALANCE][-1] - _stored_energy(system, settings, result)
        lost, given = _SUMS
        known.setdefault(lost, lost_less_given + known.get(given, 0.0))
        known.setdefault(given, known[lost] - lost_less_given)
    return np.array([known.get(name, 0.0) for name in _SUMS])


def _stored_energy(system: System, settings: RunSettings, result: Result) -> float:
    """Kinetic, elastic and potential energy at the last state [J]."""
    t, z, v = result.t[-1:], result.positions[-1:].copy(), result.velocities[-1:].copy()
    sampler = StateSampler(system, constraint_tolerances(system, settings))
    full_system, motion = restore_eliminated_joints(system, t, sampler.sample(t, z, v))
    evaluated = EvaluatedForces(full_system, motion, t)
    parts = (
        energies.kinetic_energy(evaluated),
        energies.elastic_energy(evaluated),
        energies.potential_energy(evaluated),
    )
    return float(sum(part[-1] for part in parts))
