"""Factors of symmetric positive definite matrices: libraries, ordering, memory.

CHOLMOD (scikit-sparse) and PARDISO (pypardiso) are used when they are installed;
SuperLU, which comes with SciPy, is always available. `use_engine` or the environment
variable SIDTOOL_FACTORS selects one of `ENGINES`. PETSc is used only on request: it is
meant for several processes.

The ordering is nested dissection by coordinates.
Source: A. George, "Nested dissection of a regular finite element mesh", SIAM J. Numer.
Anal. 10 (2), 1973; the cuts as in M. Heath, P. Raghavan, "A Cartesian parallel nested
dissection algorithm", SIAM J. Matrix Anal. Appl. 16 (1), 1995; the separators as in A.
Pothen, C.-J. Fan, "Computing the block triangular form of a sparse matrix", ACM Trans.
Math. Softw. 16 (4), 1990.
"""

import functools
import importlib
import os
import platform
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import maximum_bipartite_matching
from scipy.sparse.linalg import splu

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.interruptible import call_interruptibly
from sidtool.formats.base.sid import Array
from sidtool.formats.storage.operating_system import release_free_memory

from .multigrid import MultigridFactors, NodalUnknowns
from .pardiso import PardisoFactors, import_pypardiso
from .projected_matrix import Assembled
from .slepc import PetscFactors, check_slepc, notify, requested_engine

Indices = NDArray[np.int64]


#: Equations from which on the expected memory is reported, and of solids the time.
_LARGE, _SLOW = 10_000, 20_000
#: Equations from which on multigrid takes less than factors.
_WORTH_LEVELS = 2_000
#: Seconds for a factor of a solid, by the square of the number of equations times the
#: relative thickness, to a factor of two: on one processor of 2024, 76 938 equations of
#: tet10 and 55 488 of hex8 took 5.4 and 7.7 s by SuperLU, 1.8 and 1.9 s by PARDISO.
_SECONDS = {"superlu": 3e-9, "pardiso": 8e-10}
#: Where pip installs Intel's library, by `platform.machine`.
_PARDISO_MACHINES = ("x86_64", "AMD64")

#: Parts with at most this number of points are not divided.
_MIN_PART_SIZE = 3
#: Digits of base 3 that an integer of 64 bits holds.
_MOST_CUTS = 39
#: Fewest points over those on one side of a cut, below which they are taken.
_WORTH_RAGGED = 0.9
#: Coordinates that agree in so many digits of a part's length are equal.
_DIGITS = 7
#: Bytes per unknown of the matrices and vectors, and of the factors, which grow in the
#: plane as log2(n), in space as n^(1/3). Fitted to hexahedra (benchmarks/scale.py); the
#: factors of tetrahedra are smaller.
_BYTES = {
    "superlu": {2: (1100.0, 100.0), 3: (1900.0, 500.0)},
    "cholmod": {2: (1100.0, 50.0), 3: (1900.0, 180.0)},
    "pardiso": {2: (1100.0, 75.0), 3: (5200.0, 220.0)},
    "slepc": {2: (1100.0, 70.0), 3: (1900.0, 180.0)},
    "multigrid": {2: (3000.0, 0.0), 3: (11000.0, 0.0)},
}
#: Interpreter and libraries.
_BASE = 0.15e9


class Factors(Protocol):
    """Protocol of factors: solve linear systems."""

    def solve(self, load: Array) -> Array:
        """A^-1 b for b (n,) or (n, k)."""


def symmetric_factors(
    matrix: Assembled,
    places: Array | None = None,
    nodal: NodalUnknowns | None = None,
) -> Factors:
    """Factorise a symmetric positive definite matrix.

    Parameters
    ----------
    places : (n, d) position of each unknown; used by libraries that find no good order
        of elimination themselves
    nodal : for multigrid; without it, and for few equations, SuperLU takes its place

    Raises
    ------
    InputError : the requested library is not installed.
    RuntimeError, ValueError : the matrix is singular.
    """
    name, count = engine_name(), matrix.shape[0]
    if name == "multigrid" and (nodal is None or count < _WORTH_LEVELS):
        name = "superlu"
    costs = ""
    if places is not None and count >= _LARGE:
        costs = f", which may take {expected_gigabytes(places, count):.1f} GB"
        costs += _expected_durations(name, places, count)
    begin_stage(f"factorising {count} equations by {name}{costs}", count)
    if name == "multigrid" and nodal is not None:
        return MultigridFactors(matrix.tocsr(), nodal)
    if name == "superlu":
        return _Superlu(matrix.tocsr(), places)
    return ENGINES[name][1](matrix)


