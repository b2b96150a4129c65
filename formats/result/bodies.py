"""What a run asked of its flexible bodies, beside what their SIDs can give."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..stiffening import Stiffening

Array = NDArray[np.float64]
#: Bodies that move by more than this part of their size leave the linear theory.
LARGE = 0.2
#: The highest retained frequency should be this many times the excitation.
ENOUGH = 3.0


@dataclass(frozen=True)
class Excitation:
    """The fastest excitation that drives and forces tell.

    frequency : [Hz], 0 where none is known, infinite of a jump
    by : what it is, in words
    """

    frequency: float = 0.0
    by: str = ""


@dataclass(frozen=True, eq=False)
class FlexibleBody:
    """One flexible body of a run.

    Attributes
    ----------
    highest_frequency : of the modes of (Ke, Me) [Hz]
    excitation : of the scene
    expected : stiffening by what was known before the run
    found : the largest stiffening at output times and ends of steps; None before the
        run
    labels : (nq,) labels of the elastic coordinates
    names : (nq,) what they are called in outputs, q1, ...
    frequencies : (nq,) of each elastic coordinate alone [Hz]
    amplitudes : (nq,) largest |q| at output times and ends of steps
    energy_shares : (nq,) part of each coordinate, q_i (Ke q)_i / 2, in the elastic
        energy of the body, meant over time; they add up to one
    deflection : largest elastic displacement of a node over the length of the body
    """

    highest_frequency: float
    excitation: Excitation
    expected: Stiffening
    found: Stiffening | None = None
    labels: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    frequencies: Array = field(default_factory=lambda: np.zeros(0))
    amplitudes: Array = field(default_factory=lambda: np.zeros(0))
    energy_shares: Array = field(default_factory=lambda: np.zeros(0))
    deflection: float = 0.0

    @property
    def before(self) -> str:
        """A sentence on frequencies and one on stiffening, known before a run."""
        return f"{self._frequency_range()}; expected: {self.expected.sentence()}"

    @property
    def after(self) -> str:
        """Sentences on stiffening and on deflection, known after a run."""
        if self.found is None:
            return "not reached by the run"
        text = self.found.sentence(f" at t = {self.found.time:.6g} s")
        if self.deflection > LARGE:
            text += (
                f"; it deforms by {self.deflection:.2g} of its size, beyond the small "
                "deformations that a SID describes"
            )
        return text

    @property
    def diverges(self) -> bool:
        """Before or in the run, deformations grow without bound."""
        return self.expected.diverges or (
            self.found is not None and self.found.diverges
        )

    def _frequency_range(self) -> str:
        text = f"frequencies to {self.highest_frequency:.6g} Hz"
        excitation = self.excitation
        if not excitation.frequency:
            return f"{text}, excitation unknown"
        if math.isinf(excitation.frequency):
            return f"{text}, excitation at all frequencies ({excitation.by})"
        ratio = self.highest_frequency / excitation.frequency
        text += f", {ratio:.3g} times the excitation of {excitation.frequency:.4g} Hz"
        text += f" ({excitation.by})"
        if ratio < ENOUGH:
            text += f", too few: keep shape functions up to {ENOUGH:g} times it"
        return text
