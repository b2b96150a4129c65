"""What a run says that stops because a body has bent beyond its SID."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sidtool.formats.sid import Taylor
from sidtool.solver import compile_scene, simulate
from sidtool.solver.errors import SimulationError
from tests.solver.scenes import scene
from tests.solver.stiffened_bars import run, struck
from tests.steel_bars import TANGENT, slender_bar


def test_a_sid_that_is_no_body_is_not_said_to_have_deformed() -> None:
    """Its shape functions carry more momentum than their modal masses allow; a joint at
    a node in which its frame does not rest leaves the frame its motion."""
    sid = slender_bar(2, TANGENT, False)
    sid = replace(sid, Ct=Taylor(4.0 * sid.Ct.m0))
    described = scene(
        {"bar": {"sid": "-", "markers": {"a": 1, "b": 2}}},
        {"wall": {"type": "fixed", "markers": ["ground", "bar.b"]}},
        end=0.01,
    )
    system = compile_scene(described, sids={"bar": sid}, accept_defects=True)
    with pytest.raises(SimulationError, match="SID of bar has a defect") as error:
        simulate(system)
    assert "deformed so far" not in str(error.value)
    assert 'frame = "held"' in str(error.value)


def test_a_free_body_without_inertia_is_not_said_to_be_deformed_by_joints() -> None:
    """A file of a planar body in space: J about z alone, Cr m1 not antisymmetric."""
    sid = slender_bar(2, TANGENT, False)
    flat = sid.J.m0 * np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])[:, None]
    sid = replace(sid, J=Taylor(flat), Cr=Taylor(sid.Cr.m0, np.ones((2, 2, 3))))
    described = scene({"bar": {"sid": "-"}}, {}, end=0.01, dimension="spatial")
    system = compile_scene(described, sids={"bar": sid}, accept_defects=True)
    with pytest.raises(SimulationError, match="SID of bar has a defect") as error:
        simulate(system)
    assert "assembly" not in str(error.value)


def test_a_bar_struck_hard_names_the_remedy_and_it_helps() -> None:
    """A free bar in space, bent by 2 % (docs/howto/stiffening)."""
    sid = slender_bar(2, TANGENT, False)
    start = struck(sid, [0.5, 3.0, 2.0], [0.0, 0.0, 3.0])
    bar = {"sid": "-", "markers": {"b": 2}, "initial": start}
    with pytest.raises(SimulationError, match="quadratic_inertia = true of the body"):
        run(sid, "spatial", 0.15, 1e-7, bodies={"bar": bar})
    run(sid, "spatial", 0.15, 1e-7, bodies={"bar": bar | {"quadratic_inertia": True}})


def test_the_assembly_is_named_where_it_deforms_a_body_too_far() -> None:
    """A hinge along the bar and a ball joint beside its end, by 5 % of its length: the
    bar has to bend, and has no inertia about the hinge then."""
    sid = slender_bar(2, TANGENT, False)
    joints = {
        "root": {"type": "revolute", "markers": ["ground", "bar.a"], "axis": [1, 0, 0]},
        "end": {"type": "spherical", "markers": ["ground.wall", "bar.b"]},
    }
    bars = {"bar": {"sid": "-", "markers": {"a": 1, "b": 2}}}
    wall = {"markers": {"wall": {"position": [1.0, 0.05, 0.0]}}}
    described = scene(bars, joints, dimension="spatial", ground=wall)
    told = "do not meet its joints and drives, .* the assembly deforms bar so far that"
    with pytest.raises(SimulationError, match=f"t = 0 s; .*{told}") as error:
        simulate(compile_scene(described, sids={"bar": sid}))
    assert "has deformed" not in str(error.value)
