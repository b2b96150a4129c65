"""One array for all real data of a compiled scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sidtool.formats.sid import Array


class Pool:
    """Collects arrays; `add` says where each begins."""

    def __init__(self) -> None:
        self._parts: list[Array] = []
        self._size = 0

    def add(self, values: ArrayLike) -> int:
        part = np.asarray(values, float).ravel()
        start = self._size
        self._parts.append(part)
        self._size += len(part)
        return start

    def array(self) -> Array:
        return np.concatenate([*self._parts, np.zeros(1)])
