"""Response of a linearised mechanism to harmonic inputs.

With u = Re(e exp(i omega t)) the outputs are y = Re(H exp(i omega t)),

    H = (C (i omega I - A)^-1 B + D) e.

A is brought to Schur form once, so that a frequency costs a triangular solve.

References
----------
A. J. Laub: Efficient multivariable frequency response computations. IEEE Transactions
on Automatic Control 26 (1981), 407-408.
"""

import ast
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eig, matrix_balance, schur, solve_triangular
from scipy.optimize import minimize_scalar

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import INPUTS

from .input_effects import DERIVATIVE_NAMES
from .state_space import NO_INPUTS, StateSpace

#: Frequencies of a range without a number of them.
DEFAULT_COUNT = 500
#: Frequencies about a resonance, in damping ratios away from it.
AROUND_RESONANCE = np.array(
    [-8.0, -4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0]
)
#: A mode with less damping has no finite peak.
NO_DAMPING = 1e-9
#: A peak is this part higher than the lowest response on either side of it.
PROMINENCE = 1e-3
#: Slower oscillations than this part of the largest eigenvalue are rigid motions.
RIGID = 1e-7
#: The mode of a peak differs less in its frequency, besides by two damping ratios.
NEAR_MODE = 0.2
_OPERATORS: dict[type, int] = {ast.Add: 1, ast.Sub: -1}
_EXCITATION = (
    'an input, or a sum of inputs with factors such as "fx - 1j*fy" or "2*left + right"'
)


@dataclass(frozen=True)
class Peak:
    """A maximum of the magnitude of a frequency response.

    Attributes
    ----------
    output
        Its name.
    frequency
        [Hz].
    magnitude
        inf for a mode without damping.
    mode_frequency, damping_ratio
        Of the mode with the largest part in it among those near by: |eigenvalue| / 2 pi
        [Hz] and -Re / |eigenvalue|; nan where there is none, as at a maximum between
        two zeros.
    """

    output: str
    frequency: float
    magnitude: float
    mode_frequency: float
    damping_ratio: float


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Response of outputs to harmonic inputs.

    Attributes
    ----------
    frequencies : (n,)
        [Hz].
    values : (n, outputs)
        Complex amplitudes of the outputs per unit of the excitation.
    output_names, units : (outputs,)
        Units are those of the magnitude, "" if an input has none.
    excitation
        The inputs, with their complex amplitudes.
    peaks
        By output and growing frequency.
    title
        Of the scene.
    """

    frequencies: Array
    values: np.ndarray
    output_names: tuple[str, ...]
    units: tuple[str, ...]
    excitation: str
    peaks: tuple[Peak, ...] = ()
    title: str = ""

    @property
    def magnitude(self) -> Array:
        """|H|, (n, outputs)."""
        return np.abs(self.values)

    @property
    def phase(self) -> Array:
        """Phase of H without jumps of a whole turn, (n, outputs) [rad]."""
        return np.unwrap(np.angle(self.values), axis=0)


def parse_excitation(text: str, known: Sequence[str]) -> dict[str, complex]:
    """Return the complex amplitudes of a sum of inputs, such as ``fx - 1j*fy``.

    Raises
    ------
    InputError
        It is no such sum, or names an unknown input.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError):
        raise _not_an_excitation(text) from None
    amplitudes: dict[str, complex] = {}
    for name, factor in _terms(tree, 1.0, text):
        plain = name.removeprefix(f"{INPUTS}.")
        if plain not in known:
            expected = f"one of {', '.join(known)}" if known else NO_INPUTS
            raise InputError(f"found {plain!r}", place="input", expected=expected)
        amplitudes[plain] = amplitudes.get(plain, 0.0) + factor
    return amplitudes


def _not_an_excitation(text: str) -> InputError:
    return InputError(f"found {text!r}", place="input", expected=_EXCITATION)


