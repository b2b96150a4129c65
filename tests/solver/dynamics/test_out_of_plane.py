"""Planar scenes of bodies whose shape functions move out of the plane.

Nothing in the plane excites those that only do that: they rest, and modes leave them
out. A body in which both are coupled is refused. References: beam theory, and the
scene in space.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, simulate
from sidtool.solver.analyses.linearisation import linearise

E, NU, RHO, LENGTH = 2e11, 0.3, 7850.0, 1.0


def bar(height: float, width: float, twist: float = 0.0, modes: int = 6) -> SID:
    """A bar along x, clamped at its start, with static shapes for loads at its end."""
    section = {"shape": "rectangle", "height": height, "width": width}
    data = {
        "format": "sidtool model",
        "version": 1,
        "material": {"youngs_modulus": E, "poissons_ratio": NU, "density": RHO},
        "geometry": {
            "type": "beam",
            "start": [0.0, 0.0, 0.0],
            "end": [LENGTH, 0.0, 0.0],
            "twist": [0.0, twist],
            "section": section,
        },
        "discretisation": {"type": "beam", "elements": 12},
        "frame": {"type": "tangent", "marker": "a", "clamp": "start"},
        "markers": {
            "a": {"node": 1, "parameters": [0]},
            "b": {"node": 2, "parameters": [1]},
        },
        "reduction": {"method": "attachment", "interfaces": ["b"], "modes": modes},
    }
    return sid_from_model(validate_data(data, ModelFile))


def slides(planar: bool, **more: Any) -> SceneFile:
    """The bar on a wall, its end pinned to a mass that slides up and down."""
    cut = 2 if planar else 3
    rail: dict[str, Any] = {"axis": [0.0, 1.0, 0.0][:cut], "type": "prismatic"}
    mass = {"mass": 5.0, "inertia": 0.1 if planar else [0.1, 0.1, 0.1]}
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar" if planar else "spatial",
        "gravity": [0.0, -9.81, 0.0][:cut],
        "time": {"end": 0.2, "output_step": 0.01},
        "ground": {"markers": {"g": {"position": [LENGTH, 0.0, 0.0][:cut]}}},
        "bodies": {
            "bar": {"sid": "-", "markers": {"a": 1, "b": 2}},
            "slider": {**mass, "initial": {"position": [LENGTH, 0.0, 0.0][:cut]}},
        },
        "joints": {
            "root": {"type": "fixed", "markers": ["ground", "bar.a"]},
            "pin": {"type": "revolute", "markers": ["slider", "bar.b"]},
            "rail": {"markers": ["ground.g", "slider"], **rail},
        },
        "outputs": {"record": ["slider.y", "bar.q*"]},
        **more,
    }
    return validate_data(data, SceneFile)


def on_pin(planar: bool) -> SceneFile:
    """The bar between a wall and a pin."""
    cut = 2 if planar else 3
    scene = slides(planar)
    joints = {
        "root": {"type": "fixed", "markers": ["ground", "bar.a"]},
        "pin": {"type": "revolute", "markers": ["ground.g", "bar.b"]},
    }
    data = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    data |= {"joints": joints, "gravity": [0.0, 0.0, 0.0][:cut], "outputs": {}}
    del data["bodies"]["slider"]
    return validate_data(data, SceneFile)


@pytest.fixture(scope="module")
def flat() -> SID:
    """Softer across the plane than in it."""
    return bar(0.02, 0.01)


def test_the_lowest_mode_is_that_in_the_plane(flat: SID) -> None:
    """Euler and Bernoulli's bar, clamped and pinned: 15.418 sqrt(EI / m) / L^2. The
    clamped-free mode across the plane came before it."""
    exact = 15.4182 * np.sqrt(E / (12 * RHO)) * 0.02 / (2 * np.pi * LENGTH**2)
    for planar in (True, False):
        system = compile_scene(on_pin(planar), sids={"bar": flat}, keep_joints=True)
        found = linearise(system).frequencies
        near = np.abs(found - exact).min()
        assert near < 2e-4 * exact
        if planar:
            assert found.min() > 0.999 * exact


def test_motions_across_the_plane_rest_and_nothing_else_changes(flat: SID) -> None:
    found = [
        simulate(compile_scene(slides(planar), sids={"bar": flat}), rtol=1e-9)
        for planar in (True, False)
    ]
    plane, space = found
    size = np.abs(space["slider.y"]).max()
    assert_allclose(plane["slider.y"], space["slider.y"], atol=1e-6 * size)
    assert plane.names == space.names
    least = 1e-9 * np.abs(plane.values).max()
    elastic = [n for n in plane.names if n.startswith("bar.q")]
    rests = [n for n in elastic if np.abs(plane[n]).max() < least]
    assert 2 <= len(rests) < flat.nq
    for name in plane.names:
        assert_allclose(
            plane[name], space[name], atol=1e-6 * np.abs(space.values).max()
        )


def test_a_round_bar_may_have_its_modes_in_any_direction() -> None:
    """Modes of one frequency, turned about the axis by 30 degrees."""
    sid = bar(0.02, 0.02, modes=4)
    plain = simulate(compile_scene(slides(True), sids={"bar": sid}), rtol=1e-9)
    squares = np.diag(sid.Ke.m0) / np.diag(sid.Me.m0)
    first, second = np.argsort(squares)[:2]
    assert squares[second] == pytest.approx(squares[first], rel=1e-6)
    turn = np.eye(sid.nq)
    c, s = np.cos(0.5), np.sin(0.5)
    turn[np.ix_([first, second], [first, second])] = [[c, -s], [s, c]]
    turned = combined(sid, turn)
    found = simulate(compile_scene(slides(True), sids={"bar": turned}), rtol=1e-9)
    size = np.abs(plain["slider.y"]).max()
    assert_allclose(found["slider.y"], plain["slider.y"], atol=1e-6 * size)


def combined(sid: SID, T: np.ndarray) -> SID:
    """The same body with shape functions that are combinations, without m1."""

    def rows(block: Taylor) -> Taylor:
        return Taylor(T.T @ block.m0)

    def both(block: Taylor) -> Taylor:
        return Taylor(T.T @ block.m0 @ T)

    nodes = [
        replace(n, origin=Taylor(n.origin.m0), AP=Taylor(n.AP.m0))
        for n in (
            replace(n, phi=Taylor(n.phi.m0 @ T), psi=Taylor(n.psi.m0 @ T))
            for n in sid.nodes
        )
    ]
    zero = {
        name: Taylor(np.zeros_like(getattr(sid, name).m0))
        for name in ("Gr", "Ge", "Oe")
    }
    return replace(
        sid,
        nodes=tuple(nodes),
        Ct=rows(sid.Ct),
        Cr=rows(sid.Cr),
        Me=both(sid.Me),
        Ke=both(sid.Ke),
        De=both(sid.De),
        mdCM=Taylor(sid.mdCM.m0),
        J=Taylor(sid.J.m0),
        **zero,
    )


@pytest.mark.parametrize("twist", [0.1, np.pi / 4])
def test_a_twisted_bar_is_refused_in_the_plane(twist: float) -> None:
    """At 45 degrees its slider sagged by 3.445 mm for 2.225 mm in space."""
    sid = bar(0.04, 0.01, twist)
    with pytest.raises(InputError, match="out of the plane") as caught:
        compile_scene(slides(True), sids={"bar": sid})
    assert caught.value.place == "bodies.bar.sid"
    compile_scene(slides(False), sids={"bar": sid})
