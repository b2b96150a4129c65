"""Flexible machines move as in Exudyn, which has its own equations of a SID."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from benchmarks.flexible_machines import Machine, arm, satellite
from benchmarks.peers.exudyn_scene import ExudynSettings, run
from sidtool.solver import simulate


@pytest.mark.needs("exudyn")
@pytest.mark.parametrize("make", [arm, satellite])
def test_exudyn_converges_to_the_motion_of_sidtool(
    make: Callable[[], Machine],
) -> None:
    """The limit of Exudyn's steps h and h/2, whose errors fall nearly fourfold."""
    machine = make()
    scene = machine.tables(quadratic_inertia=True)
    result = simulate(machine.system(quadratic_inertia=True), rtol=1e-7)
    every = scene.time.output_step
    coarse, fine = (
        run(scene, machine.sids, ExudynSettings(every / count, 1e-8, False))[0]
        for count in (8, 16)
    )
    for name in scene.outputs.record:
        size = max(abs(result[name]))
        errors = [max(abs(one[name] - result[name])) / size for one in (coarse, fine)]
        limit = (4.0 * fine[name] - coarse[name]) / 3.0
        assert errors[1] < 0.35 * errors[0]
        assert max(abs(limit - result[name])) <= 1e-5 * size
