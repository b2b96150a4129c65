"""Most likely unit system of a SID, which has no unit field.

Each known system turns the numbers into SI; the one that gives the most ordinary body
wins. Evidence: the density of a cuboid with the same inertia (or of the cube around the
body), its size, the first frequency times the size (a speed, bounded by that of sound),
and frequencies in the labels, which are in Hz whatever the unit of time.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic, WithDiagnostics, diagnose
from sidtool.formats.sid_mass import SPATIAL, central_inertia, free_motion

from ..mesh.unit_systems import UNIT_SYSTEMS, UnitSystem, check_magnitudes
from .body_modes import body_size
from .frequencies import free_modes, held_modes, label_hertz, to_hertz

# Ordinary values in SI as (centre, spread) in decades. A solid of foam to tungsten
# spans 2 to 4.3; slender bodies fill a thousandth of the cube around them and less.
_DENSITY = (3.5, 0.6)
_CUBE_DENSITY = (1.5, 1.2)
_SIZE = (-0.3, 0.9)
_SPEED = (1.7, 1.0)
# Rarely used systems need more evidence.
_RARE_SYSTEMS = {"cm-g-s": 2.0, "in-lbf-s": 2.0, "ft-lbf-s": 10.0}
# Difference of squared spreads above which the best system is certain, and limit of
# ordinary values.
_CERTAIN_LEAD = 4.0
_STRANGE_MISFIT = 25.0
# Labels follow from Ke and Me to their digits; a factor this far off is another unit.
_SAME_RATIO = 0.02


@dataclass(frozen=True)
class UnitCandidate:
    """A unit system and how far from ordinary it makes the body (squared spreads)."""

    system: str
    misfit: float
    evidence: str


@dataclass(frozen=True)
class UnitGuess(WithDiagnostics):
    """Unit systems ranked by plausibility.

    Attributes
    ----------
    candidates : best first; empty if the SID holds nothing to judge by
    certain : True if the best one is clearly ahead
    diagnostics : not SI, or contradictory
    """

    candidates: tuple[UnitCandidate, ...]
    certain: bool
    diagnostics: tuple[Diagnostic, ...]

    @property
    def system(self) -> str | None:
        """Name of the best system, if any."""
        return self.candidates[0].system if self.candidates else None

    @property
    def nearly(self) -> list[str]:
        """Names of the others that are nearly as plausible, the best first."""
        best, *others = self.candidates or (None,)
        return [
            c.system for c in others if best and c.misfit - best.misfit <= _CERTAIN_LEAD
        ]


@dataclass(frozen=True)
class _Evidence:
    mass: float
    size: float
    volume: float | None
    frequency: float | None
    label_ratio: float | None


def guess_units(sid: SID) -> UnitGuess:
    """Return the most likely unit systems of a SID.

    Raises
    ------
    InputError : an entry is not a finite number below 1e100.
    """
    check_magnitudes(sid)
    with np.errstate(all="ignore"):
        return _rank_unit_systems(sid)


def _rank_unit_systems(sid: SID) -> UnitGuess:
    size = body_size(sid)
    if not (sid.mass > 0.0 and size > 0.0):
        return UnitGuess((), False, ())
    ratio, frequency = _label_ratio(sid)
    evidence = _Evidence(sid.mass, size, _cuboid_volume(sid), frequency, ratio)
    ranked = sorted(
        (_candidate_of(system, evidence) for system in UNIT_SYSTEMS.values()),
        key=lambda candidate: candidate.misfit,
    )
    certain = ranked[1].misfit - ranked[0].misfit > _CERTAIN_LEAD
    found = tuple(_unit_diagnostics(ranked, ratio))
    return UnitGuess(tuple(ranked), certain, found)


def _candidate_of(system: UnitSystem, evidence: _Evidence) -> UnitCandidate:
    size = evidence.size * system.length
    mass = evidence.mass * system.mass
    terms = [(np.log10(size), _SIZE)]
    texts = [f"size {size:.3g} m", f"mass {mass:.3g} kg"]
    if evidence.volume is None:
        terms.append((np.log10(mass / size**3), _CUBE_DENSITY))
    else:
        density = mass / (evidence.volume * system.length**3)
        terms.append((np.log10(density), _DENSITY))
        texts.append(f"density {density:.3g} kg/m3")
    if evidence.frequency:
        frequency = evidence.frequency / system.time
        terms.append((np.log10(frequency * size), _SPEED))
        texts.append(f"first frequency {frequency:.4g} Hz")
    misfit = sum(((value - centre) / spread) ** 2 for value, (centre, spread) in terms)
    misfit += _frequency_misfit(system, evidence.label_ratio) + _RARE_SYSTEMS.get(
        system.name, 0.0
    )
    return UnitCandidate(system.name, float(misfit), ", ".join(texts))


def _frequency_misfit(system: UnitSystem, ratio: float | None) -> float:
    """Return the misfit of labels in Hz and frequencies per unit of time."""
    if ratio is None:
        return 0.0
    return 4.0 * float(np.log10(ratio * system.time)) ** 2


def _label_ratio(sid: SID) -> tuple[float | None, float | None]:
    """Label over computed frequency, if it is one ratio; and the first computed one."""
    if sid.nq == 0:
        return None, None
    try:
        supports = [to_hertz(held_modes(sid)[0])]
    except np.linalg.LinAlgError:
        return None, None
    if free_motion(sid).possible:
        supports.append(to_hertz(free_modes(sid, SPATIAL)[0]))
    positive = supports[0][supports[0] > 0.0]
    first = float(positive[0]) if len(positive) else None
    label_frequencies = label_hertz(sid)
    if label_frequencies is None:
        return None, first
    labels = np.sort(label_frequencies[0])
    for computed in supports:
        known = (computed > 0.0) & (labels > 0.0)
        ratios = labels[known] / computed[known]
        if len(ratios) and np.ptp(ratios) <= _SAME_RATIO * ratios.mean():
            return float(ratios.mean()), first
    return None, first


def _cuboid_volume(sid: SID) -> float | None:
    """Volume of the homogeneous cuboid with this central inertia; None if it has none.

    Edges a of a cuboid: a_x^2 = 6 (J_y + J_z - J_x) / m.
    """
    moments = np.linalg.eigvalsh(central_inertia(sid))
    squares = 6.0 * (moments.sum() - 2.0 * moments) / sid.mass
    if squares.min() <= 1e-8 * squares.max():
        return None
    return float(np.sqrt(np.prod(squares)))


def _unit_diagnostics(
    ranked: list[UnitCandidate], ratio: float | None
) -> Iterator[Diagnostic]:
    """Diagnose numbers that are not in SI, or in no system (N930 to N932)."""
    best = ranked[0]
    si = next(c for c in ranked if c.system == "m-kg-s")
    values: dict[str, Any] = {
        "system": best.system,
        "evidence": best.evidence,
        "misfit": best.misfit,
    }
    if best.misfit > _STRANGE_MISFIT:
        yield diagnose("N931", **values)
    elif si.misfit - best.misfit > _CERTAIN_LEAD:
        yield diagnose("N930", **values)
    usual = (1.0, 1e3)
    if ratio and not any(abs(ratio / unit - 1.0) <= _SAME_RATIO for unit in usual):
        yield diagnose("N932", ratio=ratio)
