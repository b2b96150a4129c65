"""Bodies whose deck CalculiX discretises: shells, beams, composites and the rest."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.model.geometry import MeshGeometry

from ...importers.bdf.shells import deck_of_bulk
from ...importers.calculix.deck import free_deck, with_density
from ...importers.calculix.engine import Computed, computed
from ...importers.calculix.raised import RaisedDeck, expected_size, raised_deck
from ...importers.deck_names import DeckNames, deck_names
from ...importers.imported import notes_of_unread, undefined_notes
from ...importers.included import foreign_text_hidden
from ...importers.matrices.checks import (
    balanced,
    check_definite,
    check_digits,
    check_rigid_motion,
    printed_rounding,
    scalar_part,
)
from ...validate.units import UnitSystem
from ..elements.quadratic_fields import softest_deformation
from ..finite_element_model import (
    Alternative,
    FiniteElementModel,
    MarkerRows,
    still,
)
from ..mesh.data import Mesh
from ..mesh.points import MeshPoints, position_of
from ..mesh.surface import named_surface
from ..named_sets import NamedSets
from ..patches.markers import at_marker, placed
from .calculix_places import refined

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Rows of the internal modes of one element C3D8I: three functions, three directions.
_INTERNAL = 9
#: Places have six digits.
_PRINTED = 5e-6
#: A node with a smaller share in the motion of a marker has none.
_NO_SHARE = 1e-9


class DependentNodes(InputError):
    """Constraints make nodes of CalculiX' mesh depend on others."""


@dataclass(frozen=True, eq=False)
class _Solid:
    """The expanded mesh, internal modes behind its nodes, with the matrices.

    Attributes
    ----------
    labels : (n,) of the deck's nodes
    internal : (n,) which are internal modes
    """

    mesh: Mesh
    labels: Indices
    internal: NDArray[np.bool_]
    stiffness: sp.csr_matrix
    mass: sp.csr_matrix
    notes: tuple[str, ...]


