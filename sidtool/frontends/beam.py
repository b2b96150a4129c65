"""Straight beams of Euler-Bernoulli and Timoshenko.

Two-node elements with six degrees of freedom to a node. The stiffness of Timoshenko's
beam and its shapes are those of the exact solution for a constant section
(J. S. Przemieniecki, Theory of Matrix Structural Analysis, 1968, sections 5.6 and
11.4), so that thin beams do not lock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile, NodeMarker
from sidtool.formats.model.discretisation import BeamDiscretisation
from sidtool.formats.model.geometry import (
    BeamGeometry,
    GeneralSection,
    RectangularSection,
)
from sidtool.formats.sid_mass import skew

from .beam_mass import beam_mass
from .beam_material import BeamMaterial
from .finite_element_model import FiniteElementModel, MarkerRows, Outline
from .inertia_points import InertiaPoints
from .patch_markers import at_marker, check_length, placed

Array = NDArray[np.float64]

_GAUSS_POINTS = 4
#: Sections are smaller than this [m].
LARGEST = 1e9


@dataclass(frozen=True)
class Section:
    """Properties of a cross-section, see `GeneralSection`."""

    area: float
    iy: float
    iz: float
    torsion: float
    shear_y: float
    shear_z: float


@dataclass(frozen=True, eq=False)
class Line:
    """Where a beam is: start (3,), axes (3, 3) as rows, length [m]."""

    start: Array
    axes: Array
    length: float

    def at(self, fraction: Array) -> Array:
        """Points of the axis, (..., 3)."""
        return self.start + np.multiply.outer(fraction * self.length, self.axes[0])


def beam_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file as a straight beam.

    Raises
    ------
    InputError : the axes are degenerate, a section is unsound, or a marker lies
        outside.
    """
    geometry, settings, material = model.geometry, model.discretisation, model.material
    assert isinstance(geometry, BeamGeometry) and material is not None
    assert isinstance(settings, BeamDiscretisation)
    line = _line(geometry)
    ends = np.linspace(0, 1, settings.elements + 1)
    e, g = material.youngs_modulus, material.youngs_modulus
    g /= 2 * (1 + material.poissons_ratio)
    ndof = 6 * len(ends)
    stiffness = sp.lil_matrix((ndof, ndof))
    particles, points = _Particles(ndof), _MaterialPoints(ndof)
    for i in range(settings.elements):
        beam = _Element(geometry, line, ends[i], ends[i + 1], e, g, settings.theory)
        dofs = slice(6 * i, 6 * i + 12)
        turn = np.kron(np.eye(4), line.axes)
        stiffness[dofs, dofs] += turn.T @ beam.stiffness() @ turn
        points.add(beam, i)
        if settings.mass == "lumped":
            particles.lump(beam, i, material.density)
        else:
            particles.distribute(beam, i, material.density)
    for lump in geometry.masses:
        displacement, rotation = _rows(line, ends, lump.at, geometry, settings, e, g)
        tensor = np.diag(np.array(lump.inertia, float))
        where = line.at(np.array(lump.at))
        particles.add(where, lump.mass, tensor, displacement, rotation)
    markers = []
    for name, marker in placed(model.markers):
        with at_marker(name):
            at = _fraction(marker, line)
            displacement, rotation = _rows(line, ends, at, geometry, settings, e, g)
            markers.append(
                MarkerRows(
                    name=name,
                    node=marker.node,
                    position=line.at(np.array(at)),
                    displacement=_pruned(displacement),
                    rotation=_pruned(rotation),
                    tangent=line.axes[0],
                )
            )
    n = len(ends)
    return FiniteElementModel(
        positions=line.at(ends),
        scalar_mass=None,
        stiffness=sp.csr_matrix(stiffness),
        node_sets={"start": np.array([0]), "end": np.array([n - 1])},
        markers=tuple(markers),
        inertia_points=particles.points(),
        dof_table=np.arange(ndof).reshape(n, 6),
        beam_material=points.material(),
        outline=_outline(geometry, line, ends),
        geometry_mass=lambda: beam_mass(geometry, material.density),
    )


def _outline(geometry: BeamGeometry, line: Line, ends: Array) -> Outline:
    """Sections as rectangles; of general ones with the same area and moments."""
    halves = []
    for fraction in ends:
        section = section_at(geometry, fraction)
        moments = np.array([section.iz, section.iy])
        halves.append(np.sqrt(3 * moments / section.area))
    return Outline(line.axes[1:], np.array(halves))


