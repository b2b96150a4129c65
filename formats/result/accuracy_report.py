"""Accuracy of a result: output errors, decisions, deformation of flexible bodies."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..diagnostics import Diagnostic, WithDiagnostics, diagnose
from ..geometric_stiffening import (
    SIGNIFICANT_CHANGE,
    UNBOUNDED_RATIO,
    LoadStiffening,
)
from ..scene.base import Table

Array = NDArray[np.float64]
#: Linear theory holds to this elastic displacement over the size of a body, and to
#: this elastic rotation [rad].
MAX_DEFLECTION, MAX_ROTATION = 0.1, 0.15
#: Elastic displacement over the size of a body from which numbers mean nothing.
MEANINGLESS_DEFLECTION = 1.0
#: Diagnostics of flexible bodies, found for the whole of a run.
BODY_CODES = frozenset(
    {"N404", "N405", "N406", "N407", "N408", "N411", "N412", "N413", "N419"}
)
#: Bodies beyond linear theory that have diagnostics of their own.
MAX_WARNINGS = 8
#: The highest retained frequency should be this many times the excitation.
MIN_FREQUENCY_RATIO = 3.0


class OutputError(Table):
    """The error of one output: the largest difference over time to the finest model."""

    name: str
    unit: str = ""
    error: float = Field(description="estimate, in the unit of the output")
    variation: float = Field(description="greatest less least value in the run")
    allowed: float = Field(description="requested error, in that unit")
    bound: float | None = Field(
        default=None,
        description="what the error against all that the SIDs hold cannot exceed, in "
        "that unit; none where nothing of the kind is known",
    )
    theory: float | None = Field(
        default=None,
        description="estimate of what small deformations leave out, in that unit, from "
        "a run in another body frame; it is no part of the error; none where that was "
        "not measured",
    )

    @property
    def relative(self) -> float:
        """Error relative to the variation."""
        return self.error / self.variation if self.variation else 0.0

    def values(self) -> dict[str, Any]:
        """Return values for a diagnostic.

        Returns
        -------
        output, amount (with its unit, in words), error (in the unit of the output) and
        share (of what is allowed)
        """
        return {
            "output": self.name,
            "amount": f"{self.error:.2g} {self.unit}".rstrip(),
            "error": self.error,
            "share": self.error / self.allowed,
        }


class BudgetLine(Table):
    """One kind of choice: what it adds to the errors, and what it saves."""

    part: str
    choice: str = Field(description="what was chosen, in words")
    errors: dict[str, float] = Field(description="by output, in its unit")
    seconds: float = Field(description="of the run as it was chosen")
    finest: float | None = Field(
        default=None, description="seconds of the run with this choice at its finest"
    )


class Decision(Table):
    """A possible simplification of the model, and whether it was made."""

    body: str = Field(description="empty for space, which all bodies share")
    what: Literal[
        "shape function",
        "shape functions",
        "flexibility",
        "geometric stiffening",
        "quadratic inertia",
        "space",
        "static shape functions",
    ]
    number: int | None = Field(default=None, description="of the shape function")
    numbers: tuple[int, ...] = Field(
        default=(), description="of shape functions that were left out together"
    )
    output: str = Field(description="in which leaving it out is seen most")
    effect: float = Field(description="on that output, in its unit")
    allowed: float = Field(description="requested error of it")
    unit: str = ""
    kept: bool
    runs_without: bool = Field(
        default=True, description="false: the scene does not run without it"
    )


class AccuracyReport(Table):
    """Result of a requested accuracy."""

    wanted: dict[str, str]
    outputs: tuple[OutputError, ...]
    budget: tuple[BudgetLine, ...]
    decisions: tuple[Decision, ...]
    runs: int = Field(description="that were made to choose")
    seconds: float = Field(description="that choosing took")
    searched: bool = Field(
        default=True, description="false: what was found before was kept and used"
    )

    def errors(self) -> dict[str, float]:
        """Errors by output, relative to the variation."""
        return {output.name: output.relative for output in self.outputs}

    def absolute(self) -> dict[str, float]:
        """Errors by output, in the unit of the output."""
        return {output.name: output.error for output in self.outputs}


@dataclass(frozen=True)
class Excitation:
    """The fastest excitation of a body that drives and forces imply.

    Attributes
    ----------
    frequency : [Hz], 0 if none is known, infinite for a jump
    by : its source, in words
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
    expected : stiffening estimated before the run
    found : largest stiffening at output times and ends of steps; None before the run
    labels : (nq,) labels of the elastic coordinates
    names : (nq,) their names in outputs, q1, ...
    frequencies : (nq,) of each elastic coordinate alone [Hz]
    amplitudes : (nq,) largest |q| at output times and ends of steps
    energy_shares : (nq,) share of each coordinate, q_i (Ke q)_i / 2, in the elastic
        energy of the body, mean over time; they add up to one
    deflection : largest elastic displacement of a node over the size of the body
    rotation : largest elastic rotation of a node [rad]
    """

    highest_frequency: float
    excitation: Excitation
    expected: LoadStiffening
    found: LoadStiffening | None = None
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
        if self.deflection > MAX_DEFLECTION:
            text += (
                f"; it deforms by {self.deflection:.2g} of its size, beyond the small "
                "deformations that a SID describes"
            )
        return text

    def beyond_theory(self, name: str) -> list[Diagnostic]:
        """How a body of this name left linear theory in the run (N405 to N413)."""
        if self.found is None:
            return []
        found = deformation_diagnostics(name, self.deflection, self.rotation)
        if self.found.diverges:
            found.append(divergence_diagnostic(name, self.found))
        return found

    def model_limits(self, name: str) -> list[Diagnostic]:
        """What the SID of a body of this name lacks for the run (N404, N412)."""
        limits, found, excitation = [], self.found, self.excitation
        is_limited = found is not None and found.lacks_stiffening and not found.diverges
        if found and is_limited and abs(found.ratio) >= SIGNIFICANT_CHANGE:
            limits.append(_missing_stiffening("N404", name, found))
        if 0.0 < excitation.frequency < math.inf:
            ratio = self.highest_frequency / excitation.frequency
            if ratio < MIN_FREQUENCY_RATIO:
                limits.append(
                    diagnose(
                        "N412",
                        name,
                        highest=self.highest_frequency,
                        ratio=ratio,
                        excitation=excitation.frequency,
                        by=excitation.by,
                        needed=MIN_FREQUENCY_RATIO * excitation.frequency,
                    )
                )
        return limits

    @property
    def severity(self) -> tuple[bool, float, float]:
        """A key that sorts bodies by how little their numbers can be relied on.

        Divergence; then deformation, and stiffness that the SID lacks, over what linear
        theory holds to; then the change of stiffness.
        """
        stage = self.found or self.expected
        ratio_without = abs(stage.ratio) if stage.lacks_stiffening else 0.0
        return (
            stage.diverges,
            max(self.excess, ratio_without / MAX_DEFLECTION),
            abs(stage.ratio),
        )

    @property
    def excess(self) -> float:
        """Deformation over what linear theory holds to; above 1 beyond it."""
        return max(self.deflection / MAX_DEFLECTION, self.rotation / MAX_ROTATION)

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
        if ratio < MIN_FREQUENCY_RATIO:
            text += (
                f", too few: keep shape functions up to {MIN_FREQUENCY_RATIO:g} "
                "times it"
            )
        return text


def deformation_diagnostics(
    name: str, deflection: float, rotation: float
) -> list[Diagnostic]:
    """How far a deformation leaves linear theory (N411, N413).

    Parameters
    ----------
    deflection : largest elastic displacement over the size of the body
    rotation : largest elastic rotation [rad]
    """
    if deflection > MAX_DEFLECTION:
        return [diagnose("N411", name, deflection=deflection, limit=MAX_DEFLECTION)]
    if rotation > MAX_ROTATION:
        return [diagnose("N413", name, rotation=rotation, limit=MAX_ROTATION)]
    return []


def _missing_stiffening(code: str, name: str, found: LoadStiffening) -> Diagnostic:
    """Centrifugal softening without the stiffening that the SID lacks (N404, N405)."""
    return diagnose(
        code,
        name,
        t=found.time,
        ratio=found.ratio,
        load=found.load,
        remedy=found.remedy,
    )


def stiffening_diagnostic(name: str, found: LoadStiffening) -> Diagnostic:
    """How loads change the stiffness of a body whose SID lacks it (N404 to N408)."""
    if found.diverges:
        return divergence_diagnostic(name, found)
    return _missing_stiffening("N404", name, found)


def divergence_diagnostic(name: str, found: LoadStiffening) -> Diagnostic:
    """Why deformations of a body grow without bound (N405 to N408)."""
    if abs(found.ratio) > UNBOUNDED_RATIO:
        return diagnose("N407", name, t=found.time)
    if found.axial:
        return diagnose("N406", name, t=found.time, load=found.load)
    if found.lacks_stiffening:
        return _missing_stiffening("N405", name, found)
    return diagnose(
        "N408", name, t=found.time, factor=abs(found.ratio), load=found.load
    )


def validity_diagnostics(
    bodies: Mapping[str, FlexibleBody],
) -> tuple[Diagnostic, ...]:
    """Diagnostics of bodies that left linear theory in a run, the worst first."""
    found = {name: body.beyond_theory(name) for name, body in bodies.items()}
    return worst_first(found, {name: body.excess for name, body in bodies.items()})


def worst_first(
    found: Mapping[str, Sequence[Diagnostic]], excess: Mapping[str, float]
) -> tuple[Diagnostic, ...]:
    """Diagnostics of the worst bodies, and the names of the rest (N419).

    Parameters
    ----------
    found : diagnostics of each body, if it has some
    excess : deformation over what linear theory holds to, by body
    """
    names = sorted((n for n in found if found[n]), key=lambda n: -excess[n])
    first = tuple(d for name in names[:MAX_WARNINGS] for d in found[name])
    omitted = names[MAX_WARNINGS:]
    if omitted:
        first += (diagnose("N419", ", ".join(omitted)),)
    return first


def meaningless_body(deflections: Mapping[str, float]) -> tuple[Diagnostic, ...]:
    """The body that makes numbers meaningless (N414), if one does.

    Parameters
    ----------
    deflections : largest elastic displacement over size, by body
    """
    worst = max(deflections, key=lambda name: deflections[name], default="")
    if not worst or not deflections[worst] > MEANINGLESS_DEFLECTION:
        return ()
    return (diagnose("N414", worst, deflection=deflections[worst]),)


def has_meaningless_numbers(result: WithDiagnostics) -> bool:
    """Whether a run reached its end with numbers that mean nothing (N414)."""
    return any(each.code == "N414" for each in result.diagnostics)
