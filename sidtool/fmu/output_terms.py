"""Outputs as polynomials in the arrays of the plant.

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
from sidtool.formats.scene import INPUTS, is_section_force, parse_output
from sidtool.formats.scene.outputs import (
    INSTANTANEOUS,
    ORIENTATIONS,
    SCENE_QUANTITIES,
)
from sidtool.solver.output.body_outputs import SceneOutputs
from sidtool.solver.output.columns import output_column
from sidtool.solver.output.samples import EvaluatedForces, Samples
from sidtool.solver.spatial.dimension import FRAMES, POINTS
from sidtool.solver.system.system import System

from .plant_table import PlantTables

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
