"""Rotations of markers: beams that a joint clamps, edges that a frame clamps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.sid_mass import coupled_mass_matrix, skew
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import (
    assembled_sid,
    finite_element_model,
    sid_from_model,
)
from sidtool.reduction.body_frames import Frame
from sidtool.reduction.methods import ReducedBasis

from ..beams import beam_data as membrane_data
from ..bodies import beam_data, volume_data
from ..importers.test_import_matrices import as_npz, model

HEIGHT, WIDTH, LENGTH, E, RHO, G = 0.012, 0.02, 0.8, 7.0e10, 2700.0, 9.81
DIRECTIONS = {"x": [1, 0, 0], "y": [0, 1, 0], "z": [0, 0, 1], "askew": [2, -3, 6]}
FRAMES: dict[str, dict[str, Any]] = {
    "chord": {"type": "chord", "markers": ["root", "tip"]},
    "back": {"type": "chord", "markers": ["tip", "root"]},
    "tangent": {"type": "tangent", "marker": "root"},
    "buckens": {"type": "buckens"},
}


def slender(direction: list[float], frame: str, theory: str = "euler_bernoulli") -> Any:
    """A slender beam as plain data, its first marker an interface."""
    along = np.array(direction) / np.linalg.norm(direction)
    data = beam_data({"type": "beam", "elements": 8, "theory": theory})
    data["geometry"] |= {
        "end": list(LENGTH * along),
        "y_axis": [0.3, 1.0, -0.2] if abs(along[1]) < 0.9 else [0.0, 0.2, 1.0],
        "section": {"shape": "rectangle", "height": HEIGHT, "width": WIDTH},
    }
    data["material"] = {"youngs_modulus": E, "poissons_ratio": 0.3, "density": RHO}
    data["markers"] = {
        "root": {"node": 1, "parameters": [0]},
        "tip": {"node": 2, "parameters": [1]},
    }
    data["frame"] = dict(FRAMES[frame])
    reduction = {"method": "craig_bampton", "interfaces": ["root", "tip"], "modes": 8}
    data["reduction"] = reduction
    return data


def clamped(sid: SID, node: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass and stiffness of the body whose node a joint clamps, and what is left.

    Built from the blocks of the SID alone: rigid motion and q, less the six
    constraints of the node.
    """
    at = sid.node(node)
    stiffness = scipy.linalg.block_diag(np.zeros((6, 6)), sid.Ke.m0)
    motion = np.vstack(
        [
            np.hstack([np.eye(3), -skew(at.position), at.phi.m0]),
            np.hstack([np.zeros((3, 3)), np.eye(3), at.psi.m0]),
        ]
    )
    free = scipy.linalg.null_space(motion, rcond=1e-12)
    return free.T @ coupled_mass_matrix(sid) @ free, free.T @ stiffness @ free, free


def assert_a_cantilever(sid: SID, root: int = 1, tip: int = 2) -> None:
    """Bending frequencies beta^2 sqrt(EI / rho A) / L^2, sag rho A g L^4 / (8 E I)."""
    mass, stiffness, free = clamped(sid, root)
    found = np.sqrt(scipy.linalg.eigvalsh(stiffness, mass)[:4]) / (2 * np.pi)
    speed = np.sqrt(E / (12 * RHO)) / (2 * np.pi * LENGTH**2)
    exact = [b**2 * speed * h for b in (1.875104, 4.694091) for h in (HEIGHT, WIDTH)]
    assert_allclose(found, np.sort(exact), rtol=1e-3)
    along = sid.node(tip).position - sid.node(root).position
    along = along / np.linalg.norm(along)
    across = np.cross(along, [0.36, 0.48, 0.8])
    gravity = np.zeros(6 + sid.nq)
    gravity[:3] = -G * across / np.linalg.norm(across)
    load = free.T @ coupled_mass_matrix(sid) @ gravity
    rest = free @ np.linalg.solve(stiffness, load)
    point = sid.node(tip)
    sag = np.hstack([np.eye(3), -skew(point.position), point.phi.m0]) @ rest
    unit = RHO * G * LENGTH**4 / (8 * E) * 12
    least, most = unit / WIDTH**2, unit / HEIGHT**2
    assert 0.999 * least <= np.linalg.norm(sag) <= 1.001 * most


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_a_beam_that_a_joint_clamps_is_a_cantilever(direction: str, frame: str) -> None:
    data = slender(DIRECTIONS[direction], frame)
    sid = sid_from_model(validate_data(data, ModelFile))
    assert_a_cantilever(sid)
    assert_a_cantilever(sid, root=2, tip=1)


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_matrices_of_a_beam_make_a_cantilever(tmp_path: Path, direction: str) -> None:
    """Seven nodes of plain matrices, with rotations of their own."""
    data = slender(DIRECTIONS[direction], "chord")
    body = finite_element_model(validate_data(data, ModelFile))
    ends = {"root": {"node": 1, "mesh_node": 1}, "tip": {"node": 2, "mesh_node": 9}}
    changes = {key: data[key] for key in ("frame", "reduction")}
    path = model(tmp_path, as_npz(tmp_path, body), markers=ends, **changes)
    assert_a_cantilever(sid_from_model(path))


