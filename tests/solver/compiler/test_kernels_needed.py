"""Runs compile the kernels of energies and momenta only where outputs ask for them."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from sidtool.solver import compile_scene, simulate
from sidtool.solver.output import samples
from sidtool.solver.output.samples import needs_body_quantities
from tests.solver.scenes import scene, slender_rod

ASKED = ["energy.kinetic", "energy.balance", "momentum.x", "rod.momentum_x"]
OTHERS = ["rod.x", "pin.fx", "rod.b.vx", "constraint.position", "pin.angle"]


@pytest.mark.parametrize("output", ASKED + OTHERS)
def test_what_is_compiled_is_what_is_called(
    output: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    called = []
    kernels = samples.kernels

    def counted(*arrays: object) -> None:
        called.append(output)
        kernels.write_bodies_in_plane(*arrays)

    replaced = SimpleNamespace(**vars(kernels) | {"write_bodies_in_plane": counted})
    monkeypatch.setattr(samples, "kernels", replaced)
    pin = {"type": "revolute", "markers": ["ground", "rod.a"]}
    pendulum = scene({"rod": slender_rod(1.0)}, {"pin": pin}, record=[output])
    simulate(compile_scene(pendulum))
    assert bool(called) == needs_body_quantities(pendulum) == (output in ASKED)
