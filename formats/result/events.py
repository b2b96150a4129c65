"""Events of a run and their storage in HDF5."""

from collections.abc import Sequence
from dataclasses import dataclass

import h5py
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_TEXT_FIELDS, _ROW_FIELDS = ("name", "kind"), ("t", "values", "positions", "velocities")


@dataclass(frozen=True, eq=False)
class Event:
    """An event at one instant of a run.

    Attributes
    ----------
    name : of the event in the scene; of the drive or force for a break
    kind : "rising" or "falling" for a crossing; "break" where a drive or a force
        continues with another piece, so that the integration restarts
    t : [s]
    values : the outputs of the result, (n outputs,)
    positions, velocities : the full state
    """

    name: str
    kind: str
    t: float
    values: Array
    positions: Array
    velocities: Array


def write_events(group: h5py.Group, events: Sequence[Event]) -> None:
    """One dataset per attribute, one row per event."""
    for key in _TEXT_FIELDS:
        texts = [getattr(event, key) for event in events]
        group.create_dataset(key, data=texts, dtype=h5py.string_dtype())
    for key in _ROW_FIELDS:
        group[key] = np.array([getattr(event, key) for event in events], float)


def read_events(group: h5py.Group | None) -> tuple[Event, ...]:
    """Inverse of `write_events`; results without events have no such group."""
    if group is None:
        return ()
    texts = [group[key].asstr()[()] for key in _TEXT_FIELDS]
    rows = [np.asarray(group[key][()], float) for key in _ROW_FIELDS]
    return tuple(
        Event(str(name), str(kind), float(t), *states)
        for name, kind, t, *states in zip(*texts, *rows, strict=True)
    )
