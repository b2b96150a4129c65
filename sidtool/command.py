"""The command ``sidtool``, before anything else is imported."""

from __future__ import annotations

import os
import signal
from typing import NoReturn


def main() -> NoReturn:
    """Has Ctrl-C end the program without a word while it imports what it needs.

    OpenBLAS reads its number of threads when NumPy loads it. It gets one unless the
    user says otherwise: for the small matrices of elements and modes its threads wait
    for each other, which made `convert` take up to three times as long.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .cli import main as command_line

    command_line()
