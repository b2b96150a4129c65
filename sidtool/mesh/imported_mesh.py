"""Content of a mesh file of any program.

Nodes of elements: repeated ones and missing mid-side nodes.

Hexahedra and quadrilaterals with repeated nodes are prisms, pyramids, tetrahedra and
triangles. The displacement along an edge without its mid-side node is linear, as that
of a linear neighbour: a node is placed midway between the corners and moves by their
mean.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import chain, filterfalse, permutations
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from .connections import RawBar, RawEquation, RawShell, RawSpring, RawTie
from .materials import ElasticMaterial
from .mesh import ElementBlock, Mesh
from .reference_elements import edge_nodes, quadratic_kind, reference_element, shape_of

#: Corners of a cube in the order of hex8, and how nodes of one that collapses repeat:
#: the collapsed shape and which of its corners these are.
_CUBE = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    + [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
)
_PATTERNS = {
    "wedge6": ((0, 1, 2, 2, 4, 5, 6, 6), (0, 1, 2, 4, 5, 6)),
    "pyramid5": ((0, 1, 2, 3, 4, 4, 4, 4), (0, 1, 2, 3, 4)),
    "tet4": ((0, 1, 2, 2, 4, 4, 4, 4), (0, 1, 2, 4)),
}

Point = tuple[float, float, float]
Indices = NDArray[np.int64]
#: Among ignored words: only the nodes of a file are requested.
ONLY_NODES = "EVERYTHING"
#: A range with more members is refused as a damaged number.
MOST_MEMBERS = 5_000_000
#: Suffix of the name of a keyword that the user ignores.
LEFT_OUT = " (left out by geometry.ignore)"
#: Kinds of elements whose nodes may coincide.
_COLLAPSIBLE = ("quad4", "hex8")
#: Labels up to so many times their number are found in a table.
_DENSE = 10
#: Elements without a kind.
_CALLED = {RawBar: "bar", RawSpring: "spring"}


def collapse_element(kind: str, nodes: Sequence[int]) -> tuple[str, list[int]]:
    """Return the element with coinciding nodes merged; others are unchanged.

    Only kinds of `_COLLAPSIBLE` change. A hexahedron may repeat nodes at any of its
    edges and faces.
    """
    listed = list(nodes)
    distinct = len(set(listed))
    if kind == "quad4" and distinct == 3:
        cyclic = [n for i, n in enumerate(listed) if n != listed[i - 1]]
        return ("tri3", cyclic) if len(cyclic) == 3 else (kind, listed)
    if kind != "hex8" or distinct == len(listed):
        return kind, listed
    for order in _cube_rotations():
        turned = [listed[i] for i in order]
        for shape, (pattern, corners) in _PATTERNS.items():
            same = all(turned[i] == turned[k] for i, k in enumerate(pattern))
            if same and distinct == len(corners):
                return shape, [turned[i] for i in corners]
    return kind, listed


@cache
def _cube_rotations() -> tuple[tuple[int, ...], ...]:
    """The orders of a cube's corners that its 24 rotations make."""
    number = {tuple(corner): i for i, corner in enumerate((2 * _CUBE - 1).tolist())}
    rotations = []
    for axes in permutations(range(3)):
        for signs in np.ndindex(2, 2, 2):
            turn = np.zeros((3, 3), int)
            turn[range(3), axes] = 1 - 2 * np.array(signs)
            if round(float(np.linalg.det(turn))) == 1:
                places = (2 * _CUBE - 1) @ turn.T
                rotations.append(tuple(number[tuple(p)] for p in places.tolist()))
    return tuple(rotations)


