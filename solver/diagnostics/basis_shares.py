"""Loads for which the shape functions of a body are poor or unknown.

The share of the static compliance of the full body that the shape functions represent
is stored in the SID, if its source knew it. Shares are checked for loads at markers and
for the inertia of the body itself.
"""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import DIRECTIONS, OE_INDICES, SID, Array
from sidtool.formats.base.stress import stress_nodes
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.sid_mass import body_size
from sidtool.formats.sid_subset import (
    inertia_load_scales,
    inertia_work_of_full_body,
    unit_load_compliances,
)

from ..initial_state.assembly import StateVectors
from ..system.body_data import BodyData
from ..system.sid_packing import symmetrise
from ..system.system import System
from .body_loads import expected_loads
from .excitation import drive_history, prescribed_frames, start_frame

#: Shape functions that carry less than this share of a compliance are poor.
MIN_SHARE = 0.9
#: Where what is missing is less than this part of the largest compliance beside it,
#: it matters only if the share is below one half.
SMALL_FRACTION, HALF_SHARE = 0.01, 0.5
#: A direction is loaded if this much of it lies in what the loads span.
LOADED_FRACTION = 0.5
#: A body without stress may be rigid under a load, as inextensible blades: its shape
#: functions carry less than this share.
RIGID_SHARE = 1e-3
#: A free one is not: it deforms by more than this part of its size.
MIN_STRETCH = 1e-6
#: Shapes that carry less than this share are missing, not poor.
MISSING_SHARE = 1e-12
#: What loads a body: body and marker, force and moment in body axes, what exerts them.
Load = tuple[tuple[str, str], Array, Array, str]
#: Words of labels of shape functions that are answers to static loads.
_STATIC_LABELS = ("attachment", "constraint", "static", "relief", "at 0 hz")
#: A compliance smaller by as much than the largest one of its kind is rounding.
_NEGLIGIBLE = 1e-18
#: Squares of natural frequencies that are closer (relative) are those of a pair.
_EQUAL_FREQUENCY = 1e-6
#: A mode takes part where it has more than this part of the largest share.
_MIN_PARTICIPATION = 1e-3
#: By node, compliances (6,) of the lower half of the natural modes that take part in
#: each direction, and of all.
HalfCompliances = dict[str, tuple[Array, Array]]
_FORCES, _MOMENTS = slice(0, 3), slice(3, 6)
#: Loads of a body by its own inertia.
INERTIA_LOADS = (
    *(f"acceleration along {axis}" for axis in "xyz"),
    *(f"acceleration about {axis}" for axis in "xyz"),
    *(f"rotation about {axis}" for axis in "xyz"),
    *(f"rotation about both {axes}" for axes in ("x and y", "y and z", "x and z")),
)


def is_poorly_represented(system: System, body: str, marker: str) -> bool:
    """True if shape functions are poor in some direction at a marker."""
    return bool(_poor_shares(system, system.bodies[system.index(body)], marker))


def poor_direction_notes(system: System, loads: Iterable[Load]) -> Iterator[Diagnostic]:
    """Compliance that is missing at loaded markers (N420)."""
    for (body, marker), acting in loads_at_markers(loads).items():
        data = system.bodies[system.index(body)]
        spanned_ = spanned_fraction(np.array([vector for vector, _ in acting]))
        poor = _poor_shares(system, data, marker, spanned_ > LOADED_FRACTION)
        if not poor:
            continue
        names = dict.fromkeys(name for v, name in acting if v[list(poor)].any())
        missing, directions = _missing_shares(poor)
        yield diagnose(
            "N420",
            body,
            missing=missing,
            directions=directions,
            marker=marker,
            joints=list(names),
            shapes=suggested_shapes(data.sid),
        )


def loads_at_markers(
    loads: Iterable[Load],
) -> dict[tuple[str, str], list[tuple[Array, str]]]:
    """Forces and moments (6,) with what exerts them, by body and marker."""
    loads_by_marker: dict[tuple[str, str], list[tuple[Array, str]]] = {}
    for end, force, moment, name in loads:
        loads_by_marker.setdefault(end, []).append(
            (np.concatenate([force, moment]), name)
        )
    return loads_by_marker


