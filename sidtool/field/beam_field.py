"""The field of a beam or bar: corners of its cross-sections, which stay plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.sid_mass import skew

from ..frontends.finite_element_model import Outline
from .sampled import Sampled

Array = NDArray[np.float64]

CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)


def beam_field(outline: Outline) -> Sampled:
    """Four corners of every cross-section, which turn with it."""
    arms = (outline.halves[:, None] * CORNERS) @ outline.axes
    n = len(arms)
    turning = -skew(arms.reshape(-1, 3)).reshape(n, 4, 3, 3)

    def displacement(fields: Array) -> Array:
        motion = (outline.motion @ fields).reshape(n, 6, -1)
        own = np.einsum("ncab,nbk->ncak", turning, motion[:, 3:])
        return (motion[:, None, :3] + own).reshape(4 * n, 3, -1)

    return Sampled(
        positions=(outline.places[:, None] + arms).reshape(-1, 3),
        triangles=tube(n),
        displacement=displacement,
        transverse=np.zeros(4 * n),
    )


def tube(sections: int) -> NDArray[np.int64]:
    """Triangles of the sides and ends of a row of sections with four corners each."""
    found = [(0, 2, 1), (0, 3, 2)]
    for i in range(sections - 1):
        for c in range(4):
            a, b = 4 * i + c, 4 * i + (c + 1) % 4
            found += [(a, b, b + 4), (a, b + 4, a + 4)]
    last = 4 * (sections - 1)
    found += [(last, last + 1, last + 2), (last, last + 2, last + 3)]
    return np.array(found, np.int64)
