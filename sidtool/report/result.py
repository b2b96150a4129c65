"""Description of results, analyses and the accuracy of a run."""

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

import numpy as np

from sidtool.formats.base.errors import printable
from sidtool.formats.base.html import html_table
from sidtool.formats.diagnostics import Diagnostic, WithDiagnostics
from sidtool.formats.diagnostics.entry import per_cent
from sidtool.formats.result import (
    AccuracyReport,
    BudgetLine,
    Decision,
    Event,
    FlexibleBody,
    OutputError,
    Result,
    has_meaningless_numbers,
    units_in,
)
from sidtool.formats.text import counted_noun, fit_on_screen, wrapped

from .diagnostics import diagnostic_lines, severity_counts
from .tables import (
    TextBlock,
    label_without_frequency,
    text_table,
    title_line,
    without_rounding,
)

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
#: Shares below this are printed as zero.
SMALL_SHARE = 1e-8
#: Largest number of events in a summary.
MAX_EVENTS = 8
_DRIFT_UNITS = {"position": "m", "velocity": "m/s"}

#: Parts of the error of a run that are no choices of its model.
_NO_CHOICES = "reference", "all together", "theory"
#: Largest numbers of elastic coordinates and of outputs in a description.
MAX_COORDINATES, MAX_OUTPUTS = 8, 12
_CONTRIBUTION_HEADER = ("Hz", "max |q|", "energy %", "label")


def run_summary(
    result: Result,
    span: tuple[float, float, int] | None = None,
    files: Sequence[str] = (),
    verbose: bool = False,
    most: int | None = None,
) -> str:
    """Return how a run ended, its cost and accuracy, its bodies and diagnostics.

    Parameters
    ----------
    span : first and last output time [s] and their number; default those of the result
    files : what was written, with sizes
    verbose : also all counters, why the run stopped, all diagnostics, and the tables
        of a requested accuracy
    most : largest number of events, bodies, diagnostics and rows of a table, if it is
        limited
    """
    known = run_overview(result, span, files, verbose, most)
    if result.accuracy is None or not verbose:
        return known
    return f"{known}\n\n{describe_accuracy(result.accuracy, most)}"


def run_overview(
    result: Result,
    span: tuple[float, float, int] | None = None,
    files: Sequence[str] = (),
    verbose: bool = False,
    most: int | None = None,
) -> TextBlock:
    """Return the summary without the tables of the accuracy."""
    first, last, count = span or result_span(result)
    before = [
        ("method", f"{_settings_text(result)}, {counted_noun(count, 'output time')}"),
        ("cost", _cost_text(result, verbose)),
        ("drift", _drift_text(result)),
    ]
    if result.message and result.completed:
        before.append(("ended", result.message))
    if result.accuracy is not None:
        before += accuracy_lines(result.accuracy, result.diagnostics)
    before += event_lines(result.events, most)
    table = body_table(result.bodies, most)
    after = [("diagnostics", severity_counts(result.diagnostics))]
    after += [("files", ", ".join(files))] if files else []
    labels = [*before, *after]
    width = max(len(label) for label, _ in labels)
    parts = [_title_line(result, first, last), _labelled_lines(before, width)]
    parts += [str(table)] if table else []
    parts.append(_labelled_lines(after, width))
    if verbose and result.diagnostics:
        parts.append(diagnostic_lines(result.diagnostics, most))
    html = html_table([(label, printable(text)) for label, text in labels])
    found = [(each.severity, each.line) for each in result.diagnostics]
    html += (table.html if table else "") + (html_table(found) if found else "")
    return TextBlock("\n".join(parts), html)


def _title_line(result: Result, first: float, last: float) -> str:
    """Title and outcome of a run, the outcome at the right."""
    outcome = f"finished, {first:g} to {last:g} s"
    if result.message and result.completed:
        outcome = f"ended by an event, {first:g} to {last:g} s"
    if not result.completed:
        outcome = _unfinished_text(result, first, last)
    return title_line(result.title, outcome)