def _terms(node: ast.expr, factor: complex, text: str) -> list[tuple[str, complex]]:
    """Names of inputs and their factors in an expression."""
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        sign = _OPERATORS[type(node.op)]
        left = _terms(node.left, factor, text)
        return left + _terms(node.right, sign * factor, text)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
        sign = -1 if isinstance(node.op, ast.USub) else 1
        return _terms(node.operand, sign * factor, text)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        for number, other in ((node.left, node.right), (node.right, node.left)):
            value = _number(number)
            if value is not None:
                return _terms(other, value * factor, text)
    name = _dotted_name(node)
    if not name:
        raise _not_an_excitation(text)
    return [(name, factor)]


def _number(node: ast.expr) -> complex | None:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float | complex):
        return complex(node.value)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = _number(node.operand)
        return None if value is None else -value
    return None


def _dotted_name(node: ast.expr) -> str:
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        owner = _dotted_name(node.value)
        return f"{owner}.{node.attr}" if owner else ""
    return ""


def frequency_range(text: str) -> Array:
    """Return the frequencies [Hz] of ``FIRST:LAST``, ``FIRST:LAST:log`` or ``:lin``,
    with their number as last part if wanted, such as ``1:2000:log:400``.

    Raises
    ------
    InputError
        It is no such range.
    """
    parts = text.split(":")
    numbers = [part for part in parts if part not in ("log", "lin")]
    kinds = [part for part in parts if part in ("log", "lin")]
    try:
        first, last = float(numbers[0]), float(numbers[1])
        count = int(numbers[2]) if len(numbers) > 2 else DEFAULT_COUNT
        is_log = (kinds or ["log"])[0] == "log"
        good = len(parts) < 5 and len(numbers) < 4 and len(kinds) < 2 and count > 1
        good &= 0.0 <= first < last < math.inf and not (is_log and first == 0.0)
    except (ValueError, IndexError):
        good = False
    if not good:
        raise InputError(
            f"found {text!r}",
            place="frequencies",
            expected="such as 1:2000:log or 0:100:lin:400 [Hz], growing",
        )
    grid = np.geomspace if is_log else np.linspace
    return np.asarray(grid(first, last, count))


def frequency_response(
    space: StateSpace,
    frequencies: ArrayLike | str,
    excitation: str | Mapping[str, complex] | None = None,
    outputs: Sequence[str] | None = None,
    *,
    unbalance: bool = False,
) -> FrequencyResponse:
    """Return the response to harmonic inputs.

    Parameters
    ----------
    frequencies
        [Hz], or a range as of `frequency_range`, to which points about the resonances
        are added.
    excitation
        An input, a sum of inputs with complex factors, or their amplitudes by name;
        default the only input. A force that turns from x to y is "fx - 1j*fy". Of an
        input that prescribes a motion the input itself or its derivative can be named.
    outputs
        Names, default all of the state space.
    unbalance
        Amplitudes are those of an unbalance, mass times distance [kg m]: they are
        multiplied by omega^2.

    Raises
    ------
    InputError
        There is no such input or output.
    """
    known = _known_inputs(space)
    if excitation is None:
        if len(space.input_names) != 1:
            raise InputError(
                f"the state space has {len(space.input_names) or 'no'} inputs",
                place="input",
                expected=_EXCITATION if space.input_names else NO_INPUTS,
            )
        excitation = min(known, key=len)  # the input, not a derivative of it
    given = excitation if isinstance(excitation, str) else _excitation_text(excitation)
    amplitudes = (
        parse_excitation(excitation, tuple(known))
        if isinstance(excitation, str)
        else dict(excitation)
    )
    rows = _output_rows(space, outputs)
    selected = [(known[name], factor) for name, factor in amplitudes.items()]
    transfer = _Transfer(space, selected, rows, unbalance)
    grid = _grid(frequencies)
    fine = _with_resonances(grid, transfer)
    fine_values = transfer(fine)
    points, values = fine, fine_values
    if not isinstance(frequencies, str):
        points, values = grid, transfer(grid)
    names = tuple(space.output_names[k] for k in rows)
    units = [_unit_of_input(space, name, known[name]) for name in amplitudes]
    of_input = units[0] if len({*units}) == 1 else ""
    if unbalance:
        of_input = "kg m" if of_input in ("N", "") else f"({of_input} s\u00b2)"
    return FrequencyResponse(
        points,
        values,
        names,
        tuple(_ratio(space.output_units[k], of_input) for k in rows),
        given,
        tuple(_peaks(transfer, fine, np.abs(fine_values), names)),
        space.title,
    )