def user_body(tmp_path: Path, kind: str) -> tuple[SID, np.ndarray]:
    """A body of length 1 with the one shape u_a = x (1 - x) at its nodes, a across it.

    Returns
    -------
    the SID in a chord frame, and (n,) the mass-normalised shape of points x = 0, ...
    """
    plane = kind in ("q4", "iga")
    across, at = (1, 0.5) if plane else (2, [0.5, 0.5])
    mesh: dict[str, Any] = {"type": kind, "elements": [10, 2] + [2] * (not plane)}
    if kind == "iga":
        mesh["degrees"] = [2, 2]
    data = membrane_data(mesh) if plane else volume_data(mesh)
    data["markers"] = {
        "root": {"node": 1, "edge": "left", "at": at},
        "tip": {"node": 2, "edge": "right", "at": at},
    }
    data["frame"] = FRAMES["chord"]
    body = finite_element_model(validate_data(data, ModelFile))
    field = np.zeros_like(body.positions)
    field[:, across] = body.positions[:, 0] * (1 - body.positions[:, 0])
    shape = field.reshape(-1, 1)
    np.save(tmp_path / "shapes.npy", shape)
    data["reduction"] = {"method": "user", "file": str(tmp_path / "shapes.npy")}
    size = np.sqrt(float((shape.T @ (body.mass @ shape)).item()))
    return sid_from_model(validate_data(data, ModelFile)), 1 / size


@pytest.mark.parametrize(
    ("kind", "next_to_end"), [("q4", 0.1), ("iga", 0.05), ("hex8", 0.1), ("hex20", 0.0)]
)
def test_user_shapes_keep_their_rotation(
    tmp_path: Path, kind: str, next_to_end: float
) -> None:
    """Half the slope 1 - x_1 of x (1 - x) between the end and the next point.

    Nothing moves along the other axes, exactly; quadratic elements have the slope 1.
    """
    sid, size = user_body(tmp_path, kind)
    axis = 2 if kind in ("q4", "iga") else 0
    for node in sid.nodes:
        turn = np.abs(node.psi.m0[:, 0])
        expected = np.zeros(3)
        expected[2 if axis == 2 else 1] = (1 - next_to_end) / 2 * size
        assert_allclose(turn, expected, atol=1e-9 * size)


def test_a_clamped_face_does_not_turn_and_a_clamped_line_about_itself_only() -> None:
    """A hexahedral body whose frame holds its left face, or one edge of it along z."""
    data = volume_data({"type": "hex8", "elements": [12, 2, 2]}, 4)
    data["markers"]["corner"] = {"node": 3, "position": [0.0, 0.03, 0.005]}
    part = validate_data(data, ModelFile)
    face = sid_from_model(part)
    assert not face.node(1).psi.m0.any()
    assert not face.node(3).psi.m0.any()
    assert np.abs(face.node(2).psi.m0).max() > 0.1

    body = finite_element_model(part)
    nodes = np.flatnonzero(np.isclose(body.positions[:, :2], [0.0, 0.03]).all(axis=1))
    assert len(nodes) == 3
    held = np.zeros(body.ndof, bool)
    held[body.dofs(nodes)] = True
    marker = body.marker("corner")
    shapes = np.random.default_rng(2).normal(size=(body.ndof, 2)) * ~held[:, None]
    basis = ReducedBasis(shapes, np.eye(2), ("a", "b"))
    line = assembled_sid(body, Frame(marker.position, held), basis).node(3)
    about_line = (marker.rotation @ shapes)[2]
    assert np.abs(about_line).min() > 0.1
    assert_allclose(line.psi.m0[2], about_line, rtol=1e-9)
    assert_allclose(line.psi.m0[:2], 0.0, atol=1e-9 * np.abs(about_line).min())


def test_user_shapes_do_not_move_what_is_fixed(tmp_path: Path) -> None:
    data = membrane_data({"type": "q4", "elements": [6, 2]})
    body = finite_element_model(validate_data(data, ModelFile))
    shape = np.random.default_rng(1).normal(size=(body.ndof, 1))
    np.save(tmp_path / "shapes.npy", shape)
    user = {"method": "user", "file": str(tmp_path / "shapes.npy")}
    for fixed, moves in (([], True), (["right"], False)):
        data["reduction"] = user | {"fix": fixed}
        tip = sid_from_model(validate_data(data, ModelFile)).node(2)
        assert bool(tip.phi.m0.any()) is moves
        assert bool(tip.psi.m0.any()) is moves
