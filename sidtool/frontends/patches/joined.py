"""Isogeometric analysis of several patches.

Matching sides are joined; a side on a part of another is tied weakly.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile, NodeMarker
from sidtool.formats.model.geometry import FACES, PatchesGeometry

from ...geometry.contact import check_one_part, check_overlaps, weak_ties
from ...geometry.multipatch import Joined, Side, closed_up, joined, sides_of, topology
from ...geometry.patch import NurbsPatch, side_nodes
from ...importers.patches.reading import read_patches
from ..elements.continuum import Continuum
from ..elements.solid import ElementBatch
from ..finite_element_model import FiniteElementModel, MarkerRows
from ..iga import expected_mass, patch_continuum, patch_matrices, refined_for
from ..named_sets import NamedSets
from ..surface import Surface, together
from .markers import at_marker, marker_parameters, placed, rows_at
from .mortar import tie_stiffness
from .surface import patch_surface

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def patches_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file whose geometry is a patch file.

    Raises
    ------
    InputError : names the file, the patch or the key that is wrong.
    """
    geometry = model.geometry
    assert isinstance(geometry, PatchesGeometry)
    exact = read_patches(geometry.file)
    if len({len(patch.degrees) for patch in exact.values()}) > 1:
        raise InputError(
            "holds plane patches and volumes",
            source=geometry.file,
            expected="patches of one kind",
        )
    try:
        check_overlaps(exact)
        found = topology(exact, geometry.tolerance)
        ties = weak_ties(exact, found, geometry.tolerance)
        exact = closed_up(exact, found, geometry.tolerance)
        fine = {name: refined_for(model, patch) for name, patch in exact.items()}
        numbering = joined(fine, found)
        check_one_part(numbering, ties)
    except InputError as error:
        raise error.located(geometry.file) from None
    d = len(next(iter(fine.values())).degrees)
    n = numbering.count
    mass, stiffness = sp.csr_matrix((n, n)), sp.csr_matrix((d * n, d * n))
    positions = np.zeros((n, d))
    for name, patch in fine.items():
        m, k = patch_matrices(model, exact[name], patch)
        once, spread = _gathering(numbering, name, d)
        mass, stiffness = mass + once.T @ m @ once, stiffness + spread.T @ k @ spread
        positions[numbering.numbers[name]] = patch.points
    assert model.material is not None
    modulus = model.material.youngs_modulus * (geometry.thickness or 1.0)
    for tie in ties:
        stiffness = stiffness + tie_stiffness(tie, fine, numbering, modulus)
    return FiniteElementModel(
        positions=positions,
        scalar_mass=sp.csr_matrix(mass),
        stiffness=sp.csr_matrix(stiffness),
        node_sets=_side_sets(geometry, fine, numbering),
        surface=lambda names: _surface(geometry, fine, numbering, names),
        markers=_markers(model, exact, fine, numbering),
        continua=tuple(
            _joined_continuum(
                patch_continuum(model, exact[name], patch), numbering.numbers[name]
            )
            for name, patch in fine.items()
        ),
        patches=tuple((fine[name], numbering.numbers[name]) for name in fine),
        geometry_mass=lambda: expected_mass(model, list(exact.values())),
        notes=tuple(
            f"{tie.slave.name} lies on a part of {tie.master.name}: tied weakly "
            "(mortar method)"
            for tie in ties
        ),
    )


def _joined_continuum(continuum: Continuum, numbers: Indices) -> Continuum:
    """The material of a patch on the common control points."""

    def batches() -> Iterator[ElementBatch]:
        for batch in continuum.batches():
            yield replace(batch, nodes=numbers[batch.nodes])

    return replace(continuum, batches=batches)


def _gathering(
    numbering: Joined, name: str, d: int
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """From common control points, and degrees of freedom, to those of one patch."""
    numbers = numbering.numbers[name]
    local = np.arange(len(numbers))
    shape = (len(numbers), numbering.count)
    once = sp.csr_matrix((np.ones(len(numbers)), (local, numbers)), shape=shape)
    return once, sp.csr_matrix(sp.kron(once, sp.eye_array(d)))


def _side_sets(
    geometry: PatchesGeometry, patches: Mapping[str, NurbsPatch], numbering: Joined
) -> NamedSets:
    sets = NamedSets()
    for name, patch in patches.items():
        for side, (direction, end) in FACES.items():
            if direction < len(patch.degrees):
                nodes = numbering.numbers[name][side_nodes(patch, direction, end)]
                sets[f"{name}.{side}"] = np.unique(nodes)
    for name, members in geometry.edges.items():
        try:
            sets[name] = np.unique(np.concatenate([sets[m] for m in members]))
        except InputError as error:
            raise InputError(
                error.problem,
                place=f"geometry.edges.{name}",
                expected=error.expected,
            ) from None
    return sets


def _surface(
    geometry: PatchesGeometry,
    patches: Mapping[str, NurbsPatch],
    numbering: Joined,
    names: tuple[str, ...],
) -> Surface:
    """Named sides as one, on the common control points."""
    sides: dict[str, tuple[Side, ...]] = {s.name: (s,) for s in sides_of(patches)}
    for name, members in geometry.edges.items():
        sides[name] = tuple(side for member in members for side in sides[member])
    found = []
    for side in dict.fromkeys(side for name in names for side in sides[name]):
        own = patch_surface(patches[side.patch], side.direction, side.end)
        once, _ = _gathering(numbering, side.patch, own.points.shape[1])
        found.append(replace(own, mass=sp.csr_matrix(once.T @ own.mass @ once)))
    return together(found)


def _markers(
    model: ModelFile,
    exact: Mapping[str, NurbsPatch],
    fine: Mapping[str, NurbsPatch],
    numbering: Joined,
) -> tuple[MarkerRows, ...]:
    rows = []
    for name, marker in placed(model.markers):
        with at_marker(name):
            patch, where = _place(marker, exact)
            local = rows_at(name, marker.node, fine[patch], where)
            assert local.gradient is not None
            _, spread = _gathering(numbering, patch, fine[patch].points.shape[1])
            rows.append(
                MarkerRows(
                    name=name,
                    node=marker.node,
                    position=local.position,
                    displacement=sp.csr_matrix(local.displacement @ spread),
                    rotation=sp.csr_matrix(local.rotation @ spread),
                    gradient=sp.csr_matrix(local.gradient @ spread),
                )
            )
    return tuple(rows)


def _place(marker: NodeMarker, exact: Mapping[str, NurbsPatch]) -> tuple[str, Array]:
    if marker.edge is not None:
        patch, _, side = marker.edge.rpartition(".")
        if patch not in exact or side not in FACES:
            raise InputError(
                f"there is no side {marker.edge!r}",
                place="edge",
                expected=f"PATCH.SIDE with a patch among {', '.join(exact)}",
            )
        return patch, marker_parameters(
            marker, {marker.edge: FACES[side]}, exact[patch]
        )
    if marker.position is None:
        raise InputError(
            "parameters do not say in which patch",
            expected="edge (with at) or position",
        )
    problem: InputError | None = None
    for name, candidate in exact.items():
        try:
            return name, marker_parameters(marker, {}, candidate)
        except InputError as error:
            problem = error
    assert problem is not None
    raise problem
