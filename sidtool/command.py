"""Entry point of the command ``sidtool``, before anything else is imported."""

import os
from typing import NoReturn

from .formats.storage.operating_system import (
    DEFAULT,
    INTERRUPT,
    handle_signal,
    is_usual_interrupt,
    signal_handler,
)


def main() -> NoReturn:
    """Run the command line; Ctrl-C during its imports ends the program silently.

    OpenBLAS reads its number of threads when NumPy loads it. It gets one unless the
    user sets another: for the small matrices of elements and modes its threads wait
    for each other, which made `convert` take up to three times as long.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if is_usual_interrupt(signal_handler(INTERRUPT)):
        handle_signal(INTERRUPT, DEFAULT)
    from .cli.main import main as command_line

    command_line()
