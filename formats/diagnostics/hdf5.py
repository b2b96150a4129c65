"""Diagnostics as a table in HDF5."""

import json
import math
from collections.abc import Sequence

import h5py
import numpy as np

from .record import Diagnostic, from_data

_TEXT = h5py.string_dtype()
#: Columns of the table; `data` holds values with units as JSON.
COLUMNS = np.dtype(
    [
        ("code", _TEXT),
        ("severity", _TEXT),
        ("subject", _TEXT),
        ("message", _TEXT),
        ("remedy", _TEXT),
        ("t", float),
        ("data", _TEXT),
    ]
)


def write_diagnostics(group: h5py.Group, diagnostics: Sequence[Diagnostic]) -> None:
    """Store diagnostics as the dataset `diagnostics`, one row each."""
    rows = []
    for each in diagnostics:
        record = each.as_data()
        record["code"] = each.code
        record["t"] = math.nan if each.t is None else each.t
        record["data"] = json.dumps(record["data"])
        rows.append(tuple(record[name] for name in COLUMNS.names or ()))
    table = np.array(rows, dtype=COLUMNS)
    group.create_dataset("diagnostics", data=table, dtype=COLUMNS)


def read_diagnostics(dataset: h5py.Dataset) -> tuple[Diagnostic, ...]:
    """Inverse of `write_diagnostics`.

    Raises
    ------
    TypeError, ValueError, KeyError : the dataset is no such table.
    """
    names = COLUMNS.names or ()
    if dataset.ndim != 1 or dataset.dtype.names != names:
        raise TypeError(f"{dataset.name} is not a table of diagnostics")
    found = []
    for row in dataset[:]:
        record = {name: row[name] for name in names}
        texts = {k: v.decode() for k, v in record.items() if isinstance(v, bytes)}
        record |= texts
        record["t"] = None if math.isnan(record["t"]) else float(record["t"])
        record["data"] = json.loads(record["data"])
        found.append(from_data(record))
    return tuple(found)
