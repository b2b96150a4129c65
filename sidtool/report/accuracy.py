"""The error budget of a run that was asked for an accuracy."""

from __future__ import annotations

from sidtool.formats.result import AccuracyReport, BudgetLine, OutputError

from .tables import Block, named, plural, table


def accuracy_summary(report: AccuracyReport) -> Block:
    """A few lines: what was asked for, the worst output, and the sentences."""
    entries = [("wanted", _wanted(report)), ("reached", _reached(report))]
    entries += [("choice", text) for text in report.sentences]
    searched = f"{plural(report.runs, 'run')} in {report.seconds:.2f} s"
    how = f"by {searched}" if report.searched else f"before, by {searched}"
    return named([*entries, ("found", how)])


def describe_accuracy(report: AccuracyReport) -> str:
    """The error of each output, the budget, and why."""
    parts = [accuracy_summary(report), error_table(report), budget_table(report)]
    return "\n\n".join(parts)


def error_table(report: AccuracyReport) -> Block:
    """Outputs with their error, in their unit and of their variation; where they are
    known bounds, and what small deformations leave out."""
    found = {
        "bound": [o.bound for o in report.outputs],
        "theory": [o.theory for o in report.outputs],
    }
    known = {n: values for n, values in found.items() if any(values)}
    rows = [
        [o.name, f"{o.error:.1e}", *(_number(values[k]) for values in known.values())]
        + [f"{o.allowed:.1e}", o.unit, _relative(o)]
        for k, o in enumerate(report.outputs)
    ]
    header = ["output", "error", *known, "allowed", "unit", "of its variation"]
    return table(header, rows)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def budget_table(report: AccuracyReport) -> Block:
    """Each kind of choice with what it adds to the worst output, and its cost."""
    rows = [_row(line, report) for line in report.budget]
    header = ["part", "choice", "error", "in", "of what is allowed"]
    return table([*header, "seconds", "at its finest"], rows)


def _row(line: BudgetLine, report: AccuracyReport) -> list[str]:
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


def _relative(output: OutputError) -> str:
    return f"{output.relative:.1e}" if output.variation else ""


def _wanted(report: AccuracyReport) -> str:
    parts = [
        amount if name == "*" else f"{name} to {amount}"
        for name, amount in report.wanted.items()
    ]
    everything = "*" in report.wanted
    return ", ".join(parts) + (" of all outputs" if everything else "")


def _reached(report: AccuracyReport) -> str:
    worst = max(report.outputs, key=lambda o: o.error / o.allowed)
    unit = f" {worst.unit}" if worst.unit else ""
    return (
        f"{worst.name} errs most, by {worst.error:.1e}{unit} "
        f"({_relative(worst) or 'absolute'}) of {worst.allowed:.1e} allowed: measured "
        "at the output times against the finest model, an estimate"
    )