class MidsideNodes:
    """Inserted mid-side nodes, and the equations that define their motion.

    Attributes
    ----------
    nodes : label -> position of all nodes, including added ones
    added : their labels by the corners at their sides
    equations : three (or two) for every added node
    """

    def __init__(self, nodes: Mapping[int, Point]) -> None:
        self.nodes = dict(nodes)
        self.added: dict[tuple[int, int], int] = {}
        self.equations: list[RawEquation] = []
        self._next = min(0, *nodes, 0) - 1  # labels that no file can have

    def completed(
        self, kind: str, nodes: Sequence[int], place: str
    ) -> tuple[str, list[int]]:
        """The element with all its nodes; the linear one if it has no middle.

        Parameters
        ----------
        nodes : 0 where there is none
        """
        element = reference_element(kind)
        corners = element.corners
        if 0 not in nodes or not all(nodes[:corners]):
            return kind, list(nodes)
        if not any(nodes[corners:]):
            return linear_kind(kind), list(nodes[:corners])
        full = list(nodes)
        for i, (a, b) in enumerate(edge_nodes(kind), start=corners):
            if not full[i] and {nodes[a], nodes[b]} <= self.nodes.keys():
                full[i] = self._middle(nodes[a], nodes[b], element.dimension, place)
        return kind, full

    def _middle(self, a: int, b: int, dimension: int, place: str) -> int:
        key = (min(a, b), max(a, b))
        if key not in self.added:
            label = self._next
            self._next -= 1
            x, y, z = (np.add(self.nodes[a], self.nodes[b]) / 2).tolist()
            self.nodes[label] = (x, y, z)
            self.added[key] = label
            for axis in np.eye(3)[:dimension].tolist():
                x, y, z = axis
                half = (-x / 2, -y / 2, -z / 2)
                terms = ((label, (x, y, z)), (a, half), (b, half))
                self.equations.append(RawEquation(terms, place))
        return self.added[key]


def linear_kind(kind: str) -> str:
    """The linear element with the corners of a quadratic one."""
    shape, corners = shape_of(kind), reference_element(kind).corners
    linear = f"{shape}{corners}"
    assert quadratic_kind(linear) == kind
    return linear


@dataclass(frozen=True)
class RawCoupling:
    """Nodes that move with a reference node, by their labels.

    Attributes
    ----------
    rigid : whether the nodes are one rigid piece; else the reference node takes their
        mean motion
    reference : label of the reference node, None where the file has none
    turns : whether nodes that turn by themselves turn with the rigid piece
    directions : 1 to 6, in which the nodes of a rigid piece follow it
    by_area : True if the weight of a node is its share of the surface
    weights : weights of the nodes in the mean; empty for equal weights
    turning : nodes of a mean whose rotations take part in it
    """

    name: str
    rigid: bool
    nodes: tuple[int, ...]
    reference: int | None
    place: str
    turns: bool = True
    by_area: bool = False
    weights: tuple[float, ...] = ()
    directions: str = "123456"
    turning: tuple[int, ...] = ()


@dataclass(frozen=True)
class RawMass:
    """A mass at a node, by its label.

    Attributes
    ----------
    offset : from the node
    inertia : xx, yy, zz, xy, yz, zx about its centre; products as in J, so that they
        are minus the integrals of x y dm
    """

    node: int
    mass: float
    place: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0,) * 6

    def scaled(self, factor: float) -> RawMass:
        """Return the mass with mass and inertia times a factor."""
        xx, yy, zz, xy, yz, zx = (factor * value for value in self.inertia)
        inertia = (xx, yy, zz, xy, yz, zx)
        return replace(self, mass=factor * self.mass, inertia=inertia)


@dataclass(frozen=True, eq=False)
class ImportedMesh:
    """A mesh with further content of its file.

    Attributes
    ----------
    mesh : in the units of the file; plane meshes in two dimensions
    materials : by the names in the blocks of the mesh; only complete ones
    state : "plane_stress" or "plane_strain" if the element types state it
    diagnostics : what was read, replaced and ignored
    couplings, masses : couplings of nodes, and point masses
    equations, ties : equations between displacements, and ties of surfaces
    bars : bars instead of elements of the mesh, which then has nodes only
    parts : name -> labels of the elements of a part that may be selected
    undefined : set -> its members that the file does not define, in words
    straight : labels of nodes that are the mean of the corners beside them
    """

    mesh: Mesh
    materials: Mapping[str, ElasticMaterial] = field(default_factory=dict)
    state: str | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    couplings: tuple[RawCoupling, ...] = ()
    masses: tuple[RawMass, ...] = ()
    equations: tuple[RawEquation, ...] = ()
    ties: tuple[RawTie, ...] = ()
    bars: tuple[RawBar, ...] = ()
    shells: tuple[RawShell, ...] = ()
    springs: tuple[RawSpring, ...] = ()
    parts: Mapping[str, Sequence[int]] = field(default_factory=dict)
    undefined: Mapping[str, str] = field(default_factory=dict)
    straight: frozenset[int] = frozenset()

    @property
    def is_structure(self) -> bool:
        """Whether it has elements with rotational degrees of freedom."""
        return bool(self.bars or self.shells or self.springs)

    @property
    def nodes_in_equations(self) -> set[int]:
        """Labels of nodes that equations name."""
        return {n for e in self.equations for n, _ in (*e.terms, *e.rotations)}


