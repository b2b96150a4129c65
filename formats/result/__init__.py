"""Results of simulations, in memory and in files."""

from .accuracy_report import (
    AccuracyReport as AccuracyReport,
    BudgetLine as BudgetLine,
    Decision as Decision,
    Excitation as Excitation,
    FlexibleBody as FlexibleBody,
    OutputError as OutputError,
    has_meaningless_numbers as has_meaningless_numbers,
)
from .data import Event as Event, InMemory as InMemory, Result as Result, Sink as Sink
from .hdf5 import (
    ResultFile as ResultFile,
    TableFile as TableFile,
    read_result as read_result,
    units_in as units_in,
    write_csv as write_csv,
    write_result as write_result,
)
