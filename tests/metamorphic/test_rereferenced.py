"""What two frames of a flexible body disagree on is of second order in its rates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.metamorphic.generator.case import run
from tests.metamorphic.generator.differences import difference
from tests.metamorphic.generator.scenes import random_scene
from tests.metamorphic.ways import damping
from tests.metamorphic.ways.rereferenced import elsewhere, slowed


def test_undeformed_bodies_accelerate_the_same_in_every_frame() -> None:
    """A hundredth of the difference is left under a tenth of the elastic rates.

    The joints of this scene hold its body but for the deformation, so that every
    velocity is one of elastic rates.
    """
    seed = 460
    case = damping.as_matrices(random_scene(seed))
    markers = [
        f"{name}.{marker}.a"
        for name, body in case.table["bodies"].items()
        for marker in body["markers"]
    ]
    seen = replace(case, measures=tuple(markers))

    def gap(rate: float) -> float:
        (base,) = slowed(seen, [rate])
        other = elsewhere(base, np.random.default_rng(seed))
        found, exact = ({m: v[:1] for m, v in run(c).items()} for c in (other, base))
        return difference(found, exact, lambda values: dict.fromkeys(values, 1.0))[0]

    coarse, fine = gap(1e-2), gap(1e-3)
    assert coarse > 1e-7
    assert 80.0 < coarse / fine < 125.0
