"""Work against precision: seconds over the error that they buy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from .figure import figure

_MARKS = "osD^v"


def plot_precision(
    path: Path, points: Mapping[str, Iterable[tuple[float, float]]], label: str
) -> None:
    """Draw one line per method through its (error, seconds).

    Parameters
    ----------
    points : name of a method -> its pairs (error, seconds), in the order of the line
    label : what the error is of
    """
    with figure(path, size=(5.0, 3.6)) as axes:
        for number, (method, pairs) in enumerate(points.items()):
            errors, seconds = zip(*pairs, strict=True)
            axes.loglog(errors, seconds, f"{_MARKS[number % 5]}-", label=method)
        axes.invert_xaxis()
        axes.set_xlabel(label)
        axes.set_ylabel("wall time [s]")
        axes.legend()
