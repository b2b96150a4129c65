"""MatrixMarket files of real matrices, and checks of imported matrices.

Source: R. Boisvert, R. Pozo, K. Remington, "The Matrix Market exchange formats", NISTIR
5935, 1996. (SciPy's reader trusts the indices of a file and crashes on wrong ones.)
"""

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from ..mesh.deck_text import number_table, parse_integers, read_lines

_HEADER = "%%MatrixMarket matrix, coordinate or array, real or integer, general or "
_SYMMETRIES = ("general", "symmetric")

#: More rows are refused as damage.
MAX_ROWS = 100_000_000
_SYMMETRY_TOLERANCE = 1e-8
#: Force of a unit rigid motion relative to the forces inside the elements. Text files
#: of six digits are worse than rounding.
_RIGID_FORCE_TOLERANCE = 1e-5
#: Relative tolerance for zero: printed digits, and singular mass matrices with few
#: integration points, as CalculiX's of tetrahedra.
_ZERO_TOLERANCE = 1e-5
#: Largest relative change of the bending energy by rounding, as a bound; the actual
#: change is about ten times smaller.
_MAX_ENERGY_CHANGE = 0.1
_MOTIONS = ("x", "y", "z", "rotation about x", "rotation about y", "rotation about z")


def is_matrix_market(line: str) -> bool:
    """Whether a file that begins with this line is one."""
    return line.lower().startswith("%%matrixmarket")


def read_matrix_market(path: str) -> sp.csr_matrix:
    """A square matrix.

    Raises
    ------
    InputError : the file is not valid; the error names file and line.
    """
    try:
        return _parse_matrix(read_lines(path))
    except InputError as error:
        raise error.located(path) from None


def _parse_matrix(lines: list[str]) -> sp.csr_matrix:
    words = lines[0].lower().split()
    if (
        len(words) != 5
        or words[1] != "matrix"
        or words[2] not in ("coordinate", "array")
        or words[3] not in ("real", "integer", "double")
        or words[4] not in _SYMMETRIES
    ):
        raise InputError(
            f"found {lines[0][:80]!r}", place="line 1", expected=f"{_HEADER}symmetric"
        )
    rows = [
        (f"line {number}", line.split())
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.startswith("%")
    ]
    if not rows:
        raise InputError("has no line of sizes", expected="rows, columns, entries")
    sparse = words[2] == "coordinate"
    place, sizes = rows[0]
    size = _parse_sizes(sizes, place, sparse)
    symmetric = words[4] == "symmetric"
    if not sparse:
        return _parse_dense(rows[1:], size[0], symmetric)
    if len(rows) - 1 != size[2]:
        raise InputError(
            f"has {len(rows) - 1} entries",
            expected=f"{size[2]}, as the line of sizes says (is the file cut off?)",
        )
    places = [place for place, _ in rows[1:]]
    return _parse_sparse(number_table(rows[1:], 3), places, size[0], symmetric)


def _parse_sizes(words: list[str], place: str, sparse: bool) -> list[int]:
    size = parse_integers(words, place, "sizes")
    is_square = len(size) == 2 + sparse and size[0] == size[1]
    if not is_square or not 1 <= size[0] <= MAX_ROWS:
        raise InputError(
            f"has sizes {' '.join(words)[:60]}",
            place=place,
            expected=f"a square matrix of at most {MAX_ROWS} rows"
            + (" and its number of entries" * sparse),
        )
    return size


def _parse_sparse(
    table: Array, places: list[str], size: int, symmetric: bool
) -> sp.csr_matrix:
    index = table[:, :2]
    wrong = (index != np.round(index)) | (index < 1) | (index > size)
    if wrong.any():
        row = int(np.flatnonzero(wrong.any(axis=1))[0])
        raise InputError(
            f"is in row {index[row, 0]:g}, column {index[row, 1]:g}",
            place=places[row],
            expected=f"rows and columns from 1 to {size}",
        )
    i, j = index.astype(np.int64).T - 1
    matrix = sp.csr_matrix((table[:, 2], (i, j)), shape=(size, size))
    if not symmetric:
        return matrix
    lower, upper = sp.tril(matrix, -1), sp.triu(matrix, 1)
    twice = (abs(lower) > 0).multiply((abs(upper) > 0).T).tocoo()
    if twice.nnz:
        row, column = twice.row[0] + 1, twice.col[0] + 1
        raise InputError(
            f"holds row {row}, column {column} and row {column}, column {row}",
            expected="one of both, as the matrix is symmetric, or general",
        )
    below = lower + upper
    return sp.csr_matrix(matrix + below.T)


