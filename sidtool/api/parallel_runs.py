"""Runs in several threads: the kernels leave the lock of the interpreter to others."""

import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Event
from typing import TypeVar

Item = TypeVar("Item")
Found = TypeVar("Found")

#: Seconds after which a thread that waits for the interpreter gets it; the default of
#: 5 ms is as long as a whole run.
SWITCH_INTERVAL = 5e-5
#: Items that are begun before the first of them is taken, by thread.
ITEMS_AHEAD = 3


def map_in_threads(
    function: Callable[[Item, Event], Found], items: Iterable[Item], jobs: int
) -> Iterator[Found]:
    """Yield a function of each item, in the order of the items.

    The first item is done alone, so that the others find what is cached. Items are
    taken as they are needed, some ahead.

    Parameters
    ----------
    function : of an item and of an event that is set when the rest is not needed
    jobs : number of threads
    """
    ended, rest = Event(), iter(items)
    for first in rest:
        yield function(first, ended)
        break
    waiting: deque[Future[Found]] = deque()
    interval = sys.getswitchinterval()
    sys.setswitchinterval(min(interval, SWITCH_INTERVAL))
    pool = ThreadPoolExecutor(jobs)
    try:
        for item in rest:
            waiting.append(pool.submit(function, item, ended))
            if len(waiting) >= ITEMS_AHEAD * jobs:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        ended.set()
        pool.shutdown(cancel_futures=True)
        sys.setswitchinterval(interval)