def _unfinished_text(result: Result, first: float, last: float) -> str:
    """Where a run stopped and the share that was done, or that it failed at its end."""
    if has_meaningless_numbers(result):
        return f"FAILED, {first:g} to {last:g} s"
    times = json.loads(result.scene)["time"] if result.scene else {}
    start, end = times.get("start", 0.0), times.get("end", last)
    if not start < last < end:
        return f"STOPPED at {last:.6g} s"
    share = per_cent((last - start) / (end - start), ".2g")
    return f"STOPPED at {last:.6g} of {end:g} s ({share} %)"


def _labelled_lines(entries: Sequence[tuple[str, str]], width: int) -> str:
    """Texts behind their labels, in lines that fit on the screen."""
    return "\n".join(
        wrapped(f"{label:<{width}}  {printable(text)}", " " * (width + 2))
        for label, text in entries
    )


def body_table(
    bodies: Mapping[str, FlexibleBody], most: int | None = None
) -> TextBlock | None:
    """Deflection, stiffness change and frequencies of flexible bodies, the least
    reliable first; at most `most` and `MAX_BODIES` of them.
    """
    if not bodies:
        return None
    order = sorted(bodies, key=lambda name: bodies[name].severity, reverse=True)
    shown = min(MAX_BODIES, most or MAX_BODIES)
    rows = [_body_row(name, bodies[name]) for name in order[:shown]]
    if order[shown:]:
        more = counted_noun(len(order) - shown, "body")
        rows.append([f"and {more} with less", "", "", "", ""])
    header = ("body", "deflection", "geometric stiffness", "highest mode", "excitation")
    return text_table(header, rows)


def _body_row(name: str, body: FlexibleBody) -> list[str]:
    found, excitation = body.found or body.expected, body.excitation
    stiffness = _share_text(found.ratio)
    if not found.carried:
        stiffness += " (rotation only)"
    fastest = f"{excitation.frequency:.3g} Hz"
    if math.isinf(excitation.frequency):
        fastest = "jump"
    elif not excitation.frequency:
        fastest = "unknown"
    deflection = f"{_share_text(body.deflection)} of size"
    return [name, deflection, stiffness, f"{body.highest_frequency:.4g} Hz", fastest]


def before_run(body: FlexibleBody) -> list[str]:
    """Highest mode, excitation and expected stiffening of a body before a run."""
    _, _, stiffness, highest, fastest = _body_row("", body)
    cause, expected = body.excitation.by.partition(" ")[0], body.expected
    known = f"{'diverges, ' if expected.diverges else ''}{stiffness}, {expected.load}"
    return [
        highest,
        f"{fastest} ({cause})" if body.excitation.frequency and cause else fastest,
        known if expected.load else "not known",
    ]


def _share_text(share: float) -> str:
    """A share in per cent with two digits; below 1e-6 it is 0."""
    return f"{per_cent(share, '.2g')} %" if abs(share) > SMALL_SHARE else "0 %"


def accuracy_lines(
    report: AccuracyReport, diagnostics: Iterable[Diagnostic] = ()
) -> list[tuple[str, str]]:
    """Return whether a requested accuracy is kept, and what causes the error.

    diagnostics : of the result, for what the error does not include (N603)
    """
    worst = _worst_output(report)
    kept = "kept" if worst.error <= worst.allowed else "NOT kept"
    text = _share_of_allowed(worst, worst.error, " (estimate)")
    lines = [("wanted", f"{_request_text(report)}: {kept}"), ("error", text)]
    theories = [(o, o.theory) for o in report.outputs if o.theory is not None]
    if theories:
        text = _share_of_allowed(
            *max(theories, key=lambda pair: pair[1] / pair[0].allowed)
        )
        lines.append(("theory", f"linear theory has an error of about {text}"))
    excluded = [
        f"{each.data['what']} of {each.subject}"
        for each in diagnostics
        if each.code == "N603"
    ]
    lines += [("excluded", ", ".join(excluded))] if excluded else []
    choices = "; ".join(
        f"{line.part}: {line.choice}"
        for line in report.budget
        if line.part not in _NO_CHOICES
    )
    searched = _search_text(report)
    lines.append(("model", choices))
    lines.append(("search", searched if report.searched else f"earlier, {searched}"))
    return lines


