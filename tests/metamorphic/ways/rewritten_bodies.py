"""Bodies described in other ways: frames, halves, SIDs of rigid bodies, tools."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.base.sid import Array, rigid_node, rigid_sid
from sidtool.formats.scene import as_3d
from tests.metamorphic.generator.case import Case, Table, Values
from tests.metamorphic.generator.ingredients import Random, any_pose, unit
from tests.metamorphic.generator.poses import Pose, replaced, turned
from tests.metamorphic.generator.said import (
    Said,
    as_spin,
    components,
    copied,
    kind,
    owner,
    spin,
    with_table,
    without,
)
from tests.metamorphic.ways import damping
from tests.metamorphic.ways.sids import in_axes, mixed
from tests.metamorphic.ways.small_motions import in_small_motion

Z = np.array([0.0, 0.0, 1.0])


def inertia_3d(value: object) -> Array:
    """An inertia of a scene as a tensor; a planar body is flat."""
    given = np.array(value, float)
    if given.ndim == 0:
        return np.asarray(given * np.diag([0.5, 0.5, 1.0]))
    return np.diag(given) if given.ndim == 1 else given


def inertia_as(tensor: Array, planar: bool) -> object:
    return float(tensor[2, 2]) if planar else tensor.tolist()


def rigid_names(case: Case) -> list[str]:
    return [name for name in case.table["bodies"] if not case.is_flexible(name)]


def _velocity_at(initial: Table, new: Pose, planar: bool) -> list[float]:
    """Velocity of another point of a rigid body, `new` is its pose."""
    arm = new.x - as_3d(initial["position"])
    w = as_spin(initial["angular_velocity"])
    return components(as_3d(initial["velocity"]) + np.cross(w, arm), planar)


def moved_frames(case: Case, rng: Random) -> Said | None:
    """Rigid bodies described in other frames of their own."""
    names, planar = rigid_names(case), case.planar
    if not names:
        return None
    table, turns = copied(case), {}
    for name in names:
        body, pose = table["bodies"][name], any_pose(rng, planar, 0.5)
        angle = float(np.arctan2(pose.R[1, 0], pose.R[0, 0]))
        body["centre_of_mass"] = components(
            pose.R.T @ (as_3d(body["centre_of_mass"]) - pose.x), planar
        )
        tensor = pose.R.T @ inertia_3d(body["inertia"]) @ pose.R
        body["inertia"] = inertia_as(tensor, planar)
        for marker, old in body["markers"].items():
            inner = pose.inverse.then(Pose.of(old))
            body["markers"][marker] = inner.table(planar)
            if planar:  # the sum of both angles stays, turns and all
                body["markers"][marker]["angle"] = old.get("angle", 0.0) - angle
        initial = body["initial"]
        new = Pose.of(initial).then(pose)
        velocity = _velocity_at(initial, new, planar)
        body["initial"] = replaced(initial, new, planar) | {"velocity": velocity}
        if planar:
            body["initial"]["angle"] = initial["angle"] + angle
            turns[f"{name}.angle"] = angle

    def back(values: Values) -> Values:
        new = {k: v - turns.get(k, 0.0) for k, v in values.items()}
        gone = [f"{name}.{what}" for name in names for what in "xv"]
        return without(new, lambda name: name in gone)

    return Said(with_table(case, table), back)


def turned_sids(case: Case, rng: Random) -> Said | None:
    """Flexible bodies with their frames' axes turned."""
    if not case.sids:
        return None
    table, planar, sids, turns = copied(case), case.planar, {}, {}
    for name, sid in case.sids.items():
        angle = float(rng.uniform(-2.0, 2.0))
        R = turned(Z if planar else unit(rng), angle)
        sids[name] = in_axes(sid, R.T)
        # nodes keep their orientation in the world
        nodes = tuple(
            replace(
                n,
                AP=replace(
                    n.AP,
                    m0=n.AP.m0 @ R.T,
                    m1=None if n.AP.m1 is None else n.AP.m1 @ R.T,
                ),
            )
            for n in sids[name].nodes
        )
        sids[name] = replace(sids[name], nodes=nodes)
        body = table["bodies"][name]
        pose = Pose.of(body["initial"])
        new = replaced(body["initial"], Pose(pose.x, pose.R @ R), planar)
        turns[f"{name}.angle"] = new.get("angle", 0.0) - body["initial"].get(
            "angle", 0.0
        )
        body["initial"] = new

    def back(values: Values) -> Values:
        return {k: v - turns.get(k, 0.0) for k, v in values.items()}

    return Said(with_table(case, table, sids=sids), back)