def begin_stage(text: str, count: int) -> None:
    """Report a stage; if it has many equations, free memory goes back to the system."""
    if count >= _LARGE:
        release_free_memory()
    notify(text)


def indefinite_factors(matrix: sp.csr_matrix, places: Array | None = None) -> Factors:
    """Factorise a symmetric matrix that need not be definite, by SuperLU.

    Pivots are those on the diagonal, so that solutions should be refined.

    Parameters
    ----------
    places : (n, d) position of each unknown

    Raises
    ------
    RuntimeError : the matrix is singular.
    """
    return _Superlu(matrix, places)


def _expected_durations(name: str, places: Array, count: int) -> str:
    """How long SuperLU takes for a solid, and PARDISO if pip could install it.

    Nested dissection of a cube needs a number of operations that grows as n^2.
    """
    if name != "superlu" or places.shape[1] < 3 or count < _SLOW:
        return ""
    squares = count**2 * _relative_thickness(places)
    text = f" and about {_SECONDS['superlu'] * squares:.0f} s"
    if platform.machine() in _PARDISO_MACHINES:
        faster = _SECONDS["pardiso"] * squares
        text += f' (after pip install "sidtool[fast]" {faster:.0f} s)'
    return text


def engine_name() -> str:
    """Return the library that will be used, one of `ENGINES`.

    Raises
    ------
    InputError : the requested library is not installed.
    """
    requested = requested_engine() or os.environ.get("SIDTOOL_FACTORS")
    if requested == "slepc":
        check_slepc()
        return requested
    if requested is None:
        return next(
            n for n, (module, _) in ENGINES.items() if not reason_unavailable(module)
        )
    missing = (
        reason_unavailable(ENGINES[requested][0])
        if requested in ENGINES
        else "no such engine"
    )
    if missing:
        there = [
            n for n, (module, _) in ENGINES.items() if not reason_unavailable(module)
        ]
        raise InputError(
            f"the engine {requested!r} is not there ({missing})",
            place="--engine" if requested_engine() else "SIDTOOL_FACTORS",
            expected=f"one of {', '.join(there)}",
        )
    return requested


@functools.cache
def reason_unavailable(module: str) -> str:
    """Why a module cannot be used, empty if it can: some are installed, but a shared
    library that they load is not (pypardiso without MKL)."""
    try:
        if module == "pypardiso":
            import_pypardiso()
        else:
            importlib.import_module(module)
    except (ImportError, OSError) as error:
        return str(error).split(". ")[0]
    return ""


def _to_csc(matrix: sp.csr_matrix) -> sp.csc_matrix:
    """The same symmetric matrix by columns, without a copy."""
    return sp.csc_matrix(matrix.T)


