"""Results of simulations, in memory and in files."""

from __future__ import annotations

from .bodies import Excitation, FlexibleBody
from .data import Result
from .events import Event
from .hdf5 import ResultFile, read_result, write_result
from .rows import InMemory, Sink
from .table import TableFile, write_csv

__all__ = [
    "Event",
    "Excitation",
    "FlexibleBody",
    "InMemory",
    "Result",
    "ResultFile",
    "Sink",
    "TableFile",
    "read_result",
    "write_csv",
    "write_result",
]
