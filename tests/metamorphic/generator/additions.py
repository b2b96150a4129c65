"""More parts of random scenes: couplings, drives of markers, dampings, shafts, and
bodies that are deformed at the start.

Each has random numbers of its own, so that the rest of a scene does not depend on them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.metamorphic.generator.case import Table
from tests.metamorphic.generator.ingredients import NODES, function, second_order, unit
from tests.metamorphic.generator.poses import Pose, turned
from tests.metamorphic.generator.sketch import END, Sketch

#: Share of the scenes that have each of these.
SHARE = 0.25


def add_more(sketch: Sketch, seed: int) -> None:
    for number, add in enumerate(
        (_coupling, _marker_drive, _dampings, _shaft, _stiffened)
    ):
        sketch.rng = np.random.default_rng([16, seed, number])
        if sketch.chance(SHARE):
            add(sketch)


def deformed(sketch: Sketch, seed: int) -> bool:
    """Gives all flexible bodies elastic coordinates and rates, in some scenes."""
    rng = np.random.default_rng([17, seed])
    for name, sid in sketch.sids.items():
        initial = sketch.table["bodies"][name]["initial"]
        initial["elastic_velocity"] = (0.3 * rng.normal(size=sid.nq)).tolist()
    if not sketch.sids or rng.random() > SHARE:
        return False
    for name, sid in sketch.sids.items():
        elastic = (0.03 * rng.normal(size=sid.nq)).tolist()
        sketch.table["bodies"][name]["initial"]["elastic"] = elastic
    return True


def _unless_implied(sketch: Sketch, part: str, entry: Table) -> None:
    label = sketch.name(part)
    sketch.table[part][label] = entry
    if not sketch.independent():
        del sketch.table[part][label]


def _coupling(sketch: Sketch) -> None:
    """A sum of the coordinates of two or three joints."""
    rng, free = sketch.rng, [k for k in sketch.undriven() if k[1] != "length"]
    keys = list({name: (name, c) for name, c in free}.values())
    if len(keys) < 2:
        return
    count = min(len(keys), int(rng.integers(2, 4)))
    chosen = [keys[k] for k in rng.choice(len(keys), count, replace=False)]
    weights = rng.choice([-2.0, -1.0, 1.0, 2.0], count)
    coordinates = np.array([sketch.coordinates[key] for key in chosen])
    coupling = {
        "type": "coupling",
        "joints": [name for name, _ in chosen],
        "coordinate": [c for _, c in chosen],
        "weights": weights.tolist(),
        "offset": float(weights @ coordinates),
    }
    _unless_implied(sketch, "joints", coupling)


def _marker_drive(sketch: Sketch) -> None:
    """A coordinate of a marker, seen from another one."""
    rng, planar = sketch.rng, sketch.planar
    name = str(rng.choice(list(sketch.table["bodies"])))
    other = str(rng.choice([n for n in sketch.poses if n != name]))
    first, there = sketch.marker(other)
    seen = sketch.poses[other].then(there)
    drive: Table = {"reference": first}
    if name not in sketch.sids and not planar and sketch.chance(0.4):
        axis, angle = unit(rng), float(rng.uniform(-0.7, 0.7))
        place = seen.then(Pose(rng.uniform(-0.3, 0.3, 3), turned(axis, angle)))
        second, _ = sketch.marker(name, sketch.poses[name].inverse.then(place))
        drive |= {"marker": second, "coordinate": "rotation", "axis": axis.tolist()}
        start = angle
    else:
        second, mine = sketch.marker(name)
        place = seen.inverse.then(sketch.poses[name].then(mine))
        coordinate = str(rng.choice(["x", "y", "angle" if planar else "z"]))
        start = sketch.angle(second) - sketch.angle(first)
        if coordinate != "angle":
            start = float(place.x["xyz".index(coordinate)])
        drive |= {"marker": second, "coordinate": coordinate}
    drive["function"] = function(rng, start, 0.2, END)
    _unless_implied(sketch, "drives", drive)


def _dampings(sketch: Sketch) -> None:
    """Damping of flexible bodies in place of what their SIDs hold."""
    rng = sketch.rng
    kinds: list[Callable[[int], Table]] = [
        lambda nq: {"type": "rayleigh", "alpha": 0.8, "beta": 4e-4},
        lambda nq: {"type": "modal", "ratio": rng.uniform(0.0, 0.1, nq).tolist()},
        lambda nq: {"type": "modal", "ratio": 0.03},
        lambda nq: {"type": "frequency"},
    ]
    for name, sid in sketch.sids.items():
        kind = kinds[int(rng.integers(len(kinds)))]
        sketch.table["bodies"][name]["damping"] = kind(sid.nq)


def _shaft(sketch: Sketch) -> None:
    """A bushing that lets its second marker turn without limit."""
    rigid = [n for n in sketch.table["bodies"] if n not in sketch.sids]
    if sketch.planar or not rigid:
        return
    rng, name = sketch.rng, str(sketch.rng.choice(rigid))
    owner = str(rng.choice([n for n in sketch.poses if n != name]))
    first, there = sketch.marker(owner)
    shaft = int(rng.integers(3))
    turn = turned(np.eye(3)[shaft], float(rng.uniform(-3.0, 3.0)))
    away = Pose(0.05 * rng.normal(size=3), turned(unit(rng), 0.3) @ turn)
    place = sketch.poses[owner].then(there).then(away)
    second, _ = sketch.marker(name, sketch.poses[name].inverse.then(place))
    # the angle about a shaft has no meaning once that is tilted by a right angle
    about = np.arange(3) == shaft
    sketch.table["forces"][sketch.name("forces")] = {
        "type": "bushing",
        "markers": [first, second],
        "stiffness": [60.0, 80.0, 50.0, *np.where(about, 3.0, 60.0).tolist()],
        "damping": [1.0, 2.0, 1.0, *np.where(about, 0.0, 1.0).tolist()],
        "shaft": "xyz"[shaft],
    }


def _stiffened(sketch: Sketch) -> None:
    """Displacements of second order: what bends becomes shorter, what turns bends."""
    for name, cloud in sketch.clouds.items():
        sid = sketch.sids[name]
        found = second_order(cloud, sketch.rng, sketch.planar)
        sketch.clouds[name] = found
        sketch.sids[name] = found.sid(sid.Ke.m0, sid.De.m0, NODES)
