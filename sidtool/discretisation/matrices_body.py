"""Bodies with matrices of another program."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import diagnose
from sidtool.formats.model import ModelFile, NodeMarker
from sidtool.formats.model.geometry import MatricesGeometry

from ..elements.finite_element_model import FiniteElementModel, MarkerRows, fixed_marker
from ..elements.markers import markers_with_position, name_marker_in_errors
from ..importers.matrices import ImportedMatrices, read_arrays, read_matrices
from ..importers.matrix_market import (
    balance_stiffness,
    check_definite,
    check_digits,
    check_rigid_motion,
    complete_symmetric,
    printed_rounding_of,
    scalar_mass,
)
from ..mesh.connections import NamedSets
from ..mesh.quadratic_fields import softest_deformation
from .structure import markers_without_rotation

Indices = NDArray[np.int64]

#: Entries of a mass matrix, relative to its diagonal, that are rounding.
_NO_COUPLING = 1e-9


def imported_matrices_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file whose geometry is a set of matrices.

    A marker must be at a node. At nodes without rotational degrees of freedom it has no
    rotation (tie it to a node set to get one).

    Raises
    ------
    InputError : the file is not valid; the error names the file and the reason.
    """
    geometry = model.geometry
    assert isinstance(geometry, MatricesGeometry)
    source = geometry.file or geometry.stiffness or ""
    if geometry.file is not None:
        data = read_arrays(geometry.file)
    else:
        assert geometry.stiffness and geometry.mass and geometry.nodes
        data = read_matrices(
            geometry.stiffness, geometry.mass, geometry.nodes, geometry.dofs
        )
    try:
        body = matrices_body(data, model.markers, geometry.expected_mass)
    except InputError as error:
        if error.place and error.place.startswith("markers"):
            raise
        raise error.located(source) from None
    frame = getattr(model.frame, "marker", None)
    untied = [
        marker
        for marker in body.markers
        if model.markers[marker.name].tie is None and marker.name != frame
    ]
    found = markers_without_rotation(untied, "z" if body.dimension == 2 else "xyz")
    return replace(body, diagnostics=(*body.diagnostics, *found))


def matrices_body(
    data: ImportedMatrices, named: Mapping[str, NodeMarker], expected_mass: float | None
) -> FiniteElementModel:
    """Return a body with markers, after checks of its matrices.

    Raises
    ------
    InputError : the matrices are not those of a free body, or a marker is at no node.
    """
    table, rows = _dof_table(data)
    k = complete_symmetric(data.stiffness, "stiffness")
    m = complete_symmetric(data.mass, "mass")
    check_definite(m, k)
    plane = bool((table[:, 2:] < 0).all())
    positions = data.positions[rows][:, :2] if plane else data.positions[rows]
    scalar = scalar_mass(m, table)
    if plane and scalar is None:
        raise InputError(
            "the mass of a plane body differs between x and y",
            place="mass",
            expected="the same mass in both directions",
        )
    unmarked = FiniteElementModel(
        positions=positions,
        scalar_mass=scalar,
        stiffness=k,
        node_sets=_node_sets(data, rows),
        markers=(),
        full_mass=m if scalar is None else None,
        dof_table=table,
    )
    rigid = unmarked.rigid_body_modes(
        np.pad(positions.mean(0), (0, 3 - len(positions.T)))
    )
    check_rigid_motion(k, rigid)
    rounding = printed_rounding_of(k, rigid)
    k = balance_stiffness(k, table)
    check_digits(k, rounding, *softest_deformation(k, m, positions, table))
    mass = float(rigid[:, 0] @ (m @ rigid[:, 0]))
    if expected_mass is not None and abs(mass / expected_mass - 1) > 1e-3:
        raise InputError(
            f"the mass matrix holds {mass:.6g} kg",
            place="geometry.expected_mass",
            expected=f"{expected_mass:.6g} kg within 0.1 % (are the units consistent?)",
        )
    markers = []
    for name, marker in markers_with_position(named):
        with name_marker_in_errors(name):
            if marker.tie is None:
                node = _marker_node(marker, data.labels[rows], positions)
                markers.append(_matrix_marker_rows(name, marker.node, node, unmarked))
            else:
                node = _marker_node(marker, data.labels, data.positions)
                where = data.positions[node, : unmarked.dimension]
                markers.append(fixed_marker(name, marker.node, where, unmarked.ndof))
    return FiniteElementModel(
        positions=positions,
        scalar_mass=scalar,
        stiffness=k,
        node_sets=unmarked.node_sets,
        markers=tuple(markers),
        full_mass=unmarked.full_mass,
        dof_table=table,
        diagnostics=(diagnose("N126"),)
        if scalar is None and _is_consistent(m, table)
        else (),
    )


