"""The largest von Mises stress of flexible bodies: over all points and all times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.field import Field
from sidtool.formats.result import Result
from sidtool.formats.sid import Array
from sidtool.formats.stress import von_mises
from sidtool.solver.afterwards import Replay, replay
from sidtool.solver.recording.energies import elastic_state

from .companions import Given, companions

#: Times between output times that are looked at, and stresses that are at a time.
_BETWEEN, _BATCH = 4, 20_000_000


@dataclass(frozen=True, eq=False)
class Peak:
    """stress [Pa] at a point of a body, (3,) in its undeformed body frame [m], at a
    time [s]; components xx, yy, zz, xy, yz, xz in body axes."""

    body: str
    stress: float
    place: Array
    time: float
    components: Array


def peak_stresses(
    result: Result, fields: Given | None = None, folder: Path | None = None
) -> dict[str, Peak]:
    """The peak of every flexible body whose full field has stresses.

    Looked at are all points of the field, at output times and four times between each
    two of them.

    Raises
    ------
    InputError : no field with stresses is known.
    """
    again = replay(result)
    folders = [folder or Path("."), Path(".")]
    known, _ = companions(again.system.scene, result.sids, fields or {}, folders)
    found = _peaks(again, known)
    if not found:
        raise InputError(
            "there is no full field with stresses",
            place="--field",
            expected="BODY=FILE from `sidtool convert --field`, of solid elements",
        )
    return found


def _peaks(again: Replay, known: Mapping[str, Field]) -> dict[str, Peak]:
    stressed = {name: f for name, f in known.items() if f.stress is not None}
    if not stressed:
        return {}
    t = again.t
    if len(t) > 1:
        shares = np.arange(_BETWEEN + 1) / (_BETWEEN + 1)
        inner = (t[:-1, None] + np.diff(t)[:, None] * shares).ravel()
        t = np.append(inner, t[-1])
    samples = again.samples(t)
    found = {}
    for b, data in enumerate(again.system.bodies):
        field = stressed.get(data.name)
        if field is not None and data.sid.nq:
            q, _ = elastic_state(again.system, samples, b)
            found[data.name] = _peak(data.name, field, t, q)
    return found


def _peak(name: str, field: Field, t: Array, q: Array) -> Peak:
    assert field.stress is not None
    step = max(1, _BATCH // field.stress[..., 0].size)
    best = (-1.0, 0, 0)
    for first in range(0, len(t), step):
        part = np.moveaxis(field.stress @ q[first : first + step].T, 2, 0)
        mises = von_mises(part + field.initial_stress)
        row, point = map(int, np.unravel_index(mises.argmax(), mises.shape))
        best = max(best, (float(mises[row, point]), first + row, point))
    stress, k, i = best
    components = field.initial_stress[i] + field.stress[i] @ q[k]
    return Peak(name, stress, field.positions[i], float(t[k]), components)
