"""A run goes on with the SIDs that it was begun with, and with no others."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Node, Taylor
from sidtool.formats.result import Result
from sidtool.formats.result.data import TABLES
from sidtool.formats.scene import SceneFile
from sidtool.formats.storage.cache import (
    content_digest,
    differing_entries,
    numbers_by_entry,
)
from sidtool.solver import compile_scene, simulate
from sidtool.solver.initial_state.integrator_start import run_settings
from sidtool.solver.output.resume import resume_state
from tests.bodies import particle_body
from tests.solver.scenes import scene

SPECIAL = Taylor(m0=np.eye(6)[:, :1], m1=None)


def body() -> SID:
    """With terms of every kind: of first order, stress, a block of no known name."""
    sid = particle_body(3, 12, stiffening=True, seed=4)
    sigma = Taylor(m0=np.zeros((6, 1)), m1=np.arange(18.0).reshape(3, 6, 1))
    nodes = tuple(replace(node, sigma=sigma) for node in sid.nodes)
    return replace(sid, nodes=nodes, extra={"special": SPECIAL})


BODY = body()
PLACES = [place for place, _ in numbers_by_entry(BODY)]


def next_number(values: np.ndarray) -> np.ndarray:
    """The same but for the last bit of the last number."""
    changed = np.array(values, float)
    changed.flat[-1] = np.nextafter(changed.flat[-1], np.inf)
    return changed


def changed(place: str) -> SID:
    """The body with another number at a place."""
    if place == "mass":
        return replace(BODY, mass=float(next_number(np.array([BODY.mass]))[0]))
    *node, name, part = place.split()
    if node:
        found = BODY.node(node[1])
        entry = getattr(found, name)
        other = replace(entry, **{part: next_number(getattr(entry, part))})
        nodes = [replace(n, **{name: other}) if n is found else n for n in BODY.nodes]
        return replace(BODY, nodes=tuple[Node, ...](nodes))
    block = BODY.extra[name] if name in BODY.extra else BODY.blocks[name]
    other = replace(block, **{part: next_number(getattr(block, part))})
    if name in BODY.extra:
        return replace(BODY, extra={name: other})
    return replace(BODY, **{name: other})


@pytest.fixture(scope="module")
def free() -> SceneFile:
    return scene({"b": {"sid": "b.SID_FEM"}}, end=0.01, dimension="spatial")


@pytest.fixture(scope="module")
def unfinished(free: SceneFile) -> Result:
    result = simulate(compile_scene(free, sids={"b": BODY}))
    return replace(result, completed=False)


def test_a_body_says_all_that_it_is() -> None:
    assert len(set(PLACES)) == len(PLACES)
    known = {place.split()[-2] for place in PLACES if " " in place}
    assert known >= {*BODY.blocks, "origin", "phi", "psi", "AP", "sigma", "special"}
    assert {"Ct m1", "Oe m1", "node 1 phi m1", "node 1 sigma m1"} <= set(PLACES)


@pytest.mark.parametrize("place", PLACES)
def test_a_run_does_not_go_on_with_another_sid(
    place: str, free: SceneFile, unfinished: Result
) -> None:
    other = changed(place)
    assert differing_entries(BODY, other) == [place]
    assert content_digest(other) != content_digest(BODY)
    system = compile_scene(free, sids={"b": other})
    with pytest.raises(InputError, match=f"another SID of b: .* {place}"):
        resume_state(system, run_settings(system, None, None, None, None), unfinished)


def test_a_run_goes_on_with_an_equal_sid(free: SceneFile, unfinished: Result) -> None:
    equal = replace(BODY, title="another title", labels=("a", "b", "c"))
    assert content_digest(equal) == content_digest(BODY)
    system = compile_scene(free, sids={"b": equal})
    past = resume_state(
        system, run_settings(system, None, None, None, None), unfinished
    )
    assert past.t == free.time.end


def test_a_long_run_goes_on_at_once() -> None:
    """Rows of output times and one between them; the work is not their product."""
    count, done = 500_000, 100_000
    table = {"b": {"mass": 1.0, "initial": {"velocity": [2.0, 0.0]}}}
    system = compile_scene(scene(table, end=1.0, steps=count))
    whole = simulate(system)
    rows = [*range(done), done + 1]
    t = whole.t[rows]
    t[-1] -= 0.5 / count
    tables = {name: getattr(whole, name)[rows] for name in TABLES}
    part = replace(whole, completed=False, t=t, **tables)
    began = time.process_time()
    past = resume_state(system, run_settings(system, None, None, None, None), part)
    assert time.process_time() - began < 5.0
    assert past.t == t[-1] and len(past.done.t) == done
    assert past.start.z.tolist() == whole.positions[done + 1].tolist()