def _is_consistent(mass: sp.csr_matrix, table: Indices) -> bool:
    """Return whether rotations of nodes contribute to the displacements between
    nodes.
    """
    node, turns = np.zeros((2, mass.shape[0]), np.int64)
    for column, dofs in enumerate(table.T):
        there = np.flatnonzero(dofs >= 0)
        node[dofs[there]], turns[dofs[there]] = there, column >= 3
    entries, size = mass.tocoo(), np.sqrt(mass.diagonal())
    i, j = entries.row, entries.col
    is_coupled = np.abs(entries.data) > _NO_COUPLING * size[i] * size[j]
    return bool((is_coupled & (node[i] != node[j]) & (turns[i] != turns[j])).any())


def _dof_table(data: ImportedMatrices) -> tuple[Indices, Indices]:
    """Degrees of freedom by node (n, 6), and the rows of the nodes that have any."""
    row = {int(label): i for i, label in enumerate(data.labels)}
    table = np.full((len(data.labels), 6), -1, np.int64)
    for i, (node, direction) in enumerate(data.dofs):
        if int(node) not in row or not 1 <= direction <= 6:
            raise InputError(
                f"row {i + 1} belongs to node {node}, direction {direction}",
                place="dofs",
                expected="a node of the table and a direction from 1 to 6",
            )
        place = (row[int(node)], direction - 1)
        if table[place] >= 0:
            raise InputError(
                f"node {node} has direction {direction} twice",
                place="dofs",
                expected="every degree of freedom once",
            )
        table[place] = i
    used = np.flatnonzero((table >= 0).any(axis=1))
    table = table[used]
    for axis in range(3):
        there = table[:, axis] >= 0
        if there.any() and not there.all():
            label = data.labels[used[np.flatnonzero(~there)[0]]]
            raise InputError(
                f"node {label} has no degree of freedom {axis + 1}",
                place="dofs",
                expected="matrices of the free body, without supports; the frame of "
                "the model file defines what is held",
            )
    return table, used


def _node_sets(data: ImportedMatrices, rows: Indices) -> NamedSets:
    number = np.full(len(data.labels), -1)
    number[rows] = np.arange(len(rows))
    sets = NamedSets()
    for name, nodes in data.node_sets.items():
        numbers_of_set = number[nodes]
        sets[name] = numbers_of_set[numbers_of_set >= 0]
    return sets


def _marker_node(
    marker: NodeMarker, labels: Indices, positions: NDArray[np.float64]
) -> int:
    if marker.mesh_node is not None:
        rows = np.flatnonzero(labels == marker.mesh_node)
        if not rows.size:
            raise InputError(
                f"there is no node {marker.mesh_node}",
                place="mesh_node",
                expected="a node of the table that has degrees of freedom",
            )
        return int(rows[0])
    if marker.position is None or len(marker.position) != positions.shape[1]:
        raise InputError(
            "does not name its node", expected="mesh_node, or position in m"
        )
    distance = np.linalg.norm(positions - np.array(marker.position), axis=1)
    nearest = int(distance.argmin())
    if distance[nearest] > 1e-6 * np.ptp(positions, axis=0).max():
        raise InputError(
            "is not at a node",
            place="position",
            expected=f"a node; the nearest is {labels[nearest]}",
        )
    return nearest


def _matrix_marker_rows(
    name: str, number: int, node: int, body: FiniteElementModel
) -> MarkerRows:
    parts = []
    for columns in (slice(0, 3), slice(3, 6)):
        dofs = body.table[node, columns]
        there = np.flatnonzero(dofs >= 0)
        shape = (3, body.ndof)
        entries = (np.ones(len(there)), (there, dofs[there]))
        parts.append(sp.csr_matrix(entries, shape=shape))
    position = body.positions[node]
    return MarkerRows(
        name=name,
        node=number,
        position=np.pad(position, (0, 3 - position.size)),
        displacement=parts[0],
        rotation=parts[1],
    )
