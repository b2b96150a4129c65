"""Error of linear elements: frequencies of the same mesh with better elements.

Linear elements without internal modes bend too stiffly: by a factor if one element
spans a thickness, by some per cent if several do. The error is measured on the free
body, so that it does not depend on the supports.
"""

import warnings
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, lobpcg

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..eigensolvers.slepc import notify
from ..elements.finite_element_model import ElementAlternative, FiniteElementModel
from ..elements.solid_elements import KINDS_WITH_INCOMPATIBLE_MODES
from ..elements.solid_mesh import SolidMesh, to_quadratic, with_internal_modes
from ..mesh.connections import Equations
from ..reduction.admissible_space import AdmissibleSpace, constrained_space
from ..reduction.body_frames import Frame
from ..reduction.reduced_basis import to_hertz

#: Number of compared frequencies, and the difference that gets a note.
_COMPARED_FREQUENCIES, _NOTED_DIFFERENCE = 3, 0.01
#: Number of compared frequencies for elements of another program.
_COMPARED_FREQUENCIES_OF_PROGRAM = 6
#: Degrees of freedom of the better mesh above which the comparison would take too long,
#: and below which its eigenvectors are computed directly.
_LARGEST_MESH, _DIRECT_SOLUTION_SIZE = 150_000, 2_000
#: After so many iterations the error is less than a hundredth of the difference.
_ITERATIONS = 10


@dataclass(frozen=True, eq=False)
class _BetterElements:
    """The same mesh with better elements, and the interpolation of
    displacements to it.
    """

    mesh: SolidMesh
    between: sp.csr_matrix
    words: str


def element_notes(body: FiniteElementModel) -> tuple[Diagnostic, ...]:
    """Return a warning on linear elements that make a body too stiff or too soft (N140
    to N142).
    """
    if body.alternative is not None:
        return _compare_frequencies(body, body.alternative)
    if body.solids is None or not body.solids.kinds_with_locking:
        return ()
    kinds = " and ".join(body.solids.kinds_with_locking)
    better = _with_better_elements(body.solids)
    size = better.mesh.mesh.positions.size
    refined = size > body.positions.size
    if size > _LARGEST_MESH or (refined and body.equations is not None):
        reason = "better ones have nodes that no equation ties"
        if size > _LARGEST_MESH:
            reason = f"better ones have {size} degrees of freedom"
        return (diagnose("N142", kinds=kinds, reason=reason, better=better.words),)
    notify(f"comparing {kinds} elements with {better.words}")
    own, other = _frequencies(body, better)
    return _difference_note(kinds, own, other, better.words)


def _difference_note(
    kinds: str, own: Array, other: Array, better: str
) -> tuple[Diagnostic, ...]:
    """Return N141 if frequencies [Hz] differ from those with better elements."""
    difference = own / other - 1
    if np.abs(difference).max() <= _NOTED_DIFFERENCE:
        return ()
    ways = {"too stiff": difference.max(), "too soft": -difference.min()}
    sense = " and ".join(
        words for words, most in ways.items() if most > _NOTED_DIFFERENCE
    )
    return (
        diagnose(
            "N141",
            count=len(own),
            kinds=kinds,
            sense=sense,
            difference=float(np.abs(difference).max()),
            own=own.tolist(),
            differences=difference.tolist(),
            better=better,
        ),
    )


def _compare_frequencies(
    body: FiniteElementModel, other: ElementAlternative
) -> tuple[Diagnostic, ...]:
    """Compare the elements of another program with better ones of that program."""
    try:
        if other.size > _LARGEST_MESH:
            raise InputError(f"better ones have {other.size} degrees of freedom")
        notify(f"comparing {other.own} elements with {other.better}")
        better = other.discretise()
    except InputError as error:
        return (
            diagnose(
                "N142", kinds=other.own, reason=error.problem, better=other.better
            ),
        )
    own, reference = (
        to_hertz(_full_mass(model).modes(_COMPARED_FREQUENCIES_OF_PROGRAM)[0])
        for model in (body, better)
    )
    difference = own / reference - 1
    if np.abs(difference).max() <= _NOTED_DIFFERENCE:
        return ()
    return (
        diagnose(
            "N140",
            count=len(own),
            kinds=other.own,
            better=other.better,
            difference=float(difference[np.abs(difference).argmax()]),
            own=own.tolist(),
            differences=difference.tolist(),
            remedy=other.remedy,
        ),
    )


