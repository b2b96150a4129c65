"""What a result holds and what it cost."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

from sidtool.formats.result import Event, FlexibleBody, Result, units_in

from .accuracy import describe_accuracy
from .tables import Block, named, plural, table

#: counters in the order of a summary, with the words for them
COUNTERS = {
    "steps": "step",
    "rejected": "rejected step",
    "evaluations": "evaluation",
    "jacobians": "Jacobian",
    "factorisations": "factorisation",
    "newton_iterations": "Newton iteration",
}
#: Flexible bodies in a summary: those whose numbers can be relied on least.
MOST_BODIES = 8
#: Events told of in a summary.
MOST_EVENTS = 8
ADVICE = (
    "the scene is stiff: stability, not accuracy, limited the steps of this explicit "
    "method; radau5 or radau9 take fewer"
)
#: One step in so many that stability limits makes a scene stiff, as in `solver`.
STIFF_PART = 4


class Noted(Protocol):
    """A result, or what an analysis found."""

    @property
    def notes(self) -> tuple[str, ...]: ...

    @property
    def warnings(self) -> tuple[str, ...]: ...


_DRIFT_UNITS = {"position": "m", "velocity": "m/s"}


def summary(
    result: Result,
    span: tuple[float, float, int] | None = None,
    warned: bool = False,
) -> str:
    """A few lines after a run: span, cost, drift, notes, events, flexible bodies.

    span : first and last output time [s] and how many there are; default those of the
        result
    warned : whether the warnings were told before
    """
    known = course(result, span, warned)
    if result.accuracy is None:
        return known
    return f"{known}\n\n{describe_accuracy(result.accuracy)}"


def course(
    result: Result,
    span: tuple[float, float, int] | None = None,
    warned: bool = False,
) -> Block:
    """The same without the accuracy that was asked for."""
    entries = [
        ("motion", _span(*(span or _span_of(result)))),
        ("method", _settings(result)),
        ("cost", _cost(result)),
        ("drift", _drift(result)),
    ]
    if result.message:
        entries.append(("ended" if result.completed else "stopped", result.message))
    entries += [line for line in note_lines(result) if line[0] == "note" or not warned]
    if _is_stiff(result):
        entries.append(("advice", ADVICE))
    entries += _events(result.events)
    entries += _chosen(result.bodies, lambda body: body.after)
    return named(entries)


def note_lines(found: Noted) -> list[tuple[str, str]]:
    """Warnings and other notes of a result, each with its kind."""
    return [
        ("warning" if text in found.warnings else "note", text) for text in found.notes
    ]


def _is_stiff(result: Result) -> bool:
    """Whether stability, not accuracy, limited the steps of an explicit method."""
    counters = result.counters
    return STIFF_PART * counters.get("stiff_steps", 0) > counters.get("steps", 0)


def event_rows(events: Sequence[Event]) -> list[tuple[str, str, str]]:
    """Name, kind and time [s] of events; of the breaks of a function, such as the knots
    of a spline, a row for all of them."""
    rows = [(e.name, e.kind, f"{e.t:.9g}") for e in events if e.kind != "break"]
    found: dict[str, list[float]] = {}
    for event in events:
        if event.kind == "break":
            found.setdefault(event.name, []).append(event.t)
    for name, times in found.items():
        span = f"{times[0]:.9g} to {times[-1]:.9g}"
        several = len(times) > 1
        kind = f"{len(times)} breaks" if several else "break"
        rows.append((name, kind, span if several else f"{times[0]:.9g}"))
    return rows


def _events(events: Sequence[Event]) -> list[tuple[str, str]]:
    """Lines of the first crossings, and how many breaks of functions there were."""
    crossings = [e for e in events if e.kind != "break"]
    lines = [(e.name, f"{e.kind} at t = {e.t:.12g} s") for e in crossings[:MOST_EVENTS]]
    more = len(crossings) - MOST_EVENTS
    if more > 0:
        lines.append(("...", f"and {plural(more, 'event')} later"))
    breaks: dict[str, list[float]] = {}
    for event in events:
        if event.kind == "break":
            breaks.setdefault(event.name, []).append(event.t)
    return lines + [(name, _breaks(times)) for name, times in breaks.items()]


def _breaks(times: Sequence[float]) -> str:
    if len(times) == 1:
        return f"break at t = {times[0]:.12g} s"
    return f"{len(times)} breaks from t = {times[0]:.12g} s to {times[-1]:.12g} s"


def foreseen(bodies: Mapping[str, FlexibleBody]) -> str:
    """A line per flexible body before a run: frequencies, expected stiffening."""
    return named(_chosen(bodies, lambda body: body.before))


def _chosen(
    bodies: Mapping[str, FlexibleBody], tell: Callable[[FlexibleBody], str]
) -> list[tuple[str, str]]:
    """Lines of the bodies whose numbers can be relied on least, these first."""
    order = sorted(bodies, key=lambda name: bodies[name].severity, reverse=True)
    lines = [(name, tell(bodies[name])) for name in order[:MOST_BODIES]]
    rest = order[MOST_BODIES:]
    more = f"and {plural(len(rest), 'body')} with less"
    return [*lines, ("...", more)] if rest else lines


def describe_result(result: Result) -> str:
    """The summary, the outputs with their range, and the versions."""
    parts = [named([("title", result.title or "(none)")]) + "\n" + summary(result)]
    parts += [_contributions(name, body) for name, body in result.bodies.items()]
    if result.names and len(result.t):
        columns = dict(zip(result.names, result.values.T, strict=True))
        parts.append(ranges(columns, units_in(result)))
    if result.versions:
        own = f"sidtool {result.versions.get('sidtool', '')}".rstrip()
        others = [f"{n} {v}" for n, v in result.versions.items() if n != "sidtool"]
        parts.append(f"written by {own}, with {', '.join(others)}")
    return "\n\n".join(parts)


def ranges(columns: Mapping[str, np.ndarray], unit: Callable[[str], str]) -> str:
    """A table of the first, least, greatest and last value of each output.

    unit : of an output by its name
    """
    rows = [
        [name, f"{column[0]:.10g}", *(f"{f(column):.10g}" for f in (np.min, np.max))]
        + [f"{column[-1]:.10g}", unit(name)]
        for name, column in columns.items()
        if len(column)
    ]
    return table(["output", "first", "least", "greatest", "last", "unit"], rows)


def _contributions(name: str, body: FlexibleBody) -> str:
    """What was expected of a body, and what each elastic coordinate contributed."""
    return f"{body.before}\n{contributions(name, body)}"


def contributions(name: str, body: FlexibleBody) -> Block:
    """What each elastic coordinate of a body contributed to the motion."""
    header = [name, "Hz", "max |q|", "energy %", "label"]
    names = body.names or [f"q{i + 1}" for i in range(len(body.labels))]
    columns = (body.frequencies, body.amplitudes, 100 * body.energy_shares)
    rows = [
        [coordinate, f"{hertz:.4f}", f"{size:.4g}", f"{share:.2f}", label.strip()]
        for coordinate, hertz, size, share, label in zip(
            names, *columns, body.labels, strict=False
        )
    ]
    return table(header, rows)


def _span_of(result: Result) -> tuple[float, float, int]:
    count = len(result.t)
    return (float(result.t[0]), float(result.t[-1]), count) if count else (0.0, 0.0, 0)


def _span(first: float, last: float, count: int) -> str:
    if not count:
        return "no output time was reached"
    return f"{first:g} s to {last:g} s, {plural(count, 'output time')}"


def _settings(result: Result) -> str:
    settings = result.settings
    parts = [str(settings.get("integrator", "unknown integrator"))]
    step = settings.get("step")
    if step:
        parts.append(f"fixed step {step:g} s" if isinstance(step, float) else f"{step}")
    elif "rtol" in settings:
        parts.append(f"relative tolerance {settings['rtol']:g}")
    if "spectral_radius" in settings:
        parts.append(f"spectral radius {settings['spectral_radius']:g}")
    return ", ".join(parts)


def _cost(result: Result) -> str:
    counters = result.counters
    parts = [
        plural(int(counters[key]), word)
        for key, word in COUNTERS.items()
        if key in counters
    ]
    if "seconds" in counters:
        parts.append(f"{counters['seconds']:.3f} s")
    return ", ".join(parts) or "not counted"


def _drift(result: Result) -> str:
    parts = [
        f"{level} {value:.1e} {_DRIFT_UNITS.get(level, '')}".rstrip()
        for level, value in result.drift.items()
    ]
    return "constraints, " + ", ".join(parts) if parts else "not measured"