def section_at(geometry: BeamGeometry, fraction: float) -> Section:
    """The cross-section at a fraction of the length.

    The torsion constant of a rectangle a x b, a >= b, is
    a b^3 (1/3 - 0.21 b/a (1 - (b/a)^4 / 12)) (Roark, table 10.1).

    Raises
    ------
    InputError : a height or width is not positive there, or no length of a section.
    """
    section = geometry.section
    if isinstance(section, GeneralSection):
        torsion = section.torsion or section.iy + section.iz
        return Section(
            section.area,
            section.iy,
            section.iz,
            torsion,
            section.shear_y,
            section.shear_z,
        )
    h, w = (_interpolated(section, name, fraction) for name in ("height", "width"))
    a, b = max(h, w), min(h, w)
    if not a < LARGEST:
        raise InputError(
            f"is {a:g} m at {fraction:.3g} of the length",
            place="geometry.section",
            expected=f"a section below {LARGEST:g} m",
        )
    torsion = a * b**3 * (1 / 3 - 0.21 * b / a * (1 - (b / a) ** 4 / 12))
    return Section(h * w, h * w**3 / 12, w * h**3 / 12, torsion, 5 / 6, 5 / 6)


def _interpolated(section: RectangularSection, name: str, fraction: float) -> float:
    values = getattr(section, name)
    if not isinstance(values, tuple):
        return float(values)
    x = np.linspace(0, 1, len(values))
    value = 0.0
    for i, v in enumerate(values):
        others = np.delete(x, i)
        value += v * float(np.prod((fraction - others) / (x[i] - others)))
    if value <= 0:
        raise InputError(
            f"becomes {value:.3g} at {fraction:.3g} of the length",
            place=f"geometry.section.{name}",
            expected="a polynomial that stays positive",
        )
    return value


def _line(geometry: BeamGeometry) -> Line:
    start, end = np.array(geometry.start), np.array(geometry.end)
    length = float(np.linalg.norm(end - start))
    if length == 0:
        raise InputError(
            "start and end are the same",
            place="geometry.end",
            expected="a beam with a length",
        )
    x = (end - start) / length
    y = np.array(geometry.y_axis) - x * (x @ geometry.y_axis)
    if np.linalg.norm(y) <= 1e-9 * np.linalg.norm(geometry.y_axis):
        raise InputError(
            "is parallel to the beam",
            place="geometry.y_axis",
            expected="a direction across the beam",
        )
    y /= np.linalg.norm(y)
    return Line(start, np.stack([x, y, np.cross(x, y)]), length)


class _Element:
    """One element in its own axes; the section is averaged for the shapes."""

    def __init__(
        self,
        geometry: BeamGeometry,
        line: Line,
        first: float,
        last: float,
        e: float,
        g: float,
        theory: str,
    ) -> None:
        self.geometry, self.line = geometry, line
        self.first, self.last = first, last
        self.length = (last - first) * line.length
        self.e, self.g = e, g
        middle = section_at(geometry, (first + last) / 2)
        shear = theory == "timoshenko"
        self.shear = shear
        scale = 12 * e / (g * middle.area * self.length**2)
        self.phi_y = scale * middle.iz / middle.shear_y if shear else 0.0
        self.phi_z = scale * middle.iy / middle.shear_z if shear else 0.0

    def gauss(self) -> tuple[Array, Array]:
        """Points in [0, 1] and weights [m]."""
        x, w = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
        return (x + 1) / 2, w * self.length / 2

    def section(self, s: float) -> Section:
        """At the fraction s of the element."""
        return section_at(self.geometry, self.first + s * (self.last - self.first))

    def shapes(self, s: float) -> tuple[Array, Array, Array]:
        """Displacement (3, 12), rotation (3, 12) and strains (6, 12).

        Strains: stretch, shears xy and xz, twist, curvatures about y and z.
        """
        u, r, b = np.zeros((3, 12)), np.zeros((3, 12)), np.zeros((6, 12))
        length = self.length
        u[0, [0, 6]] = r[0, [3, 9]] = [1 - s, s]
        b[0, [0, 6]] = b[3, [3, 9]] = [-1 / length, 1 / length]
        for axis, phi, sign in ((1, self.phi_y, 1.0), (2, self.phi_z, -1.0)):
            turn = 5 if axis == 1 else 4
            columns = [axis, turn, axis + 6, turn + 6]
            w, t, k, gamma = _bending(s, length, phi)
            flip = np.array([1, sign, 1, sign])
            u[axis, columns] = w * flip
            r[turn - 3, columns] = t * flip * sign
            b[turn, columns] = k * flip * sign
            b[axis, columns] = gamma * flip
        return u, r, b

    def shear_forces(self) -> Array:
        """(2, 12) along y and z: the change of the moments along the element."""
        (first, last), middle = (
            (self.shapes(s)[2] for s in (0.0, 1.0)),
            self.section(0.5),
        )
        change = (last[4:] - first[4:]) * self.e / self.length
        forces: Array = np.array([-middle.iz * change[1], middle.iy * change[0]])
        return forces

    def stiffness(self) -> Array:
        """(12, 12) in the axes of the element."""
        total = np.zeros((12, 12))
        for s, weight in zip(*self.gauss(), strict=True):
            _, _, b = self.shapes(s)
            p = self.section(s)
            e, g = self.e, self.g
            shear = [g * p.area * p.shear_y, g * p.area * p.shear_z]
            law = [e * p.area, *shear, g * p.torsion, e * p.iy, e * p.iz]
            total += weight * b.T @ (np.array(law)[:, None] * b)
        return total


