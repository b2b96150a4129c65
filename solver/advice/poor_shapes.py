"""Loads for which a body has shape functions, but poor ones.

What its shape functions carry of the compliance of the full body stands in its SID, if
whoever made it knew it (`formats.carried`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from sidtool.formats.carried import DIRECTIONS
from sidtool.formats.carried.compliance import compliances, full_inertia
from sidtool.formats.sid import SID, Array

from ..start.assembly import Start
from ..system.bodies.data import BodyData
from ..system.scene import System
from .body_loads import foreseen_loads
from .excitation import drive_history
from .prescribed import prescribed_frames, start_frame

#: Shape functions that carry less than this share of a compliance are poor.
POOR = 0.9
#: Where what is missing is less than this part of the largest compliance beside it,
#: it matters only if the share is below one half.
SMALL, HALF = 0.01, 0.5
#: A direction is loaded if this much of it lies in what the loads span.
LOADED = 0.5
#: Shapes that carry less than this share are missing, not poor.
MISSING = 1e-12

_FORCES, _MOMENTS = slice(0, 3), slice(3, 6)

#: What loads a body: body and marker, force and moment in body axes, what exerts them.
Load = tuple[tuple[str, str], Array, Array, str]


def is_poor(system: System, body: str, marker: str) -> bool:
    """Whether shape functions are poor in some direction at a marker."""
    return bool(_shares(system, system.bodies[system.index(body)], marker))


def poor_directions(system: System, loads: Iterable[Load]) -> Iterator[str]:
    """One sentence for each body and marker."""
    for (body, marker), acting in felt_at(loads).items():
        data = system.bodies[system.index(body)]
        poor = _shares(system, data, marker)
        there = spanned(np.array([vector for vector, _ in acting]))
        poor = {k: share for k, share in poor.items() if there[k] > LOADED}
        if not poor:
            continue
        names = dict.fromkeys(name for v, name in acting if v[list(poor)].any())
        yield (
            f"the shape functions of {body} carry {_told(poor)} at {marker}, where "
            f"{', '.join(names)} {'load' if len(names) > 1 else 'loads'} it: "
            f"{remedy(data.sid)} with this marker among the interfaces carry all of it"
        )


def felt_at(loads: Iterable[Load]) -> dict[tuple[str, str], list[tuple[Array, str]]]:
    """Forces and moments (6,) with what exerts them, by body and marker."""
    felt: dict[tuple[str, str], list[tuple[Array, str]]] = {}
    for where, force, moment, name in loads:
        felt.setdefault(where, []).append((np.concatenate([force, moment]), name))
    return felt


def _shares(system: System, data: BodyData, marker: str) -> dict[int, float]:
    """What is carried in poor directions, by number."""
    carried = data.sid.carried
    if not data.of_scene or not data.sid.nq or carried is None:
        return {}
    node = data.node(marker).id
    row = carried.shares.get(node)
    if row is None or min((x for x in row if x is not None), default=1.0) >= POOR:
        return {}
    known = np.array([np.nan if x is None else x for x in row])
    own = compliances(data.sid, carried.free)[0][node]
    full = own / np.maximum(known, MISSING)
    found: dict[int, float] = {}
    for kind in ways(system):
        full[kind] = np.where(known[kind] > MISSING, full[kind], 0.0)
        largest = np.nanmax(full[kind], initial=0.0)
        for k in kind:
            small = full[k] - own[k] <= SMALL * largest
            if MISSING < known[k] < (HALF if small else POOR):
                found[k] = float(known[k])
    return found


def ways(system: System) -> tuple[list[int], list[int]]:
    """The directions of forces and of moments, in the plane or in space."""
    return ([0, 1], [5]) if system.planar else ([0, 1, 2], [3, 4, 5])


def spanned(vectors: Array) -> Array:
    """(6,) how much of a unit force or moment lies in what vectors (n, 6) span."""
    shares = np.zeros(6)
    for kind in (_FORCES, _MOMENTS):
        _, sizes, basis = np.linalg.svd(vectors[:, kind], full_matrices=False)
        kept = basis[sizes > LOADED * sizes.max(initial=0.0)]
        shares[kind] = np.linalg.norm(kept, axis=0)
    return shares


def _told(poor: dict[int, float]) -> str:
    """ "83 % of its compliance along x"."""
    parts = [f"{_percent(share)} {along(k)}" for k, share in poor.items()]
    first, *rest = parts
    first = first.replace("%", "% of its compliance", 1)
    return " and ".join([first, *rest])


def along(k: int) -> str:
    return f"{'along' if k < 3 else 'about'} {DIRECTIONS[k].removeprefix('r')}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"


def remedy(sid: SID) -> str:
    """Which shape functions hold the static answer to a load at a marker.

    Those of Craig-Bampton hold it of a body that is held; of a free one they hold its
    inertia in place of its reaction, unless it is loaded where it is held only.
    """
    if sid.carried is None:
        return "attachment modes"
    return f"attachment or {'Herting' if sid.carried.free else 'Craig-Bampton'} modes"


def poor_inertia(system: System, start: Start) -> Iterator[str]:
    """One sentence for each body whose own inertia deforms it as no shape does.

    Gravity and, as far as they are known, accelerations of its frame load it.
    """
    poor = [data for data in system.bodies if data.of_scene and _loses(data)]
    if not poor:
        return
    history = system.once(drive_history)
    frames = prescribed_frames(system, history)
    for data in poor:
        frame = frames.get(data.name)
        if frame is None:
            frame = start_frame(system, start.z, start.v, data.name)
        loads = foreseen_loads(system, frame, history.times, data.name)
        both = np.hstack([loads.acceleration, loads.angular_acceleration])
        found = _lost_under(system, data, np.abs(both).max(axis=0))
        if found:
            yield (
                f"the shape functions of {data.name} carry {_told(found)} under its "
                "own weight and inertia: more modes, or attachment modes, carry it"
            )


def _loses(data: BodyData) -> bool:
    carried = data.sid.carried
    return bool(data.sid.nq and carried and max(carried.lost, default=0.0) > 1 - POOR)


def _lost_under(system: System, data: BodyData, size: Array) -> dict[int, float]:
    """Shares that are carried of accelerations (6,) under which much is lost."""
    carried = data.sid.carried
    assert carried is not None
    own = compliances(data.sid, carried.free)[1]
    full = full_inertia(carried.lost, own)
    found = {}
    for kind, directions in zip((_FORCES, _MOMENTS), ways(system), strict=True):
        largest = size[kind].max()
        for k in directions:
            loaded = largest > 0.0 and size[k] > LOADED * largest
            if loaded and carried.lost[k] > 1.0 - POOR:
                found[k] = float(own[k] / full[k]) if full[k] else 0.0
    return found