def mixed_coordinates(case: Case, rng: Random) -> Said | None:
    """Elastic coordinates scaled, permuted and mixed."""
    if not case.sids:
        return None
    table, sids, ways = copied(case), {}, {}
    for name, sid in case.sids.items():
        nq = sid.nq
        T = np.eye(nq)[rng.permutation(nq)] * 10.0 ** rng.uniform(-2.0, 2.0, nq)
        if rng.random() < 0.5:
            T = T @ (np.eye(nq) + rng.uniform(-0.9, 0.9, (nq, nq)) / nq)
        sids[name], ways[name] = mixed(sid, T), T
        initial = table["bodies"][name]["initial"]
        rates = np.linalg.solve(T, initial["elastic_velocity"])
        initial["elastic_velocity"] = rates.tolist()
        if "elastic" in initial:
            initial["elastic"] = np.linalg.solve(T, initial["elastic"]).tolist()

    def back(values: Values) -> Values:
        return {
            k: v @ ways[owner(k)].T if kind(k) in ("q", "vq") else v
            for k, v in values.items()
        }

    return Said(with_table(case, table, sids=sids), back)


def as_sids(case: Case, rng: Random) -> Said | None:
    """Rigid bodies as SIDs without elastic coordinates."""
    names = rigid_names(case)
    if not names:
        return None
    table, sids = copied(case), dict(case.sids)
    for name in names:
        body = table["bodies"][name]
        c, markers = as_3d(body["centre_of_mass"]), body["markers"]
        inertia = inertia_3d(body["inertia"])
        inertia = inertia + body["mass"] * (c @ c * np.eye(3) - np.outer(c, c))
        places = {m: Pose.of(placement) for m, placement in markers.items()}
        nodes = tuple(
            rigid_node(str(k + 1), p.x, p.R) for k, p in enumerate(places.values())
        )
        sids[name] = rigid_sid(body["mass"], c, inertia, nodes)
        numbers = {m: str(k + 1) for k, m in enumerate(places)}
        initial = body["initial"]
        table["bodies"][name] = {"sid": name, "markers": numbers, "initial": initial}
    return Said(with_table(case, table, sids=sids))


