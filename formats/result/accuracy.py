"""How exact the numbers of a result are, what they cost, and what was left out."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ..scene.base import Table


class OutputError(Table):
    """The error of one output: the largest difference over time to the finest model."""

    name: str
    unit: str = ""
    error: float = Field(description="estimate, in the unit of the output")
    variation: float = Field(description="greatest less least value in the run")
    allowed: float = Field(description="error that was asked for, in that unit")
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
        """Of the variation."""
        return self.error / self.variation if self.variation else 0.0


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
    """One thing that could be left out, and what became of it."""

    body: str = Field(description="empty for space, which all bodies share")
    what: Literal[
        "shape function",
        "shape functions",
        "flexibility",
        "geometric stiffening",
        "quadratic inertia",
        "space",
    ]
    number: int | None = Field(default=None, description="of the shape function")
    numbers: tuple[int, ...] = Field(
        default=(), description="of shape functions that were left out together"
    )
    output: str = Field(description="in which leaving it out is seen most")
    effect: float = Field(description="on that output, in its unit")
    allowed: float = Field(description="error of it that was asked for")
    unit: str = ""
    kept: bool
    sentence: str


class AccuracyReport(Table):
    """What `[accuracy] wanted` came to."""

    wanted: dict[str, str]
    outputs: tuple[OutputError, ...]
    budget: tuple[BudgetLine, ...]
    decisions: tuple[Decision, ...]
    sentences: tuple[str, ...] = Field(description="decisions and all else, in words")
    runs: int = Field(description="that were made to choose")
    seconds: float = Field(description="that choosing took")
    notes: tuple[str, ...] = Field(
        default=(), description="of the run that errors are measured against"
    )
    searched: bool = Field(
        default=True, description="false: what was found before was kept and used"
    )

    def errors(self) -> dict[str, float]:
        """By output, relative to its variation."""
        return {output.name: output.relative for output in self.outputs}

    def absolute(self) -> dict[str, float]:
        """By output, in its unit."""
        return {output.name: output.error for output in self.outputs}
