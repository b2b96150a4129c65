"""Results of simulations, in memory and in files."""

from __future__ import annotations

from .bodies import Excitation, FlexibleBody
from .data import Result
from .events import Event
from .hdf5 import read_result, write_result
from .table import write_csv

__all__ = [
    "Event",
    "Excitation",
    "FlexibleBody",
    "Result",
    "read_result",
    "write_csv",
    "write_result",
]