def _share_of_allowed(output: OutputError, error: float, more: str = "") -> str:
    """An error of an output, and how much that is of what is allowed."""
    share = _share_text(error / output.allowed)
    amount = f"{error:.1e}{_unit_text(output)}"
    return f"{amount} in {output.name}{more}, {share} of what is allowed"


def _worst_output(report: AccuracyReport) -> OutputError:
    return max(report.outputs, key=lambda o: o.error / o.allowed)


def _unit_text(output: OutputError) -> str:
    return f" {output.unit}" if output.unit else ""


def _search_text(report: AccuracyReport) -> str:
    return f"{counted_noun(report.runs, 'run')} in {report.seconds:.2f} s"


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


def event_lines(
    events: Sequence[Event], most: int | None = None
) -> list[tuple[str, str]]:
    """Return lines on the first crossings of events, at most `most` of them."""
    crossings = [e for e in events if e.kind != "break"]
    shown = min(MAX_EVENTS, most or MAX_EVENTS)
    lines = [(e.name, f"{e.kind} at t = {e.t:.12g} s") for e in crossings[:shown]]
    more = len(crossings) - shown
    if more > 0:
        lines.append(("...", f"and {counted_noun(more, 'event')} later"))
    return lines


def describe_result(result: Result, verbose: bool = False) -> str:
    """Return the summary, the outputs with their range, and the versions.

    verbose : all elastic coordinates, outputs and diagnostics
    """
    return fit_on_screen(partial(_description, result), MAX_OUTPUTS, verbose)


def _description(result: Result, most: int | None) -> str:
    """The description of a result with at most so many rows in each of its tables."""
    parts = [run_summary(result, verbose=True, most=most)]
    if most is None:
        parts += [contributions(name, body) for name, body in result.bodies.items()]
    elif result.bodies:
        rows = min(most, MAX_COORDINATES)
        parts.append(largest_contributions(result.bodies, rows))
    if result.names and len(result.t):
        columns = dict(zip(result.names, result.values.T, strict=True))
        parts.append(output_ranges(columns, units_in(result), most))
    if result.versions:
        own = f"sidtool {result.versions.get('sidtool', '')}".rstrip()
        others = [f"{n} {v}" for n, v in result.versions.items() if n != "sidtool"]
        parts.append(f"written by {own}, with {', '.join(others)}")
    return "\n\n".join(parts)


def output_ranges(
    columns: Mapping[str, np.ndarray],
    unit: Callable[[str], str],
    most: int | None = None,
) -> str:
    """Tabulate the first, least, greatest and last value of each output.

    unit : of an output by its name
    most : largest number of rows, if it is limited
    """
    found = {name: column for name, column in columns.items() if len(column)}
    units = [unit(name) for name in found]
    ranges = [[c[0], np.min(c), np.max(c), c[-1]] for c in found.values()]
    rows = [
        [name, *(f"{value:.10g}" for value in values), u]
        for name, values, u in zip(
            found, without_rounding(ranges, units), units, strict=True
        )
    ]
    header = ["output", "first", "least", "greatest", "last", "unit"]
    return text_table(header, rows, most)


def contributions(name: str, body: FlexibleBody) -> TextBlock:
    """Tabulate the contribution of each elastic coordinate of a body to the motion."""
    return text_table([name, *_CONTRIBUTION_HEADER], _contribution_rows(body))


def largest_contributions(bodies: Mapping[str, FlexibleBody], most: int) -> TextBlock:
    """Tabulate the `most` elastic coordinates with the largest energies."""
    ranked = [
        (share, f"{name}.{row[0]}", row[1:])
        for name, body in bodies.items()
        for share, row in zip(body.energy_shares, _contribution_rows(body), strict=True)
    ]
    ranked.sort(key=lambda each: -each[0])
    rows = [[name, *cells] for _, name, cells in ranked]
    header = ("coordinate", *_CONTRIBUTION_HEADER)
    return text_table(header, rows, most, "with less (-v prints all)")


