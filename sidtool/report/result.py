"""What a result holds and what it cost."""

from __future__ import annotations

import numpy as np

from formats.result import Result

from .tables import named, plural, table

#: counters in the order of a summary, with the words for them
COUNTERS = {
    "steps": "step",
    "rejected": "rejected step",
    "evaluations": "evaluation",
    "jacobians": "Jacobian",
    "factorisations": "factorisation",
    "newton_iterations": "Newton iteration",
}
_DRIFT_UNITS = {"position": "m", "velocity": "m/s"}


def summary(result: Result) -> str:
    """A few lines after a run: span, cost, drift, error."""
    entries = [
        ("motion", _span(result)),
        ("method", _settings(result)),
        ("cost", _cost(result)),
        ("drift", _drift(result)),
    ]
    error = result.counters.get("estimated_error")
    if error is not None:
        entries.append(("estimated error", f"{error:.1e}"))
    if not result.completed:
        entries.append(("stopped", result.message))
    return named(entries)


def describe_result(result: Result) -> str:
    """The summary, the outputs with their range, and the versions."""
    rows = [
        [name, f"{column[0]:.10g}", *(f"{f(column):.10g}" for f in (np.min, np.max))]
        + [f"{column[-1]:.10g}"]
        for name, column in zip(result.names, result.values.T, strict=True)
        if len(column)
    ]
    parts = [named([("title", result.title or "(none)")]) + "\n" + summary(result)]
    if rows:
        parts.append(table(["output", "first", "least", "greatest", "last"], rows))
    if result.versions:
        made = ", ".join(f"{name} {text}" for name, text in result.versions.items())
        parts.append(f"made with {made}")
    return "\n\n".join(parts)


def _span(result: Result) -> str:
    if not len(result.t):
        return "no output time was reached"
    times = plural(len(result.t), "output time")
    return f"{result.t[0]:g} s to {result.t[-1]:g} s, {times}"


def _settings(result: Result) -> str:
    settings = result.settings
    parts = [str(settings.get("integrator", "unknown integrator"))]
    step = settings.get("step")
    if step:
        parts.append(f"fixed step {step:g} s" if isinstance(step, float) else f"{step}")
    elif "rtol" in settings:
        parts.append(f"relative tolerance {settings['rtol']:g}")
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
