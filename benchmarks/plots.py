"""Cost over size on logarithmic axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from sidtool.plot.figure import figure


def plot_scaling(
    path: Path,
    lines: Mapping[str, Sequence[tuple[float, float]]],
    size: str,
    cost: str,
) -> None:
    """One line per name through its (size, cost)."""
    with figure(path, size=(5.0, 3.6)) as axes:
        for name, pairs in lines.items():
            axes.loglog(*zip(*pairs, strict=True), "o-", label=name)
        axes.set_xlabel(size)
        axes.set_ylabel(cost)
        axes.legend()
