"""Blocks of other writers that hold nothing, the wrong sign, or a mirror image."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sidtool.conversion.frame_change import change_frame
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array, Node, Taylor, axis_major
from sidtool.formats.geometric_stiffening import has_stiffening, load_stiffness
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_mass import skew
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene
from sidtool.validate import check, repair
from sidtool.validate.checks import Check
from tests.bodies import particle_body

from ..bodies import BEAMS, SOLIDS, beam_data, volume_data


def _checks(sid: SID) -> dict[str, Check]:
    return {c.id: c for c in check(sid)}


def _stiffened(data: dict[str, Any]) -> SID:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sid_from_model(validate_data(data | {"stiffening": {}}, ModelFile))


@pytest.fixture(scope="module", params=["beam", "hex20"])
def tower(request: pytest.FixtureRequest) -> SID:
    """A body that is clamped at its first marker, x upwards."""
    if request.param == "beam":
        return _stiffened(beam_data(BEAMS["beam"], 5))
    return _stiffened(volume_data(SOLIDS["hex20"], 5))


def _softest(sid: SID) -> float:
    """Least change of stiffness by weight that presses the tower on its foot."""
    weight = load_stiffness(sid, acceleration=[9.81, 0.0, 0.0])
    return float(np.linalg.eigvalsh(weight)[0])


@pytest.mark.parametrize("blocks", [("Ct",), ("phi",), ("Ct", "phi")])
def test_a_reversed_sign_of_the_stiffening_is_found(
    tower: SID, blocks: tuple[str, ...]
) -> None:
    """A standing tower is softened by its weight; with the sign reversed stiffened."""
    assert _checks(tower)["I20"].verdict == "passed" and _softest(tower) < 0.0
    wrong = tower
    if "Ct" in blocks:
        wrong = replace(wrong, Ct=replace(wrong.Ct, m1=-wrong.Ct.first_order(5)))
    if "phi" in blocks:
        nodes = [
            replace(n, phi=Taylor(n.phi.m0, -n.phi.first_order(5))) for n in wrong.nodes
        ]
        wrong = replace(wrong, nodes=tuple(nodes))
    assert _checks(wrong)["I20"].failed
    repaired, changes = repair(wrong)
    assert {c.block.split(", ")[-1] for c in changes} == set(blocks)
    assert_allclose(repaired.Ct.first_order(5), tower.Ct.first_order(5))
    for node, sound in zip(repaired.nodes, tower.nodes, strict=True):
        assert_allclose(node.phi.first_order(5), sound.phi.first_order(5))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("frame", ["buckens", "tangent:1", "as it is"])
def test_errors_of_cr_are_no_stiffening(seed: int, frame: str) -> None:
    """Magnitudes that were averaged leave a symmetric part, also in Ge = 2 Cr1."""
    body = particle_body(3, 20, seed=seed)
    body = body if frame == "as it is" else change_frame(body, frame)
    first = body.Cr.first_order(3).copy()
    first[0, 1] = first[1, 0] = np.abs(first[0, 1])
    wrong = replace(
        body, Cr=Taylor(body.Cr.m0, first), Ge=Taylor(axis_major(2 * first))
    )
    assert _checks(wrong)["I9"].failed and not has_stiffening(wrong)
    repaired, changes = repair(wrong)
    assert {c.block for c in changes} == {"Cr", "Ge"}
    assert not has_stiffening(repaired) and not _checks(repaired)["I9"].failed


def test_stiffening_by_angular_acceleration_alone_is_carried() -> None:
    """K0r is part of Cr1 and, by the kinematics, not of Ge."""
    body = particle_body(3, 20, seed=2)
    first = body.Cr.first_order(3) + 0.1 * np.arange(9).reshape(3, 3, 1)
    first = first + 0.1 * np.swapaxes(np.arange(9).reshape(3, 3, 1), 0, 1)
    stiffened = replace(body, Cr=Taylor(body.Cr.m0, first))
    assert has_stiffening(stiffened) and not _checks(stiffened)["I9"].failed
    assert repair(stiffened) == (stiffened, ())


def _oriented(seed: int) -> SID:
    """Nodes with axes of their own, and rotations about three directions."""
    body = particle_body(4, 12, seed=seed)
    nodes = []
    for i, node in enumerate(body.nodes):
        AP = Rotation.from_rotvec([0.3 + i, -0.8, 0.5 * seed]).as_matrix()
        nodes.append(replace(node, AP=Taylor(AP, skew(node.psi.m0.T) @ AP)))
    return replace(body, nodes=tuple(nodes))


MIRROR = np.diag([1.0, -1.0, 1.0])
FAULTS: dict[str, Callable[[Array, Array], Taylor]] = {
    "zero": lambda m0, m1: Taylor(0.0 * m0, m1),
    "reflected": lambda m0, m1: Taylor(m0 @ MIRROR, m1),
    "m0 transposed": lambda m0, m1: Taylor(m0.T, m1),
    "transposed": lambda m0, m1: Taylor(m0.T, np.swapaxes(m1, 1, 2)),
    "no first order": lambda m0, m1: Taylor(m0),
}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("fault", FAULTS)
def test_orientations_come_back(fault: str, seed: int) -> None:
    body = _oriented(seed)

    def spoilt(node: Node) -> Node:
        return replace(node, AP=FAULTS[fault](node.AP.m0, node.AP.first_order(4)))

    wrong = replace(body, nodes=(spoilt(body.nodes[0]), *body.nodes[1:]))
    checks = _checks(wrong)
    assert checks["I3"].failed or checks["I18"].failed
    assert checks["I18"].failed == (fault in ("zero", "reflected"))
    repaired, changes = repair(wrong)
    assert {c.block for c in changes} == {"node 1, AP"}
    assert_allclose(repaired.nodes[0].AP.m0, body.nodes[0].AP.m0, atol=1e-9)
    assert_allclose(repaired.nodes[0].AP.m1, body.nodes[0].AP.m1, atol=1e-9)


def test_placeholders_are_named() -> None:
    """As a converter leaves them that writes Me and Ke only."""
    body = particle_body(3, 12, seed=1)
    names = ("J", "Ct", "Cr", "Gr", "Ge", "Oe")
    empty = {name: Taylor(np.zeros(getattr(body, name).shape)) for name in names}
    found = _checks(replace(body, **empty, mdCM=Taylor(body.mdCM.m0)))["I19"]  # type: ignore[arg-type]
    assert found.failed and found.severity == "error"
    assert all(name in found.detail for name in names)
    assert not _checks(body)["I19"].failed


@pytest.mark.parametrize("name", ["mdCM", "Ct", "Gr", "Ge", "Oe", "J"])
def test_blocks_that_follow_from_others_are_filled(name: str) -> None:
    body = particle_body(3, 12, seed=1)
    block = getattr(body, name)
    missing = {
        "mdCM": Taylor(block.m0),
        "J": Taylor(block.m0),
        "Oe": Taylor(np.zeros(block.shape), block.m1),
    }.get(name, Taylor(np.zeros(block.shape)))
    wrong = replace(body, **{name: missing})  # type: ignore[arg-type]
    assert name in _checks(wrong)["I19"].detail
    repaired, changes = repair(wrong)
    assert {c.block for c in changes} == {name}
    found = getattr(repaired, name)
    assert_allclose(found.m0, block.m0, atol=1e-12)
    assert_allclose(
        getattr(repaired, name).first_order(3), block.first_order(3), atol=1e-12
    )


@pytest.mark.parametrize("fault", ["zero", "reflected"])
def test_a_joint_needs_an_orientation(fault: str) -> None:
    body = _oriented(0)
    first = body.nodes[0]
    wrong = replace(first, AP=FAULTS[fault](first.AP.m0, first.AP.first_order(4)))
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "spatial",
        "time": {"start": 0.0, "end": 0.1, "output_step": 0.1},
        "ground": {"markers": {"base": {}}},
        "bodies": {"arm": {"sid": "arm.SID_FEM", "markers": {"foot": 1}}},
        "joints": {"hold": {"type": "fixed", "markers": ["ground.base", "arm.foot"]}},
    }
    scene = validate_data(data, SceneFile)
    spoilt = replace(body, nodes=(wrong, *body.nodes[1:]))
    with pytest.raises(InputError, match="node 1 of arm, whose AP is"):
        compile_scene(scene, sids={"arm": spoilt})
    compile_scene(scene, sids={"arm": body})
