"""Flexible bodies in frames at another of their nodes.

Without displacements of second order two frames describe the same body to first order
in its elastic coordinates. So what holds in every frame are the accelerations and
forces of an undeformed body, however it moves; and the motions of small loads, whose
differences between frames are of second order in the loads.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np

from sidtool.conversion.frame_change import apply_frame_change, frame_change
from sidtool.formats.scene import as_3d
from tests.metamorphic.generator.case import Case, Values, run
from tests.metamorphic.generator.differences import difference, magnitude
from tests.metamorphic.generator.ingredients import Random
from tests.metamorphic.generator.poses import Pose, replaced
from tests.metamorphic.generator.said import (
    Said,
    as_spin,
    components,
    copied,
    kind,
    owner,
    spin,
    with_table,
)
from tests.metamorphic.generator.scenes import at_instant, settled
from tests.metamorphic.ways import damping
from tests.metamorphic.ways.small_motions import LEFT, in_small_motion, is_deformed

#: Shares of the elastic rates at two starts; one instant may differ by so small a part
#: of what two runs may.
RATES, SHARP = (1e-3, 1e-4), 1e-3
#: Each leaves 1e-4 or less of the elastic rates that joints make of other velocities.
SETTLINGS = 2


def at_the_start(case: Case, rng: Random) -> Said | None:
    """Accelerations and forces at the start, where no body is deformed.

    Elastic rates are slow: of second order in them the accelerations differ.
    """
    if not case.sids or is_deformed(case):
        return None
    case = damping.as_matrices(case)
    measures = [f"{name}.a" for name in case.table["bodies"] if name not in case.sids]
    for name, body in case.table["bodies"].items():
        measures += [f"{name}.{marker}.a" for marker in body["markers"]]
    for name, joint in case.table["joints"].items():
        if "markers" in joint:
            measures += [f"{name}.f", f"{name}.m"]
    seen = replace(case, measures=tuple(measures))
    bases = slowed(seen, RATES)
    seed = int(rng.integers(1 << 30))
    others = [elsewhere(base, np.random.default_rng(seed)) for base in bases]
    sizes = partial(magnitude, share=SHARP)

    def slack(exact: Values) -> float:
        large = [run(case) for case in (others[0], bases[0])]
        return (
            LEFT
            * RATES[1]
            / RATES[0]
            * difference(first(large[0]), first(large[1]), sizes)[0]
        )

    def first(values: Values) -> Values:
        return {name: value[:1] for name, value in values.items()}

    return Said(others[1], first, slack, base=bases[1], sizes=sizes)


def slowed(case: Case, rates: Iterable[float]) -> list[Case]:
    """Starts with these shares of the elastic rates, all rates between which are met.

    Velocities that meet joints and drives are affine. A body that joints hold but for
    its deformation cannot move without elastic rates: without them it is at rest.
    """
    still = case
    for _ in range(SETTLINGS):
        table = copied(still)
        for name, sid in case.sids.items():
            table["bodies"][name]["initial"]["elastic_velocity"] = [0.0] * sid.nq
        still = settled(with_table(still, table))
    return [at_instant(_between(still, case, rate)) for rate in rates]


def _between(still: Case, moving: Case, share: float) -> Case:
    """The first case with a share of what the velocities of the second one are more."""
    table = copied(still)
    for name, body in table["bodies"].items():
        other = moving.body(name)["initial"]
        for key in ("velocity", "angular_velocity", "elastic_velocity"):
            if key in other:
                own = np.array(body["initial"][key])
                new = own + share * (np.array(other[key]) - own)
                body["initial"][key] = new.tolist()
    return with_table(still, table)


def small_motion(case: Case, rng: Random) -> Said | None:
    """The motion under a ten-thousandth of all loads and speeds."""
    flexible = set(case.sids)

    def dropped(name: str) -> bool:
        own = ("x", "v", "w", "angle")
        return owner(name) in flexible and name.count(".") == 1 and kind(name) in own

    return in_small_motion(damping.as_matrices(case), rng, elsewhere, dropped)


def elsewhere(case: Case, rng: Random) -> Case:
    """The case with its flexible bodies in frames at another of their nodes."""
    table, sids, planar = copied(case), {}, case.planar
    for name, sid in case.sids.items():
        frame = str(rng.choice(["tangent:2", "tangent:3", "buckens", "buckens:4"]))
        change = frame_change(sid, frame)
        sids[name] = apply_frame_change(sid, change)
        initial = table["bodies"][name]["initial"]
        pose, rates = Pose.of(initial), np.array(initial["elastic_velocity"])
        new = pose.then(Pose(change.origin, np.eye(3)))
        w = as_spin(initial["angular_velocity"])
        v = as_3d(initial["velocity"]) + np.cross(w, pose.R @ change.origin)
        v = v + pose.R @ (rates @ change.at(change.origin))
        w = w + pose.R @ (rates @ change.turn)
        table["bodies"][name]["initial"] = replaced(initial, new, planar) | {
            "velocity": components(v, planar),
            "angular_velocity": spin(w, planar),
        }
    return with_table(case, table, sids=sids)