def _parse_dense(
    rows: list[tuple[str, list[str]]], size: int, symmetric: bool
) -> sp.csr_matrix:
    values = number_table(rows, 1)[:, 0]
    count = size * (size + 1) // 2 if symmetric else size * size
    if len(values) != count:
        raise InputError(f"has {len(values)} entries", expected=f"{count} entries")
    matrix = np.zeros((size, size))
    if not symmetric:
        return sp.csr_matrix(values.reshape(size, size).T)
    columns, lines = np.triu_indices(size)
    matrix[lines, columns] = values
    matrix[columns, lines] = values
    return sp.csr_matrix(matrix)


def complete_symmetric(matrix: sp.csr_matrix, name: str) -> sp.csr_matrix:
    """Return the full matrix; a matrix with one triangle only is completed.

    Raises
    ------
    InputError : it is not symmetric.
    """
    lower, upper = sp.tril(matrix, -1), sp.triu(matrix, 1)
    if lower.count_nonzero() == 0 or upper.count_nonzero() == 0:
        return sp.csr_matrix(matrix + lower.T + upper.T)
    scale = np.abs(matrix.data).max()
    off = abs(matrix - matrix.T)
    if off.nnz and off.max() > _SYMMETRY_TOLERANCE * scale:
        raise InputError(
            f"the {name} matrix is not symmetric: entries differ by "
            f"{off.max() / scale:.1e} of the largest",
            place=name,
            expected="a symmetric matrix, or one triangle of it",
        )
    return sp.csr_matrix((matrix + matrix.T) / 2)


def check_definite(mass: sp.csr_matrix, stiffness: sp.csr_matrix) -> None:
    """Whether mass and stiffness are positive semidefinite, to printed digits.

    Raises
    ------
    InputError : one is not; by the signs of its pivots (Sylvester's law of inertia).
    """
    massless = np.flatnonzero(mass.diagonal() <= 0)
    if massless.size:
        raise InputError(
            f"{massless.size} degrees of freedom have no mass, the first in row "
            f"{massless[0] + 1}",
            place="mass",
            expected="a positive definite mass matrix (a beam needs polar inertia too)",
        )
    lifted = mass + _ZERO_TOLERANCE * sp.diags_array(mass.diagonal())
    if _negative_pivots(sp.csr_matrix(lifted)):
        raise InputError(
            "the mass matrix has negative eigenvalues",
            place="mass",
            expected="a mass matrix that is positive at least to its printed digits",
        )
    lift = _ZERO_TOLERANCE * sp.diags_array(np.abs(stiffness.diagonal()))
    if _negative_pivots(sp.csr_matrix(stiffness + lift)):
        raise InputError(
            "the stiffness matrix has negative eigenvalues",
            place="stiffness",
            expected="a positive semidefinite matrix",
        )


