"""A body that is rigid where it is loaded is told, and only such a one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.result import Result
from sidtool.solver import simulate
from tests.bodies import particle_body
from tests.codes import with_code
from tests.solver.scenes import compiled, scene
from tests.steel_bars import steel_bar

ATTACHED = {"method": "attachment", "interfaces": ["tip"], "modes": 2}
MODAL = {"method": "modal", "modes": 2}


def rigid_directions(result: Result) -> list[Diagnostic]:
    """Where no shape function moves a marker that is loaded."""
    return [d for d in with_code(result, "N420") if d.data["missing"] == 1.0]


def pulled(sid: SID, force: float) -> Any:
    """A bar clamped at its root, pulled along its axis and heavily damped."""
    body = {"sid": "-", "markers": {"a": 1, "b": 2}}
    body["damping"] = {"type": "modal", "ratio": 1.0}
    joints = {"wall": {"type": "fixed", "markers": ["ground", "bar.a"]}}
    pull = {"type": "force", "marker": "bar.b", "force": [force, 0.0]}
    described = scene(
        {"bar": body}, joints, forces={"pull": pull}, end=0.5, record=["bar.b.ux"]
    )
    return simulate(compiled(described, bar=sid))


@pytest.mark.parametrize("force", [1e4, -3e3])
def test_a_basis_without_axial_shape_is_told_and_does_not_stretch(force: float) -> None:
    """F L / (E A) with an attachment mode; nothing, and a note, without."""
    modal, attached = (pulled(steel_bar(reduction=r), force) for r in (MODAL, ATTACHED))
    (found,) = rigid_directions(modal)
    assert found.subject == "bar" and found.data["joints"] == ("pull",)
    assert (found.data["directions"], found.data["marker"]) == ("along x", "b")
    assert not rigid_directions(attached)
    assert abs(modal["bar.b.ux"][-1]) < 1e-15
    stretch = force * 1.0 / (2.1e11 * 0.02 * 0.02)
    assert attached["bar.b.ux"][-1] == pytest.approx(stretch, rel=1e-3)


def stiffened(sid: SID, node: str, row: int, turning: bool) -> SID:
    """The body whose shape functions leave one component of a node where it is."""

    def without(block: Taylor) -> Taylor:
        values = block.m0.copy()
        values[row] = 0.0
        return Taylor(values)

    def changed(n: Any) -> Any:
        if n.id != node:
            return n
        if turning:
            return replace(n, psi=without(n.psi))
        return replace(n, phi=without(n.phi))

    return replace(sid, nodes=tuple(changed(n) for n in sid.nodes))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("row", "turning"), [(0, False), (2, False), (1, True)])
def test_joints_on_what_no_shape_function_moves(
    seed: int, row: int, turning: bool
) -> None:
    """Random bodies between two `fixed` joints; with and without the component."""
    sid = particle_body(4, 12, seed=seed, nodes=3)
    quiet = stiffened(sid, "2", row, turning)
    body = {"sid": "-", "markers": {"a": 1, "b": 2}}
    joints = {"grip": {"type": "fixed", "markers": ["body.b", "load"]}}
    place = [float(x) for x in sid.node("2").position]
    load = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "initial": {"position": place}}
    described = scene(
        {"body": body, "load": load}, joints, end=1e-5, steps=1, dimension="spatial"
    )
    direction = f"{'about' if turning else 'along'} {'xyz'[row]}"
    for part, wanted in ((sid, False), (quiet, True)):
        found = rigid_directions(simulate(compiled(described, body=part)))
        places = [(d.subject, d.data["directions"], d.data["marker"]) for d in found]
        assert places == [("body", direction, "b")] * wanted


@pytest.mark.parametrize("reduction", [MODAL, ATTACHED])
def test_where_a_chord_frame_sits_it_hides_nothing(reduction: Any) -> None:
    """No shape function moves the ends of a pinned bar across it: the frame turns with
    them. That a basis without axial shape cannot stretch is still told."""
    frame = {"type": "chord", "markers": ["root", "tip"]}
    sid = steel_bar(reduction=reduction, frame=frame)
    body = {"sid": "-", "markers": {"a": 1, "b": 2}}
    body["initial"] = {"angle": 0.4}
    far = [0.9210609940028851, 0.3894183423086505]
    joints = {
        "left": {"type": "revolute", "markers": ["ground", "bar.a"]},
        "right": {"type": "coincident", "markers": ["bar.b", "load"]},
    }
    load = {"mass": 1.0, "initial": {"position": far}}
    described = scene({"bar": body, "load": load}, joints, end=1e-5, steps=1)
    found = rigid_directions(simulate(compiled(described, bar=sid)))
    places = [(d.subject, d.data["directions"], d.data["marker"]) for d in found]
    assert places == [("bar", "along x", "b")] * (reduction is MODAL)


@pytest.mark.parametrize("reduction", [MODAL, ATTACHED])
def test_a_shaft_in_a_chord_frame_is_driven_at_its_origin(reduction: Any) -> None:
    """The frame rolls with the marker there; a basis without torsion is still told."""
    frame = {"type": "chord", "markers": ["root", "tip"]}
    sid = steel_bar(reduction=reduction, frame=frame)
    body = {"sid": "-", "markers": {"a": 1, "b": 2}}
    hub = {"mass": 0.1, "inertia": [1e-4, 1e-4, 1e-4]}
    joints = {
        "axle": {"type": "revolute", "markers": ["ground", "hub"], "axis": [1, 0, 0]},
        "cardan": {
            "type": "universal",
            "markers": ["hub", "bar.a"],
            "axis": [0.0, 1.0, 0.0],
            "second_axis": [0.0, 0.0, 1.0],
        },
    }
    described = scene(
        {"hub": hub, "bar": body}, joints, end=1e-5, steps=1, dimension="spatial"
    )
    found = with_code(simulate(compiled(described, bar=sid)), "N420")
    missing = [(d.subject, d.data["directions"], d.data["marker"]) for d in found]
    assert missing == ([("bar", "about x", "a")] if reduction is MODAL else [])


@pytest.mark.parametrize("rounding", [0.0, 1e-14])
def test_a_joint_where_the_body_frame_sits_is_no_missing_shape(rounding: float) -> None:
    """A hinge holds two rotations there; what conversion leaves of them is rounding."""
    sid = particle_body(4, 12, nodes=3)

    def held(n: Any) -> Any:
        if n.id != "1":
            return n
        phi, psi = (Taylor(rounding * block.m0) for block in (n.phi, n.psi))
        return replace(n, phi=phi, psi=psi)

    sid = replace(sid, nodes=tuple(held(n) for n in sid.nodes))
    body = {"sid": "-", "markers": {"a": 1, "b": 2}}
    joints = {"hinge": {"type": "revolute", "markers": ["ground", "body.a"]}}
    place = [-float(x) for x in sid.node("1").position]
    body["initial"] = {"position": place}
    described = scene({"body": body}, joints, end=1e-5, steps=1, dimension="spatial")
    assert not rigid_directions(simulate(compiled(described, body=sid)))
