"""Finite element model of a body before its reduction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from sidtool.formats.base.complex_step import is_nonzero, numbers
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.sid_mass import skew

from ..mesh.connections import Coupling, Equations, PointMass
from .faces import Surface
from .material_points import BarEnds, BeamMaterial, Continuum, InertiaPoints
from .solid_mesh import InternalInertia

if TYPE_CHECKING:
    from ..geometry.nurbs_patch import NurbsPatch
    from ..mesh.mesh import Mesh
    from .solid_mesh import SolidMesh

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class GeometryMass:
    """Exact mass and first moments of a body, by integrals over its surface.

    Attributes
    ----------
    mass : [kg]
    first : (d,) first moments [kg m]
    sampled : whether the mesh only approximates the geometry
    """

    mass: float
    first: Array
    sampled: bool = False


@dataclass(frozen=True, eq=False)
class MarkerRows:
    """A named point and the rows that evaluate the motion there.

    Attributes
    ----------
    name, node : its name in the model file and its node number in the SID
    position : (3,) in the axes of the model [m]
    displacement : (3, ndof) sparse; displacement of the point = rows @ u
    rotation : (3, ndof) sparse; right-handed small rotation of the point = rows @ u
    gradient : (9, ndof) sparse; derivative of u_a by x_b = row 3 a + b, internal modes
        of the elements included
    tangent : (3,) direction of the beam whose cross-section it is
    nodal : `displacement` without the internal modes of the elements, if they have some
    """

    name: str
    node: int
    position: Array
    displacement: sp.csr_matrix
    rotation: sp.csr_matrix
    gradient: sp.csr_matrix | None = None
    tangent: Array | None = None
    nodal: sp.csr_matrix | None = None


def fixed_marker(name: str, node: int, position: Array, ndof: int) -> MarkerRows:
    """Return a marker at a position without connection to the body."""
    rows = sp.csr_matrix((3, ndof))
    return MarkerRows(name, node, np.pad(position, (0, 3 - position.size)), rows, rows)


def moving_dofs(rows: sp.csr_matrix) -> Indices:
    """Return the degrees of freedom that rows (k, ndof) depend on."""
    return np.asarray(rows.indices[is_nonzero(rows.data)], np.int64)


def offset_marker(marker: MarkerRows, position: Array) -> MarkerRows:
    """Return a marker at another position that moves as a rigid arm of this one."""
    place = np.pad(position, (0, 3 - position.size))
    turn = sp.csr_matrix(-skew((place - marker.position)[None])[0]) @ marker.rotation
    nodal = marker.nodal
    return replace(
        marker,
        position=place,
        displacement=sp.csr_matrix(marker.displacement + turn),
        nodal=None if nodal is None else sp.csr_matrix(nodal + turn),
    )


@dataclass(frozen=True, eq=False)
class BeamOutline:
    """The successive cross-sections of a beam or bar, for pictures.

    places : (n, 3) [m]
    axes : (n, 2, 3) unit vectors y and z of every section
    halves : (n, 2) half their extent along these [m]
    motion : (6 n, ndof) displacement and rotation of every section
    """

    places: Array
    axes: Array
    halves: Array
    motion: sp.csr_matrix


@dataclass(frozen=True, eq=False)
class BodyCut:
    """A cross-section of a body and what lies beyond it.

    Attributes
    ----------
    name : of the section
    section : its motion; the node number is that of no marker
    axes : (3, 3) rows: the tangent, or the normal of a plane cut, and the axes y, z of
        the section
    points : (p,) mask of the inertia points beyond; with `jump`, those of the element
        at the cut
    markers : names of the markers beyond
    scalar_mass, internal_inertia : of a solid, those of the part beyond
    resultants : (6, ndof) sparse; section forces = rows @ u. None where the cut
        separates the body
    jump : (ndof, 6) sparse; displacement of the element's end at the node by a unit
        jump along each section force. None where the cut separates the body
    """

    name: str
    section: MarkerRows
    axes: Array
    points: NDArray[np.bool_]
    markers: tuple[str, ...]
    resultants: sp.csr_matrix | None = None
    jump: sp.csr_matrix | None = None
    scalar_mass: sp.csr_matrix | None = None
    internal_inertia: InternalInertia | None = None


@dataclass(frozen=True, eq=False)
class BeamStress:
    """Points of a beam at which its stress can be largest.

    Attributes
    ----------
    positions : (p, 3) [m]
    displacement, rotation : (3 p, ndof) sparse; their motion = rows @ u
    stress : (6 p, ndof) sparse; xx, yy, zz, xy, yz, xz = rows @ u [Pa]
    """

    positions: Array
    displacement: sp.csr_matrix
    rotation: sp.csr_matrix
    stress: sp.csr_matrix


def _no_alternative(_: tuple[str, ...]) -> Surface | None:
    return None


@dataclass(frozen=True, eq=False)
class ElementAlternative:
    """Better elements on the same mesh, for comparison with those of a body.

    Attributes
    ----------
    own, better : names of the elements
    size : degrees of freedom with the better ones, at most
    remedy : text on how to use the better elements
    discretise : function that returns the body with them, without markers; raises
        InputError
    """

    own: str
    better: str
    size: int
    remedy: str
    discretise: Callable[[], FiniteElementModel]


@dataclass(frozen=True, eq=False)
class FiniteElementModel:
    """Nodes (or control points) with mass and stiffness, in two or three dimensions.

    Without `dof_table`, degree of freedom ``d * i + a`` is the displacement of node i
    along axis a, and the field of positions lies in the space of the displacements: a
    point of the body is sum_i N_i X_i, its displacement sum_i N_i u_i.

    The mass is `full_mass` if that is given (an imported matrix), and otherwise the
    sum of `scalar_mass`, `internal_inertia` and `inertia_points`.

    Attributes
    ----------
    positions : (n, d) with d = 2 or 3 [m]
    scalar_mass : (n, n) sparse, integral of rho N_i N_j dV [kg]; its share of the mass
        matrix is the Kronecker product with the d x d identity
    stiffness : (ndof, ndof) sparse, symmetric [N/m]
    node_sets : name -> node numbers; the edges and faces among them
    markers : in the order of the model file
    full_mass : (ndof, ndof) sparse, symmetric
    internal_inertia : displacements inside elements that depend on the nodes; the field
        then has more functions than nodes
    inertia_points : particles with rotary inertia: lumped masses, quadrature points of
        beams
    dof_table : (n, 6) number of the degree of freedom that is the displacement along
        x, y, z and the rotation about x, y, z of every node; -1 where there is none
    internal : (n,) mask of rows of `positions` that are no points but internal modes of
        elements, which vanish in rigid motion; their position is the element centre
    rigid_sets : name of a marker or a piece -> nodes that move as one rigid piece
    pieces : rigid pieces that are no markers of the model file
    couplings, point_masses : couplings and point masses of the file of the body
    equations : equations that all displacements satisfy
    continua : materials of solid elements, for stresses
    beam_material : the material of beam elements, for stress resultants
    bar_ends : of beam elements that do not continue each other
    surface : function that returns the surface of named edges, faces or node sets; None
        if their nodes have no common surface
    geometry_mass : mass and centre of the geometry by an independent quadrature
    solids : the elements, if the body is a mesh of solid ones
    alternative : the same body with better elements, if another program discretises it
    drawing_mesh : a mesh for pictures whose nodes are the first rows of `positions`,
        if they need one besides `solids`
    patches : NURBS patches with the nodes that their control points are
    outlines : function that returns those of a beam or of bars, for pictures
    cuts : sections for section forces
    beam_stress : points of a beam whose stress is requested
    diagnostics : properties of the body that are not in the model file
    """

    positions: Array
    scalar_mass: sp.csr_matrix | None
    stiffness: sp.csr_matrix
    node_sets: Mapping[str, Indices]
    markers: tuple[MarkerRows, ...]
    full_mass: sp.csr_matrix | None = None
    internal_inertia: InternalInertia | None = None
    inertia_points: InertiaPoints | None = None
    dof_table: Indices | None = None
    internal: NDArray[np.bool_] | None = None
    rigid_sets: Mapping[str, Indices] = field(default_factory=dict)
    pieces: tuple[MarkerRows, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    point_masses: tuple[PointMass, ...] = ()
    equations: Equations | None = None
    continua: tuple[Continuum, ...] = ()
    beam_material: BeamMaterial | None = None
    bar_ends: BarEnds | None = None
    surface: Callable[[tuple[str, ...]], Surface | None] = _no_alternative
    geometry_mass: Callable[[], GeometryMass] | None = None
    solids: SolidMesh | None = None
    alternative: ElementAlternative | None = None
    drawing_mesh: Mesh | None = None
    patches: tuple[tuple[NurbsPatch, Indices], ...] = ()
    outlines: Callable[[], tuple[BeamOutline, ...]] = tuple
    cuts: tuple[BodyCut, ...] = ()
    beam_stress: BeamStress | None = None
    diagnostics: tuple[Diagnostic, ...] = ()

    @property
    def dimension(self) -> int:
        """Number of displacement components of a node."""
        return self.positions.shape[1]

    @property
    def ndof(self) -> int:
        """Number of degrees of freedom."""
        return self.stiffness.shape[0]

    @cached_property
    def mass(self) -> sp.csr_matrix:
        """(ndof, ndof) mass matrix."""
        if self.inertia_points is None or self.full_mass is not None:
            return self.field_mass
        points = self.inertia_points.mass_matrix()
        return sp.csr_matrix(self.field_mass + points)

    @cached_property
    def field_mass(self) -> sp.csr_matrix:
        """(ndof, ndof) mass matrix without the inertia points."""
        if self.full_mass is not None:
            return self.full_mass
        if self.scalar_mass is None:
            return sp.csr_matrix((self.ndof, self.ndof))
        spread = self._spread(self.scalar_mass)
        inner = self.internal_inertia
        return spread if inner is None else sp.csr_matrix(spread + inner.added)

    @cached_property
    def table(self) -> Indices:
        """(n, 6) degrees of freedom by node: displacements, rotations; -1 for none."""
        if self.dof_table is not None:
            return self.dof_table
        n, d = self.positions.shape
        table = np.full((n, 6), -1, dtype=np.int64)
        table[:, :d] = np.arange(n * d).reshape(n, d)
        return table

    @property
    def place_table(self) -> Indices:
        """`table` without the rows that are no places."""
        if self.internal is None:
            return self.table
        return np.where(self.internal[:, None], -1, self.table)

    def marker(self, name: str) -> MarkerRows:
        """The marker with this name."""
        known = (*self.markers, *self.pieces)
        return next(marker for marker in known if marker.name == name)

    def dofs(self, nodes: Indices) -> Indices:
        """The degrees of freedom of some nodes, node by node, rotations included."""
        numbers = self.table[nodes].ravel()
        return numbers[numbers >= 0]

    def by_node(self, vectors: Array) -> Array:
        """(ndof, ...) as (n, 6, ...): displacement and rotation of every node.

        Components that a node does not have are zero.
        """
        padded = np.concatenate([vectors, np.zeros((1, *vectors.shape[1:]))])
        return padded[self.table]

    def rigid_body_modes(self, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """(ndof, 3 or 6) unit displacements and unit rotations about `origin`.

        Columns: x, y, rotation about z of a plane body; x, y, z and the three
        rotations of a spatial one.
        """
        n, d = self.positions.shape
        arms = np.pad(self.positions, ((0, 0), (0, 3 - d))) - numbers(origin)
        motion = np.zeros((n, 6, 6), arms.dtype)
        motion[:] = np.eye(6)
        motion[:, :3, 3:] = -skew(arms)
        modes = np.zeros((self.ndof, 6), arms.dtype)
        there = self.place_table >= 0
        modes[self.table[there]] = motion[there]
        return modes if d == 3 else modes[:, [0, 1, 5]]

    @cached_property
    def directions(self) -> Array:
        """(ndof,) 1, 2, 3 of displacements along x, y, z, and 0 of rotations."""
        axes = 3 if self.positions.shape[1] == 3 else 2
        unit = np.abs(self.rigid_body_modes().real[:, :axes])
        return unit @ np.arange(1.0, axes + 1.0)

    @cached_property
    def dof_positions(self) -> Array:
        """(ndof, d) position of the node of every degree of freedom [m]."""
        there = self.table >= 0
        nodes = np.broadcast_to(np.arange(len(self.table))[:, None], there.shape)
        positions = np.zeros((self.ndof, self.dimension), self.positions.dtype)
        positions[self.table[there]] = self.positions[nodes[there]]
        return positions

    def coordinate_positions(self, transform: sp.csr_matrix) -> Array:
        """Return positions (n, d) of the coordinates y of displacements ``transform @
        y``: of its node, or the mean of the nodes that it moves.
        """
        moved = sp.csr_matrix(abs(transform) > 0).astype(float)
        return (moved.T @ self.dof_positions) / (moved.T @ np.ones((self.ndof, 1)))

    def linear_fields(self, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        """(ndof, 1 or 6) displacements S r with symmetric S at r from `origin`.

        The accelerations w x (w x r) of all angular velocities w are among them: of a
        plane body r, of a spatial one those of every S. Rotations are zero.
        """
        n, d = self.positions.shape
        arms = self.positions - numbers(origin)[:d]
        pairs = [(a, b) for a in range(d) for b in range(a, d)]
        fields = np.zeros((n, d, len(pairs)), arms.dtype)
        for column, (a, b) in enumerate(pairs):
            fields[:, a, column] = arms[:, b]
            fields[:, b, column] = arms[:, a]
        if d == 2:
            fields = arms[:, :, None]
        there = self.place_table[:, :d] >= 0
        motion = np.zeros((self.ndof, fields.shape[2]), arms.dtype)
        motion[self.table[:, :d][there]] = fields[there]
        return motion

    def _spread(self, scalar: sp.csr_matrix) -> sp.csr_matrix:
        """The scalar mass on every displacement component."""
        d = self.dimension
        if self.dof_table is None:
            return sp.csr_matrix(sp.kron(scalar, sp.eye_array(d)))
        entries = scalar.tocoo()
        total = sp.csr_matrix((self.ndof, self.ndof))
        for axis in range(d):
            i, j = self.table[entries.row, axis], self.table[entries.col, axis]
            is_dof = (i >= 0) & (j >= 0)
            part = (entries.data[is_dof], (i[is_dof], j[is_dof]))
            total = total + sp.csr_matrix(part, shape=total.shape)
        return total
