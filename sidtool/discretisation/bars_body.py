"""Bodies of bars and rods in a mesh file: frames, trusses, shafts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.taylor import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.model import ModelFile
from sidtool.formats.model.discretisation import MeshDiscretisation
from sidtool.formats.model.geometry import MeshGeometry

from ..beams.element import (
    MaterialPointCollector,
    ParticleCollector,
    scatter_rows,
)
from ..eigensolvers.factorisation import symmetric_factors
from ..elements.finite_element_model import (
    BeamOutline,
    FiniteElementModel,
    MarkerRows,
    fixed_marker,
)
from ..elements.markers import markers_with_position as with_places
from ..elements.markers import name_marker_in_errors
from ..elements.material_points import InertiaPoints
from ..elements.mesh_markers import position_of
from ..mesh.connections import RawBar
from ..mesh.imported_mesh import ImportedMesh, undefined_notes
from ..mesh.materials import ElasticMaterial
from ..mesh.mesh import Mesh
from ..mesh.unit_systems import UnitSystem
from .bar_elements import BarElement, bar_outline, extra_masses, make_bar_element
from .bar_nodes import BarNodes, bar_nodes, nearest_node, node_sets
from .structure_elements import (
    merge_particles,
    node_motion,
    shell_matrices,
    shell_outlines,
    solid_matrices,
    spring_matrix,
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
    property="shells: shear by TS/T, consistent mass, no stiffening by loads",
)
_HINGED = diagnose(
    "N129", limit="bars and shells that share single nodes with solids are hinged there"
)
_MAX_ARM = diagnose(
    "N129", limit="offsets and rigid couplings add no geometric stiffness"
)
_MAX_TWIST = diagnose(
    "N129", limit="the torsion of rods at nodes without bars has no effect"
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
    materials = materials or {}
    mesh = Mesh(
        imported.mesh.positions * units.length,
        imported.mesh.blocks,
        imported.mesh.node_sets,
        imported.mesh.labels,
    )
    _check_sections(imported, model)
    nodes = bar_nodes(imported, mesh)
    imported, nodes, unsupported = _resolve_pins(model, imported, nodes, units)
    nodes, more = _without_idle(model, imported, nodes, units, materials)
    unsupported += more
    ndof = int(nodes.table.max()) + 1
    particles, points = ParticleCollector(ndof), MaterialPointCollector(ndof)
    outlines: list[BeamOutline] = []
    parts: list[tuple[Array, Indices]] = []
    pieces = max(1, min(_PIECES, _SECTIONS // max(1, len(imported.bars))))
    for given in imported.bars:
        bar = _with_material(given, model, units)
        element, dofs = _bar_element(bar, nodes, units)
        parts.append((element.stiffness(), dofs))
        points.add(element, dofs)
        outlines.append(bar_outline(element, dofs, ndof, pieces))
        _add_bar_mass(particles, bar, element, dofs, units)
    _add_masses(particles, imported, nodes, units)
    others, inertia = _other_elements(imported, nodes, units, materials)
    stiffness = sp.csr_matrix(others + _assemble_bars(parts, ndof))
    if len(imported.shells) <= _PLATES:
        motion = node_motion(nodes)
        outlines += shell_outlines(imported.shells, nodes, motion, units.length)
    inertia += [particles.points()] if imported.bars or imported.masses else []
    if not inertia:
        raise InputError(
            "springs without any mass are no body",
            place="geometry",
            expected="masses (CONM2, CMASS2), or elements with a density",
        )
    used = np.flatnonzero((nodes.table >= 0).any(axis=1))
    body = FiniteElementModel(
        positions=mesh.positions[used],
        scalar_mass=None,
        stiffness=stiffness,
        node_sets=node_sets(nodes, used, imported.undefined),
        markers=_bar_markers(model, imported.bars, nodes, ndof),
        inertia_points=merge_particles(inertia),
        dof_table=nodes.table[used],
        beam_material=points.material() if alone and imported.bars else None,
        outlines=tuple(outlines),
        diagnostics=(
            *imported.diagnostics,
            *undefined_notes(imported.undefined),
            *([_SHEAR] if imported.bars else []),
            *([_SHELLS] if imported.shells else []),
            *([_HINGED] if imported.mesh.blocks else []),
            *_bar_limits(imported.bars, nodes),
            *unsupported,
        ),
    )
    _check_mechanism(body)
    return body


def _other_elements(
    imported: ImportedMesh,
    nodes: BarNodes,
    units: UnitSystem,
    materials: Mapping[str | None, ElasticMaterial],
) -> tuple[sp.csr_matrix, list[InertiaPoints]]:
    """Stiffness and particles of all elements but bars."""
    ndof = int(nodes.table.max()) + 1
    stiffness = spring_matrix(imported.springs, nodes, units, ndof)
    if not (imported.shells or imported.mesh.blocks):
        return stiffness, []
    motion = node_motion(nodes)
    total, points = shell_matrices(imported.shells, nodes, motion, units)
    if imported.mesh.blocks:
        solid, more = solid_matrices(nodes.mesh, materials, motion)
        total, points = total + solid, points + more
    return sp.csr_matrix(stiffness + total), points


def _without_idle(
    model: ModelFile,
    imported: ImportedMesh,
    nodes: BarNodes,
    units: UnitSystem,
    materials: Mapping[str | None, ElasticMaterial],
) -> tuple[BarNodes, list[Diagnostic]]:
    """Return nodes without rotations that have neither stiffness nor mass."""
    if not (imported.springs or imported.couplings):
        return nodes, []
    ndof = int(nodes.table.max()) + 1
    total, points = _other_elements(imported, nodes, units, materials)
    parts, particles = [], ParticleCollector(ndof)
    for given in imported.bars:
        element, dofs = _bar_element(_with_material(given, model, units), nodes, units)
        parts.append((element.stiffness(), dofs))
    _add_masses(particles, imported, nodes, units)
    if imported.masses:
        points = [*points, particles.points()]
    stiff = (total + _assemble_bars(parts, ndof)).diagonal()
    heavy = (
        merge_particles(points).mass_matrix().diagonal() if points else np.zeros(ndof)
    )
    turning = nodes.table[:, 3:]
    idle = (stiff <= 0) & (heavy <= 0)
    idle &= np.isin(np.arange(ndof), turning[turning >= 0])
    if not idle.any():
        return nodes, []
    number = np.where(idle, -1, np.cumsum(~idle) - 1)
    table = np.where(nodes.table >= 0, number[nodes.table], -1)
    count = np.count_nonzero(idle)
    limit = f"{count} rotations of nodes that nothing resists are left out (AUTOSPC)"
    return replace(nodes, table=table), [diagnose("N129", limit=limit)]


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
                f"shell {shell.label} has no complete material (E, nu and RHO)",
                place=shell.place,
                expected="MAT1, MAT2 or MAT8 with RHO; geometry.density adds a density "
                "(0 where CONM2 hold all mass)",
            )


def _resolve_pins(
    model: ModelFile, imported: ImportedMesh, nodes: BarNodes, units: UnitSystem
) -> tuple[ImportedMesh, BarNodes, list[Diagnostic]]:
    """Return bars and nodes without rotations that have neither stiffness nor mass.

    Such a rotation about an axis of the model is removed, as by AUTOSPC of Nastran.
    About another axis it follows a bar that is pinned there, unless a marker
    fixes it.
    """
    if not any(any(bar.pins) for bar in imported.bars):
        return imported, nodes, []
    ndof = int(nodes.table.max()) + 1
    heavy = np.zeros(ndof)
    if imported.masses:
        particles = ParticleCollector(ndof)
        _add_masses(particles, imported, nodes, units)
        heavy = particles.points().mass_matrix().diagonal()
    plain = tuple(replace(bar, pins=((), ())) for bar in imported.bars)
    whole = _bar_stiffness(model, plain, nodes, units).diagonal()
    stiff = _bar_stiffness(model, imported.bars, nodes, units).diagonal()
    unsupported = (stiff <= _FREE_STIFFNESS_TOLERANCE * whole) & (heavy <= 0)
    turning = nodes.table[:, 3:]
    unsupported &= np.isin(np.arange(ndof), turning[turning >= 0])
    number = np.where(unsupported, -1, np.cumsum(~unsupported) - 1)
    table = np.where(nodes.table >= 0, number[nodes.table], -1)
    nodes = replace(nodes, table=table)
    count = np.count_nonzero(unsupported)
    limit = f"{count} rotations of nodes that no bar resists are left out (AUTOSPC)"
    supported = whole[~unsupported], heavy[~unsupported]
    bars = _without_free_rotations(model, imported.bars, nodes, units, *supported)
    return (
        replace(imported, bars=bars),
        nodes,
        [diagnose("N129", limit=limit)] if unsupported.any() else [],
    )


def _bar_stiffness(
    model: ModelFile, bars: tuple[RawBar, ...], nodes: BarNodes, units: UnitSystem
) -> sp.csr_matrix:
    parts = []
    for given in bars:
        element, dofs = _bar_element(_with_material(given, model, units), nodes, units)
        parts.append((element.stiffness(), dofs))
    return _assemble_bars(parts, int(nodes.table.max()) + 1)


def _without_free_rotations(
    model: ModelFile,
    bars: tuple[RawBar, ...],
    nodes: BarNodes,
    units: UnitSystem,
    whole: Array,
    heavy: Array,
) -> tuple[RawBar, ...]:
    """Remove one pin for every rotation of a node that has no stiffness."""
    stiffness = _bar_stiffness(model, bars, nodes, units)
    marked = {
        marker.mesh_node or nearest_node(nodes, position_of(nodes.mesh, marker))
        for _, marker in with_places(model.markers)
        if marker.tie is None
    }
    ends: dict[int, list[tuple[int, int]]] = {}
    for k, bar in enumerate(bars):
        for end, label in enumerate(bar.nodes):
            if bar.y_axis is not None and label not in {*nodes.owner, *marked}:
                ends.setdefault(nodes.row[label], []).append((k, end))
    changed = list(bars)
    used: set[tuple[int, int]] = set()
    for row, own in ends.items():
        there = nodes.table[row, 3:] >= 0
        dofs = nodes.table[row, 3:][there]
        if not dofs.size:
            continue
        block = stiffness[dofs][:, dofs].toarray()
        values, vectors = np.linalg.eigh(block)
        free = vectors[:, values <= _FREE_STIFFNESS_TOLERANCE * whole[dofs].max()]
        if not free.shape[1] or heavy[dofs].any():
            continue
        for k, end in own:
            given = _with_material(changed[k], model, units)
            axes = _bar_element(given, nodes, units)[0].frames(np.zeros(1)).axes[0]
            for direction in changed[k].pins[end]:
                axis = axes[direction - 4] if direction > 3 else np.zeros(3)
                inside = np.linalg.norm(free.T @ axis[there])
                if inside < 1 - _COLLINEAR_TOLERANCE or (k, direction) in used:
                    continue
                used.add((k, direction))
                pins = [list(pin) for pin in changed[k].pins]
                pins[end].remove(direction)
                changed[k] = replace(changed[k], pins=(tuple(pins[0]), tuple(pins[1])))
                left = free - np.outer(axis[there], axis[there] @ free)
                u, sizes, _ = np.linalg.svd(left, full_matrices=False)
                free = u[:, sizes > 0.5]
    return tuple(changed)


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
    if imported.equations:
        raise InputError(
            "MPC beside bars or shells is not supported",
            place=imported.equations[0].place,
            expected="RBE2, RBE3 and RBAR; geometry.ignore leaves cards out",
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


def _bar_element(
    bar: RawBar, nodes: BarNodes, units: UnitSystem
) -> tuple[BarElement, Indices]:
    places = np.array(
        [
            nodes.place(label) + units.length * np.array(offset)
            for label, offset in zip(bar.nodes, bar.offsets, strict=True)
        ]
    )
    moved = [nodes.motion(n, x) for n, x in zip(bar.nodes, places, strict=True)]
    ends = scipy.linalg.block_diag(*(motion for motion, _ in moved))
    dofs = np.concatenate([dofs for _, dofs in moved])
    return make_bar_element(bar, places, ends, units), dofs


def _add_bar_mass(
    particles: ParticleCollector,
    bar: RawBar,
    element: BarElement,
    dofs: Indices,
    units: UnitSystem,
) -> None:
    """Add the mass of a bar, with its non-structural mass."""
    particles.add_slices(element, dofs, bar.density * units.mass / units.length**3)
    masses = extra_masses(bar, element, units)
    if not masses.any():
        return
    places = element.gauss_frames.places
    for rows, place, mass in zip(element.gauss_rows, places, masses, strict=True):
        move = (rows.displacement, rows.rotation, dofs)
        particles.add(place, mass, np.zeros((3, 3)), *move)


def _add_masses(
    particles: ParticleCollector,
    imported: ImportedMesh,
    nodes: BarNodes,
    units: UnitSystem,
) -> None:
    for mass in imported.masses:
        if mass.node not in nodes.row:
            raise InputError(
                f"the mass at node {mass.node} has no node",
                place=mass.place,
                expected="a node of this file",
            )
        place = nodes.place(mass.node) + units.length * np.array(mass.offset)
        motion, dofs = nodes.motion(mass.node, place)
        fixed = not motion[3:].any()
        incomplete = fixed and (any(mass.offset) or any(mass.inertia))
        if not len(dofs) or incomplete:
            raise InputError(
                f"the mass at node {mass.node} is held by no bar"
                + (" that turns it" if incomplete else ""),
                place=mass.place,
                expected="a node of bars or of a rigid coupling to one",
            )
        xx, yy, zz, xy, yz, zx = mass.inertia
        tensor = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
        tensor = tensor * (units.mass * units.length**2)
        heavy = mass.mass * units.mass
        particles.add(place, heavy, tensor, motion[:3], motion[3:], dofs)


def _assemble_bars(parts: list[tuple[Array, Indices]], ndof: int) -> sp.csr_matrix:
    if not parts:
        return sp.csr_matrix((ndof, ndof))
    i = np.concatenate([np.repeat(dofs, len(dofs)) for _, dofs in parts])
    j = np.concatenate([np.tile(dofs, len(dofs)) for _, dofs in parts])
    values = np.concatenate([(k + k.T).ravel() / 2 for k, _ in parts])
    return sp.csr_matrix((values, (i, j)), shape=(ndof, ndof))


def _beam_direction(
    bars: tuple[RawBar, ...], nodes: BarNodes, label: int
) -> Array | None:
    """Return the direction of the beam whose cross-section contains a node, if there is
    one.
    """
    arms = [
        nodes.place(bar.nodes[1]) - nodes.place(bar.nodes[0])
        for bar in bars
        if label in bar.nodes and bar.y_axis is not None
    ]
    arms = [arm / np.linalg.norm(arm) for arm in arms if arm.any()]
    if not arms or any(abs(arm @ arms[0]) < 1 - _COLLINEAR_TOLERANCE for arm in arms):
        return None
    return np.asarray(arms[0])


def _bar_markers(
    model: ModelFile, bars: tuple[RawBar, ...], nodes: BarNodes, ndof: int
) -> tuple[MarkerRows, ...]:
    markers = []
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
            markers.append(
                MarkerRows(name, marker.node, nodes.place(label), move, turn)
            )
    return tuple(markers)


def _bar_limits(bars: tuple[RawBar, ...], nodes: BarNodes) -> list[Diagnostic]:
    is_limited = any(
        bar.y_axis is None
        and any(v for _, v in bar.section.torsion)
        and any(len(nodes.motion(n, nodes.place(n))[1]) < 6 for n in bar.nodes)
        for bar in bars
    )
    arms = bool(nodes.owner or nodes.partly_dependent or nodes.means) or any(
        any(w) for b in bars for w in b.offsets
    )
    return [_MAX_TWIST] * is_limited + [_MAX_ARM] * arms


def _check_mechanism(body: FiniteElementModel) -> None:
    """Check that only rigid motions have no energy, and that all of them have
    inertia.
    """
    count = min(7, body.ndof)
    k, m = body.stiffness, body.mass
    heavy = m.diagonal() > 0
    gram = body.rigid_body_modes(body.positions.mean(axis=0))
    gram = gram.T @ (m @ gram)
    size = np.sqrt(gram.diagonal())
    if (
        not size.all()
        or np.linalg.cond(gram / np.outer(size, size)) > 1 / _MECHANISM_TOLERANCE
    ):
        raise InputError(
            "a rigid motion of the body has no inertia",
            place="mesh",
            expected="a density above zero, or masses with inertia or off one line",
        )
    largest = float((k.diagonal()[heavy] / m.diagonal()[heavy]).max())
    shift = _EIGENVALUE_SHIFT * largest
    try:
        if (
            body.ndof <= 600
        ):  # with exchanged matrices, because massless motions have m = 0
            raised = (k + shift * m).toarray()
            first = body.ndof - count
            inverse = scipy.linalg.eigh(
                m.toarray(),
                raised,
                eigvals_only=True,
                subset_by_index=[first, body.ndof - 1],
            )
            values = 1 / inverse - shift
        else:
            factors = symmetric_factors(
                sp.csr_matrix(k + shift * m), body.dof_positions
            )
            values = sp.linalg.eigsh(
                k,
                count,
                m,
                sigma=-shift,
                OPinv=sp.linalg.LinearOperator(k.shape, factors.solve),
                return_eigenvectors=False,
                v0=np.ones(body.ndof),
            )
    except (np.linalg.LinAlgError, RuntimeError):  # of SuperLU: singular
        values = np.zeros(count)
    if max(values) < _MECHANISM_TOLERANCE * largest:
        raise InputError(
            "the elements move without deforming: the body is a mechanism, or lies on "
            "one line that nothing twists",
            place="mesh",
            expected="elements that hold each other; rods alone need triangles in "
            "space, membranes neighbours in other planes",
        )