def _bending(s: float, length: float, phi: float) -> tuple[Array, Array, Array, Array]:
    """Deflection, rotation, curvature and shear per (w1, t1, w2, t2)."""
    f = 1 / (1 + phi)
    w = f * np.array(
        [
            1 - 3 * s**2 + 2 * s**3 + phi * (1 - s),
            length * (s - 2 * s**2 + s**3 + phi * (s - s**2) / 2),
            3 * s**2 - 2 * s**3 + phi * s,
            length * (-(s**2) + s**3 - phi * (s - s**2) / 2),
        ]
    )
    t = f * np.array(
        [
            6 * (s**2 - s) / length,
            1 - 4 * s + 3 * s**2 + phi * (1 - s),
            6 * (s - s**2) / length,
            3 * s**2 - 2 * s + phi * s,
        ]
    )
    k = (
        f
        / length
        * np.array(
            [
                (12 * s - 6) / length,
                6 * s - 4 - phi,
                (6 - 12 * s) / length,
                6 * s - 2 + phi,
            ]
        )
    )
    gamma = -f * phi * np.array([1 / length, 0.5, -1 / length, 0.5])
    return w, t, k, gamma


class _Particles:
    """Collects the points that carry the mass."""

    def __init__(self, ndof: int) -> None:
        self._ndof = ndof
        self._where: list[Array] = []
        self._masses: list[float] = []
        self._inertias: list[Array] = []
        self._displacement: list[sp.csr_matrix] = []
        self._rotation: list[sp.csr_matrix] = []

    def add(
        self,
        where: Array,
        mass: float,
        inertia: Array,
        displacement: sp.csr_matrix,
        rotation: sp.csr_matrix,
    ) -> None:
        self._where.append(where)
        self._masses.append(mass)
        self._inertias.append(inertia)
        self._displacement.append(displacement)
        self._rotation.append(rotation)

    def distribute(self, beam: _Element, i: int, density: float) -> None:
        """Slices of the beam at its Gauss points."""
        for s, weight in zip(*beam.gauss(), strict=True):
            p = beam.section(s)
            u, r, _ = beam.shapes(s)
            where = beam.line.at(np.array(beam.first + s * (beam.last - beam.first)))
            tensor = density * weight * np.diag([p.iy + p.iz, p.iy, p.iz])
            self.add(
                where,
                density * p.area * weight,
                _turned(tensor, beam.line),
                _global(u, i, beam.line, self._ndof),
                _global(r, i, beam.line, self._ndof),
            )

    def lump(self, beam: _Element, i: int, density: float) -> None:
        """The two halves of an element, each a rigid piece that its node carries."""
        x, w = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
        for end in (0.0, 1.0):
            places = abs(end - (x + 1) / 4)
            sections = [beam.section(s) for s in places]
            weights = density * w * beam.length / 4
            masses = weights * [p.area for p in sections]
            mass = masses.sum()
            centre = masses @ places / mass
            spread = masses @ (places - centre) ** 2 * beam.length**2
            own = [[p.iy + p.iz, p.iy, p.iz] for p in sections]
            tensor = np.diag(weights @ np.array(own) + [0.0, spread, spread])
            u, r, _ = beam.shapes(end)
            arm = np.array([(centre - end) * beam.length, 0.0, 0.0])
            fraction = beam.first + centre * (beam.last - beam.first)
            self.add(
                beam.line.at(fraction),
                mass,
                _turned(tensor, beam.line),
                _global(u - skew(arm) @ r, i, beam.line, self._ndof),
                _global(r, i, beam.line, self._ndof),
            )

    def points(self) -> InertiaPoints:
        return InertiaPoints(
            positions=np.array(self._where),
            masses=np.array(self._masses),
            inertias=np.array(self._inertias),
            displacement=sp.vstack(self._displacement, format="csr"),
            rotation=sp.vstack(self._rotation, format="csr"),
        )


