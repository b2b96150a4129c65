"""What runs say of geometric stiffening is true, from runs with and without it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

from sidtool.formats.base.sid import SID
from sidtool.formats.geometric_stiffening import SIGNIFICANT_CHANGE, LoadStiffening
from sidtool.formats.result import Result
from sidtool.formats.sid_mass import coupled_mass_matrix
from sidtool.solver import simulate
from tests.solver.scenes import compiled, scene, soft_body

NQ, END = 3, 2.0
KINDS = ("free", "revolute", "fixed", "held")
SMALL, MAY = "stiffening small", "stiffening may matter"
BOTH = (True, False)
DOES = ("stiffening matters", "buckles")


def moved(sid: SID, seed: int, planar: bool) -> Result:
    """Particles that are thrown, hinged or clamped and pushed, more or less, or that
    vibrate in a frame at rest without any load."""
    random = np.random.default_rng([24, seed])
    size = float(10.0 ** random.uniform(-3.5, -0.7))
    n, kind = 2 if planar else 3, KINDS[seed % 4]
    speed, spin = np.sqrt(size) * random.normal(size=(2, 3))
    loads, joints = {}, {}
    initial = {"elastic_velocity": (size * random.normal(size=NQ)).tolist()}
    if kind == "free":
        initial["velocity"] = speed[:n].tolist()
        initial["angular_velocity"] = spin[2] if planar else spin.tolist()
    if kind in ("revolute", "fixed"):
        joints = {"joint": {"type": kind, "markers": ["ground.place", "soft.a"]}}
    if kind != "held":
        force = (size * random.normal(size=n)).tolist()
        push = {"type": "force", "marker": "soft.b", "force": force}
        gravity = (size * random.normal(size=n)).tolist()
        loads = {"forces": {"push": push}, "gravity": gravity}
    place = sid.node("1").position[:n].tolist()
    described = scene(
        {
            "soft": {
                "sid": "-",
                "markers": {"a": 1, "b": 2},
                "initial": initial,
                "frame": "held" if kind == "held" else "free",
                "quadratic_inertia": True,
            }
        },
        joints,
        end=END,
        steps=100,
        dimension="planar" if planar else "spatial",
        ground={"markers": {"place": {"position": place}}},
        record=["soft.q*"],
        accuracy={"rtol": 1e-8},
        **loads,
    )
    return simulate(compiled(described, soft=sid))


def judged(seed: int, planar: bool) -> tuple[LoadStiffening, float, float]:
    """What is said, how far the deformations are from those without stiffening, as a
    part of them by the root of their energy, and radians of the fastest vibration."""
    sids = [soft_body(NQ, seed, planar, stiffens, damped=False) for stiffens in BOTH]
    runs = [moved(sid, seed, planar) for sid in sids]
    found = runs[0].bodies["soft"].found
    assert found is not None
    far, size = (
        np.sqrt(np.einsum("tk,kl,tl->t", q, sids[0].Ke.m0, q).max())
        for q in (runs[1].values - runs[0].values, runs[0].values)
    )
    rows = [*((0, 1, 5) if planar else range(6)), *range(6, 6 + NQ)]
    K, M = np.pad(sids[0].Ke.m0, ((6, 0), (6, 0))), coupled_mass_matrix(sids[0])
    fastest = np.sqrt(eigh(K[np.ix_(rows, rows)], M[np.ix_(rows, rows)])[0][-1])
    return found, far / size, fastest * END


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("seed", range(8))
def test_stiffening_that_is_called_small_changes_the_motion_by_no_more(
    seed: int, planar: bool
) -> None:
    """Deformations by its shares of stiffness and inertia, and by half of that of each
    radian by which vibrations then drift out of step."""
    found, far, radians = judged(seed, planar)
    share = abs(found.ratio) + found.inertia
    assert far < share * (1.0 + 0.5 * radians)
    verdict = found.sentence()
    expected = SMALL if found.inertia < SIGNIFICANT_CHANGE else MAY
    assert verdict.startswith(
        expected if abs(found.ratio) < SIGNIFICANT_CHANGE else DOES
    )
