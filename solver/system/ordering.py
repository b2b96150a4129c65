"""An order of the constraints that keeps the Schur complement a narrow band."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def reverse_cuthill_mckee(
    owners: Sequence[tuple[int, ...]],
    counts: Sequence[int],
    coordinates: NDArray[np.int64],
) -> tuple[list[int], int]:
    """Order of constraints and the half bandwidth of their Schur complement.

    Two constraints couple when they act on a body with coordinates of its own.

    Parameters
    ----------
    owners : bodies of each constraint
    counts : rows of each constraint
    coordinates : velocity coordinates of each body
    """
    n = len(owners)
    touching: dict[int, list[int]] = {}
    for i, pair in enumerate(owners):
        for b in set(pair):
            if coordinates[b] > 0:
                touching.setdefault(b, []).append(i)
    neighbours = [set().union(*(touching.get(b, []) for b in pair)) for pair in owners]
    order: list[int] = []
    seen: set[int] = set()
    for start in sorted(range(n), key=lambda i: (len(neighbours[i]), i)):
        if start in seen:
            continue
        queue = [start]
        seen.add(start)
        for i in queue:
            order.append(i)
            fresh = [k for k in neighbours[i] if k not in seen]
            fresh.sort(key=lambda k: (len(neighbours[k]), k))
            seen.update(fresh)
            queue.extend(fresh)
    order.reverse()
    return order, _bandwidth(order, neighbours, counts)


def _bandwidth(
    order: Sequence[int], neighbours: Sequence[set[int]], counts: Sequence[int]
) -> int:
    first = {}
    row = 0
    for i in order:
        first[i] = row
        row += counts[i]
    width = 0
    for i in order:
        for k in neighbours[i]:
            width = max(width, first[k] + counts[k] - 1 - first[i])
    return width
