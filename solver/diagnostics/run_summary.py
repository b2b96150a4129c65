"""Diagnostics of a run, evaluated when they are read.

Many runs of one scene are made for their numbers only. Therefore recorded rows are
stored, as far as they are few, and evaluated together.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, without
from sidtool.formats.result import FlexibleBody
from sidtool.formats.text import counted_noun

from ..initial_state import assembly
from ..initial_state.assembly import assemble, row_names
from ..initial_state.displacement_report import displacement_notes
from ..initial_state.initial_friction import with_prescribed_friction
from ..output.columns import RecordedOutputs
from ..output.dense_output import StepEndStates, StepStates
from ..output.samples import Samples
from ..spatial import system_arrays as at
from ..system.body_data import BodyData
from ..system.system import System
from ..system.work_arrays import new_work_arrays
from .basis_coverage import unrepresented_loads
from .body_loads import LoadExtrema, expected_bodies
from .checks import check_attachments
from .implausible_values import implausible_value_warnings
from .light_links import refuse_light_links
from .result_notes import OutputNotes, callable_notes
from .vibration import Vibrations

#: Numbers of frames, markers and states that may wait.
MAX_PENDING_NUMBERS = 100_000

#: Relative size below which stiffening at markers counts as zero.
_NEGLIGIBLE = 1e-6
QUADRATIC_INERTIA = "quadratic inertia"
#: Terms beyond those of the undeformed body, by the bits of their flags.
_TERMS = {
    at.HAS_CR1: "Cr1, Ge1",
    at.HAS_OE1: "Oe1",
    at.HAS_CT1: "Ct1",
    at.HAS_KE1: "Ke1",
    at.HAS_QUADRATIC_J: QUADRATIC_INERTIA,
}
#: Terms that the inertia of a stiffened body always has, in mean axes.
_STIFFENED_TERMS = at.HAS_CR1 | at.HAS_OE1 | at.HAS_CT1 | at.HAS_QUADRATIC_J
_FRAMES = {0: "prescribed", 2: "2", 3: "3", 6: "6"}


class DiagnosticsResult(NamedTuple):
    """What flexible bodies met, vibrations, and states not to be missed."""

    load_extrema: LoadExtrema
    vibrations: Vibrations
    step_end_states: StepEndStates


class RunDiagnostics:
    """Findings from rows and ends of steps of a run.

    Attributes
    ----------
    expect
        What was said of flexible bodies before it.
    output_notes
        Of the recorded rows, which do not wait.
    """

    def __init__(
        self, system: System, expect: Callable[[], Mapping[str, FlexibleBody]]
    ) -> None:
        self._system, self._expect = system, expect
        self.output_notes = OutputNotes(system)
        self._waiting: list[Callable[[], None]] = []
        self._numbers = 0

    @property
    def has_pending(self) -> bool:
        """True if what is added may be kept for later."""
        return self._numbers <= MAX_PENDING_NUMBERS

    def add(self, recorded: RecordedOutputs, t: Array) -> None:
        """Recorded rows."""
        samples = recorded.samples
        self.output_notes.add(t, recorded)

        def process() -> None:
            self._found.vibrations.add(samples)
            self._found.load_extrema.add(samples, t)

        self._defer(process, samples.frames.size + samples.points.size)

    def add_previous_rows(self, samples: Samples, t: Array) -> None:
        """Rows that a run before this one recorded."""
        self._defer(
            lambda: self._found.load_extrema.add(samples, t), samples.frames.size
        )

    def add_step_ends(self, ends: StepStates) -> None:
        """Ends of some steps."""
        self._defer(
            lambda: self._found.step_end_states.add(ends), ends.z.size + ends.v.size
        )

    def continue_after(self, times: Array, z: Array) -> None:
        """Rows and ends of steps in the order of time."""
        self._defer(lambda: self._found.load_extrema.start_after(times, z), z.size)

    def _defer(self, process: Callable[[], None], numbers: int) -> None:
        self._numbers += numbers
        if self.has_pending:
            self._waiting.append(process)
        else:
            self._process_pending()
            process()

    def _process_pending(self) -> None:
        waiting, self._waiting = self._waiting, []
        for process in waiting:
            process()

    @property
    def found(self) -> DiagnosticsResult:
        """What there is, of all that was added."""
        self._process_pending()
        return self._found

    @cached_property
    def _found(self) -> DiagnosticsResult:
        system, expected = self._system, self._expect()
        worst = np.array([body.expected.time for body in expected.values()])
        return DiagnosticsResult(
            LoadExtrema(system, expected),
            Vibrations(system),
            StepEndStates(system, worst),
        )


@dataclass(frozen=True, eq=False)
class InitialisedSystem:
    """A system at its start.

    Attributes
    ----------
    compiled
        The system as it was compiled.
    system
        With redundant constraints marked.
    start
        Positions and velocities that meet the constraints.
    """

    compiled: System
    system: System
    start: assembly.StateVectors

    @cached_property
    def implausible_inputs(self) -> tuple[Diagnostic, ...]:
        """Diagnostics for the author of the scene."""
        return (
            *implausible_value_warnings(self.compiled),
            *unrepresented_loads(self.system, self.start),
        )

    @cached_property
    def expected_bodies(self) -> Mapping[str, FlexibleBody]:
        """What is expected of each flexible body, by name."""
        return expected_bodies(self.system, self.start)


def initialise(system: System) -> InitialisedSystem:
    """Find a start; for `System.cached`, as nothing here depends on a run.

    Raises
    ------
    InputError
        No start position meets the constraints, friction that the joints do not
        determine, or a link whose inertia rounding hides.
    """
    assembled, start = _assemble_with_warnings(system)
    refuse_light_links(assembled, start)
    return InitialisedSystem(system, with_prescribed_friction(assembled, start), start)


def _assemble_with_warnings(system: System) -> tuple[System, assembly.StateVectors]:
    """An error that numbers in other units may explain ends with the questions."""
    try:
        return assembly.assemble(system)
    except InputError as error:
        warnings = tuple(implausible_value_warnings(system))
        if not warnings:
            raise
        problem = "; ".join((error.problem, *(w.message_line for w in warnings)))
        raise InputError(problem, place=error.place, expected=error.expected) from None


class BodyEquations(NamedTuple):
    """What is integrated of a body.

    Attributes
    ----------
    name
    frame
        Its coordinates.
    elastic
        Number of elastic coordinates.
    terms
        Of a flexible body, terms beyond those of the undeformed one: "yes" if its
        equations have them, "off" if the scene omits them, "-" if the SID has none.
    stiffened
        Markers whose forces or moments stiffen it.
    expected
        Its frequencies, excitation and stiffening before the run, if it is flexible.
    """

    name: str
    frame: str
    elastic: int
    terms: dict[str, str]
    stiffened: tuple[str, ...]
    expected: FlexibleBody | None


def describe_bodies(system: System) -> list[BodyEquations]:
    """Describe what is integrated of each body.

    Raises
    ------
    InputError
        No start position meets the constraints.
    """
    system, start = assemble(system)
    expected = expected_bodies(system, start)
    found = []
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        if not data.is_scene_body:
            continue
        flags, terms = int(row[at.FLAGS]), dict[str, str]()
        if row[at.NQ]:
            if flags & at.STIFFENED:
                flags |= _STIFFENED_TERMS
            body = system.scene.bodies[data.name]
            off = {at.HAS_QUADRATIC_J}
            if not getattr(body, "geometric_stiffening", True):
                off.add(at.HAS_CT1)
            terms = {
                text: "yes" if flags & bit else "off" if bit in off else "-"
                for bit, text in _TERMS.items()
            }
        found.append(
            BodyEquations(
                data.name,
                _FRAMES[int(row[at.RD])],
                int(row[at.NQ]),
                terms,
                _stiffening_markers(system, data) if terms else (),
                expected.get(data.name),
            )
        )
    return found


def describe(system: System) -> list[str]:
    """Lines that describe what is integrated, without those of each body.

    Raises
    ------
    InputError
        No start position meets the constraints.
    """
    compiled = system
    system, start = assemble(compiled)
    lines = [_degrees_of_freedom(system), _total_mass(system)]
    lines += [
        f"body {data.name}: {text}"
        for data in system.bodies
        if data.is_scene_body
        for text in _prestress_texts(data)
    ]
    lines += _defect_lines(system)
    least = system.scene.accuracy.rtol
    warnings = (
        *implausible_value_warnings(compiled),
        *unrepresented_loads(system, start),
        *displacement_notes(system, new_work_arrays(system), start, least),
    )
    lines += [each.line for each in without(warnings, system.scene.diagnostics.ignore)]
    frames: dict[str, list[str]] = {}
    for name, of in system.eliminated.items():
        frames.setdefault(of, []).append(name)
    if frames:
        listed = ", ".join(f"{of} ({', '.join(n)})" for of, n in frames.items())
        lines.append(f"frames that joints and drives prescribe: {listed}")
    if system.redundant:
        names = ", ".join(dict.fromkeys(row_names(system, system.redundant)))
        count = counted_noun(len(system.redundant), "redundant constraint")
        lines.append(
            f"{count} ({names}): met by the others; of "
            "all multipliers that hold the mechanism the smallest are reported"
        )
    return [*lines, *(each.line for each in callable_notes(system))]


def _degrees_of_freedom(system: System) -> str:
    """What joints and drives leave free at the start, by counting (Gruebler).

    States of laws are no degrees of freedom, and redundant constraints hold nothing.
    """
    pairs = list(zip(system.arrays.body, system.bodies, strict=True))
    free = sum(int(row[at.NV]) for row, data in pairs if data.is_scene_body)
    elastic = sum(int(row[at.NQ]) for row, data in pairs if data.is_scene_body)
    redundant = len({*system.redundant, *system.inactive_rows})
    freedom = free - (system.n_rows - redundant)
    return (
        f"degrees of freedom: {freedom}, of "
        f"{counted_noun(free, 'velocity coordinate')} ({elastic} elastic), "
        f"{counted_noun(system.n_rows, 'constraint')} and "
        f"{counted_noun(redundant, 'redundancy')}"
    )


def _total_mass(system: System) -> str:
    mass = sum(data.sid.mass for data in system.bodies if data.is_scene_body)
    return f"total mass: {mass:.6g} kg"


def _stiffening_markers(system: System, data: BodyData) -> tuple[str, ...]:
    """Markers that are used and whose forces or moments stiffen the body."""
    sizes = {
        (marker, entry): np.abs(getattr(data.node(marker), entry).m1).max(initial=0.0)
        for marker in [m for body, m in system.markers if body == data.name]
        for entry in ("phi", "psi")
        if getattr(data.node(marker), entry).m1 is not None
    }
    least = _NEGLIGIBLE * max(sizes.values(), default=0.0)
    return tuple(dict.fromkeys(m for (m, _), size in sizes.items() if size > least))


def _prestress_texts(data: BodyData) -> list[str]:
    """What a body under initial stress needs of the scene, and must not hold itself."""
    if not data.sid.ksigma.m0.any():
        return []
    return [
        "prestressed (ksigma), undeformed under the loads of its "
        "prestress only; what these stiffen at markers must not be in its Ke as well"
    ]


def _defect_lines(system: System) -> list[str]:
    """What `compile_scene` would refuse unless told to accept it."""
    try:
        check_attachments(system)
    except InputError as error:
        return [f"{error.problem} (--accept-defects)"]
    return []
