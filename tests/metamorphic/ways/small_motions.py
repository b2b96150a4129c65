"""The same small motion said in two ways that agree to first order in the loads."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from tests.metamorphic.generator import functions
from tests.metamorphic.generator.case import Case, Table, Values, run
from tests.metamorphic.generator.differences import difference, variation
from tests.metamorphic.generator.ingredients import Random
from tests.metamorphic.generator.said import Said, copied, with_table, without

#: Loads of the two small motions, relative to those of the scene, and their request.
LOADS, RTOL = (1e-3, 1e-4), 1e-8
#: More than a tenth of a relative difference is not left under a tenth of the load, but
#: for what has not yet grown with the larger one: a vibration may be back in phase.
LEFT = 0.3
#: Variation of what hardly moves: numbers of size one are rounded at 1e-8 of it.
LEAST = 1e-8


def in_small_motion(
    case: Case,
    rng: Random,
    say: Callable[[Case, Random], Case],
    dropped: Callable[[str], bool] = lambda name: False,
) -> Said | None:
    """The motion under a ten-thousandth of all loads and speeds.

    say : says a case differently; what it does at random is the same for all loads
    dropped : measures that differ
    """
    if not case.sids or is_deformed(case) or rubs(case):
        return None
    bases = [small(case, load) for load in LOADS]
    seed = int(rng.integers(1 << 30))
    others = [say(base, np.random.default_rng(seed)) for base in bases]
    sizes = partial(variation, least=LEAST)

    def back(values: Values) -> Values:
        # energies are quadratic
        return without(values, lambda n: n.startswith("energy.") or dropped(n))

    def slack(exact: Values) -> float:
        large = [run(case, rtol=RTOL) for case in (others[0], bases[0])]
        return LEFT * difference(back(large[0]), large[1], sizes)[0]

    return Said(others[1], back, slack, base=bases[1], sizes=sizes)


def is_deformed(case: Case) -> bool:
    return any("elastic" in body["initial"] for body in case.table["bodies"].values())


def rubs(case: Case) -> bool:
    """Whether joints have friction: the least difference may let one of them go."""
    return any("friction" in joint for joint in case.table["joints"].values())


def small(case: Case, load: float) -> Case:
    """The case with all that moves it multiplied, about the places that it starts in.

    Constraints are met at the start as before; forces of springs are multiplied.
    """
    table = copied(case)
    table["gravity"] = [load * g for g in table["gravity"]]
    for drive in table["drives"].values():
        drive["function"] = functions.about_start(drive["function"], load)
    for force in table["forces"].values():
        _weaken(force, load)
    for body in table["bodies"].values():
        for key in ("velocity", "angular_velocity", "elastic_velocity"):
            if key in body["initial"]:
                body["initial"][key] = (load * np.array(body["initial"][key])).tolist()
    return with_table(case, table)


def _weaken(force: Table, load: float) -> None:
    if "function" in force:
        force["function"] = functions.scaled(force["function"], load)
    for key in ("stiffness", "damping"):
        if key in force:
            force[key] = (load * np.array(force[key])).tolist()
    if "table" in force:
        force["table"]["force"] = [load * f for f in force["table"]["force"]]
    if force["type"] == "friction":
        force |= {key: load * force[key] for key in ("force", "speed")}