def calculix_model(
    model: ModelFile, units: UnitSystem, density: float | None = None
) -> FiniteElementModel:
    """The body of a model file whose deck CalculiX discretises.

    Markers and ties take their place in the solids that CalculiX makes of shells and
    beams; a node of the deck stands amid those that were made of it, and a set of the
    deck holds all of these.

    Parameters
    ----------
    density : of materials without one, in the units of the file

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
        deck_of_path = _deck(path, ignored, density)
        with foreign_text_hidden(path), deck_of_path as (deck_file, left_out):
            lines = free_deck(deck_file, left_out)
            if density is not None and deck_file == path:
                lines = with_density(lines, density)
            ours = geometry.order is None and deck_file != path
            if geometry.order == 2 or ours:
                names = deck_names(deck_file, left_out)
                taken = raised_deck(lines, names, shells_only=ours)
                found = computed(taken.lines, path)
            else:
                found = computed(lines, path)
                taken = RaisedDeck(lines, deck_names(deck_file, left_out), {})
        body = _solid(found, taken.names)
        alternative = _alternative(taken, path, units)
        discretised = _checked(body, taken.names, units, alternative)
    except InputError as error:
        raise error.located(geometry.file) from None
    deck = _deck_mesh(body, discretised.positions, taken.names, units)
    solids = Mesh(discretised.positions, body.mesh.blocks)
    return replace(
        discretised,
        markers=_markers(model, solids, deck),
        drawn=solids,
        alternative=alternative,
        notes=(*discretised.notes, *_raising_notes(taken)),
    )


def _raising_notes(deck: RaisedDeck) -> list[str]:
    listed = ", ".join(f"{own} to {new}" for own, new in deck.replaced.items())
    if not listed:
        return []
    return [f"nodes in the middle of straight edges raise the elements: {listed}"]


def _alternative(deck: RaisedDeck, path: Path, units: UnitSystem) -> Alternative | None:
    """The same deck with quadratic elements, if it has linear ones."""
    better = raised_deck(deck.lines, deck.names)
    if not better.replaced:
        return None

    def discretise() -> FiniteElementModel:
        body = _solid(computed(better.lines, path), better.names)
        return _checked(body, better.names, units)

    own, new = (
        " and ".join(dict.fromkeys(words))
        for words in (better.replaced, better.replaced.values())
    )
    size = expected_size(better.names)
    return Alternative(own, new, size, "geometry.order = 2", discretise)


@contextmanager
def _deck(
    path: Path, ignored: frozenset[str], density: float | None
) -> Iterator[tuple[Path, frozenset[str]]]:
    """A deck that CalculiX reads, and what of it is left out."""
    if path.suffix.lower() == ".inp":
        yield path, ignored
        return
    with tempfile.TemporaryDirectory() as name:
        made = Path(name) / f"{path.stem}.inp"
        made.write_text(deck_of_bulk(path, ignored, density), encoding="utf-8")
        yield made, frozenset()


def _solid(found: Computed, names: DeckNames) -> _Solid:
    rows, internal = _rows(found, names)
    labels = found.dofs[rows[:, 0], 0]
    positions, exact = _known_places(found, names, labels)
    notes = _notes(found, len(internal), names) + undefined_notes(names.undefined)
    if not exact:
        positions = refined(positions, *_condensed(found, rows.ravel(), internal))
    order = np.concatenate([rows.ravel(), internal])
    k, m = (sp.csr_matrix(a[order][:, order]) for a in (found.stiffness, found.mass))
    m = m + _point_masses(names, labels, m.shape[0])
    middles = _middles(k, positions)
    return _Solid(
        Mesh(np.vstack([positions, middles]), found.blocks),
        np.concatenate([labels, found.dofs[internal[::3], 0]]),
        np.arange(len(labels) + len(middles)) >= len(labels),
        k,
        m,
        tuple(notes),
    )


def _point_masses(names: DeckNames, labels: Indices, size: int) -> sp.csr_matrix:
    """Masses at nodes, which move by the mean of the nodes that were made of them.

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
        made = np.flatnonzero(labels == mass.node)
        if not made.size:
            raise InputError(
                f"the mass at node {mass.node} is held by no element",
                place=mass.place,
                expected="a node of an element, or a marker tied there and a rigid "
                "body in the scene",
            )
        rows = (3 * made[:, None] + np.arange(3)).ravel()
        shares = np.full(rows.size, 1 / made.size)
        columns = np.tile(np.arange(3), made.size)
        mean = sp.csr_matrix((shares, (rows, columns)), shape=(size, 3))
        total = total + mass.mass * (mean @ mean.T)
    return sp.csr_matrix(total)


def _middles(stiffness: sp.csr_matrix, positions: Array) -> Array:
    """(m, 3) the mean place of the nodes that each internal mode is coupled to."""
    n = positions.size
    coupled = sp.csr_matrix(abs(stiffness[n::3][:, :n]) > 0).astype(float)
    places = coupled @ np.repeat(positions, 3, axis=0)
    return np.asarray(places / np.maximum(coupled.sum(axis=1), 1.0))


def _rows(found: Computed, names: DeckNames) -> tuple[Indices, Indices]:
    """(n, 3) rows of the nodes of the expanded mesh, and the rows of internal modes.

    Rows are in the order of the expanded nodes; internal modes come last, with numbers
    beyond those of the deck.
    """
    n = len(found.nodes)
    last = max(names.nodes)
    internal = np.flatnonzero(found.dofs[:, 0] > last)
    own = np.flatnonzero(found.dofs[:, 0] <= last)
    labels, directions = found.dofs[own].T
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
    if len(internal) % _INTERNAL:
        raise InputError(
            f"CalculiX adds {len(internal)} rows of its own",
            expected=f"{_INTERNAL} of internal modes for every element C3D8I",
        )
    return own.reshape(-1, 3), internal


