"""Damping laws of flexible bodies, as the matrices that they mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.base.sid import SID, Array, Taylor
from tests.metamorphic.generator.case import Case, Table
from tests.metamorphic.generator.ingredients import Random
from tests.metamorphic.generator.said import Said, copied, with_table

KINDS = ("rayleigh", "modal", "frequency")
#: Damping ratio of `frequency` where no natural frequency is above 100 Hz.
LOWEST = 0.01


def in_sids(case: Case, rng: Random) -> Said | None:
    """The SIDs have the damping that the scene asks for."""
    if not any("damping" in body for body in case.table["bodies"].values()):
        return None
    return Said(as_matrices(case))


def as_matrices(case: Case, kinds: tuple[str, ...] = KINDS) -> Case:
    """The case with laws of these kinds replaced by matrices in the SIDs."""
    table, sids = copied(case), dict(case.sids)
    for name, sid in case.sids.items():
        law = table["bodies"][name].get("damping")
        if law is not None and law["type"] in kinds:
            del table["bodies"][name]["damping"]
            sids[name] = replace(sid, De=Taylor(_matrix(sid, law)))
    return with_table(case, table, sids=sids)


def _matrix(sid: SID, law: Table) -> Array:
    """For natural modes as shape functions: Me is the identity, Ke diagonal."""
    squares = np.diag(sid.Ke.m0)
    assert np.allclose(sid.Me.m0, np.eye(sid.nq), atol=1e-9)
    assert (
        np.array_equal(sid.Ke.m0, np.diag(squares))
        and max(squares) < (200 * np.pi) ** 2
    )
    if law["type"] == "rayleigh":
        return np.diag(law["alpha"] + law["beta"] * squares)
    ratio = law.get("ratio", LOWEST)
    return np.diag(2.0 * np.sqrt(squares) * ratio)
