"""`shape_functions` and `geometric_stiffening` of a scene: what a body leaves out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.scene import SceneFile
from sidtool.validate.basis_change import change_basis
from tests.bodies import particle_body, particle_cloud
from tests.codes import only

STIFF = np.array([3e3, 8e3, 2e4, 5e4])


def body(stiffening: bool = False, planar: bool = True, seed: int = 3) -> SID:
    sid = particle_body(4, 9, planar=planar, seed=seed, stiffening=stiffening)
    Ke, De = Taylor(np.diag(STIFF)), Taylor(1e-3 * np.diag(STIFF))
    return replace(sid, Ke=Ke, De=De)


def scene(dimension: str = "planar", **changes: Any) -> SceneFile:
    """A body that hangs on a pin or a ball and is thrown."""
    spatial = dimension == "spatial"
    record = ["arm.tip.x", "arm.tip.y", "arm.q*", "arm.vq2", "pin.fx"]
    return SceneFile.model_validate(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": dimension,
            "gravity": [0.0, -9.81, 0.0] if spatial else [0.0, -9.81],
            "time": {"end": 0.4, "output_step": 0.02},
            "accuracy": {"rtol": 1e-9},
            "bodies": {
                "arm": {
                    "sid": "arm",
                    "markers": {"pin": 1, "tip": 2},
                    "initial": {"angular_velocity": [0, 0, 5.0] if spatial else 5.0},
                    **changes,
                }
            },
            "joints": {
                "pin": {
                    "type": "spherical" if spatial else "revolute",
                    "markers": ["ground", "arm.pin"],
                }
            },
            "outputs": {"record": record},
        }
    )


def run(sid: SID, content: SceneFile) -> sidtool.Result:
    return sidtool.simulate(content, sids={"arm": sid})


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("kept", [(2, 4), (4, 2, 1)])
def test_retained_shape_functions_equal_a_sid_without_the_others(
    dimension: str, kept: tuple[int, ...]
) -> None:
    whole = body(stiffening=True, planar=dimension == "planar")
    numbers = sorted(kept)
    few = change_basis(whole, np.eye(4)[:, [k - 1 for k in numbers]])
    result = run(whole, scene(dimension, shape_functions=kept))
    plain = scene(dimension)
    record = [n for n in plain.outputs.record if n != "arm.vq2"]
    record += [f"arm.vq{numbers.index(2) + 1}"]
    outputs = plain.outputs.model_copy(update={"record": tuple(record)})
    expected = run(few, plain.model_copy(update={"outputs": outputs}))
    assert result.names[2 : 2 + len(kept)] == tuple(f"arm.q{k}" for k in numbers)
    for name in ("arm.tip.x", "arm.tip.y", "pin.fx"):
        assert result[name] == pytest.approx(expected[name], rel=1e-7, abs=1e-8)
    for i, k in enumerate(numbers, 1):
        assert result[f"arm.q{k}"] == pytest.approx(expected[f"arm.q{i}"], abs=1e-8)
    assert result["arm.vq2"] == pytest.approx(
        expected[f"arm.vq{numbers.index(2) + 1}"], rel=1e-6, abs=1e-7
    )
    assert "shape functions" in str(only(result, "N241"))


def test_outputs_that_were_not_recorded_keep_their_numbers() -> None:
    content = scene(shape_functions=(1, 3))
    few = content.outputs.model_copy(update={"record": ("arm.tip.x",)})
    result = run(body(), content.model_copy(update={"outputs": few}))
    wanted = [n for n in content.outputs.record if n != "arm.vq2"]
    outputs = content.outputs.model_copy(update={"record": tuple(wanted)})
    expected = run(body(), content.model_copy(update={"outputs": outputs}))
    assert result["arm.q3"] == pytest.approx(expected["arm.q3"], abs=1e-12)
    with pytest.raises(sidtool.InputError, match="q1, q3"):
        result["arm.q2"]


def test_a_planar_body_without_stiffening_is_the_one_made_without() -> None:
    """The cloud of particles with and without its field of second order."""
    expected = run(body(stiffening=False), scene())
    result = run(body(stiffening=True), scene(geometric_stiffening=False))
    stiffened = run(body(stiffening=True), scene())
    for name in ("arm.tip.x", "arm.q1", "arm.q3"):
        assert result[name] == pytest.approx(expected[name], rel=1e-7, abs=1e-9)
        assert np.abs(stiffened[name] - expected[name]).max() > 1e-6


@pytest.mark.parametrize("axes", [(1, 2, 1, 2), (0, 1, 2, 2)])
def test_a_spatial_body_without_stiffening_is_the_one_made_without(
    axes: tuple[int, ...],
) -> None:
    """Particles of which each shape function moves all along one axis, as in a beam."""
    cloud, _ = particle_cloud(4, 9, False, 11, stiffening=True)
    phi = np.random.default_rng(4).normal(size=cloud.phi.shape)
    for k, axis in enumerate(axes):
        phi[:, [a for a in range(3) if a != axis], k] = 0.0
    aligned = replace(cloud, phi=0.3 * phi)
    Ke, De = np.diag(STIFF), 1e-3 * np.diag(STIFF)
    plain = replace(aligned, phi1=None, psi1=None).sid(Ke, De, 2)
    spin = {"angular_velocity": [2.0, -1.0, 5.0]}
    content = scene("spatial", initial=spin)
    expected = run(plain, content)
    stiff = aligned.sid(Ke, De, 2)
    result = run(stiff, scene("spatial", initial=spin, geometric_stiffening=False))
    stiffened = run(stiff, content)
    for name in ("arm.tip.x", "arm.q1", "arm.q3"):
        assert result[name] == pytest.approx(expected[name], rel=1e-7, abs=1e-9)
        assert np.abs(stiffened[name] - expected[name]).max() > 1e-6


def test_invalid_omissions_are_refused() -> None:
    with pytest.raises(sidtool.InputError, match="leaves the plane"):
        run(
            body(stiffening=True, planar=False),
            scene("spatial", geometric_stiffening=False),
        )
    with pytest.raises(sidtool.InputError, match="no shape function 5"):
        run(body(), scene(shape_functions=(2, 5)))
    with pytest.raises(ValueError, match="each number once"):
        scene(shape_functions=(2, 2))
