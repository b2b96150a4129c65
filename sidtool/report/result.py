"""Description of results, analyses and the accuracy of a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from sidtool.formats.result import (
    AccuracyReport,
    BudgetLine,
    Event,
    FlexibleBody,
    OutputError,
    Result,
    units_in,
)

from .tables import TextBlock, counted_noun, named_values, text_table

if TYPE_CHECKING:
    from sidtool.solver.analyses.linearisation import Linearisation
    from sidtool.solver.analyses.static_equilibrium import Equilibrium

#: Counters in the order of a summary, with their texts
COUNTERS = {
    "steps": "step",
    "rejected": "rejected step",
    "evaluations": "evaluation",
    "jacobians": "Jacobian",
    "factorisations": "factorisation",
    "newton_iterations": "Newton iteration",
}
#: Largest number of flexible bodies in a summary; the least reliable ones are listed.
MAX_BODIES = 8
#: Largest number of events in a summary.
MAX_EVENTS = 8
STIFF_SCENE_TEXT = (
    "the scene is stiff: stability, not accuracy, limited the steps of this explicit "
    "method; radau5 or radau9 take fewer"
)
#: A scene is stiff if stability limits at least one step in this number, as in
#: `solver`.
STIFF_STEP_SHARE = 4


class WithNotes(Protocol):
    """Protocol: an object with notes, such as a result or an analysis."""

    @property
    def notes(self) -> tuple[str, ...]: ...

    @property
    def warnings(self) -> tuple[str, ...]: ...


_DRIFT_UNITS = {"position": "m", "velocity": "m/s"}


def run_summary(
    result: Result,
    span: tuple[float, float, int] | None = None,
    warned: bool = False,
) -> str:
    """Return a few lines after a run: span, cost, drift, notes, events, flexible
    bodies.

    Parameters
    ----------
    span : first and last output time [s] and their number; default those of the result
    warned : whether the warnings were printed before
    """
    known = run_overview(result, span, warned)
    if result.accuracy is None:
        return known
    return f"{known}\n\n{describe_accuracy(result.accuracy)}"


def run_overview(
    result: Result,
    span: tuple[float, float, int] | None = None,
    warned: bool = False,
) -> TextBlock:
    """Return the summary without the accuracy report."""
    entries = [
        ("motion", _span_text(*(span or _result_span(result)))),
        ("method", _settings_text(result)),
        ("cost", _cost_text(result)),
        ("drift", _drift_text(result)),
    ]
    if result.message:
        entries.append(("ended" if result.completed else "stopped", result.message))
    entries += [line for line in note_lines(result) if line[0] == "note" or not warned]
    if _is_stiff(result):
        entries.append(("advice", STIFF_SCENE_TEXT))
    entries += _event_lines(result.events)
    entries += _worst_body_lines(result.bodies, lambda body: body.after)
    return named_values(entries)


def note_lines(result: WithNotes) -> list[tuple[str, str]]:
    """Return warnings and other notes of a result, each with its kind."""
    return [
        ("warning" if text in result.warnings else "note", text)
        for text in result.notes
    ]


def _is_stiff(result: Result) -> bool:
    """Return whether stability, not accuracy, limited the steps of an explicit
    method.
    """
    counters = result.counters
    return STIFF_STEP_SHARE * counters.get("stiff_steps", 0) > counters.get("steps", 0)


def event_rows(events: Sequence[Event]) -> list[tuple[str, str, str]]:
    """Return name, kind and time [s] of events. All breaks of a function, such as the
    knots of a spline, share one row.
    """
    rows = [(e.name, e.kind, f"{e.t:.9g}") for e in events if e.kind != "break"]
    times_of_break: dict[str, list[float]] = {}
    for event in events:
        if event.kind == "break":
            times_of_break.setdefault(event.name, []).append(event.t)
    for name, times in times_of_break.items():
        span = f"{times[0]:.9g} to {times[-1]:.9g}"
        several = len(times) > 1
        kind = f"{len(times)} breaks" if several else "break"
        rows.append((name, kind, span if several else f"{times[0]:.9g}"))
    return rows


def _event_lines(events: Sequence[Event]) -> list[tuple[str, str]]:
    """Return lines on the first crossings, and the number of breaks of functions."""
    crossings = [e for e in events if e.kind != "break"]
    lines = [(e.name, f"{e.kind} at t = {e.t:.12g} s") for e in crossings[:MAX_EVENTS]]
    more = len(crossings) - MAX_EVENTS
    if more > 0:
        lines.append(("...", f"and {counted_noun(more, 'event')} later"))
    breaks: dict[str, list[float]] = {}
    for event in events:
        if event.kind == "break":
            breaks.setdefault(event.name, []).append(event.t)
    return lines + [(name, _break_line(times)) for name, times in breaks.items()]


def _break_line(times: Sequence[float]) -> str:
    if len(times) == 1:
        return f"break at t = {times[0]:.12g} s"
    return f"{len(times)} breaks from t = {times[0]:.12g} s to {times[-1]:.12g} s"


def expected_body_lines(bodies: Mapping[str, FlexibleBody]) -> str:
    """Return a line per flexible body before a run: frequencies, expected
    stiffening.
    """
    return named_values(_worst_body_lines(bodies, lambda body: body.before))


def _worst_body_lines(
    bodies: Mapping[str, FlexibleBody], describe: Callable[[FlexibleBody], str]
) -> list[tuple[str, str]]:
    """Return the lines of the least reliable bodies, the worst first."""
    order = sorted(bodies, key=lambda name: bodies[name].severity, reverse=True)
    lines = [(name, describe(bodies[name])) for name in order[:MAX_BODIES]]
    rest = order[MAX_BODIES:]
    more = f"and {counted_noun(len(rest), 'body')} with less"
    return [*lines, ("...", more)] if rest else lines


def describe_result(result: Result) -> str:
    """Return the summary, the outputs with their range, and the versions."""
    parts = [
        named_values([("title", result.title or "(none)")]) + "\n" + run_summary(result)
    ]
    parts += [_body_contributions(name, body) for name, body in result.bodies.items()]
    if result.names and len(result.t):
        columns = dict(zip(result.names, result.values.T, strict=True))
        parts.append(output_ranges(columns, units_in(result)))
    if result.versions:
        own = f"sidtool {result.versions.get('sidtool', '')}".rstrip()
        others = [f"{n} {v}" for n, v in result.versions.items() if n != "sidtool"]
        parts.append(f"written by {own}, with {', '.join(others)}")
    return "\n\n".join(parts)


def output_ranges(columns: Mapping[str, np.ndarray], unit: Callable[[str], str]) -> str:
    """Tabulate the first, least, greatest and last value of each output.

    unit : of an output by its name
    """
    rows = [
        [name, f"{column[0]:.10g}", *(f"{f(column):.10g}" for f in (np.min, np.max))]
        + [f"{column[-1]:.10g}", unit(name)]
        for name, column in columns.items()
        if len(column)
    ]
    return text_table(["output", "first", "least", "greatest", "last", "unit"], rows)


def _body_contributions(name: str, body: FlexibleBody) -> str:
    """Describe the expectation of a body, and the contribution of each elastic
    coordinate.
    """
    return f"{body.before}\n{contributions(name, body)}"


def contributions(name: str, body: FlexibleBody) -> TextBlock:
    """Tabulate the contribution of each elastic coordinate of a body to the motion."""
    header = [name, "Hz", "max |q|", "energy %", "label"]
    names = body.names or [f"q{i + 1}" for i in range(len(body.labels))]
    columns = (body.frequencies, body.amplitudes, 100 * body.energy_shares)
    rows = [
        [coordinate, f"{hertz:.4f}", f"{size:.4g}", f"{share:.2f}", label.strip()]
        for coordinate, hertz, size, share, label in zip(
            names, *columns, body.labels, strict=False
        )
    ]
    return text_table(header, rows)


def _result_span(result: Result) -> tuple[float, float, int]:
    count = len(result.t)
    return (float(result.t[0]), float(result.t[-1]), count) if count else (0.0, 0.0, 0)


def _span_text(first: float, last: float, count: int) -> str:
    if not count:
        return "no output time was reached"
    return f"{first:g} s to {last:g} s, {counted_noun(count, 'output time')}"


def _settings_text(result: Result) -> str:
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


def _cost_text(result: Result) -> str:
    counters = result.counters
    parts = [
        counted_noun(int(counters[key]), word)
        for key, word in COUNTERS.items()
        if key in counters
    ]
    if "seconds" in counters:
        parts.append(f"{counters['seconds']:.3f} s")
    return ", ".join(parts) or "not counted"


def _drift_text(result: Result) -> str:
    parts = [
        f"{level} {value:.1e} {_DRIFT_UNITS.get(level, '')}".rstrip()
        for level, value in result.drift.items()
    ]
    return "constraints, " + ", ".join(parts) if parts else "not measured"


#: Largest number of leading coordinates of a mode, and their minimum amplitude relative
#: to the largest one.
MAX_LEADING_COORDINATES, LEADING_TOLERANCE = 3, 1e-6
#: Damping ratios are negative below this; smaller values are indistinguishable from
#: zero.
INSTABILITY_TOLERANCE = 1e-6
#: Damping ratios below this are rounding.
DAMPING_ROUNDING = 1e-12


def describe_equilibrium(equilibrium: Equilibrium) -> str:
    """Describe an equilibrium: iterations, residual, notes, outputs and multipliers."""
    result = equilibrium.result()
    parts: list[str] = [
        named_values(
            [
                ("equilibrium", f"after {equilibrium.iterations} steps"),
                ("unbalanced", f"{equilibrium.residual:.1e} of the forces"),
            ]
        )
    ]
    parts += _plain_notes(result)
    rows = state_rows(result)
    if rows:
        texts = [[name, f"{value:.10g}", unit] for name, value, unit in rows]
        parts.append(text_table(["output", "value", "unit"], texts))
    return "\n\n".join(parts)


def state_rows(result: Result) -> list[tuple[str, float, str]]:
    """Return recorded outputs and all multipliers of a result of one time.

    Returns
    -------
    names, values and units
    """
    names = (*result.names, *result.multiplier_names)
    values = [*result.values[0], *result.multipliers[0]]
    unit = units_in(result)
    value_of = dict(zip(names, map(float, values), strict=True))
    return [(name, value, unit(name)) for name, value in value_of.items()]


def describe_modes(modes: Linearisation) -> str:
    """Describe natural modes: a table with the leading coordinates of each, and
    notes.
    """
    rows = mode_rows(modes)
    if not rows:
        return "no natural modes: nothing can move"
    text: str = text_table(mode_header(modes), rows)
    text += f"\n\n{axes_of_frequencies(modes)}"
    growing = (
        np.flatnonzero((modes.damping_ratios < -INSTABILITY_TOLERANCE) & ~modes.rigid)
        + 1
    )
    if len(growing):
        which = ", ".join(map(str, growing))
        rate = modes.eigenvalues[growing - 1].real.max()
        warning = f"mode {which} grows, its damping ratio is negative"
        if len(growing) > 1:
            warning = f"modes {which} grow, their damping ratios are negative"
        warning += f"; growth up to exp({rate:.4g} t/s)"
        text += f"\n\nunstable: {warning}"
    return "\n\n".join([text, *_plain_notes(modes)])


def has_rotating_axes(modes: Linearisation) -> bool:
    """Return whether frequencies differ between inertial and body axes."""
    difference = modes.inertial_frequencies - modes.rotating_frequencies
    return bool(any(modes.whirl) or difference.any())


def mode_header(modes: Linearisation) -> tuple[str, ...]:
    """Return the header of `mode_rows`."""
    columns: tuple[str, ...] = ("Hz",)
    if has_rotating_axes(modes):
        columns = ("inertial Hz", "rotating Hz", "whirl")
    return ("mode", *columns, "damping ratio", "moved most by")


def axes_of_frequencies(modes: Linearisation) -> str:
    """Return a text on the axes in which the frequencies are measured."""
    if not has_rotating_axes(modes):
        return f"frame: {modes.frame} axes"
    return (
        f"frame: modes are solved in axes {modes.frame}"
        if modes.frame != "inertial"
        else "frame: modes are solved in inertial axes"
    ) + (
        "; inertial Hz is what fixed sensors see, rotating Hz what strain gauges on "
        "the body see"
    )


def mode_rows(modes: Linearisation) -> list[list[str]]:
    """Return number, frequency, damping ratio and leading coordinates of each mode."""
    rows = []
    for k, (hertz, ratio) in enumerate(
        zip(modes.frequencies, modes.damping_ratios, strict=True)
    ):
        sizes = np.abs(modes.shapes[k])
        order = [
            i for i in np.argsort(-sizes) if sizes[i] > LEADING_TOLERANCE * sizes.max()
        ]
        leading = ", ".join(modes.names[i] for i in order[:MAX_LEADING_COORDINATES])
        columns = [f"{hertz:.6g}"]
        if has_rotating_axes(modes):
            columns = [
                f"{modes.inertial_frequencies[k]:.6g}",
                f"{modes.rotating_frequencies[k]:.6g}",
                modes.whirl[k],
            ]
        rows.append(
            [
                str(k + 1),
                *columns,
                "rigid"
                if modes.rigid[k]
                else f"{ratio if abs(ratio) > DAMPING_ROUNDING else 0.0:.4g}",
                leading,
            ]
        )
    return rows


def modes_as_data(modes: Linearisation) -> dict[str, Any]:
    """Return natural modes as data for JSON; complex numbers are pairs."""
    return {
        "coordinates": list(modes.names),
        "position": modes.z.tolist(),
        "velocity": modes.v.tolist(),
        "notes": list(modes.notes),
        "warnings": list(modes.warnings),
        "frame": modes.frame,
        "modes": [
            {
                "frequency": float(modes.frequencies[k]),
                "inertial_frequency": float(modes.inertial_frequencies[k]),
                "rotating_frequency": float(modes.rotating_frequencies[k]),
                "whirl": modes.whirl[k],
                "rigid": bool(modes.rigid[k]),
                "damping_ratio": float(modes.damping_ratios[k]),
                "eigenvalue": _complex_pair(value),
                "shape": [_complex_pair(entry) for entry in modes.shapes[k]],
            }
            for k, value in enumerate(modes.eigenvalues)
        ],
    }


def describe_inverse(result: Result) -> str:
    """Describe inverse dynamics: the largest force of each constraint, and notes."""
    unit = units_in(result)
    rows = [
        [name, f"{np.min(column):.10g}", f"{np.max(column):.10g}", unit(name)]
        for name, column in zip(
            result.multiplier_names, result.multipliers.T, strict=True
        )
    ]
    return "\n\n".join(
        [
            text_table(["force", "least", "greatest", "unit"], rows),
            *_plain_notes(result),
        ]
    )


def _plain_notes(result: Result | Linearisation) -> list[str]:
    """Return the notes without the warnings, which are printed before, as one
    paragraph.
    """
    lines = [line for line in note_lines(result) if line[0] == "note"]
    return [named_values(lines)] if lines else []


def _complex_pair(value: complex) -> list[float]:
    return [float(np.real(value)), float(np.imag(value))]


def accuracy_summary(report: AccuracyReport) -> TextBlock:
    """Return a few lines: the request, the worst output, and the sentences."""
    entries = [("wanted", _request_text(report)), ("reached", _reached_text(report))]
    entries += [("choice", text) for text in report.sentences]
    searched = f"{counted_noun(report.runs, 'run')} in {report.seconds:.2f} s"
    how = f"by {searched}" if report.searched else f"before, by {searched}"
    return named_values([*entries, ("found", how)])


def describe_accuracy(report: AccuracyReport) -> str:
    """Describe the error of each output, the budget, and the reasons."""
    parts = [accuracy_summary(report), error_table(report), budget_table(report)]
    return "\n\n".join(parts)


def error_table(report: AccuracyReport) -> TextBlock:
    """Tabulate outputs with their error, in their unit and relative to their variation.

    Known bounds and terms neglected by linear theory have a column.
    """
    columns = {
        "bound": [o.bound for o in report.outputs],
        "theory": [o.theory for o in report.outputs],
    }
    known = {n: values for n, values in columns.items() if any(values)}
    rows = [
        [
            o.name,
            f"{o.error:.1e}",
            *(_format_number(values[k]) for values in known.values()),
        ]
        + [f"{o.allowed:.1e}", o.unit, _relative_text(o)]
        for k, o in enumerate(report.outputs)
    ]
    header = ["output", "error", *known, "allowed", "unit", "of its variation"]
    return text_table(header, rows)


def _format_number(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def budget_table(report: AccuracyReport) -> TextBlock:
    """Tabulate, for each kind of choice, its error in the worst output and its cost."""
    rows = [_budget_row(line, report) for line in report.budget]
    header = ["part", "choice", "error", "in", "of what is allowed"]
    return text_table([*header, "seconds", "at its finest"], rows)


def _budget_row(line: BudgetLine, report: AccuracyReport) -> list[str]:
    worst = max(report.outputs, key=lambda o: line.errors[o.name] / o.allowed)
    error = line.errors[worst.name]
    return [
        line.part,
        line.choice,
        f"{error:.1e}",
        worst.name,
        f"{100 * error / worst.allowed:.2g} %",
        f"{line.seconds:.4f}",
        "" if line.finest is None else f"{line.finest:.4f}",
    ]


def _relative_text(output: OutputError) -> str:
    return f"{output.relative:.1e}" if output.variation else ""


def _request_text(report: AccuracyReport) -> str:
    parts = [
        amount if name == "*" else f"{name} to {amount}"
        for name, amount in report.wanted.items()
    ]
    everything = "*" in report.wanted
    return ", ".join(parts) + (" of all outputs" if everything else "")


def _reached_text(report: AccuracyReport) -> str:
    worst = max(report.outputs, key=lambda o: o.error / o.allowed)
    unit = f" {worst.unit}" if worst.unit else ""
    return (
        f"{worst.name} errs most, by {worst.error:.1e}{unit} "
        f"({_relative_text(worst) or 'absolute'}) of {worst.allowed:.1e} allowed: "
        "measured at the output times against the finest model, an estimate"
    )
