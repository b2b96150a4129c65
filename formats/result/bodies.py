"""What a run asked of its flexible bodies, beside what their SIDs can give."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..stiffening import Stiffening

Array = NDArray[np.float64]
#: Linear theory holds to this elastic displacement over the size of a body, and to
#: this elastic rotation [rad].
LARGE, LARGE_ROTATION = 0.1, 0.15
#: Elastic displacement over the size of a body from which numbers mean nothing.
MEANINGLESS = 1.0
_REMEDY = (
    "Cut the body into parts, each with a SID of its own, tied by joints of type fixed."
)
#: Bodies beyond linear theory that have a sentence of their own.
MOST_WARNINGS = 8
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
    deflection : largest elastic displacement of a node over the size of the body
    rotation : largest elastic rotation of a node [rad]
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
    rotation: float = 0.0

    @property
    def before(self) -> str:
        """A sentence on frequencies and one on stiffening, known before a run."""
        known = f"expected: {self.expected.sentence()}"
        if not self.expected.load:
            known = "no load that changes its stiffness is known before the run"
        return f"{self._frequency_range()}; {known}"

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

    def beyond_theory(self, name: str) -> str:
        """How far a body of this name left linear theory in the run; empty if it did
        not."""
        if self.found is None:
            return ""
        cause = ""
        if self.found.diverges:
            cause = f"{name} {self.found.sentence(f' at t = {self.found.time:.6g} s')}."
        return (
            describe_deformation(name, self.deflection, self.rotation, cause) or cause
        )

    @property
    def severity(self) -> tuple[bool, float, float]:
        """A key that sorts bodies by how little their numbers can be relied on.

        Divergence; then deformation, and stiffness that the SID lacks, over what linear
        theory holds to; then the change of stiffness.
        """
        stage = self.found or self.expected
        lacking = abs(stage.ratio) if stage.lacks_stiffening else 0.0
        return stage.diverges, max(self.excess, lacking / LARGE), abs(stage.ratio)

    @property
    def excess(self) -> float:
        """Deformation over what linear theory holds to; above 1 beyond it."""
        return max(self.deflection / LARGE, self.rotation / LARGE_ROTATION)

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


def describe_deformation(
    name: str, deflection: float, rotation: float, cause: str = ""
) -> str:
    """How far a deformation leaves linear theory; empty if it does not.

    Parameters
    ----------
    deflection : largest elastic displacement over the size of the body
    rotation : largest elastic rotation [rad]
    cause : a sentence that replaces the remedy
    """
    if deflection > LARGE:
        amount = f"{_percent(deflection)} of"
        if deflection > 1.0:
            amount = f"{deflection:.2g} times"
        fact, limit = f"deforms by {amount} its size", _percent(LARGE)
    elif rotation > LARGE_ROTATION:
        fact, limit = (
            f"turns elastically by {rotation:.2g} rad",
            f"{LARGE_ROTATION:g} rad",
        )
    else:
        return ""
    return f"{name} {fact}; linear theory holds to {limit}. {cause or _REMEDY}"


def find_warnings(bodies: Mapping[str, FlexibleBody]) -> tuple[str, ...]:
    """One sentence for each body that left linear theory in a run, the worst first."""
    found = {name: body.beyond_theory(name) for name, body in bodies.items()}
    order = [n for n in sorted(found, key=lambda n: -bodies[n].excess) if found[n]]
    return limit_sentences([(name, found[name]) for name in order])


def limit_sentences(found: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """The first sentences, and of the rest the bodies: (name, sentence), sorted."""
    told = tuple(sentence for _, sentence in found[:MOST_WARNINGS])
    rest = [name for name, _ in found[MOST_WARNINGS:]]
    if rest:
        told += (f"{', '.join(rest)} leave linear theory by less.",)
    return told


def find_failure(bodies: Mapping[str, FlexibleBody]) -> str:
    """Why the numbers of a run mean nothing; empty where they mean something."""
    worst = max(bodies, key=lambda n: bodies[n].deflection, default="")
    if not worst or not bodies[worst].deflection > MEANINGLESS:
        return ""
    return f"gives numbers without meaning: {bodies[worst].beyond_theory(worst)}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"