def _condensed(
    found: Computed, own: Indices, internal: Indices
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Stiffness and mass of the nodes whose internal modes follow without mass."""
    k, m = found.stiffness, found.mass[own][:, own]
    kept = k[own][:, own]
    if internal.size:
        inner = sp.bsr_matrix(k[internal][:, internal], blocksize=(_INTERNAL,) * 2)
        if not np.array_equal(inner.indices, np.arange(len(internal) // _INTERNAL)):
            raise InputError(
                "internal modes of elements are coupled", expected="C3D8I of CalculiX"
            )
        inverse = sp.bsr_matrix(
            (np.linalg.inv(inner.data), inner.indices, inner.indptr), inner.shape
        )
        across = k[internal][:, own]
        kept = kept - across.T @ inverse @ across
    return sp.csr_matrix((kept + kept.T) / 2), sp.csr_matrix((m + m.T) / 2)


def _known_places(
    found: Computed, names: DeckNames, labels: Indices
) -> tuple[Array, bool]:
    """Positions of the expanded nodes, and whether all stand in the deck.

    Those that were made of one node lie around it, unless a section has an offset.
    """
    owners, of = np.unique(labels, return_inverse=True)
    given = np.array([names.nodes[int(label)] for label in owners])
    counts = np.bincount(of)
    means = np.column_stack([np.bincount(of, x) / counts for x in found.positions.T])
    printed = _PRINTED * np.abs(means - found.centre)
    off = (np.abs(given - means) - printed).max(axis=1)
    same = found.nodes == labels
    around = (off[of] <= 0) | same
    positions = found.positions + np.where(around[:, None], (given - means)[of], 0.0)
    return positions, bool(same.all())


def _notes(found: Computed, internal: int, names: DeckNames) -> list[str]:
    counts = Counter({b.kind: len(b.nodes) for b in found.blocks})
    listed = ", ".join(f"{count} {kind}" for kind, count in counts.items())
    notes = [
        f"CalculiX makes {listed} with {len(found.nodes)} nodes of the "
        f"{names.elements} elements of the deck"
    ]
    if internal:
        notes.append(
            f"{internal // _INTERNAL} elements C3D8I bring their internal modes as "
            "degrees of freedom, with the mass that CalculiX gives them"
        )
    notes += notes_of_unread(names.left_out)
    return notes + [f"CalculiX warns: {text}" for text in found.warnings]


def _checked(
    body: _Solid,
    names: DeckNames,
    units: UnitSystem,
    alternative: Alternative | None = None,
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
    bare = FiniteElementModel(
        mesh.positions, None, k, {}, (), full_mass=m, internal=body.internal
    )
    check_definite(m, k)
    scalar = scalar_part(m, table)
    if scalar is None:
        raise InputError(
            "the mass differs between the directions",
            expected="elements without rotary inertia of their own",
        )
    rigid = bare.rigid_body_modes(mesh.positions.mean(axis=0))
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
    rounding = printed_rounding(k, rigid[:, :3])
    k = balanced(k, bare.place_table)
    softest = softest_deformation(k, m, mesh.positions, bare.place_table)
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
        notes=body.notes,
    )


def _deck_mesh(
    body: _Solid, positions: Array, names: DeckNames, units: UnitSystem
) -> Mesh:
    """The nodes of the deck, each amid the nodes that were made of it."""
    labels = np.array(list(names.nodes), np.int64)
    places = np.array(list(names.nodes.values())) * units.length
    row = {int(label): i for i, label in enumerate(labels)}
    made = np.flatnonzero(~body.internal)
    owners = np.array([row[int(label)] for label in body.labels[made]])
    counts = np.bincount(owners, minlength=len(labels))
    for axis in range(3):
        sums = np.bincount(owners, positions[made, axis], len(labels))
        places[counts > 0, axis] = sums[counts > 0] / counts[counts > 0]
    return Mesh(places, (), {}, labels)


def _markers(model: ModelFile, mesh: Mesh, deck: Mesh) -> tuple[MarkerRows, ...]:
    """At nodes and places of the deck, in the solids around them."""
    points = MeshPoints(mesh)
    markers = []
    for name, marker in placed(model.markers):
        with at_marker(name):
            where = position_of(deck, marker)
            if marker.tie is None:
                rows = points.rows_beside(name, marker.node, where)
                markers.append(_on_its_nodes(rows))
            else:
                markers.append(still(name, marker.node, where, mesh.positions.size))
    return tuple(markers)


def _on_its_nodes(marker: MarkerRows) -> MarkerRows:
    """Without the shares that the last digits of places give to nodes beside it."""
    rows = marker.displacement.copy()
    rows.data[np.abs(rows.data) < _NO_SHARE] = 0.0
    rows.eliminate_zeros()
    return replace(marker, displacement=rows)
