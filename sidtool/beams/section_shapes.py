"""Properties of named cross-sections: circle, tube, box, I, T, C and L.

Area, centroid and second moments are those of the plates, with fillets. Sources:

- torsion constants: W. Young, R. Budynas, Roark's Formulas for Stress and Strain, 7th
  edition, table 10.1; a channel is two angles that share a web,
- shear of circle and tube: G. Cowper, "The shear coefficient in Timoshenko's beam
  theory", J. Appl. Mech. 33, 1966,
- shear and shear centre of walls: the energy of the shear flow on their middle lines,
  W. Pilkey, Analysis and Design of Elastic Beams, 2002, chapter 6. For Poisson's ratio
  zero it gives Cowper's coefficients of thin-walled sections.

Warping is free: bimoments of restrained warping are neglected.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from sidtool.formats.base.complex_step import (
    analytic_arctan2,
    analytic_norm,
    without_rounding,
)
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model.beams import (
    BoxSection,
    CircularSection,
    CSection,
    ISection,
    LSection,
    NamedSection,
    TSection,
    TubeSection,
)

_X, _W = np.polynomial.legendre.leggauss(4)
_POINTS, _WEIGHTS = (_X + 1) / 2, _W / 2
#: Area of a fillet, distance of its centroid from the corner along both walls, and
#: second moment about it, for unit radius.
_FILLET_AREA = 1 - math.pi / 4
_FILLET_ARM = (10 - 3 * math.pi) / (12 - 3 * math.pi)
_FILLET_MOMENT = 1 / 3 - math.pi / 16 - 1 / (9 * (4 - math.pi))
#: Product of inertia below this share of the moments is rounding.
_SYMMETRIC = 1e-12


@dataclass(frozen=True)
class NamedProperties:
    """A section in its principal axes.

    Attributes
    ----------
    area : [m^2]
    iy, iz : second moments about the principal axes [m^4]
    torsion : torsion constant [m^4]
    shear_y, shear_z : shear areas along the principal axes over the area
    shear_coupling : the same of the shear force along one by shear along the other
    centroid : (2,) y, z along the local axes: of an L from its corner, of a C from the
        middle of the back of its web, of a T from the end of its web, else zero [m]
    shear_centre : (2,) from the centroid along the principal axes [m]
    turn : angle from the local y axis to the first principal axis, towards z [rad]
    third_moments : integrals of yyy, yyz, yzz, zzz along the principal axes [m^5]
    """

    area: float
    iy: float
    iz: float
    torsion: float
    shear_y: float
    shear_z: float
    shear_coupling: float = 0.0
    centroid: tuple[float, float] = (0.0, 0.0)
    shear_centre: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0
    third_moments: tuple[float, float, float, float] = (0.0,) * 4


@dataclass(frozen=True)
class _Wall:
    """Middle line of a wall, from `start` to `end`; shear flows in from others."""

    start: tuple[float, float]
    end: tuple[float, float]
    thickness: float
    fed_by: tuple[int, ...] = ()

    @property
    def length(self) -> float:
        return analytic_norm(np.subtract(self.end, self.start))


@dataclass(frozen=True)
class _Shape:
    """Plates (y, z, height, width) about their middles, fillets (y, z of the corner,
    directions into the opening), walls in an order in which shear flows, torsion.
    """

    plates: tuple[tuple[float, float, float, float], ...]
    walls: tuple[_Wall, ...]
    torsion: float
    fillets: tuple[tuple[float, float, int, int], ...] = ()
    fillet: float = 0.0
    closed: bool = field(default=False)


@lru_cache(maxsize=256)
def named_properties(section: NamedSection, poissons_ratio: float) -> NamedProperties:
    """Return the properties of a section in its principal axes.

    Raises
    ------
    InputError : sizes contradict each other; the error names the key.
    """
    if isinstance(section, CircularSection | TubeSection):
        return _round_section(section, poissons_ratio)
    shape = _SHAPES[type(section)](section)
    area, centroid, tensor, third = _area_moments(shape)
    turn = _principal_turn(tensor)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    tensor = axes @ tensor @ axes.T
    third = np.einsum("abc,ia,jb,kc->ijk", third, axes, axes, axes)
    third = without_rounding(third, _SYMMETRIC * area.real**2.5)
    compliance, centre, middle = _shear_flow(shape)
    offset = axes @ (centre + middle - centroid)
    if shape.closed:
        offset = np.zeros(2)
    shear = np.linalg.inv(axes @ compliance @ axes.T)
    coupling = (shear[0, 1] + shear[1, 0]) / 2
    coupling = without_rounding(coupling, _SYMMETRIC * np.trace(shear).real)
    offset = without_rounding(offset, _SYMMETRIC * np.sqrt(area.real))
    return NamedProperties(
        area=area,
        iy=tensor[1, 1].item(),
        iz=tensor[0, 0].item(),
        torsion=shape.torsion,
        shear_y=shear[0, 0].item(),
        shear_z=shear[1, 1].item(),
        shear_coupling=coupling.item(),
        centroid=tuple(centroid.tolist()),
        shear_centre=tuple(offset.tolist()),
        turn=turn,
        third_moments=tuple(third[(0, 0, 0, 1), (0, 0, 1, 1), (0, 1, 1, 1)].tolist()),
    )


def shape_of_section(section: NamedSection) -> _Shape:
    """Return the plates and walls of a section of walls."""
    return _SHAPES[type(section)](section)


def _round_section(
    section: CircularSection | TubeSection, nu: float
) -> NamedProperties:
    outer = section.diameter / 2
    inner = 0.0
    if isinstance(section, TubeSection):
        _check("thickness", section.thickness, outer, "the radius")
        inner = outer - section.thickness
    area = math.pi * (outer**2 - inner**2)
    moment = math.pi / 4 * (outer**4 - inner**4)
    m2 = (inner / outer) ** 2
    shear = 6 * (1 + nu) * (1 + m2) ** 2
    shear /= (7 + 6 * nu) * (1 + m2) ** 2 + (20 + 12 * nu) * m2
    return NamedProperties(area, moment, moment, 2 * moment, shear, shear)


def _area_moments(shape: _Shape) -> tuple[float, Array, Array, Array]:
    """Return area, centroid (2,), and tensors (2, 2) and (2, 2, 2) of the second and
    third moments about it; of fillets without the third ones about their own centroid.
    """
    parts = [
        (h * w, np.array([y, z]), np.diag([h**2, w**2]) * h * w / 12)
        for y, z, h, w in shape.plates
    ]
    r = shape.fillet
    for y, z, up, right in shape.fillets if r else ():
        centre = np.array([y + up * _FILLET_ARM * r, z + right * _FILLET_ARM * r])
        own = _FILLET_MOMENT * r**4 * np.eye(2)
        parts.append((_FILLET_AREA * r**2, centre, own))
    area = sum(part[0] for part in parts)
    centroid = sum((a * c for a, c, _ in parts), np.zeros(2)) / area
    tensor, third = np.zeros((2, 2)), np.zeros((2, 2, 2))
    for a, centre, own in parts:
        arm = centre - centroid
        moved = own + a * np.outer(arm, arm)
        tensor = tensor + moved
        mixed = np.multiply.outer(own, arm)
        third = third + np.multiply.outer(moved, arm)
        third = third + np.moveaxis(mixed, 2, 0) + np.moveaxis(mixed, 2, 1)
    return area, centroid, tensor, third


def _principal_turn(tensor: Array) -> Any:
    """Return the least angle from y towards z that makes the product zero."""
    product, difference = tensor[0, 1], tensor[0, 0] - tensor[1, 1]
    if abs(product.real) <= _SYMMETRIC * np.trace(tensor).real:
        return 0.0
    turn = analytic_arctan2(2 * product, difference) / 2
    if turn.real > math.pi / 4 + 1e-9:
        turn -= math.pi / 2
    elif turn.real < -math.pi / 4 - 1e-9:
        turn += math.pi / 2
    return turn.item()


def _shear_flow(shape: _Shape) -> tuple[Array, Array, Array]:
    """Return compliance (2, 2) in shear over 1 / (G A), the shear centre (2,) from the
    centroid of the middle lines, and that centroid (2,).

    A force along axis i causes stresses that change along the beam by g = c_i . (y, z)
    and the shear flow dq/ds = -g t. The flow that enters a wall is what leaves the
    walls that feed it.
    """
    starts = np.array([wall.start for wall in shape.walls])
    ends = np.array([wall.end for wall in shape.walls])
    t = np.array([wall.thickness for wall in shape.walls])
    lengths = np.array([wall.length for wall in shape.walls])
    areas = t * lengths
    middle = areas @ (starts + ends) / (2 * areas.sum())
    a, d = starts - middle, ends - starts
    points = a[:, None] + _POINTS[:, None] * d[:, None]
    weights = areas[:, None] * _WEIGHTS
    tensor = np.einsum("wp,wpi,wpj->ij", weights, points, points)
    gradient = np.linalg.inv(tensor)
    # flow at the Gauss points and at the ends of walls, by axis of the force
    g, slope = a @ gradient, d @ gradient
    flow = np.zeros((len(t), len(_POINTS), 2), tensor.dtype)
    leaving = np.zeros((len(t), 2), tensor.dtype)
    for k, wall in enumerate(shape.walls):
        entering = sum((leaving[j] for j in wall.fed_by), np.zeros(2))
        x = _POINTS[:, None]
        flow[k] = entering - areas[k] * (g[k] * x + slope[k] * x**2 / 2)
        leaving[k] = entering - areas[k] * (g[k] + slope[k] / 2)
    per_length = lengths[:, None] * _WEIGHTS
    if shape.closed:  # no twist: the mean of q / t around the cell is zero
        mean = np.einsum("wp,wpi->i", per_length / t[:, None], flow)
        flow -= mean / (lengths / t).sum()
    energy = np.einsum("wp,wpi,wpj->ij", per_length / t[:, None], flow, flow)
    arm = (a[:, 0] * d[:, 1] - a[:, 1] * d[:, 0]) / lengths
    torque = np.einsum("w,wp,wpi->i", arm, per_length, flow)
    return areas.sum() * energy, np.array([torque[1], -torque[0]]), middle


def _box(section: BoxSection) -> _Shape:
    h, w, t = section.height, section.width, section.thickness
    _check("thickness", t, _smaller(h, w) / 2, "half the smaller side")
    y, z = (h - t) / 2, (w - t) / 2
    corners = ((-y, -z), (-y, z), (y, z), (y, -z))
    walls = tuple(
        _Wall(corners[k], corners[(k + 1) % 4], t, (k - 1,) if k else ())
        for k in range(4)
    )
    torsion = 2 * t**2 * (w - t) ** 2 * (h - t) ** 2 / ((w + h) * t - 2 * t**2)
    plates = (
        (y, 0.0, t, w),
        (-y, 0.0, t, w),
        (0.0, z, h - 2 * t, t),
        (0.0, -z, h - 2 * t, t),
    )
    return _Shape(plates, walls, torsion, closed=True)


def _i_section(section: ISection) -> _Shape:
    h, b, tw, tf, r = _profile_sizes(section)
    y, z, inside, side = (h - tf) / 2, b / 2, h / 2 - tf, tw / 2
    walls = (
        _Wall((y, -z), (y, 0.0), tf),
        _Wall((y, z), (y, 0.0), tf),
        _Wall((y, 0.0), (-y, 0.0), tw, (0, 1)),
        _Wall((-y, -z), (-y, 0.0), tf),
        _Wall((-y, z), (-y, 0.0), tf),
    )
    fillets = tuple(
        (-up * inside, right * side, up, right) for up in (1, -1) for right in (1, -1)
    )
    plates = ((y, 0.0, tf, b), (-y, 0.0, tf, b), (0.0, 0.0, h - 2 * tf, tw))
    torsion = 2 * _plate(b, tf) + (h - 2 * tf) * tw**3 / 3 + 2 * _tee(tf, tw, r)
    return _Shape(plates, walls, torsion, fillets, r)


def _t_section(section: TSection) -> _Shape:
    h, b, tw, tf, r = _profile_sizes(section, flanges=1)
    y, z, inside, side = h - tf / 2, b / 2, h - tf, tw / 2
    walls = (
        _Wall((y, -z), (y, 0.0), tf),
        _Wall((y, z), (y, 0.0), tf),
        _Wall((0.0, 0.0), (y, 0.0), tw),
    )
    fillets = ((inside, side, -1, 1), (inside, -side, -1, -1))
    plates = ((y, 0.0, tf, b), ((h - tf) / 2, 0.0, h - tf, tw))
    torsion = _plate(b, tf) + _outstanding(h - tf, tw) + _tee(tf, tw, r)
    return _Shape(plates, walls, torsion, fillets, r)


def _c_section(section: CSection) -> _Shape:
    h, b, tw, tf, r = _profile_sizes(section)
    y, z, inside = (h - tf) / 2, tw / 2, h / 2 - tf
    walls = (
        _Wall((y, b), (y, z), tf),
        _Wall((y, z), (-y, z), tw, (0,)),
        _Wall((-y, b), (-y, z), tf),
    )
    fillets = ((inside, tw, -1, 1), (-inside, tw, 1, 1))
    plates = ((y, b / 2, tf, b), (-y, b / 2, tf, b), (0.0, z, h - 2 * tf, tw))
    torsion = 2 * _plate(b, tf) + (h - 2 * tf) * tw**3 / 3 + 2 * _corner(tf, tw, r)
    return _Shape(plates, walls, torsion, fillets, r)


def _l_section(section: LSection) -> _Shape:
    h, b, t, r = section.height, section.width, section.thickness, section.fillet
    _check("thickness", t, _smaller(h, b), "the smaller leg")
    _check("fillet", r, _smaller(h, b) - t, "the shorter leg inside")
    walls = (
        _Wall((h, t / 2), (t / 2, t / 2), t),
        _Wall((t / 2, b), (t / 2, t / 2), t),
    )
    plates = ((h / 2, t / 2, h, t), (t / 2, (b + t) / 2, t, b - t))
    longer, shorter = _larger(h, b), _smaller(h, b)
    torsion = _plate(longer, t) + _outstanding(shorter - t, t) + _corner(t, t, r)
    return _Shape(plates, walls, torsion, ((t, t, 1, 1),), r)


_SHAPES: dict[type, Callable[[Any], _Shape]] = {
    BoxSection: _box,
    ISection: _i_section,
    TSection: _t_section,
    CSection: _c_section,
    LSection: _l_section,
}


def _plate(length: float, thickness: float) -> float:
    """Torsion constant of a plate with two free ends."""
    a, b = _larger(length, thickness), _smaller(length, thickness)
    return a * b**3 * (1 / 3 - 0.21 * b / a * (1 - (b / a) ** 4 / 12))


def _outstanding(length: float, thickness: float) -> float:
    """Torsion constant of a plate that continues at one end."""
    ratio = thickness / length
    share = 1 / 3 - 0.105 * ratio * (1 - ratio**4 / 192)
    return length * thickness**3 * share


def _tee(flange: float, web: float, fillet: float) -> float:
    """Torsion constant of the junction of a web at the middle of a flange."""
    alpha = (
        _smaller(flange, web) / _larger(flange, web) * (0.15 + 0.1 * fillet / flange)
    )
    circle = ((flange + fillet) ** 2 + fillet * web + web**2 / 4) / (
        2 * fillet + flange
    )
    return alpha * circle**4


def _corner(flange: float, web: float, fillet: float) -> float:
    """Torsion constant of the junction of two walls at their ends."""
    b, d = _larger(flange, web), _smaller(flange, web)
    alpha = d / b * (0.07 + 0.076 * fillet / b)
    root = np.sqrt(2 * (2 * fillet + b) * (2 * fillet + d))
    return alpha * (2 * (d + b + 3 * fillet - root)) ** 4


def _profile_sizes(
    section: ISection | TSection | CSection, flanges: int = 2
) -> tuple[float, float, float, float, float]:
    """Return height, width, web, flange and fillet after a check."""
    h, b = section.height, section.width
    _check("web", section.web, b, "the width")
    _check("flange", section.flange, h / flanges, "its share of the height")
    inside = (h - flanges * section.flange) / flanges
    arm = b - section.web if isinstance(section, CSection) else (b - section.web) / 2
    _check("fillet", section.fillet, _smaller(inside, arm), "the space inside")
    return h, b, section.web, section.flange, section.fillet


def _smaller(a: Any, b: Any) -> Any:
    return a if a.real <= b.real else b


def _larger(a: Any, b: Any) -> Any:
    return b if a.real <= b.real else a


def _check(key: str, value: float, limit: float, what: str) -> None:
    value, limit = value.real, limit.real
    if not value < limit:
        raise InputError(
            f"is {value:g} m",
            place=f"geometry.section.{key}",
            expected=f"less than {what}, {limit:g} m",
        )
