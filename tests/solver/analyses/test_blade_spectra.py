"""Campbell diagram of a three-bladed turbine against spectra of its motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import hankel

import sidtool
from sidtool.formats.base.sid import Array

#: [rad/s]; at the second one a mode of the blades has slowed down to the tower.
SPEEDS = (12.0, 18.0)
#: Of the samples [s].
STEP, ROWS = 0.013, 300
#: A push on the tower and on one blade.
PUSH = {
    "bodies.tower.initial": {"elastic_velocity": [1e-4, 1e-4]},
    "bodies.blade0.initial.elastic_velocity": [1e-4, -1e-4],
}
ALUMINIUM = {"youngs_modulus": 7e10, "poissons_ratio": 0.3, "density": 2700.0}


def column(length: float, height: float, width: float) -> sidtool.SID:
    """A clamped beam along z with its first mode along x and along y."""
    section = {"shape": "rectangle", "height": height, "width": width}
    return sidtool.convert(
        sidtool.Model(
            material=ALUMINIUM,
            geometry={
                "type": "beam",
                "start": [0.0, 0.0, 0.0],
                "end": [0.0, 0.0, length],
                "y_axis": [1.0, 0.0, 0.0],
                "section": section,
            },
            discretisation={"type": "beam", "elements": 6},
            frame={"type": "tangent", "marker": "root", "clamp": "start"},
            markers={
                "root": {"node": 1, "edge": "start"},
                "tip": {"node": 2, "edge": "end"},
            },
            reduction={"method": "modal", "modes": 2},
            damping={"type": "rayleigh", "beta": 2e-4},
            stiffening={},
            diagnostics={"ignore": ["N161"]},
        )
    )


@pytest.fixture(scope="module")
def turbine() -> sidtool.Scene:
    """Blades that bend along and across the axis, on a tower that bends in both
    directions."""
    tower, blade = column(4.0, 0.08, 0.06), column(1.5, 0.012, 0.05)
    turning = {"angular_velocity": ["speed", 0.0, 0.0]}
    hub: dict[str, Any] = {"mass": 2.0, "inertia": [0.02, 0.01, 0.01], "markers": {}}
    bodies: dict[str, Any] = {
        "tower": {"sid": tower, "markers": {"base": 1, "top": 2}},
        "nacelle": {
            "mass": 6.0,
            "inertia": [0.2, 0.3, 0.25],
            "markers": {"bearing": {"position": [-0.3, 0.0, 0.1]}},
            "initial": {"position": [0.0, 0.0, 4.0]},
        },
        "hub": hub | {"initial": turning | {"position": [-0.3, 0.0, 4.1]}},
    }
    joints: dict[str, Any] = {
        "foundation": {"type": "fixed", "markers": ["ground", "tower.base"]},
        "yaw": {"type": "fixed", "markers": ["tower.top", "nacelle"]},
        "shaft": {
            "type": "revolute",
            "axis": [1.0, 0.0, 0.0],
            "markers": ["nacelle.bearing", "hub"],
        },
    }
    for k in range(3):
        angle = 2 * np.pi * k / 3
        y, z = -0.1 * float(np.sin(angle)), 0.1 * float(np.cos(angle))
        turn = {"axis_angle": [angle, 0.0, 0.0]}
        hub["markers"][f"root{k}"] = {"position": [0.0, y, z]} | turn
        start = {"position": [-0.3, y, 4.1 + z]} | turn | turning
        start |= {"velocity": [0.0, f"{-z} * speed", f"{y} * speed"]}
        markers = {"root": 1, "tip": 2}
        bodies[f"blade{k}"] = {"sid": blade, "markers": markers, "initial": start}
        ends = [f"hub.root{k}", f"blade{k}.root"]
        joints[f"root{k}"] = {"type": "fixed", "markers": ends}
    motion = {"type": "constant", "value": "speed"}
    return sidtool.Scene(
        dimension="spatial",
        parameters={"speed": 0.0},
        time={"end": STEP * ROWS, "output_step": STEP},
        bodies=bodies,
        joints=joints,
        drives={"generator": {"joint": "shaft", "of": "rate", "function": motion}},
        outputs={"record": ["tower.q*", "blade*.q*"]},
        accuracy={"rtol": 1e-10},
    )


def exponentials(signals: Array, count: int) -> tuple[Array, Array]:
    """Exponents [1/s] and amplitudes (signals, count) of sampled signals (ESPRIT)."""
    half = signals.shape[1] // 2
    data = np.hstack([hankel(s[:half], s[half - 1 :]) for s in signals])
    space = np.linalg.svd(data, full_matrices=False)[0][:, :count]
    factors = np.linalg.eigvals(np.linalg.lstsq(space[:-1], space[1:])[0])
    waves = factors ** np.arange(signals.shape[1])[:, None]
    return np.log(factors) / STEP, np.linalg.lstsq(waves, signals.T)[0].T


@pytest.fixture(scope="module")
def diagram(turbine: sidtool.Scene) -> sidtool.CampbellDiagram:
    return sidtool.campbell(turbine, {"parameters.speed": SPEEDS}, orders=())


@pytest.mark.parametrize("n", range(len(SPEEDS)))
def test_spectra_of_tower_and_blades_have_the_frequencies_of_the_diagram(
    turbine: sidtool.Scene, diagram: sidtool.CampbellDiagram, n: int
) -> None:
    """A tower has the inertial frequencies alone. The gauge of a blade has the rotating
    ones. The pattern of all blades goes around in the direction of the whirl."""
    speed = SPEEDS[n]
    scene = turbine.with_({"parameters.speed": speed} | PUSH)
    motion = sidtool.simulate(scene, integrator="dop853")
    blades = np.array(
        [[motion[f"blade{k}.q{j}"] for k in range(3)] for j in (1, 2)], complex
    )
    azimuths = speed * motion.t + 2 * np.pi * np.arange(3)[:, None] / 3
    inertial = 2 * np.pi * diagram.inertial_frequencies[n]
    rotating = 2 * np.pi * diagram.rotating_frequencies[n]
    modes = len(inertial)

    found, _ = exponentials(
        np.array([motion["tower.q1"], motion["tower.q2"]]), 2 * modes
    )
    assert_allclose(np.sort(found.imag)[modes:], np.sort(inertial), rtol=1e-6)

    whirl = diagram.whirl[n]
    assert {*whirl} == {"forward", "backward", ""}
    pattern = (blades * np.exp(1j * azimuths)).sum(axis=1)
    found, amplitudes = exponentials(pattern, 2 * modes)
    size = np.linalg.norm(amplitudes, axis=0)
    gauge, _ = exponentials(blades[:, 0], 6 * modes)
    for k in np.flatnonzero(whirl != ""):
        forward, backward = (
            size[np.abs(found.imag - sign * inertial[k]).argmin()] for sign in (1, -1)
        )
        assert (forward > backward) == (whirl[k] == "forward")
        assert np.abs(gauge.imag - rotating[k]).min() < 2e-5 * rotating[k]
        sign = -1 if whirl[k] == "forward" else 1
        seen = abs(inertial[k] + sign * speed)
        assert rotating[k] == pytest.approx(seen, rel=1e-9)