def _grid(frequencies: ArrayLike | str) -> Array:
    """The requested frequencies [Hz]."""
    if isinstance(frequencies, str):
        return frequency_range(frequencies)
    points = np.array(frequencies, float).ravel()
    if not len(points) or not np.isfinite(points).all() or points.min() < 0.0:
        raise InputError(
            "found no frequencies, or one that is not positive",
            place="frequencies",
            expected="frequencies [Hz]",
        )
    return points


def _known_inputs(space: StateSpace) -> dict[str, tuple[int, int]]:
    """Column of each input that can be named, and the powers of i omega with it."""
    known = {}
    for column, name in enumerate(space.input_names):
        known[name] = column, 0
        for order, suffix in enumerate(DERIVATIVE_NAMES[1:], 1):
            if name.endswith(suffix):
                plain = name.removesuffix(suffix)
                for k in range(order):
                    known[plain + DERIVATIVE_NAMES[k]] = column, order - k
    return known


def _unit_of_input(space: StateSpace, name: str, known: tuple[int, int]) -> str:
    """Unit of an input that can be named; of what is a state, that of the state."""
    column, powers = known
    if powers == 0:
        return space.input_units[column]
    return space.state_units[space.state_names.index(f"{INPUTS}.{name}")]


def _excitation_text(amplitudes: Mapping[str, complex]) -> str:
    return " + ".join(f"{factor}*{name}" for name, factor in amplitudes.items())


def _ratio(output: str, of_input: str) -> str:
    if not of_input:
        return ""
    unit = f"({of_input})" if " " in of_input or "/" in of_input else of_input
    return f"{output or '1'}/{unit}"


def _output_rows(space: StateSpace, names: Sequence[str] | None) -> list[int]:
    if names is None:
        return list(range(len(space.output_names)))
    known = {name: k for k, name in enumerate(space.output_names)}
    for name in names:
        if name not in known:
            listed = ", ".join(known) or "an output of the scene"
            raise InputError(
                f"found {name!r}", place="outputs", expected=f"one of {listed}"
            )
    return [known[name] for name in names]


