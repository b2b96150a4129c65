"""Bodies whose mesh another program made."""

from __future__ import annotations

from dataclasses import replace

from formats.errors import InputError
from formats.model import Material, ModelFile
from formats.model_discretisation import MeshDiscretisation
from formats.model_geometry import MeshGeometry

from ..importers.imported import ImportedMesh
from ..importers.meshes import read_mesh
from .conformity import check_conforming
from .finite_element_model import FiniteElementModel
from .mesh import check_mesh, without_free_nodes
from .mesh_points import MeshPoints
from .named_sets import NamedSets
from .patch_markers import at_marker, placed
from .solids import mesh_continua, mesh_matrices


def imported_mesh_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file whose geometry is a mesh file.

    Nodes that no element uses (reference points of couplings, construction points)
    are left out. A material in the model file holds for all elements.

    Raises
    ------
    InputError : names the file and what is wrong in it.
    """
    geometry, settings = model.geometry, model.discretisation
    assert isinstance(geometry, MeshGeometry)
    assert isinstance(settings, MeshDiscretisation)
    imported = read_mesh(geometry.file)
    mesh = without_free_nodes(imported.mesh)
    mesh = replace(mesh, positions=mesh.positions * geometry.unit)
    plane = mesh.dimension == 2
    try:
        check_mesh(mesh, "mesh")
        check_conforming(mesh, "mesh")
        materials = _materials(model, imported)
        state = _state(settings, imported) if plane else "solid"
        thickness = _thickness(geometry, imported) if plane else 1.0
        relieved = settings.formulation == "incompatible_modes"
        mass, stiffness = mesh_matrices(
            mesh, materials, state, thickness=thickness, incompatible_modes=relieved
        )
    except InputError as error:
        raise error.located(geometry.file) from None
    continua = mesh_continua(
        mesh, materials, state, thickness=thickness, incompatible_modes=relieved
    )
    points = MeshPoints(mesh, continua)
    markers = []
    for name, marker in placed(model.markers):
        with at_marker(name):
            where = points.position_of(marker)
            markers.append(points.rows(name, marker.node, where))
    return FiniteElementModel(
        positions=mesh.positions,
        scalar_mass=mass,
        stiffness=stiffness,
        node_sets=NamedSets(mesh.node_sets),
        markers=tuple(markers),
        continua=continua,
    )


def _materials(model: ModelFile, imported: ImportedMesh) -> dict[str | None, Material]:
    names = {block.material for block in imported.mesh.blocks}
    if model.material is not None:
        return dict.fromkeys(names, model.material)
    result: dict[str | None, Material] = {}
    for name in names:
        if name is None or name not in imported.materials:
            what = "elements without a material" if name is None else f"material {name}"
            raise InputError(
                f"has {what}, of which E, nu and density are not known",
                expected="complete and constant materials in the mesh file, or a table "
                "[material]",
            )
        result[name] = imported.materials[name]
    return result


def _state(settings: MeshDiscretisation, imported: ImportedMesh) -> str:
    state = settings.state or imported.state
    if state is None:
        raise InputError(
            "is missing",
            place="discretisation.state",
            expected="plane_stress or plane_strain, which this file does not say",
        )
    return state


def _thickness(geometry: MeshGeometry, imported: ImportedMesh) -> float:
    if geometry.thickness is not None:
        return geometry.thickness
    if imported.thickness is None:
        raise InputError(
            "is missing", place="geometry.thickness", expected="that of plane elements"
        )
    return imported.thickness * geometry.unit
