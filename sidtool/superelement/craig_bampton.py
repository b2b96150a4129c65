"""Superelement of a SID: coordinates are motions of interfaces and internal modes.

Source: R. Craig, M. Bampton, "Coupling of substructures for dynamic analyses",
AIAA J. 6 (7), 1968.

Checks of mass, stiffness and damping matrices before they are written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array, Node
from sidtool.formats.sid_mass import coupled_mass_matrix, free_motion, skew

#: Relative differences and negative eigenvalues that are rounding.
_ROUNDING = 1e-9

#: Motions of an interface, in the order of its six rows.
MOTIONS = ("x", "y", "z", "rx", "ry", "rz")
#: Interface motions depend on each other if a singular value of their unit-mobility
#: rows is below this.
_DEPENDENT = 1e-7
#: Relative difference of mass and inertia that is rounding.
_SAME_INERTIA = 1e-8


def check_symmetric(matrix: Array, name: str) -> None:
    """Check that a matrix equals its transpose, relative to its diagonal.

    Raises
    ------
    InputError : it does not.
    """
    size = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.maximum(np.outer(size, size), 1e-300)
    largest = np.abs(matrix).max(initial=0.0)
    deviation = np.abs(matrix - matrix.T)
    relative = np.minimum(deviation / scale, deviation / max(largest, 1e-300))
    if relative.max(initial=0.0) > _ROUNDING:
        raise InputError(
            f"is not symmetric, by {relative.max():.2g} of its entries",
            place=name,
            expected="a symmetric matrix",
        )


def check_definite(matrix: Array, mass: Array, name: str, *, strict: bool) -> None:
    """Check that a matrix is positive semidefinite, or positive definite.

    Parameters
    ----------
    mass : relative to which eigenvalues of a semidefinite matrix are computed
    strict : positive definite; eigenvalues are those of the matrix with unit diagonal

    Raises
    ------
    InputError : it is not.
    """
    if strict:
        size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        values = scipy.linalg.eigvalsh(matrix / np.outer(size, size))
        passed = values[0] > 0.0
    else:
        values = scipy.linalg.eigh(matrix, mass, eigvals_only=True)
        passed = values[0] >= -_ROUNDING * max(values[-1], 0.0)
    if not passed:
        kind = "definite" if strict else "semidefinite"
        raise InputError(
            f"is not positive {kind}: its least eigenvalue is {values[0]:.3g}, the "
            f"largest {values[-1]:.3g}",
            place=name,
            expected=f"a positive {kind} matrix",
        )


def check_rigid_motion(matrix: Array, rigid: Array, name: str) -> None:
    """Check that rigid motions (n, 6) cause no forces but rounding.

    Forces are compared with the root of the stiffness at that coordinate times the
    energy of the terms that cancel.

    Raises
    ------
    InputError : they do.
    """
    energies = np.einsum("ij,ik,kj->j", np.abs(rigid), np.abs(matrix), np.abs(rigid))
    scale = np.sqrt(np.outer(np.abs(np.diag(matrix)), energies))
    forces = np.abs(matrix @ rigid) / np.maximum(scale, 1e-300)
    if forces.max(initial=0.0) > _ROUNDING:
        raise InputError(
            f"rigid motions cause forces, {forces.max():.2g} of their terms",
            place=name,
            expected=f"less than {_ROUNDING:g}",
        )


@dataclass(frozen=True, eq=False)
class Superelement:
    """Matrices of a free linear body with six coordinates for each interface.

    Coordinates: displacement x, y, z and rotation rx, ry, rz of each interface along
    the body axes, in the order of `interfaces`; then amplitudes of modes with fixed
    interfaces, of unit modal mass.

    Attributes
    ----------
    title : of the body
    interfaces : n names
    numbers : (n,) number of the node of each interface
    positions : (n, 3) of the interfaces in the body frame [m]
    mass : (6 n + m, 6 n + m) [kg, kg m, kg m^2; kg^(1/2) for modes]
    stiffness : of the same shape [N/m, N, N m]
    damping : of the same shape [N s/m, N s, N m s]
    supports : interfaces that were removed because they do not move
    """

    title: str
    interfaces: tuple[str, ...]
    numbers: tuple[int, ...]
    positions: Array
    mass: Array
    stiffness: Array
    damping: Array
    supports: tuple[str, ...] = ()

    @property
    def n_interface(self) -> int:
        """Number of interface coordinates, 6 n."""
        return 6 * len(self.interfaces)

    @property
    def n_modes(self) -> int:
        """Number m of modes with fixed interfaces."""
        return len(self.mass) - self.n_interface

    @property
    def frequencies(self) -> Array:
        """(6 n + m,) natural frequencies [Hz], rigid motions included as zeros."""
        values = scipy.linalg.eigh(self.stiffness, self.mass, eigvals_only=True)
        return np.asarray(np.sqrt(np.maximum(values, 0.0)) / (2 * np.pi))

    @property
    def fixed_frequencies(self) -> Array:
        """(m,) natural frequencies with fixed interfaces [Hz]."""
        squares = np.diag(self.stiffness)[self.n_interface :]
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi))

    def rigid_motions(self) -> Array:
        """(6 n + m, 6) coordinates of rigid motions: translations along and rotations
        about the body axes through the origin of the body frame.
        """
        motions = np.zeros((len(self.mass), 6))
        for k, position in enumerate(self.positions):
            motions[6 * k : 6 * k + 6] = _rigid_rows(position)
        return motions

    def with_supports(self, names: Sequence[str]) -> Superelement:
        """Return the superelement with some interfaces fixed to the ground.

        Raises
        ------
        InputError : there is no such interface, or none would be left.
        """
        unknown = [name for name in names if name not in self.interfaces]
        left = [k for k, name in enumerate(self.interfaces) if name not in names]
        if unknown or not left:
            what = (
                f"there is no interface {unknown[0]!r}" if unknown else "none is left"
            )
            raise InputError(
                what,
                place="fixed",
                expected=f"some, not all, of {', '.join(self.interfaces)}",
            )
        rows = [6 * k + i for k in left for i in range(6)]
        rows += range(self.n_interface, len(self.mass))
        selected = np.ix_(rows, rows)
        return replace(
            self,
            interfaces=tuple(self.interfaces[k] for k in left),
            numbers=tuple(self.numbers[k] for k in left),
            positions=self.positions[left],
            mass=self.mass[selected],
            stiffness=self.stiffness[selected],
            damping=self.damping[selected],
            supports=(*self.supports, *names),
        )


def superelement_of_sid(
    sid: SID, interfaces: Sequence[str], names: Mapping[str, str] | None = None
) -> Superelement:
    """Transform the coordinates of a free body to interface motions and modes.

    With rigid motion and elastic coordinates z = (r, q), the motion of the interfaces
    is x = T z. Static motions C minimise the elastic energy under T C = 1, so that a
    rigid motion of the interfaces has none. Modes with fixed interfaces span the null
    space of T. The new coordinates represent the same motions as z.

    Parameters
    ----------
    interfaces : ids of the nodes, in the order of the coordinates
    names : node id -> name of the interface, by default the id

    Raises
    ------
    InputError : there is no such node, the shape functions cannot represent six
        independent motions of every interface, the body has prestress, or its matrices
        are not those of a free body with mass; the error names what fails.
    """
    labels = [str((names or {}).get(node, node)) for node in interfaces]
    if not interfaces:
        raise InputError("there is none", place="interfaces", expected="one or more")
    nodes = [sid.node(node) for node in interfaces]
    check_linear_body(sid)
    mass, stiffness, damping = _free_matrices(sid)
    motion = np.vstack([_motion_rows(node) for node in nodes])
    factor = scipy.linalg.cholesky(mass, lower=True)
    motion_by_mass = scipy.linalg.solve_triangular(factor, motion.T, lower=True).T
    _check_independent(motion_by_mass, motion, labels)

    static, modes, squares = _static_and_fixed_modes(
        motion_by_mass, _by_mass(stiffness, factor)
    )
    shapes = scipy.linalg.solve_triangular(
        factor, np.hstack([static, modes]), lower=True, trans="T"
    )
    inner = slice(len(motion), None)
    new_mass, new_stiffness = (
        _transformed(mass, shapes),
        _transformed(stiffness, shapes),
    )
    # what modes with fixed interfaces have but for rounding
    new_mass[inner, inner] = np.eye(len(squares))
    new_stiffness[inner], new_stiffness[:, inner] = 0.0, 0.0
    new_stiffness[inner, inner] = np.diag(squares)
    element = Superelement(
        title=sid.title,
        interfaces=tuple(labels),
        numbers=node_numbers(interfaces),
        positions=np.array([node.position for node in nodes]),
        mass=new_mass,
        stiffness=new_stiffness,
        damping=_transformed(damping, shapes),
    )
    check_superelement(element, sid)
    return element


def check_linear_body(sid: SID) -> None:
    """Refuse a body without the mass of a free body, or with prestress.

    Raises
    ------
    InputError : it is one of them.
    """
    free = free_motion(sid)
    if not free.possible:
        raise InputError(
            free.reason, place="mass", expected="a body that can move freely in space"
        )
    if sid.ksigma.m0.any():
        raise InputError(
            "the body has prestress (ksigma), a constant force",
            place="ksigma",
            expected="a body without prestress, as matrices hold no constant force",
        )


def check_superelement(element: Superelement, sid: SID) -> None:
    """Check what must hold for the matrices of a free body.

    Symmetry; positive definite mass, positive semidefinite stiffness and damping; rigid
    motions without elastic and damping force; mass and inertia of the body.

    Raises
    ------
    InputError : a check fails; the error names the matrix and the number.
    """
    matrices = {
        "mass": element.mass,
        "stiffness": element.stiffness,
        "damping": element.damping,
    }
    for name, matrix in matrices.items():
        check_symmetric(matrix, name)
        check_definite(matrix, element.mass, name, strict=name == "mass")
    rigid = element.rigid_motions()
    check_rigid_motion(element.stiffness, rigid, "stiffness")
    check_rigid_motion(element.damping, rigid, "damping")
    found = rigid.T @ element.mass @ rigid
    expected = coupled_mass_matrix(sid)[:6, :6]
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    deviation = float((np.abs(found - expected) / size).max())
    if deviation > _SAME_INERTIA:
        raise InputError(
            f"mass and inertia differ from those of the body by {deviation:.2g}",
            place="mass",
            expected=f"a relative difference below {_SAME_INERTIA:g}",
        )


def _free_matrices(sid: SID) -> tuple[Array, Array, Array]:
    """Return mass, stiffness and damping (6 + nq, 6 + nq) of the free body."""
    mass = coupled_mass_matrix(sid)
    check_symmetric(mass, "mass")
    matrices = [(mass + mass.T) / 2]
    for name, block in (("stiffness", sid.Ke.m0), ("damping", sid.De.m0)):
        check_symmetric(block, name)
        matrix = np.zeros_like(mass)
        matrix[6:, 6:] = (block + block.T) / 2
        matrices.append(matrix)
    return matrices[0], matrices[1], matrices[2]


def _motion_rows(node: Node) -> Array:
    """(6, 6 + nq) displacement and rotation of a node by rigid motion and q."""
    return np.hstack(
        [_rigid_rows(node.position), np.vstack([node.phi.m0, node.psi.m0])]
    )


def _rigid_rows(position: Array) -> Array:
    """(6, 6) displacement and rotation of a point by rigid motions of the body."""
    rows = np.eye(6)
    rows[:3, 3:] = -skew(position)
    return rows


def _by_mass(matrix: Array, factor: Array) -> Array:
    """F^-1 A F^-T, symmetric."""
    half = scipy.linalg.solve_triangular(factor, matrix, lower=True)
    full = scipy.linalg.solve_triangular(factor, half.T, lower=True)
    return np.asarray((full + full.T) / 2)


def _transformed(matrix: Array, shapes: Array) -> Array:
    result = shapes.T @ matrix @ shapes
    return np.asarray((result + result.T) / 2)


def _check_independent(rows: Array, motion: Array, names: Sequence[str]) -> None:
    """Refuse interface motions (6 n, 6 + nq) that depend on each other.

    Parameters
    ----------
    rows : the motions in coordinates with unit mass
    """
    sizes = np.linalg.norm(rows, axis=1)
    scaled = rows / np.where(sizes > 0, sizes, 1.0)[:, None]
    _, r, order = scipy.linalg.qr(scaled.T, mode="economic", pivoting=True)
    rank = int((np.abs(np.diag(r)) > _DEPENDENT).sum())
    if rank == len(rows):
        return
    dependent = sorted(order[rank:])
    text = ", ".join(f"{names[k // 6]} {MOTIONS[k % 6]}" for k in dependent[:6])
    more = ", ..." if len(dependent) > 6 else ""
    listed = ", ".join(f'"{name}"' for name in names)
    raise InputError(
        f"the shape functions represent {rank} of {len(rows)} interface motions; {text}"
        f"{more} depend on the others",
        place="interfaces",
        expected="a body in space converted with [reduction] method = "
        f'"craig_bampton", interfaces = [{listed}], rotations = true; or fewer '
        "interfaces",
    )


def _static_and_fixed_modes(
    rows: Array, stiffness: Array
) -> tuple[Array, Array, Array]:
    """Return static motions (n, k) and modes (n, n - k) with fixed interfaces, both in
    coordinates with unit mass, and the squared angular frequencies of the modes.

    Parameters
    ----------
    rows : (k, n) interface motions, of full rank
    """
    sizes = np.linalg.norm(rows, axis=1)
    u, s, vt = scipy.linalg.svd(rows / sizes[:, None])
    particular = vt[: len(s)].T @ ((u.T / s[:, None]) / sizes)
    free = vt[len(s) :].T
    inner = free.T @ stiffness @ free
    values, turns = scipy.linalg.eigh((inner + inner.T) / 2)
    modes = free @ turns
    response = (modes.T @ stiffness @ particular) / values[:, None]
    return particular - modes @ response, modes, values


def node_numbers(interfaces: Sequence[str]) -> tuple[int, ...]:
    """Return the numbers of the nodes; 1, 2, ... if an id is no number."""
    if all(str(node).isdecimal() and 0 < int(node) < 10**8 for node in interfaces):
        return tuple(int(node) for node in interfaces)
    return tuple(range(1, len(interfaces) + 1))