@dataclass(frozen=True)
class RawElement:
    """One element of a file: its location and the labels of its nodes.

    `thickness` is that of a plane element and `formulation` that of our element, if
    the file states them.
    """

    label: int
    kind: str
    nodes: Sequence[int]
    place: str
    material: str | None = None
    thickness: float | None = None
    formulation: str | None = None


class _Labelled(Protocol):
    """An element of a file, with its number and where it stands."""

    @property
    def label(self) -> int: ...

    @property
    def place(self) -> str: ...


def check_unique_labels(
    elements: Iterable[_Labelled], others: Iterable[int] = ()
) -> None:
    """Refuse elements that share a number, also with other elements.

    Raises
    ------
    InputError : a number appears twice.
    """
    known = set(others)
    for element in elements:
        if element.label in known:
            raise InputError(
                f"element {element.label} is defined twice",
                place=element.place,
                expected="one definition",
            )
        known.add(element.label)


def assemble_mesh(
    nodes: Mapping[int, tuple[float, float, float]],
    elements: Iterable[RawElement],
    sets: Mapping[str, Iterable[int]],
) -> Mesh:
    """A mesh from labelled nodes and elements; a plane one in two dimensions.

    Raises
    ------
    InputError : an element names an unknown node or has too few, a label appears
        twice, or plane and solid elements are mixed.
    """
    labels = np.fromiter(nodes, np.int64, len(nodes))
    groups: dict[tuple[Any, ...], list[RawElement]] = {}
    elements = list(elements)
    check_unique_labels(elements)
    for element in elements:
        if element.kind in _COLLAPSIBLE:
            kind, listed = collapse_element(element.kind, element.nodes)
            if kind != element.kind:
                element = replace(element, kind=kind, nodes=listed, formulation=None)
        alike = (element.kind, element.material, element.thickness, element.formulation)
        groups.setdefault(alike, []).append(element)
    if not groups:
        raise InputError("holds no solid element", expected="a mesh of solid elements")
    dimensions = {reference_element(kind).dimension for kind, *_ in groups}
    if len(dimensions) > 1:
        raise InputError(
            "mixes plane and solid elements", expected="elements of one dimension"
        )
    d = dimensions.pop()
    positions = np.array(list(nodes.values()), float).reshape(-1, 3)
    _check_finite(positions, labels)
    blocks = tuple(
        ElementBlock(
            kind,
            _rows_of_nodes(group, labels, nodes),
            np.array([e.label for e in group], np.int64),
            material,
            thickness,
            formulation,
        )
        for (kind, material, thickness, formulation), group in groups.items()
    )
    if d == 2:
        used = np.unique(np.concatenate([b.nodes.ravel() for b in blocks]))
        if np.ptp(positions[used, 2]) > 1e-9 * np.ptp(positions[used], axis=0).max():
            raise InputError(
                "has plane elements outside a plane z = constant",
                expected="a plane mesh in the xy plane, or geometry.engine = "
                '"calculix", which makes shells of those of an .inp or .bdf',
            )
    return Mesh(positions[:, :d], blocks, _members_of_sets(nodes, sets), labels)


def mesh_of_points(
    nodes: Mapping[int, tuple[float, float, float]],
    sets: Mapping[str, Iterable[int]],
) -> Mesh:
    """Nodes and their sets without elements.

    Raises
    ------
    InputError : a node has no finite position.
    """
    labels = np.fromiter(nodes, np.int64, len(nodes))
    positions = np.array(list(nodes.values()), float).reshape(-1, 3)
    _check_finite(positions, labels)
    return Mesh(positions, (), _members_of_sets(nodes, sets), labels)


def _members_of_sets(
    nodes: Mapping[int, object], sets: Mapping[str, Iterable[int]]
) -> dict[str, Indices]:
    row = {label: i for i, label in enumerate(nodes)}
    return {
        name: np.array(sorted({row[n] for n in group if n in row}), np.int64)
        for name, group in sets.items()
    }


