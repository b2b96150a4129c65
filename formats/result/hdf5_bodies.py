"""Flexible bodies of a run as groups in HDF5."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import h5py
import numpy as np

from ..stiffening import Stiffening
from ..storage.hdf5_data import put_texts, read_texts
from .bodies import Excitation, FlexibleBody

_PARTS = {"excitation": Excitation, "expected": Stiffening, "found": Stiffening}


def write_bodies(group: h5py.Group, bodies: Mapping[str, FlexibleBody]) -> None:
    """One subgroup per body: its lists are datasets, its other entries attributes."""
    for name, body in bodies.items():
        place = group.create_group(name)
        for key, value in _entries(body).items():
            if isinstance(value, tuple):
                put_texts(place, key, value)
            elif isinstance(value, np.ndarray):
                place[key] = value
            else:
                place.attrs[key] = value


def read_bodies(group: h5py.Group | None) -> dict[str, FlexibleBody]:
    """Inverse of `write_bodies`.

    Files of before have no such group, or their lists as attributes.
    """
    if group is None:
        return {}
    return {name: _body(_stored(place)) for name, place in group.items()}


def _stored(place: h5py.Group) -> dict[str, Any]:
    lists = {
        key: dataset[()] if dataset.dtype.kind == "f" else read_texts(dataset)
        for key, dataset in place.items()
    }
    return dict(place.attrs) | lists


def _entries(body: FlexibleBody) -> dict[str, Any]:
    """Numbers, texts and arrays; those of parts as PART.NAME."""
    found: dict[str, Any] = {}
    for entry in fields(body):
        value = getattr(body, entry.name)
        if entry.name not in _PARTS:
            found[entry.name] = value
        elif value is not None:
            for part in fields(value):
                told = getattr(value, part.name)
                if told is not None:
                    found[f"{entry.name}.{part.name}"] = told
    return found


def _body(entries: dict[str, Any]) -> FlexibleBody:
    """What parts had in earlier versions, and have no longer, is skipped."""
    parts: dict[str, Any] = {}
    for key, value in entries.items():
        part, dot, name = key.partition(".")
        if dot:
            parts.setdefault(part, {})[name] = _plain(value)
        else:
            parts[key] = _plain(value)
    for name, kind in _PARTS.items():
        if name in parts:
            known = {entry.name for entry in fields(kind)}
            parts[name] = kind(**{k: v for k, v in parts[name].items() if k in known})
    return FlexibleBody(**parts)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return tuple(value.tolist()) if value.dtype.kind == "O" else value
    return value.item() if isinstance(value, np.generic) else value
