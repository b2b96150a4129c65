"""What bodies are coloured by, and how far it reaches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sidtool.formats.stress import von_mises

from .drawn_bodies import Drawn
from .played import Played

#: Values that are looked at for a range: more times are left out, evenly.
_MOST = 200_000_000
_PREFIXES: tuple[tuple[str, float], ...] = (
    ("G", 1e9),
    ("M", 1e6),
    ("k", 1e3),
    ("", 1.0),
    ("m", 1e-3),
    ("\N{MICRO SIGN}", 1e-6),
    ("n", 1e-9),
)

#: Deformations below this part of the mechanism are none.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Range:
    """Colours reach from 0 to `most` [SI], which is most / per in the unit."""

    title: str
    unit: str
    most: float
    per: float


def colour_ranges(motion: Played, bodies: Sequence[Drawn]) -> dict[str, Range]:
    """The largest elastic displacement and von Mises stress of all bodies."""
    found = {}
    moved = max((_most(motion, body, False) for body in bodies), default=0.0)
    if moved > 0:
        unit, per = _unit(moved, "m")
        found["displacement"] = Range("elastic displacement", unit, moved, per)
    stressed = [body for body in bodies if body.stress is not None and body.nq]
    stress = max((_most(motion, body, True) for body in stressed), default=0.0)
    if stress > 0:
        unit, per = _unit(stress, "Pa")
        found["stress"] = Range("von Mises stress", unit, stress, per)
    return found


def _most(motion: Played, body: Drawn, stress: bool) -> float:
    if not body.nq:
        return 0.0
    q = motion.elastic[body.name]
    field = body.stress if stress else body.shapes
    assert field is not None
    rows = np.arange(len(q))
    wanted = max(1, _MOST // field.size)
    if len(rows) > wanted:
        extremes = np.concatenate([q.argmax(axis=0), q.argmin(axis=0)])
        even = np.round(np.linspace(0, len(q) - 1, wanted)).astype(int)
        rows = np.unique(np.concatenate([even, extremes]))
    best = 0.0
    for k in rows:
        values = field @ q[k]
        if stress:
            values = von_mises(values + body.initial_stress)
        else:
            values = np.linalg.norm(values, axis=1)
        best = max(best, float(values.max(initial=0.0)))
    return best


def _unit(size: float, unit: str) -> tuple[str, float]:
    """A unit with a prefix in which the size is a handy number."""
    for prefix, per in _PREFIXES:
        if size >= per:
            return prefix + unit, per
    return unit, 1.0


def fitting_scale(motion: Played, bodies: Sequence[Drawn]) -> float:
    """A round magnification by which deformations are seen: the largest becomes about
    a thirtieth of the mechanism. What rounding leaves is not magnified."""
    moved = max((_most(motion, body, False) for body in bodies), default=0.0)
    if moved <= _ROUNDING * motion.size:
        return 1.0
    wanted = motion.size / 30 / moved
    if wanted < 2:
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1, 2, 5) if step * power <= wanted))
