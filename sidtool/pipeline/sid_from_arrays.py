"""Build SIDs from matrices with shape functions, or from blocks."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    BLOCK_SHAPES,
    SID,
    Array,
    Node,
    Taylor,
    axis_major,
    block_shape,
    symmetric_3x3,
)
from sidtool.formats.model import NodeMarker, RayleighDamping
from sidtool.formats.sid_mass import skew
from sidtool.validate import check

from ..conversion.frame_change import centrifugal, change_frame
from ..discretisation.matrices_body import matrices_body
from ..elements.finite_element_model import FiniteElementModel
from ..importers.matrices import ImportedMatrices
from ..reduction.body_frames import Frame
from ..reduction.reduced_basis import ReducedBasis
from .model_to_sid import assembled_sid

__all__ = ["sid_from_blocks", "sid_from_shapes"]

#: A block: its value at q = 0, or that and its derivatives (nq, rows, columns) by q.
Block = ArrayLike | Taylor | tuple[ArrayLike, ArrayLike]

#: Stiffness relative to the largest one below which a shape function is rigid.
_RIGID_MOTION_TOLERANCE = 1e-9
_NODE_DOF_COUNTS = {2: (1, 2), 3: (1, 2, 3), 6: (1, 2, 3, 4, 5, 6)}


def sid_from_shapes(
    mass: ArrayLike | sp.spmatrix | sp.sparray,
    stiffness: ArrayLike | sp.spmatrix | sp.sparray,
    positions: ArrayLike,
    shapes: ArrayLike,
    nodes: Mapping[int, int],
    *,
    dofs: ArrayLike | None = None,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    frame: str | None = None,
    damping: tuple[float, float] = (0.0, 0.0),
    labels: Sequence[str] | None = None,
    title: str = "",
) -> SID:
    """Build the SID of a free body from its matrices and given shape functions.

    Parameters
    ----------
    mass, stiffness : (ndof, ndof) dense or sparse, of the body without supports [kg,
        N/m, and their moments]
    positions : (n, 2) or (n, 3) of the nodes [m]
    shapes : (ndof, nq) displacements of the shape functions in the body frame,
        independent and free of rigid motion; they need not be orthogonal
    nodes : number in the SID, from 1, -> row of `positions`: the points that joints and
        forces can use
    dofs : (ndof, 2) row of `positions` and direction 1 to 6 of every row of the
        matrices; default node by node x y, or x y z, or these and the rotations about
        them, as many as there are
    origin : of the body frame, whose axes are those of `positions` [m]
    frame : another body frame for the same deformations: "buckens" (mean axes),
        "tangent:1" or "chord:1,2" of numbers in `nodes`; default the one above
    damping : alpha [1/s] and beta [s] of De = alpha Me + beta Ke
    labels : nq texts, default "Shape 1" and so on

    Raises
    ------
    InputError : sizes do not fit, matrices are no mass or stiffness of a free body, or
        shape functions are dependent or rigid.
    """
    points = _finite_array(positions, "positions", 2)
    basis = _finite_array(shapes, "shapes", 2)
    data = ImportedMatrices(
        _square_matrix(stiffness, "stiffness"),
        _square_matrix(mass, "mass"),
        np.arange(len(points)),
        np.pad(points, ((0, 0), (0, 3 - points.shape[1]))),
        _rows_by_node(len(points), len(basis))
        if dofs is None
        else np.array(dofs, np.int64),
        {},
    )
    for name, size in (("mass", data.mass.shape), ("stiffness", data.stiffness.shape)):
        if size != (len(basis), len(basis)):
            raise InputError(
                f"is {size[0]} x {size[1]} beside shape functions of {len(basis)} rows",
                place=name,
                expected="as many rows and columns as shapes has rows",
            )
    body = matrices_body(data, _node_markers(nodes, len(points)), None)
    if labels is None:
        labels = [f"Shape {k + 1}" for k in range(basis.shape[1])]
    reduced = ReducedBasis(basis, _reduced_stiffness(body, basis), tuple(labels))
    place = np.zeros(3)
    place[: np.size(origin)] = np.asarray(origin, float).ravel()
    frame_without_clamps = Frame(place, np.zeros(body.ndof, bool))
    alpha, beta = damping
    rayleigh = RayleighDamping(type="rayleigh", alpha=alpha, beta=beta)
    sid = assembled_sid(body, frame_without_clamps, reduced, rayleigh, title=title)
    sid = replace(sid, from_matrices=True)
    return _checked_sid(sid if frame is None else change_frame(sid, frame))


def sid_from_blocks(
    mass: float,
    nodes: Mapping[int | str, Mapping[str, ArrayLike]],
    *,
    labels: Sequence[str] | None = None,
    title: str = "",
    **blocks: Block,
) -> SID:
    """Build a SID from its blocks, with Wallrapp's names and shapes (`sidtool.SID`).

    Omitted blocks follow from the others: mdCM m1 from Ct, Oe m0 from J m1, Ge from Cr
    m1 and Gr from J m1 and Cr; ksigma, De and all else are zero.

    Parameters
    ----------
    mass : [kg]
    nodes : id -> `position` (3,) in the body frame [m], `phi` (3, nq) and, default
        zero, `psi` (3, nq) displacement and rotation by the elastic coordinates, and
        `rotation` (3, 3) from node to body axes, default none
    blocks : mdCM (3, 1), J (6, 1) in the order xx yy zz xy xz yz, Ct (nq, 3), Cr
        (nq, 3), Me (nq, nq), Ke (nq, nq), which have to be given; Gr (3, 3 nq) and Ge
        (nq, 3 nq), column axis * nq + mode, Oe (nq, 6), ksigma (nq, 1), De (nq, nq).
        Each is its value at q = 0, or that and the derivatives by q, (nq, rows,
        columns)

    Raises
    ------
    InputError : a block is missing, unknown, has a wrong shape, or contradicts the
        others.
    """
    unknown = [name for name in blocks if name not in BLOCK_SHAPES]
    missing = [n for n in ("mdCM", "J", "Ct", "Cr", "Me", "Ke") if n not in blocks]
    if unknown or missing:
        raise InputError(
            f"{', '.join(unknown or missing)} "
            + ("is no block" if unknown else "is missing"),
            place="blocks",
            expected=", ".join(BLOCK_SHAPES),
        )
    nq = np.shape(_block_terms(blocks["Me"])[0])[0]
    expansions = {
        name: _taylor_block(name, block, nq) for name, block in blocks.items()
    }
    for name, value in _implied_blocks(expansions, nq).items():
        expansions.setdefault(name, value)
    if expansions["mdCM"].m1 is None and nq:
        expansions["mdCM"] = Taylor(
            expansions["mdCM"].m0, expansions["Ct"].m0[:, :, None]
        )
    if labels is None:
        labels = [f"Shape {k + 1}" for k in range(nq)]
    points = tuple(
        _node_of_entries(str(name), entries, nq) for name, entries in nodes.items()
    )
    all_blocks: dict[str, Any] = expansions
    sid = SID(float(mass), tuple(labels), points, title=title, **all_blocks)
    return _checked_sid(replace(sid, from_matrices=True))


def _implied_blocks(expansions: Mapping[str, Taylor], nq: int) -> dict[str, Taylor]:
    """Return omitted blocks that follow from the others; theory, section 4."""
    rate = expansions["J"].first_order(nq)[:, :, 0]
    turned = expansions["Cr"].first_order(nq)
    return {
        "Gr": Taylor(axis_major(symmetric_3x3(rate) - skew(expansions["Cr"].m0))),
        "Ge": Taylor(axis_major(turned - np.swapaxes(turned, 0, 1))),
        "Oe": Taylor(centrifugal(expansions["J"], nq)),
        "ksigma": Taylor(np.zeros((nq, 1))),
        "De": Taylor(np.zeros((nq, nq))),
    }


def _block_terms(block: Block) -> tuple[Any, Any]:
    if isinstance(block, Taylor):
        return block.m0, block.m1
    return block if isinstance(block, tuple) else (block, None)


def _taylor_block(name: str, block: Block, nq: int) -> Taylor:
    """Return a block; vectors may be given in one dimension."""
    m0, m1 = _block_terms(block)
    shape = block_shape(name, nq)
    first = None if m1 is None else _with_shape(name, m1, (nq, *shape))
    return Taylor(_with_shape(name, m0, shape), first)


def _with_shape(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = _finite_array(value, f"block {name}")
    if shape not in (array.shape, (*array.shape, 1)):
        raise InputError(
            f"has shape {array.shape}", place=f"block {name}", expected=f"{shape}"
        )
    return array.reshape(shape)


def _node_of_entries(name: str, entries: Mapping[str, ArrayLike], nq: int) -> Node:
    known = {"position": (3,), "phi": (3, nq), "psi": (3, nq), "rotation": (3, 3)}
    given = {"psi": np.zeros((3, nq)), "rotation": np.eye(3), **entries}
    for key in (*known, *given):
        shape = np.shape(given.get(key, 0.0))
        if shape != known.get(key):
            raise InputError(
                f"{key} has shape {shape}" if key in given else f"{key} is missing",
                place=f"node {name}",
                expected=", ".join(f"{key} {size}" for key, size in known.items()),
            )
    position, phi, psi, rotation = (
        _finite_array(given[k], f"node {name}") for k in known
    )
    turned = np.einsum("lab,bc->lac", skew(psi.T), rotation)
    return Node(
        id=name,
        origin=Taylor(position[:, None], phi.T[:, :, None]),
        phi=Taylor(phi),
        psi=Taylor(psi),
        AP=Taylor(rotation, turned),
    )


def _checked_sid(sid: SID) -> SID:
    """Return the SID if it passes the checks of a file.

    Raises
    ------
    InputError : it does not pass; the error names the identity.
    """
    failed = [
        failure
        for failure in check(sid)
        if failure.failed and failure.severity == "error"
    ]
    if failed:
        raise InputError(
            "; ".join(f"{failure.id} fails: {failure.title}" for failure in failed),
            place="blocks",
            expected="blocks of one body, see `sidtool validate`",
        )
    return sid


def _reduced_stiffness(body: FiniteElementModel, shapes: Array) -> Array:
    """Return the reduced stiffness (nq, nq); refuse dependent or rigid shapes."""
    reduced = shapes.T @ (body.stiffness @ shapes)
    inertia = shapes.T @ (body.mass @ shapes)
    sizes = np.sqrt(np.maximum(np.diag(inertia), 1e-300))
    values = np.linalg.eigvalsh(inertia / np.outer(sizes, sizes))
    if len(values) and values[0] <= _RIGID_MOTION_TOLERANCE:
        raise InputError(
            "are not independent, or one moves no mass",
            place="shapes",
            expected="linearly independent shape functions",
        )
    energies = np.linalg.eigvalsh(reduced / np.outer(sizes, sizes))
    if len(energies) and energies[0] <= _RIGID_MOTION_TOLERANCE * energies[-1]:
        raise InputError(
            "contain a motion without strain, a rigid one",
            place="shapes",
            expected="deformations only: the body frame has the rigid motion",
        )
    return np.asarray((reduced + reduced.T) / 2)


def _rows_by_node(count: int, rows: int) -> NDArray[np.int64]:
    """Return node row and direction of each degree of freedom in node-by-node order."""
    each, left = divmod(rows, max(count, 1))
    if left or each not in _NODE_DOF_COUNTS:
        raise InputError(
            f"{rows} rows do not belong to {count} nodes in a regular way",
            place="dofs",
            expected="2, 3 or 6 rows a node, or dofs that name every row",
        )
    return np.array(
        [(n, a) for n in range(count) for a in _NODE_DOF_COUNTS[each]], np.int64
    )


def _node_markers(nodes: Mapping[int, int], count: int) -> dict[str, NodeMarker]:
    markers = {}
    for number, row in nodes.items():
        if not (1 <= int(number) <= 99999 and 0 <= int(row) < count):
            raise InputError(
                f"has node {number} in row {row}",
                place="nodes",
                expected=f"numbers from 1 to 99999 and rows from 0 to {count - 1}",
            )
        markers[str(number)] = NodeMarker.model_validate(
            {"node": int(number), "mesh_node": int(row)}
        )
    return markers


def _square_matrix(matrix: Any, name: str) -> sp.csr_matrix:
    matrix_ = sp.csr_matrix(matrix, dtype=float)
    _finite_array(matrix_.data, name)
    return matrix_


def _finite_array(value: ArrayLike, name: str, dimensions: int | None = None) -> Array:
    array = np.asarray(value, float)
    if dimensions is not None and array.ndim != dimensions:
        raise InputError(
            f"has shape {array.shape}",
            place=name,
            expected=f"an array with {dimensions} indices",
        )
    if not np.isfinite(array).all():
        raise InputError("holds numbers that are not finite", place=name)
    return array