def split_bodies(case: Case, rng: Random) -> Said | None:
    """Rigid bodies as two halves that are fixed to each other."""
    names, planar = rigid_names(case), case.planar
    if not names:
        return None
    table, moved = copied(case), {}
    for name in names:
        body, half = table["bodies"][name], f"{name}half"
        share = float(rng.uniform(0.2, 0.8))
        m, c = body["mass"], as_3d(body["centre_of_mass"])
        inertia = inertia_3d(body["inertia"])
        least = np.linalg.eigvalsh(inertia)[0]
        way = unit(rng) * ([1.0, 1.0, 0.0] if planar else 1.0)
        way *= np.sqrt(0.2 * least / m)
        centres = [c + (1.0 - share) * way, c - share * way]
        mu = m * share * (1.0 - share)
        left = inertia - mu * (way @ way * np.eye(3) - np.outer(way, way))
        masses, shares = [share * m, (1.0 - share) * m], [0.3, 0.7]
        halves = [
            {
                "mass": mass,
                "centre_of_mass": components(centre, planar),
                "inertia": inertia_as(part * left, planar),
                "initial": dict(body["initial"]),
            }
            for mass, centre, part in zip(masses, centres, shares, strict=True)
        ]
        seam = any_pose(rng, planar, 0.4).table(planar)
        halves[0]["markers"], halves[1]["markers"] = {"seam": seam}, {"seam": seam}
        for marker, place in body["markers"].items():
            k = int(rng.random() < 0.5)
            halves[k]["markers"][marker] = place
            if k:
                moved[f"{name}.{marker}"] = f"{half}.{marker}"
        table["bodies"][name], table["bodies"][half] = halves
        ends = [f"{name}.seam", f"{half}.seam"]
        if rng.random() < 0.5:
            ends = ends[::-1]
        table["joints"][f"{name}seam"] = {"type": "fixed", "markers": ends}
    for part in (*table["joints"].values(), *table["forces"].values()):
        if "markers" in part:
            part["markers"] = [moved.get(text, text) for text in part["markers"]]
    for part in (*table["drives"].values(), *table["forces"].values()):
        for key in ("marker", "reference"):
            if key in part:
                part[key] = moved.get(part[key], part[key])
    names_of = {
        f"{moved.get(m.rpartition('.')[0], m.rpartition('.')[0])}.{kind(m)}": m
        for m in case.measures
    }
    said = with_table(case, table, measures=tuple(names_of))
    return Said(said, lambda found: {names_of[k]: v for k, v in found.items()})


def tools(case: Case, rng: Random) -> Said | None:
    """A mass of the FE model at a node as a body that is fixed there.

    The tool has no size: what turns with a node is of second order in q. Displacements
    of second order are exact in a body that is carried, not in the mass of a SID: there
    small motions are compared.
    """
    if not case.sids:
        return None
    case = damping.as_matrices(case)  # which follow the mass of the body
    if any(cloud.phi1 is not None for cloud in case.clouds.values()):
        return in_small_motion(case, rng, _with_tool)

    def back(values: Values) -> Values:
        return without(values, lambda n: kind(n) in ("kinetic",))

    return Said(_with_tool(case, rng), back)


def _with_tool(case: Case, rng: Random) -> Case:
    table, sids, planar = copied(case), dict(case.sids), case.planar
    name = str(rng.choice(sorted(case.sids)))
    sid, k = case.sids[name], str(rng.integers(2, 5))
    node = sid.node(k)
    mass = 0.05
    part, none = case.clouds[name].at(int(k) - 1), np.zeros((sid.nq, sid.nq))
    lump = replace(part, masses=np.array([-mass])).sid(none, none, 0)
    blocks = {}
    for block in ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe"):
        one, other = getattr(sid, block), getattr(lump, block)
        first = None if one.m1 is None else one.m1 + other.m1
        blocks[block] = replace(one, m0=one.m0 + other.m0, m1=first)
    sids[name] = replace(sid, mass=sid.mass - mass, **blocks)
    initial = table["bodies"][name]["initial"]
    q = np.array(initial.get("elastic", np.zeros(sid.nq)))
    place = node.position + node.phi.m0 @ q
    pose = Pose.of(initial).then(Pose(place, np.eye(3)))
    w = as_spin(initial["angular_velocity"])
    rates = np.array(initial["elastic_velocity"])
    R = Pose.of(initial).R
    velocity = as_3d(initial["velocity"]) + np.cross(w, R @ place)
    velocity = velocity + R @ node.phi.m0 @ rates
    w = w + R @ node.psi.m0 @ rates
    tiny = 1e-10
    table["bodies"]["tool"] = {
        "mass": mass,
        "inertia": tiny if planar else [tiny, tiny, tiny],
        "markers": {},
        "initial": replaced(
            {
                "velocity": components(velocity, planar),
                "angular_velocity": spin(w, planar),
            }
            | ({"angle": initial["angle"]} if planar else {}),
            pose,
            planar,
        ),
    }
    # a node that starts deformed has turned: there the tool is held by its place alone
    table["joints"]["tool_joint"] = {
        "type": "coincident" if q.any() else "fixed",
        "markers": [f"{name}.{k}", "tool"],
    }
    return with_table(case, table, sids=sids)
