"""What each kind of choice adds to the error and saves in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.result import BudgetLine
from sidtool.formats.sid import Array

from .candidates import Choice, with_all_shapes, with_all_terms
from .choose import Chosen
from .reference import Reference
from .runs import Runs


def budget(
    runs: Runs,
    reference: Reference,
    chosen: Chosen,
    theory: Array,
    seen_by: str = "two methods",
) -> tuple[BudgetLine, ...]:
    """One line for each kind of choice, one for the reference, one for all together.

    Each is switched alone: the chosen model against the one that has this choice at
    its finest, both integrated tightly; the chosen integration against a tight one.
    The line of all together is the chosen run against the reference, with all that is
    not known of it. What small deformations leave out stands below it.

    Parameters
    ----------
    theory : (n,) what small deformations leave out, zero where that was not measured
    seen_by : how errors of the reference are known
    """
    lines = _Lines(runs, reference, chosen)
    whole, setting = chosen.choice, chosen.found.setting
    shapes = with_all_shapes(whole, reference.choice)
    terms = with_all_terms(whole, reference.choice)
    loose = runs.between(
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
        lines.switched("shape functions", _shapes_told(whole, reference), shapes),
        lines.switched("terms", _terms_told(whole, reference), terms),
        lines.line("integration", method, loose + reference.resolution, tight),
        lines.line("reference", seen_by, reference.uncertainty, None),
        *(digits if reference.digits.any() else ()),
        *(frames if reference.frames.any() else ()),
        lines.line("all together", "as run", chosen.errors, None),
        *(left_out if theory.any() else ()),
    )


class _Lines:
    def __init__(self, runs: Runs, reference: Reference, chosen: Chosen) -> None:
        self.runs, self.reference, self.chosen = runs, reference, chosen

    def plane(self) -> tuple[BudgetLine, ...]:
        """The line of the plane: the finest model there and in space."""
        space, setting = self.reference.choice, self.chosen.found.setting
        plane = replace(space, flat=True)
        errors = self.runs.difference(plane, space, self.reference.setting)
        seconds = self.runs.seconds(space, setting)
        told = "planar, for spatial"
        return (self.line("space", told, errors + self.reference.resolution, seconds),)

    def switched(self, part: str, told: str, finer: Choice) -> BudgetLine:
        """The line of what `finer` has at its finest."""
        setting, choice = self.chosen.found.setting, self.chosen.choice
        if finer == choice:
            nothing = np.zeros(len(self.runs.names))
            return self.line(part, told, nothing, self.chosen.found.seconds)
        errors = self.runs.difference(choice, finer, self.reference.setting)
        seconds = self.runs.seconds(finer, setting)
        return self.line(part, told, errors + self.reference.resolution, seconds)

    def line(
        self, part: str, told: str, errors: Array, finest: float | None
    ) -> BudgetLine:
        pairs = zip(self.runs.names, errors, self.reference.allowed, strict=True)
        return BudgetLine(
            part=part,
            choice=told,
            errors={n: float(e) for n, e, a in pairs if np.isfinite(a)},
            seconds=self.chosen.found.seconds,
            finest=None if finest is None or not np.isfinite(finest) else finest,
        )


def _shapes_told(choice: Choice, reference: Reference) -> str:
    """ "3 of 8, rod rigid"."""
    all_ = dict(reference.choice.kept)
    kept = sum(len(numbers) for _, numbers in choice.kept)
    total = sum(map(len, all_.values()))
    rigid = [n for n, numbers in choice.kept if all_[n] and not numbers]
    return ", ".join([f"{kept} of {total}", *(f"{name} rigid" for name in rigid)])


def _terms_told(choice: Choice, reference: Reference) -> str:
    flexible = {n for n, kept in choice.kept if kept}
    bare = sorted(choice.unstiffened & flexible)
    simple = sorted((reference.choice.quadratic - choice.quadratic) & flexible)
    parts = [f"{n} without geometric stiffening" for n in bare]
    parts += [f"{n} without quadratic inertia" for n in simple]
    return ", ".join(parts) or "all"
