"""Random trees whose joints rub and whose forces obey laws of outputs.

Trees, since the load of a joint is open where others share it.
"""

from __future__ import annotations

import numpy as np

from tests.metamorphic.generator import laws
from tests.metamorphic.generator.case import Case, Table
from tests.metamorphic.generator.ingredients import Random
from tests.metamorphic.generator.loads import add_forces
from tests.metamorphic.generator.scenes import push, settled, with_measures
from tests.metamorphic.generator.sketch import Sketch

RUBS = ("revolute", "prismatic", "point_on_line")
FIXED = ("fixed",)


def rubbing_scene(seed: int) -> Case:
    """A tree of one to four bodies; even seeds are planar. One of its joints rubs at
    least, and a force obeys a law."""
    rng = np.random.default_rng([18, seed])
    sketch = Sketch(rng, planar=seed % 2 == 0)
    for _ in range(int(rng.integers(1, 5))):
        parent = str(rng.choice(list(sketch.poses)))
        kinds = FIXED if sketch.coordinates and sketch.chance(0.15) else RUBS
        sketch.add_body(parent, 0.4, kinds)
    keys = list(sketch.coordinates)
    for key in keys[1:]:
        if sketch.chance(0.2):
            sketch.drive(key)
    free = sketch.undriven()
    for k, (name, _) in enumerate(free):
        if k == 0 or sketch.chance(0.6):
            joint = sketch.table["joints"][name]
            joint["friction"] = _friction(rng, joint["type"], sketch.planar)
    add_forces(sketch)
    for _ in range(int(rng.integers(1, 3))):
        acts, reads = (free[int(rng.integers(len(free)))] for _ in range(2))
        sketch.table["forces"][sketch.name("forces")] = {
            "type": "actuator",
            "joint": acts[0],
            "coordinate": acts[1],
            "function": laws.law(rng, reads, sketch.coordinates[reads]),
        }
    for body in sketch.table["bodies"].values():
        push(rng, body["initial"], sketch.planar)
    return with_measures(settled(sketch.case()), forces=True)


def _friction(rng: Random, kind: str, planar: bool) -> Table:
    friction: Table = {"coefficient": float(rng.uniform(0.05, 0.3))}
    if rng.random() < 0.5:
        friction["static"] = 1.5 * friction["coefficient"]
        if rng.random() < 0.5:
            friction["stribeck_velocity"] = 0.1
    if rng.random() < 0.3:
        friction["viscous"] = 0.05
    if kind == "revolute":
        friction["radius"] = float(rng.uniform(0.02, 0.1))
        if not planar and rng.random() < 0.5:
            friction["length"] = 0.3
    return friction
