"""Bushings with full matrices of stiffness and damping."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.solver import compile_scene, simulate

from .joint_scenes import scene

MASS, INERTIA = 2.0, 0.3
NAMES = {
    "planar": (["x", "y", "angle"], ["vx", "vy", "wz"]),
    "spatial": (
        ["x", "y", "z", "rotation_x", "rotation_y", "rotation_z"],
        ["vx", "vy", "vz", "wx", "wy", "wz"],
    ),
}


def matrix(n: int, seed: int, antisymmetric: float = 0.0) -> Array:
    """Positive definite, and as much that is antisymmetric."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    other = rng.normal(size=(n, n))
    return root @ root.T + n * np.eye(n) + antisymmetric * (other - other.T)


def mounted(dimension: str, start: list[float], **bushing: Any) -> dict[str, Any]:
    plane = dimension == "planar"
    half = 2 if plane else 3
    turn = {"angle": start[2]} if plane else {"axis_angle": start[half:]}
    return {
        "bodies": {
            "b": {
                "mass": MASS,
                "inertia": INERTIA if plane else [INERTIA] * 3,
                "initial": {"position": start[:half], **turn},
            }
        },
        "forces": {"mount": {"type": "bushing", "markers": ["ground", "b"], **bushing}},
    }


@pytest.mark.parametrize("dimension", NAMES)
@pytest.mark.parametrize("antisymmetric", [0.0, 3.0])
def test_small_motion_follows_the_matrices(
    dimension: str, antisymmetric: float
) -> None:
    """M q'' + D q' + K q = 0, exact by a matrix exponential; small, so that the axes of
    the marker and rotation vectors are linear."""
    n = 3 if dimension == "planar" else 6
    K, D = 20.0 * matrix(n, 1, antisymmetric), matrix(n, 2, antisymmetric)
    M = np.diag([MASS] * (2 if n == 3 else 3) + [INERTIA] * (1 if n == 3 else 3))
    start = 1e-6 * np.array([1.0, -0.5, 0.7, 0.3, -0.8, 0.4][:n])
    places, speeds = NAMES[dimension]
    content = scene(
        dimension,
        0.5,
        **mounted(dimension, start.tolist(), stiffness=K.tolist(), damping=D.tolist()),
        outputs={"record": [f"b.{name}" for name in places]},
    )
    result = simulate(compile_scene(content), rtol=1e-9)
    minv = np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-minv @ K, -minv @ D]])
    exact = np.array([expm(A * t)[:n, :n] @ start for t in result.t])
    assert np.abs(result.values - exact).max() < 1e-6 * np.abs(start).max()
    assert np.abs(exact[-1] - start).max() > 0.1 * np.abs(start).max()


@pytest.mark.parametrize("dimension", NAMES)
def test_large_motion_keeps_energy(dimension: str) -> None:
    """A symmetric matrix has a potential, q K q / 2, also where markers turn far."""
    n = 3 if dimension == "planar" else 6
    K = 20.0 * matrix(n, 3)
    start = [0.3, -0.2, 0.5, 0.4, -0.3, 0.6][:n]
    result = simulate(
        compile_scene(
            scene(
                dimension,
                1.0,
                **mounted(dimension, start, stiffness=K.tolist()),
                outputs={"record": ["energy.potential", "energy.kinetic"]},
            )
        ),
        rtol=1e-9,
    )
    potential, kinetic = result.values.T
    q = np.array(start)
    assert potential[0] == pytest.approx(0.5 * q @ K @ q, rel=1e-12)
    assert potential + kinetic == pytest.approx(potential[0], rel=1e-7)
    assert kinetic.max() > 0.2 * potential[0]


def test_a_diagonal_matrix_is_its_diagonal() -> None:
    start, values = [0.3, -0.2, 0.5], [30.0, 50.0, 4.0]
    record = {"record": ["b.x", "b.y", "b.angle", "mount.fx", "energy.balance"]}
    one, two = (
        simulate(
            compile_scene(
                scene(
                    "planar",
                    1.0,
                    **mounted("planar", start, stiffness=stiffness),
                    outputs=record,
                )
            )
        )
        for stiffness in (values, np.diag(values).tolist())
    )
    assert (one.values == two.values).all()


def test_the_whirl_of_a_journal_bearing() -> None:
    """A cross-coupled stiffness drives a whirl: with K = [[c, k], [-k, c]] the motion
    w = x + i y obeys m w'' = (-c + i k) w; the shaft turns meanwhile."""
    c, k = 200.0, 40.0
    K = np.diag([c, c, c, 30.0, 30.0, 0.0])
    K[0, 1], K[1, 0] = k, -k
    start = [1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]
    parts = mounted("spatial", start, stiffness=K.tolist(), shaft="z")
    parts["bodies"]["b"]["initial"]["angular_velocity"] = [0.0, 0.0, 40.0]
    content = scene("spatial", 1.0, **parts, outputs={"record": ["b.x", "b.y"]})
    result = simulate(compile_scene(content), rtol=1e-9)
    exact = 1e-3 * np.cosh(np.sqrt(complex(-c, k) / MASS) * result.t)
    whirl = result["b.x"] + 1j * result["b.y"]
    assert np.abs(whirl - exact).max() < 1e-9
    assert np.abs(whirl).max() > 1.3e-3


@pytest.mark.parametrize(
    "stiffness", [[[1.0, 0.0], [0.0, 1.0]], [[1.0] * 3, [1.0] * 3], [[1.0] * 2] * 3]
)
def test_other_sizes_are_refused(stiffness: list[list[float]]) -> None:
    with pytest.raises(InputError, match=r"3 x 3 matrix in a planar scene"):
        scene("planar", **mounted("planar", [0.0] * 3, stiffness=stiffness))
