"""Inputs of a plant as pieces of polynomials, each from a time on."""

from typing import NamedTuple

from ..functions.piecewise import N_INPUT_TERMS


class InputPiece(NamedTuple):
    """An input from a time on: a cubic polynomial.

    Attributes
    ----------
    start : time [s]
    terms : coefficients of powers of the time since then, lowest first
    """

    start: float
    terms: tuple[float, ...]

    @classmethod
    def constant(cls, start: float, value: float) -> "InputPiece":
        """The piece that stays at a value."""
        return cls(start, (value, *[0.0] * (N_INPUT_TERMS - 1)))

    def at(self, t: float) -> tuple[float, float]:
        """Value and rate at a time t [s]."""
        x = t - self.start
        value, rate = 0.0, 0.0
        for term in reversed(self.terms):
            rate = rate * x + value
            value = value * x + term
        return value, rate

    def mean_rate(self, length: float) -> float:
        """Mean rate over a time from the start on, without cancellation."""
        mean = 0.0
        for term in reversed(self.terms[1:]):
            mean = mean * length + term
        return mean

    @property
    def is_constant(self) -> bool:
        return not any(self.terms[1:])


def piece_to_goal(
    continuity: int, start: float, end: float, before: InputPiece, goal: float
) -> InputPiece:
    """The piece of an input that is to have a value at the end of a time span.

    A cubic polynomial ends with the rate of the parabola through the values at the ends
    of both spans; after rest, of the parabola that begins without rate. Its second
    derivative then has an error of first order in their lengths. With a mean rate it
    would go from four times to minus twice its value.

    Parameters
    ----------
    continuity : 1 for a straight line, 2 for a cubic polynomial that begins with the
        rate of the piece before
    before : the piece until the start
    """
    length = end - start
    value, rate = before.at(start)
    mean = (goal - value) / length
    if continuity < 2:
        return InputPiece(start, (value, mean, 0.0, 0.0))
    length_before = 0.0 if before.is_constant else start - before.start
    change = mean - before.mean_rate(length_before)
    last_rate = mean + change * length / (length + length_before)
    square = (3.0 * mean - 2.0 * rate - last_rate) / length
    cube = (rate + last_rate - 2.0 * mean) / length**2
    return InputPiece(start, (value, rate, square, cube))