class _Transfer:
    """H of some outputs at frequencies."""

    def __init__(
        self,
        space: StateSpace,
        inputs: Sequence[tuple[tuple[int, int], complex]],
        rows: Sequence[int],
        unbalance: bool,
    ) -> None:
        self.inputs, self.unbalance = inputs, unbalance
        columns = [column for (column, _), _ in inputs]
        A = T = Z = space.A
        sizes = np.ones(len(A))  # of the states, so that entries of A are alike
        if len(A):
            A, scaling = matrix_balance(A, permute=False)
            sizes = scaling.diagonal()
            T, Z = schur(A, output="complex")
        self.T, self.C = T, (space.C[rows] * sizes) @ Z
        self.B = Z.conj().T @ (space.B[:, columns] / sizes[:, None])
        self.D = space.D[np.ix_(rows, columns)]
        values, left, right = (
            eig(space.A, left=True, right=True)
            if len(space.A)
            else (np.zeros(0), space.A, space.A)
        )
        self.eigenvalues = values
        norms = np.einsum("ik,ik->k", left.conj(), right)
        with np.errstate(divide="ignore", invalid="ignore"):
            self.participation = left.conj().T @ space.B[:, columns] / norms[:, None]
        self.shapes = space.C[rows] @ right

    def amplitudes(self, omega: float) -> np.ndarray:
        """Amplitudes of the inputs of the state space, (inputs,)."""
        found = [factor * (1j * omega) ** k for (_, k), factor in self.inputs]
        return np.array(found, complex) * (omega**2 if self.unbalance else 1.0)

    def __call__(self, frequencies: Array) -> np.ndarray:
        values = np.zeros((len(frequencies), len(self.C)), complex)
        ones = np.eye(len(self.T))
        for k, omega in enumerate(2.0 * np.pi * frequencies):
            e = self.amplitudes(omega)
            shifted = 1j * omega * ones - self.T
            if len(shifted) and not np.abs(shifted.diagonal()).min() > 0.0:
                values[k] = np.inf
                continue
            x = solve_triangular(shifted, self.B @ e) if len(shifted) else self.B @ e
            values[k] = self.C @ x + self.D @ e
        return values

    def leading_mode(self, row: int, frequency: float) -> complex | None:
        """The eigenvalue of the oscillation with the largest part in an output, among
        those with a frequency near by."""
        omega = 2.0 * np.pi * frequency
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = np.abs(
                self.shapes[row]
                * (self.participation @ self.amplitudes(omega))
                / (1j * omega - self.eigenvalues)
            )
        values, sizes = self.eigenvalues, np.abs(self.eigenvalues)
        slowest = RIGID * sizes.max(initial=0.0)
        width = NEAR_MODE * sizes + 2.0 * np.abs(values.real)
        is_near = (values.imag > slowest) & (np.abs(omega - sizes) < width)
        parts = np.where(is_near, np.nan_to_num(parts), 0.0)
        if not parts.any():
            return None
        return complex(values[int(np.argmax(parts))])


def _with_resonances(grid: Array, transfer: _Transfer) -> Array:
    """The frequencies with some about each resonance between them."""
    added = [grid]
    for value in transfer.eigenvalues[transfer.eigenvalues.imag > 0.0]:
        ratio = abs(value.real) / abs(value)
        if ratio > NO_DAMPING:
            around = abs(value.imag) * (1.0 + ratio * AROUND_RESONANCE)
        else:
            around = abs(value.imag) * (1.0 + 1e-3 * AROUND_RESONANCE[[4, 6]])
        added.append(around / (2.0 * np.pi))
    points = np.unique(np.concatenate(added))
    return points[(points >= grid.min()) & (points <= grid.max())]


def _peaks(
    transfer: _Transfer, points: Array, magnitudes: Array, names: Sequence[str]
) -> list[Peak]:
    """Maxima of the magnitudes (n, outputs) at growing frequencies (n,)."""
    found = []
    for row, name in enumerate(names):
        sizes = magnitudes[:, row]
        for k in range(1, len(points) - 1):
            if not (sizes[k] > sizes[k - 1] and sizes[k] >= sizes[k + 1]):
                continue
            if not _is_prominent(sizes, k):
                continue
            best = minimize_scalar(
                lambda f, row=row: -float(abs(transfer(np.array([f]))[0, row])),
                bounds=(points[k - 1], points[k + 1]),
                method="bounded",
                options={"xatol": 1e-10 * points[k]},
            )
            frequency, magnitude = float(best.x), float(-best.fun)
            value = transfer.leading_mode(row, frequency)
            if value is None:
                found.append(Peak(name, frequency, magnitude, math.nan, math.nan))
                continue
            ratio = -value.real / abs(value)
            hertz = abs(value) / (2.0 * math.pi)
            if abs(ratio) < NO_DAMPING:
                frequency, magnitude = hertz, math.inf
                if any((p.output, p.frequency) == (name, hertz) for p in found):
                    continue  # both sides of an infinite peak
            found.append(Peak(name, frequency, magnitude, hertz, float(ratio)))
    return found


def _is_prominent(sizes: Array, k: int) -> bool:
    """True if the response falls on both sides of a maximum before it rises above."""
    for side in (sizes[k - 1 :: -1], sizes[k + 1 :]):
        above = np.flatnonzero(side > sizes[k])
        lowest = side[: above[0] if len(above) else len(side)].min()
        if lowest > (1.0 - PROMINENCE) * sizes[k]:
            return False
    return True