def _contribution_rows(body: FlexibleBody) -> list[list[str]]:
    names = body.names or [f"q{i + 1}" for i in range(len(body.labels))]
    sizes = without_rounding(body.amplitudes, [""] * len(body.amplitudes))
    columns = (body.frequencies, sizes, 100 * body.energy_shares)
    return [
        [
            coordinate,
            f"{hertz:.4f}",
            f"{size:.4g}",
            f"{share:.2f}",
            label_without_frequency(" ".join(label.split()), hertz),
        ]
        for coordinate, hertz, size, share, label in zip(
            names, *columns, body.labels, strict=False
        )
    ]


def result_span(result: Result) -> tuple[float, float, int]:
    count = len(result.t)
    return (float(result.t[0]), float(result.t[-1]), count) if count else (0.0, 0.0, 0)


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


def _cost_text(result: Result, verbose: bool) -> str:
    counters = result.counters
    shown = COUNTERS if verbose else ("steps", "rejected")
    parts = [
        counted_noun(int(counters[key]), COUNTERS[key])
        for key in shown
        if key in counters
    ]
    if "seconds" in counters:
        parts.append(f"{counters['seconds']:.3g} s")
    if "seconds_assembly" in counters:
        parts.append(f"start {counters['seconds_assembly']:.3g} s")
    return ", ".join(parts) or "not counted"


def _drift_text(result: Result) -> str:
    parts = [
        f"{value:.1e} {_DRIFT_UNITS.get(level, level)}"
        if value
        else f"0 {_DRIFT_UNITS.get(level, level)}"
        for level, value in result.drift.items()
    ]
    return "joints closed to " + ", ".join(parts) if parts else "not measured"


def plain_notes(result: WithDiagnostics) -> list[str]:
    """Return the diagnostics without the warnings, which are printed before, as one
    paragraph.
    """
    infos = [each for each in result.diagnostics if not each.is_warning]
    return [diagnostic_lines(infos)] if infos else []


def describe_accuracy(report: AccuracyReport, most: int | None = None) -> str:
    """Tabulate the error of each output, the budget, and the decisions."""
    tables = [error_table(report, most), budget_table(report)]
    tables += [decision_table(report, most)] if report.decisions else []
    return "\n\n".join(tables)


def error_table(report: AccuracyReport, most: int | None = None) -> TextBlock:
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
    return text_table(header, rows, most)


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


def decision_table(report: AccuracyReport, most: int | None = None) -> TextBlock:
    """Tabulate what could be left out of the model, its effect, and the choice."""
    header = ["part of the model", "effect of leaving it out", "of what is allowed"]
    rows = [_decision_row(decision) for decision in report.decisions]
    return text_table([*header, "choice"], rows, most)


def _decision_row(decision: Decision) -> list[str]:
    numbers = decision.numbers or ((decision.number,) if decision.number else ())
    what = " ".join([decision.what, *(str(number) for number in numbers)])
    part = f"{what} of {decision.body}" if decision.body else "motion out of the plane"
    choice = "kept" if decision.kept else "left out"
    if not decision.runs_without:
        return [part, "the scene does not run without it", "", choice]
    effect = f"{decision.effect:.1e} {decision.unit}".rstrip()
    share = _share_text(decision.effect / decision.allowed)
    return [part, f"{effect} in {decision.output}", share, choice]


def _relative_text(output: OutputError) -> str:
    return f"{output.relative:.1e}" if output.variation else ""


def _request_text(report: AccuracyReport) -> str:
    parts = [
        amount if name == "*" else f"{name} to {amount}"
        for name, amount in report.wanted.items()
    ]
    everything = "*" in report.wanted
    return ", ".join(parts) + (" of all outputs" if everything else "")
