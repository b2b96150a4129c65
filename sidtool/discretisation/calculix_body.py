"""Bodies that CalculiX discretises: shells, beams, composites and others.

CalculiX prints positions of nodes with few digits. They are refined such that the
stiffness, known with more digits, does not resist rigid rotations.
"""

import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.model import ModelFile
from sidtool.formats.model.geometry import MeshGeometry

from ..eigensolvers.eigenpairs import symmetric_factors
from ..eigensolvers.slepc import notify
from ..elements.faces import named_surface
from ..elements.finite_element_model import (
    ElementAlternative,
    FiniteElementModel,
    MarkerRows,
    fixed_marker,
)
from ..elements.markers import (
    MeshPoints,
    markers_with_position,
    name_marker_in_errors,
    position_of,
)
from ..importers.calculix_engine import (
    CalculixResult,
    free_deck,
    run_calculix,
    with_density,
)
from ..importers.calculix_quadratic import QuadraticDeck, expected_size, quadratic_deck
from ..importers.matrix_market import (
    balance_stiffness,
    check_definite,
    check_digits,
    check_rigid_motion,
    printed_rounding_of,
    scalar_mass,
)
from ..importers.mesh_files import DeckNames, read_deck_names
from ..importers.nastran.shells import deck_of_bulk
from ..mesh.connections import NamedSets
from ..mesh.deck_text import hide_included_text
from ..mesh.imported_mesh import undefined_notes, unread_keyword_notes
from ..mesh.mesh import Mesh
from ..mesh.quadratic_fields import softest_deformation
from ..mesh.unit_systems import UnitSystem

Indices = NDArray[np.int64]

#: Rows of the internal modes of one element C3D8I: three functions, three directions.
_INTERNAL_ROWS_PER_ELEMENT = 9
#: Printed positions have six digits.
_PRINTED_PRECISION = 5e-6
#: Smaller shares of a node in the motion of a marker are zero.
_NO_SHARE = 1e-9

#: What is left of deformations, unless they may come from the last digits of the
#: stiffness, as below this share of the largest eigenvalue.
_RESIDUAL_SHARE, _STIFFNESS_DIGITS = 1e-3, 1e-7
#: Iterations stop when that eigenvalue changes by less than this fraction.
_CONVERGENCE_TOLERANCE, _MAX_ITERATIONS = 0.01, 8


class DependentNodes(InputError):
    """Raised if constraints make nodes of CalculiX' mesh depend on others."""


@dataclass(frozen=True, eq=False)
class _ExpandedMesh:
    """The expanded mesh, internal modes behind its nodes, with the matrices.

    Attributes
    ----------
    labels : (n,) of the deck's nodes
    internal : (n,) mask of internal modes
    """

    mesh: Mesh
    labels: Indices
    internal: NDArray[np.bool_]
    stiffness: sp.csr_matrix
    mass: sp.csr_matrix
    diagnostics: tuple[Diagnostic, ...]


