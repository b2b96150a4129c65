"""A body whose frame is held vibrates as its Me, Ke and Ct say, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool import Result, read, simulate, static_equilibrium, write
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.scene import SceneFile, orientation_matrix
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene
from tests.bodies import particle_body

GRAVITY = np.array([1.0, -9.0, 4.0])


def impossible(nq: int, seed: int) -> SID:
    """Couplings beyond what the modal mass allows: no frame of it can float."""
    body = particle_body(nq, 12, seed=seed)
    still = {"De": Taylor(np.zeros((nq, nq))), "Ct": Taylor(10.0 * body.Ct.m0)}
    return replace(body, **still)  # type: ignore[arg-type]


def held_scene(planar: bool, body: dict[str, Any], nq: int) -> SceneFile:
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar" if planar else "spatial",
        "gravity": list(GRAVITY[: 2 if planar else 3]),
        "time": {"start": 0.0, "end": 0.02, "output_step": 0.002},
        "bodies": {"blade": {"sid": "blade.SID_FEM", **body}},
        "outputs": {"record": [f"blade.q{i + 1}" for i in range(nq)]},
        "accuracy": {"rtol": 1e-9},
    }
    return validate_data(data, SceneFile)


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("seed", [0, 3])
def test_a_held_body_swings_about_its_rest(planar: bool, seed: int) -> None:
    """Me = 1 and Ke = w^2: q = Ct g (1 - cos w t) / w^2, g in the body frame."""
    nq, sid = 2, impossible(2, seed)
    place: dict[str, Any] = {"position": [0.3, -0.2], "angle": 0.7}
    if not planar:
        place = {"position": [0.3, -0.2, 0.5], "axis_angle": [0.4, -0.2, 0.9]}
    scene = held_scene(planar, {"frame": "held", "initial": place}, nq)
    found = simulate(scene, sids={"blade": sid})
    turned = orientation_matrix(scene.bodies["blade"].initial)
    weight = sid.Ct.m0 @ (turned.T @ (GRAVITY * [1, 1, not planar]))
    squares = np.diag(sid.Ke.m0)
    t = found.t[:, None]
    expected = weight / squares * (1.0 - np.cos(np.sqrt(squares) * t))
    assert_allclose(found.values, expected, atol=1e-5 * np.abs(expected).max())


def test_without_it_the_body_is_refused() -> None:
    sid = impossible(2, 0)
    with pytest.raises(InputError, match='frame = "held"'):
        compile_scene(held_scene(False, {}, 2), sids={"blade": sid})
    with pytest.raises(InputError, match=r"bodies\.blade\.frame"):
        held_scene(False, {"frame": "still"}, 2)


def test_results_of_held_bodies_are_told_afterwards(tmp_path: Path) -> None:
    """Files hold the scene as it was written, from which all outputs follow."""
    sid = impossible(2, 0)
    scene = held_scene(False, {"frame": "held"}, 2)
    found = simulate(scene, sids={"blade": sid})
    write(tmp_path / "held.h5", found)
    kept = read(tmp_path / "held.h5")
    assert isinstance(kept, Result)
    w = np.sqrt(sid.Ke.m0[0, 0])
    rate = (sid.Ct.m0 @ GRAVITY)[0] / w * np.sin(w * found.t)
    assert_allclose(kept["blade.vq1"], rate, atol=1e-5 * np.abs(rate).max())
    resting = static_equilibrium(scene, sids={"blade": sid}).result()
    rest = np.linalg.solve(sid.Ke.m0, sid.Ct.m0 @ GRAVITY)
    assert_allclose(resting["blade.q2"], rest[1], rtol=1e-6)


def test_one_coordinate_turns_with_itself_by_rounding_alone() -> None:
    """Cr m1 = int Phi x Phi dm is zero; a file's 1e-17 is no geometric stiffening."""
    sid, scene = impossible(1, 0), held_scene(False, {"frame": "held"}, 1)
    noisy = replace(sid, Cr=Taylor(sid.Cr.m0, np.full((1, 1, 3), 1e-17)))
    expected = simulate(scene, sids={"blade": sid})
    found = simulate(scene, sids={"blade": noisy})
    assert_allclose(found.values, expected.values, rtol=1e-9)