def _poor_shares(
    system: System,
    data: BodyData,
    marker: str,
    loaded: NDArray[np.bool_] | None = None,
) -> dict[int, float]:
    """What is carried in poor directions, by number.

    Parameters
    ----------
    loaded : (6,) whether anything loads them, default all
    """
    loaded = np.ones(6, bool) if loaded is None else loaded
    compliance = data.sid.carried
    if not data.is_scene_body or not data.sid.nq or compliance is None:
        return {}
    node = data.node(marker)
    row = compliance.shares.get(node.id)
    if row is None or min((x for x in row if x is not None), default=1.0) >= MIN_SHARE:
        return {}
    known = np.array([np.nan if x is None else x for x in row])
    # loads at the node that a free body's frame follows deform the body, too
    is_free_frame = compliance.free and not (node.phi.m0.any() or node.psi.m0.any())
    own = unit_load_compliances(data.sid, compliance.free).nodes[node.id]
    full = own / np.maximum(known, MISSING_SHARE)
    shares: dict[int, float] = {}
    for directions in load_directions(system):
        kind = [k for k in directions if loaded[k]]
        full[kind] = np.where(known[kind] > MISSING_SHARE, full[kind], 0.0)
        largest = np.nanmax(full[kind], initial=0.0)
        for k in kind:
            small = full[k] - own[k] <= SMALL_FRACTION * largest
            if known[k] <= MISSING_SHARE:
                poor = is_free_frame
            else:
                poor = known[k] < (HALF_SHARE if small else MIN_SHARE)
            if poor:
                shares[k] = float(known[k])
    return shares


def load_directions(system: System) -> tuple[list[int], list[int]]:
    """The directions of forces and of moments, in the plane or in space."""
    return ([0, 1], [5]) if system.planar else ([0, 1, 2], [3, 4, 5])


def spanned_fraction(vectors: Array) -> Array:
    """(6,) how much of a unit force or moment lies in what vectors (n, 6) span."""
    shares = np.zeros(6)
    for kind in (_FORCES, _MOMENTS):
        _, sizes, basis = np.linalg.svd(vectors[:, kind], full_matrices=False)
        basis_ = basis[sizes > LOADED_FRACTION * sizes.max(initial=0.0)]
        shares[kind] = np.linalg.norm(basis_, axis=0)
    return shares


def _missing_shares(poor: dict[int, float]) -> tuple[float, str]:
    """The largest missing share, and all directions in words, from shares by number."""
    directions = " and ".join(direction_text(k) for k in poor)
    return 1.0 - min(poor.values()), directions


def direction_text(k: int) -> str:
    return f"{'along' if k < 3 else 'about'} {DIRECTIONS[k].removeprefix('r')}"


def suggested_shapes(sid: SID) -> str:
    """Which shape functions hold the static answer to a load at a marker.

    Those of Craig-Bampton hold it of a body that is held; of a free one they hold its
    inertia in place of its reaction, unless it is loaded where it is held only.
    """
    if sid.carried is None:
        return "attachment"
    return f"attachment or {'Herting' if sid.carried.free else 'Craig-Bampton'}"


def poor_inertia_notes(system: System, start: StateVectors) -> Iterator[Diagnostic]:
    """Bodies whose own inertia deforms them as no shape function does (N422).

    Gravity and, as far as they are known, accelerations and rotations of its frame
    load it.
    """
    poor = [
        data for data in system.bodies if data.is_scene_body and _has_poor_inertia(data)
    ]
    if not poor:
        return
    history = system.cached(drive_history)
    frames = prescribed_frames(system, history)
    for data in poor:
        frame = frames.get(data.name)
        if frame is None:
            frame = start_frame(system, start.z, start.v, data.name)
        loads = expected_loads(system, frame, history.times, data.name)
        accelerations = (loads.acceleration, loads.angular_acceleration)
        w = loads.angular_velocity
        products = np.column_stack([w[:, a] * w[:, b] for a, b in OE_INDICES])
        sizes = np.hstack([*accelerations, products])
        shares = _poor_inertia_shares(system, data, np.abs(sizes).max(axis=0))
        if shares:
            causes = " and ".join(INERTIA_LOADS[k] for k in shares)
            missing = 1.0 - min(shares.values())
            yield diagnose("N422", data.name, missing=missing, causes=causes)


def _has_poor_inertia(data: BodyData) -> bool:
    compliance = data.sid.carried
    return bool(
        data.sid.nq
        and compliance
        and compliance.knows_inertia
        and max(compliance.lost) > 0.0
    )


