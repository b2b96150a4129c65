"""Bodies of bars and rods in a mesh file: frames, trusses, shafts."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.model import ModelFile
from sidtool.formats.model.discretisation import MeshDiscretisation
from sidtool.formats.model.geometry import MeshGeometry
from sidtool.formats.text import counted_noun

from ..beams.element import (
    MaterialPointCollector,
    ParticleCollector,
    assemble,
    scatter_rows,
)
from ..elements.finite_element_model import (
    BeamOutline,
    FiniteElementModel,
    MarkerRows,
    fixed_marker,
)
from ..elements.markers import (
    markers_with_position as with_places,
    name_marker_in_errors,
    position_of,
)
from ..mesh.connections import RawBar
from ..mesh.imported_mesh import ImportedMesh, undefined_notes
from ..mesh.materials import ElasticMaterial
from ..mesh.mesh import Mesh
from ..mesh.unit_systems import UnitSystem
from .bar_elements import Bar, bar_of_deck, bar_outline
from .bar_nodes import BarNodes, bar_nodes, nearest_node, node_sets
from .imported_constraints import structure_equations
from .structure import (
    Structure,
    add_bar_mass,
    check_mechanism,
    markers_without_rotation,
    without_unsupported,
)
from .structure_elements import (
    merge_particles,
    node_motion,
    shell_outlines,
)

Indices = NDArray[np.int64]

#: Largest number of segments of a bar in pictures, and of all bars together.
_PIECES, _SECTIONS = 8, 1000
#: Shells in pictures at most.
_PLATES = 20_000
#: Relative eigenvalue below which a deformation has no energy.
_MECHANISM_TOLERANCE = 1e-13
#: Shift of the eigenvalue search, relative to the largest eigenvalue.
_EIGENVALUE_SHIFT = 1e-9
#: Stiffness below this share of that without pins is none.
_FREE_STIFFNESS_TOLERANCE = 1e-12
#: Cosines of bars in one line differ from one by less.
_COLLINEAR_TOLERANCE = 1e-9
_SHEAR = diagnose(
    "N125",
    property="bars: shear by K1 and K2, consistent mass with rotary inertia (COUPMASS)",
)
_SHELLS = diagnose(
    "N125",
    property="shells: MITC4 and MITC3, shear of 5/6 (or TS/T), consistent mass, no "
    "stiffening by loads",
)
_NO_STIFFENING = diagnose(
    "N129",
    limit="RBE3 and RBE2 of some directions add no geometric stiffness",
    remedy="Hold all six directions by RBE2, or leave [stiffening] out.",
)
_MAX_TWIST = diagnose(
    "N129",
    limit="the torsion of rods at nodes without bars has no effect",
    remedy="Use bars instead, or leave the torsion out.",
)


def bars_model(
    model: ModelFile,
    imported: ImportedMesh,
    units: UnitSystem,
    materials: Mapping[str | None, ElasticMaterial] | None = None,
) -> FiniteElementModel:
    """Return the body of bars, shells, springs and solids with rotational degrees of
    freedom.

    Parameters
    ----------
    materials : of solid elements, in SI units

    Raises
    ------
    InputError : the bars are not connected or form a mechanism, a marker is at no node,
        or the model file requests features of other elements.
    """
    _check_choices(model, imported)
    alone = not (imported.shells or imported.mesh.blocks)
    mesh = Mesh(
        imported.mesh.positions * units.length,
        imported.mesh.blocks,
        imported.mesh.node_sets,
        imported.mesh.labels,
    )
    _check_sections(imported, model)
    bars = _bars_in_si(imported, mesh, model, units)
    nodes = bar_nodes(imported, bars, mesh)
    structure = Structure(imported, bars, nodes, units, materials or {})
    structure, unsupported = without_unsupported(structure, partial(_marked, model))
    nodes, ndof = structure.nodes, structure.ndof
    particles, points = ParticleCollector(ndof), MaterialPointCollector(ndof)
    parts: list[tuple[Array, Indices]] = []
    for bar in structure.bars:
        element, dofs = structure.bar_element(bar)
        parts.append((element.stiffness(), dofs))
        points.add(element, dofs)
        add_bar_mass(particles, bar, element, dofs)
    structure.add_masses(particles)
    others, inertia = structure.other_elements()
    stiffness = sp.csr_matrix(others + assemble(parts, ndof))
    inertia += [particles.points()] if imported.bars or imported.masses else []
    if not inertia:
        raise InputError(
            "springs without any mass are no body",
            place="geometry",
            expected="masses (CONM2, CMASS2), or elements with a density",
        )
    used = np.flatnonzero((nodes.table >= 0).any(axis=1))
    markers = _bar_markers(model, structure)
    body = FiniteElementModel(
        positions=mesh.positions[used],
        scalar_mass=None,
        stiffness=stiffness,
        node_sets=node_sets(nodes, used, imported.undefined),
        markers=markers,
        inertia_points=merge_particles(inertia),
        dof_table=nodes.table[used],
        beam_material=points.material() if alone and imported.bars else None,
        bar_ends=structure.bar_ends() if alone and imported.bars else None,
        outlines=lambda: tuple(_outlines(structure)),
        diagnostics=(
            *imported.diagnostics,
            *undefined_notes(imported.undefined),
            *([_SHEAR] if imported.bars else []),
            *([_SHELLS] if imported.shells else []),
            *_hinges(imported),
            *_bar_limits(imported.bars, nodes, bool(model.stiffening)),
            *unsupported,
            *markers_without_rotation(markers),
        ),
    )
    equations, found = structure_equations(
        imported.equations, nodes, body, units.length
    )
    body = replace(body, equations=equations, diagnostics=(*body.diagnostics, *found))
    check_mechanism(body)
    return body


def _outlines(structure: Structure) -> Iterator[BeamOutline]:
    """Yield the outlines of bars, and of shells that are not too many."""
    shells, nodes = structure.imported.shells, structure.nodes
    pieces = max(1, min(_PIECES, _SECTIONS // max(1, len(structure.bars))))
    for bar in structure.bars:
        yield bar_outline(*structure.bar_element(bar), structure.ndof, pieces)
    if len(shells) <= _PLATES:
        motion = node_motion(nodes)
        yield from shell_outlines(shells, nodes, motion, structure.units.length)


def _hinges(imported: ImportedMesh) -> list[Diagnostic]:
    """Name nodes of solids at which bars, shells or springs are hinged (N129).

    A solid resists no rotation of its nodes. An element with all nodes in one solid
    element follows the rotation of that, and holds what continues it.
    """
    solids: dict[int, set[tuple[int, int]]] = {}
    for number, block in enumerate(imported.mesh.blocks):
        for element, nodes in enumerate(imported.mesh.labels[block.nodes].tolist()):
            for node in nodes:
                solids.setdefault(node, set()).add((number, element))
    members: list[tuple[int, ...]] = []
    members += [bar.nodes for bar in imported.bars if bar.y_axis is not None]
    members += [shell.nodes for shell in imported.shells if shell.section.flexural]
    members += [
        tuple(n for n in spring.nodes if n is not None)
        for spring in imported.springs
        if any(spring.stiffness[3:])
    ]
    hinged, held = set[int](), set[int]()
    for coupling in imported.couplings:
        followers = coupling.nodes if coupling.rigid and coupling.turns else ()
        held.update(
            followers
            if coupling.reference is None
            else (*followers, coupling.reference)
        )
    for nodes in members:
        shared = [n for n in nodes if n in solids]
        inside = set.intersection(*(solids.get(n, set()) for n in nodes))
        (held if inside and len(nodes) > 1 else hinged).update(shared)
    names = sorted(hinged - held)
    if not names:
        return []
    some = ", ".join(map(str, names[:3])) + (", ..." if names[3:] else "")
    limit = f"hinged at {counted_noun(len(names), 'node')} of solids ({some})"
    remedy = "Continue bars and shells by an element along the solid, or use an RBE3."
    return [diagnose("N129", limit=limit, remedy=remedy)]


def _bars_in_si(
    imported: ImportedMesh, mesh: Mesh, model: ModelFile, units: UnitSystem
) -> tuple[Bar, ...]:
    row = {int(label): i for i, label in enumerate(mesh.labels)}
    return tuple(
        bar_of_deck(
            _with_material(bar, model, units),
            mesh.positions[[row[n] for n in bar.nodes]],
            units,
        )
        for bar in imported.bars
    )


def _marked(model: ModelFile, structure: Structure) -> set[int]:
    """Return the labels of nodes at which markers or equations are."""
    nodes = structure.nodes
    return structure.imported.nodes_in_equations | {
        marker.mesh_node or nearest_node(nodes, position_of(nodes.mesh, marker))
        for _, marker in with_places(model.markers)
        if marker.tie is None
    }


def _check_sections(imported: ImportedMesh, model: ModelFile) -> None:
    """Check that the materials of shells are complete.

    Raises
    ------
    InputError : a material is not complete, or [material] would replace layers.
    """
    if imported.shells and model.material is not None:
        raise InputError(
            "is not for shells",
            place="material",
            expected="materials of the file; geometry.density completes them",
        )
    for shell in imported.shells:
        if not shell.section.complete:
            raise InputError(
                f"shell {shell.label} has no complete material (E, nu and density)",
                place=shell.place,
                expected="all three in the file; geometry.density adds a density "
                "(in a .bdf 0 where CONM2 hold all mass)",
            )


def _check_choices(model: ModelFile, imported: ImportedMesh) -> None:
    geometry, settings = model.geometry, model.discretisation
    assert isinstance(geometry, MeshGeometry)
    assert isinstance(settings, MeshDiscretisation)
    for place, given in (
        ("geometry.thickness", geometry.thickness),
        ("discretisation.formulation", settings.formulation),
        ("discretisation.state", settings.state),
    ):
        if given is not None:
            raise InputError(
                "is not for bars", place=place, expected="what the file says of them"
            )
    if imported.ties:
        raise InputError(
            "*TIE of shells is not supported",
            place=imported.ties[0].place,
            expected="meshes that share nodes, or *COUPLING; geometry.ignore leaves it "
            "out",
        )


def _with_material(bar: RawBar, model: ModelFile, units: UnitSystem) -> RawBar:
    """Apply the material of the model file, if there is one, in units of the file."""
    material, geometry = model.material, model.geometry
    assert isinstance(geometry, MeshGeometry)
    if material is not None:
        e, density = material.youngs_modulus, material.density
        stress = units.mass / units.length / units.time**2
        g = e / (2 * (1 + material.poissons_ratio))
        heavy = density * units.length**3 / units.mass
        return replace(bar, e=e / stress, g=g / stress, density=heavy)
    massless = bar.density == 0 and geometry.density == 0
    if min(bar.e, bar.g) <= 0 or (bar.density <= 0 and not massless):
        raise InputError(
            f"element {bar.label} has no complete material (E, G or nu, and RHO)",
            place=bar.place,
            expected="MAT1 with E, nu and RHO; geometry.density adds a density (0 "
            "where CONM2 hold all mass), a table [material] replaces all",
        )
    return bar


def _bar_markers(model: ModelFile, structure: Structure) -> tuple[MarkerRows, ...]:
    markers, nodes, ndof = [], structure.nodes, structure.ndof
    for name, marker in with_places(model.markers):
        with name_marker_in_errors(name):
            where = position_of(nodes.mesh, marker)
            if marker.tie is not None:
                markers.append(fixed_marker(name, marker.node, where, ndof))
                continue
            label = marker.mesh_node or nearest_node(nodes, where)
            motion, dofs = nodes.motion(label, nodes.place(label))
            if not len(dofs):
                raise InputError(
                    f"node {label} is held by no bar",
                    place="mesh_node",
                    expected="a node of bars",
                )
            move, turn = (
                scatter_rows(part, dofs, ndof) for part in (motion[:3], motion[3:])
            )
            tangent = structure.continued.get(structure.base(label))
            place = nodes.place(label)
            markers.append(
                MarkerRows(name, marker.node, place, move, turn, tangent=tangent)
            )
    return tuple(markers)


def _bar_limits(
    bars: tuple[RawBar, ...], nodes: BarNodes, stiffened: bool
) -> list[Diagnostic]:
    is_limited = any(
        bar.y_axis is None
        and any(v for _, v in bar.section.torsion)
        and any(len(nodes.motion(n, nodes.place(n))[1]) < 6 for n in bar.nodes)
        for bar in bars
    )
    couplings = stiffened and bool(nodes.partly_dependent or nodes.means)
    return [_MAX_TWIST] * is_limited + [_NO_STIFFENING] * couplings
