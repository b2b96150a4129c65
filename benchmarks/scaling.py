"""How cost grows with size."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np


def exponent(points: Iterable[tuple[float, float]], least: float, most: float) -> float:
    """Slope of log(cost) over log(size), least squares, for sizes in the range."""
    inside = [pair for pair in points if least <= pair[0] <= most]
    sizes, costs = np.log(np.array(inside)).T
    return float(np.polyfit(sizes, costs, 1)[0])