def _poor_inertia_shares(
    system: System, data: BodyData, size: Array
) -> dict[int, float]:
    """Shares that are carried of the energy under loads of `size` (12,), where much of
    what all of them cause is missing.
    """
    compliance = data.sid.carried
    assert compliance is not None
    unit = unit_load_compliances(data.sid, compliance.free)
    full, own = inertia_work_of_full_body(compliance.lost, unit), unit.inertia
    size = size / inertia_load_scales(data.sid.mass, data.sid.J.m0[:3, 0])
    stretch = (full - own) * size / data.sid.mass
    is_deformed = compliance.free & (stretch > MIN_STRETCH * body_size(data.sid))
    full, own = full * size**2, own * size**2
    possible = [0, 1, 5, 8] if system.planar else list(range(12))
    largest = full[possible].max()
    has_stress = bool(stress_nodes(data.sid))
    counts = has_stress | is_deformed | (own >= RIGID_SHARE * full)
    return {
        k: float(own[k] / full[k])
        for k in possible
        if counts[k]
        and full[k] - own[k]
        > max((1.0 - MIN_SHARE) * full[k], SMALL_FRACTION * largest)
    }


def is_unassessed(system: System, body: str, marker: str) -> bool:
    """True if much of the compliance at a marker rests on the upper half of modes."""
    return bool(_upper_half_shares(system, body, marker))


def unassessed_loads(system: System, loads: Iterable[Load]) -> Iterator[Diagnostic]:
    """Markers at which it is not known what shape functions lack (N423)."""
    for (body, marker), acting in loads_at_markers(loads).items():
        spanned_ = spanned_fraction(np.array([vector for vector, _ in acting]))
        shares = _upper_half_shares(system, body, marker)
        shares = {k: share for k, share in shares.items() if spanned_[k] > HALF_SHARE}
        if shares:
            worst = max(shares, key=lambda k: shares[k])
            of_one = shares[worst] >= 1.0
            names = dict.fromkeys(name for v, name in acting if v[list(shares)].any())
            yield diagnose(
                "N423",
                body,
                share=shares[worst],
                direction=direction_text(worst),
                marker=marker,
                modes="modes of one frequency" if of_one else "the upper modes",
                joints=list(names),
            )


def _upper_half_shares(system: System, body: str, marker: str) -> dict[int, float]:
    """The share of the upper half of the natural modes, by direction, where large."""
    data = system.bodies[system.index(body)]
    halves = system.cached(_half_compliances).get(body)
    if halves is None:
        return {}
    lower, own = halves[data.node(marker).id]
    shares: dict[int, float] = {}
    for kind in load_directions(system):
        largest = max((own[k] for k in kind), default=0.0)
        for k in kind:
            share = 1.0 - lower[k] / own[k] if own[k] > _NEGLIGIBLE * largest else 0.0
            small = own[k] - lower[k] <= SMALL_FRACTION * largest
            if share > (HALF_SHARE if small else 1.0 - MIN_SHARE):
                shares[k] = float(share)
    return shares


def _half_compliances(system: System) -> dict[str, HalfCompliances]:
    """Of the bodies of which nothing is known."""
    compliances = {}
    for data in system.bodies:
        known = data.sid.carried is not None or _has_static_shapes(data.sid)
        if data.is_scene_body and data.sid.nq and not known:
            halves = _natural_mode_halves(data.sid)
            if halves is not None:
                compliances[data.name] = halves
    return compliances


def _has_static_shapes(sid: SID) -> bool:
    labels = " ".join(sid.labels).lower()
    return any(word in labels for word in _STATIC_LABELS)


def _natural_mode_halves(sid: SID) -> HalfCompliances | None:
    """None where Me or Ke is singular."""
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(symmetrise(sid.Me.m0)))
    except np.linalg.LinAlgError:
        return None
    squares, vectors = np.linalg.eigh(inverse @ symmetrise(sid.Ke.m0) @ inverse.T)
    if not squares[0] > 0.0:
        return None
    modes = inverse.T @ vectors / np.sqrt(squares)
    halves = {}
    for node in sid.nodes:
        parts = (np.vstack([node.phi.m0, node.psi.m0]) @ modes) ** 2
        lower = [_lower_half_sum(squares, part) for part in parts]
        halves[node.id] = (np.array(lower), parts.sum(axis=1))
    return halves


def _lower_half_sum(squares: Array, parts: Array) -> float:
    """What the lower half of the modes that take part has, of parts (nq,).

    Of modes of one frequency none is lower: which comes first is rounding.
    """
    taking = np.flatnonzero(parts > _MIN_PARTICIPATION * parts.max(initial=0.0))
    if not taking.size:
        return 0.0
    limit = (1.0 - _EQUAL_FREQUENCY) * squares[taking[len(taking) // 2]]
    return float(parts[squares < limit].sum())
