"""What a run needs to know of a system before it: found once, for all of its runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from sidtool.formats.errors import InputError
from sidtool.formats.result import FlexibleBody

from ..start import assembly
from ..start.loads import with_prescribed_friction
from ..system.scene import System
from .asked.questions import questions
from .body_measures import expected_bodies
from .coverage import uncovered
from .light_links import refuse_light_links


@dataclass(frozen=True, eq=False)
class Prepared:
    """A system at its start.

    given : the system as it was compiled
    system : with redundant constraints marked
    start : positions and velocities that meet the constraints
    """

    given: System
    system: System
    start: assembly.Start

    @cached_property
    def asked(self) -> tuple[str, ...]:
        """Sentences for the one who wrote the scene."""
        return (*questions(self.given), *uncovered(self.system, self.start))

    @cached_property
    def expected(self) -> Mapping[str, FlexibleBody]:
        """What runs will ask of each flexible body."""
        return expected_bodies(self.system, self.start)


def prepare(system: System) -> Prepared:
    """Finds a start; for `System.once`, as nothing here depends on a run.

    Raises
    ------
    InputError : no start position meets the constraints, friction that the joints do
        not determine, or a link whose inertia rounding hides.
    """
    assembled, start = _assembled(system)
    refuse_light_links(assembled, start)
    return Prepared(system, with_prescribed_friction(assembled, start), start)


def _assembled(system: System) -> tuple[System, assembly.Start]:
    """An error that numbers in other units may explain ends with the questions."""
    try:
        return assembly.assemble(system)
    except InputError as error:
        asked = tuple(questions(system))
        if not asked:
            raise
        problem = "; ".join((error.problem, *asked))
        raise InputError(problem, place=error.place, expected=error.expected) from None