def _full_mass(body: FiniteElementModel) -> AdmissibleSpace:
    nothing = np.zeros(body.ndof, bool)
    return constrained_space(body, Frame(np.zeros(3), nothing))


def _percent(share: float) -> str:
    return f"{100 * share:.{1 if abs(share) < 0.1 else 0}f} %"


def _with_better_elements(solids: SolidMesh) -> _BetterElements:
    if set(solids.kinds_with_locking) <= set(KINDS_WITH_INCOMPATIBLE_MODES):
        same = sp.csr_matrix(sp.eye_array(len(solids.mesh.positions)))
        return _BetterElements(with_internal_modes(solids), same, "incompatible modes")
    finer, between = to_quadratic(solids)
    known = {block.kind for block in solids.mesh.blocks}
    kinds = dict.fromkeys(block.kind for block in finer.mesh.blocks)
    return _BetterElements(
        finer, between, " and ".join(k for k in kinds if k not in known)
    )


def _frequencies(
    body: FiniteElementModel, better: _BetterElements
) -> tuple[Array, Array]:
    """The lowest ones of the free body, and of the free body of better elements [Hz].

    The latter follow from a few iterations that start at the modes of the body; they
    are upper bounds.
    """
    tied, positions = body.equations, body.positions
    own = _free_space(body.stiffness, body.field_mass, positions, tied)
    values, modes = own.modes(_COMPARED_FREQUENCIES)
    mass, stiffness = better.mesh.matrices()
    other = _free_space(stiffness, mass, better.mesh.mesh.positions, tied)
    if tied is not None or len(other.rigid) <= _DIRECT_SOLUTION_SIZE:
        return to_hertz(values), to_hertz(other.modes(_COMPARED_FREQUENCIES)[0])
    between = sp.csr_matrix(sp.kron(better.between, sp.eye_array(body.dimension)))
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", UserWarning
        )  # so few iterations do not converge
        squares, _ = lobpcg(
            stiffness,
            between @ modes,
            B=mass,
            M=_two_level_solver(stiffness, between, own),
            Y=other.rigid,
            tol=1e-12,
            maxiter=_ITERATIONS,
            largest=False,
        )
    return to_hertz(values), to_hertz(np.sort(squares))


def _free_space(
    stiffness: sp.csr_matrix,
    mass: sp.csr_matrix,
    positions: Array,
    tied: Equations | None = None,
) -> AdmissibleSpace:
    """Return the space of all displacements of a mesh."""
    model = FiniteElementModel(
        positions, None, stiffness, {}, (), full_mass=mass, equations=tied
    )
    nothing = np.zeros(stiffness.shape[0], bool)
    return constrained_space(model, Frame(np.zeros(3), nothing))


def _two_level_solver(
    stiffness: sp.csr_matrix, between: sp.csr_matrix, coarse: AdmissibleSpace
) -> LinearOperator:
    """Return a preconditioner: solve on the elements of the body, and node by node on
    the better ones.
    """
    d = coarse.places.shape[1]
    nodes = stiffness.shape[0] // d
    blocks = stiffness.tobsr((d, d))
    rows = np.repeat(np.arange(nodes), np.diff(blocks.indptr))
    alone = np.linalg.inv(blocks.data[rows == blocks.indices])

    def apply(load: Array) -> Array:
        load = np.ascontiguousarray(load.reshape(len(load), -1))
        local = alone @ load.reshape(nodes, d, -1)
        return between @ coarse.factors.solve(between.T @ load) + local.reshape(
            load.shape
        )

    return LinearOperator(stiffness.shape, matvec=apply, matmat=apply, dtype=float)
