"""Re-referencing: there and back, against the model, against particles."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sidtool.cli.main import run
from sidtool.conversion.damping import with_damping_law
from sidtool.conversion.frame_change import (
    apply_frame_change,
    change_frame,
    frame_change,
)
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    BLOCK_SHAPES,
    J_INDICES,
    SID,
    Node,
    Taylor,
    axis_major,
)
from sidtool.formats.sid_files import read_sid
from sidtool.formats.sid_mass import CENTRIFUGAL_PRODUCTS, free_modal_mass, skew
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.validate import check
from tests.codes import unwrapped
from tests.places import SLIDER_CRANK

from ..models import rod

FRAMES = ["tangent:1", "tangent:2", "chord:1,2", "buckens", "buckens:2"]
MODEL_FRAMES: dict[str, dict[str, Any]] = {
    "tangent:2": {"type": "tangent", "marker": "piston_pin"},
    "chord:1,2": {"type": "chord", "markers": ["crank_pin", "piston_pin"]},
    "buckens": {"type": "buckens"},
}
MODES = {"method": "modal", "modes": 5}


@pytest.fixture(params=[None, {}], ids=["plain", "stiffened"], scope="module")
def sid(request: pytest.FixtureRequest) -> SID:
    """The rod in its tangent frame."""
    stiffening = {} if request.param is None else {"stiffening": request.param}
    return sid_from_model(rod(reduction=MODES, **stiffening))


def entries(sid: SID) -> dict[str, Taylor]:
    parts = {name: getattr(sid, name) for name in BLOCK_SHAPES}
    for node in sid.nodes:
        for name in ("origin", "phi", "psi", "AP"):
            parts[f"{node.id} {name}"] = getattr(node, name)
    return parts


def assert_same(found: SID, expected: SID, tolerance: float) -> None:
    for name, block in entries(expected).items():
        other = entries(found)[name]
        for a, b in (
            (other.m0, block.m0),
            (other.first_order(found.nq), block.first_order(found.nq)),
        ):
            scale = max(np.abs(b).max(initial=0.0), 1e-2)
            assert_allclose(a, b, rtol=0, atol=tolerance * scale, err_msg=name)


@pytest.mark.parametrize("frame", FRAMES)
def test_there_and_back_is_the_identity(sid: SID, frame: str) -> None:
    assert_same(change_frame(change_frame(sid, frame), "tangent:1"), sid, 1e-10)


@pytest.mark.parametrize("frame", FRAMES)
def test_any_way_round_leads_to_the_same(sid: SID, frame: str) -> None:
    """Twice the same frame changes nothing the second time."""
    once = change_frame(sid, frame)
    assert_same(change_frame(once, frame), once, 1e-10)


@pytest.mark.parametrize("frame", FRAMES)
def test_every_check_passes_in_every_frame(sid: SID, frame: str) -> None:
    found = check(change_frame(sid, frame))
    assert [(c.id, c.measured) for c in found if c.failed] == []


@pytest.mark.parametrize("frame", FRAMES)
def test_the_free_body_keeps_its_frequencies(sid: SID, frame: str) -> None:
    """Whatever the frame, the body is the same."""
    other = change_frame(sid, frame)
    values = [scipy.linalg.eigvalsh(s.Ke.m0, free_modal_mass(s)) for s in (sid, other)]
    assert_allclose(values[1], values[0], rtol=1e-9)


@cache
def undamped(modes: int) -> SID:
    return sid_from_model(rod(reduction={**MODES, "modes": modes}, damping=None))


DAMPING = ["rayleigh:0,3e-5", "rayleigh:40,0", "rayleigh:5,1e-5", "modal:0.1", "random"]


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("law", DAMPING)
@pytest.mark.parametrize("modes", [1, 4])
def test_the_free_body_keeps_its_damping(modes: int, law: str, frame: str) -> None:
    """Complex frequencies of the free body: its frame is only a way to look at it."""
    plain = undamped(modes)
    if law == "random":
        root = np.random.default_rng(5).normal(size=(modes, modes))
        old = replace(plain, De=Taylor(20 * root @ root.T))
    else:
        old = with_damping_law(plain, law)
    values = [decays(body) for body in (old, change_frame(old, frame))]
    assert np.abs(values[0].real).max() > 0.1
    assert_allclose(values[1], values[0], rtol=1e-8)


def decays(sid: SID) -> np.ndarray:
    """Eigenvalues of M s^2 + De s + Ke with the mass of the free body."""
    mass, zero, one = free_modal_mass(sid), np.zeros((sid.nq,) * 2), np.eye(sid.nq)
    inverse = np.linalg.inv(mass)
    first = np.block([[zero, one], [-inverse @ sid.Ke.m0, -inverse @ sid.De.m0]])
    return np.sort_complex(np.linalg.eigvals(first))


def test_one_mode_keeps_its_ratio() -> None:
    """beta omega / 2 with the frequency of the clamped body, and as it was after."""
    one = undamped(1)
    omega = float(np.sqrt(one.Ke.m0[0, 0]))
    damped = with_damping_law(one, f"rayleigh:0,{2 * 0.158 / omega}")
    assert float(damped.De.m0[0, 0]) / (2 * omega) == pytest.approx(0.158)
    before = decays(damped)
    after = decays(change_frame(damped, "buckens"))
    ratios = [-float(v[0].real / abs(v[0])) for v in (before, after)]
    assert ratios[1] == pytest.approx(ratios[0], rel=1e-9)


def test_another_law_of_damping_by_name(tmp_path: Path, capsys: Any) -> None:
    source, target = SLIDER_CRANK / "rod_q4.SID_FEM", tmp_path / "mean.SID_FEM"
    arguments = ["convert", str(source), "-o", str(target), "--frame", "chord:1,2"]
    assert run([*arguments, "--damping", "rayleigh:3.86,2.25e-5"]) == 0
    sid = read_sid(target)
    assert_allclose(sid.De.m0, 3.86 * sid.Me.m0 + 2.25e-5 * sid.Ke.m0, rtol=1e-10)
    assert run([*arguments, "--damping", "modal:0.03"]) == 0
    sid = read_sid(target)
    squares, modes = scipy.linalg.eigh(sid.Ke.m0, sid.Me.m0)
    expected = np.diag(2 * 0.03 * np.sqrt(squares))
    assert_allclose(modes.T @ sid.De.m0 @ modes, expected, atol=1e-9 * expected.max())
    assert run([*arguments, "--damping", "none"]) == 0
    assert not read_sid(target).De.m0.any()
    for wrong in ("rayleigh:1", "modal", "viscous", "modal:-1", "modal:1,2"):
        assert run([*arguments, "--damping", wrong]) == 2
        assert "--damping: " in unwrapped(capsys.readouterr().err)


def test_frames_meet_their_definitions(sid: SID) -> None:
    tangent = change_frame(sid, "tangent:2").node(2)
    assert_allclose(tangent.phi.m0, 0, atol=1e-12)
    assert_allclose(tangent.psi.m0, 0, atol=1e-12)
    chord = change_frame(sid, "chord:1,2")
    assert_allclose(chord.node(1).phi.m0, 0, atol=1e-12)
    assert_allclose(chord.node(2).phi.m0[1], 0, atol=1e-12)
    mean = change_frame(sid, "buckens")
    assert_allclose(mean.Ct.m0, 0, atol=1e-12)
    assert_allclose(mean.Cr.m0, 0, atol=1e-12)
    assert_allclose(mean.mdCM.m0, 0, atol=1e-12)


@pytest.mark.parametrize("frame", MODEL_FRAMES)
def test_it_is_the_sid_of_the_model_in_that_frame(frame: str) -> None:
    """The same clamped modes: from the model, or from the SID, up to their basis."""
    fixed = {**MODES, "fix": "left"}
    direct = sid_from_model(rod(frame=MODEL_FRAMES[frame], reduction=fixed))
    other = change_frame(sid_from_model(rod(reduction=MODES)), frame)
    values = [scipy.linalg.eigvalsh(s.Ke.m0, s.Me.m0) for s in (direct, other)]
    assert_allclose(values[1], values[0], rtol=1e-7)
    assert_allclose(other.J.m0, direct.J.m0, atol=1e-12)
    assert_allclose(other.mdCM.m0, direct.mdCM.m0, atol=1e-12)
    compliance = [
        moving(s) @ np.linalg.solve(s.Ke.m0, moving(s).T) for s in (direct, other)
    ]
    assert_allclose(
        compliance[1], compliance[0], rtol=0, atol=1e-7 * compliance[0].max()
    )


def moving(sid: SID) -> np.ndarray:
    """(3 nodes, nq) displacements of all nodes."""
    return np.vstack([node.phi.m0 for node in sid.nodes])


class Particles:
    """Random masses with a displacement field of second order in q."""

    def __init__(self, nq: int = 3, count: int = 40) -> None:
        random = np.random.default_rng(3)
        self.m = random.uniform(0.5, 2, count)
        self.c = random.normal(size=(count, 3))
        self.phi = random.normal(size=(count, nq, 3))
        phi1 = random.normal(size=(count, nq, nq, 3))
        self.phi1 = phi1 + np.swapaxes(phi1, 1, 2)
        self.psi = random.normal(size=(nq, 3))

    def sid(self) -> SID:
        m, c, phi, phi1 = self.m, self.c, self.phi, self.phi1
        nq = phi.shape[1]
        pairs = np.einsum("p,pia,plb->ilab", m, phi, phi)
        second = np.einsum("p,pila,pb->ilab", m, phi1, c)
        cross = np.einsum("p,plia->lia", m, np.cross(phi[:, :, None], phi[:, None]))
        arm = np.einsum("p,plia->lia", m, np.cross(c[:, None, None], phi1))
        cc = np.einsum("p,pa,pb->ab", m, c, c)
        x = np.einsum("p,pla,pb->lab", m, phi, c)
        c4 = x - np.einsum("laa->l", x)[:, None, None] * np.eye(3)
        inertia = np.trace(cc) * np.eye(3) - cc
        rate = -(c4 + np.swapaxes(c4, 1, 2))
        six = lambda t: np.stack([t[..., a, b] for a, b in J_INDICES], -1)  # noqa: E731
        blocks = {
            "mdCM": Taylor((m @ c)[:, None], np.einsum("p,pla->la", m, phi)[..., None]),
            "J": Taylor(six(inertia)[:, None], six(rate)[..., None]),
            "Ct": Taylor(
                np.einsum("p,pla->la", m, phi), np.einsum("p,pkla->kla", m, phi1)
            ),
            "Cr": Taylor(
                np.einsum("p,pla->la", m, np.cross(c[:, None], phi)), cross + arm
            ),
            "Me": Taylor(np.einsum("ilaa->il", pairs)),
            "Gr": Taylor(axis_major(-2 * c4)),
            "Ge": Taylor(axis_major(2 * cross)),
            "Oe": Taylor(
                np.einsum("kab,iab->ik", CENTRIFUGAL_PRODUCTS, x),
                np.einsum("kab,liab->lik", CENTRIFUGAL_PRODUCTS, pairs + second),
            ),
            "ksigma": Taylor(np.zeros((nq, 1))),
            "Ke": Taylor(np.eye(nq)),
            "De": Taylor(np.zeros((nq, nq))),
        }
        node = Node(
            id="1",
            origin=Taylor(c[0][:, None], phi[0][:, :, None]),
            phi=Taylor(phi[0].T, np.swapaxes(phi1[0], 1, 2)),
            psi=Taylor(self.psi.T),
            AP=Taylor(np.eye(3), skew(self.psi)),
        )
        labels = tuple(f"shape {i + 1}" for i in range(nq))
        return SID(float(m.sum()), labels, (node,), **blocks)

    def moved(self, origin: np.ndarray, shift: np.ndarray, turn: np.ndarray) -> Any:
        """The same particles seen from the frame that moves by exp(xi(q))."""
        step = 1e-2
        nq = self.phi.shape[1]
        values = {}
        for i in range(nq):
            for j in range(i, nq):
                for si in (-1, 1):
                    for sj in (-1, 1):
                        q = np.zeros(nq)
                        q[i] += si * step
                        q[j] += sj * step
                        values[i, j, si, sj] = self._seen(q, shift, turn) - origin
        new = Particles(nq, len(self.m))
        new.m, new.c = self.m, self.c - origin
        for i in range(nq):
            plus, minus = values[i, i, 1, 1], values[i, i, -1, -1]
            new.phi[:, i] = (plus - minus) / (4 * step)
            for j in range(i, nq):
                mixed = (
                    values[i, j, 1, 1]
                    - values[i, j, 1, -1]
                    - values[i, j, -1, 1]
                    + values[i, j, -1, -1]
                ) / (4 * step**2)
                new.phi1[:, i, j] = new.phi1[:, j, i] = mixed
        new.psi = self.psi - turn
        return new

    def _seen(self, q: np.ndarray, shift: np.ndarray, turn: np.ndarray) -> np.ndarray:
        place = self.c + np.einsum("pla,l->pa", self.phi, q)
        place = place + np.einsum("pkla,k,l->pa", self.phi1, q, q) / 2
        angle, move = q @ turn, q @ shift
        twist = np.zeros((4, 4))
        twist[:3, :3], twist[:3, 3] = skew(angle), move
        motion = scipy.linalg.expm(-twist)
        assert_allclose(
            motion[:3, :3], Rotation.from_rotvec(-angle).as_matrix(), atol=1e-12
        )
        return place @ motion[:3, :3].T + motion[:3, 3]


def test_every_block_follows_the_particles() -> None:
    """Exact kinematics of 40 particles, differentiated by q, against the formulas."""
    particles = Particles()
    sid = particles.sid()
    change = replace(frame_change(sid, "tangent:1"), origin=np.array([0.3, -0.2, 0.5]))
    moved = particles.moved(change.origin, change.shift, change.turn)
    expected, found = moved.sid(), apply_frame_change(sid, change)
    for name in ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe"):
        new, old = getattr(found, name), getattr(expected, name)
        scale = np.abs(old.first_order(3)).max() + np.abs(old.m0).max()
        assert_allclose(new.m0, old.m0, atol=2e-3 * scale, err_msg=name)
        assert_allclose(
            new.first_order(3), old.first_order(3), atol=2e-3 * scale, err_msg=name
        )
    node, reference = found.node(1), expected.node(1)
    scale = np.abs(reference.phi.m1).max()
    assert_allclose(node.phi.m1, reference.phi.m1, atol=2e-3 * scale)


def test_files_of_others_come_back(field_data: Path) -> None:
    """To a node's tangent frame and back to where the data came from."""
    sid = read_sid(field_data / "sid" / "Beam_3m.SID_FEM")
    there = change_frame(sid, "buckens")
    assert_allclose(there.Ct.m0, 0, atol=1e-9 * np.abs(sid.Ct.m0).max())
    change = frame_change(sid, "buckens")
    back = replace(
        change,
        origin=-change.origin,
        shift=-change.at(change.origin),
        turn=-change.turn,
    )
    assert_same(apply_frame_change(there, back), sid, 1e-10)


