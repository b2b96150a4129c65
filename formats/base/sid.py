"""Standard Input Data (SID) of one flexible body, in memory.

Source: O. Wallrapp, "Standardization of flexible body modeling in multibody system
codes, Part I: Definition of standard input data", 1994.

One convention, the canonical one of this project, holds in memory whatever the file
said: every block has the shape of `BLOCK_SHAPES`; the columns of `Gr` and `Ge` are
axis-major (column ``axis * nq + mode``); ``m1[l]`` is the derivative by elastic
coordinate l. Indices start at 0. All quantities are resolved in the body frame.
Units are whatever consistent system the producer used; [q] is the unit of the
elastic coordinates.

A rigid body is a SID with no elastic coordinates.

Matrices that depend on the elastic coordinates of a body.

Shares of the static compliance of a body that its shape functions represent.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..diagnostics import Diagnostic
from .complex_step import number_type
from .errors import InputError
from .html import html_table

Array = NDArray[np.float64]

#: The directions of loads: forces along the body axes, moments about them.
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
#: What stands for the loads by its own inertia, where nodes have their ids.
INERTIA_KEY = "*"
_ENTRY = re.compile(r"([^\s=\[\];]+)=([\d.e,-]+)", re.ASCII)
#: Per cents below this are rounding.
_LEAST_PERCENT = 1e-6
SixComponents = tuple[float | None, ...]
#: Body blocks in file order. Rows and columns; "q" stands for nq.
#: Units: mdCM kg m; J kg m2; Ct kg m/[q]; Cr kg m2/[q]; Me kg m2/[q]2;
#: Gr kg m2/[q]; Ge kg m2/[q]2; Oe kg m2/[q]; ksigma N m/[q]; Ke N m/[q]2;
#: De N m s/[q]2. With m1 of Ke the elastic force is Ke(q) q.
BLOCK_SHAPES: Mapping[str, tuple[int | str, int | str]] = MappingProxyType(
    {
        "mdCM": (3, 1),
        "J": (6, 1),
        "Ct": ("q", 3),
        "Cr": ("q", 3),
        "Me": ("q", "q"),
        "Gr": (3, "3q"),
        "Ge": ("q", "3q"),
        "Oe": ("q", 6),
        "ksigma": ("q", 1),
        "Ke": ("q", "q"),
        "De": ("q", "q"),
    }
)
#: Node entries in file order. Units: origin m; phi m/[q]; psi rad/[q]; AP 1;
#: sigma stress or section force (optional).
NODE_SHAPES: Mapping[str, tuple[int | str, int | str]] = MappingProxyType(
    {"origin": (3, 1), "phi": (3, "q"), "psi": (3, "q"), "AP": (3, 3), "sigma": (6, 1)}
)
#: J is stored as (xx, yy, zz, xy, xz, yz), tensor elements.
J_INDICES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
#: Oe columns multiply (wx wx, wy wy, wz wz, wx wy, wy wz, wx wz): yz before xz.
OE_INDICES = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
#: Further shape functions of a section that leaves the body connected.
JUMPS = 6


@dataclass(frozen=True, eq=False)
class Taylor:
    """A matrix that depends on the elastic coordinates: M(q) = m0 + sum_l m1[l] q_l.

    Attributes
    ----------
    m0 : (nrow, ncol) value at q = 0
    m1 : (nq, nrow, ncol) derivative by each elastic coordinate; None at order 0
    mn : (nqn, nrow, ncol) coefficients of terms above the first, stored as read;
        no producer writes them and their meaning is not defined; None otherwise
    order : declared order of the expansion; at least 1 with m1, 2 with mn
    """

    m0: Array
    m1: Array | None = None
    mn: Array | None = None
    order: int = 0

    def __post_init__(self) -> None:
        implied = 2 if self.mn is not None else (1 if self.m1 is not None else 0)
        object.__setattr__(self, "order", max(self.order, implied))
        for name in ("m0", "m1", "mn"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _read_only(value))

    @property
    def shape(self) -> tuple[int, int]:
        """(nrow, ncol)."""
        rows, columns = self.m0.shape
        return rows, columns

    @property
    def is_zero(self) -> bool:
        """True when every stored coefficient is zero."""
        stored = (self.m0, self.m1, self.mn)
        return not any(part is not None and part.any() for part in stored)

    def first_order(self, nq: int) -> Array:
        """m1 as (nq, nrow, ncol), zeros where the expansion has none."""
        return np.zeros((nq, *self.shape)) if self.m1 is None else self.m1

    def at(self, q: ArrayLike) -> Array:
        """M(q), (nrow, ncol), to first order."""
        if self.m1 is None:
            return self.m0
        return self.m0 + np.tensordot(np.asarray(q, float), self.m1, axes=1)


def _read_only(value: ArrayLike) -> Array:
    array = np.array(value, dtype=number_type(value), order="C")
    array.setflags(write=False)
    return array


@dataclass(frozen=True)
class ComplianceShares:
    """Shares of the compliance of the full body.

    Attributes
    ----------
    free : loads were balanced by the inertia of a free body, whose displacements carry
        no momentum; else the body was fixed by its frame
    shares : node id -> (6,) by `DIRECTIONS`: share of the displacement (or rotation)
        along a unit load there that the shape functions represent; None if not known
    lost : (12,) missing work under its own inertia when its frame is accelerated along
        and about its axes, and when it rotates steadily, by the units of
        `inertia_load_scales`; over the reference of `UnitLoadCompliances`; empty if not
        known; in older files (9,) without products of angular velocities, over the
        largest one of the body, or (6,) of another measure, which is kept
    """

    free: bool
    shares: Mapping[str, SixComponents] = field(default_factory=dict)
    lost: tuple[float, ...] = ()

    @property
    def knows_inertia(self) -> bool:
        """Whether the missing work under own inertia is known."""
        return len(self.lost) in (9, 12)

    def text(self, room: int) -> str:
        """Return the shares in per cent, the poorest nodes first, limited to `room`
        characters.
        """
        text = "free" if self.free else "held"
        for entry in self._entries():
            if len(text) + 1 + len(entry) > room:
                break
            text += f" {entry}"
        return text

    def _entries(self) -> Iterator[str]:
        if self.lost:
            yield f"{INERTIA_KEY}={','.join(map(_percent, self.lost))}"
        for name, row in sorted(self._rows(), key=lambda named: _poorest(named[1])):
            yield _entry(name, row)

    def _rows(self) -> Iterator[tuple[str, SixComponents]]:
        for name, row in self.shares.items():
            if _ENTRY.fullmatch(_entry(name, row)) and name != INERTIA_KEY:
                yield name, row


def parse_compliance_shares(text: str) -> ComplianceShares | None:
    """Parse the text of `ComplianceShares.text`; None if it is something else."""
    kind, _, rest = text.partition(" ")
    if kind not in ("free", "held"):
        return None
    shares: dict[str, SixComponents] = {}
    lost: tuple[float, ...] = ()
    for entry in rest.split():
        match = _ENTRY.fullmatch(entry)
        row = None if match is None else _row(match[2])
        if match is None or row is None:
            return None
        if match[1] == INERTIA_KEY:
            lost = tuple(_is_known(row))
        elif len(row) == len(DIRECTIONS):
            shares[match[1]] = row
        else:
            return None
    lost = lost if len(lost) in (6, 9, 12) else ()
    return ComplianceShares(kind == "free", shares, lost)


def _is_known(row: SixComponents) -> list[float]:
    return [share for share in row if share is not None]


def _poorest(row: SixComponents) -> int:
    """The lowest known share in whole per cents; finer differences may be rounding."""
    return round(100.0 * min(_is_known(row), default=1.0))


def _entry(name: str, row: SixComponents) -> str:
    cells = ["-" if x is None else f"{100.0 * x:.0f}" for x in row]
    return f"{name}={','.join(cells)}"


def _percent(share: float) -> str:
    percent = 100.0 * share if 100.0 * share > _LEAST_PERCENT else 0.0
    return f"{percent:.0f}" if percent >= 10.0 else f"{percent:.2g}"


def _row(text: str) -> SixComponents | None:
    cells = text.split(",")
    try:
        return tuple(None if c == "-" else float(c[:8]) / 100.0 for c in cells)
    except ValueError:
        return None


def orientation_fault(AP: Array) -> str:
    """In words why a matrix (3, 3) is no rotation; empty for one."""
    if not AP.any():
        return "is zero"
    if orientation_deviation(AP) > 1e-3:
        return "is no rotation"
    return "is reflected (left-handed)" if np.linalg.det(AP) < 0.0 else ""


def orientation_deviation(AP: Array) -> float:
    """Largest entry of AP^T AP - I."""
    return float(np.abs(AP.T @ AP - np.eye(3)).max())


@lru_cache(maxsize=4096)
def block_shape(name: str, nq: int) -> tuple[int, int]:
    """Rows and columns of a body block or node entry for nq elastic coordinates."""
    shape = BLOCK_SHAPES.get(name) or NODE_SHAPES[name]
    sizes = {"q": nq, "3q": 3 * nq}
    rows, columns = (sizes[s] if isinstance(s, str) else s for s in shape)
    return rows, columns


@dataclass(frozen=True, eq=False)
class Node:
    """One exported point of the body.

    Attributes
    ----------
    id : the node's name; an integer up to 99999 in ASCII files that others read
    origin : (3, 1) position; m1[l] equals column l of phi.m0
    phi : (3, nq) translational shape functions; m1 is geometric stiffening by a force
    psi : (3, nq) rotational shape functions; m1 is geometric stiffening by a moment
    AP : (3, 3) rotation from node-frame to body-frame components
    sigma : (6, 1) stress or section forces per elastic coordinate, or None
    rframe : the frame that the entries refer to, always "body ref" so far
    """

    id: str
    origin: Taylor
    phi: Taylor
    psi: Taylor
    AP: Taylor
    sigma: Taylor | None = None
    rframe: str = "body ref"

    @property
    def position(self) -> Array:
        """Undeformed position in the body frame, (3,)."""
        return self.origin.m0[:, 0]


@dataclass(frozen=True)
class Dialect:
    """How the file of a SID was written; see theory, section 4.

    Attributes
    ----------
    writer : the program that wrote the file, as far as its title states it
    gr_layout, ge_layout : columns of Gr and Ge, "axis" or "mode" major
    m1_index : "rlc" (mode index second) or "rcl"
    j_shape : "6x1" or "3x3"
    symmetric : "both" or "lower", the stored halves of symmetric matrices
    exponent : the letter before exponents, "D" or "E", "" for none
    name : the name of the body after ``new modal =``
    """

    writer: str = "sidtool"
    gr_layout: str = "axis"
    ge_layout: str = "axis"
    m1_index: str = "rlc"
    j_shape: str = "6x1"
    symmetric: str = "both"
    exponent: str = "D"
    name: str = ""


@dataclass(frozen=True, eq=False)
class Section:
    """A cross-section of a body, and the part of the body beyond it.

    Section forces are those in equilibrium with all that acts on that part. Where the
    section leaves the body connected, there is no such part. The entry sigma of the
    node then has the section forces N, Vy, Vz, T, My, Mz per elastic coordinate. The
    part is the whole body with six further shape functions: its displacements by a unit
    jump at the section in the direction of each of these forces.

    Attributes
    ----------
    name : of the section
    part : mass integrals of the part beyond, without stiffness, with the shape
        functions and the frame of the whole body. Its first node is the section, whose
        axes are the tangent of a beam or the normal of a plane cut, and the axes y and
        z of the section. With further shape functions the nodes of the body follow
    beyond : ids of the nodes of the body that belong to the part; empty where the
        section leaves the body connected
    """

    name: str
    part: "SID"
    beyond: tuple[str, ...]

    @property
    def jumps(self) -> int:
        """Number of further shape functions of the part."""
        sigma = self.node.sigma
        return 0 if sigma is None or len(self.part.nodes) == 1 else JUMPS

    @property
    def node(self) -> Node:
        """The cross-section as a node."""
        return self.part.nodes[0]


@dataclass(frozen=True, eq=False, repr=False)
class SID:
    """Standard Input Data of one body; blocks carry Wallrapp's names.

    Attributes
    ----------
    mass : total mass [kg]
    labels : nq free texts of the elastic coordinates (``ielastq``)
    nodes : exported points
    mdCM, J, Ct, Cr, Me, Gr, Ge, Oe, ksigma, Ke, De : body blocks, see `BLOCK_SHAPES`
    title : free text of the first line
    extra : Taylor blocks with names this project does not know, kept as read
    dialect : where the data came from
    written_by : the program that wrote the file, "" if it is not ours or none
    carried : what the shape functions have of the compliance of the full body, if it
        is known
    from_matrices : the body came as matrices, or was discretised by another program, so
        that there are no elements whose stress could stiffen it
    has_peak_nodes : whether nodes were added where the stress is largest; None if that
        is not known, see `formats.base.stress.has_peak_nodes`
    sections : at which section forces are known

    Raises
    ------
    InputError : a block, a node entry or the labels do not fit nq.
    """

    mass: float
    labels: tuple[str, ...]
    nodes: tuple[Node, ...]
    mdCM: Taylor
    J: Taylor
    Ct: Taylor
    Cr: Taylor
    Me: Taylor
    Gr: Taylor
    Ge: Taylor
    Oe: Taylor
    ksigma: Taylor
    Ke: Taylor
    De: Taylor
    title: str = ""
    extra: Mapping[str, Taylor] = field(default_factory=dict)
    dialect: Dialect = field(default_factory=Dialect)
    written_by: str = ""
    carried: ComplianceShares | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    from_matrices: bool = False
    has_peak_nodes: bool | None = None
    sections: tuple[Section, ...] = ()

    def __post_init__(self) -> None:
        nq = self.nq
        for name in BLOCK_SHAPES:
            _check_shape(getattr(self, name), name, nq)
        for node in self.nodes:
            for name in NODE_SHAPES:
                entry = getattr(node, name)
                if entry is not None:
                    _check_shape(entry, name, nq, node)
        for section in self.sections:
            if section.part.nq != nq + section.jumps:
                raise InputError(
                    f"has {section.part.nq} elastic coordinates",
                    place=f"section {section.name}",
                    expected=f"{nq}, as the body has",
                )
        ids = [node.id for node in self.nodes]
        if len(set(ids)) != len(ids):
            repeated = Counter(ids).most_common(1)[0][0]
            raise InputError(
                f"node {repeated} appears twice", expected="one node per id"
            )

    def __repr__(self) -> str:
        size = f"{len(self.nodes)} nodes, {self.nq} modes"
        return f"<SID {self.title!r}: {size}, mass {self.mass:g}>"

    def _repr_html_(self) -> str:
        """For notebooks: modes and nodes."""
        title = f"{self.title or 'SID'}, mass {self.mass:.6g}"
        modes = html_table(enumerate(self.labels, 1), ("q", "mode"), title)
        nodes = self.nodes[:12]
        places = [(node.id, *(f"{x:.6g}" for x in node.position)) for node in nodes]
        more = f"{len(nodes)} of {len(self.nodes)} nodes"
        return modes + html_table(places, ("node", "x", "y", "z"), more)

    @property
    def nq(self) -> int:
        """Number of elastic coordinates."""
        return len(self.labels)

    @property
    def blocks(self) -> dict[str, Taylor]:
        """The eleven body blocks in file order."""
        return {name: getattr(self, name) for name in BLOCK_SHAPES}

    @cached_property
    def shapes(self) -> tuple[Array, Array]:
        """phi m0 and psi m0 of all nodes, (n, 3, nq) each."""
        size = (len(self.nodes), 3, self.nq)
        phi = np.array([node.phi.m0 for node in self.nodes]).reshape(size)
        psi = np.array([node.psi.m0 for node in self.nodes]).reshape(size)
        return phi, psi

    @cached_property
    def largest_shapes(self) -> tuple[float, float]:
        """The largest magnitudes of phi m0 and of psi m0."""
        phi, psi = (float(np.abs(shapes).max(initial=0.0)) for shapes in self.shapes)
        return phi, psi

    def section(self, name: str) -> Section:
        """The section with this name.

        Raises
        ------
        InputError : there is none.
        """
        for section in self.sections:
            if section.name == name:
                return section
        known = ", ".join(section.name for section in self.sections[:8])
        more = ", ..." if len(self.sections) > 8 else ""
        raise InputError(
            f"there is no section {name!r}",
            expected=f"one of the sections {known}{more}"
            if known
            else "a body with [section_forces], converted to an .h5 file or named as "
            "`model`",
        )

    def node(self, node_id: str | int) -> Node:
        """The node with this id.

        Raises
        ------
        InputError : no node has it.
        """
        key = str(node_id)
        for node in self.nodes:
            if node.id == key:
                return node
        known = ", ".join(node.id for node in self.nodes[:8]) or "none at all"
        more = ", ..." if len(self.nodes) > 8 else ""
        raise InputError(
            f"there is no node {key}", expected=f"one of the nodes {known}{more}"
        )


def _check_shape(entry: Taylor, name: str, nq: int, node: Node | None = None) -> None:
    rows, columns = block_shape(name, nq)
    if entry.order == 0 and entry.m0.shape == (rows, columns):
        return
    place = f"block {name}" if node is None else f"node {node.id}, {name}"
    if entry.shape != (rows, columns):
        shape = "{} x {}".format(*entry.shape)
        raise InputError(
            f"has {shape} entries",
            place=place,
            expected=f"{rows} x {columns} for {nq} elastic coordinates",
        )
    for part, count in ((entry.m1, nq), (entry.mn, None)):
        if part is None:
            continue
        fits = part.ndim == 3 and part.shape[1:] == (rows, columns)
        if not fits or (count is not None and len(part) != count):
            raise InputError(
                f"has a higher-order term of shape {part.shape}",
                place=place,
                expected=f"({count or 'n'}, {rows}, {columns})",
            )


def symmetric_3x3(six: Array) -> Array:
    """(..., 6) tensor elements (xx, yy, zz, xy, xz, yz) as (..., 3, 3)."""
    return six[..., [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]


def by_mode(columns: Array, nq: int) -> Array:
    """Axis-major columns (..., n, 3 nq) of Gr or Ge, by mode (..., nq, n, 3)."""
    *lead, rows, _ = columns.shape
    return np.moveaxis(columns.reshape(*lead, rows, 3, nq), -1, -3)


def axis_major(matrices: Array) -> Array:
    """Inverse of `by_mode`: (nq, n, 3) as (n, 3 nq) with axis-major columns."""
    nq, rows, _ = matrices.shape
    return np.ascontiguousarray(np.moveaxis(matrices, 0, -1).reshape(rows, 3 * nq))


def rigid_sid(
    mass: float, centre: ArrayLike, inertia: ArrayLike, nodes: tuple[Node, ...] = ()
) -> SID:
    """A rigid body as a SID without elastic coordinates.

    Parameters
    ----------
    mass : [kg]
    centre : (3,) centre of mass in the body frame [m]
    inertia : (3, 3) inertia tensor about the body-frame origin [kg m2]
    nodes : exported points; see `rigid_node`
    """
    six = np.asarray(inertia, float)[tuple(zip(*J_INDICES, strict=True))]
    moment = Taylor(mass * np.asarray(centre, float).reshape(3, 1))
    blocks = {**_empty_blocks(), "mdCM": moment, "J": Taylor(six[:, None])}
    return SID(mass=float(mass), labels=(), nodes=nodes, **blocks)


@cache
def _empty_blocks() -> dict[str, Any]:
    return {name: _zero_expansion(block_shape(name, 0)) for name in BLOCK_SHAPES}


@cache
def _zero_expansion(shape: tuple[int, int]) -> Taylor:
    return Taylor(np.zeros(shape))


def rigid_node(
    node_id: str, position: ArrayLike, rotation: ArrayLike | None = None
) -> Node:
    """A node of a body without elastic coordinates.

    Parameters
    ----------
    position : (3,) in the body frame [m]
    rotation : (3, 3) node frame to body frame, identity by default
    """
    frame = np.eye(3) if rotation is None else rotation
    empty = _zero_expansion((3, 0))
    return Node(
        id=node_id,
        origin=Taylor(np.asarray(position, float).reshape(3, 1)),
        phi=empty,
        psi=empty,
        AP=Taylor(np.asarray(frame, float)),
    )
