"""Warnings about implausible numbers, which mostly come from wrong units."""

import numpy as np

from .base.errors import InputError
from .base.sid import SID, Taylor
from .diagnostics import Diagnostic, diagnose
from .geometric_stiffening import elastic_basis
from .sid_mass import body_size

#: From soft rubber to diamond [Pa], from foam to osmium [kg/m3].
_STIFFNESS, _DENSITY = (1e6, 1.3e12), (10.0, 2.3e4)
#: What solids mostly have, by which a slip is recognised.
_USUAL_STIFFNESS, _USUAL_DENSITY = (1e9, 1.3e12), (500.0, 2.3e4)
_STIFFNESS_UNITS = {"GPa": 1e9, "MPa": 1e6, "kPa": 1e3}
_DENSITY_UNITS = {"g/cm3": 1e3, "kg/mm3": 1e9, "t/mm3": 1e12}
#: Faster than sound in any solid [m/s]; longer than most flexible bodies [m].
_MAX_WAVE_SPEED, _MAX_LENGTH = 2e4, 150.0
#: Weight on earth [m/s2], and the sag under it, in sizes of the body, that soft bodies
#: without gravity may have.
_EARTH_GRAVITY, _MAX_SAG = 9.81, 30.0
#: Mass per cubed size [kg/m3], from gas between galaxies to more than a neutron star,
#: and first frequency times size [m/s]: other bodies are numbers without meaning.
_DENSITIES, _WAVE_SPEEDS = (1e-27, 1e20), (1e-12, 1e12)
#: Negative damping that is none, relative to the largest.
_ROUNDING = 1e-9


def material_warnings(youngs_modulus: float, density: float) -> list[Diagnostic]:
    """Return warnings on implausible properties of a material in SI units (N101)."""
    return [
        diagnose(
            "N101",
            quantity=quantity,
            value=value,
            unit=unit,
            least=limits[0],
            most=limits[1],
            hint=_unit_hint(value, units, usual, unit),
        )
        for quantity, value, unit, limits, units, usual in (
            (
                "Young's modulus",
                youngs_modulus,
                "Pa",
                _STIFFNESS,
                _STIFFNESS_UNITS,
                _USUAL_STIFFNESS,
            ),
            ("density", density, "kg/m3", _DENSITY, _DENSITY_UNITS, _USUAL_DENSITY),
        )
        if not limits[0] <= value <= limits[1]
    ]


def _is_finite(block: Taylor) -> bool:
    return all(np.isfinite(x).all() for x in (block.m0, block.m1) if x is not None)


def check_body(sid: SID) -> None:
    """Refuse a body whose mass, inertia or first frequency no body can have.

    Raises
    ------
    InputError : mass or inertia are not finite and above zero, a block is not finite,
        the mean density is not that of matter, or waves are slower or faster than any.
    """
    moments = sid.J.m0[:3, 0]
    numbers = np.array([sid.mass, *moments])
    expected = "lengths, sections, densities and moduli in consistent units"
    if not (np.isfinite(numbers).all() and sid.mass > 0.0 and moments.max() > 0.0):
        listed = ", ".join(f"{moment:.3g}" for moment in moments)
        raise InputError(
            f"the body has a mass of {sid.mass:.3g} kg and moments of inertia of "
            f"{listed} kg m2",
            expected=f"numbers above zero: {expected}",
        )
    bad = [name for name, block in sid.blocks.items() if not _is_finite(block)]
    if bad:
        raise InputError(
            f"the blocks {', '.join(bad)} hold values that are no numbers",
            expected=expected,
        )
    size = body_size(sid)
    if not _DENSITIES[0] < sid.mass / size**3 < _DENSITIES[1]:
        raise InputError(
            f"the body has a mass of {sid.mass:.3g} kg and a size of {size:.3g} m",
            expected=expected,
        )
    hertz = first_frequency(sid)
    if hertz > 0.0 and not _WAVE_SPEEDS[0] < hertz * size < _WAVE_SPEEDS[1]:
        raise InputError(
            f"the body has a first frequency of {hertz:.3g} Hz and a size of "
            f"{size:.3g} m",
            expected=expected,
        )


def body_warnings(sid: SID, gravity: float | None = None) -> list[Diagnostic]:
    """Return warnings on implausible properties of a body in SI units.

    Parameters
    ----------
    gravity : of its scene [m/s2]; without it that of the earth, in which soft bodies
        need not have their shape
    """
    size = body_size(sid)
    if not size > 0.0:
        return []
    found = []
    if size > _MAX_LENGTH:
        found.append(diagnose("N103", reason=f"size of {size:.3g} m"))
    # Smallest eigenvalue of De over the largest absolute one; 0 without damping.
    values = np.linalg.eigvalsh((sid.De.m0 + sid.De.m0.T) / 2)
    largest = np.abs(values).max(initial=0.0)
    damping = float(values[0] / largest) if largest > 0.0 else 0.0
    if damping < -_ROUNDING:
        found.append(diagnose("N104", share=damping))
    omega, ratio = _first_mode(sid)
    if not omega > 0.0:
        return found
    hertz = omega / (2.0 * np.pi)
    if hertz * size > _MAX_WAVE_SPEED:
        found.append(
            diagnose(
                "N103",
                reason=f"first frequency of {hertz:.3g} Hz and size of {size:.3g} m: "
                "faster than sound",
            )
        )
    sag = (gravity or _EARTH_GRAVITY) / omega**2
    if sag > (1.0 if gravity else _MAX_SAG) * size:
        load = "gravity" if gravity else "9.81 m/s2"
        found.append(
            diagnose(
                "N103",
                reason=f"sags by {sag:.2g} m ({sag / size:.2g} sizes) under {load}",
            )
        )
    if ratio > 1.0:
        found.append(diagnose("N107", frequency=hertz, ratio=ratio))
    return found


def first_frequency(sid: SID) -> float:
    """Return the frequency of the lowest deforming mode of (Ke, Me) [Hz]; 0 without
    one.
    """
    return _first_mode(sid)[0] / (2.0 * float(np.pi))


def _unit_hint(
    value: float, units: dict[str, float], usual: tuple[float, float], si: str
) -> str:
    """ "; in GPa it would be 2.1e+11 Pa"; empty if no unit fits."""
    for unit, factor in units.items():
        if usual[0] <= value * factor <= usual[1]:
            return f"; in {unit} it would be {value * factor:.3g} {si}"
    return ""


def _first_mode(sid: SID) -> tuple[float, float]:
    """Lowest angular frequency [rad/s] and its damping ratio; zeros without one."""
    basis = elastic_basis(sid) if sid.nq else np.zeros((0, 0))
    if basis.size == 0:
        return 0.0, 0.0
    mass = basis.T @ sid.Me.m0 @ basis
    values, vectors = np.linalg.eigh((mass + mass.T) / 2)
    if not values[-1] > 0.0:
        return 0.0, 0.0
    shape = basis @ vectors[:, -1]
    omega = 1.0 / float(np.sqrt(values[-1]))
    return omega, 0.5 * omega * float(shape @ sid.De.m0 @ shape)
