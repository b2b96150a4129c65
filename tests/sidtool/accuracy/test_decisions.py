"""Right decisions for a wanted accuracy, with their reasons."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import sidtool
from sidtool.formats.base.sid import SID
from sidtool.formats.scene import SceneFile
from sidtool.measurement import cache
from sidtool.measurement.runs import OutsideTheory
from tests.bodies import Cloud

from .arms import cantilever, spun, swinging


@pytest.fixture(autouse=True)
def _own_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path)


def ring() -> SID:
    """A ring of mass and radius one that breathes at 20 rad/s."""
    turns = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    c = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(12)])
    masses, phi = np.full(12, 1.0 / 12.0), c[:, :, None].copy()
    cloud = Cloud(masses, c, phi, np.zeros_like(phi))
    return cloud.sid(np.array([[400.0]]), np.zeros((1, 1)), 2)


@pytest.mark.parametrize(("speed", "kept"), [(3.0, True), (0.3, False)])
def test_a_disc_that_spins_fast_needs_quadratic_inertia(
    speed: float, kept: bool
) -> None:
    """(1 + q)^2 times the spin is constant: its square is what the term adds."""
    scene = SceneFile.model_validate(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "planar",
            "time": {"end": 2.0, "output_step": 0.05},
            "bodies": {"arm": {"sid": "arm", "initial": {"angular_velocity": speed}}},
            "outputs": {"record": ["arm.angle"]},
        }
    )
    result = sidtool.simulate(scene, sids={"arm": ring()}, accuracy=1e-4)
    decision = next(
        d for d in result.accuracy.decisions if d.what == "quadratic inertia"
    )
    assert decision.kept is kept

    def rates(_: float, state: np.ndarray) -> list[float]:
        _, q, v = state
        spin = speed / (1.0 + q) ** 2
        return [spin, v, (1.0 + q) * spin**2 - 400.0 * q]

    start = [0.0, 0.0, 0.0]
    exact = solve_ivp(rates, (0.0, 2.0), start, t_eval=result.t, rtol=1e-10, atol=1e-12)
    error = np.abs(result["arm.angle"] - exact.y[0]).max() / np.ptp(exact.y[0])
    assert error <= result.error["arm.angle"] <= 1e-4


@pytest.mark.parametrize(("speed", "kept"), [(1.8, True), (0.05, False)])
def test_in_space_fast_spin_needs_stiffening_and_slow_spin_does_not(
    speed: float, kept: bool
) -> None:
    """About an axis askew to the arm, so that it sweeps a cone."""
    axis = {"axis": [0.2, 0.0, 1.0]}
    hub = {"type": "revolute", "markers": ["ground", "arm.root"], **axis}
    scene = spun(
        speed,
        20.0,
        dimension="spatial",
        joints={"hub": hub},
        outputs={"record": ["arm.tip.uy"]},
    )
    sid = cantilever(2, stiffened=True)
    result = sidtool.simulate(scene, sids={"arm": sid}, accuracy=2e-2)
    decision = next(
        d for d in result.accuracy.decisions if d.what == "geometric stiffening"
    )
    assert decision.kept is kept
    exact = sidtool.simulate(scene, sids={"arm": sid}, rtol=1e-9)["arm.tip.uy"]
    error = np.abs(result["arm.tip.uy"] - exact).max() / np.ptp(exact)
    assert error <= 2e-2


def test_a_cantilever_bent_by_a_quarter_of_its_length_is_refused() -> None:
    """A tip force of 3 EI / 4 L^2 leaves linear theory; the report names a remedy."""
    ramp = {"type": "sine_ramp", "from": 0.0, "to": 30.0, "end": 1.0}
    push = {"type": "force", "marker": "arm.tip", "force": [0.0, 0.75]}
    scene = swinging(
        32.0,
        gravity=None,
        joints={"clamp": {"type": "fixed", "markers": ["ground", "arm.root"]}},
        forces={"push": push | {"function": ramp}},
        outputs={"record": ["arm.tip.uy"]},
    )
    with pytest.raises(OutsideTheory) as refused:
        sidtool.simulate(scene, sids={"arm": cantilever(3)}, accuracy=1e-2)
    text = str(refused.value)
    assert "N411 arm" in text
    assert "cut into 3 or more" in text and "joints of type fixed" in text
