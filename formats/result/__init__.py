"""Results of simulations, in memory and in files."""

from .accuracy_report import (
    AccuracyReport,
    BudgetLine,
    Decision,
    Excitation,
    FlexibleBody,
    OutputError,
    has_meaningless_numbers,
)
from .data import Event, InMemory, Result, Sink
from .hdf5 import ResultFile, TableFile, read_result, units_in, write_csv, write_result

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
    "has_meaningless_numbers",
    "read_result",
    "units_in",
    "write_csv",
    "write_result",
]