def find_undefined_members(
    known: Container[int], sets: Mapping[str, Iterable[int]], what: str = "node"
) -> dict[str, str]:
    """Return the first undefined member of each set as text.

    Parameters
    ----------
    known : labels that the file defines
    what : which kind of members the sets have
    """
    undefined = {
        name: next((n for n in group if n not in known), None)
        for name, group in sets.items()
    }
    return {name: f"{what} {n}" for name, n in undefined.items() if n is not None}


def undefined_notes(undefined: Mapping[str, str]) -> list[Diagnostic]:
    """Return N130 on sets that cannot be used, if there are some."""
    sets = [f"{name} ({member})" for name, member in undefined.items()]
    return [diagnose("N130", sets=sets)] if sets else []


def _check_finite(positions: Array, labels: Indices) -> None:
    rows = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    if rows.size:
        raise InputError(
            f"node {labels[rows[0]]} has no finite position",
            expected="finite coordinates",
        )


def unread_keyword_notes(keywords: Iterable[str]) -> list[Diagnostic]:
    """Return diagnostics of keywords that were not read (N112, N113).

    They distinguish keywords that cannot change a body from those ignored by
    `geometry.ignore`, whose masses, stiffnesses and ties are missing.
    """
    names = list(keywords)
    left_out = [n.removesuffix(LEFT_OUT) for n in names if n.endswith(LEFT_OUT)]
    idle = [name for name in names if not name.endswith(LEFT_OUT)]
    found = (("N112", idle), ("N113", left_out))
    return [diagnose(code, keywords=names) for code, names in found if names]


def reading_notes(
    nodes: Mapping[int, object],
    elements: Sequence[RawElement | RawBar | RawShell | RawSpring],
    given: int,
) -> list[Diagnostic]:
    """Return how many elements and nodes of a file were read (N110, N111).

    Parameters
    ----------
    given : elements in the file, with those of lower dimension that only name nodes
    """
    counts = Counter(
        _CALLED.get(type(element)) or getattr(element, "kind", "")
        for element in elements
    )
    used = {*chain.from_iterable(element.nodes for element in elements)} - {None}
    found = [
        diagnose(
            "N110",
            elements=len(elements),
            given=given,
            kinds=[f"{count} {kind}" for kind, count in counts.items()],
            used=len(used),
            nodes=len(nodes),
        )
    ]
    if given > len(elements):
        omitted = given - len(elements)
        found.append(diagnose("N111", count=omitted, reason="of lower dimension"))
    return found


def rows_of_labels(labels: Indices, nodes: Sequence[Sequence[int]]) -> Indices:
    """Return the rows of nodes (k, m) in a table of labels (n,), -1 of unknown ones."""
    given = np.array(nodes, np.int64)
    largest = labels.max(initial=0)
    if labels.min(initial=0) >= 0 and largest < _DENSE * (len(labels) + 100):
        rows = np.full(largest + 2, -1)
        rows[labels] = np.arange(len(labels))
        return np.asarray(rows[given.clip(-1, largest + 1)])
    order = labels.argsort()
    places = np.searchsorted(labels, given, sorter=order)
    rows = order[np.minimum(places, len(labels) - 1)]
    return np.where(labels[rows] == given, rows, -1)


def _rows_of_nodes(
    group: Sequence[RawElement], labels: Indices, nodes: Container[int]
) -> Indices:
    """Return the rows of the nodes of elements of one kind.

    Raises
    ------
    InputError : an element has too few nodes, or an unknown one.
    """
    listed = [element.nodes for element in group]
    if set(map(len, listed)) == {len(reference_element(group[0].kind).nodes)}:
        rows = rows_of_labels(labels, listed)
        if rows.min() >= 0:
            return rows
    for element in group:
        _check_nodes(element, nodes)
    raise AssertionError("one of the elements is wrong")


def _check_nodes(element: RawElement, nodes: Container[int]) -> None:
    needed = len(reference_element(element.kind).nodes)
    if len(element.nodes) != needed:
        raise InputError(
            f"element {element.label} ({element.kind}) has {len(element.nodes)} nodes",
            place=element.place,
            expected=f"{needed} nodes",
        )
    check_defined(element.label, element.nodes, nodes, element.place)


def check_defined(
    label: int, nodes: Iterable[int], known: Container[int], place: str
) -> None:
    """Check that an element names defined nodes only.

    Raises
    ------
    InputError : it does not.
    """
    for node in filterfalse(known.__contains__, nodes):
        raise InputError(
            f"element {label} names node {node}, which is not defined",
            place=place,
            expected="a node of this file",
        )
