"""Mass and stiffness matrices of other programs, with a table of nodes.

Formats: CalculiX .sti/.mas (lines ``row column value``) with .dof (lines
``node.direction``), Abaqus .mtx (lines ``node, direction, node, direction, value``),
MatrixMarket, and .npz or .h5 with the arrays

- ``stiffness``, ``mass``: dense (ndof, ndof), or (entries, 3) of row, column, value
  counted from 0
- ``nodes``: (n, 4) number, x, y, z
- ``dofs``: (ndof, 2) node number and direction 1 to 6 of every row
- ``set.NAME``: (n,) node numbers of a node set, as many sets as there are
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_label
from sidtool.formats.base.sid import Array
from sidtool.formats.storage.hdf5_files import check_own_data, check_size

from ..mesh.deck_text import number_table, parse_integers, parse_numbers, read_lines
from ..mesh.imported_mesh import ONLY_NODES
from .matrix_market import MAX_ROWS, is_matrix_market, read_matrix_market
from .mesh_files import MESH_READERS, read_mesh

#: Prefix of the names of arrays with node sets.
_SET = "set."

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ImportedMatrices:
    """Matrices as they are in their files.

    Attributes
    ----------
    stiffness, mass : (ndof, ndof) sparse
    labels : (n,) node numbers
    positions : (n, 3)
    dofs : (ndof, 2) node number and direction 1 to 6 of every row
    node_sets : name -> rows of `positions`
    """

    stiffness: sp.csr_matrix
    mass: sp.csr_matrix
    labels: Indices
    positions: Array
    dofs: Indices
    node_sets: dict[str, Indices]


def read_matrices(
    stiffness: str, mass: str, nodes: str, dofs: str | None
) -> ImportedMatrices:
    """Matrices, nodes and degrees of freedom from text files.

    Raises
    ------
    InputError : the file is not valid; the error names file and line.
    """
    labels, positions, sets = read_nodes(nodes)
    k, k_dofs = _read_matrix(stiffness)
    m, m_dofs = _read_matrix(mass)
    if k_dofs is not None and m_dofs is not None:
        k, m, table = _align_matrices(k, k_dofs, m, m_dofs)
    elif dofs is not None:
        table = _read_dofs(dofs)
        size = len(table)
        k, m = _check_matrix_size(k, size, stiffness), _check_matrix_size(m, size, mass)
    else:
        size = max(k.shape[0], m.shape[0])
        k, m = _check_matrix_size(k, size, stiffness), _check_matrix_size(m, size, mass)
        table = _regular_dofs(labels, size, nodes)
    return ImportedMatrices(k, m, labels, positions, table, sets)


def read_arrays(path: str) -> ImportedMatrices:
    """Matrices, nodes and degrees of freedom from an .npz or .h5 file.

    Raises
    ------
    InputError : an array is missing or misshapen.
    """
    arrays = _load_arrays(path)
    nodes = _checked_array(arrays, "nodes", path, 4)
    dofs = _integers(_checked_array(arrays, "dofs", path, 2), "dofs", path)
    size = len(dofs)
    matrices = []
    for name in ("stiffness", "mass"):
        value = _checked_array(arrays, name, path, None)
        if value.shape == (size, size):
            matrices.append(sp.csr_matrix(value))
        elif value.shape[1] == 3:
            i, j = _integers(value[:, :2], name, path).T
            _check_range(i, j, size, name, path)
            shape = (size, size)
            matrices.append(sp.csr_matrix((value[:, 2], (i, j)), shape=shape))
        else:
            raise InputError(
                f"{name} has shape {value.shape}",
                source=path,
                expected=f"({size}, {size}) or (entries, 3)",
            )
    labels = _integers(nodes[:, 0], "nodes", path)
    sets = {
        name.removeprefix(_SET): _rows_of_set(value, labels, name, path)
        for name, value in arrays.items()
        if name.startswith(_SET)
    }
    return ImportedMatrices(matrices[0], matrices[1], labels, nodes[:, 1:], dofs, sets)


def _rows_of_set(value: Any, labels: Indices, name: str, path: str) -> Indices:
    """Rows of the nodes with some numbers."""
    rows = {int(label): row for row, label in enumerate(labels)}
    if value.ndim == 1 and value.size and np.isin(value, labels).all():
        return np.array([rows[int(number)] for number in value], np.int64)
    raise InputError(
        "holds other than numbers of nodes",
        source=path,
        place=name,
        expected="(n,) numbers of the array nodes",
    )


def read_nodes(path: str) -> tuple[Indices, Array, dict[str, Indices]]:
    """Node numbers (n,), positions (n, 3) and node sets.

    The file is a mesh, or holds lines ``number x y z``.

    Raises
    ------
    InputError : the file is not valid; the error names file and line.
    """
    if Path(path).suffix.lower() in MESH_READERS:
        mesh = read_mesh(path, [ONLY_NODES]).mesh
        pad = ((0, 0), (0, 3 - mesh.dimension))
        return mesh.labels, np.pad(mesh.positions, pad), dict(mesh.node_sets)
    known: set[int] = set()
    labels, positions = [], []
    for place, words in _table_rows(path):
        if len(words) != 4:
            raise InputError(
                f"has {len(words)} entries",
                source=path,
                place=place,
                expected="number x y z",
            )
        with_source = _SourcedParser(path)
        label = with_source.integers(words[:1], place)[0]
        if label in known:
            raise InputError(
                f"node {label} is defined twice",
                source=path,
                place=place,
                expected="one position",
            )
        known.add(label)
        labels.append(label)
        positions.append(with_source.numbers(words[1:], place))
    return np.array(labels, np.int64), np.array(positions).reshape(-1, 3), {}


class _SourcedParser:
    """Words to numbers, with the file in the message."""

    def __init__(self, path: str) -> None:
        self._path = path

    def integers(self, words: list[str], place: str) -> list[int]:
        try:
            return parse_integers(words, place)
        except InputError as error:
            raise error.located(self._path) from None

    def numbers(self, words: list[str], place: str) -> list[float]:
        try:
            return parse_numbers(words, place)
        except InputError as error:
            raise error.located(self._path) from None


def _table_rows(path: str) -> list[tuple[str, list[str]]]:
    rows = []
    for number, line in enumerate(read_lines(path), start=1):
        text = line.strip()
        if text and not text.startswith(("*", "#", "%")):
            rows.append((f"line {number}", text.replace(",", " ").split()))
    return rows


def _read_matrix(path: str) -> tuple[sp.csr_matrix, Indices | None]:
    """A matrix and, where rows name themselves, node and direction of each."""
    first = read_lines(path)[0]
    if is_matrix_market(first):
        return read_matrix_market(path), None
    rows = _table_rows(path)
    width = len(rows[0][1]) if rows else 0
    if width not in (3, 5):
        raise InputError(
            f"has {width} entries in a line",
            source=path,
            place=rows[0][0] if rows else None,
            expected="row column value, or node direction node direction value",
        )
    try:
        table = number_table(rows, width)
        keys = _as_integers(table[:, : width - 1])
    except InputError as error:
        raise error.located(path) from None
    if width == 3:
        i, j = keys.T - 1
        size = int(max(i.max(), j.max())) + 1
        _check_range(i, j, min(size, MAX_ROWS), "the matrix", path)
        return sp.csr_matrix((table[:, 2], (i, j)), shape=(size, size)), None
    dofs, inverse = np.unique(
        np.vstack([keys[:, :2], keys[:, 2:]]), axis=0, return_inverse=True
    )
    i, j = inverse.ravel()[: len(keys)], inverse.ravel()[len(keys) :]
    shape = (len(dofs), len(dofs))
    return sp.csr_matrix((table[:, 4], (i, j)), shape=shape), dofs


def _as_integers(values: Array) -> Indices:
    if (values != np.round(values)).any() or (np.abs(values) >= 2**53).any():
        raise InputError(
            "has a row, column, node or direction that is no integer",
            expected="integers before the value",
        )
    return values.astype(np.int64)


def _read_dofs(path: str) -> Indices:
    result = []
    for place, words in _table_rows(path):
        node, _, direction = words[0].partition(".")
        if not (is_label(node) and is_label(direction)) or not 1 <= int(direction) <= 6:
            raise InputError(
                f"found {words[0]!r}",
                source=path,
                place=place,
                expected="node.direction with a direction from 1 to 6",
            )
        result.append((int(node), int(direction)))
    return np.array(result, np.int64).reshape(-1, 2)


def _align_matrices(
    k: sp.csr_matrix, k_dofs: Indices, m: sp.csr_matrix, m_dofs: Indices
) -> tuple[sp.csr_matrix, sp.csr_matrix, Indices]:
    """Both matrices on the union of their degrees of freedom."""
    table, inverse = np.unique(np.vstack([k_dofs, m_dofs]), axis=0, return_inverse=True)
    rows = inverse.ravel()
    parts = []
    for matrix, row in ((k, rows[: len(k_dofs)]), (m, rows[len(k_dofs) :])):
        c = matrix.tocoo()
        shape = (len(table), len(table))
        parts.append(sp.csr_matrix((c.data, (row[c.row], row[c.col])), shape=shape))
    return parts[0], parts[1], table


def _regular_dofs(labels: Indices, size: int, path: str) -> Indices:
    for per_node in (2, 3, 6):
        if size == per_node * len(labels):
            directions = np.tile(np.arange(1, per_node + 1), len(labels))
            return np.column_stack([np.repeat(labels, per_node), directions])
    raise InputError(
        f"{size} rows do not fit {len(labels)} nodes",
        source=path,
        expected="2, 3 or 6 rows to a node, or a file of dofs",
    )


def _check_matrix_size(matrix: sp.csr_matrix, size: int, path: str) -> sp.csr_matrix:
    if matrix.shape[0] > size or matrix.shape[0] != matrix.shape[1]:
        raise InputError(
            f"has {matrix.shape[0]} x {matrix.shape[1]} entries",
            source=path,
            expected=f"{size} x {size}, as there are degrees of freedom",
        )
    c = matrix.tocoo()
    return sp.csr_matrix((c.data, (c.row, c.col)), shape=(size, size))


def _check_range(i: Indices, j: Indices, size: int, name: str, path: str) -> None:
    if len(i) and (min(i.min(), j.min()) < 0 or max(i.max(), j.max()) >= size):
        raise InputError(
            f"{name} has a row or column outside its size",
            source=path,
            expected=f"{size} rows and columns",
        )


def _is_known(name: str) -> bool:
    return name in ("stiffness", "mass", "nodes", "dofs") or name.startswith(_SET)


def _load_arrays(path: str) -> dict[str, Any]:
    try:
        if Path(path).suffix.lower() == ".npz":
            with np.load(path, allow_pickle=False) as data:
                return {name: data[name] for name in data if _is_known(name)}
        import h5py

        with h5py.File(path, "r") as file:
            check_own_data(file)
            known = [name for name in file if _is_known(name)]
            for name in known:
                check_size(file[name])
            return {name: np.array(file[name]) for name in known}
    except InputError as error:
        raise error.located(path) from None
    except Exception as error:
        text = " ".join(str(error).split())[:160]
        raise InputError(
            f"cannot be read ({text})", source=path, expected="an .npz or .h5 file"
        ) from None


def _checked_array(
    arrays: dict[str, Any], name: str, path: str, columns: int | None
) -> Array:
    if name not in arrays:
        raise InputError(
            "is missing",
            source=path,
            place=name,
            expected="the arrays stiffness, mass, nodes and dofs",
        )
    value = arrays[name]
    numeric = value.dtype.kind in "iuf" and value.ndim == 2 and value.size
    if not numeric or (columns and value.shape[1] != columns):
        raise InputError(
            f"has shape {value.shape}",
            source=path,
            place=name,
            expected=f"(rows, {columns or 'columns'}) of numbers",
        )
    if not np.isfinite(value).all():
        raise InputError(
            "is not finite", source=path, place=name, expected="finite numbers"
        )
    return np.asarray(value, float)


def _integers(values: Array, name: str, path: str) -> Indices:
    """Numbers of nodes, directions, rows and columns in an array."""
    try:
        return _as_integers(values)
    except InputError as error:
        problem, expected = error.problem, error.expected
    raise InputError(problem, source=path, place=name, expected=expected)
