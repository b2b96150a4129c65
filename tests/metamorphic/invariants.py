"""What every motion keeps, computed from what a run records and from the particles.

Each function returns the largest violation relative to the size of what is compared,
or None where a scene has nothing to say.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from sidtool.formats.scene import as_3d
from sidtool.formats.sid import Array

from .case import Case, Values, run, times
from .poses import Pose
from .rewritten_bodies import inertia_3d
from .said import copied, with_table
from .states import pose_at, with_corners

ROWS = 400


def energy(case: Case, rtol: float) -> float:
    """Kinetic, elastic and potential energy less what forces and drives do."""
    names = ("kinetic", "elastic", "potential", "dissipated", "supplied", "balance")
    seen = replace(case, measures=tuple(f"energy.{name}" for name in names))
    found = run(seen, rtol=rtol)
    size = max(np.ptp(found[f"energy.{name}"]) for name in names[:-1])
    return float(np.ptp(found["energy.balance"]) / max(size, 1e-9))


def kinetic(case: Case, rtol: float) -> float:
    """The recorded kinetic energy is that of all particles and rigid bodies."""
    seen = with_corners(case)
    seen = replace(seen, measures=(*seen.measures, "energy.kinetic"))
    found = run(seen, rtol=rtol)
    own = sum(_kinetic(seen, name, found) for name in case.table["bodies"])
    gap = np.abs(found["energy.kinetic"][:, 0] - own).max()
    return float(gap / max(np.abs(own).max(), 1e-9))


def impulses(case: Case, rtol: float) -> float | None:
    """The momenta of each body change by what all joints and forces do to it.

    A joint or a force acts on its second marker as recorded, and with the opposite
    wrench on its first one. Gears act on the coordinates of two joints: not looked at.
    """
    table = case.table
    if any(joint["type"] == "gear" for joint in table["joints"].values()):
        return None
    seen = with_corners(_finer(case))
    loads = list(_loads(seen))
    wrenches = [f"{name}.{kind}" for name, _, _ in loads for kind in "fm"]
    ends = [f"{end}.x" for _, _, end in loads if not end.startswith("ground")]
    seen = replace(
        seen, measures=tuple(dict.fromkeys([*seen.measures, *wrenches, *ends]))
    )
    found = run(seen, rtol=rtol)
    t = times(seen)
    span = t[-1] - t[0]
    worst, size = 0.0, span * max(_mass(case, name) for name in table["bodies"])
    for name in table["bodies"]:
        momenta = _momenta(seen, name, found)
        total = np.zeros_like(momenta)
        for load, first, second in loads:
            for end, sign in ((first, -1.0), (second, 1.0)):
                if end is not None and end.split(".")[0] == name:
                    wrench = _wrench(seen, load, second, found)
                    total += sign * wrench
                    size = max(size, span * float(np.abs(wrench).max()))
        weight = _mass(case, name) * as_3d(table["gravity"])
        total[:, :3] += weight
        total[:, 3:] += np.cross(_centre(seen, name, found), weight)
        change = CubicSpline(t, total).antiderivative()(t)
        worst = max(worst, float(np.abs(momenta - momenta[0] - change).max()))
    return worst / size


def _finer(case: Case) -> Case:
    table = copied(case)
    span = table["time"]["end"] - table["time"]["start"]
    table["time"]["output_step"] = span / ROWS
    return with_table(case, table)


def _loads(case: Case) -> Iterator[tuple[str, str | None, str]]:
    """Name, first and second marker of all that acts between bodies."""
    table = case.table
    for name, joint in table["joints"].items():
        yield name, joint["markers"][0], joint["markers"][1]
    for name, drive in table["drives"].items():
        first, second = table["joints"][drive["joint"]]["markers"]
        yield name, first, second
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


def _particles(case: Case, name: str, found: Values) -> tuple[Array, Array, Array]:
    """Masses (n,), positions and velocities (nt, n, 3) of a flexible body."""
    cloud = case.clouds[name]
    q, rates = found[f"{name}.q"], found[f"{name}.vq"]
    x, v, w = (found[f"{name}.{k}"] for k in "xvw")
    R = np.array([pose_at(case, name, found, row).R for row in range(len(x))])
    inner = cloud.c + np.einsum("pal,tl->tpa", cloud.phi, q)
    arm = np.einsum("tab,tpb->tpa", R, inner)
    own = np.einsum("tab,pbl,tl->tpa", R, cloud.phi, rates)
    return cloud.masses, x[:, None] + arm, v[:, None] + np.cross(w[:, None], arm) + own


def _rigid(case: Case, name: str, found: Values) -> tuple[float, Array, Array, Array]:
    """Mass, centre and its velocity (nt, 3), and spin momentum (nt, 3)."""
    body = case.body(name)
    x, v, w = (found[f"{name}.{k}"] for k in "xvw")
    R = np.array([pose_at(case, name, found, row).R for row in range(len(x))])
    arm = R @ as_3d(body["centre_of_mass"])
    inertia = R @ inertia_3d(body["inertia"]) @ np.swapaxes(R, 1, 2)
    spin = np.einsum("tab,tb->ta", inertia, w)
    return body["mass"], x + arm, v + np.cross(w, arm), spin


def _kinetic(case: Case, name: str, found: Values) -> Array:
    if name in case.sids:
        masses, _, v = _particles(case, name, found)
        return np.asarray(0.5 * np.einsum("p,tpa,tpa->t", masses, v, v))
    mass, _, v, spin = _rigid(case, name, found)
    turning = np.einsum("ta,ta->t", spin, found[f"{name}.w"])
    return np.asarray(0.5 * mass * np.einsum("ta,ta->t", v, v) + 0.5 * turning)


def _momenta(case: Case, name: str, found: Values) -> Array:
    """(nt, 6) linear and angular momentum about the origin."""
    if name in case.sids:
        masses, x, v = _particles(case, name, found)
        both = np.concatenate([v, np.cross(x, v)], axis=-1)
        return np.asarray(np.einsum("p,tpa->ta", masses, both))
    mass, x, v, spin = _rigid(case, name, found)
    return np.hstack([mass * v, mass * np.cross(x, v) + spin])


def _centre(case: Case, name: str, found: Values) -> Array:
    if name in case.sids:
        masses, x, _ = _particles(case, name, found)
        return np.asarray(np.einsum("p,tpa->ta", masses, x) / masses.sum())
    return _rigid(case, name, found)[1]


def _mass(case: Case, name: str) -> float:
    return float(case.sids[name].mass if name in case.sids else case.body(name)["mass"])
