"""Natural modes over a parameter: Campbell diagrams and critical speeds.

Modes at neighbouring values are the same if their shapes agree, by the modal assurance
criterion in the metric of the kinetic energy. Of modes of one frequency any
combinations are modes: their space is compared.

References
----------
R. J. Allemang: The modal assurance criterion - twenty years of use and abuse, Sound and
Vibration 37 (8), 2003.
G. Genta: Dynamics of Rotating Systems, 2005, section 2.4.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import (
    Diagnostic,
    WithDiagnostics,
    diagnose,
    each_once,
)

from .linearisation import GROWING, INSTABILITY_TOLERANCE, Linearisation

#: Eigenvalues that differ by less, relative to the largest, are those of one frequency.
EQUAL_EIGENVALUES = 1e-6
#: Weights beside the agreement of shapes: of the direction of whirl, as the shapes of
#: forward and backward whirl are conjugate, of the distance of eigenvalues, and of the
#: agreement of one shape with one other where several have the same frequency.
_WHIRL_WEIGHT, _DISTANCE_WEIGHT, _SINGLE_WEIGHT = 0.1, 1e-3, 0.05
#: Agreement of shapes below which it is uncertain that two modes are the same.
UNCERTAIN_AGREEMENT = 0.5
#: Relative accuracy of a critical speed.
_CRITICAL_TOLERANCE = 1e-10
_MAX_EVALUATIONS = 60
#: Halvings of the interval in which modes are followed, where shapes alone do not
#: determine which of them crosses.
_MAX_HALVINGS = 8
#: Relative distance of a frequency from a multiple of the speed that is no crossing but
#: a jump between modes.
_MISSED = 1e-6


@dataclass(frozen=True)
class CriticalSpeed:
    """A speed at which a multiple of the rotation excites a mode.

    Attributes
    ----------
    mode
        Number of the mode from 1, as in the diagram.
    value
        Of the parameter.
    speed
        Of the rotation [rad/s].
    order
        Times per revolution that the excitation acts.
    whirl
        "forward", "backward", or "" of what does not whirl.
    """

    mode: int
    value: float
    speed: float
    order: float
    whirl: str


@dataclass(frozen=True, eq=False)
class CampbellDiagram(WithDiagnostics):
    """Natural modes over a parameter, followed from value to value.

    Modes are numbered by frequency at the first value. A mode that another value does
    not have is NaN there.

    Attributes
    ----------
    key
        Of the parameter.
    values : (n,)
        Of the parameter.
    speeds : (n,)
        Of the body that rotates fastest [rad/s].
    inertial_frequencies, rotating_frequencies : (n, m)
        [Hz] in axes that do not turn, and in those of the bodies that move.
    damping_ratios : (n, m)
        -Re over the size of the eigenvalue.
    eigenvalues : (n, m)
        [1/s]
    whirl : (n, m)
        "forward", "backward" or "".
    agreement : (n, m)
        Of a shape with that at the value before, 0 to 1; 1 at the first.
    critical_speeds
        Where a frequency in inertial axes is a multiple of the speed.
    diagnostics
        Those of all values, each once, and uncertain modes (N724).
    """

    key: str
    values: Array
    speeds: Array
    inertial_frequencies: Array
    rotating_frequencies: Array
    damping_ratios: Array
    eigenvalues: np.ndarray
    whirl: np.ndarray
    agreement: Array
    critical_speeds: tuple[CriticalSpeed, ...] = ()
    diagnostics: tuple[Diagnostic, ...] = field(default=())


def campbell_diagram(
    key: str,
    values: Sequence[float],
    modes_at: Callable[[float], Linearisation],
    orders: Sequence[float] = (1.0,),
) -> CampbellDiagram:
    """Follow the modes of a scene over a parameter.

    Parameters
    ----------
    key, values
        Of the parameter.
    modes_at
        Returns the natural modes at a value.
    orders
        Times per revolution that an excitation acts.
    """
    modes_at = cache(modes_at)  # the search for critical speeds begins at the values
    points = [modes_at(value) for value in values]
    paths, agreement = _followed_paths(points)
    whirl = np.array(
        [
            ["" if k < 0 else point.whirl[k] for k in row]
            for point, row in zip(points, paths, strict=True)
        ]
    ).reshape(paths.shape)
    speeds = np.array([point.speed for point in points])
    found = [d for point in points for d in point.diagnostics if d.code != GROWING]
    diagram = CampbellDiagram(
        key=key,
        values=np.array(values, float),
        speeds=speeds,
        inertial_frequencies=_along(points, paths, "inertial_frequencies"),
        rotating_frequencies=_along(points, paths, "rotating_frequencies"),
        damping_ratios=_along(points, paths, "damping_ratios"),
        eigenvalues=_along(points, paths, "eigenvalues"),
        whirl=whirl,
        agreement=agreement,
        diagnostics=(*each_once(found), *_uncertain(key, values, agreement)),
    )
    growing = _growing(diagram, points, paths)
    critical = _critical_speeds(diagram, points, paths, modes_at, orders)
    return replace(
        diagram,
        diagnostics=(*diagram.diagnostics, *growing),
        critical_speeds=tuple(critical),
    )


def _along(points: Sequence[Linearisation], paths: Array, name: str) -> np.ndarray:
    """(n, m) numbers of the followed modes, NaN where there is none."""
    return np.array(
        [
            [np.nan if k < 0 else getattr(point, name)[k] for k in row]
            for point, row in zip(points, paths, strict=True)
        ]
    ).reshape(paths.shape)


def _uncertain(
    key: str, values: Sequence[float], agreement: Array
) -> Iterator[Diagnostic]:
    """The mode that is followed with least certainty (N724)."""
    if not agreement.size or not (agreement < UNCERTAIN_AGREEMENT).any():
        return
    n, k = np.unravel_index(np.nanargmin(agreement), agreement.shape)
    yield diagnose(
        "N724",
        mode=int(k) + 1,
        key=key,
        before=float(values[int(n) - 1]),
        after=float(values[int(n)]),
        agreement=float(agreement[n, k]),
    )


def _growing(
    diagram: CampbellDiagram, points: Sequence[Linearisation], paths: Array
) -> Iterator[Diagnostic]:
    """Followed modes that grow, with the values of the parameter (N714)."""
    known = [GROWING in {d.code for d in point.diagnostics} for point in points]
    rates = diagram.eigenvalues.real
    grows = diagram.damping_ratios < -INSTABILITY_TOLERANCE
    grows &= np.array(known)[:, None] & (_along(points, paths, "rigid") == 0.0)
    for k in np.flatnonzero(grows.any(axis=0)):
        values = diagram.values[grows[:, k]]
        span = " to ".join(f"{v:.6g}" for v in dict.fromkeys((values[0], values[-1])))
        subject = f"mode {k + 1}, {diagram.key} = {span}"
        yield diagnose(GROWING, subject, rate=float(rates[grows[:, k], k].max()))


def _followed_paths(points: Sequence[Linearisation]) -> tuple[np.ndarray, Array]:
    """Numbers of the modes of each point by path, -1 for none, and their agreement."""
    from scipy.optimize import linear_sum_assignment

    last = _ModeShapes.of(points[0])
    first = len(last.shapes)
    rows, agreement = [np.arange(first)], [np.ones(first)]
    for point in points[1:]:
        after = _ModeShapes.of(point)
        alike = shape_agreement(last, after)
        own, chosen = linear_sum_assignment(_differences(last, after, alike))
        path = np.flatnonzero(rows[-1] >= 0)[own]
        new = np.setdiff1d(np.arange(len(after.shapes)), chosen)
        rows = [np.append(row, np.full(len(new), -1)) for row in rows]
        agreement = [np.append(row, np.full(len(new), np.nan)) for row in agreement]
        rows.append(np.full(len(rows[0]), -1))
        agreement.append(np.full(len(rows[0]), np.nan))
        rows[-1][path], agreement[-1][path] = chosen, alike[own, chosen]
        count = len(rows[0])
        rows[-1][count - len(new) :] = new
        agreement[-1][count - len(new) :] = 1.0
        last = after.aligned_with(last, own, chosen).selected(rows[-1][rows[-1] >= 0])
    return np.array(rows, int), np.array(agreement)


@dataclass(frozen=True, eq=False)
class _ModeShapes:
    """Shapes (m, n) by coordinates of equal kinetic energy, of length 1, eigenvalues
    and directions of whirl of some modes."""

    shapes: np.ndarray
    eigenvalues: np.ndarray
    whirl: np.ndarray

    @classmethod
    def of(cls, modes: Linearisation) -> "_ModeShapes":
        shapes = modes.shapes / modes.scales
        sizes = np.linalg.norm(shapes, axis=1, keepdims=True)
        shapes = shapes / np.where(sizes > 0.0, sizes, 1.0)
        return cls(shapes, modes.eigenvalues, np.array(modes.whirl, dtype=object))

    def selected(self, numbers: np.ndarray) -> "_ModeShapes":
        return _ModeShapes(
            self.shapes[numbers], self.eigenvalues[numbers], self.whirl[numbers]
        )

    def aligned_with(
        self, before: "_ModeShapes", old: np.ndarray, new: np.ndarray
    ) -> "_ModeShapes":
        """Of several modes of one frequency, which any combinations are, those that are
        most like the ones before: modes keep their shapes where frequencies cross."""
        shapes = self.shapes.copy()
        for group in _equal_groups(self.eigenvalues):
            if len(group) < 2:
                continue
            basis = np.linalg.qr(self.shapes[group].T)[0]
            for i, k in zip(old, new, strict=True):
                if k in group:
                    kinds = before.shapes[i], before.shapes[i].conj()
                    parts = [basis @ (basis.conj().T @ shape) for shape in kinds]
                    part = max(parts, key=np.linalg.norm)
                    size = np.linalg.norm(part)
                    shapes[k] = part / size if size > 0.0 else shapes[k]
        return _ModeShapes(shapes, self.eigenvalues, self.whirl)


def shape_agreement(first: _ModeShapes, second: _ModeShapes) -> Array:
    """(m, n) the modal assurance criterion of the shapes of two states, 0 to 1.

    A mode and its conjugate are one: in axes that turn faster than it whirls, a mode
    turns the other way.
    """
    alike = np.zeros((len(first.shapes), len(second.shapes)))
    for shapes in (second.shapes, second.shapes.conj()):
        for group in _equal_groups(first.eigenvalues):
            shares = _shares(first.shapes[group], shapes)
            alike[group] = np.maximum(alike[group], shares)
        for group in _equal_groups(second.eigenvalues):
            shares = _shares(shapes[group], first.shapes)[:, None]
            alike[:, group] = np.maximum(alike[:, group], shares)
    return np.minimum(alike, 1.0)


def _differences(first: _ModeShapes, second: _ModeShapes, alike: Array) -> Array:
    """(m, n) how different the modes of two states are, least for one mode."""
    size = max(np.abs(p.eigenvalues).max(initial=1e-300) for p in (first, second))
    apart = np.abs(first.eigenvalues[:, None] - second.eigenvalues) / size
    before, after = first.whirl[:, None], second.whirl[None]
    turned = (before != after) & (before != "") & (after != "")
    products = [
        np.abs(first.shapes.conj() @ shapes.T)
        for shapes in (second.shapes, second.shapes.conj())
    ]
    single = np.maximum(*products) ** 2
    weighted = _WHIRL_WEIGHT * turned + _DISTANCE_WEIGHT * apart
    return np.asarray(weighted - alike - _SINGLE_WEIGHT * single)


def _shares(space: np.ndarray, shapes: np.ndarray) -> Array:
    """(n,) the squared parts of shapes (n, ...) in the space of others (k, ...)."""
    basis = np.linalg.qr(space.T)[0]
    return np.asarray(np.sum(np.abs(basis.conj().T @ shapes.T) ** 2, axis=0))


def _equal_groups(eigenvalues: np.ndarray) -> list[np.ndarray]:
    """Numbers of the modes, in groups of one eigenvalue."""
    size = np.abs(eigenvalues).max(initial=0.0)
    left, groups = list(range(len(eigenvalues))), []
    while left:
        same = [
            k
            for k in left
            if abs(eigenvalues[k] - eigenvalues[left[0]]) <= EQUAL_EIGENVALUES * size
        ]
        groups.append(np.array(same))
        left = [k for k in left if k not in same]
    return groups


def _critical_speeds(
    diagram: CampbellDiagram,
    points: Sequence[Linearisation],
    paths: np.ndarray,
    modes_at: Callable[[float], Linearisation],
    orders: Sequence[float],
) -> Iterator[CriticalSpeed]:
    """Where frequencies in inertial axes cross multiples of the speed."""
    for mode, order in ((k, x) for k in range(paths.shape[1]) for x in orders):
        lines = order * diagram.speeds
        gap = 2.0 * np.pi * diagram.inertial_frequencies[:, mode] - lines
        for n in map(int, np.flatnonzero(gap[:-1] * gap[1:] <= 0.0)):
            if gap[n + 1] == 0.0 == gap[n] or (n and gap[n] == 0.0):
                continue  # a rigid motion at rest, or found as the end before
            ends = float(diagram.values[n]), float(diagram.values[n + 1])
            first, last = (int(k) for k in paths[n : n + 2, mode])
            found = _crossing_between(modes_at, order, ends, (first, last))
            if found is not None and found[1] > 0.0:
                whirl = str(diagram.whirl[n + 1, mode])
                yield CriticalSpeed(mode + 1, *found, order, whirl)


def _crossing_between(
    modes_at: Callable[[float], Linearisation],
    order: float,
    ends: tuple[float, float],
    numbers: tuple[int, int],
) -> tuple[float, float] | None:
    """Value and speed at which the frequency of a mode is a multiple of the speed, None
    where modes that are followed in smaller steps do not cross it.

    Parameters
    ----------
    ends, numbers
        Values of the parameter, and numbers of the mode there.
    """
    from scipy.optimize import brentq

    (a, b), (first, last) = ends, numbers
    for _ in range(_MAX_HALVINGS):
        start = _ModeShapes.of(modes_at(b))  # at rest forward is like backward
        crossing = _Crossing(modes_at, start.selected(np.array([last])), order)
        if crossing.gap(a) * crossing.gap(b) <= 0.0:
            value, _ = brentq(
                crossing.gap,
                a,
                b,
                xtol=_CRITICAL_TOLERANCE * max(map(abs, ends)),
                rtol=_CRITICAL_TOLERANCE,
                maxiter=_MAX_EVALUATIONS,
                full_output=True,
                disp=False,
            )
            if abs(crossing.gap(value)) <= _MISSED * crossing.speed:
                return float(value), crossing.speed
        values = a, 0.5 * (a + b), b
        points = [modes_at(value) for value in values]
        paths, _ = _followed_paths(points)
        path = paths[:, list(paths[0]).index(first)]
        if (path < 0).any():
            return None
        gap = [
            2.0 * np.pi * point.inertial_frequencies[k] - order * point.speed
            for point, k in zip(points, path, strict=True)
        ]
        half = 0 if gap[0] * gap[1] <= 0.0 else 1
        if gap[half] * gap[half + 1] > 0.0:
            return None
        (a, b), (first, last) = values[half : half + 2], path[half : half + 2]
    return None


class _Crossing:
    """Distance of the frequency of a mode from a multiple of the speed."""

    def __init__(
        self,
        modes_at: Callable[[float], Linearisation],
        start: _ModeShapes,
        order: float,
    ) -> None:
        self._modes_at, self._start, self._order = modes_at, start, order
        self.speed = 0.0

    def gap(self, value: float) -> float:
        """Return the angular frequency minus the multiple of the speed [rad/s]."""
        modes = self._modes_at(value)
        before, after = self._start, _ModeShapes.of(modes)
        alike = shape_agreement(before, after)
        k = int(np.argmin(_differences(before, after, alike)[0]))
        self.speed = modes.speed
        frequency = 2.0 * np.pi * float(modes.inertial_frequencies[k])
        return frequency - self._order * modes.speed
