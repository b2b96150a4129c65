"""What must hold of imported matrices; all raise `InputError`."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from sidtool.formats.errors import InputError

Array = NDArray[np.float64]

_ASYMMETRY = 1e-8
#: Force of a unit rigid motion relative to the forces inside the elements. Text files
#: of six digits are worse than rounding.
_RIGID = 1e-5
#: What counts as zero: printed digits, and mass matrices integrated with few points,
#: as CalculiX's of tetrahedra, which are singular.
_DIGITS = 1e-5
#: The most that rounding may change the energy of bending by, as a bound; the change
#: itself is some ten times smaller.
_LOST = 0.1
_MOTIONS = ("x", "y", "z", "rotation about x", "rotation about y", "rotation about z")


def symmetric(matrix: sp.csr_matrix, name: str) -> sp.csr_matrix:
    """The whole matrix; one that has only one triangle is completed.

    Raises
    ------
    InputError : it is not symmetric.
    """
    lower, upper = sp.tril(matrix, -1), sp.triu(matrix, 1)
    if lower.count_nonzero() == 0 or upper.count_nonzero() == 0:
        return sp.csr_matrix(matrix + lower.T + upper.T)
    scale = np.abs(matrix.data).max()
    off = abs(matrix - matrix.T)
    if off.nnz and off.max() > _ASYMMETRY * scale:
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
    bare = np.flatnonzero(mass.diagonal() <= 0)
    if bare.size:
        raise InputError(
            f"{bare.size} degrees of freedom have no mass, the first in row "
            f"{bare[0] + 1}",
            place="mass",
            expected="a positive definite mass matrix (a beam needs polar inertia too)",
        )
    lifted = mass + _DIGITS * sp.diags_array(mass.diagonal())
    if _negative_pivots(sp.csr_matrix(lifted)):
        raise InputError(
            "the mass matrix has negative eigenvalues",
            place="mass",
            expected="a mass matrix that is positive at least to its printed digits",
        )
    lift = _DIGITS * sp.diags_array(np.abs(stiffness.diagonal()))
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
    """Whether the stiffness leaves rigid motion free.

    Parameters
    ----------
    rigid : (ndof, 3 or 6) rigid motions

    Raises
    ------
    InputError : it does not: the body is held, or the nodes are not where the matrix
        was made.
    """
    sizes = abs(stiffness) @ np.abs(rigid)
    forces = np.abs(stiffness @ rigid).max(axis=0) / sizes.max(axis=0)
    bad = np.flatnonzero(forces > _RIGID)
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
        "file says what is held",
    )


def balanced(stiffness: sp.csr_matrix, table: NDArray[np.int64]) -> sp.csr_matrix:
    """The stiffness with the balance of forces that printing has rounded away.

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
    """Whether the printed digits of a balanced stiffness tell how it bends.

    Entries rounded to a relative `rounding` r change the energy of a vector v by at
    most r sum_ij |K_ij| (v_i - v_j)^2.

    Parameters
    ----------
    rounding : see `printed_rounding`
    value, vector : of the softest quadratic deformation, v^T K v

    Raises
    ------
    InputError : they hardly do.
    """
    sizes = abs(stiffness)
    ones = np.ones(len(vector))
    change = 2 * ((vector**2) @ (sizes @ ones) - vector @ (sizes @ vector))
    if rounding * change > _LOST * value:
        raise InputError(
            f"the stiffness is rounded to {rounding:.0e}, which hides how the body "
            "bends",
            place="stiffness",
            expected="an export with more digits",
        )


def printed_rounding(stiffness: sp.csr_matrix, rigid: Array) -> float:
    """The relative rounding of entries, from the forces under rigid motion."""
    forces = np.abs(stiffness @ rigid).max(axis=0)
    return float((forces / (abs(stiffness) @ np.abs(rigid)).max(axis=0)).max())


def scalar_part(mass: sp.csr_matrix, table: NDArray[np.int64]) -> sp.csr_matrix | None:
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
