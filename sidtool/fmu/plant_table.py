"""All tables and arrays of a unit as one table, the plant.

C sees the same table as a structure (`c_source`). A copy of it, with all that it
refers to, is an instance of the unit (`c_source`).

Outputs as polynomials in the arrays of the plant.

What an output is, is written once, in `sidtool.solver.output.columns`, as a function
of many states at once. Its coefficients are found by evaluating that function where one
or two entries of the arrays are not zero. An output is offered if it is a polynomial of
at most the second degree, or the square root of one:

    y = c + sum_i a_i x_i + sum_ij b_ij x_i x_j

At random states the polynomial has to agree with the function. Orientations are no
polynomials: C evaluates quaternions and rotation vectors of the entries of a rotation
matrix, or of the angle in the plane.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    INPUTS,
    Event,
    SceneFile,
    is_section_force,
    parse_output,
)
from sidtool.formats.scene.outputs import INSTANTANEOUS, ORIENTATIONS, SCENE_QUANTITIES
from sidtool.solver.compiler.tables import Table, TableType
from sidtool.solver.initial_state.integrator_start import RunSettings
from sidtool.solver.initial_state.overconstraint import restore_constraints
from sidtool.solver.integrators import output_sampling, radau_stages
from sidtool.solver.integrators.loop_state import StepLoopState
from sidtool.solver.integrators.radau_stages import RadauStages
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.linear.factor_storage import Kernels, Memory
from sidtool.solver.output.body_outputs import SceneOutputs
from sidtool.solver.output.columns import output_column
from sidtool.solver.output.samples import (
    EvaluatedForces,
    Samples,
    StateSampler,
    new_output_arrays,
    output_work,
)
from sidtool.solver.simulation.preparation import (
    RunStart,
    allocate,
    plan_whole_steps,
    prepare_run,
)
from sidtool.solver.spatial.dimension import FRAMES, POINTS
from sidtool.solver.spatial.system_arrays import (
    Integers2,
    OutputArrays,
    Reals,
    Reals2,
    Reals3,
    SystemArrays,
    WorkArrays,
)
from sidtool.solver.system.system import System


class Plant(Table):
    """State of an instance, and what it calls kernels with.

    Attributes
    ----------
    now
        Communication point: time of the outputs [s].
    interval_start, interval_end
        Smooth interval of the step at hand [s]; a new one begins at each break.
    last_sample_time
        Time at which sampled laws were asked last [s].
    must_restart
        1 if the step loop has to begin anew at `now`, as an input jumped.
    outputs_known
        1 if the arrays from `frames` on belong to `now`.
    kernels, system, work, memory, control, stages
        Arguments of the step loop, see `sidtool.solver.integrators`.
    sampler_work, sampler_memory
        What `sample` writes beside its outputs.
    output_system, output_work, output
        Arguments of the kernels of forces and energies.
    constraint_tolerance, interval, time, interval_time, step_z, step_v, row_blocks
    row_sizes, multiplier_sizes, largest_multiplier
        Arguments of `sample` and of the kernels of forces.
    z, v, frames, points, accelerations, multipliers, factors, friction
        State at `now` and what follows from it, see `Samples`.
    friction_forces
        Forces along coordinates with friction.
    input_goals, input_values
        Values that inputs were set to, and those at `now`.
    ending_event
        1 and the number of the event that has ended the motion, or 0.
    event_sides, event_sizes, event_counts
        Of events that end the motion: 1 above the value and -1 below, largest magnitude
        of the quantity, and how often it crossed the value.
    """

    now: float
    interval_start: float
    interval_end: float
    last_sample_time: float
    must_restart: int
    outputs_known: int
    ending_event: int
    kernels: Kernels
    system: SystemArrays
    work: WorkArrays
    memory: Memory
    control: StepLoopState
    stages: RadauStages
    sampler_work: WorkArrays
    sampler_memory: Memory
    output_system: SystemArrays
    output_work: WorkArrays
    output: OutputArrays
    constraint_tolerance: Reals2
    interval: Reals
    time: Reals
    interval_time: Reals
    step_z: Reals2
    step_v: Reals2
    z: Reals2
    v: Reals2
    frames: Reals3
    points: Reals3
    accelerations: Reals2
    multipliers: Reals2
    factors: Reals2
    friction: Reals3
    friction_forces: Reals2
    row_blocks: Integers2
    row_sizes: Reals
    multiplier_sizes: Reals
    largest_multiplier: Reals
    input_goals: Reals
    input_values: Reals
    event_sides: Reals
    event_sizes: Reals
    event_counts: Reals


PLANT = TableType(Plant)


@dataclass(frozen=True, eq=False)
class PlantTables:
    """The plant of a scene at its start.

    Attributes
    ----------
    start : settings and initial state
    system : the system that is integrated
    output_system : the same with all constraints, whose forces are reported
    """

    start: RunStart
    system: System
    output_system: System
    plant: Plant


def ending_events(scene: SceneFile) -> dict[str, Event]:
    """Events that end the motion, by name."""
    events = scene.events.items()
    return {name: event for name, event in events if event.action == "stop"}


def plant_tables(system: System, settings: RunSettings) -> PlantTables:
    """Allocate the tables of a unit, at the initial state of its scene.

    Raises
    ------
    InputError : no initial state meets the constraints.
    """
    start = prepare_run(system, settings, (), None)
    method, system = INTEGRATORS[settings.integrator], start.system
    n, m = system.n_positions, system.n_velocities
    run = allocate(start, plan_whole_steps(start), np.zeros(0))
    control = run.control
    sampler = StateSampler(system, start.tolerances)
    full = restore_constraints(system)
    frame, point = sampler.work.frame.shape, sampler.work.point.shape
    n_friction = len(system.friction_joints)
    arrays = {
        "interval": (2,),
        "time": (1,),
        "interval_time": (1,),
        "step_z": (1, n),
        "step_v": (3, m),
        "z": (1, n),
        "v": (1, m),
        "frames": (1, *frame),
        "points": (1, *point),
        "accelerations": (1, m),
        "multipliers": (1, system.n_rows),
        "factors": (1, len(system.forces)),
        "friction": (1, n_friction, output_sampling.N_FRICTION_OUTPUT),
        "friction_forces": (1, n_friction),
        "row_sizes": (system.n_rows,),
        "multiplier_sizes": (1,),
        "largest_multiplier": (1,),
        "input_goals": (len(system.scene.inputs),),
        "input_values": (len(system.scene.inputs),),
    }
    n_events = len(ending_events(system.scene))
    arrays |= {
        "event_sides": (n_events,),
        "event_sizes": (n_events,),
        "event_counts": (n_events,),
    }
    plant = Plant(
        now=control.time,
        interval_start=control.time,
        interval_end=system.breaks[0],
        last_sample_time=-np.inf,
        must_restart=1,
        kernels=run.kernels,
        system=system.arrays,
        work=run.work,
        memory=run.memory,
        control=control,
        stages=system.cached_by_topology(
            radau_stages.stages_maker, method.dense_degree
        )(),
        sampler_work=sampler.work,
        sampler_memory=sampler.memory,
        output_system=full.output_rows,
        output_work=output_work(full, sampler.work),
        output=new_output_arrays(full, 1),
        constraint_tolerance=np.ascontiguousarray(start.tolerances),
        row_blocks=np.zeros((2, system.n_rows), np.int64),
        **{name: np.zeros(shape) for name, shape in arrays.items()},
    )
    initial = [signal.initial for signal in system.scene.inputs.values()]
    plant.event_sizes[:] = [abs(e.value) for e in ending_events(system.scene).values()]
    plant.input_goals[:] = plant.input_values[:] = initial
    return PlantTables(start, system, full, plant)


#: Numbers of states that are evaluated together.
NUMBERS_AT_ONCE = 4_000_000
#: Entries beyond which products are not looked for.
MAX_FACTORS = 80
#: Agreement with the function, relative to the sum of the magnitudes of all terms.
AGREEMENT = 1e-12
N_RANDOM_STATES = 4

#: Kinds of outputs, see `OutputTerms`; the components of an orientation follow.
POLYNOMIAL, ROOT, ORIENTATION = range(3)

Function = Callable[[Array], Array]


class Term(NamedTuple):
    """A coefficient times one entry of the arrays, or times two.

    Attributes
    ----------
    first, second : (array, index) of the entries; `second` is None for a linear term
    """

    weight: float
    first: tuple[str, int]
    second: tuple[str, int] | None


@dataclass(frozen=True)
class OutputTerms:
    """An output as a polynomial, or what follows from one.

    Attributes
    ----------
    kind : POLYNOMIAL, ROOT (its square root) or ORIENTATION and a component: the four
        of the quaternion, the three of the rotation vector, the angle of the rotation.
        The terms of an orientation are the entries of its matrix by rows, in the plane
        its angle
    """

    name: str
    constant: float
    terms: tuple[Term, ...]
    kind: int = 0


class _Polynomial(NamedTuple):
    constant: float
    linear: dict[int, float]
    quadratic: dict[tuple[int, int], float]

    def values(self, x: Array) -> tuple[Array, Array]:
        """Values (nt,) at states (nt, n), and the sum of the magnitudes of terms."""
        parts = [np.full(len(x), self.constant)]
        parts += [weight * x[:, i] for i, weight in self.linear.items()]
        parts += [
            weight * x[:, i] * x[:, j] for (i, j), weight in self.quadratic.items()
        ]
        return np.sum(parts, axis=0), np.sum(np.abs(parts), axis=0)

    def agrees(self, function: Function, n: int) -> bool:
        """True if a function of n entries has these values at random states."""
        x = np.random.default_rng(1).uniform(-1.0, 1.0, (N_RANDOM_STATES, n))
        values, size = self.values(x)
        error = np.abs(function(x) - values)
        return bool((error <= AGREEMENT * np.maximum(size, 1e-300)).all())


class _ArrayEntries:
    """All entries of the arrays that outputs are made of, one behind the other."""

    def __init__(self, tables: PlantTables) -> None:
        plant, self.tables = tables.plant, tables
        self.shapes = {
            name: getattr(plant, name).shape[1:]
            for name in ("z", "v", "frames", "points", "accelerations", "multipliers")
            + ("factors", "friction")
        }
        for name in ("wrench", "force", "body"):
            self.shapes[name] = getattr(plant.output, name).shape
        sizes = [math.prod(shape) for shape in self.shapes.values()]
        self.ends = np.cumsum(sizes)
        self.count = int(self.ends[-1])

    def location(self, k: int) -> tuple[str, int]:
        """Array and index of entry k."""
        part = int(np.searchsorted(self.ends, k, side="right"))
        start = int(self.ends[part - 1]) if part else 0
        return list(self.shapes)[part], k - start

    def function(self, name: str) -> Function:
        """An output as a function of states (nt, count), (nt,)."""
        return lambda x: self.columns(x, (name,))[:, 0]

    def columns(self, x: Array, names: Iterable[str]) -> Array:
        """Outputs at states (nt, count), (nt, outputs)."""
        rows = max(1, NUMBERS_AT_ONCE // self.count)
        blocks = (x[first : first + rows] for first in range(0, len(x), rows))
        parts = [
            np.column_stack([output_column(quantities, name) for name in names])
            for quantities in map(self._quantities, blocks)
        ]
        return np.concatenate(parts).astype(float)

    def _quantities(self, x: Array) -> SceneOutputs:
        parts = np.split(x, self.ends[:-1], axis=1)
        arrays: dict[str, Any] = {
            key: np.ascontiguousarray(part).reshape(len(x), *shape)
            for (key, shape), part in zip(self.shapes.items(), parts, strict=True)
        }
        output = [arrays.pop(key) for key in ("wrench", "force", "body")]
        samples, system = Samples(**arrays), self.tables.output_system
        evaluated = EvaluatedForces.of_arrays(system, samples, *output)
        work, times = self.tables.plant.sampler_work, np.zeros(len(x))
        return SceneOutputs(system, work, times, samples, None, evaluated)

    def unit_changes(self) -> Iterator[tuple[range, Array]]:
        """States that differ from `random_state` in one entry each, in blocks."""
        rows = max(1, NUMBERS_AT_ONCE // self.count)
        for first in range(0, self.count, rows):
            entries = range(first, min(first + rows, self.count))
            x = np.tile(self.random_state, (len(entries), 1))
            x[np.arange(len(entries)), entries] += 1.0
            yield entries, x

    @property
    def random_state(self) -> Array:
        """Small whole numbers, whose sums and products are exact."""
        return np.random.default_rng(0).integers(1, 9, self.count).astype(float)


def output_terms(tables: PlantTables, names: Iterable[str]) -> tuple[OutputTerms, ...]:
    """The polynomials of some outputs.

    Raises
    ------
    InputError : an output cannot be evaluated in a unit; names it, and why.
    """
    names = tuple(names)
    for name in names:
        _refuse_by_name(name)
    entries = _ArrayEntries(tables)
    known = {name: _orientation(tables, name) for name in names}
    evaluated = [
        name
        for name in names
        if known[name] is None and parse_output(name).owner != INPUTS
    ]
    factors = _entries_of_outputs(entries, evaluated)
    found = []
    for name in names:
        orientation = known[name]
        if orientation is not None:
            found.append(orientation)
            continue
        if name not in factors:
            found.append(_input_output(tables.system, name))
            continue
        found.append(_terms(name, factors[name], entries))
        _refuse_undetermined(found[-1], tables)
    return tuple(found)


def _refuse_by_name(name: str) -> None:
    owner, _, quantity = parsed = parse_output(name)
    if is_section_force(parsed):
        raise InputError(
            f"{name} follows from the equilibrium of a part of the beam, which a unit "
            "does not evaluate",
            place="outputs",
            expected="outputs without it (--outputs)",
        )
    if owner in SCENE_QUANTITIES and quantity not in INSTANTANEOUS:
        if owner == "energy":
            why = "is an integral along the steps, which a unit does not compute"
        else:
            why = "is a residual of the integrator, which a unit does not compute"
        raise InputError(
            f"{name} {why}", place="outputs", expected="outputs without it (--outputs)"
        )


def _entries_of_outputs(
    entries: _ArrayEntries, names: list[str]
) -> dict[str, list[int]]:
    """Entries that each output depends on."""
    found: dict[str, list[int]] = {name: [] for name in names}
    if not names:
        return found
    known = entries.columns(entries.random_state[None], names)
    for block, x in entries.unit_changes():
        changed = entries.columns(x, names) != known
        for name, column in zip(names, changed.T, strict=True):
            found[name] += [block[k] for k in np.flatnonzero(column)]
    return found


def _terms(name: str, factors: list[int], entries: _ArrayEntries) -> OutputTerms:
    """The polynomial of one output that depends on these entries.

    Raises
    ------
    InputError : it is no polynomial, nor the square root of one.
    """
    function = entries.function(name)

    def square(x: Array) -> Array:
        return function(x) ** 2

    for source, kind in ((function, POLYNOMIAL), (square, ROOT)):
        for degree in (1, 2):
            if degree == 2 and len(factors) > MAX_FACTORS:
                continue
            found = _interpolated(source, factors, entries.count, degree)
            if not found.agrees(source, entries.count):
                continue
            where = entries.location
            terms = [Term(w, where(i), None) for i, w in found.linear.items()]
            terms += [
                Term(w, where(i), where(j)) for (i, j), w in found.quadratic.items()
            ]
            return OutputTerms(name, found.constant, tuple(terms), kind)
    raise InputError(
        f"{name} is no polynomial in positions, velocities, accelerations and forces, "
        "and a unit evaluates no other outputs",
        place="outputs",
        expected="outputs without it (--outputs)",
    )


def _orientation(tables: PlantTables, name: str) -> OutputTerms | None:
    """Quaternion, rotation vector or angle of a body or marker; None for the rest."""
    owner, marker, quantity = parse_output(name)
    system = tables.output_system
    components = (*ORIENTATIONS, *(() if system.planar or not marker else ("angle",)))
    if quantity not in components:
        return None
    if marker:
        array, rows = "points", POINTS[system.space]
        row = system.markers[owner, marker]
    else:
        array, rows, row = "frames", FRAMES[system.space], system.index(owner)
    place, count = ("angle", 1) if system.planar else ("R", 9)
    first = row * rows.record.size + rows.record.places[place]
    terms = tuple(Term(1.0, (array, first + k), None) for k in range(count))
    return OutputTerms(name, 0.0, terms, ORIENTATION + components.index(quantity))


def _interpolated(
    function: Function, factors: list[int], n: int, degree: int
) -> _Polynomial:
    """The polynomial in some entries with the values of a function at small states."""
    count = len(factors)
    pairs = list(combinations(range(count), 2)) if degree == 2 else []
    x = np.zeros((1 + 2 * count + len(pairs), n))
    for k, i in enumerate(factors):
        x[1 + k, i], x[1 + count + k, i] = 1.0, -1.0
    for row, (k, m) in enumerate(pairs, 1 + 2 * count):
        x[row, factors[k]] = x[row, factors[m]] = 1.0
    y = function(x)
    constant, plus, minus = y[0], y[1 : 1 + count], y[1 + count : 1 + 2 * count]
    linear, square = 0.5 * (plus - minus), 0.5 * (plus + minus) - constant
    products = {}
    if degree == 2:
        products = {(factors[k], factors[k]): square[k] for k in range(count)}
        for (k, m), value in zip(pairs, y[1 + 2 * count :], strict=True):
            products[factors[k], factors[m]] = value - plus[k] - plus[m] + constant
    return _Polynomial(
        float(constant),
        {i: float(a) for i, a in zip(factors, linear, strict=True) if a},
        {pair: float(b) for pair, b in products.items() if b},
    )


def _refuse_undetermined(found: OutputTerms, tables: PlantTables) -> None:
    """Refuse forces of joints that the motion does not determine.

    Raises
    ------
    InputError : the output depends on forces of redundant constraints.
    """
    if not tables.system.redundant:
        return
    constraints = len(tables.output_system.arrays.constraint)
    width = tables.plant.output.wrench.shape[1]
    for term in found.terms:
        for location in (term.first, term.second):
            if location is None:
                continue
            array, index = location
            if array == "multipliers" or (
                array == "wrench" and index < constraints * width
            ):
                raise InputError(
                    f"{found.name} is a force in redundant constraints, which a unit "
                    "does not determine",
                    place="outputs",
                    expected="joints without redundant constraints, or outputs "
                    "without it (--outputs)",
                )


def _input_output(system: System, name: str) -> OutputTerms:
    """The value of an input at the communication point."""
    index = list(system.scene.inputs).index(parse_output(name).quantity)
    return OutputTerms(name, 0.0, (Term(1.0, ("input_values", index), None),))
