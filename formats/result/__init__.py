"""Results of simulations, in memory and in files."""

from .accuracy_report import (
    AccuracyReport,
    BudgetLine,
    Decision,
    Excitation,
    FlexibleBody,
    OutputError,
)
from .data import Result
from .events import Event
from .hdf5 import ResultFile, read_result, write_result
from .rows import InMemory, Sink
from .table import TableFile, units_in, write_csv

__all__ = [
    "AccuracyReport",
    "BudgetLine",
    "Decision",
    "Event",
    "Excitation",
    "FlexibleBody",
    "InMemory",
    "OutputError",
    "Result",
    "ResultFile",
    "Sink",
    "TableFile",
    "read_result",
    "units_in",
    "write_csv",
    "write_result",
]
