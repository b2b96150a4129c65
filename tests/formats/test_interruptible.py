"""Calls of machine code leave the main thread to signals."""

from __future__ import annotations

import signal
import threading
from typing import NoReturn

import pytest

from sidtool.formats.base.interruptible import call_interruptibly, is_work_left
from tests.places import posix


class EndedError(Exception):
    pass


def end(number: int, frame: object) -> NoReturn:
    raise EndedError


def test_results_and_errors_are_those_of_the_call() -> None:
    assert call_interruptibly(lambda: 3) == 3

    def fail() -> NoReturn:
        raise RuntimeError("singular")

    with pytest.raises(RuntimeError, match="singular"):
        call_interruptibly(fail)


@posix
def test_a_signal_ends_the_wait_for_a_call_that_goes_on() -> None:
    finish, threads = threading.Event(), []

    def work() -> None:
        threads.append(threading.current_thread())
        finish.wait()

    before = signal.signal(signal.SIGALRM, end)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        with pytest.raises(EndedError):
            call_interruptibly(work)
        assert threads[0] is not threading.main_thread()
        assert is_work_left()
    finally:
        signal.signal(signal.SIGALRM, before)
        finish.set()
    threads[0].join()
    assert not is_work_left()
