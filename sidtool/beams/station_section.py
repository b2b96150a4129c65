"""Cross-sections of beams from tables of stations, linear between them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from sidtool.formats.base.complex_step import number_type, numbers
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model.beams import BeamGeometry
from sidtool.formats.model.stations import COLUMNS, MATRIX_ORDERS, StationTable
from sidtool.formats.sid_mass import skew

from .cross_section import Profile, linear_profile

#: A table that ends this near to the length of the axis, relative to it, ends there.
_SAME_LENGTH = 1e-6
#: Entries of matrices below this share of the largest ones are rounding.
_ROUNDING = 1e-8


@dataclass(frozen=True, eq=False)
class StationSection:
    """Stiffness and inertia of a cross-section about the axis of the beam.

    Attributes
    ----------
    sheared, unsheared : (6, 6) strains of N, Vy, Vz, T, My, Mz, with and without shear
    mass : per length [kg/m]
    centre : (3,) of mass in the axes of the section [m]
    tensor : (3, 3) mass moments of inertia per length about the centre [kg m]
    stress_moments : (3, 3) as of `BeamMaterial`, with moments about the axis
    offset : (2,) y, z of the centre of tension [m]
    """

    sheared: Array | None
    unsheared: Array
    mass: float
    centre: Array
    tensor: Array
    stress_moments: Array
    offset: Array

    @property
    def halves(self) -> Array:
        """(2,) half the sides, along y and z, of the rectangle with EI / EA of the
        section about its centre of tension [m].
        """
        return np.asarray(np.sqrt(3 * (self.stress_moments[0, ::2] + self.offset**2)))

    def inertia(self, density: float, curvatures: Array) -> tuple[float, Array, Array]:
        """Mass per length, centre and tensor; the table holds the density."""
        return self.mass, self.centre, self.tensor

    def compliance(self, e: float, g: float, curvatures: Array, shear: bool) -> Array:
        """(6, 6) strains of resultants about the axis of the beam.

        Raises
        ------
        InputError : shear is requested, and the table has no shear stiffness.
        """
        if not shear:
            return self.unsheared
        if self.sheared is None:
            raise InputError(
                "has no GA_y and GA_z, which the Timoshenko theory needs",
                place="geometry.sections",
                expected='these columns, or discretisation.theory = "euler_bernoulli"',
            )
        return self.sheared


@dataclass(frozen=True, eq=False)
class StationSections:
    """Sections of a beam by stations.

    Attributes
    ----------
    at : section at a fraction of the length
    mass : mass per length over the fraction [kg/m]
    twist : of the section axes over the fraction [rad]
    """

    at: Callable[[float], StationSection]
    mass: Profile
    twist: Profile


def station_sections(geometry: BeamGeometry, length: float) -> StationSections:
    """Return the sections of a beam whose geometry has `sections`.

    Parameters
    ----------
    length : of the axis [m]

    Raises
    ------
    InputError : the table is not sound, or does not fit the length of the axis.
    """
    table = geometry.station_table()
    fractions = _fractions(table, length)
    angle = geometry.twist
    assert not isinstance(angle, tuple)
    values = numbers(table.twist) if table.twist else np.zeros(len(fractions))
    _check_twist(fractions, values)
    twist = linear_profile(fractions, values + angle)
    if table.stiffness:
        return _by_matrices(table, fractions, twist)
    return _by_columns(table, fractions, twist)


def mass_moments(sections: StationSections, length: float) -> tuple[float, ...]:
    """Return mass, first and second moment about the start along the axis.

    Parameters
    ----------
    length : of the axis [m]
    """
    along = linear_profile(np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    weighted, moments = sections.mass, []
    for power in range(1, 4):
        moments.append(length**power * weighted.integral())
        weighted = weighted * along
    return tuple(moments)


def _fractions(table: StationTable, length: float) -> Array:
    given = table.position if table.fraction is None else table.fraction
    assert given is not None
    if np.iscomplexobj(numbers(given)):
        raise InputError(
            "has no derivative",
            place="geometry.sections",
            expected="variables other than the positions of stations",
        )
    if table.fraction is not None:
        return np.array(given)
    last, length = given[-1], length.real
    if abs(last - length) > _SAME_LENGTH * length:
        raise InputError(
            f"ends at {last:.6g} m, but the axis of the beam is {length:.6g} m long",
            place="geometry.sections",
            expected="positions from 0 to the length of the axis",
        )
    return np.array(given) / last


def _check_twist(fractions: Array, twist: Array) -> None:
    jumps = (np.diff(fractions) == 0) & (np.diff(twist.real) != 0)
    if jumps.any():
        raise InputError(
            f"jumps at {fractions[:-1][jumps][0]:.3g} of the length",
            place="geometry.sections.twist",
            expected="one twist at every position",
        )


def _between_stations(fractions: Array, values: Array) -> Callable[[float], Array]:
    """Linear interpolation of values (stations, ...) over the fraction of the length.

    At a step the values behind it hold.
    """

    def at(fraction: float) -> Array:
        k = int(np.searchsorted(fractions, fraction.real, side="right"))
        k = min(k, len(fractions) - 1)
        while fractions[k - 1] == fractions[k]:  # a step at the end of the beam
            k -= 1
        share = (fraction - fractions[k - 1]) / (fractions[k] - fractions[k - 1])
        return np.asarray((1 - share) * values[k - 1] + share * values[k])

    return at


def _by_columns(
    table: StationTable, fractions: Array, twist: Profile
) -> StationSections:
    """Sections whose columns are linear between stations."""
    names = [name for name in COLUMNS if name not in ("position", "twist")]
    names = [name for name in names if getattr(table, name)]
    columns = numbers([getattr(table, name) for name in names]).T
    row = _between_stations(fractions, columns)

    def at(fraction: float) -> StationSection:
        values = row(fraction).tolist()
        return _section_of_columns(dict(zip(names, values, strict=True)))

    mass = linear_profile(fractions, numbers(table.mass_per_length))
    return StationSections(cache(at), mass, twist)


def _section_of_columns(value: dict[str, Any]) -> StationSection:
    """Stiffness about the centres of tension and shear, mass about its centre.

    With forces through the axis, the moments about the centre of tension (y, z) are
    My - z N and Mz + y N, and the moment about the shear centre is T + z Vy - y Vz.
    """
    y, z = value.get("tension_y", 0.0), value.get("tension_z", 0.0)
    dtype = number_type(*value.values())
    moved = np.eye(6, dtype=dtype)
    moved[4, 0], moved[5, 0] = -z, y
    shear_y, shear_z = value.get("shear_y", 0.0), value.get("shear_z", 0.0)
    moved[3, 1:3] = shear_z, -shear_y
    ea, ei_y, ei_z = value["EA"], value["EI_y"], value["EI_z"]
    diagonal = numbers([1 / ea, 0.0, 0.0, 1 / value["GJ"], 1 / ei_y, 1 / ei_z])
    unsheared = moved.T @ np.diag(diagonal) @ moved
    sheared = None
    if "GA_y" in value:
        diagonal = diagonal.astype(dtype)
        diagonal[1:3] = 1 / value["GA_y"], 1 / value["GA_z"]
        sheared = moved.T @ np.diag(diagonal) @ moved
    mass = value["mass_per_length"]
    about_y = value.get("inertia_y", mass * ei_y / ea)
    about_z = value.get("inertia_z", mass * ei_z / ea)
    tensor = np.diag(np.array([about_y + about_z, about_y, about_z], dtype))
    tensor[1, 2] = tensor[2, 1] = -value.get("inertia_yz", 0.0)
    centre = np.array([0.0, value.get("mass_y", 0.0), value.get("mass_z", 0.0)])
    moments = _stress_moments(y, z, ei_y / ea, ei_z / ea)
    offset = np.array([y, z])
    return StationSection(sheared, unsheared, mass, centre, tensor, moments, offset)


def _stress_moments(y: Any, z: Any, own_y: Any, own_z: Any) -> Array:
    """Return `stress_moments` for a centre of tension (y, z).

    The stress of N, My and Mz about the axis is that of N, My - z N and Mz + y N about
    the centre, where the section counts as doubly symmetric.

    Parameters
    ----------
    own_y, own_z : EI_y / EA and EI_z / EA about the centre of tension
    """
    none = 0 * y
    of_force = [own_z - y**2, -y * z, own_y - z**2]
    return np.array([of_force, [none, y, 2 * z], [-2 * y, -z, none]])


def _by_matrices(
    table: StationTable, fractions: Array, twist: Profile
) -> StationSections:
    """Sections whose matrices are linear between stations."""
    rows = np.array(MATRIX_ORDERS[table.order])
    stiffness, mass = (
        numbers(getattr(table, name))[:, rows][:, :, rows]
        for name in ("stiffness", "mass")
    )
    for name, matrices in (("stiffness", stiffness), ("mass", mass)):
        _check_matrices(name, matrices.real)
    for matrix in mass.real:
        _check_rigid(matrix)
    pair = _between_stations(fractions, np.stack([stiffness, mass], axis=1))

    def at(fraction: float) -> StationSection:
        return _section_of_matrices(*pair(fraction))

    return StationSections(cache(at), linear_profile(fractions, mass[:, 0, 0]), twist)


def _check_matrices(name: str, matrices: Array) -> None:
    """Refuse matrices that are not symmetric and positive."""
    for k, matrix in enumerate(matrices):
        place = f"geometry.sections.{name}[{k}]"
        diagonal = np.diag(matrix)
        positive = diagonal > 0 if name == "stiffness" else diagonal >= 0
        scale = np.sqrt(np.maximum(diagonal, 1e-300))
        scaled = matrix / np.outer(scale, scale)
        if (
            not positive.all()
            or np.linalg.eigvalsh(scaled + scaled.T).min() < -_ROUNDING
        ):
            raise InputError(
                "is not positive definite",
                place=place,
                expected="a matrix in the order of geometry.sections.order",
            )
        if np.abs(scaled - scaled.T).max() > _ROUNDING:
            raise InputError(
                "is not symmetric", place=place, expected="a symmetric one"
            )


def _check_rigid(matrix: Array) -> None:
    """Refuse a mass matrix that no rigid slice has."""
    mass, arm, tensor = _rigid_slice(matrix)
    built = np.zeros((6, 6))
    built[:3, :3] = mass * np.eye(3)
    built[3:, :3] = mass * skew(arm)
    built[:3, 3:] = built[3:, :3].T
    built[3:, 3:] = tensor - mass * skew(arm) @ skew(arm)
    scale = np.sqrt(np.maximum(np.diag(built), 1e-300))
    if np.abs((built - matrix) / np.outer(scale, scale)).max() > 1e-4:
        raise InputError(
            "is not the mass matrix of a thin slice",
            place="geometry.sections.mass",
            expected="m on the first diagonal, m y and m z beside it, and moments of "
            "inertia",
        )


def _rigid_slice(matrix: Array) -> tuple[float, Array, Array]:
    """Mass, centre (3,) and tensor (3, 3) about it of a slice by its mass matrix."""
    mass = matrix[0, 0].item()
    arm = np.array([0.0, -matrix[0, 5], matrix[0, 4]]) / mass
    return mass, arm, matrix[3:, 3:] + mass * skew(arm) @ skew(arm)


def _section_of_matrices(stiffness: Array, matrix: Array) -> StationSection:
    """Section without shear strains: those of the shear centre vanish."""
    sheared: Array = np.asarray(np.linalg.inv(stiffness))
    moved = np.eye(6, dtype=sheared.dtype)
    moved[3, 1:3] = sheared[3, 1:3] / sheared[3, 3]
    back = np.linalg.inv(moved)
    unsheared = back.T @ sheared @ back
    unsheared[1:3] = 0.0
    unsheared[:, 1:3] = 0.0
    unsheared = moved.T @ unsheared @ moved
    mass, arm, tensor = _rigid_slice(matrix)
    axial = stiffness[0, 0]
    z, y = (stiffness[0, 4] / axial).item(), (-stiffness[0, 5] / axial).item()
    own_y = (stiffness[4, 4] / axial).item() - z**2
    own_z = (stiffness[5, 5] / axial).item() - y**2
    moments, offset = _stress_moments(y, z, own_y, own_z), np.array([y, z])
    return StationSection(sheared, unsheared, mass, arm, tensor, moments, offset)
