"""Markers in finite motions: what their rows and their stiffening make of them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sidtool.conversion.frame_change import change_frame
from sidtool.discretisation.marker_couplings import second_order_rows
from sidtool.elements.finite_element_model import FiniteElementModel, MarkerRows
from sidtool.formats.base.sid import SID
from sidtool.formats.geometric_stiffening import load_stiffness
from sidtool.formats.model import ModelFile
from sidtool.formats.sid_mass import coupled_mass_matrix
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.validate import check

from ..beams import beam_data
from ..elements.test_interfaces import DISCRETISATIONS, SOLIDS, block, markers
from ..models import rod

TIES = ["rigid", "distributing"]
SHAPES = {**DISCRETISATIONS, **{f"solid {name}": s for name, s in SOLIDS.items()}}


def bodies(name: str) -> Iterator[tuple[FiniteElementModel, MarkerRows]]:
    """All markers of a body: at a point, tied, and tied away from the centroid."""
    for eccentric in (False, True):
        tie = {"type": "distributing", "to": "right"}
        if name in DISCRETISATIONS:
            place = {"position": [1.0, 0.02]} if eccentric else {}
            body = finite_element_model(
                rod(SHAPES[name], markers=markers(tie, **place))
            )
        else:
            body = finite_element_model(block(SHAPES[name], tie))
            if eccentric:
                continue
        for marker in body.markers:
            yield body, marker


def finite(
    body: FiniteElementModel,
    marker: MarkerRows,
    strained: np.ndarray,
    turn: np.ndarray,
    shift: np.ndarray,
) -> np.ndarray:
    """(ndof,) nodes displaced at first, then turned about a marker and shifted."""
    d = body.dimension
    field = np.zeros((len(body.positions), 3))
    field[:, :d] = strained[body.table[:, :d]]
    r = np.zeros_like(field)
    r[:, :d] = body.positions
    r -= marker.position
    moved = Rotation.from_rotvec(turn).apply(r + field) - r + shift
    result = np.zeros(body.ndof)
    result[body.table[:, :d]] = moved[:, :d]
    return result


@pytest.mark.parametrize("name", SHAPES)
def test_a_finite_motion_arrives_at_the_marker(name: str) -> None:
    """Of a strained body, turned and shifted: that rotation, that displacement.

    The strain itself is one of which the rows see no motion.
    """
    random = np.random.default_rng(4)
    for body, marker in bodies(name):
        d = body.dimension
        rows = np.vstack([marker.displacement.toarray(), marker.rotation.toarray()])
        rigid = body.rigid_body_modes(marker.position)
        strained = 0.1 * random.normal(size=body.ndof)
        which = [0, 1, 5] if d == 2 else list(range(6))
        strained = strained - rigid @ (rows[which] @ strained)
        turn, shift = random.normal(size=(2, 3))
        if d == 2:
            turn[:2] = shift[2] = 0.0
        step = 1e-3
        ends = [
            finite(body, marker, s * step * strained, s * step * turn, s * step * shift)
            for s in (-1.0, 1.0)
        ]
        first = (ends[1] - ends[0]) / (2 * step)
        second = (ends[1] + ends[0]) / step**2
        assert_allclose(rows @ first, [*shift, *turn], atol=1e-4)
        excess = second_order_rows(body, marker, first[:, None])
        found = np.concatenate(excess)[:, 0, 0]
        scale = max(np.abs(rows @ second).max(), 0.1)
        assert_allclose(rows @ second, found, atol=1e-5 * scale)


def test_the_rows_of_a_tie_contain_second_order_terms() -> None:
    """Half a turn of a plane tie by theta pulls a marker at e from it: theta^2 e / 2.

    At one point a rigid motion has no excess.
    """
    tie = {"type": "rigid", "to": "right"}
    table = markers(tie, position=[1.0, 0.02])
    body = finite_element_model(rod(SHAPES["iga"], markers=table))
    point, tied = body.markers
    for marker, expected in ((point, 0.0), (tied, 0.02)):
        turning = body.rigid_body_modes(marker.position)[:, 2:]
        shift, turn = second_order_rows(body, marker, turning)
        assert_allclose(shift[:, 0, 0], [0.0, expected, 0.0], atol=1e-12)
        assert_allclose(turn, 0.0, atol=1e-12)


def plane_body(tie: str, frame: str) -> ModelFile:
    ends = {
        "root": {"node": 1, "tie": {"type": tie, "to": "left"}, "position": [0.2, 0.1]},
        "tip": {
            "node": 2,
            "tie": {"type": tie, "to": "right"},
            "position": [0.9, -0.05],
        },
        "side": {"node": 3, "edge": "top", "at": 0.6},
    }
    mesh = {"type": "iga", "degrees": [3, 2], "elements": [6, 1]}
    data = beam_data(
        mesh,
        markers=ends,
        frame={"type": "tangent", "marker": frame},
        reduction={"method": "modal", "modes": 4},
        stiffening={},
    )
    points = [[[0.0, -0.1], [0.1, 0.15]], [[1.0, -0.1], [1.2, 0.15]]]
    data["geometry"]["control_points"] = points
    return validate_data(data, ModelFile)


def solid_body(tie: str, frame: str) -> ModelFile:
    data = block(SOLIDS["iga"], {"type": tie, "to": "right"}).model_dump(
        mode="json", exclude_none=True
    )
    data["discretisation"] = {"type": "iga", "degrees": [2, 2, 2]}
    data["discretisation"]["elements"] = [3, 1, 1]
    data["markers"]["root"] = {"node": 1, "tie": {"type": tie, "to": "left"}}
    data["markers"]["root"]["position"] = [0.2, 0.02, 0.18]
    data["markers"]["tip"]["position"] = [1.0, 0.09, 0.02]
    data["markers"]["side"] = {"node": 3, "edge": "top", "at": [0.4, 0.7]}
    data["frame"] = {"type": "tangent", "marker": frame}
    data["reduction"] = {"method": "modal", "modes": 7}
    data["stiffening"] = {}
    return validate_data(data, ModelFile)


BODIES = {"plane": plane_body, "solid": solid_body}


@cache
def sid(kind: str, tie: str, frame: str) -> SID:
    return sid_from_model(BODIES[kind](tie, frame))


def balanced_loads(body: SID, kind: str) -> dict[str, Any]:
    """Forces and moments at all nodes, and the accelerations that they make."""
    random = np.random.default_rng(8)
    forces, moments = random.normal(size=(2, 3, 3))
    if kind == "plane":
        forces[:, 2] = 0.0
        moments[:, :2] = 0.0
    places = np.array([node.position for node in body.nodes])
    torque = moments.sum(axis=0) + np.cross(places, forces).sum(axis=0)
    mass = coupled_mass_matrix(body)[:6, :6]
    motion = np.linalg.solve(mass, np.append(forces.sum(axis=0), torque))
    names = [node.id for node in body.nodes]
    return {
        "acceleration": motion[:3],
        "angular_acceleration": motion[3:],
        "forces": dict(zip(names, forces, strict=True)),
        "moments": dict(zip(names, moments, strict=True)),
    }


@pytest.mark.parametrize("tie", TIES)
@pytest.mark.parametrize("kind", BODIES)
def test_the_stiffness_of_loads_in_balance_is_that_in_any_frame(
    kind: str, tie: str
) -> None:
    """The same free body from its model in another frame, and re-referenced to it.

    That holds only if forces and moments work on finite motions of their markers, and
    the forces inside rigid pieces on those of their nodes.
    """
    found = []
    other = sid(kind, tie, "tip")
    for body in (change_frame(sid(kind, tie, "root"), "tangent:2"), other):
        stiffness = load_stiffness(body, **balanced_loads(body, kind))
        found.append(scipy.linalg.eigvalsh(stiffness, body.Ke.m0))
    assert_allclose(found[0], found[1], atol=1e-9 * np.abs(found[1]).max())


@pytest.mark.parametrize("tie", TIES)
@pytest.mark.parametrize("kind", BODIES)
def test_stiffened_ties_pass_every_check(kind: str, tie: str) -> None:
    assert [(c.id, c.measured) for c in check(sid(kind, tie, "root")) if c.failed] == []


@pytest.mark.parametrize("tie", TIES)
def test_prestress_at_a_tie_is_its_stiffening(tie: str) -> None:
    """Return Ke of a body under forces and moments, from phi m1 and psi m1.

    Where the tie does not stiffen Ke has it all; where it does, Ke has nothing.
    """
    free = plane_body(tie, "root")
    force, moment = (300.0, -200.0), (150.0,)
    given = {"prestress": {"forces": {"tip": force}, "moments": {"tip": moment}}}
    data = free.model_dump(mode="json", exclude_none=True)
    plain = sid_from_model(free)
    loads: dict[str, Any] = {"forces": {"2": (*force, 0.0)}}
    loads["moments"] = {"2": (0.0, 0.0, *moment)}
    extra = load_stiffness(plain, **loads)
    expected = scipy.linalg.eigvalsh(plain.Ke.m0 + extra, plain.Me.m0)
    assert np.abs(expected / np.diag(plain.Ke.m0) - 1).max() > 1e-3
    alone = {"stiffening": {**given, "markers": []}}
    loaded = sid_from_model(validate_data(data | alone, ModelFile))
    assert_allclose(np.diag(loaded.Ke.m0), expected, rtol=1e-9)
    once = sid_from_model(validate_data(data | {"stiffening": given}, ModelFile))
    assert_allclose(np.diag(once.Ke.m0), np.diag(plain.Ke.m0), rtol=1e-9)