def calculix_model(
    model: ModelFile, units: UnitSystem, density: float | None = None
) -> FiniteElementModel:
    """Return the body of a model file whose deck CalculiX discretises.

    Markers and ties are placed in the solids that CalculiX makes of shells and beams. A
    node of the deck is at the centre of those that were expanded from it, and a set of
    the deck holds all of these.

    Parameters
    ----------
    density : density of materials without one, in the units of the file

    Raises
    ------
    InputError : CalculiX is not installed or refuses the deck, or constraints make
        nodes depend on others.
    """
    geometry = model.geometry
    assert isinstance(geometry, MeshGeometry)
    if model.material is not None or geometry.thickness is not None:
        raise InputError(
            "is that of the deck where CalculiX discretises",
            place="material" if model.material is not None else "geometry.thickness",
            expected="materials and sections in the deck",
        )
    path = Path(geometry.file)
    ignored = frozenset(" ".join(w.upper().strip("*").split()) for w in geometry.ignore)
    try:
        if density == 0:
            raise InputError(
                "is zero", place="geometry.density", expected="a density above zero"
            )
        deck_of_path = _prepared_deck(path, ignored, density)
        with hide_included_text(path), deck_of_path as (deck_file, left_out):
            lines = free_deck(deck_file, left_out)
            if density is not None and deck_file == path:
                lines = with_density(lines, density)
            notify("CalculiX discretises the deck")
            ours = geometry.order is None and deck_file != path
            if geometry.order == 2 or ours:
                names = read_deck_names(deck_file, left_out)
                taken = quadratic_deck(lines, names, shells_only=ours)
                result = run_calculix(taken.lines, path, notify)
            else:
                result = run_calculix(lines, path, notify)
                taken = QuadraticDeck(lines, read_deck_names(deck_file, left_out), {})
        body = _expanded_mesh(result, taken.names)
        alternative = _quadratic_alternative(taken, path, units)
        discretised = _checked_body(body, taken.names, units, alternative)
    except InputError as error:
        raise error.located(geometry.file) from None
    deck = _deck_mesh(body, discretised.positions, taken.names, units)
    solids = Mesh(discretised.positions, body.mesh.blocks)
    return replace(
        discretised,
        markers=_deck_markers(model, solids, deck),
        drawing_mesh=solids,
        alternative=alternative,
        diagnostics=(*discretised.diagnostics, *_quadratic_notes(taken)),
    )


def _quadratic_notes(deck: QuadraticDeck) -> list[Diagnostic]:
    kinds = [f"{own} to {new}" for own, new in deck.replaced.items()]
    return [diagnose("N139", kinds=kinds)] if kinds else []


def _quadratic_alternative(
    deck: QuadraticDeck, path: Path, units: UnitSystem
) -> ElementAlternative | None:
    """Return the deck with quadratic elements, if it has linear ones."""
    better = quadratic_deck(deck.lines, deck.names)
    if not better.replaced:
        return None

    def discretise() -> FiniteElementModel:
        body = _expanded_mesh(run_calculix(better.lines, path, notify), better.names)
        return _checked_body(body, better.names, units)

    own, new = (
        " and ".join(dict.fromkeys(words))
        for words in (better.replaced, better.replaced.values())
    )
    size = expected_size(better.names)
    remedy = "geometry.order = 2"
    if better.replaced.keys() <= {"S3", "S3R", "S4", "S4R"}:
        remedy += ", or leave out geometry.engine (shells of sidtool)"
    return ElementAlternative(own, new, size, remedy, discretise)


@contextmanager
def _prepared_deck(
    path: Path, ignored: frozenset[str], density: float | None
) -> Iterator[tuple[Path, frozenset[str]]]:
    """Return a deck that CalculiX reads, and what was removed from it."""
    if path.suffix.lower() == ".inp":
        yield path, ignored
        return
    with tempfile.TemporaryDirectory() as name:
        deck_file = Path(name) / f"{path.stem}.inp"
        deck_file.write_text(deck_of_bulk(path, ignored, density), encoding="utf-8")
        yield deck_file, frozenset()


def _expanded_mesh(result: CalculixResult, names: DeckNames) -> _ExpandedMesh:
    rows, internal = _node_rows(result, names)
    labels = result.dofs[rows[:, 0], 0]
    positions, exact = _known_positions(result, names, labels)
    found = _conversion_notes(result, len(internal), names)
    found += undefined_notes(names.undefined)
    if not exact:
        positions = refine_positions(
            positions, *_condense_internal(result, rows.ravel(), internal)
        )
    order = np.concatenate([rows.ravel(), internal])
    k, m = (sp.csr_matrix(a[order][:, order]) for a in (result.stiffness, result.mass))
    m = m + _point_masses(names, labels, m.shape[0])
    middles = _internal_mode_positions(k, positions)
    return _ExpandedMesh(
        Mesh(np.vstack([positions, middles]), result.blocks),
        np.concatenate([labels, result.dofs[internal[::3], 0]]),
        np.arange(len(labels) + len(middles)) >= len(labels),
        k,
        m,
        tuple(found),
    )


