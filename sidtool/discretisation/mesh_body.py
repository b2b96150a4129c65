"""Bodies with a mesh of another program."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.model import Material, ModelFile
from sidtool.formats.model.discretisation import MeshDiscretisation
from sidtool.formats.model.geometry import MeshGeometry

from ..elements.faces import named_surface
from ..elements.finite_element_model import FiniteElementModel, fixed_marker
from ..elements.markers import (
    MeshPoints,
    markers_with_position,
    name_marker_in_errors,
    position_of,
)
from ..elements.mass_properties import GeometryMass, mesh_moments
from ..elements.mesh_contact import check_conforming, check_contact
from ..elements.solid_mesh import (
    Amplitudes,
    SolidMesh,
    mesh_continua,
    mesh_matrices,
)
from ..importers.mesh_files import read_mesh
from ..importers.nastran.shells import beyond_calculix, is_bulk
from ..mesh.connections import NamedSets
from ..mesh.imported_mesh import ImportedMesh, undefined_notes
from ..mesh.materials import AnisotropicMaterial, CylindricalMaterial, ElasticMaterial
from ..mesh.mesh import Mesh, check_mesh, counter_clockwise, without_free_nodes
from ..mesh.unit_systems import UnitSystem, unit_system
from .bars_body import bars_model
from .calculix_body import DependentNodes, calculix_model
from .imported_constraints import (
    body_couplings,
    body_equations,
    body_masses,
    nodes_in_equations,
    nodes_of_equations,
)
from .mesh_morphs import with_morphs

#: Upper limits of density [kg/m^3] and stiffness [Pa] of solids; larger values indicate
#: other units.
_MAX_DENSITY, _MAX_STIFFNESS = 1e5, 1e13
Materials = Mapping[str | None, ElasticMaterial]


def imported_mesh_model(model: ModelFile) -> FiniteElementModel:
    """Return the body of a model file whose geometry is a mesh file.

    Nodes that no element uses (reference points of couplings, construction points)
    are removed; a tied marker may be at one. A material in the model file applies to
    all elements.

    Raises
    ------
    InputError : the file is not valid; the error names the file and the reason.
    """
    geometry, settings = model.geometry, model.discretisation
    assert isinstance(geometry, MeshGeometry)
    assert isinstance(settings, MeshDiscretisation)
    units = _file_units(geometry)
    bending = geometry.engine == "calculix"
    density = file_density(model, units)
    engine_notes: tuple[Diagnostic, ...] = ()
    if bending and geometry.morphs:
        raise InputError(
            "moves nodes, and elements of CalculiX keep theirs",
            place="geometry.morphs",
            expected="no geometry.engine",
        )
    if bending:
        try:
            reason = beyond_calculix(
                Path(geometry.file), geometry.ignore, density, order=geometry.order
            )
            if not reason:
                return calculix_model(model, units, density)
        except DependentNodes as error:
            if not (is_bulk(geometry.file) or _has_own_shells(geometry, density)):
                raise error.located(geometry.file) from None
            reason = "edges where its shells meet"
        engine_notes = (diagnose("N132", reason=reason),)
        if geometry.order is not None:
            reason = "it is for elements of CalculiX alone"
            engine_notes += (diagnose("N145", "geometry.order", reason=reason),)
    elif geometry.order is not None:
        raise InputError(
            "is for elements of CalculiX alone",
            place="geometry.order",
            expected='geometry.engine = "calculix", or a mesh of that order',
        )

    def read(file: str) -> ImportedMesh:
        found = read_mesh(
            file, geometry.ignore, geometry.part, density, bending=bending
        )
        return replace(found, mesh=counter_clockwise(found.mesh))

    imported = read(geometry.file)
    found = (*imported.diagnostics, *engine_notes)
    if negative := [m.mass for m in imported.masses if m.mass < 0]:
        total = sum(negative) * units.mass
        found += (diagnose("N146", count=len(negative), total=total),)
    imported = replace(imported, diagnostics=found)
    try:
        imported = with_morphs(imported, geometry, units.length, read)
        if density == 0 and not imported.is_structure:
            raise InputError(
                "is zero, and solids and plane elements need mass at every node",
                place="geometry.density",
                expected="a density above zero",
            )
        if imported.is_structure:
            held = _file_materials(imported, geometry, units)
            laws = _body_materials(model, imported.mesh, held)
            body = bars_model(model, imported, units, laws)
            known = [m.density for m in held.values()]
            factor = units.mass / units.length**3
            known += [bar.density * factor for bar in imported.bars]
            found = (*body.diagnostics, *_density_notes(geometry, known))
            return replace(body, diagnostics=found)
        _check_element_choices(geometry, settings, imported)
        whole = _scale_mesh(imported.mesh, geometry, settings, units)
        mesh = without_free_nodes(whole)
        plain = replace(mesh, positions=mesh.positions.real)
        moved = any(morph.amount != 0.0 for morph in geometry.morphs.values())
        what = "mesh with geometry.morphs" if moved else "mesh"
        couplings = body_couplings(imported, whole, mesh, model)
        masses = body_masses(imported, couplings, mesh, units)
        equations, equation_notes = body_equations(imported, whole, mesh, units.length)
        joined = [c.nodes for c in couplings if c.rigid]
        check_mesh(
            plain, what, [*joined, *nodes_of_equations(equations, mesh.dimension)]
        )
        straight = np.flatnonzero(np.isin(mesh.labels, list(imported.straight)))
        check_conforming(plain, what, straight)
        check_contact(plain, what, nodes_in_equations(equations, mesh, imported.ties))
        own = _file_materials(imported, geometry, units)
        materials = _body_materials(model, mesh, own)
        plane = mesh.dimension == 2
        state = _plane_state(settings, imported) if plane else "solid"
        if plane:
            _check_thickness(mesh)
        amplitudes: Amplitudes = {}
        mass, stiffness = mesh_matrices(
            mesh, materials, state, incompatible_modes=True, amplitudes=amplitudes
        )
    except InputError as error:
        raise error.located(geometry.file) from None
    continua = mesh_continua(mesh, materials, state, incompatible_modes=True)
    solids = SolidMesh(mesh, materials, state, incompatible_modes=True)
    points = MeshPoints(mesh, continua)
    markers = []
    coupled = {name for coupling in couplings for name in coupling.markers}
    for name, marker in markers_with_position(model.markers):
        with name_marker_in_errors(name):
            if marker.tie is None and name not in coupled:
                where = position_of(mesh, marker)
                markers.append(points.rows(name, marker.node, where))
            else:
                where = position_of(whole, marker)
                markers.append(
                    fixed_marker(name, marker.node, where, mesh.positions.size)
                )
    return FiniteElementModel(
        positions=mesh.positions,
        scalar_mass=mass,
        stiffness=stiffness,
        node_sets=NamedSets(mesh.node_sets, imported.undefined),
        surface=named_surface(mesh, mesh.node_sets),
        markers=tuple(markers),
        continua=continua,
        internal_inertia=solids.internal_inertia(amplitudes),
        solids=solids,
        couplings=couplings,
        point_masses=masses,
        equations=equations,
        diagnostics=(
            *imported.diagnostics,
            *undefined_notes(imported.undefined),
            *equation_notes,
            *_import_notes(model, imported, own),
        ),
        geometry_mass=lambda: GeometryMass(*mesh_moments(plain, materials)),
    )


def _has_own_shells(geometry: MeshGeometry, density: float | None) -> bool:
    """Return whether the elements of sidtool represent an .inp with shells."""
    try:
        imported = read_mesh(geometry.file, geometry.ignore, geometry.part, density)
    except InputError:
        return False
    return bool(imported.shells) and not imported.ties


def file_density(model: ModelFile, units: UnitSystem) -> float | None:
    """Return the density that completes materials of the file, in its units.

    Raises
    ------
    InputError : [material] gives all materials already.
    """
    geometry = model.geometry
    assert isinstance(geometry, MeshGeometry)
    if geometry.density is None:
        return None
    if model.material is not None:
        raise InputError(
            "completes materials of the file, which [material] replaces",
            place="geometry.density",
            expected="one of them",
        )
    return geometry.density * units.length**3 / units.mass


def _check_element_choices(
    geometry: MeshGeometry, settings: MeshDiscretisation, imported: ImportedMesh
) -> None:
    """Refuse choices for elements that the mesh does not have.

    Raises
    ------
    InputError : names the choice.
    """
    plane = imported.mesh.dimension == 2
    linear = any(b.kind in ("hex8", "quad4") for b in imported.mesh.blocks)
    for place, value, has_effect, elements in (
        ("geometry.thickness", geometry.thickness, plane, "plane elements"),
        ("discretisation.state", settings.state, plane, "plane elements"),
        ("discretisation.formulation", settings.formulation, linear, "hex8 and quad4"),
    ):
        if value is not None and not has_effect:
            raise InputError(
                f"is for {elements}, which this mesh does not have",
                place=place,
                expected="no such key",
            )


def _density_notes(
    geometry: MeshGeometry, densities: list[float]
) -> Iterator[Diagnostic]:
    """Yield what `geometry.density` did (N121, N145).

    Parameters
    ----------
    densities : of the materials of the file, after they were completed [kg/m^3]
    """
    given = geometry.density
    if given is None:
        return
    if any(math.isclose(own, given, rel_tol=1e-9) for own in densities):
        yield diagnose("N121", density=given)
    else:
        reason = "all materials of the file have a density"
        yield diagnose("N145", "geometry.density", reason=reason)


def _file_units(geometry: MeshGeometry) -> UnitSystem:
    """The units of the file; with a length alone, newton and second."""
    if isinstance(geometry.unit, str):
        try:
            return unit_system(geometry.unit)
        except InputError as error:
            raise InputError(
                error.problem, place="geometry.unit", expected=error.expected
            ) from None
    return UnitSystem("", geometry.unit, 1 / geometry.unit, 1.0, "N")


def _scale_mesh(
    mesh: Mesh, geometry: MeshGeometry, settings: MeshDiscretisation, units: UnitSystem
) -> Mesh:
    """The mesh in metres, with the choices of the model file."""
    blocks = []
    for block in mesh.blocks:
        own = None if block.thickness is None else block.thickness * units.length
        blocks.append(
            replace(
                block,
                thickness=geometry.thickness or own,
                formulation=settings.formulation or block.formulation,
            )
        )
    positions = mesh.positions * units.length
    return replace(mesh, positions=positions, blocks=tuple(blocks))


def _file_materials(
    imported: ImportedMesh, geometry: MeshGeometry, units: UnitSystem
) -> dict[str, ElasticMaterial]:
    """The materials of the file in SI units."""
    stress = units.mass / units.length / units.time**2
    density = units.mass / units.length**3
    result: dict[str, ElasticMaterial] = {}
    for name, own in imported.materials.items():
        if isinstance(own, AnisotropicMaterial):
            result[name] = own.scaled(stress, density, units.length)
            continue
        result[name] = Material(
            youngs_modulus=own.youngs_modulus * stress,
            poissons_ratio=own.poissons_ratio,
            density=own.density * density,
        )
    return result


def _body_materials(
    model: ModelFile, mesh: Mesh, own: Mapping[str, ElasticMaterial]
) -> dict[str | None, ElasticMaterial]:
    names = {block.material for block in mesh.blocks}
    if model.material is not None:
        return dict.fromkeys(names, model.material)
    result: dict[str | None, ElasticMaterial] = {}
    for name in names:
        if name is None or name not in own:
            what = "elements without a material" if name is None else f"material {name}"
            raise InputError(
                f"has {what}, of which E, nu or density is not known: it is missing, "
                "or has values for several temperatures",
                expected="complete and constant materials in the mesh file; "
                "geometry.density adds a density, a table [material] replaces them",
            )
        _check_units(name, own[name])
        result[name] = own[name]
    return result


def _check_units(name: str, material: ElasticMaterial) -> None:
    if isinstance(material, AnisotropicMaterial):
        stiffest = float(material.law.diagonal().max())
    else:
        stiffest = material.youngs_modulus
    if material.density > _MAX_DENSITY or stiffest > _MAX_STIFFNESS:
        raise InputError(
            f"material {name} would have {_describe_material(material)}",
            place="geometry.unit",
            expected='the units that the file is written in, such as "mm-t-s" or '
            '"mm-kg-ms", or a table [material]',
        )


def _plane_state(settings: MeshDiscretisation, imported: ImportedMesh) -> str:
    state = settings.state or imported.state
    if state is None:
        raise InputError(
            "is missing",
            place="discretisation.state",
            expected="plane_stress or plane_strain, which this file does not say; "
            'geometry.engine = "calculix" makes shells of the elements of a .bdf',
        )
    return state


def _check_thickness(mesh: Mesh) -> None:
    if any(block.thickness is None for block in mesh.blocks):
        raise InputError(
            "is missing", place="geometry.thickness", expected="that of plane elements"
        )


def _import_notes(
    model: ModelFile, imported: ImportedMesh, own: Mapping[str, ElasticMaterial]
) -> Iterator[Diagnostic]:
    """Yield what the model file replaces in the mesh file, and what it uses (N114 to
    N121).
    """
    blocks, geometry, settings = (
        imported.mesh.blocks,
        model.geometry,
        model.discretisation,
    )
    assert isinstance(geometry, MeshGeometry)
    assert isinstance(settings, MeshDiscretisation)
    named = {b.material for b in blocks if b.material is not None}
    yield from _density_notes(geometry, [m.density for m in own.values()])
    if model.material is None:
        for name in sorted(named):
            description = _describe_material(own[name], imported.mesh.dimension)
            yield diagnose("N117", name=name, properties=description)
    elif named:
        yield diagnose("N116", key="[material]", replaced=", ".join(sorted(named)))
    depths = {b.thickness for b in blocks if b.thickness is not None}
    if geometry.thickness is not None and depths:
        listed = ", ".join(f"{depth:g}" for depth in sorted(depths))
        yield diagnose("N116", key="geometry.thickness", replaced=listed)
    if settings.state and imported.state and settings.state != imported.state:
        yield diagnose("N116", key="discretisation.state", replaced=imported.state)
    chosen = {b.formulation for b in blocks if b.kind in ("hex8", "quad4")}
    if settings.formulation and chosen - {None, settings.formulation}:
        replaced = "the formulation of the elements"
        yield diagnose("N116", key="discretisation.formulation", replaced=replaced)
    if not settings.formulation and None in chosen:
        replacement = "incompatible modes, as the file gives no formulation"
        yield diagnose("N114", type="hex8, quad4", replacement=replacement)


def _describe_material(material: ElasticMaterial, dimension: int = 3) -> str:
    if isinstance(material, AnisotropicMaterial):
        moduli = ", ".join(f"{value:g}" for value in material.moduli[:dimension])
        turning = isinstance(material, CylindricalMaterial)
        axes = (
            "radius, circumference and axis"
            if turning
            else "x, y, z"[: 3 * dimension - 2]
        )
        return (
            f"E along {axes} = {moduli} Pa, not isotropic, "
            f"density = {material.density:g} kg/m^3"
        )
    return (
        f"E = {material.youngs_modulus:g} Pa, nu = {material.poissons_ratio:g}, "
        f"density = {material.density:g} kg/m^3"
    )
