"""What every motion keeps, computed from what a run records and from the particles.

Violations are relative to the size of what is compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import as_3d
from tests.bodies import Cloud
from tests.metamorphic.generator.case import Case, Values, run, times
from tests.metamorphic.generator.differences import LOOSER, WITHIN
from tests.metamorphic.generator.poses import Pose
from tests.metamorphic.generator.said import copied, with_table
from tests.metamorphic.generator.states import rotations, with_corners
from tests.metamorphic.ways.rewritten_bodies import inertia_3d

#: Name, first and second marker of what acts between bodies.
Load = tuple[str, str | None, str]

ROWS = 400
#: What is allowed: impulses are quadratures of what is recorded, from functions whose
#: third derivatives may jump.
PARTICLES, IMPULSES = 1e-12, 3e-4
ENERGIES = ("kinetic", "elastic", "potential", "dissipated", "supplied", "balance")


@dataclass(frozen=True, eq=False)
class Motion:
    """Of a body: linear and angular momentum about the origin (nt, 6), its centre
    (nt, 3), kinetic energy (nt,) and mass, as sums over its particles."""

    momenta: Array
    centre: Array
    kinetic: Array
    mass: float


def violations(case: Case, rtol: float) -> dict[str, tuple[float, float]]:
    """The largest violation of each law in one run, and what is allowed.

    The mass matrices of bodies with displacements of second order hold these to first
    order only, so that their kinetic energy is not that of the particles.
    """
    seen = with_corners(_finer(case))
    loads = list(_loads(seen))
    more = [f"energy.{name}" for name in ENERGIES]
    more += [f"{name}.{kind}" for name, _, _ in loads for kind in "fm"]
    more += [f"{end}.x" for _, _, end in loads if not end.startswith("ground")]
    seen = replace(seen, measures=tuple(dict.fromkeys([*seen.measures, *more])))
    # kinetic energy depends on rates, which may differ by so many times more
    found = run(seen, rtol=rtol / LOOSER["v"])
    bodies = {name: _motion(seen, name, found) for name in case.table["bodies"]}
    laws = {
        "energy": (_energy(found), WITHIN * rtol),
    }
    if all(cloud.phi1 is None for cloud in case.clouds.values()):
        kinetic = _kinetic(bodies, found)
        laws["kinetic energy of the particles"] = (kinetic, PARTICLES)
    # gears and couplings act on coordinates of joints: their wrenches are not told;
    # friction of joints jumps between what is recorded
    joints = case.table["joints"].values()
    if not any("joints" in joint or "friction" in joint for joint in joints):
        impulses = _impulses(seen, bodies, loads, found)
        laws["momenta and impulses of each body"] = (impulses, IMPULSES)
    return laws


def _energy(found: Values) -> float:
    """Kinetic, elastic and potential energy less what forces and drives do."""
    size = max(np.ptp(found[f"energy.{name}"]) for name in ENERGIES[:-1])
    return float(np.ptp(found["energy.balance"]) / max(size, 1e-9))


def _kinetic(bodies: dict[str, Motion], found: Values) -> float:
    """The recorded kinetic energy is that of all particles and rigid bodies."""
    own = sum(body.kinetic for body in bodies.values())
    gap = np.abs(found["energy.kinetic"][:, 0] - own).max()
    return float(gap / max(np.abs(own).max(), 1e-9))


def _impulses(
    case: Case, bodies: dict[str, Motion], loads: list[Load], found: Values
) -> float:
    """The momenta of each body change by what all joints and forces do to it.

    A joint or a force acts on its second marker as recorded, and with the opposite
    wrench on its first one.
    """
    t = times(case)
    span = t[-1] - t[0]
    worst, size = 0.0, span * max(body.mass for body in bodies.values())
    for name, body in bodies.items():
        total = np.zeros_like(body.momenta)
        for load, first, second in loads:
            for end, sign in ((first, -1.0), (second, 1.0)):
                if end is not None and end.split(".")[0] == name:
                    wrench = _wrench(case, load, second, found)
                    total += sign * wrench
                    size = max(size, span * float(np.abs(wrench).max()))
        weight = body.mass * as_3d(case.table["gravity"])
        total[:, :3] += weight
        total[:, 3:] += np.cross(body.centre, weight)
        change = CubicSpline(t, total).antiderivative()(t)
        gap = np.abs(body.momenta - body.momenta[0] - change).max()
        worst = max(worst, float(gap))
    return worst / size


def _finer(case: Case) -> Case:
    table = copied(case)
    span = table["time"]["end"] - table["time"]["start"]
    table["time"]["output_step"] = span / ROWS
    return with_table(case, table)


def _loads(case: Case) -> Iterator[Load]:
    """Name, first and second marker of all that acts between bodies."""
    table = case.table
    for name, joint in table["joints"].items():
        if "markers" in joint:
            yield name, joint["markers"][0], joint["markers"][1]
    for name, drive in table["drives"].items():
        if "marker" in drive:
            yield name, drive["reference"], drive["marker"]
        else:
            yield name, *table["joints"][drive["joint"]]["markers"]
    for name, force in table["forces"].items():
        if "marker" in force:
            yield name, None, force["marker"]
            continue
        where = force if "markers" in force else table["joints"][force["joint"]]
        yield name, where["markers"][0], where["markers"][1]


def _wrench(case: Case, load: str, end: str, found: Values) -> Array:
    """(nt, 6) force and moment about the origin of what acts at a marker."""
    force = found[f"{load}.f"]
    body, _, marker = end.partition(".")
    if body == "ground":
        at = Pose.of(case.table["ground"]["markers"][marker]).x
        place = np.broadcast_to(at, force.shape)
    else:
        place = found[f"{end}.x"]
    return np.hstack([force, found[f"{load}.m"] + np.cross(place, force)])


def _motion(case: Case, name: str, found: Values) -> Motion:
    x, v, w = (found[f"{name}.{k}"] for k in "xvw")
    R = rotations(case, name, found)
    if name in case.sids:
        return _flexible(case.clouds[name], found, name, R)
    body = case.body(name)
    m, arm = body["mass"], R @ as_3d(body["centre_of_mass"])
    inertia = R @ inertia_3d(body["inertia"]) @ np.swapaxes(R, 1, 2)
    spin = np.einsum("tab,tb->ta", inertia, w)
    x, v = x + arm, v + np.cross(w, arm)
    momenta = np.hstack([m * v, m * np.cross(x, v) + spin])
    kinetic = 0.5 * np.sum(m * v * v + spin * w, axis=1)
    return Motion(momenta, x, kinetic, m)


def _flexible(cloud: Cloud, found: Values, name: str, R: Array) -> Motion:
    q, rates = found[f"{name}.q"], found[f"{name}.vq"]
    x, v, w = (found[f"{name}.{k}"][:, None] for k in "xvw")
    m = cloud.masses
    inner = cloud.c + np.einsum("pal,tl->tpa", cloud.phi, q)
    speed = np.einsum("pal,tl->tpa", cloud.phi, rates)
    if cloud.phi1 is not None:
        inner = inner + 0.5 * np.einsum("pakl,tk,tl->tpa", cloud.phi1, q, q)
        speed = speed + np.einsum("pakl,tk,tl->tpa", cloud.phi1, q, rates)
    arm = np.einsum("tab,tpb->tpa", R, inner)
    own = np.einsum("tab,tpb->tpa", R, speed)
    x, v = x + arm, v + np.cross(w, arm) + own
    both = np.concatenate([v, np.cross(x, v)], axis=-1)
    kinetic = 0.5 * np.einsum("p,tpa,tpa->t", m, v, v)
    centre = np.einsum("p,tpa->ta", m, x) / m.sum()
    momenta = np.einsum("p,tpa->ta", m, both)
    return Motion(momenta, centre, kinetic, float(m.sum()))