def _point_masses(names: DeckNames, labels: Indices, size: int) -> sp.csr_matrix:
    """Return masses at nodes; they move with the mean of the expanded nodes.

    Raises
    ------
    InputError : no element holds such a node, or it has inertia.
    """
    total = sp.csr_matrix((size, size))
    for mass in names.masses:
        if any(mass.inertia):
            raise InputError(
                f"the mass at node {mass.node} has inertia",
                place=mass.place,
                expected="plain masses, or a marker tied there and a rigid body in the "
                "scene",
            )
        copies = np.flatnonzero(labels == mass.node)
        if not copies.size:
            raise InputError(
                f"the mass at node {mass.node} is held by no element",
                place=mass.place,
                expected="a node of an element, or a marker tied there and a rigid "
                "body in the scene",
            )
        rows = (3 * copies[:, None] + np.arange(3)).ravel()
        shares = np.full(rows.size, 1 / copies.size)
        columns = np.tile(np.arange(3), copies.size)
        mean = sp.csr_matrix((shares, (rows, columns)), shape=(size, 3))
        total = total + mass.mass * (mean @ mean.T)
    return sp.csr_matrix(total)


def _internal_mode_positions(stiffness: sp.csr_matrix, positions: Array) -> Array:
    """(m, 3) the mean place of the nodes that each internal mode is coupled to."""
    n = positions.size
    coupled = sp.csr_matrix(abs(stiffness[n::3][:, :n]) > 0).astype(float)
    places = coupled @ np.repeat(positions, 3, axis=0)
    return np.asarray(places / np.maximum(coupled.sum(axis=1), 1.0))


def _node_rows(result: CalculixResult, names: DeckNames) -> tuple[Indices, Indices]:
    """(n, 3) rows of the nodes of the expanded mesh, and the rows of internal modes.

    Rows are in the order of the expanded nodes; internal modes come last, with numbers
    beyond those of the deck.
    """
    n = len(result.nodes)
    last = max(names.nodes)
    internal = np.flatnonzero(result.dofs[:, 0] > last)
    own = np.flatnonzero(result.dofs[:, 0] <= last)
    labels, directions = result.dofs[own].T
    if len(own) > 3 * n:
        raise InputError(
            f"nodes of {len(own) // 3 - n} of the deck belong to no solid: springs, "
            "masses or other elements stand apart",
            expected="solids, shells and beams",
        )
    whole = len(own) == 3 * n and (directions.reshape(-1, 3) == [1, 2, 3]).all()
    if not whole or (labels.reshape(-1, 3) != labels[::3, None]).any():
        raise DependentNodes(
            f"constraints make degrees of freedom of the {n} nodes of the expanded "
            f"mesh depend on others ({len(own)} of {3 * n} are left): *EQUATION, *MPC, "
            "*TIE and the like, or knots where sections or normals of shells and beams "
            "differ",
            expected="nodes that are free, smooth shells and beams of one section, and "
            "none that share nodes with solids",
        )
    if len(internal) % _INTERNAL_ROWS_PER_ELEMENT:
        raise InputError(
            f"CalculiX adds {len(internal)} rows of its own",
            expected=f"{_INTERNAL_ROWS_PER_ELEMENT} of internal modes for every "
            "element C3D8I",
        )
    return own.reshape(-1, 3), internal


