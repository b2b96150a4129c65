"""Figures of a sweep: measures over design parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError

from .figure import legend_columns, legend_rows, saved_figure, use_log_scale, wrap_label

#: Size of a page without legend, height of a panel, and of a row of the legend [inch].
_WIDTH, _PANEL, _ROW = 5.5, 2.2, 0.19
#: Largest number of lines with a legend.
MOST_LINES = 24
#: Ratio of the largest to the least value of a geometric sequence above which an axis
#: is logarithmic.
_LOGARITHMIC = 20.0


def plot_sweep(
    path: Path | None,
    table: Mapping[str, np.ndarray],
    axes: Sequence[str],
    measures: Sequence[str],
    header: Mapping[str, str],
    succeeded: Sequence[bool],
) -> Any:
    """Draw a panel per measure over the first key, a line for each combination of the
    other keys; runs that failed are gaps.

    Parameters
    ----------
    path : file of the figure, or None
    table : columns (n,) by name
    axes, measures : names of columns
    header : titles of columns with units
    succeeded : (n,) True if the run gave numbers

    Raises
    ------
    InputError : no run has a number.
    """
    measures = [name for name in measures if np.isfinite(table[name]).any()]
    if not measures:
        raise InputError("holds no numbers to draw", expected="a run that succeeds")
    first, *others = axes
    lines: dict[str, list[int]] = {}
    for row in range(len(succeeded)):
        label = ", ".join(
            f"{_key_label(k)} = {_value_text(table[k][row])}" for k in others
        )
        lines.setdefault(label, []).append(row)
    lines = {
        label: rows
        for label, rows in lines.items()
        if any(succeeded[row] for row in rows)
    }
    places, labels = _axis_positions(table[first])
    keyed = [label for label in lines if label] if len(lines) <= MOST_LINES else []
    legend_height = _ROW * legend_rows(keyed, _WIDTH) if keyed else 0.0
    size = _WIDTH, 0.6 + _PANEL * len(measures) + legend_height
    with saved_figure(path, len(measures), size=size) as all_panels:
        panels = np.atleast_1d(all_panels)
        for panel, name in zip(panels, measures, strict=True):
            values = table[name]
            for number, (label, rows) in enumerate(lines.items()):
                shade = {}
                if len(lines) > MOST_LINES:
                    share = number / (len(lines) - 1)
                    shade = {"color": (0.1 + 0.7 * share, 0.4, 0.8 - 0.7 * share)}
                order = sorted(rows, key=lambda row: places[row])
                panel.plot(
                    places[order],
                    values[order],
                    "o-",
                    markersize=3,
                    label=label,
                    **shade,
                )
            panel.set_ylabel(wrap_label(header[name], _PANEL))
        _label_axis(panels[-1], places, labels, header[first])
        if keyed:
            handles, texts = panels[0].get_legend_handles_labels()
            panels[0].figure.legend(
                handles,
                texts,
                loc="outside upper right",
                ncols=legend_columns(texts, _WIDTH),
            )
    return panels[0].figure


def _label_axis(panel: Any, places: np.ndarray, labels: list[str], name: str) -> None:
    panel.set_xlabel(name)
    if labels:
        panel.set_xticks(range(len(labels)), labels)
        return
    values = np.unique(places)
    ratios = values[1:] / values[:-1] if values[0] > 0 else np.zeros(0)
    far = len(ratios) > 1 and values[-1] > _LOGARITHMIC * values[0]
    if far and np.allclose(ratios, ratios[0], rtol=1e-6):
        use_log_scale(panel.xaxis)


def _axis_positions(values: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Return positions of values on the axis, and labels of those that are no
    numbers.
    """
    if values.dtype != object:
        return values, []
    labels = list(dict.fromkeys(map(_value_text, values)))
    return np.array(
        [labels.index(_value_text(value)) for value in values], float
    ), labels


def _key_label(key: str) -> str:
    """Return the key without the table of parameters."""
    return key.removeprefix("parameters.")


def _value_text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
