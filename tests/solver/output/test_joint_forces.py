"""Force and torque of every joint and drive: what changes the momenta of a body.

Nothing else acts on the second body of a free pair, so that the rates of its linear
and angular momentum are the force at its marker, and the torque with its moment.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.solver import compile_scene, simulate
from sidtool.solver.output.reactions import COMPONENTS
from sidtool.solver.system.joints import PLANAR, SPATIAL

from ..dynamics.joint_scenes import evaluated, marker, momenta, pair
from ..dynamics.test_drives import DRIVEN

#: Five output times, and the weights of the fourth-order difference over them.
TIMES = tuple((0.1 + 2e-3 * np.arange(-2, 3)).tolist())
WEIGHTS = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * 2e-3)
FREE = [("planar", kind, "") for kind in PLANAR]
FREE += [("spatial", kind, "") for kind in SPATIAL]
SPEEDS = ((1.0, 0.7, 2.0), (0.5, -0.4, 1.0))


def driven_pair(
    dimension: str, kind: str, names: str, flexible: bool, **tables: Any
) -> Any:
    """Two bodies and a joint whose coordinates of these names are driven."""
    content, sids = pair(dimension, {"type": kind}, flexible)
    drives = {
        f"drive_{name}": {
            "joint": "joint",
            "coordinate": name,
            "function": {
                "type": "polynomial",
                "pieces": [{"from": 0.0, "coefficients": SPEEDS[k]}],
            },
        }
        for k, name in enumerate(names.split())
    }
    owners = ("joint", *drives)
    outputs = {"record": tuple(f"{o}.{c}" for o in owners for c in COMPONENTS)}
    data = content.model_dump(by_alias=True, exclude_none=True)
    data["time"] = {"end": 0.2, "output_times": TIMES}
    data |= {"drives": drives, "outputs": outputs, **tables}
    return compile_scene(type(content).model_validate(data), sids=sids)


@pytest.mark.parametrize("flexible", [False, True], ids=["rigid", "flexible"])
@pytest.mark.parametrize(("dimension", "kind", "names"), FREE + DRIVEN)
def test_joints_and_drives_act_as_the_momenta_of_a_body_tell(
    dimension: str, kind: str, names: str, flexible: bool
) -> None:
    system = driven_pair(dimension, kind, names, flexible)
    result = simulate(system, rtol=1e-11)
    body, history, places = system.index("right"), [], []
    for t, z, v in zip(result.t, result.positions, result.velocities, strict=True):
        work = evaluated(system, t, z, v)
        history.append(momenta(system, work, body, v))
        places.append(marker(system, work, ("right", "end"))[0])
    rates = WEIGHTS @ np.array(history)
    wrench = result.values[2].reshape(-1, 6).sum(axis=0)
    moment = wrench[3:] + np.cross(places[2], wrench[:3])
    error = np.concatenate([wrench[:3], moment]) - rates
    assert np.abs(error).max() < 1e-6 * np.abs(rates).max()
    assert np.abs(rates).max() > 1e-2
