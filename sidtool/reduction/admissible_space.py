"""Admissible displacements of a body with fixed and rigid parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from sidtool.formats.base.complex_step import null_space_with_step
from sidtool.formats.base.errors import InputError, TooManyModes
from sidtool.formats.base.extremes import first_largest
from sidtool.formats.base.sid import Array

from ..eigensolvers.eigenpairs import (
    equal_frequencies,
    free_body_shift,
    lowest_eigenpairs,
    rotation_to_axes,
    symmetric_factors,
)
from ..eigensolvers.factorisation import Factors, begin_stage, engine_name
from ..eigensolvers.lanczos import ACCURATE, BLOCK_SIZE, Accuracy
from ..eigensolvers.multigrid import MultigridFactors, NodalUnknowns
from ..eigensolvers.projected_matrix import ProjectedMatrix, SymmetricMatrix
from ..elements.finite_element_model import FiniteElementModel
from ..elements.mortar_ties import elimination_matrix
from ..mesh.reference_elements import element_edges
from .body_frames import Frame, clamped_dofs, motion_rows

_NO_MOTION = 1e-9
#: Loads that differ by less, relative to their largest, are the same.
_SAME = 4 * np.finfo(float).eps
#: Of modes that frequencies are compared with: errors of frequencies are half of those
#: of eigenvalues, and errors below 1e-8 are not printed.
_COMPARISON = Accuracy(value_error=1e-8)


@dataclass(frozen=True, eq=False)
class AdmissibleSpace:
    """Admissible displacements u = transform @ y with constraints @ y = 0.

    Attributes
    ----------
    transform : (ndof, n) sparse
    stiffness, mass : (n, n)
    constraints : (k, n) further conditions, of fixed or interface markers
    rigid : (n, r) the rigid motions that are admissible
    constrained_rigid_motions : (n, s) the rigid motions that only the constraints
        prevent
    shift : function that returns a negative number below which K - shift M is positive
        definite [1/s^2]
    places : (n, d) position of each y, for the elimination order
    directions : (ndof,) directions of the degrees of freedom of the model
    factors : factors of the stiffness, shared with spaces with further constraints
    accuracy : of modes
    """

    transform: sp.csr_matrix
    stiffness: SymmetricMatrix
    mass: SymmetricMatrix
    constraints: Array
    rigid: Array
    constrained_rigid_motions: Array
    shift: Callable[[], float]
    places: Array
    directions: Array
    factors: PinnedFactors
    accuracy: Accuracy = ACCURATE

    def for_comparison(self) -> AdmissibleSpace:
        """The same space for frequencies to compare with: modes that are not known yet
        are computed less exactly, in fewer solutions.
        """
        return self if self._found else replace(self, accuracy=_COMPARISON)

    def loads(self, loads: Array) -> Array:
        """Loads (ndof, n) on the model as loads on y."""
        return self.transform.T @ loads

    def displacements(self, y: Array) -> Array:
        """y as displacements of the model, (ndof, n)."""
        return self.transform @ y

    def effective_loads(self, loads: Array) -> NDArray[np.bool_]:
        """Return a mask (n,) of loads (ndof, n) that do not act on supports only. The
        response to a load on supports alone, or to a load of rounding size, is
        rounding.
        """
        rest = self.loads(loads)
        possible = np.linalg.norm(abs(self.transform).T @ np.abs(loads), axis=0)
        if len(self.constraints):
            held = np.linalg.qr(self.constraints.T)[0]
            for _ in range(2):
                rest = rest - held @ (held.T @ rest)
        return np.linalg.norm(rest, axis=0) > _NO_MOTION * possible

    def with_constraints(self, rows: Array) -> AdmissibleSpace:
        """Return the space with further conditions ``rows @ u = 0``, rows (k, ndof)."""
        more = np.asarray((self.transform.T @ rows.T).T)
        constraints = np.vstack([self.constraints, more])
        largest = (np.abs(more) @ np.abs(self.rigid)).max(axis=0, initial=0.0)
        left, stopped = _null_and_range(more @ self.rigid, largest)
        return replace(
            self,
            constraints=independent_rows(constraints),
            rigid=self.rigid @ left,
            constrained_rigid_motions=np.hstack(
                [self.constrained_rigid_motions, self.rigid @ stopped]
            ),
        )

    def modes(self, count: int, soon: int = 0) -> tuple[Array, Array]:
        """Return the lowest elastic modes: eigenvalues and displacements (ndof, count).

        Rigid motions are excluded. Of equal frequencies, whose modes are arbitrary
        combinations, the modes are those along the axes if there are any, x before y
        before z: the two bending modes of a square bar.

        Parameters
        ----------
        soon : number of modes that will be requested later; they are computed together

        Raises
        ------
        TooManyModes : the space has fewer modes.
        """
        skipped = self.rigid.shape[1]
        available = self.stiffness.shape[0] - len(self.constraints) - skipped
        if count > available:
            error = TooManyModes(
                f"{count} modes of a model with {available} free degrees of freedom",
                place="reduction.modes",
                expected=f"at most {available}",
            )
            error.available = available
            raise error
        if count == 0:
            return np.zeros(0), np.zeros((self.transform.shape[0], 0))
        size = max(count, soon)
        while not self._found or count > self._found[0][2]:
            size = min(size + 1, available)
            self._found[:] = [self._lowest_modes(size, size == available)]
            size += BLOCK_SIZE
        values, shapes, _ = self._found[0]
        return values[:count], shapes[:, :count]

    @cached_property
    def _found(self) -> list[tuple[Array, Array, int]]:
        """Return the modes of the last request."""
        return []

    def _lowest_modes(self, count: int, all_of_them: bool) -> tuple[Array, Array, int]:
        """Eigenvalues, displacements, and how many modes form whole groups.

        The last group of equal frequencies may be incomplete: its modes could be
        combined with modes that are not known.
        """
        skipped = self.rigid.shape[1]
        try:
            values, vectors = lowest_eigenpairs(
                self.stiffness,
                self.mass,
                count + skipped,
                shift=self.shift if skipped or len(self.constraints) else 0.0,
                constraints=self.constraints,
                rigid=self.rigid,
                static=lambda load: self._static.solve(load),
                accuracy=replace(self.accuracy, next_is_distinct=not all_of_them),
                multigrid=self._multigrid,
            )
        except InputError:
            self.shift()  # its error may name the cause
            raise
        values, vectors = values[skipped:], vectors[:, skipped:]
        groups = equal_frequencies(values, vectors, self.stiffness)
        shapes = self.displacements(vectors)
        shapes = shapes @ rotation_to_axes(groups, shapes, self.directions)
        return values, shapes, count if all_of_them else int(groups[-1][0])

    @property
    def _multigrid(self) -> tuple[MultigridFactors, Array] | None:
        levels = self.factors.multigrid
        return None if levels is None else (levels, self._static.reactions)

    def static(self, loads: Array, motions: Array | None = None) -> Array:
        """Static displacements (ndof, n) under loads (ndof, n).

        A body that can move rigidly is accelerated by the loads: they are balanced by
        the inertia of that motion, and the displacement is M-orthogonal to it
        (inertia relief).

        Parameters
        ----------
        motions : (k, n) values of the constraints instead of zero
        """
        begin_stage(f"static responses: {loads.shape[1]}", len(loads))
        solver = self._static
        respond = self.factors.static_responses
        return self.displacements(solver.solve(self.loads(loads), motions, respond))

    @cached_property
    def _static(self) -> _StaticSolver:
        return _StaticSolver(self)


class PinnedFactors:
    """Factors of K with springs against its rigid motions, computed on first use.

    The number of springs equals that of rigid motions, so balanced loads do not strain
    them.
    """

    #: (n, k) loads of the last conditions and the responses to them.
    _known: tuple[Array, Array] | None = None

    def __init__(
        self,
        stiffness: ProjectedMatrix,
        rigid: Array,
        places: Array,
        nodal: Callable[[], NodalUnknowns],
    ) -> None:
        """`nodal` is called only for multigrid."""
        self._stiffness, self._rigid, self._places = stiffness, rigid, places
        self._nodal = nodal

    def solve(self, load: Array) -> Array:
        """(K + springs)^-1 b for b (n, k)."""
        return self._factors.solve(np.ascontiguousarray(load))

    def condition_responses(self, rows: Array) -> Array:
        """(n, k) responses to rows (k, n) of conditions, which are kept."""
        found = self.solve(rows.T)
        if np.isrealobj(found):
            self._known = rows.T, found
        return found

    def static_responses(self, loads: Array) -> Array:
        """As `solve` for loads (n, k); loads of the last conditions, as those at
        interfaces, need no further solution.
        """
        if self._known is None or np.iscomplexobj(loads):
            return self.solve(loads)
        conditions, responses = self._known
        source, share = _multiples(loads, conditions)
        is_new = source < 0
        if is_new.all():
            return self.solve(loads)
        answer = responses[:, source] * share
        if is_new.any():
            answer[:, is_new] = self.solve(loads[:, is_new])
        return answer

    @property
    def multigrid(self) -> MultigridFactors | None:
        """The factors if they are none, but levels of multigrid."""
        if engine_name() != "multigrid":
            return None
        return self._factors if isinstance(self._factors, MultigridFactors) else None

    @cached_property
    def _factors(self) -> Factors:
        matrix = _PinnedMatrix(self._stiffness, self._rigid)
        nodal = self._nodal() if engine_name() == "multigrid" else None
        return symmetric_factors(matrix, self._places, nodal)


class _PinnedMatrix:
    """K with springs, see `projected_matrix.Assembled`."""

    def __init__(self, stiffness: ProjectedMatrix, rigid: Array) -> None:
        self._stiffness, self._rigid = stiffness, rigid
        self.shape = stiffness.shape

    def tocsr(self) -> sp.csr_matrix:
        stiffness = self._stiffness.tocsr()
        if self._rigid.shape[1]:
            stiff = float(abs(stiffness.diagonal()).mean())
            stiffness = stiffness + stiff * sp.diags_array(_support_mask(self._rigid))
        return sp.csr_matrix(stiffness)


class _StaticSolver:
    """Static responses of a space from the factors A of its body without constraints.

    With constraints C, their multipliers l and the rigid motions R that they prevent,
    ``u = A^-1 (f - C^T l) + R a`` solves ``K u + C^T l = f`` where the constraints
    balance the loads, ``R^T (f - C^T l) = 0``: nothing then pulls at the springs in A.

    Attributes
    ----------
    reactions : (n, k) A^-1 C^T
    """

    def __init__(self, space: AdmissibleSpace) -> None:
        """Keep no reference to the space, which keeps the solver: they would hold the
        factors until the garbage collector runs.
        """
        self._respond, self._rigid = space.factors.solve, space.rigid
        self._rows = rows = space.constraints
        stopped = space.constrained_rigid_motions
        self._inertia = space.mass @ space.rigid
        self._gram = space.rigid.T @ self._inertia
        self.reactions = np.zeros((rows.shape[1], 0))
        if len(rows):
            self.reactions = space.factors.condition_responses(rows)
        flexibility = rows @ self.reactions
        moved = rows @ stopped
        scale = np.linalg.norm(flexibility) / np.linalg.norm(moved, axis=0)
        self._stopped = stopped * scale
        moved = moved * scale
        none = np.zeros((stopped.shape[1],) * 2)
        self._bordered = np.block([[flexibility, -moved], [-moved.T, none]])

    def solve(
        self,
        loads: Array,
        motions: Array | None = None,
        respond: Callable[[Array], Array] | None = None,
    ) -> Array:
        """Static responses to loads (n, m) and motions (k, m) of the constraints.

        Parameters
        ----------
        respond : b -> A^-1 b, in place of a solution of every load
        """
        rigid, rows, respond = self._rigid, self._rows, respond or self._respond
        if rigid.shape[1]:
            balance = np.linalg.solve(self._gram, rigid.T @ loads)
            loads = loads - self._inertia @ balance
        y = respond(loads) if loads.any() else np.zeros_like(loads)
        if len(rows):
            gap = rows @ y - (0.0 if motions is None else motions)
            pull = -self._stopped.T @ loads
            both = np.linalg.solve(self._bordered, np.vstack([gap, pull]))
            y = y - self.reactions @ both[: len(rows)]
            y = y + self._stopped @ both[len(rows) :]
        if rigid.shape[1]:
            y = y - rigid @ np.linalg.solve(self._gram, self._inertia.T @ y)
        return y


def _multiples(loads: Array, known: Array) -> tuple[NDArray[np.int64], Array]:
    """For every load (n, m) the number of the known load (n, k) that it is a multiple
    of but for rounding, -1 for none, and the multiple.
    """
    source, share = np.full(loads.shape[1], -1), np.zeros(loads.shape[1])
    for column, load in enumerate(loads.T):
        first = first_largest(np.abs(load))
        for number, other in enumerate(known.T):
            if other[first]:
                multiple = load[first] / other[first]
                if np.abs(load - multiple * other).max() <= _SAME * abs(load[first]):
                    source[column], share[column] = number, multiple
    return source, share


def constrained_space(
    model: FiniteElementModel, frame: Frame, fixed: tuple[str, ...] = ()
) -> AdmissibleSpace:
    """Return the space of displacements allowed by frame, rigid ties and supports.

    Parameters
    ----------
    fixed : edges, node sets and markers that are fixed

    Raises
    ------
    InputError : no displacement is left, or a rigid piece is fixed in part.
    """
    space = space_without_conditions(model, clamped_dofs(model, frame, fixed), frame)
    rows = support_rows(model, frame, fixed)
    return space if rows is None else space.with_constraints(rows)


def space_without_conditions(
    model: FiniteElementModel, held: NDArray[np.bool_], frame: Frame
) -> AdmissibleSpace:
    """Return the space of displacements with clamped degrees of freedom and ties.

    Raises
    ------
    InputError : no displacement is left, or a rigid piece is fixed in part.
    """
    parts = reduced_matrices(model, held, frame)
    places = model.coordinate_positions(parts["transform"])

    @cache
    def shift() -> float:
        return free_body_shift(
            model.stiffness, model.mass, model.positions, model.place_table
        )

    factors = PinnedFactors(
        parts["stiffness"],
        parts["rigid"],
        places,
        partial(_nodal_unknowns, parts["transform"], model, frame),
    )
    return AdmissibleSpace(**parts, shift=shift, places=places, factors=factors)


def _nodal_unknowns(
    transform: sp.csr_matrix, model: FiniteElementModel, frame: Frame
) -> NodalUnknowns:
    """Return the displacements that the unknowns are, and how they move rigidly."""
    single = np.diff(transform.indptr) == 1
    for nodes in model.rigid_sets.values():
        single[model.dofs(nodes)] = False
    rows = np.flatnonzero(single)
    rows = rows[transform.data[transform.indptr[rows]] == 1.0]
    unknown = transform.indices[transform.indptr[rows]]
    table = model.table[:, : model.dimension]
    node, axis = np.full((2, model.ndof + 1), -1)
    node[table], axis[table] = np.arange(len(table))[:, None], np.arange(len(table[0]))
    rows, unknown = (x[node[rows] >= 0][::-1] for x in (rows, unknown))
    node_of, axis_of = np.full((2, transform.shape[1]), -1)
    node_of[unknown], axis_of[unknown] = node[rows], axis[rows]
    modes = model.rigid_body_modes(frame.origin).real
    motions = np.zeros((transform.shape[1], modes.shape[1]))
    motions[unknown] = modes[rows]
    middles = [
        block.nodes[:, [middle, a, b]].T
        for block in (model.solids.mesh.blocks if model.solids else ())
        for a, b, middle in element_edges(block.kind)
        if middle >= 0
    ]
    none = np.zeros((3, 0), np.int64)
    return NodalUnknowns(node_of, axis_of, motions, np.hstack([none, *middles]))


def reduced_matrices(
    model: FiniteElementModel, held: NDArray[np.bool_], frame: Frame
) -> dict[str, Any]:
    """Return transformation, matrices and rigid motions of a space without conditions.

    Raises
    ------
    InputError : no displacement is left, or a rigid piece is fixed in part.
    """
    transform = _free_coordinates(model, held)
    stiffness = ProjectedMatrix(transform, model.stiffness)
    if stiffness.shape[0] == 0:
        raise InputError("nothing is left that could move", place="reduction.fix")
    whole = model.rigid_body_modes(frame.origin)
    free, _ = _null_and_range(whole[held], np.abs(whole).max(axis=0))
    return {
        "transform": transform,
        "stiffness": stiffness,
        "mass": ProjectedMatrix(transform, model.mass),
        "constraints": np.zeros((0, stiffness.shape[0])),
        "rigid": coordinates_of(transform, whole @ free),
        "constrained_rigid_motions": np.zeros((stiffness.shape[0], 0)),
        "directions": model.directions,
    }


def support_rows(
    model: FiniteElementModel, frame: Frame, fixed: tuple[str, ...]
) -> Array | None:
    """Return the conditions (k, ndof) of fixed markers and of the frame, if any."""
    known = {marker.name for marker in model.markers}
    markers = [motion_rows(model, model.marker(n)) for n in fixed if n in known]
    if frame.supports and frame.rows is not None and not fixed:
        markers.append(frame.rows)
    return np.vstack(markers) if markers else None


def _free_coordinates(
    model: FiniteElementModel, held: NDArray[np.bool_]
) -> sp.csr_matrix:
    """Return the transformation: free degrees of freedom one to one, rigid pieces by
    their rigid motions, without dependent unknowns of the equations of the body.
    """
    free = ~held
    columns = []
    for name, nodes in model.rigid_sets.items():
        dofs = model.dofs(nodes)
        if held[dofs].all():
            continue
        if not free[dofs].all():
            raise InputError(
                f"the rigid piece at marker {name} is held or tied in part",
                place=f"markers.{name}.tie",
                expected="rigid pieces apart from each other and from what is clamped",
            )
        free[dofs] = False
        rigid = model.rigid_body_modes(model.marker(name).position)
        motion = np.zeros_like(rigid)
        motion[dofs] = rigid[dofs]
        columns.append(sp.csr_matrix(motion))
    numbers = np.flatnonzero(free)
    entries = (np.ones(numbers.size), (numbers, np.arange(numbers.size)))
    plain = sp.csr_matrix(entries, shape=(model.ndof, numbers.size))
    transform = sp.csr_matrix(sp.hstack([plain, *columns]))
    if model.equations is None:
        return transform
    number = np.full(model.ndof, -1)
    number[numbers] = np.arange(numbers.size)
    matrix = sp.csr_matrix(model.equations.matrix @ transform)
    rest = elimination_matrix(matrix, number[model.equations.dependent])
    return sp.csr_matrix(transform @ rest)


def coordinates_of(transform: sp.csr_matrix, displacements: Array) -> Array:
    """Return the coordinates y of admissible displacements (ndof, n)."""
    if displacements.shape[1] == 0:
        return np.zeros((transform.shape[1], 0))
    factors = splu(sp.csc_matrix(transform.T @ transform))
    right = np.ascontiguousarray(transform.T @ displacements)
    if np.isrealobj(right) or np.iscomplexobj(transform):
        return factors.solve(right)
    return factors.solve(right.real.copy()) + 1j * factors.solve(right.imag.copy())


def _null_and_range(rows: Array, largest: Array) -> tuple[Array, Array]:
    """Columns that the rows (k, n) annihilate, and columns for the rest of the space.

    Each set is orthonormal after a scaling of the unknowns.

    Parameters
    ----------
    largest : (n,) possible size of the columns; values far below are rounding
    """
    n = rows.shape[1]
    if np.iscomplexobj(rows):
        null, others = _null_and_range(rows.real, largest)
        return null_space_with_step(rows, null), others
    sizes = np.abs(rows).max(axis=0, initial=0.0)
    felt = sizes > _NO_MOTION * largest
    rows = np.where(felt, rows, 0.0)
    scale = 1.0 / np.where(felt, sizes, 1.0)
    if rows.shape[0] == 0 or n == 0:
        return np.eye(n), np.zeros((n, 0))
    gram = (rows * scale).T @ (rows * scale)
    values, vectors = np.linalg.eigh(gram)
    is_null = values <= _NO_MOTION**1.5 * max(values[-1], 1e-300)
    vectors = scale[:, None] * vectors
    return vectors[:, is_null], vectors[:, ~is_null]


def independent_rows(rows: Array) -> Array:
    """Return normalised rows without those that depend on previous rows."""
    selected: list[Array] = []
    basis = np.zeros((0, rows.shape[1]))
    for row in rows:
        size = np.linalg.norm(row)
        if size == 0:
            continue
        rest = row.real / size
        for _ in range(2):
            rest = rest - basis.T @ (basis @ rest)
        if np.linalg.norm(rest) > _NO_MOTION:
            selected.append(row / size)
            basis = np.vstack([basis, rest / np.linalg.norm(rest)])
    return np.array(selected).reshape(-1, rows.shape[1])


def _support_mask(rigid: Array) -> Array:
    """Return (n,) ones at degrees of freedom that support every rigid motion, zeros
    elsewhere.
    """
    rest = rigid / np.abs(rigid).max(axis=0)
    pins = np.zeros(len(rigid))
    for _ in range(rigid.shape[1]):
        sizes = np.einsum("ij,ij->i", rest, rest)
        pin = first_largest(sizes)
        pins[pin] = 1.0
        rest = rest - np.outer(rest @ rest[pin], rest[pin]) / sizes[pin]
    return pins
