"""Starts in which flexible bodies are let go far from what their loads ask for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from sidtool.formats.result import FlexibleBody
from sidtool.formats.scene import SidBody

from ..recording.sampling import Samples
from ..space import layout as at
from ..system.bodies.data import symmetric
from ..system.scene import System
from .body_measures import deflection

#: Part of the largest deformation of a run that counts as far, and of the size of the
#: body that counts at all.
FAR, SEEN = 0.1, 1e-6


def far_starts(
    system: System, first: Samples, bodies: Mapping[str, FlexibleBody]
) -> Iterator[str]:
    """One line on bodies that are far from quasi-static equilibrium at the start.

    Ke dq = Me q'' is the deformation by which elastic forces would balance what
    accelerates the elastic coordinates. Bodies whose deformation the scene states are
    where they are meant to be.

    first : the state at the start (nt = 1) with its accelerations
    """
    told = []
    for name, body in bodies.items():
        b = system.index(name)
        described, sid = system.scene.bodies[name], system.bodies[b].sid
        stated = isinstance(described, SidBody) and (
            described.initial.elastic is not None
            or described.initial.elastic_velocity is not None
        )
        if stated or not body.deflection > SEEN:
            continue
        row = system.arrays.body[b]
        last, nq = int(row[at.VEL] + row[at.NV]), int(row[at.NQ])
        pushed = symmetric(sid.Me.m0) @ first.accelerations[0, last - nq : last]
        missing = np.linalg.lstsq(symmetric(sid.Ke.m0), pushed, rcond=None)[0]
        away = deflection(sid, np.asarray(missing, np.float64)[None], 0.0)
        if np.isfinite(away) and away > FAR * body.deflection:
            told.append(f"{name} by {away:.2g} of its size")
    if told:
        yield (
            "the run starts far from equilibrium: the loads at the start ask for other "
            f"deformations of {', '.join(told)}, and what it shows rings about them; "
            'initial = {state = "static"} starts at rest, loads that grow smoothly '
            "excite less"
        )
