"""What a run needs to know of a system before it: found once, for all of its runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sidtool.formats.errors import InputError
from sidtool.formats.result import FlexibleBody

from ..start import assembly
from ..start.loads import with_prescribed_friction
from ..system.scene import System
from .asked.questions import questions
from .body_measures import expected_bodies
from .coverage import uncovered


@dataclass(frozen=True, eq=False)
class Prepared:
    """A system at its start.

    system : with redundant constraints marked
    start : positions and velocities that meet the constraints
    asked : sentences for the one who wrote the scene
    expected : what runs will ask of each flexible body
    """

    system: System
    start: assembly.Start
    asked: tuple[str, ...]
    expected: Mapping[str, FlexibleBody]


def prepare(system: System) -> Prepared:
    """Finds a start; for `System.once`, as nothing here depends on a run.

    Raises
    ------
    InputError : no start position meets the constraints, or friction that the joints
        do not determine.
    """
    asked = tuple(questions(system))
    system, start = _assembled(system, asked)
    system = with_prescribed_friction(system, start)
    asked = (*asked, *uncovered(system, start))
    return Prepared(system, start, asked, expected_bodies(system, start))


def _assembled(system: System, asked: tuple[str, ...]) -> tuple[System, assembly.Start]:
    """An error that numbers in other units may explain ends with the questions."""
    try:
        return assembly.assemble(system)
    except InputError as error:
        if not asked:
            raise
        problem = "; ".join((error.problem, *asked))
        raise InputError(problem, place=error.place, expected=error.expected) from None
