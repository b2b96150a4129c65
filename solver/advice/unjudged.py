"""Loads of bodies of which nobody knows how much their shape functions carry.

SIDs of other programs, and of earlier versions, do not tell the compliance of the full
body (`formats.carried`). Modes alone come to it from below, the lowest with the most:
what rests on the upper half of them shows how far they are from it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from sidtool.formats.sid import SID, Array

from ..system.bodies.packing import symmetric
from ..system.scene import System
from .poor_shapes import HALF, POOR, SMALL, Load, along, felt_at, spanned, ways

#: Words of labels of shape functions that are answers to static loads.
_STATIC = ("attachment", "constraint", "static", "relief", "at 0 hz")
#: A compliance smaller by as much than the largest one of its kind is rounding.
_NONE = 1e-18
#: Squares of natural frequencies that are closer (relative) are those of a pair.
_EQUAL = 1e-6
#: By node, compliances (6,) of the lower half of the natural modes, and of all.
Halves = dict[str, tuple[Array, Array]]


def is_unjudged(system: System, body: str, marker: str) -> bool:
    """Whether much of the compliance at a marker rests on the upper half of modes."""
    return bool(_resting(system, body, marker))


def unjudged(system: System, loads: Iterable[Load]) -> Iterator[str]:
    """One sentence for each body whose shape functions cannot be judged."""
    places: dict[str, list[str]] = {}
    for (body, marker), acting in felt_at(loads).items():
        there = spanned(np.array([vector for vector, _ in acting]))
        found = _resting(system, body, marker)
        found = {k: share for k, share in found.items() if there[k] > HALF}
        if found:
            worst = max(found, key=lambda k: found[k])
            names = dict.fromkeys(name for v, name in acting if v[list(found)].any())
            share = f"{100.0 * found[worst]:.0f} % of that {along(worst)} at {marker}"
            places.setdefault(body, []).append(f"{share} ({', '.join(names)})")
    for body, told in places.items():
        yield (
            f"how much of its static compliance the shape functions of {body} carry "
            "cannot be judged, as its SID does not tell that of the full body: "
            f"{', '.join(told)} {'rests' if len(told) == 1 else 'rest'} on the upper "
            "half of its natural modes, so that more modes may add as much; static "
            "answers to these loads (attachment modes) among them would not"
        )


def _resting(system: System, body: str, marker: str) -> dict[int, float]:
    """The share of the upper half of the natural modes, by direction, where large."""
    data = system.bodies[system.index(body)]
    halves = system.once(_halves).get(body)
    if halves is None:
        return {}
    lower, own = halves[data.node(marker).id]
    found: dict[int, float] = {}
    for kind in ways(system):
        largest = max((own[k] for k in kind), default=0.0)
        for k in kind:
            share = 1.0 - lower[k] / own[k] if own[k] > _NONE * largest else 0.0
            small = own[k] - lower[k] <= SMALL * largest
            if share > (HALF if small else 1.0 - POOR):
                found[k] = float(share)
    return found


def _halves(system: System) -> dict[str, Halves]:
    """Of the bodies of which nothing is known."""
    found = {}
    for data in system.bodies:
        known = data.sid.carried is not None or _has_static_shapes(data.sid)
        if data.of_scene and data.sid.nq and not known:
            halves = _of_natural_modes(data.sid)
            if halves is not None:
                found[data.name] = halves
    return found


def _has_static_shapes(sid: SID) -> bool:
    labels = " ".join(sid.labels).lower()
    return any(word in labels for word in _STATIC)


def _of_natural_modes(sid: SID) -> Halves | None:
    """None where Me or Ke is singular."""
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(symmetric(sid.Me.m0)))
    except np.linalg.LinAlgError:
        return None
    squares, vectors = np.linalg.eigh(inverse @ symmetric(sid.Ke.m0) @ inverse.T)
    if not squares[0] > 0.0:
        return None
    modes = inverse.T @ vectors / np.sqrt(squares)
    # Of modes of one frequency none is lower: which comes first is rounding.
    half = int(np.searchsorted(squares, (1.0 - _EQUAL) * squares[sid.nq // 2]))
    found = {}
    for node in sid.nodes:
        parts = (np.vstack([node.phi.m0, node.psi.m0]) @ modes) ** 2
        found[node.id] = (parts[:, :half].sum(axis=1), parts.sum(axis=1))
    return found
