"""Loads of bodies of which nobody knows how much their shape functions carry.

SIDs of other programs, and of earlier versions, do not tell the compliance of the full
body (`formats.carried`). Modes alone come to it from below, the lowest with the most:
what rests on the upper half of those that take part in a direction shows how far they
are from it. Where modes of one frequency alone take part, nothing does.
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
#: A mode takes part where it has more than this part of the largest share; a share
#: above this is all of it.
_PART, _ALL = 1e-3, 1.0 - 1e-9
#: By node, compliances (6,) of the lower half of the natural modes that take part in
#: each direction, and of all.
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
            where = f"that {along(worst)} at {marker} ({', '.join(names)})"
            text = (
                f"{100.0 * found[worst]:.0f} % of {where} rests on the upper half of "
                "the natural modes that take part in it, and more modes may add as much"
            )
            if found[worst] > _ALL:
                text = (
                    f"{where} rests on natural modes of one frequency alone, and "
                    "nothing tells how much more modes would add"
                )
            places.setdefault(body, []).append(text)
    for body, told in places.items():
        yield (
            f"how much of its static compliance the shape functions of {body} carry "
            "cannot be judged, as its SID does not tell that of the full body: "
            f"{'; '.join(told)}; static answers to these loads (attachment modes) "
            "carry all of it"
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
    found = {}
    for node in sid.nodes:
        parts = (np.vstack([node.phi.m0, node.psi.m0]) @ modes) ** 2
        lower = [_lower_half(squares, part) for part in parts]
        found[node.id] = (np.array(lower), parts.sum(axis=1))
    return found


def _lower_half(squares: Array, parts: Array) -> float:
    """What the lower half of the modes that take part has, of parts (nq,).

    Of modes of one frequency none is lower: which comes first is rounding.
    """
    taking = np.flatnonzero(parts > _PART * parts.max(initial=0.0))
    if not taking.size:
        return 0.0
    limit = (1.0 - _EQUAL) * squares[taking[len(taking) // 2]]
    return float(parts[squares < limit].sum())