class _Superlu:
    """LU factors with pivots on the diagonal, by nested dissection if it can be."""

    def __init__(self, matrix: sp.csr_matrix, places: Array | None = None) -> None:
        self._order: Indices | None = None
        if places is not None:
            self._order = nested_dissection(matrix, places)
            matrix = matrix[self._order][:, self._order]
        self._factors = call_interruptibly(
            lambda: splu(
                _to_csc(matrix),
                permc_spec="MMD_AT_PLUS_A" if places is None else "NATURAL",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        )

    def solve(self, load: Array) -> Array:
        if self._order is None:
            return self._factors.solve(load)
        solution = np.empty(load.shape, order="F")
        solution[self._order] = self._factors.solve(load[self._order])
        return solution


class _Cholmod:
    """Supernodal Cholesky factors (scikit-sparse below 0.5)."""

    def __init__(self, matrix: Assembled) -> None:
        from sksparse.cholmod import CholmodError, cholesky

        try:
            self._factor = cholesky(_to_csc(matrix.tocsr()), mode="supernodal")
        except CholmodError as error:
            raise RuntimeError(str(error)) from None

    def solve(self, load: Array) -> Array:
        return self._factor(load)


#: Name -> required module, factorisation; the first available one is the default.
ENGINES: dict[str, tuple[str, Callable[[Any], Factors]]] = {
    "cholmod": ("sksparse.cholmod", _Cholmod),
    "pardiso": ("pypardiso", PardisoFactors),
    "superlu": ("scipy", _Superlu),
    "slepc": ("slepc4py", PetscFactors),
    "multigrid": ("pyamg", _Superlu),  # of what has no levels
}


def nested_dissection(matrix: sp.csr_matrix, places: Array) -> Indices:
    """(n,) the unknowns in an order for elimination.

    Every part is cut at the median of its longest side. The fewest points that touch
    all connections across the cut, on either side, come after both sides. All parts of
    one level are cut at once.

    Parameters
    ----------
    matrix : (n, n) with a symmetric pattern
    places : (n, d) where each unknown is; neighbours with the same place make a point
    """
    starts = np.ones(len(places), bool)
    starts[1:] = (places[1:] != places[:-1]).any(axis=1)
    point = np.cumsum(starts) - 1
    first = np.flatnonzero(starts)
    codes = _elimination_codes(
        _neighbour_pairs(matrix, first, point, starts), places[first]
    )
    return np.argsort(codes[point], kind="stable")


def _neighbour_pairs(
    matrix: sp.csr_matrix, first: Indices, point: Indices, starts: NDArray[np.bool_]
) -> Indices:
    """(2, m) pairs of neighbours, each once, by the first unknown of every point."""
    rows = matrix[first]
    counts = np.diff(rows.indptr)
    i = np.repeat(np.arange(len(first), dtype=np.int32), counts)
    j = point[rows.indices].astype(np.int32)
    is_edge = starts[rows.indices] & (i < j)
    return np.stack([i[is_edge], j[is_edge]])


def _elimination_codes(edges: Indices, places: Array) -> Indices:
    """(n,) numbers that rise in the order of elimination.

    Every cut gives a digit of base 3: 0 and 1 for the sides, 2 for the separator.
    """
    codes = np.zeros(len(places), np.int64)
    part = np.zeros(len(places), np.int64)
    active = np.arange(len(places))
    for power in reversed(range(_MOST_CUTS)):
        active = _parts_to_cut(active, part)
        if not active.size:
            break
        digit = np.zeros(len(places), np.int8)
        digit[active] = _is_above_median(part[active], places[active])
        edges = edges[:, (part[edges] >= 0).all(axis=0)]
        i, j = edges
        cut = digit[i] != digit[j]
        separator = _smallest_separators(edges[:, cut], digit, part)
        digit[separator] = 2
        codes[active] += 3**power * digit[active].astype(np.int64)
        part[active] = 2 * part[active] + digit[active]
        part[separator] = -1
        edges = edges[:, ~cut]
        active = active[part[active] >= 0]
    return codes


def _smallest_separators(
    edges: Indices, side: NDArray[np.int8], part: Indices
) -> Indices:
    """The points that separate the sides of each part.

    Those on one side make plane separators; the fewest on both sides are taken in parts
    where they are fewer by far, as on unstructured meshes: they are ragged, which costs
    entries where later cuts meet them.

    Parameters
    ----------
    edges : (2, m) pairs of points, one on either side
    side : 0 or 1 for every point
    part : number of the part of every point
    """
    i, j = edges
    is_swapped = side[i] > side[j]
    first, row = np.unique(np.where(is_swapped, j, i), return_inverse=True)
    plane, column = np.unique(np.where(is_swapped, i, j), return_inverse=True)
    shape = (len(first), len(plane))
    graph = sp.csr_matrix((np.ones(len(row), np.int32), (row, column)), shape=shape)
    partner = maximum_bipartite_matching(graph, perm_type="row")
    count = part.max(initial=-1) + 1
    # the fewest are as many as pairs of the matching (theorem of König)
    sizes = [
        np.bincount(part[x], minlength=count) for x in (plane, plane[partner >= 0])
    ]
    is_ragged = sizes[1] < _WORTH_RAGGED * sizes[0]
    if not is_ragged.any():
        return plane
    is_first, is_second = _minimum_vertex_cover(graph, partner)
    fewest = np.concatenate([first[is_first], plane[is_second]])
    return np.concatenate(
        [plane[~is_ragged[part[plane]]], fewest[is_ragged[part[fewest]]]]
    )


def _minimum_vertex_cover(
    graph: sp.csr_matrix, partner: Indices
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which points of two sides (n,), (m,) make the smallest set that touches all edges
    between these.

    By the theorem of König: from a maximum matching, the points of the first side that
    no alternating path from an unmatched point of that side reaches, and those of the
    second side that one reaches.

    Parameters
    ----------
    graph : (n, m) positive at edges
    partner : (m,) of the points of the second side in the matching, -1 for none
    """
    count, second_count = graph.shape
    to_second = graph.T.tocsr()
    matched = np.zeros(count, bool)
    matched[partner[partner >= 0]] = True
    reached, reached_second = ~matched, np.zeros(second_count, bool)
    new = reached.copy()
    while new.any():
        touched = (to_second @ new.astype(np.int32) > 0) & ~reached_second
        reached_second |= touched
        new = np.zeros(count, bool)
        new[partner[touched & (partner >= 0)]] = True
        new &= ~reached
        reached |= new
    return ~reached, reached_second


def _parts_to_cut(active: Indices, part: Indices) -> Indices:
    """The points of parts that are worth a cut, by parts, which get new numbers.

    The others get the part -1.
    """
    active = active[np.argsort(part[active], kind="stable")]
    _, number, sizes = np.unique(part[active], return_inverse=True, return_counts=True)
    large = sizes > _MIN_PART_SIZE
    renumbered = np.where(large, np.cumsum(large) - 1, -1)[number]
    part[active] = renumbered
    return active[renumbered >= 0]


def _is_above_median(part: Indices, places: Array) -> NDArray[np.bool_]:
    """(n,) whether points, sorted by parts, lie beyond the cut of their part."""
    starts = np.flatnonzero(np.diff(part, prepend=-1))
    low = np.minimum.reduceat(places, starts)
    sides = np.maximum.reduceat(places, starts) - low
    longest = sides.argmax(axis=1)
    every = np.arange(len(part))
    along = places[every, longest[part]] - low[part, longest[part]]
    length = np.maximum(sides.max(axis=1), np.finfo(float).tiny)
    along = np.round(along / length[part], _DIGITS)
    order = np.argsort(part + along / 2, kind="stable")
    middle = starts + np.diff(starts, append=len(part)) // 2
    threshold = np.maximum(along[order[middle]], 10.0**-_DIGITS)
    return along >= threshold[part]


def expected_gigabytes(positions: Array, ndof: int) -> float:
    """Peak memory of a reduction: to about a tenth for hexahedra, and at most twice as
    much as tetrahedra need.

    Separators of slender and flat parts are small: the factors grow with the cube root
    of what a cube would have times that of its thickness. Herting's method on hex8 by
    SuperLU, measured: 22 x 22 x 22 elements 0.80 GB (0.83 expected), 60 x 24 x 8
    0.84 GB (0.83), 120 x 12 x 8 0.77 GB (0.79).

    Parameters
    ----------
    positions : (n, d) nodes [m]
    """
    dimension = positions.shape[1]
    growth = np.log2(ndof)
    if dimension == 3:
        growth = (ndof * _relative_thickness(positions)) ** (1 / 3)
    matrices, factors = _BYTES[engine_name()][dimension]
    return float(_BASE + ndof * (matrices + factors * growth)) / 1e9


def _relative_thickness(positions: Array) -> float:
    """Return the relative thickness of a part: 1 for a cube, 0.4 for 15 x 1.5 x 1."""
    if len(positions) < 2:
        return 1.0
    spread = np.linalg.eigvalsh(np.cov(positions.T))
    thin, middle, long = np.sqrt(np.maximum(spread, 1e-12 * spread[-1]))
    return float((thin * middle) ** (1 / 6) / long ** (1 / 3))