def _condense_internal(
    result: CalculixResult, own: Indices, internal: Indices
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Stiffness and mass of the nodes whose internal modes follow without mass."""
    k, m = result.stiffness, result.mass[own][:, own]
    own_block = k[own][:, own]
    if internal.size:
        inner = sp.bsr_matrix(
            k[internal][:, internal], blocksize=(_INTERNAL_ROWS_PER_ELEMENT,) * 2
        )
        if not np.array_equal(
            inner.indices, np.arange(len(internal) // _INTERNAL_ROWS_PER_ELEMENT)
        ):
            raise InputError(
                "internal modes of elements are coupled", expected="C3D8I of CalculiX"
            )
        inverse = sp.bsr_matrix(
            (np.linalg.inv(inner.data), inner.indices, inner.indptr), inner.shape
        )
        across = k[internal][:, own]
        own_block = own_block - across.T @ inverse @ across
    return sp.csr_matrix((own_block + own_block.T) / 2), sp.csr_matrix((m + m.T) / 2)


def _known_positions(
    result: CalculixResult, names: DeckNames, labels: Indices
) -> tuple[Array, bool]:
    """Return positions of the expanded nodes, and whether all are in the deck.

    Nodes expanded from one node surround it, unless a section has an offset.
    """
    owners, of = np.unique(labels, return_inverse=True)
    if undefined := [int(label) for label in owners if int(label) not in names.nodes]:
        raise InputError(
            f"an element names node {undefined[0]}, which is not defined",
            expected="nodes of the deck: CalculiX places others at the origin",
        )
    given = np.array([names.nodes[int(label)] for label in owners])
    counts = np.bincount(of)
    means = np.column_stack([np.bincount(of, x) / counts for x in result.positions.T])
    printed = _PRINTED_PRECISION * np.abs(means - result.centre)
    off = (np.abs(given - means) - printed).max(axis=1)
    same = result.nodes == labels
    around = (off[of] <= 0) | same
    positions = result.positions + np.where(around[:, None], (given - means)[of], 0.0)
    return positions, bool(same.all())


def _conversion_notes(
    result: CalculixResult, internal: int, names: DeckNames
) -> list[Diagnostic]:
    counts = Counter({b.kind: len(b.nodes) for b in result.blocks})
    found = [
        diagnose(
            "N127",
            elements=names.elements,
            kinds=[f"{count} {kind}" for kind, count in counts.items()],
            nodes=len(result.nodes),
            elements_with_internal_modes=internal // _INTERNAL_ROWS_PER_ELEMENT,
        )
    ]
    found += unread_keyword_notes(names.left_out)
    return found + [diagnose("N128", warning=text) for text in result.warnings]


def _checked_body(
    body: _ExpandedMesh,
    names: DeckNames,
    units: UnitSystem,
    alternative: ElementAlternative | None = None,
) -> FiniteElementModel:
    """The body without markers, in SI units.

    Raises
    ------
    InputError : the matrices are not those of a free body of solids.
    """
    n = len(body.labels)
    table = np.full((n, 6), -1, np.int64)
    table[:, :3] = np.arange(3 * n).reshape(n, 3)
    mesh = Mesh(body.mesh.positions * units.length, body.mesh.blocks)
    k = sp.csr_matrix(body.stiffness * (units.mass / units.time**2))
    m = sp.csr_matrix(body.mass * units.mass)
    unmarked = FiniteElementModel(
        mesh.positions, None, k, {}, (), full_mass=m, internal=body.internal
    )
    notify("checking the matrices of CalculiX")
    check_definite(m, k)
    scalar = scalar_mass(m, table)
    if scalar is None:
        raise InputError(
            "the mass differs between the directions",
            expected="elements without rotary inertia of their own",
        )
    rigid = unmarked.rigid_body_modes(mesh.positions.mean(axis=0))
    try:
        check_rigid_motion(k, rigid)
    except InputError as error:
        if alternative is None:
            raise
        raise InputError(
            f"{alternative.own} elements of CalculiX: {error.problem}",
            expected=f"{alternative.remedy}: C3D8R, as which it takes S4R, resists "
            "rotations where it is distorted",
        ) from None
    rounding = printed_rounding_of(k, rigid[:, :3])
    k = balance_stiffness(k, unmarked.place_table)
    softest = softest_deformation(k, m, mesh.positions, unmarked.place_table)
    check_digits(k, rounding, *softest)
    sets = NamedSets(
        {
            name: np.flatnonzero(np.isin(body.labels, list(nodes)))
            for name, nodes in names.sets.items()
        },
        names.undefined,
    )
    return FiniteElementModel(
        positions=mesh.positions,
        scalar_mass=None if body.internal.any() else scalar,
        full_mass=m if body.internal.any() else None,
        internal=body.internal,
        stiffness=k,
        node_sets=sets,
        surface=named_surface(mesh, sets),
        markers=(),
        diagnostics=body.diagnostics,
    )


def _deck_mesh(
    body: _ExpandedMesh, positions: Array, names: DeckNames, units: UnitSystem
) -> Mesh:
    """Return the nodes of the deck, each at the mean of its expanded nodes."""
    labels = np.array(list(names.nodes), np.int64)
    places = np.array(list(names.nodes.values())) * units.length
    row = {int(label): i for i, label in enumerate(labels)}
    nodal = np.flatnonzero(~body.internal)
    owners = np.array([row[int(label)] for label in body.labels[nodal]])
    counts = np.bincount(owners, minlength=len(labels))
    for axis in range(3):
        sums = np.bincount(owners, positions[nodal, axis], len(labels))
        places[counts > 0, axis] = sums[counts > 0] / counts[counts > 0]
    return Mesh(places, (), {}, labels)


def _deck_markers(model: ModelFile, mesh: Mesh, deck: Mesh) -> tuple[MarkerRows, ...]:
    """Return markers at nodes and positions of the deck, in the solids around them."""
    points = MeshPoints(mesh)
    markers = []
    for name, marker in markers_with_position(model.markers):
        with name_marker_in_errors(name):
            where = position_of(deck, marker)
            if marker.tie is None:
                rows = points.rows_of_nearest_point(name, marker.node, where)
                markers.append(_without_rounding_shares(rows))
            else:
                markers.append(
                    fixed_marker(name, marker.node, where, mesh.positions.size)
                )
    return tuple(markers)


def _without_rounding_shares(marker: MarkerRows) -> MarkerRows:
    """Remove weights of neighbouring nodes that are rounding of printed positions."""
    rows = marker.displacement.copy()
    rows.data[np.abs(rows.data) < _NO_SHARE] = 0.0
    rows.eliminate_zeros()
    return replace(marker, displacement=rows)


def refine_positions(
    positions: Array, stiffness: sp.csr_matrix, mass: sp.csr_matrix
) -> Array:
    """Return positions (n, 3) for which the stiffness does not resist rigid rotations.

    A rotation about an axis is a displacement field that the positions give. Rounded
    positions deform the body; of the fields near them, those of the least energy are
    rigid: the solution x of (K + s M) x = s M x0 loses the part of x0 whose Rayleigh
    quotient is far above s.
    """
    centre = positions.mean(axis=0)
    places = positions - centre
    largest = float((stiffness.diagonal() / mass.diagonal()).max())
    before = np.inf
    for step in range(1, _MAX_ITERATIONS + 1):
        notify(f"refining positions, step {step} of at most {_MAX_ITERATIONS}")
        body = FiniteElementModel(places, None, stiffness, {}, ())
        first, _ = softest_deformation(stiffness, mass, places, body.table)
        if abs(first - before) < _CONVERGENCE_TOLERANCE * before:
            break
        before = first
        shift = max(_RESIDUAL_SHARE * abs(first), _STIFFNESS_DIGITS * largest)
        where = np.repeat(places, 3, axis=0)
        factors = symmetric_factors(stiffness + shift * mass, where)
        rigid = body.rigid_body_modes()
        turns = factors.solve(np.ascontiguousarray(shift * (mass @ rigid[:, 3:])))
        about = turns.reshape(-1, 3, 3)
        places = np.column_stack(
            [(about[:, b, c] - about[:, c, b]) / 2 for b, c in ((1, 2), (2, 0), (0, 1))]
        )
    return places + centre
