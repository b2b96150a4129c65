"""Couplings and point masses of a mesh file as those of a body."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile

from ...importers.imported import ImportedMesh, RawCoupling, RawMass
from ...validate.units import UnitSystem
from ..couplings import Coupling, PointMass
from ..mesh.data import Mesh
from ..mesh.surface import mesh_surface

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def body_couplings(
    imported: ImportedMesh, whole: Mesh, mesh: Mesh, model: ModelFile
) -> tuple[Coupling, ...]:
    """The couplings of a file by the nodes of its elements.

    Rigid ones with one reference node are one piece. A reference node that elements
    use belongs to its rigid piece.

    Parameters
    ----------
    whole : the mesh with the nodes that no element uses
    mesh : the mesh without them

    Raises
    ------
    InputError : a coupling holds no node of the body, one that the file does not
        define or that is a reference node of another, or the mean motion of nodes
        without elements.
    """
    row = {int(label): i for i, label in enumerate(mesh.labels)}
    place = {int(label): i for i, label in enumerate(whole.labels)}
    references = {c.reference for c in imported.couplings}
    for coupling in imported.couplings:
        _check_members(coupling, place, row)
    result = []
    for group in _by_reference(imported.couplings):
        first = group[0]
        labels = dict.fromkeys(n for c in group for n in c.nodes)
        if first.rigid and first.reference in row:
            labels[first.reference] = None
        chained = [n for n in labels if n in references and n != first.reference]
        nodes = np.unique([row[n] for n in labels if n in row]).astype(np.int64)
        if chained or not nodes.size:
            raise InputError(
                f"{first.name} holds node {chained[0]}, the reference of another"
                if chained
                else f"{first.name} holds no node of an element",
                place=first.place,
                expected="couplings of nodes of elements",
            )
        where = None
        if first.reference is not None and first.reference in place:
            where = np.zeros(3)
            where[: whole.dimension] = whole.positions[place[first.reference]]
        markers = tuple(
            name
            for name, marker in model.markers.items()
            if marker.tie is None
            and marker.mesh_node is not None
            and marker.mesh_node == first.reference
            and marker.mesh_node not in row
        )
        weights = _weights(first, mesh, row)
        result.append(Coupling(first.name, first.rigid, nodes, where, markers, weights))
    return tuple(result)


def _check_members(
    coupling: RawCoupling, defined: Container[int], used: Container[int]
) -> None:
    if not {*"123"} <= set(coupling.directions):
        raise InputError(
            f"{coupling.name} holds the directions {coupling.directions}",
            place=coupling.place,
            expected="1, 2 and 3 with or without rotations",
        )
    named = (*coupling.nodes, coupling.reference)
    lost = [n for n in named if n is not None and n not in defined]
    free = [] if coupling.rigid else [n for n in coupling.nodes if n not in used]
    if lost or (free and len(free) < len(coupling.nodes)):
        node = (lost or free)[0]
        what = "is not defined" if lost else "no element of the body uses"
        raise InputError(
            f"{coupling.name} names node {node}, which {what}",
            place=coupling.place,
            expected="nodes of this file"
            if lost
            else "a mean over nodes of elements alone",
        )


def _weights(
    coupling: RawCoupling, mesh: Mesh, row: Mapping[int, int]
) -> sp.csr_matrix | None:
    """Of the nodes of a mean: theirs, or the mass matrix of the surface they span."""
    n = len(mesh.positions)
    own = [(row[label], i) for i, label in enumerate(coupling.nodes) if label in row]
    nodes = np.array([place for place, _ in own], np.int64)
    if coupling.weights:
        values = [coupling.weights[i] for _, i in own]
        return sp.csr_matrix((values, (nodes, nodes)), shape=(n, n))
    surface = mesh_surface(mesh, nodes) if coupling.by_area else None
    return surface.mass if surface is not None and surface.mass.nnz else None


def _by_reference(couplings: Sequence[RawCoupling]) -> Iterable[list[RawCoupling]]:
    groups: dict[object, list[RawCoupling]] = {}
    for i, coupling in enumerate(couplings):
        shared = coupling.rigid and coupling.reference is not None
        groups.setdefault(coupling.reference if shared else -1 - i, []).append(coupling)
    return groups.values()


def body_masses(
    imported: ImportedMesh,
    couplings: Sequence[Coupling],
    mesh: Mesh,
    units: UnitSystem,
) -> tuple[PointMass, ...]:
    """The point masses of a file in SI units.

    Raises
    ------
    InputError : a mass is at a node that neither elements nor couplings hold, or has
        inertia at a node that does not turn.
    """
    row = {int(label): i for i, label in enumerate(mesh.labels)}
    held = {c.reference: c.name for c in reversed(imported.couplings)}
    known = {c.name for c in couplings}
    first = {
        c.reference: c.name for c in reversed(imported.couplings) if c.name in known
    }
    result = []
    for mass in imported.masses:
        coupling = first.get(mass.node) if mass.node in held else None
        _check(mass, coupling is not None, mass.node in row)
        xx, yy, zz, xy, yz, zx = mass.inertia
        tensor = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
        result.append(
            PointMass(
                None if coupling is not None else row[mass.node],
                coupling,
                mass.mass * units.mass,
                np.array(mass.offset) * units.length,
                tensor * (units.mass * units.length**2),
            )
        )
    return tuple(result)


def _check(mass: RawMass, coupled: bool, on_element: bool) -> None:
    if not coupled and not on_element:
        raise InputError(
            f"the mass at node {mass.node} is held by no element and no coupling",
            place=mass.place,
            expected="a node of an element, or the reference node of a coupling",
        )
    if not coupled and (any(mass.offset) or any(mass.inertia)):
        raise InputError(
            f"the mass at node {mass.node} has inertia or an offset, and the node of a "
            "solid does not turn",
            place=mass.place,
            expected="a plain mass, or one at the reference node of a coupling",
        )
