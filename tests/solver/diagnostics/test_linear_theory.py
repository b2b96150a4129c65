"""Bodies that leave linear theory, or lack what a run needs, have their codes.

Reference: Euler's column and cantilever of L = m = EI = 1, and Jeffcott's rotor of two
stiffnesses.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import Taylor
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.result import Result
from sidtool.solver import simulate
from sidtool.solver.diagnostics.geometric_stiffening import softening_bound
from tests.codes import codes, only, with_code
from tests.solver.scenes import compiled, polynomial, scene

from .test_body_measures import EULER, cantilever, fixed, rotor

#: First natural frequency of the cantilever [rad/s].
FIRST = 3.516015
#: Codes of deformations that grow without bound.
DIVERGENCES = ("N405", "N406", "N407", "N408")


def compressed(load: float) -> Result:
    """The cantilever under a load along it, in Euler's loads."""
    push = {"type": "force", "marker": "beam.tip", "force": [-load * EULER, 0.0]}
    return simulate(fixed(cantilever(), end=1e-3, forces={"push": push}))


@pytest.mark.parametrize("load", [0.9, 1.2, 90.0])
def test_a_load_above_that_of_euler_buckles(load: float) -> None:
    found = with_code(compressed(load), *DIVERGENCES)
    if load < 1.0:
        assert found == []
        return
    (buckling,) = found
    assert (buckling.code, buckling.subject) == ("N408", "beam")
    assert buckling.data["factor"] == pytest.approx(load, rel=5e-3)
    assert buckling.t is not None and 0.0 <= buckling.t <= 1e-3


def test_a_load_far_beyond_any_stiffness_is_that_of_no_body() -> None:
    """More than 100 times what the column can bear."""
    found = only(compressed(150.0), *DIVERGENCES)
    assert (found.code, found.subject) == ("N407", "beam")


def turning(speed: float, stiffened: bool) -> Result:
    """The cantilever on a hub that turns."""
    described = scene(
        {"beam": {"sid": "-", "markers": {"root": 1}}},
        {"hub": {"type": "revolute", "markers": ["ground", "beam.root"]}},
        {"spin": {"joint": "hub", "function": polynomial(0.0, speed)}},
        end=0.02,
    )
    return simulate(compiled(described, beam=cantilever(stiffened)))


@pytest.mark.parametrize("share", [0.05, 0.5, 1.5])
def test_softening_without_stiffening(share: float) -> None:
    """In the plane of rotation the frequency squared becomes w1^2 - w^2: from 1 % of it
    on a warning, from all of it on divergence. With stiffening it is none of these."""
    speed = share * FIRST
    softened = turning(speed, False)
    found = with_code(softened, "N404", "N405")
    assert [each.code for each in found] == {0.05: [], 0.5: ["N404"], 1.5: ["N405"]}[
        share
    ]
    for each in found:
        assert each.subject == "beam" and "[stiffening]" in each.remedy
        assert each.data["ratio"] == pytest.approx(-(share**2), rel=5e-3)
        assert each.units["ratio"] == "1" and each.t is not None
    assert not with_code(turning(speed, True), "N404", *DIVERGENCES)


@pytest.mark.parametrize(
    ("joint", "share", "gravity", "expected"),
    [
        ("revolute", 0.03, 0.0, []),
        ("revolute", 0.5, 0.0, ["N404"]),
        ("prismatic", 0.0, 0.2, ["N220"]),
        ("prismatic", 0.0, 1.0, ["N411", "N220"]),
    ],
)
def test_warnings_are_found_without_the_rest(
    joint: str, share: float, gravity: float, expected: list[str]
) -> None:
    """Loads on a slow beam are evaluated when the result is read, not before."""
    start, emitted = {"angular_velocity": share * FIRST}, list[Diagnostic]()
    described = scene(
        {
            "carrier": {"mass": 9.0, "inertia": 1.0, "initial": start},
            "beam": {"sid": "-", "markers": {"root": 1}, "initial": start},
        },
        {
            "hub": {"type": joint, "markers": ["ground", "carrier"]},
            "clamp": {"type": "fixed", "markers": ["carrier", "beam.root"]},
        },
        gravity=[0.0, -gravity],
        end=1.0 if gravity else 0.01,
    )
    sid = cantilever(stiffened=False)
    system = compiled(described, beam=sid)
    result = simulate(system, emit_warning=emitted.append, all_warnings=True)
    assert ("diagnostics" in vars(result)) == bool(expected)
    assert emitted == [each for each in result.diagnostics if each.is_warning]
    assert [each.code for each in emitted] == expected
    if not gravity:
        found = result.bodies["beam"].found
        assert found is not None
        assert found.ratio == pytest.approx(-(share**2), rel=5e-3)
        assert softening_bound(sid, planar=True) * FIRST**2 >= 1.0


