"""What a run took into account of each body, and what it left out."""

from __future__ import annotations

from sidtool.formats.result import Result
from sidtool.formats.scene import RigidBody, SceneFile, SidBody
from sidtool.formats.sid import SID
from sidtool.formats.stiffening import has_stiffening
from sidtool.formats.stress import stress_nodes
from sidtool.solver.system.bodies.lost_inertia import has_quadratic_inertia

from ..report.tables import Block, table


def modelled(scene: SceneFile, result: Result) -> Block:
    """A row for each body: what moves it, what is kept, what is not."""
    rows, planar = [], scene.dimension == "planar"
    for name, body in scene.bodies.items():
        if isinstance(body, RigidBody):
            kept = "mass" if body.inertia is None else "mass, inertia"
            lost = "deformation" + (", rotation" if body.inertia is None else "")
            rows.append([name, "rigid", kept, lost])
        else:
            terms, missing = _flexible(body, result.sids.get(name), planar)
            rows.append([name, "taken as rigid" if body.rigid else "flexible"])
            rows[-1] += [
                ", ".join(terms),
                ", ".join(missing) or "nothing that is known",
            ]
    return table(["body", "kind", "modelled", "left out"], rows)


def _flexible(
    body: SidBody, sid: SID | None, planar: bool
) -> tuple[list[str], list[str]]:
    """What is kept of a SID, and what is not."""
    if sid is None:
        return ["as its SID says"], []
    if body.rigid:
        return ["mass, inertia, places of nodes"], ["all shape functions"]
    damping = "De of the SID" if body.damping is None else body.damping.type
    damped = body.damping is not None or sid.De.m0.any()
    used = len(body.numbers(sid.nq))
    kept = [f"{used} of {sid.nq} shape functions of the SID"]
    kept += [f"damping ({damping})"] if damped else []
    lost = ["all other shape functions"]
    lost += [] if damped else ["damping"]
    quadratic = has_quadratic_inertia(body, sid, planar)
    stiffens = has_stiffening(sid) and body.geometric_stiffening
    for present, what in (
        (stiffens, "geometric stiffening"),
        (bool(stress_nodes(sid)), "stresses"),
        (sid.Ke.first_order(sid.nq).any(), "elastic forces quadratic in q"),
        (quadratic or stiffens, "inertia terms quadratic in q"),
    ):
        (kept if present else lost).append(what)
    return kept, lost