def _negative_pivots(matrix: sp.csr_matrix) -> bool:
    try:
        factors = splu(
            sp.csc_matrix(matrix),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:
        return True
    return bool((factors.U.diagonal() < 0).any())


def check_rigid_motion(stiffness: sp.csr_matrix, rigid: Array) -> None:
    """Check that rigid motions have no stiffness.

    Parameters
    ----------
    rigid : (ndof, 3 or 6) rigid motions

    Raises
    ------
    InputError : they have stiffness: the body is supported, or the positions of nodes
        differ from those of the matrix.
    """
    sizes = abs(stiffness) @ np.abs(rigid)
    forces = np.abs(stiffness @ rigid).max(axis=0) / sizes.max(axis=0)
    bad = np.flatnonzero(forces > _RIGID_FORCE_TOLERANCE)
    if bad.size == 0:
        return
    moves = _MOTIONS if rigid.shape[1] == 6 else ("x", "y", "rotation about z")
    names = ", ".join(moves[i] for i in bad)
    turned = all("rotation" in moves[i] for i in bad)
    raise InputError(
        f"the stiffness resists rigid motion ({names})",
        place="stiffness",
        expected="node positions that fit the matrix"
        if turned
        else "the matrix of the free body, without supports; the frame of the model "
        "file defines what is held",
    )


def balance_stiffness(
    stiffness: sp.csr_matrix, table: NDArray[np.int64]
) -> sp.csr_matrix:
    """Return the stiffness after restoring the balance of forces, which was lost by
    printing.

    A free body that is displaced feels no force: the blocks of a row of nodes add up
    to zero. The block of every node with itself is set so that they do, which changes
    it by its last printed digit. The rounding would otherwise act as springs to the
    ground on every node, and shift low frequencies by far more than that digit.

    Parameters
    ----------
    stiffness : (ndof, ndof) of a free body, see `check_rigid_motion`
    table : (n, 6) degrees of freedom by node, -1 for none
    """
    axes = [a for a in range(3) if (table[:, a] >= 0).any()]
    dofs = table[(table[:, axes] >= 0).all(axis=1)][:, axes]
    motion = np.zeros((stiffness.shape[0], len(axes)))
    for k in range(len(axes)):
        motion[dofs[:, k], k] = 1.0
    blocks = (stiffness @ motion)[dofs]
    blocks = (blocks + np.swapaxes(blocks, 1, 2)) / 2
    rows = np.broadcast_to(dofs[:, :, None], blocks.shape)
    columns = np.broadcast_to(dofs[:, None, :], blocks.shape)
    entries = (blocks.ravel(), (rows.ravel(), columns.ravel()))
    return sp.csr_matrix(stiffness - sp.csr_matrix(entries, shape=stiffness.shape))


def check_digits(
    stiffness: sp.csr_matrix, rounding: float, value: float, vector: Array
) -> None:
    """Check that the printed digits of a balanced stiffness resolve its bending.

    Entries rounded to a relative `rounding` r change the energy of a vector v by at
    most r sum_ij |K_ij| (v_i - v_j)^2.

    Parameters
    ----------
    rounding : see `printed_rounding_of`
    value, vector : of the softest quadratic deformation, v^T K v

    Raises
    ------
    InputError : they do not resolve it.
    """
    sizes = abs(stiffness)
    ones = np.ones(len(vector))
    change = 2 * ((vector**2) @ (sizes @ ones) - vector @ (sizes @ vector))
    if rounding * change > _MAX_ENERGY_CHANGE * value:
        raise InputError(
            f"the stiffness is rounded to {rounding:.0e}, which hides how the body "
            "bends",
            place="stiffness",
            expected="an export with more digits",
        )


def printed_rounding_of(stiffness: sp.csr_matrix, rigid: Array) -> float:
    """The relative rounding of entries, from the forces under rigid motion."""
    forces = np.abs(stiffness @ rigid).max(axis=0)
    return float((forces / (abs(stiffness) @ np.abs(rigid)).max(axis=0)).max())


def scalar_mass(mass: sp.csr_matrix, table: NDArray[np.int64]) -> sp.csr_matrix | None:
    """m (n, n) if the mass matrix is m on every displacement component, else None.

    Parameters
    ----------
    table : (n, 6) degrees of freedom by node, -1 for none
    """
    if (table[:, 3:] >= 0).any():
        return None
    axes = [a for a in range(3) if (table[:, a] >= 0).all()]
    if len(axes) * len(table) != mass.shape[0]:
        return None
    blocks = [mass[table[:, a]][:, table[:, a]] for a in axes]
    scale = 1e-9 * np.abs(mass.data).max()
    for block in blocks[1:]:
        difference = abs(block - blocks[0])
        if difference.nnz and difference.max() > scale:
            return None
    inside = sum(abs(block).sum() for block in blocks)
    if abs(mass).sum() - inside > 1e-9 * inside:
        return None
    return sp.csr_matrix(blocks[0])