class _MaterialPoints:
    """Collects the points of `BeamMaterial`."""

    def __init__(self, ndof: int) -> None:
        self._ndof = ndof
        self._rows: list[list[sp.csr_matrix]] = [[], [], []]
        self._values: list[list[float]] = []

    def add(self, beam: _Element, i: int) -> None:
        """The Gauss points of element i."""
        shear_forces = beam.shear_forces()
        for s, weight in zip(*beam.gauss(), strict=True):
            _, turns, strains = beam.shapes(s)
            for kept, rows in zip(
                self._rows, (strains, turns, shear_forces), strict=True
            ):
                kept.append(_resolved(rows, i, beam.line, self._ndof))
            p = beam.section(s)
            stiffness = [beam.e * p.area, beam.g * p.torsion, beam.e * p.iy]
            ratios = [p.iy / p.area, p.iz / p.area]
            self._values.append([weight, *stiffness, beam.e * p.iz, *ratios])

    def material(self) -> BeamMaterial:
        strains, turns, forces = (sp.vstack(rows, format="csr") for rows in self._rows)
        values = np.array(self._values)
        return BeamMaterial(
            weights=values[:, 0],
            strains=strains,
            turns=turns,
            shear_forces=forces,
            stretching=values[:, 1],
            twisting=values[:, 2],
            bending=values[:, 3:5],
            gyration=values[:, 5:7],
        )


def _turned(tensor: Array, line: Line) -> Array:
    return line.axes.T @ tensor @ line.axes


def _global(rows: Array, i: int, line: Line, ndof: int) -> sp.csr_matrix:
    """(3, 12) in the axes of element i as (3, ndof) in those of the model."""
    return _resolved(line.axes.T @ rows, i, line, ndof)


def _resolved(rows: Array, i: int, line: Line, ndof: int) -> sp.csr_matrix:
    """(r, 12) for the degrees of freedom in the axes of element i as (r, ndof)."""
    values, count = rows @ np.kron(np.eye(4), line.axes), len(rows)
    columns = np.tile(np.arange(6 * i, 6 * i + 12), count)
    index = (np.repeat(np.arange(count), 12), columns)
    return sp.csr_matrix((values.ravel(), index), shape=(count, ndof))


def _rows(
    line: Line,
    ends: Array,
    at: float,
    geometry: BeamGeometry,
    settings: BeamDiscretisation,
    e: float,
    g: float,
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Displacement and rotation at a fraction of the length."""
    i = min(int(np.searchsorted(ends, at, side="right")) - 1, len(ends) - 2)
    beam = _Element(geometry, line, ends[i], ends[i + 1], e, g, settings.theory)
    s = float((at - ends[i]) / (ends[i + 1] - ends[i]))
    u, r, _ = beam.shapes(s)
    ndof = 6 * len(ends)
    return _global(u, i, line, ndof), _global(r, i, line, ndof)


def _pruned(rows: sp.csr_matrix) -> sp.csr_matrix:
    rows.data[np.abs(rows.data) < 1e-14] = 0
    rows.eliminate_zeros()
    return rows


def _fraction(marker: NodeMarker, line: Line) -> float:
    if marker.edge is not None:
        return 0.0 if marker.edge == "start" else 1.0
    if marker.parameters is not None:
        check_length(marker.parameters, 1, "parameters")
        return marker.parameters[0]
    if marker.position is None:
        raise InputError("is for meshes", place="mesh_node", expected="another place")
    check_length(marker.position, 3, "position")
    offset = line.axes @ (np.array(marker.position) - line.start) / line.length
    if np.abs(offset[1:]).max() > 1e-9 or not -1e-9 <= offset[0] <= 1 + 1e-9:
        raise InputError(
            "lies off the axis of the beam",
            place="position",
            expected="a point between start and end",
        )
    return float(np.clip(offset[0], 0, 1))
