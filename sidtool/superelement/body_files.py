"""Files of bodies for other programs, by their endings.

Inertia integrals of a floating frame in the form of other programs.

A tilde is a cross product, x~ y = x x y, and phi_l the displacement field of shape
function l.

Superelement for Simscape Multibody: variables of Reduced Order Flexible Solid.

Source: MathWorks, Simscape Multibody reference, block Reduced Order Flexible Solid:
coordinates of each boundary node in the order Tx, Ty, Tz, Rx, Ry, Rz, nodes in the
order of the interface frames, then modal coordinates.

Superelement for Nastran: matrices in an OUTPUT4 file, or DMIG bulk data.

Source: MSC Nastran Quick Reference Guide, entries DMIG, GRID and SPOINT, module
OUTPUT4 (formatted, non-sparse).

Superelement for OpenFAST's module ExtPtfm: the reduced file in the Flex 5 format.

Source: E. Branlard, M. Shields, B. Anderson, R. Damiani, F. Wendt, J. Jonkman, W.
Musial, B. Foley, "Superelement reduction of substructures for sequential load
calculations in OpenFAST", J. Phys. Conf. Ser. 1452, 2020; ExtPtfm user's guide, section
Reduced file.

Body for the modal joint of MBDyn: a `.fem` file.

The frame of the file is the body frame. Inertia invariants replace the lumped masses of
the nodes (record groups 14 to 18), so that the inertia is that of the whole body.

Source: P. Masarati, MBDyn theory and developer's manual, version 1.7, section Modal
element: invariants 3, 4, 5, 8 and 9.

Arrays of a body for Exudyn's `ObjectFFRFreducedOrder`.

Source: J. Gerstmayr, Exudyn user documentation, section ObjectFFRFreducedOrder;
A. Zwoelfer, J. Gerstmayr, "The nodal-based floating frame of reference formulation with
modal reduction", Acta Mechanica 232, 2021.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import OE_INDICES, SID, Array, by_mode, symmetric_3x3
from sidtool.formats.file_names import check_ending
from sidtool.formats.geometric_stiffening import has_stiffening
from sidtool.formats.sid_mass import body_size, central_inertia, centre_of_mass, skew
from sidtool.formats.storage.atomic import atomic_path

from .craig_bampton import (
    Superelement,
    check_linear_body,
    node_numbers,
    superelement_of_sid,
)

#: Numbers on a line of an OUTPUT4 file, each of 23 characters.
_PER_LINE = 3
#: Forms of matrices: rectangular, symmetric.
_RECTANGULAR, _SYMMETRIC = 2, 6
#: Real numbers in double precision.
_REAL_DOUBLE = 2
#: Modal coordinates are scalar points with numbers above this and above all grids.
_FIRST_SCALAR = 100_000
#: End of the table of loads [s].
_END = 1e5
#: Distance of the points around a node, over the size of the body.
_ARM = 0.01
#: Parameters of `ObjectFFRFreducedOrder` among the arrays.
MATRICES = ("massMatrixReduced", "stiffnessMatrixReduced", "dampingMatrixReduced")


@dataclass(frozen=True, eq=False)
class InertiaIntegrals:
    """Integrals over the mass of a body, from the blocks of its SID.

    Attributes
    ----------
    translation : (3, nq) int phi_l dm [kg m/[q]]
    rotation : (3, nq) int c~ phi_l dm, and the angular momentum of rotating sections
    position_shape : (nq, 3, 3) int c~ phi_l~ dm
    shape_cross : (nq, nq, 3) [l, i] int phi_l x phi_i dm
    shape_shape : (nq, nq, 3, 3) [l, i] int phi_l~ phi_i~ dm; zero if the SID has no
        second-order term of the inertia (Oe m1)
    """

    translation: Array
    rotation: Array
    position_shape: Array
    shape_cross: Array
    shape_shape: Array


def inertia_integrals(sid: SID) -> InertiaIntegrals:
    """Return the integrals of a SID.

    With int c~ phi_l~ dm = -Gr_l / 2, int phi_l x phi_i dm = Ge_l / 2 in row i, and the
    symmetric part of int phi_l phi_i^T dm from Oe m1 and Me; see `sidtool.SID`.

    Raises
    ------
    InputError : Oe m1 contains geometric stiffening, which is no inertia.
    """
    if sid.Oe.m1 is not None and has_stiffening(sid):
        raise InputError(
            "the body has geometric stiffening, which is no inertia of its shapes",
            place="Oe m1",
            expected="a body converted without the table [stiffening]",
        )
    cross = by_mode(sid.Ge.m0, sid.nq) / 2
    return InertiaIntegrals(
        translation=sid.Ct.m0.T,
        rotation=sid.Cr.m0.T,
        position_shape=-by_mode(sid.Gr.m0, sid.nq) / 2,
        shape_cross=cross,
        shape_shape=_shape_products(sid, cross),
    )


def _shape_products(sid: SID, cross: Array) -> Array:
    """(nq, nq, 3, 3) int phi_l~ phi_i~ dm.

    The integrand is phi_i phi_l^T - (phi_l . phi_i) 1.
    """
    nq = sid.nq
    products = np.zeros((nq, nq, 3, 3))
    if sid.Oe.m1 is None:
        return products
    for k, (a, b) in enumerate(OE_INDICES):
        values = sid.Oe.m1[:, :, k]
        products[:, :, a, b] = values if a == b else values / 2
        products[:, :, b, a] = products[:, :, a, b]
    # what is not symmetric in the axes: (phi_i phi_l^T - phi_l phi_i^T) / 2
    return products + skew(cross) / 2


#: Description at the start of the file; MATLAB shows it and asks for nothing in it.
_DESCRIPTION = b"MATLAB 5.0 MAT-file, superelement written by sidtool".ljust(116)


def write_simscape(path: Path, element: Superelement) -> None:
    """Write a MATLAB file (version 5).

    Variables: M, K, C; P (n, 3) origins of the interface frames [m]; Q (n, 4) their
    unit quaternions, scalar first; names (n, 1) of the frames.
    """
    from scipy.io import savemat

    count = len(element.interfaces)
    names = np.empty((count, 1), object)
    names[:, 0] = element.interfaces
    with path.open("wb") as stream:
        savemat(
            stream,
            {
                "M": element.mass,
                "K": element.stiffness,
                "C": element.damping,
                "P": element.positions,
                "Q": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
                "names": names,
            },
            do_compression=True,
        )
        stream.seek(0)
        stream.write(_DESCRIPTION)


def op4_text(element: Superelement) -> str:
    """Return the matrices KAAX, MAAX, BAAX and the positions XYZ of the interfaces."""
    matrices = {
        "KAAX": (element.stiffness, _SYMMETRIC),
        "MAAX": (element.mass, _SYMMETRIC),
        "BAAX": (element.damping, _SYMMETRIC),
        "XYZ": (element.positions, _RECTANGULAR),
    }
    lines = [
        line for name, value in matrices.items() for line in _op4_lines(name, *value)
    ]
    return "\n".join(lines) + "\n"


def _op4_lines(name: str, matrix: Array, form: int) -> Iterator[str]:
    rows, columns = matrix.shape
    header = f"{columns:8d}{rows:8d}{form:8d}{_REAL_DOUBLE:8d}{name:<8s}"
    yield f"{header}1P,{_PER_LINE}E23.16"
    for number, column in enumerate(matrix.T, 1):
        there = np.flatnonzero(column)
        if there.size:
            first, last = there[0], there[-1]
            yield f"{number:8d}{first + 1:8d}{last - first + 1:8d}"
            yield from _number_lines(column[first : last + 1])
    yield f"{columns + 1:8d}{1:8d}{1:8d}"
    yield from _number_lines(np.ones(1))


def _number_lines(values: Array) -> Iterator[str]:
    for k in range(0, len(values), _PER_LINE):
        yield "".join(f"{value:23.16E}" for value in values[k : k + _PER_LINE])


def dmig_text(element: Superelement) -> str:
    """Return bulk data: interfaces as GRID, modes as SPOINT, and DMIG matrices."""
    points = scalar_points(element)
    lines = [
        f"$ Superelement {_printable(element.title)}".rstrip(),
        "$ Case control: K2GG = KAAX, M2GG = MAAX, B2GG = BAAX",
    ]
    for name, number, position in zip(
        element.interfaces, element.numbers, element.positions, strict=True
    ):
        x, y, z = (f"{value:16.9E}" for value in position)
        lines += [
            f"$ interface {_printable(name)}",
            f"GRID*   {number:16d}{'':16s}{x}{y}",
            f"*       {z}",
        ]
    if points:
        lines.append(f"SPOINT  {points[0]:8d}THRU    {points[-1]:8d}")
    rows = [(g, c) for g in element.numbers for c in range(1, 7)]
    rows += [(point, 0) for point in points]
    matrices = {
        "KAAX": element.stiffness,
        "MAAX": element.mass,
        "BAAX": element.damping,
    }
    for name, matrix in matrices.items():
        lines += _dmig_lines(name, matrix, rows)
    return "\n".join(lines) + "\n"


def scalar_points(element: Superelement) -> list[int]:
    """Return the numbers of the scalar points of the modes."""
    first = max(_FIRST_SCALAR, *element.numbers) + 1
    return list(range(first, first + element.n_modes))


def _dmig_lines(name: str, matrix: Array, rows: list[tuple[int, int]]) -> Iterator[str]:
    yield f"DMIG    {name:<8s}{0:8d}{_SYMMETRIC:8d}{_REAL_DOUBLE:8d}{0:8d}"
    for j, (grid, component) in enumerate(rows):
        there = np.flatnonzero(matrix[j:, j]) + j
        if there.size:
            yield f"DMIG*   {name:<16s}{grid:16d}{component:16d}"
        for i in there:
            number = f"{matrix[i, j]:.9E}".replace("E", "D")
            yield f"*       {rows[i][0]:16d}{rows[i][1]:16d}{number:>16s}"


def _printable(text: str) -> str:
    """Return a text for a comment: printable ASCII of at most 60 characters."""
    return "".join(c if " " <= c <= "~" else "?" for c in text)[:60]


def extptfm_text(element: Superelement) -> str:
    """Return the reduced file of a structure with one interface, the platform.

    Coordinates are those of the platform, surge, sway, heave, roll, pitch and yaw along
    the axes of the body frame, and the modes with a fixed platform. Loads are zero.

    Raises
    ------
    InputError : there is more than one interface that can move.
    """
    if len(element.interfaces) != 1:
        raise InputError(
            f"{len(element.interfaces)} interfaces can move: "
            f"{', '.join(element.interfaces)}",
            place="interfaces",
            expected="one, the platform of ExtPtfm; fix the others to the ground with "
            "--fixed (fixed=[...] in Python)",
        )
    size = len(element.mass)
    lines = [
        "!Comment: superelement written by sidtool, SI units",
        "!Comment Flex 5 Format",
        f"!Dimension: {size}",
        f"!Time increment in simulation: {_END:g}",
        f"!Total simulation time in file: {_END:g}",
    ]
    for title, matrix in (
        ("Mass Matrix (kg, kg m, kg m^2)", element.mass),
        ("Stiffness Matrix (N/m, N, N m)", element.stiffness),
        ("Damping Matrix (N s/m, N s, N m s)", element.damping),
    ):
        lines += [f"!{title}", f"!Dimension: {size}"]
        lines += (" ".join(f"{value:.16e}" for value in row) for row in matrix)
    lines += ["!Loading", f"!Dimension: 1 time column, {size} force columns"]
    zeros = " ".join(f"{value:.1e}" for value in np.zeros(size))
    lines += [f"{time:.6e} {zeros}" for time in (0.0, _END)]
    return "\n".join(lines) + "\n"


def mbdyn_text(sid: SID, nodes: Sequence[str], numbers: Sequence[int]) -> str:
    """Return the file of a body.

    Parameters
    ----------
    nodes : ids of the nodes of the SID
    numbers : of the nodes in the file

    Raises
    ------
    InputError : there is no such node, or the body has geometric stiffening.
    """
    points = [sid.node(node) for node in nodes]
    places = np.array([point.position for point in points])
    lines = [
        "** MBDyn MODAL DATA FILE",
        "** RECORD GROUP 1, HEADER",
        "**   REVISION, NODES, NORMAL, ATTACHMENT, CONSTRAINT, REJECTED MODES.",
        f"     REV0 {len(points)} {sid.nq} 0 0 0",
        "** RECORD GROUP 2, FINITE ELEMENT NODE LIST",
        " ".join(map(str, numbers)),
        "** RECORD GROUP 3, INITIAL MODAL DISPLACEMENTS",
        *_rows([np.zeros(sid.nq)]),
        "** RECORD GROUP 4, INITIAL MODAL VELOCITIES",
        *_rows([np.zeros(sid.nq)]),
    ]
    for group, (axis, column) in enumerate(zip("XYZ", places.T, strict=True), 5):
        lines += [f"** RECORD GROUP {group}, NODAL {axis} COORDINATES"]
        lines += _rows(column[:, None])
    lines.append("** RECORD GROUP 8, MODE SHAPES")
    motions = np.array([np.vstack([p.phi.m0, p.psi.m0]) for p in points])
    for k in range(sid.nq):
        lines.append(f"**    NORMAL MODE SHAPE # {k + 1}")
        lines += _rows(motions[:, :, k])
    for title, matrix in _records(sid):
        lines += [f"** RECORD GROUP {title}", *_rows(matrix)]
    return "\n".join(lines) + "\n"


def _records(sid: SID) -> Iterator[tuple[str, Iterable[Array]]]:
    """Record groups 9 to 18, except lumped masses."""
    integrals = inertia_integrals(sid)
    nq = sid.nq
    yield "9, MODAL MASS MATRIX", sid.Me.m0
    yield "10, MODAL STIFFNESS MATRIX", sid.Ke.m0
    body = [np.array([sid.mass]), centre_of_mass(sid), *central_inertia(sid)]
    yield "12, RIGID BODY INERTIA", body
    yield "13, MODAL DAMPING MATRIX", sid.De.m0
    yield "14, INVARIANT 3", integrals.translation
    yield "15, INVARIANT 4", integrals.rotation
    invariant8 = -integrals.position_shape
    yield "16, INVARIANT 8", invariant8.transpose(1, 0, 2).reshape(3, 3 * nq)
    cross = integrals.shape_cross
    yield "17, INVARIANT 5", cross.transpose(2, 0, 1).reshape(3, nq * nq)
    products = integrals.shape_shape
    yield "18, INVARIANT 9", products.transpose(2, 0, 1, 3).reshape(3, 3 * nq * nq)


def _rows(matrix: Iterable[Array]) -> Iterator[str]:
    for row in matrix:
        yield " ".join(f"{value:.16e}" for value in row)


#: Points of a node: itself, and two along each axis.
_ARMS = np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])


def exudyn_arrays(sid: SID, nodes: Sequence[str]) -> dict[str, Array]:
    """Return the arrays of a body by the names of Exudyn's parameters.

    Each node of the SID becomes seven mesh nodes, one at its place and six at a small
    distance on the axes, fixed to it. `MarkerSuperElementRigid` with the six and equal
    weights has its displacement and rotation.

    Parameters
    ----------
    nodes : ids of the nodes of the SID

    Returns
    -------
    massMatrixReduced, stiffnessMatrixReduced, dampingMatrixReduced : (nq, nq)
    modeBasis : (21 n, nq); referencePositions : (21 n,)
    mass : (); inertia : (3, 3) about the origin of the frame; centerOfMass : (3,)
    mPsiTildePsi, mPsiTildePsiTilde, mPhitTPsi, mPhitTPsiTilde, mXRefTildePsi,
    mXRefTildePsiTilde : inertia integrals
    nodeNames : (n,) ids; markerNodes : (n, 7) mesh nodes of each, the first in place

    Raises
    ------
    InputError : there is no such node, or the body has geometric stiffening.
    """
    nq = sid.nq
    integrals = inertia_integrals(sid)
    arms = _ARM * body_size(sid) * _ARMS
    points = [sid.node(node) for node in nodes]
    basis = [
        point.phi.m0 - skew(arm) @ point.psi.m0 for point in points for arm in arms
    ]
    places = [point.position + arm for point in points for arm in arms]
    count = len(points) * len(arms)
    products = -integrals.shape_shape.transpose(0, 2, 1, 3)
    return {
        "massMatrixReduced": sid.Me.m0,
        "stiffnessMatrixReduced": sid.Ke.m0,
        "dampingMatrixReduced": sid.De.m0,
        "modeBasis": np.vstack(basis),
        "referencePositions": np.concatenate(places),
        "mass": np.array(sid.mass),
        "inertia": symmetric_3x3(sid.J.m0[:, 0]),
        "centerOfMass": sid.mdCM.m0[:, 0] / sid.mass,
        "mPsiTildePsi": -integrals.shape_cross.transpose(0, 2, 1).reshape(3 * nq, nq),
        "mPsiTildePsiTilde": products.reshape(3 * nq, 3 * nq),
        "mPhitTPsi": integrals.translation,
        "mPhitTPsiTilde": np.hstack(list(skew(integrals.translation.T))),
        "mXRefTildePsi": -integrals.rotation,
        "mXRefTildePsiTilde": np.hstack(list(-integrals.position_shape)),
        "nodeNames": np.array(list(map(str, nodes))),
        "markerNodes": np.arange(count).reshape(len(points), len(arms)),
    }


@dataclass(frozen=True)
class BodyFormat:
    """A file that holds a superelement, or a body with a floating frame.

    Attributes
    ----------
    program : that reads it
    write_element : writes a superelement, or None
    write_body : writes a SID with some of its nodes, or None
    """

    program: str
    write_element: Callable[[Path, Superelement], None] | None = None
    write_body: Callable[[Path, SID, Sequence[str]], None] | None = None


def _text_of_element(
    text_of: Callable[[Superelement], str],
) -> Callable[[Path, Superelement], None]:
    def write(path: Path, element: Superelement) -> None:
        path.write_text(text_of(element), encoding="ascii", newline="\n")

    return write


def _write_mbdyn(path: Path, sid: SID, nodes: Sequence[str]) -> None:
    text = mbdyn_text(sid, nodes, node_numbers(nodes))
    path.write_text(text, encoding="ascii", newline="\n")


def _write_exudyn(path: Path, sid: SID, nodes: Sequence[str]) -> None:
    arrays: dict[str, Any] = dict(exudyn_arrays(sid, nodes))
    with path.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


_DMIG = BodyFormat("Nastran (DMIG)", write_element=_text_of_element(dmig_text))
#: One line adds a format.
BODY_FORMATS: dict[str, BodyFormat] = {
    ".mat": BodyFormat("Simscape Multibody", write_element=write_simscape),
    ".op4": BodyFormat("Nastran (OUTPUT4)", write_element=_text_of_element(op4_text)),
    ".dmig": _DMIG,
    ".bdf": _DMIG,
    ".dat": BodyFormat(
        "OpenFAST (ExtPtfm)", write_element=_text_of_element(extptfm_text)
    ),
    ".fem": BodyFormat("MBDyn", write_body=_write_mbdyn),
    ".npz": BodyFormat("Exudyn", write_body=_write_exudyn),
}


def write_body(
    path: Path,
    sid: SID,
    nodes: Sequence[str],
    *,
    names: Mapping[str, str] | None = None,
    fixed: Sequence[str] = (),
) -> Superelement | None:
    """Write a body in the format of the ending.

    Parameters
    ----------
    nodes : ids of the nodes of the SID that other bodies are connected to
    names : node id -> name of the interface
    fixed : names of interfaces of a superelement that do not move

    Returns
    -------
    the superelement, or None if the format holds shape functions and integrals

    Raises
    ------
    InputError : the ending is unknown, or the body does not suit the format.
    """
    check_ending(path, "body")
    kind = BODY_FORMATS[path.suffix.lower()]
    if kind.write_element is not None:
        element = superelement_of_sid(sid, nodes, names)
        if fixed:
            element = element.with_supports(fixed)
        with atomic_path(path) as temporary:
            kind.write_element(temporary, element)
        return element
    if fixed:
        raise InputError(
            f"is not possible for {kind.program}",
            place="fixed",
            expected="supports among the joints of the other program",
        )
    check_linear_body(sid)
    assert kind.write_body is not None
    with atomic_path(path) as temporary:
        kind.write_body(temporary, sid, nodes)
    return None
