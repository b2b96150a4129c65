"""Figures of studies and sweeps: error over cost, measures over design parameters.

Figure of an optimisation: functionals and variables over the iterations.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.study import StudyFile, StudyPoint

from .figure import (
    PowersOfTen,
    draw_legend,
    legend_columns,
    legend_rows,
    order_by_rows,
    saved_figure,
    use_log_scale,
    wrap_label,
    wrap_text,
)

_MARKS = "osD^v"
#: Width of the lines of a label [inch].
_LABEL = 3.0
#: Axes with a smaller ratio have labels between powers of ten, or at even distances.
MAX_DECADE_SPAN, MAX_EVEN_SPAN = 100.0, 5.0
#: Drawn costs of a study and their labels.
_COSTS = {
    "seconds": "wall time [s]",
    "size": "elastic coordinates",
    "dofs": "degrees of freedom of the meshes",
}

#: Size of a page without legend, height of a panel, and of a row of the legend [inch].
_WIDTH, _PANEL, _ROW = 5.5, 2.2, 0.19
#: Largest number of lines with a legend.
MOST_LINES = 24
#: Ratio of the largest to the least value of a geometric sequence above which an axis
#: is logarithmic.
_LOGARITHMIC = 20.0
#: Width of the figure, height of a panel and of the axis below all [inch].
_DESIGN_WIDTH, _DESIGN_PANEL, _AXIS = 7.0, 1.6, 0.6


def plot_precision(
    path: Path | None, points: Mapping[str, Iterable[tuple[float, float]]], label: str
) -> Any:
    """Draw one line per method through its (error, seconds).

    Parameters
    ----------
    points : pairs (error, seconds) by method, in the order of the line
    label : quantity of the error
    """
    with saved_figure(path, size=(5.0, 3.6)) as axes:
        for number, (method, pairs) in enumerate(points.items()):
            errors, seconds = zip(*pairs, strict=True)
            axes.plot(errors, seconds, f"{_MARKS[number % 5]}-", label=method)
        for axis in (axes.xaxis, axes.yaxis):
            use_log_scale(axis)
        axes.invert_xaxis()
        axes.set_xlabel(label)
        axes.set_ylabel("wall time [s]")
        _label_decades(axes)
        draw_legend(axes)
    return axes.figure


def plot_study(path: Path | None, content: StudyFile) -> Any:
    """Draw a study: a work-precision diagram with a line per integrator, or error over
    time and size with Pareto fronts if more than integrators vary. Return the figure.

    Raises
    ------
    InputError : no setting gave an error.
    """
    good = [p for p in content.points if not p.message and p.error and p.seconds]
    if not good:
        raise InputError("holds no errors to draw", expected="a study with runs")
    others = [name for name in content.varied if name != "integrator"]
    if others:
        return _plot_fronts(path, content, good, others[0])
    lines: dict[str, list[tuple[float, float]]] = {}
    for p in good:
        name = p.integrator + ("" if p.step is None else ", fixed step")
        lines.setdefault(name, []).append((float(p.error or 0), float(p.seconds or 0)))
    return plot_precision(path, lines, _study_errors(content))


def _study_errors(content: StudyFile) -> str:
    title = f", {content.title}" if content.title else ""
    return wrap_text(f"relative error{title}", _LABEL)


def _plot_fronts(
    path: Path | None, content: StudyFile, points: list[StudyPoint], axis: str
) -> Any:
    """Draw one panel for each cost that differs; colours show the values of
    one axis.
    """
    costs = [c for c in _COSTS if len({getattr(p, c) for p in points}) > 1]
    kinds = list(dict.fromkeys(p.choices.get(axis, "") for p in points))
    size = (4.2 * max(len(costs), 1), 4.2)
    with saved_figure(path, 1, len(costs), size=size) as panels:
        every = list(panels) if len(costs) > 1 else [panels]
        for panel, cost in zip(every, costs, strict=True):
            for number, kind in enumerate(kinds):
                chosen = [p for p in points if p.choices.get(axis, "") == kind]
                pairs = [(getattr(p, cost), p.error) for p in chosen]
                panel.plot(
                    *zip(*pairs, strict=True),
                    _MARKS[number % 5],
                    markersize=4,
                    alpha=0.6,
                    label=f"{axis} {kind}",
                )
            front = [(getattr(p, cost), float(p.error or 0), p.told) for p in points]
            draw_front(panel, front)
            panel.axhline(content.uncertainty, color="0.5", linestyle=":")
            use_log_scale(panel.yaxis)
            if cost != "size":
                use_log_scale(panel.xaxis)
            panel.set_xlabel(_COSTS[cost])
            _label_decades(panel)
        every[0].set_ylabel(_study_errors(content))
        handles, labels = every[-1].get_legend_handles_labels()
        columns = legend_columns(labels, size[0] - 0.4)
        rows = order_by_rows(handles, labels, columns)
        every[0].figure.legend(*rows, loc="outside upper left", ncols=columns)
    return every[0].figure


def draw_front(panel: Any, points: list[tuple[float, float, bool]]) -> None:
    """Draw the Pareto front of costs and errors, up to the first unresolved error."""
    best: list[tuple[float, float]] = []
    is_labelled = True
    for cost, error, is_told in sorted(points):
        if is_labelled and (not best or error < best[-1][1]):
            best.append((cost, error))
            is_labelled = is_told
    best.append((max(cost for cost, *_ in points), best[-1][1]))
    panel.step(
        *zip(*best, strict=True),
        where="post",
        color="0.2",
        label="Pareto front",
        marker="o",
        markersize=7,
        markerfacecolor="none",
        markevery=range(len(best) - 1),
    )


def _label_decades(axes: Any) -> None:
    """Label 1, 2 and 5 of each decade if there are few, else powers of ten: labels at
    every minor tick would overlap.
    """
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() != "log":
            continue
        low, high = sorted(axis.get_view_interval())
        if high < MAX_DECADE_SPAN * low:
            near = high < MAX_EVEN_SPAN * low
            some = MaxNLocator(3) if near else LogLocator(subs=(1.0, 2.0, 5.0))
            axis.set_major_locator(some)
            every = PowersOfTen(minor_thresholds=(math.inf, math.inf))
            axis.set_major_formatter(every)
        axis.set_minor_formatter(NullFormatter())


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


def plot_history(
    path: Path | None, panels: Sequence[tuple[str, Array, Sequence[float]]]
) -> Any:
    """Draw a panel for each quantity.

    Parameters
    ----------
    path : file to write (.png, .svg, .pdf)
    panels : label, values over the iterations, limits as dashed lines
    """
    size = _DESIGN_WIDTH, _AXIS + _DESIGN_PANEL * len(panels)
    with saved_figure(path, len(panels), size=size) as drawn:
        all_axes = np.atleast_1d(drawn)
        for axes, (label, values, limits) in zip(all_axes, panels, strict=True):
            axes.plot(values, "o-", markersize=3)
            for limit in limits:
                axes.axhline(limit, color="0.4", linestyle="--", linewidth=0.8)
            axes.set_ylabel(wrap_label(label, _DESIGN_PANEL))
        all_axes[-1].set_xlabel("iteration")
        all_axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    return all_axes[0].figure


def plot_fit(
    path: Path | None, panels: Sequence[tuple[str, Array, Array, Array]]
) -> Any:
    """Draw measured and fitted values of outputs over time.

    Parameters
    ----------
    path : file to write (.png, .svg, .pdf)
    panels : label, times, measured and fitted values
    """
    size = _DESIGN_WIDTH, _AXIS + 2.0 * _DESIGN_PANEL * max(1, len(panels))
    with saved_figure(path, max(1, len(panels)), size=size) as drawn:
        all_axes = np.atleast_1d(drawn)
        for axes, (label, times, measured, fitted) in zip(
            all_axes, panels, strict=False
        ):
            axes.plot(times, measured, ".", markersize=3, label="measured")
            axes.plot(times, fitted, linewidth=1.0, label="fitted")
            axes.set_ylabel(wrap_label(label, _DESIGN_PANEL))
        all_axes[0].legend(loc="upper right")
        all_axes[-1].set_xlabel("t [s]")
    return all_axes[0].figure
