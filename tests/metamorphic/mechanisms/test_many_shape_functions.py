"""A rod with many shape functions, said in natural modes and in a mixture of them.

Natural modes leave Newton's matrices nearly diagonal, which is made use of; a mixture
of them is solved in full. The motion is one.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.solver import compile_scene, simulate
from tests.metamorphic.ways.sids import mixed
from tests.places import SLIDER_CRANK
from tests.steel_bars import slender_bar

MODES = 24


@cache
def rod() -> SID:
    return slender_bar(MODES, "tangent:1", stiffened=False)


def motion(sid: SID, integrator: str, rtol: float, end: float) -> tuple[Array, Array]:
    """Of the piston and of the elastic coordinates, while the crank starts."""
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    table = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    table["time"] = {"end": end, "output_step": end / 6}
    table["bodies"]["rod"]["damping"] = {
        "type": "rayleigh",
        "alpha": 3.0,
        "beta": 2e-5,
    }
    table["outputs"] = {"record": ["piston.x", "rod.q*"]}
    system = compile_scene(SceneFile.model_validate(table), SLIDER_CRANK, {"rod": sid})
    result = simulate(system, integrator=integrator, rtol=rtol)
    q = [result[f"rod.q{k}"] for k in range(1, MODES + 1)]
    return result["piston.x"], np.column_stack(q)


@pytest.mark.parametrize(
    "integrator, rtol, end, same",
    [("radau9", 1e-8, 0.2, 1e-6), ("generalised_alpha", 1e-3, 0.01, 1e-2)],
)
def test_a_mixture_of_modes_moves_like_the_modes(
    integrator: str, rtol: float, end: float, same: float
) -> None:
    T = np.eye(MODES) + 0.1 * np.random.default_rng(7).normal(size=(MODES, MODES))
    x, q = motion(rod(), integrator, rtol, end)
    mixed_x, mixed_q = motion(mixed(rod(), T), integrator, rtol, end)
    assert mixed_x == pytest.approx(x, abs=same * abs(q).max())
    assert mixed_q @ T.T == pytest.approx(q, abs=same * abs(q).max())
