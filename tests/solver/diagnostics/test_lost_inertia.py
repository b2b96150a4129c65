"""What a run says that stops because a body has bent beyond its SID."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import Taylor
from sidtool.solver import compile_scene, simulate
from sidtool.solver.system.errors import SimulationError
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
    with pytest.raises(SimulationError) as error:
        simulate(system)
    assert error.value.code == "N308"
    assert 'frame = "held"' in error.value.diagnostics[0].remedy


def test_a_free_body_without_inertia_is_not_said_to_be_deformed_by_joints() -> None:
    """A file of a planar body in space: J about z alone, Cr m1 not antisymmetric."""
    sid = slender_bar(2, TANGENT, False)
    flat = sid.J.m0 * np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])[:, None]
    sid = replace(sid, J=Taylor(flat), Cr=Taylor(sid.Cr.m0, np.ones((2, 2, 3))))
    described = scene({"bar": {"sid": "-"}}, {}, end=0.01, dimension="spatial")
    system = compile_scene(described, sids={"bar": sid}, accept_defects=True)
    with pytest.raises(SimulationError) as error:
        simulate(system)
    assert error.value.code == "N308"


def test_a_bar_struck_hard_names_the_remedy_and_it_helps() -> None:
    """A free bar in space, bent by 2 % (docs/howto/stiffening)."""
    sid = slender_bar(2, TANGENT, False)
    start = struck(sid, [0.5, 3.0, 2.0], [0.0, 0.0, 3.0])
    bar = {"sid": "-", "markers": {"b": 2}, "initial": start}
    with pytest.raises(SimulationError) as error:
        less = {"bar": bar | {"quadratic_inertia": False}}
        run(sid, "spatial", 0.15, 1e-7, bodies=less)
    lost = [d for d in error.value.diagnostics if d.code == "N307"]
    assert lost and "quadratic_inertia" in lost[0].remedy
    run(sid, "spatial", 0.15, 1e-7, bodies={"bar": bar})


def test_the_assembly_is_named_where_it_deforms_a_body_too_far() -> None:
    """A hinge along the bar and a ball joint beside its end, by 5 % of its length: the
    bar has to bend, and has no inertia about the hinge then."""
    sid = slender_bar(2, TANGENT, False)
    joints = {
        "root": {"type": "revolute", "markers": ["ground", "bar.a"], "axis": [1, 0, 0]},
        "end": {"type": "spherical", "markers": ["ground.wall", "bar.b"]},
    }
    bar = {"sid": "-", "markers": {"a": 1, "b": 2}, "quadratic_inertia": False}
    wall = {"markers": {"wall": {"position": [1.0, 0.05, 0.0]}}}
    described = scene({"bar": bar}, joints, dimension="spatial", ground=wall)
    with pytest.raises(SimulationError) as error:
        simulate(compile_scene(described, sids={"bar": sid}))
    found = error.value.diagnostics[0]
    assert (found.code, found.subject, found.t) == ("N312", "bar", 0.0)


@pytest.mark.parametrize("modes", [16, 24])
def test_a_bar_with_many_modes_bends_as_euler_and_bernoulli_say(modes: int) -> None:
    """On two supports under a moment at one end: M L / 6 E I at the other. The frame
    turns with that end, and the modes leave little of its inertia: that of first order
    is lost at a deflection of 0.1 % of the length."""
    sid = slender_bar(modes, TANGENT, False)
    joints = {
        "left": {"type": "revolute", "markers": ["ground", "bar.a"]},
        "right": {"type": "point_on_line", "markers": ["ground", "bar.b"]},
    }
    moment, bending = 500.0, 2.1e11 * 0.03 * 0.02**3 / 12.0
    ramp = {"type": "sine_ramp", "from": 0.0, "to": 1.0, "end": 1.0}
    force = {"type": "force", "marker": "bar.b", "torque": moment, "function": ramp}

    def angle(bar: dict[str, Any]) -> float:
        bars = {"bar": {"sid": "-", "markers": {"a": 1, "b": 2}} | bar}
        described = scene(bars, joints, record=["bar.angle"], forces={"end": force})
        result = simulate(compile_scene(described, sids={"bar": sid}))
        return float(result["bar.angle"][-1])

    with pytest.raises(SimulationError):
        angle({"quadratic_inertia": False})
    assert angle({}) == pytest.approx(-moment / (6.0 * bending), rel=0.02)
