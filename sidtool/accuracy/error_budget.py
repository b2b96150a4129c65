"""Contribution of each kind of choice to the error and to the saved time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.result import BudgetLine

from ..measurement.candidates import Choice, with_all_shapes, with_all_terms
from ..measurement.runs import Runs
from .reference_run import Reference
from .selection import SelectedModel


def error_budget(
    runs: Runs,
    reference: Reference,
    chosen: SelectedModel,
    theory: Array,
    seen_by: str = "two methods",
) -> tuple[BudgetLine, ...]:
    """Build the error budget: a line for each kind of choice, the reference and the
    sum.

    Each choice is switched alone: the selected model against the one with this choice
    at its finest, both integrated tightly; the selected integration against a tight
    one. The last line is the selected run against the reference, with the uncertainty
    of the reference. The terms neglected by linear theory follow below.

    Parameters
    ----------
    theory : (n,) terms neglected by linear theory, zero where they were not measured
    seen_by : text on how the errors of the reference are known
    """
    lines = _BudgetLines(runs, reference, chosen)
    whole, setting = chosen.choice, chosen.accepted_run.setting
    shapes = with_all_shapes(whole, reference.choice)
    terms = with_all_terms(whole, reference.choice)
    integration_error = runs.max_differences(
        (whole, runs.attempt(whole, setting)),
        (whole, runs.attempt(whole, reference.setting)),
    )
    tight = runs.seconds(whole, reference.setting)
    method = f"{setting.integrator}, rtol {setting.rtol:.2g}"
    meshes = (lines.line("mesh", "of models", reference.meshes, None),)
    frames = (lines.line("frames", "not their own", reference.frames, None),)
    left_out = (lines.line("theory", "small deformations", theory, None),)
    digits = (lines.line("digits", "of files", reference.digits, None),)
    return (
        *(meshes if reference.meshes.any() else ()),
        *(lines.plane() if whole.flat else ()),
        lines.choice_line("shape functions", _shapes_text(whole, reference), shapes),
        lines.choice_line("terms", _terms_text(whole, reference), terms),
        lines.line(
            "integration", method, integration_error + reference.resolution, tight
        ),
        lines.line("reference", seen_by, reference.uncertainty, None),
        *(digits if reference.digits.any() else ()),
        *(frames if reference.frames.any() else ()),
        lines.line("all together", "as run", chosen.errors, None),
        *(left_out if theory.any() else ()),
    )


class _BudgetLines:
    def __init__(self, runs: Runs, reference: Reference, chosen: SelectedModel) -> None:
        self.runs, self.reference, self.chosen = runs, reference, chosen

    def plane(self) -> tuple[BudgetLine, ...]:
        """Return the line of the planar reduction: finest planar against spatial
        model.
        """
        space, setting = self.reference.choice, self.chosen.accepted_run.setting
        plane = replace(space, flat=True)
        errors = self.runs.difference(plane, space, self.reference.setting)
        seconds = self.runs.seconds(space, setting)
        text = "planar, for spatial"
        return (self.line("space", text, errors + self.reference.resolution, seconds),)

    def choice_line(self, part: str, text: str, finer: Choice) -> BudgetLine:
        """Return the line of the choices that `finer` replaces by the finest ones."""
        setting, choice = self.chosen.accepted_run.setting, self.chosen.choice
        if finer == choice:
            nothing = np.zeros(len(self.runs.names))
            return self.line(part, text, nothing, self.chosen.accepted_run.seconds)
        errors = self.runs.difference(choice, finer, self.reference.setting)
        seconds = self.runs.seconds(finer, setting)
        return self.line(part, text, errors + self.reference.resolution, seconds)

    def line(
        self, part: str, text: str, errors: Array, finest: float | None
    ) -> BudgetLine:
        pairs = zip(self.runs.names, errors, self.reference.allowed, strict=True)
        return BudgetLine(
            part=part,
            choice=text,
            errors={n: float(e) for n, e, a in pairs if np.isfinite(a)},
            seconds=self.chosen.accepted_run.seconds,
            finest=None if finest is None or not np.isfinite(finest) else finest,
        )


def _shapes_text(choice: Choice, reference: Reference) -> str:
    """Return a text such as "3 of 8, rod rigid"."""
    all_ = dict(reference.choice.kept)
    kept = sum(len(numbers) for _, numbers in choice.kept)
    total = sum(map(len, all_.values()))
    rigid = [n for n, numbers in choice.kept if all_[n] and not numbers]
    return ", ".join([f"{kept} of {total}", *(f"{name} rigid" for name in rigid)])


def _terms_text(choice: Choice, reference: Reference) -> str:
    flexible = {n for n, kept in choice.kept if kept}
    unstiffened = sorted(choice.unstiffened & flexible)
    simple = sorted((reference.choice.quadratic - choice.quadratic) & flexible)
    parts = [f"{n} without geometric stiffening" for n in unstiffened]
    parts += [f"{n} without quadratic inertia" for n in simple]
    return ", ".join(parts) or "all"
