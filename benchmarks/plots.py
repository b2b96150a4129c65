"""Cost over size, and cost over error, on logarithmic axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from sidtool.plot.figure import saved_figure

MARKS = "osD^vP*X<"


def plot_scaling(
    path: Path,
    lines: Mapping[str, Sequence[tuple[float, float]]],
    size: str,
    cost: str,
) -> None:
    """One line per name through its (size, cost)."""
    with saved_figure(path, size=(5.0, 3.6)) as axes:
        for name, pairs in lines.items():
            axes.loglog(*zip(*pairs, strict=True), "o-", label=name)
        axes.set_xlabel(size)
        axes.set_ylabel(cost)
        axes.legend()


def plot_lines(
    path: Path, lines: Mapping[str, Sequence[tuple[float, float]]], error: str
) -> None:
    """One line per program through its (error, seconds), those of peers dashed."""
    with saved_figure(path, size=(7.5, 4.0)) as axes:
        for number, (name, pairs) in enumerate(lines.items()):
            style = "-" if name.startswith("sidtool") else "--"
            axes.loglog(
                *zip(*pairs, strict=True), f"{MARKS[number % 9]}{style}", label=name
            )
        axes.invert_xaxis()
        axes.set_xlabel(error)
        axes.set_ylabel("wall time [s]")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
