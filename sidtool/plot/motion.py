"""Courses of outputs from several runs: overlaid, and their difference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sidtool.formats.result import Result

from .figure import COLOURS, figure
from .words import legend

_LINES = ("-", "--", ":", "-.")


def plot_motions(
    path: Path, results: Mapping[str, Result], outputs: Mapping[str, str]
) -> None:
    """Draw each output of all runs over time, and below it how they differ.

    Parameters
    ----------
    results : runs by the name for the legend, on the same output times; differences
        are taken from the first
    outputs : name of an output -> label of its axis

    Raises
    ------
    InputError : a run lacks an output.
    """
    first, *others = results.items()
    rows = len(outputs) * (2 if others else 1)
    with figure(path, rows, size=(7.0, 1.8 * rows + 0.4)) as axes:
        column = axes if rows > 1 else [axes]
        for number, (name, label) in enumerate(outputs.items()):
            here = column[number * (rows // len(outputs)) :]
            _overlay(here[0], results, name, label)
            if others:
                _difference(here[1], first, others, name, label)
        column[-1].set_xlabel("t [s]")


def _overlay(axes: Any, results: Mapping[str, Result], name: str, label: str) -> None:
    for number, (run, result) in enumerate(results.items()):
        axes.plot(
            result.t,
            result[name],
            _LINES[number % len(_LINES)],
            color=COLOURS[number % len(COLOURS)],
            label=run,
        )
    axes.set_ylabel(label)
    legend(axes)


def _difference(
    axes: Any,
    first: tuple[str, Result],
    others: Sequence[tuple[str, Result]],
    name: str,
    label: str,
) -> None:
    for number, (run, result) in enumerate(others, 1):
        axes.plot(
            result.t,
            result[name] - first[1][name],
            color=COLOURS[(number + 1) % len(COLOURS)],
            label=f"{run} - {first[0]}",
        )
    axes.set_ylabel(f"difference\n{label}")
    axes.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3))
    legend(axes)
