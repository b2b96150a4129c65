"""Forces on the coordinates of joints: what drives feel of them, and their energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.solver import simulate

from ..output.test_joint_forces import SPEEDS, driven_pair
from .test_drives import DRIVEN

ENERGIES = ("kinetic", "dissipated", "supplied", "balance")
#: The spline through three points is a parabola.
PUSH = {
    "type": "table",
    "times": [0.0, 0.25, 0.5],
    "values": [1.0, 2.0, -1.0],
    "interpolation": "smooth",
}


def forces(names: str) -> dict[str, Any]:
    """Spring, damper, friction and actuator on each coordinate."""
    found: dict[str, Any] = {}
    for name in names.split():
        at = {"joint": "joint", "coordinate": name}
        found |= {
            f"spring_{name}": {
                "type": "spring_damper",
                "rest": 0.2,
                "stiffness": [3.0, 0.0, 1.0],
                "damping": [0.3, 0.0, 0.05],
                **at,
            },
            f"rub_{name}": {"type": "friction", "force": 0.4, "speed": 0.5, **at},
            f"motor_{name}": {"type": "actuator", "function": PUSH, **at},
        }
    return found


@pytest.mark.parametrize("flexible", [False, True], ids=["rigid", "flexible"])
@pytest.mark.parametrize(("dimension", "kind", "names"), DRIVEN)
def test_a_drive_works_against_the_forces_on_its_coordinate(
    dimension: str, kind: str, names: str, flexible: bool
) -> None:
    """They change its multiplier and nothing else."""
    record = tuple(f"drive_{name}.f1" for name in names.split())
    tables = {"outputs": {"record": record}}
    pair = dimension, kind, names, flexible
    without = simulate(driven_pair(*pair, **tables), rtol=1e-10)
    system = driven_pair(*pair, **tables, forces=forces(names))
    result = simulate(system, rtol=1e-10)
    t, scale = result.t, np.abs(without.values).max()
    for k, output in enumerate(record):
        start, speed, bend = SPEEDS[k]
        x, rate = start + speed * t + bend * t**2 - 0.2, speed + 2.0 * bend * t
        expected = 3.0 * x + x**3 + 0.3 * rate + 0.05 * rate**3
        expected += 0.4 * np.tanh(rate / 0.5)
        expected -= np.polyval(np.polyfit(PUSH["times"], PUSH["values"], 2), t)
        felt = result[output] - without[output]
        assert np.abs(felt - expected).max() < 1e-7 * max(scale, 1.0)


@pytest.mark.parametrize("flexible", [False, True], ids=["rigid", "flexible"])
@pytest.mark.parametrize(
    ("dimension", "kind", "names"), [row for row in DRIVEN if row[1] != "distance"]
)
def test_forces_on_free_coordinates_keep_the_balance_of_energy(
    dimension: str, kind: str, names: str, flexible: bool
) -> None:
    tables = {
        "time": {"end": 0.5, "output_step": 0.1},
        "drives": {},
        "outputs": {"record": tuple(f"energy.{name}" for name in ENERGIES)},
        "forces": forces(names),
    }
    system = driven_pair(dimension, kind, names, flexible, **tables)
    result = simulate(system, rtol=1e-9)
    assert np.ptp(result["energy.balance"]) < 1e-7 * np.ptp(result["energy.kinetic"])
    assert result["energy.dissipated"][-1] > 1e-2
    assert abs(result["energy.supplied"][-1]) > 1e-2
