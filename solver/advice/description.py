"""What compiling a scene kept and dropped, and why, in sentences."""

from __future__ import annotations

import numpy as np

from sidtool.formats.errors import InputError

from ..space import layout as at
from ..start.assembly import assemble, names_of_rows
from ..start.displacements import told_displacements
from ..system.bodies.data import BodyData
from ..system.scene import System
from ..system.storage import new_work
from .body_measures import expected_bodies
from .checks import check_attachments
from .notes import of_programs

#: Relative size below which stiffening at markers counts as zero.
_NOTHING = 1e-6
_TERMS = {
    at.HAS_CR1: "first-order terms of Cr and Ge",
    at.HAS_OE1: "first-order term of Oe",
    at.HAS_CT1: "geometric stiffening by acceleration (Ct1)",
    at.HAS_KE1: "elastic forces quadratic in the coordinates (Ke1)",
    at.HAS_QUADRATIC_J: "quadratic inertia",
}
#: Terms that the inertia of a stiffened body always has, in mean axes.
_OF_STIFFENED = at.HAS_CR1 | at.HAS_OE1 | at.HAS_CT1 | at.HAS_QUADRATIC_J


def describe(system: System) -> list[str]:
    """Lines that say what is integrated.

    Raises
    ------
    InputError : no start position meets the constraints.
    """
    system, start = assemble(system)
    kind = "planar" if system.planar else "spatial"
    lines = [
        f"{kind} scene: {system.n_positions - system.n_turns} position coordinates, "
        f"{system.n_velocities} velocity coordinates, {system.n_rows} constraints"
    ]
    lines += [_degrees_of_freedom(system), _total_mass(system)]
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        if data.of_scene:
            lines.append(f"body {data.name}: {_body(row, data)}")
            lines += _stiffened_markers(system, data)
            lines += _prestress(data)
    for name, body in expected_bodies(system, start).items():
        lines.append(f"body {name}: {body.before}")
    lines += _defects(system)
    least = system.scene.accuracy.rtol
    lines += told_displacements(system, new_work(system), start, least)
    for name, owner in system.eliminated.items():
        lines.append(
            f"{name}: dropped from the constraints, the frame of {owner} is prescribed"
        )
    if system.redundant:
        names = ", ".join(dict.fromkeys(names_of_rows(system, system.redundant)))
        count = len(system.redundant)
        plural = "" if count == 1 else "s"
        lines.append(
            f"{count} redundant constraint{plural} ({names}): met by the others; of "
            "all multipliers that hold the mechanism the smallest are told"
        )
    lines += of_programs(system)
    used, total = len(system.markers), sum(len(b.sid.nodes) for b in system.bodies)
    lines.append(f"markers: {used} used of {total} exported nodes")
    return lines


def _degrees_of_freedom(system: System) -> str:
    """What joints and drives leave free at the start, by counting (Gruebler).

    States of laws are no degrees of freedom, and redundant constraints hold nothing.
    """
    pairs = list(zip(system.arrays.body, system.bodies, strict=True))
    free = sum(int(row[at.NV]) for row, data in pairs if data.of_scene)
    elastic = sum(int(row[at.NQ]) for row, data in pairs if data.of_scene)
    redundant = len({*system.redundant, *system.dropped})
    freedom = free - (system.n_rows - redundant)
    return (
        f"degrees of freedom: {freedom}, of {free} velocity coordinates ({elastic} "
        f"elastic), {system.n_rows} constraints and {redundant} redundancies"
    )


def _total_mass(system: System) -> str:
    mass = sum(data.sid.mass for data in system.bodies if data.of_scene)
    return f"total mass: {mass:.6g} kg"


def _stiffened_markers(system: System, data: BodyData) -> list[str]:
    """Geometric stiffening by forces and moments at markers that are used."""
    markers = [marker for body, marker in system.markers if body == data.name]
    sizes = {
        (marker, entry): np.abs(getattr(data.node(marker), entry).m1).max(initial=0.0)
        for marker in markers
        for entry in ("phi", "psi")
        if getattr(data.node(marker), entry).m1 is not None
    }
    least = _NOTHING * max(sizes.values(), default=0.0)
    lines = []
    for wanted, what in (("phi", "forces kept"), ("psi", "moments kept")):
        found = [m for (m, entry), s in sizes.items() if entry == wanted and s > least]
        if found:
            listed = ", ".join(found)
            lines.append(f"body {data.name}: stiffening by {what} at {listed}")
    return lines


def _prestress(data: BodyData) -> list[str]:
    """What a body under initial stress needs of the scene, and must not hold itself."""
    if not data.sid.ksigma.m0.any():
        return []
    return [
        f"body {data.name}: prestressed (ksigma), undeformed under the loads of its "
        "prestress only; what these stiffen at markers must not be in its Ke as well"
    ]


def _defects(system: System) -> list[str]:
    """What `compile_scene` would refuse unless told to accept it."""
    try:
        check_attachments(system)
    except InputError as error:
        return [f"{error.problem} (--accept-defects)"]
    return []


def _body(row: object, data: BodyData) -> str:
    nq, rigid = int(row[at.NQ]), int(row[at.RD])  # type: ignore[index]
    flags = int(row[at.FLAGS])  # type: ignore[index]
    frame = {0: "prescribed frame, no coordinates", 2: "point mass, 2 coordinates"}
    frame |= {3: "3 frame coordinates", 6: "6 frame coordinates"}
    parts = [frame[rigid]]
    if nq:
        if flags & at.STIFFENED:
            flags |= _OF_STIFFENED
        kept = [text for bit, text in _TERMS.items() if flags & bit]
        dropped = [text for bit, text in _TERMS.items() if not flags & bit]
        parts.append(f"{nq} elastic coordinates")
        parts.append(f"kept: {', '.join(kept) or 'nothing beyond zeroth order'}")
        parts.append(
            f"dropped, zero or not asked for: {', '.join(dropped) or 'nothing'}"
        )
    return "; ".join(parts)
