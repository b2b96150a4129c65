"""What linear elements cost: frequencies of the same mesh with better elements.

Linear elements without internal modes bend too stiffly: by a factor where one of them
spans a thickness, by per cents where several do. How much is measured on the free body,
so that it does not depend on what holds it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, lobpcg

from .frontends.finite_element_model import FiniteElementModel
from .frontends.internal_modes import RELIEVED_KINDS
from .frontends.solid_mesh import SolidMesh, raised, with_internal_modes
from .reduction.basis import hertz
from .reduction.eigen import free_body_shift, lowest_eigenpairs, symmetric_factors
from .reduction.running import tell

Array = NDArray[np.float64]

#: How many frequencies are compared, and the difference that is told.
_MODES, _TOLD = 3, 0.01
#: Degrees of freedom of the better mesh above which comparing would dominate the time,
#: and below which its eigenvectors are computed outright.
_LARGEST, _SMALL = 150_000, 2_000
#: Iterations leave less than a hundredth of the difference.
_ITERATIONS = 10


@dataclass(frozen=True, eq=False)
class _Better:
    """The same mesh with better elements, and how to carry displacements over."""

    mesh: SolidMesh
    between: sp.csr_matrix
    words: str


def element_notes(body: FiniteElementModel) -> tuple[str, ...]:
    """A sentence on linear elements that make this body too stiff, if they do."""
    if body.solids is None or not body.solids.plain_kinds:
        return ()
    kinds = " and ".join(body.solids.plain_kinds)
    better = _better(body.solids)
    size = better.mesh.mesh.positions.size
    if size > _LARGEST:
        return (
            f"{kinds} elements without incompatible modes bend too stiffly where few "
            "of them span a thickness; what that costs here is not measured, as the "
            f"same mesh with {better.words} has {size} degrees of freedom",
        )
    tell(f"comparing {kinds} elements with {better.words}")
    own, other = _frequencies(body, better)
    if (own <= (1 + _TOLD) * other).all():
        return ()
    excess = ", ".join(_percent(x) for x in own / other - 1)
    listed = ", ".join(f"{f:.5g}" for f in own)
    return (
        f"{kinds} elements bend too stiffly in this mesh: the first frequencies of the "
        f"free body, {listed} Hz, are {excess} above those of the same mesh with "
        f"{better.words}; use these, or a finer mesh",
    )


def _percent(share: float) -> str:
    return f"{100 * share:.{1 if share < 0.1 else 0}f} %"


def _better(solids: SolidMesh) -> _Better:
    if set(solids.plain_kinds) <= set(RELIEVED_KINDS):
        same = sp.csr_matrix(sp.eye_array(len(solids.mesh.positions)))
        return _Better(with_internal_modes(solids), same, "incompatible modes")
    finer, between = raised(solids)
    known = {block.kind for block in solids.mesh.blocks}
    kinds = dict.fromkeys(block.kind for block in finer.mesh.blocks)
    return _Better(finer, between, " and ".join(k for k in kinds if k not in known))


def _frequencies(body: FiniteElementModel, better: _Better) -> tuple[Array, Array]:
    """The lowest ones of the free body, and of the free body of better elements [Hz].

    The latter by a few steps from the modes of the body, which are bounds from above.
    """
    own = _FreeBody(body.stiffness, body.mass, body.positions)
    values, modes = own.lowest()
    mass, stiffness = better.mesh.matrices()
    other = _FreeBody(stiffness, mass, better.mesh.mesh.positions)
    if len(other.rigid) <= _SMALL:
        return hertz(values), hertz(other.lowest()[0])
    between = sp.csr_matrix(sp.kron(better.between, sp.eye_array(body.dimension)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # That so few do not converge.
        found, _ = lobpcg(
            stiffness,
            between @ modes,
            B=mass,
            M=_two_levels(stiffness, between, own),
            Y=other.rigid,
            tol=1e-12,
            maxiter=_ITERATIONS,
            largest=False,
        )
    return hertz(values), hertz(np.sort(found))


class _FreeBody:
    """Matrices of a mesh and its rigid motions."""

    def __init__(
        self, stiffness: sp.csr_matrix, mass: sp.csr_matrix, positions: Array
    ) -> None:
        self.stiffness, self.mass = stiffness, mass
        model = FiniteElementModel(positions, None, stiffness, {}, (), full_mass=mass)
        self.rigid = model.rigid_body_modes(np.pad(positions.mean(axis=0), (0, 1))[:3])
        self.shift = free_body_shift(stiffness, mass, positions)
        self.places = np.repeat(positions, positions.shape[1], axis=0)

    def lowest(self) -> tuple[Array, Array]:
        """Eigenvalues and vectors of the first deformations."""
        skipped = self.rigid.shape[1]
        values, vectors = lowest_eigenpairs(
            self.stiffness,
            self.mass,
            _MODES + skipped,
            shift=self.shift,
            rigid=self.rigid,
            places=self.places,
        )
        return values[skipped:], vectors[:, skipped:]

    def solver(self) -> Callable[[Array], Array]:
        """Of the shifted stiffness."""
        shifted = sp.csr_matrix(self.stiffness - self.shift * self.mass)
        return symmetric_factors(shifted, self.places).solve


def _two_levels(
    stiffness: sp.csr_matrix, between: sp.csr_matrix, coarse: _FreeBody
) -> LinearOperator:
    """Solutions on the body's own elements, and node by node on the better ones."""
    solve = coarse.solver()
    d = coarse.places.shape[1]
    nodes = stiffness.shape[0] // d
    blocks = stiffness.tobsr((d, d))
    rows = np.repeat(np.arange(nodes), np.diff(blocks.indptr))
    alone = np.linalg.inv(blocks.data[rows == blocks.indices])

    def apply(load: Array) -> Array:
        load = np.ascontiguousarray(load.reshape(len(load), -1))
        local = alone @ load.reshape(nodes, d, -1)
        return between @ solve(between.T @ load) + local.reshape(load.shape)

    return LinearOperator(stiffness.shape, matvec=apply, matmat=apply, dtype=float)
