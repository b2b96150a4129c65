"""By how much two runs differ, relative to how much each measure varies."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.metamorphic.generator.case import Values

#: What differences of each measure are relative to, from a run.
Sizes = Callable[[Values], dict[str, float]]

#: Equal runs differ by at most so many times the request in positions and coordinates.
WITHIN = 10.0
#: Rates and forces of them may differ by so many times more.
LOOSER = {"v": 10.0, "w": 10.0, "vq": 10.0, "f": 100.0, "m": 100.0}
#: Kinds of positions and of rotations.
LENGTHS, ANGLES = ("x", "displacement", "length"), ("angle", "angle_1", "angle_2")


def kind(measure: str) -> str:
    return measure.rsplit(".", 1)[1]


def variation(exact: Values, least: float = 1e-6) -> dict[str, float]:
    """How much each measure varies, and at least a trace of the largest of its kind."""
    own = {name: float(np.ptp(v, axis=0).max()) for name, v in exact.items()}
    traces = {what: 1e-3 * size for what, size in _largest(own).items()}
    return {
        name: max(least, traces[kind(name)], size) * LOOSER.get(kind(name), 1.0)
        for name, size in own.items()
    }


def promised(exact: Values) -> dict[str, float]:
    """What `rtol` is relative to: of positions the largest motion of all.

    A joint that comes to rest slides little, and how far depends on where it stops.
    """
    own = {name: float(np.ptp(v, axis=0).max()) for name, v in exact.items()}
    sizes = variation(exact)
    for kinds in (LENGTHS, ANGLES):
        group = [name for name in exact if kind(name) in kinds]
        largest = max((own[name] for name in group), default=0.0)
        sizes |= dict.fromkeys(group, max(1e-6, largest))
    return sizes


def magnitude(exact: Values, share: float) -> dict[str, float]:
    """A share of the largest value of all measures of the same kind."""
    largest = _largest({name: float(np.abs(v).max()) for name, v in exact.items()})
    return {name: share * max(1e-6, largest[kind(name)]) for name in exact}


def _largest(sizes: dict[str, float]) -> dict[str, float]:
    found: dict[str, float] = {}
    for name, size in sizes.items():
        found[kind(name)] = max(size, found.get(kind(name), 0.0))
    return found


def difference(
    found: Values, exact: Values, sizes: Sizes = variation, first: int = 0
) -> tuple[float, str]:
    """Largest relative difference of two runs, and in what.

    first : row of the exact one at which the other one begins
    """
    worst, where, relative = 0.0, "", sizes(exact)
    for name in found.keys() & exact.keys():
        rows = exact[name][first : first + len(found[name])]
        gap = float(np.abs(found[name] - rows).max()) / relative[name]
        if not gap <= worst:
            worst, where = gap, name
    return worst, where