@pytest.mark.parametrize("speed", [1.5, 3.0, 5.0])
def test_a_shaft_between_its_critical_speeds(speed: float) -> None:
    """Of 2 and 4 rad/s. The mass lies on the axis, where no force stiffens it."""
    sid = rotor(4.0, 16.0)
    far, still = Taylor(np.array([[2.0], [0.0], [0.0]])), Taylor(np.zeros((3, 2)))
    end = replace(sid.nodes[0], id="2", origin=far, phi=still)
    sid = replace(sid, nodes=(*sid.nodes, end))
    described = scene(
        {"shaft": {"sid": "-", "markers": {"end": "2"}}},
        {
            "axle": {
                "type": "revolute",
                "markers": ["ground.end", "shaft.end"],
                "axis": [1.0, 0.0, 0.0],
            }
        },
        {"spin": {"joint": "axle", "function": polynomial(0.0, speed)}},
        dimension="spatial",
        ground={"markers": {"end": {"position": [2.0, 0.0, 0.0]}}},
        end=0.01,
    )
    found = with_code(simulate(compiled(described, shaft=sid)), *DIVERGENCES)
    assert [(each.code, each.subject) for each in found] == (
        [("N406", "shaft")] if speed == 3.0 else []
    )


def bent(nodes: int = 2, **elastic: list[float]) -> Result:
    """Cantilevers that start in a deformation, by their names, with so many nodes."""
    sid = replace(cantilever(), De=Taylor(np.zeros((3, 3))))
    sid = replace(sid, nodes=sid.nodes[:nodes])
    bodies, joints = {}, {}
    for name, q in elastic.items():
        start = {"elastic": q}
        bodies[name] = {"sid": "-", "markers": {"root": 1}, "initial": start}
        joints[f"wall_{name}"] = {
            "type": "fixed",
            "markers": ["ground", f"{name}.root"],
        }
    described = scene(bodies, joints, end=1e-4, steps=1)
    return simulate(compiled(described, **dict.fromkeys(elastic, sid)))


def test_deflections_and_rotations_have_limits_of_their_own() -> None:
    """The second mode has a slope of 4.78 at the tip where it deflects by one: there
    the rotation leaves linear theory before the deflection does."""
    tip = abs(cantilever().node("2").phi.m0[1])
    cases: dict[str, list[float]] = {
        "little": [0.09 / tip[0], 0.0, 0.0],
        "far": [0.12 / tip[0], 0.0, 0.0],
        "turned": [0.0, 0.05 / tip[1], 0.0],
    }
    result = bent(**cases)
    found = with_code(result, "N411", "N413")
    assert {(each.code, each.subject) for each in found} == {
        ("N411", "far"),
        ("N413", "turned"),
    }
    assert only(result, "N411").data["deflection"] == pytest.approx(0.12, rel=1e-2)
    assert only(result, "N411").data["limit"] == 0.1
    rotation = only(result, "N413").data["rotation"]
    assert rotation == pytest.approx(4.78 * 0.05, rel=2e-2)


def test_a_body_whose_only_node_is_held_deflects_by_its_centre() -> None:
    """The centre of mass of the first mode moves by 0.3915 of the tip."""
    tip = abs(cantilever().node("2").phi.m0[1])
    result = bent(1, far=[0.3 / tip[0], 0.0, 0.0])
    found = only(result, "N411").data["deflection"]
    assert found == pytest.approx(0.3915 * 0.3, rel=1e-2)


def test_of_many_bodies_the_worst_have_a_line_each() -> None:
    """Eight of ten; the two others, which deflect least, are named together."""
    tip = abs(cantilever().node("2").phi.m0[1, 0])
    sizes = [0.11, 0.15, 0.12, 0.19, 0.13, 0.14, 0.18, 0.16, 0.17, 0.115]
    names = [f"b{k}" for k in range(len(sizes))]
    starts = {n: [s / tip, 0.0, 0.0] for n, s in zip(names, sizes, strict=True)}
    result = bent(**starts)
    worst = sorted(names, key=lambda n: -sizes[int(n[1:])])
    assert [each.subject for each in with_code(result, "N411")] == worst[:8]
    assert only(result, "N419").subject == ", ".join(worst[8:])


@pytest.mark.parametrize("frequency", [1.0, 5.0])
def test_shape_functions_that_end_near_the_excitation(frequency: float) -> None:
    """The third mode of the cantilever has 9.82 Hz: 3 times 3.27 Hz."""
    shake: dict[str, Any] = {
        "type": "force",
        "marker": "beam.tip",
        "force": [0.0, 1e-6],
        "function": {"type": "harmonic", "amplitude": 1.0, "frequency": frequency},
    }
    result = simulate(fixed(cantilever(), end=1.0, forces={"shake": shake}))
    assert ("N412" in codes(result)) == (frequency > 61.6972 / (2.0 * np.pi) / 3.0)
    for each in with_code(result, "N412"):
        highest = 61.6972 / (2.0 * np.pi)
        assert (each.subject, each.data["by"]) == ("beam", "shake")
        assert each.data["highest"] == pytest.approx(highest, rel=5e-3)
        assert each.data["excitation"] == pytest.approx(frequency)
        assert each.data["ratio"] == pytest.approx(highest / frequency, rel=5e-3)
        assert each.data["needed"] == pytest.approx(3.0 * frequency)
