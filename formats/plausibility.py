"""Warnings about implausible numbers, which mostly come from wrong units."""

from __future__ import annotations

import numpy as np

from .base.sid import SID
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
#: Negative damping that is none, relative to the largest.
_ROUNDING = 1e-9


def material_warnings(youngs_modulus: float, density: float) -> list[str]:
    """Return warnings on implausible properties of a material in SI units."""
    texts = []
    if not _STIFFNESS[0] <= youngs_modulus <= _STIFFNESS[1]:
        other = _unit_hint(youngs_modulus, _STIFFNESS_UNITS, _USUAL_STIFFNESS, "Pa")
        texts.append(
            f"Young's modulus is {youngs_modulus:g} Pa; rubber has 1e6, steel 2.1e11, "
            f"diamond 1.2e12{other}"
        )
    if not _DENSITY[0] <= density <= _DENSITY[1]:
        other = _unit_hint(density, _DENSITY_UNITS, _USUAL_DENSITY, "kg/m3")
        texts.append(
            f"the density is {density:g} kg/m3; foam has 30, water 1000, steel 7850"
            f"{other}"
        )
    return texts


def body_warnings(sid: SID, gravity: float | None = None) -> list[str]:
    """Return warnings on implausible properties of a body in SI units.

    Parameters
    ----------
    gravity : of its scene [m/s2]; without it that of the earth, in which soft bodies
        need not have their shape
    """
    size = body_size(sid)
    if not size > 0.0:
        return []
    texts = []
    if size > _MAX_LENGTH:
        texts.append(f"the body is {size:.3g} m long: are its lengths in mm?")
    if _adds_energy(sid):
        texts.append(
            "its damping De is negative for some motions and feeds what it should "
            "damp: is its sign meant?"
        )
    omega, ratio = _first_mode(sid)
    if not omega > 0.0:
        return texts
    hertz = omega / (2.0 * np.pi)
    if hertz * size > _MAX_WAVE_SPEED:
        texts.append(
            f"the first frequency of {hertz:.3g} Hz in a body of {size:.3g} m is "
            "faster than sound in any solid: are mass or stiffness in other units?"
        )
    sag = (gravity or _EARTH_GRAVITY) / omega**2
    if sag > (1.0 if gravity else _MAX_SAG) * size:
        texts.append(
            f"with a first frequency of {hertz:.3g} Hz the body sags by about "
            f"{sag:.2g} m under {'gravity' if gravity else 'its weight'}, "
            f"{sag / size:.2g} times its size: are lengths, mass or stiffness in other "
            "units?"
        )
    if ratio > 1.0:
        texts.append(
            f"its first mode ({hertz:.3g} Hz) has {ratio:.2g} times the critical "
            "damping and creeps instead of vibrating: 2 % of it are a ratio of 0.02"
        )
    return texts


def _adds_energy(sid: SID) -> bool:
    values = np.linalg.eigvalsh((sid.De.m0 + sid.De.m0.T) / 2)
    return bool(values.size and values[0] < -_ROUNDING * np.abs(values).max())


def first_frequency(sid: SID) -> float:
    """Return the frequency of the lowest deforming mode of (Ke, Me) [Hz]; 0 without
    one.
    """
    return _first_mode(sid)[0] / (2.0 * float(np.pi))


def _unit_hint(
    value: float, units: dict[str, float], usual: tuple[float, float], si: str
) -> str:
    """ ": is it in GPa? Then it is 2.1e+11 Pa"."""
    for unit, factor in units.items():
        if usual[0] <= value * factor <= usual[1]:
            return f": is it in {unit}? In SI units that is {value * factor:.3g} {si}"
    return ": is it in other units?"


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
