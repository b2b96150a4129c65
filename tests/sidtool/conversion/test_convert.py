"""From a model file to a SID: blocks, nodes, identities, invariance, messages."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.discretisation.registry import DISCRETISERS
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Taylor, by_mode, symmetric_3x3
from sidtool.formats.sid_files import read_sid
from sidtool.formats.sid_mass import skew
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.validate import check
from tests.places import SLIDER_CRANK

from ..bodies import BEAMS, SOLIDS, beam, volume
from ..models import DISCRETISATIONS, annulus, moved, rod, rod_data

EXACT = 1e-11
#: Rounding of the stiffness times its condition: what an eigenvalue can promise.
CONDITION = 1e-7


SPATIAL = {f"solid {name}": volume(settings, 3) for name, settings in SOLIDS.items()}
SPATIAL["solid tet4"] = volume({"type": "tet4", "elements": [10, 2, 1]}, 3)
SPATIAL |= {name: beam(settings, 3) for name, settings in BEAMS.items()}


@pytest.fixture(params=[*DISCRETISATIONS, "annulus q4", "annulus iga"], scope="module")
def sid(request: pytest.FixtureRequest) -> SID:
    shape, _, name = request.param.rpartition(" ")
    return sid_from_model((annulus if shape else rod)(DISCRETISATIONS[name]))


@cache
def example(name: str) -> SID:
    """The SID of a model of the slider-crank."""
    return sid_from_model(SLIDER_CRANK / f"{name}.toml")


def test_every_frontend_is_tested_here() -> None:
    """Geometries of files and frames have their own tests."""
    own = {("nurbs", settings["type"]) for settings in DISCRETISATIONS.values()}
    others = {("patches", "iga"), ("mesh", "mesh"), ("matrices", "matrices")}
    others |= {("frame", "beam")}
    spatial = {(m.geometry.type, m.discretisation.type) for m in SPATIAL.values()}
    assert own | others | spatial == set(DISCRETISERS)


@pytest.mark.parametrize("name", SPATIAL)
def test_spatial_bodies_are_sound(name: str) -> None:
    checks = check(sid_from_model(SPATIAL[name]))
    assert not [c.id for c in checks if c.verdict == "failed"]


def test_rotary_inertia_is_no_fault() -> None:
    """Of torsion all kinetic energy is that of sections that turn, which keep the
    trace of their inertia: I12 cannot hold. With another mass matrix it fails.
    """
    sid = sid_from_model(beam({"type": "beam", "elements": 8}, 12))
    wrong = replace(sid, Me=Taylor(1.5 * sid.Me.m0))
    foreign = replace(sid, dialect=replace(sid.dialect, writer="FEMBS"))
    found = {}
    for name, body in (("own", sid), ("wrong", wrong), ("foreign", foreign)):
        (found[name],) = (c for c in check(body) if c.id == "I12")
    assert found["own"].verdict == "not applicable"
    assert found["wrong"].verdict == found["foreign"].verdict == "failed"
    assert found["foreign"].measured == pytest.approx(1.0, rel=1e-6)


def test_all_identities_hold(sid: SID) -> None:
    """I1 to I17 of the format, as far as they apply to a single file."""
    checks = check(sid)
    assert len(checks) >= 17
    assert [c.id for c in checks if c.failed] == []


def test_identities_to_rounding(sid: SID) -> None:
    nq = sid.nq
    for node in sid.nodes:
        assert (node.origin.m1[:, :, 0] == node.phi.m0.T).all()
        assert (node.AP.m0 == np.eye(3)).all()
        assert (node.AP.m1 == skew(node.psi.m0.T)).all()
    j1 = symmetric_3x3(sid.J.m1[..., 0])
    gr, ge = by_mode(sid.Gr.m0, nq), by_mode(sid.Ge.m0, nq)
    cr1, oe1 = sid.Cr.m1, sid.Oe.m1
    scale = np.abs(j1).max()
    assert_allclose(sid.mdCM.m1[:, :, 0], sid.Ct.m0, rtol=0, atol=EXACT)
    expected = -np.stack([*np.einsum("laa->al", j1) / 2], 1)
    assert_allclose(sid.Oe.m0[:, :3], expected, atol=EXACT * scale)
    mixed = -np.stack([j1[:, 0, 1], j1[:, 1, 2], j1[:, 0, 2]], 1)
    assert_allclose(sid.Oe.m0[:, 3:], mixed, atol=EXACT * scale)
    assert_allclose(gr, j1 - skew(sid.Cr.m0), atol=EXACT * scale)
    assert_allclose(ge, 2 * cr1, atol=EXACT)
    assert_allclose(cr1, -np.swapaxes(cr1, 0, 1), atol=EXACT)
    assert_allclose(oe1, np.swapaxes(oe1, 0, 1), atol=EXACT)
    assert_allclose(oe1[:, :, :3].sum(-1), -2 * sid.Me.m0, atol=EXACT)
    assert_allclose(sid.Me.m0, np.eye(nq), atol=EXACT)
    assert_allclose(sid.De.m0, 3.86 * sid.Me.m0 + 2.25e-5 * sid.Ke.m0, rtol=1e-15)
    assert not sid.ksigma.m0.any()


def test_coupled_mass_matrix_is_positive_definite(sid: SID) -> None:
    rigid = np.zeros((6, 6))
    rigid[:3, :3] = sid.mass * np.eye(3)
    rigid[3:, :3] = skew(sid.mdCM.m0[:, 0])
    rigid[:3, 3:] = rigid[3:, :3].T
    rigid[3:, 3:] = symmetric_3x3(sid.J.m0[:, 0])
    coupling = np.hstack([sid.Ct.m0, sid.Cr.m0])
    full = np.block([[rigid, coupling.T], [coupling, sid.Me.m0]])
    assert np.linalg.eigvalsh(full)[0] > 0


def test_a_plane_body_has_the_inertia_of_a_plane_body(sid: SID) -> None:
    xx, yy, zz, _, xz, yz = sid.J.m0[:, 0]
    assert zz == pytest.approx(xx + yy, rel=1e-14)
    assert (xz, yz, sid.mdCM.m0[2, 0]) == (0, 0, 0)
    assert not sid.Ct.m0[:, 2].any() and not sid.Cr.m0[:, :2].any()


def test_nothing_moves_or_turns_at_the_tangent_frame(sid: SID) -> None:
    base = sid.node(1)
    assert_allclose(base.position, 0, atol=1e-15)
    assert not base.phi.m0.any() and not base.psi.m0.any()
    assert np.abs(sid.node(2).psi.m0[2]).max() > 0


def test_frequencies_and_labels() -> None:
    sid = example("rod_q4")
    assert sid.labels == (
        "Eigen Mode    1 :       31.701 Hz",
        "Eigen Mode    2 :      200.553 Hz",
        "Eigen Mode    3 :      560.634 Hz",
        "Eigen Mode    4 :     1082.319 Hz",
        "Eigen Mode    5 :     1254.949 Hz",
    )
    assert sid.title == "Piston rod, Q4 150x10"


def test_rotation_at_the_pin_is_the_slope_of_the_axis() -> None:
    """First bending modes: shear is small, psi_z follows dphi_y/dx."""
    markers = {
        "crank_pin": {"node": 1, "edge": "left", "at": 0.5},
        "before": {"node": 3, "parameters": [0.599, 0.5]},
        "middle": {"node": 4, "parameters": [0.6, 0.5]},
        "after": {"node": 5, "parameters": [0.601, 0.5]},
    }
    sid = sid_from_model(rod(DISCRETISATIONS["iga"], markers=markers))
    slope = (sid.node(5).phi.m0[1, :2] - sid.node(3).phi.m0[1, :2]) / 0.002
    assert_allclose(sid.node(4).psi.m0[2, :2], slope, rtol=0.02)


@pytest.mark.parametrize("name", DISCRETISATIONS)
def test_a_turned_and_shifted_part_gives_the_turned_sid(name: str) -> None:
    """The frame keeps the global axes: every vector turns with the geometry."""
    angle = 0.7
    data = rod_data(DISCRETISATIONS[name])
    plain = sid_from_model(moved(data, 0.0, (0.0, 0.0)))
    turned = sid_from_model(moved(data, angle, (3.0, -2.0)))
    c, s = np.cos(angle), np.sin(angle)
    r = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    signs = np.sign(np.sum(turned.node(2).phi.m0 * (r @ plain.node(2).phi.m0), axis=0))
    assert_allclose(turned.Ke.m0, plain.Ke.m0, rtol=CONDITION)
    assert turned.mass == pytest.approx(plain.mass, rel=1e-13)
    assert_allclose(turned.mdCM.m0, r @ plain.mdCM.m0, atol=1e-12)
    inertia, expected = (symmetric_3x3(x.J.m0[:, 0]) for x in (turned, plain))
    assert_allclose(inertia, r @ expected @ r.T, atol=1e-12)
    assert_allclose(turned.node(2).position, r @ plain.node(2).position, atol=1e-13)
    for block in ("Ct", "Cr"):
        found, before = getattr(turned, block).m0, getattr(plain, block).m0
        assert_allclose(found, signs[:, None] * before @ r.T, atol=1e-6)


def test_scaling_laws() -> None:
    """Twice the modulus: sqrt(2) in frequency; twice the thickness: only the mass."""
    settings = DISCRETISATIONS["q4"]
    base = sid_from_model(rod(settings))
    material = rod_data()["material"]
    stiff = sid_from_model(
        rod(settings, material=material | {"youngs_modulus": 4.2e11})
    )
    geometry = rod_data()["geometry"] | {"thickness": 0.02}
    thick = sid_from_model(rod(settings, geometry=geometry))
    assert_allclose(np.diag(stiff.Ke.m0), 2 * np.diag(base.Ke.m0), rtol=CONDITION)
    assert_allclose(np.diag(thick.Ke.m0), np.diag(base.Ke.m0), rtol=CONDITION)
    assert thick.mass == pytest.approx(2 * base.mass, rel=1e-14)
    assert_allclose(thick.node(2).phi.m0, base.node(2).phi.m0 / np.sqrt(2), atol=1e-9)


def test_q4_and_iga_describe_the_same_body() -> None:
    q4, iga = example("rod_q4"), example("rod_iga")
    assert_allclose(q4.mass, iga.mass, rtol=3e-5)
    assert_allclose(q4.J.m0, iga.J.m0, rtol=6e-4, atol=1e-12)
    assert_allclose(q4.Ct.m0, iga.Ct.m0, atol=2e-3)
    assert_allclose(q4.node(2).phi.m0, iga.node(2).phi.m0, atol=2e-3)


def test_a_body_without_damping() -> None:
    data = rod_data()
    del data["damping"]
    assert not sid_from_model(moved(data, 0, (0, 0))).De.m0.any()


def test_the_caller_hears_of_the_stages() -> None:
    stages: list[str] = []
    sid_from_model(rod(), stages.append)
    assert stages[0] == "discretising" and "310 degrees" in stages[1]


@pytest.mark.parametrize("name", ["rod_q4", "rod_iga"])
def test_example_sids_equal_their_converted_models(name: str) -> None:
    stored = read_sid(SLIDER_CRANK / f"{name}.SID_FEM")
    fresh = example(name)
    assert stored.labels == fresh.labels and stored.title == fresh.title
    for block, taylor in fresh.blocks.items():
        assert_same(getattr(stored, block), taylor, block)
    for node in fresh.nodes:
        for entry in ("origin", "phi", "psi", "AP"):
            assert_same(
                getattr(stored.node(node.id), entry), getattr(node, entry), entry
            )


def assert_same(stored: Any, fresh: Any, name: str) -> None:
    for part in ("m0", "m1"):
        a, b = getattr(stored, part), getattr(fresh, part)
        if b is None or not b.any():
            assert a is None or not a.any(), name
        else:
            assert_allclose(a, b, rtol=0, atol=1e-9 * np.abs(b).max(), err_msg=name)


def test_a_model_that_cannot_be_used_names_file_and_key(tmp_path: Path) -> None:
    text = (SLIDER_CRANK / "rod_q4.toml").read_text(encoding="utf-8")
    path = tmp_path / "folded.toml"
    path.write_text(
        text.replace("[[0.5,  0.00], [0.5, 0.00]]", "[[0.5,0.2],[0.5,-0.2]]"),
        encoding="utf-8",
    )
    with pytest.raises(InputError) as caught:
        sid_from_model(path)
    assert caught.value.source == str(path) and caught.value.place == "geometry"
    assert "folds or is mirrored near (0." in str(caught.value)
    path.write_text(text.replace("modes = 5", "modes = 50000"), encoding="utf-8")
    with pytest.raises(InputError, match="folded.toml: reduction.modes: 50000 modes"):
        sid_from_model(path)