def test_a_rigid_body_only_moves_its_origin() -> None:
    from sidtool.formats.base.sid import rigid_node, rigid_sid

    body = rigid_sid(
        2.0, [1.0, 0, 0], np.diag([1.0, 3.0, 3.0]), (rigid_node("1", [0, 0, 0]),)
    )
    moved = change_frame(body, "buckens")
    assert_allclose(moved.mdCM.m0, 0, atol=1e-15)
    assert_allclose(moved.J.m0[:3, 0], [1.0, 1.0, 1.0])
    assert_same(change_frame(moved, "tangent:1"), body, 1e-12)


@pytest.mark.parametrize("frame", ["", "chord:1", "tangent", "mean", "buckens:1,2"])
def test_unknown_frames_are_refused(sid: SID, frame: str) -> None:
    with pytest.raises(InputError, match="expected tangent:NODE, chord:NODE,NODE"):
        change_frame(sid, frame)


def test_nodes_that_cannot_carry_a_frame_are_refused(sid: SID) -> None:
    with pytest.raises(InputError, match="there is no node 7"):
        change_frame(sid, "tangent:7")
    with pytest.raises(InputError, match="at the same place"):
        change_frame(sid, "chord:1,1")
    fixed = [replace(n, psi=Taylor(np.zeros((3, 5)))) for n in sid.nodes]
    with pytest.raises(InputError, match="moves but has no rotation"):
        change_frame(replace(sid, nodes=tuple(fixed)), "tangent:2")


def test_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, target = SLIDER_CRANK / "rod_q4.SID_FEM", tmp_path / "mean.SID_FEM"
    arguments = ["convert", str(source), "-o", str(target), "--frame"]
    assert run([*arguments, "buckens"]) == 0
    assert_allclose(read_sid(target).Ct.m0, 0, atol=1e-12)
    assert run([*arguments, "chord:1"]) == 2
    assert "--frame: found 'chord:1'; expected tangent:NODE" in unwrapped(
        capsys.readouterr().err
    )
