"""Entry point of the command ``sidtool``, before anything else is imported."""

import atexit
import gc
import os
import sys
from contextlib import suppress
from typing import NoReturn

from .formats.storage.operating_system import (
    DEFAULT,
    INTERRUPT,
    handle_signal,
    is_usual_interrupt,
    signal_handler,
)

#: Threshold of the garbage collector: a command creates little garbage, and a low
#: threshold would scan all imported objects many times.
GARBAGE_THRESHOLD = 500_000


def main() -> NoReturn:
    """Run the command line; Ctrl-C during its imports ends the program silently.

    OpenBLAS reads its number of threads when NumPy loads it. It gets one unless the
    user sets another: for the small matrices of elements and modes its threads wait
    for each other, which made `convert` take up to three times as long.
    """
    gc.set_threshold(GARBAGE_THRESHOLD)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # pydantic would look through the metadata of all installed packages
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    if is_usual_interrupt(signal_handler(INTERRUPT)):
        handle_signal(INTERRUPT, DEFAULT)
    status = list[int]()
    atexit.register(_skip_teardown, status)  # registered first, called last
    from .cli.main import main as command_line

    try:
        command_line()
    except SystemExit as end:
        if isinstance(end.code, int):
            status.append(end.code)
        raise


def _skip_teardown(status: list[int]) -> None:
    """End the process; to free all modules takes as long as half a simulation.

    Streams that take no more are left to the interpreter, which knows what to say.
    """
    with suppress(OSError, ValueError, AttributeError):
        sys.stdout.flush()
        sys.stderr.flush()
        if status:
            os._exit(status[0])
