"""Analyses give whole numbers or say why not: no failed solve is dropped."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, simulate
from sidtool.solver.analyses.inverse_dynamics import inverse_dynamics
from sidtool.solver.analyses.linearisation import linearise
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
from sidtool.solver.system.errors import SimulationError
from tests.codes import codes
from tests.sidtool.beams import beam
from tests.solver.integrators.test_singular_positions import slider_crank
from tests.solver.scenes import polynomial, scene, slender_rod

G = 9.81
STEEL, DENSITY = 2.1e11, 7850.0


@cache
def bar(length: float, radius: float, stiffened: bool) -> SID:
    """A round steel bar, clamped in its frame, with bending modes in both planes."""
    area = math.pi * radius**2
    data: dict[str, Any] = {
        "material": {
            "youngs_modulus": STEEL,
            "poissons_ratio": 0.3,
            "density": DENSITY,
        },
        "geometry": {
            "type": "beam",
            "start": [0, 0, 0],
            "end": [length, 0, 0],
            "section": {
                "shape": "general",
                "area": area,
                "iy": area * radius**2 / 4,
                "iz": area * radius**2 / 4,
                "torsion": area * radius**2 / 2,
            },
        },
        "discretisation": {"type": "beam", "elements": 16},
        "frame": {"type": "tangent", "marker": "root", "clamp": "start"},
        "markers": {
            "root": {"node": 1, "parameters": [0]},
            "tip": {"node": 2, "parameters": [1]},
        },
        "reduction": {"method": "modal", "modes": 12},
    }
    if stiffened:
        data["stiffening"] = {}
    return sid_from_model(beam(**data))


def rotor(
    dimension: str, hub: str, spring: float = 0.0, gravity: float = 0.0, **more: Any
) -> SceneFile:
    """A bar on a hub; gravity across it, along z in space."""
    forces = {}
    if spring:
        law = {"type": "spring_damper", "joint": "hub", "stiffness": spring}
        forces = {"spring": law}
    down = [0.0, -gravity] if dimension == "planar" else [0.0, 0.0, -gravity]
    return scene(
        {"bar": {"sid": "-", "markers": {"root": 1, "tip": 2}}},
        {"hub": {"type": hub, "markers": ["ground", "bar.root"]}},
        dimension=dimension,
        gravity=down,
        forces=forces,
        record=["bar.q1"],
        **more,
    )


def frequencies(content: SceneFile, sid: SID) -> np.ndarray:
    system = compile_scene(content, ".", {"bar": sid}, keep_joints=True)
    found = linearise(system).frequencies
    return found[found > 1e-3]


def bending(root: float, length: float, radius: float) -> float:
    """Of an Euler-Bernoulli beam with beta l = root [Hz]."""
    stiffness = math.sqrt(STEEL / DENSITY) * radius / 2.0
    return (root / length) ** 2 * stiffness / (2.0 * math.pi)


@pytest.mark.parametrize("stiffened", [True, False])
@pytest.mark.parametrize("gravity", [0.0, G])
@pytest.mark.parametrize(("length", "radius"), [(1.0, 0.01), (3.0, 0.01), (0.4, 0.001)])
def test_a_bar_at_rest_has_the_frequencies_of_a_clamped_beam(
    stiffened: bool, gravity: float, length: float, radius: float
) -> None:
    """However far it sags: 2 mm to 150 mm."""
    content = rotor("spatial", "fixed", gravity=gravity)
    found = frequencies(content, bar(length, radius, stiffened))
    exact = [bending(root, length, radius) for root in (1.875104, 4.694091, 7.854757)]
    assert found[:6] == pytest.approx(np.repeat(exact, 2), rel=4e-3)


@pytest.mark.parametrize("stiffened", [True, False])
@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize(
    ("length", "radius", "spring", "gravity"),
    [(3.0, 0.01, 50.0, 0.0), (3.0, 0.01, 50.0, G), (1.2, 0.02, 400.0, 0.0)],
)
def test_a_rotor_at_rest_has_the_frequencies_of_a_hinged_beam(
    dimension: str,
    stiffened: bool,
    length: float,
    radius: float,
    spring: float,
    gravity: float,
) -> None:
    """Hinged and free in the plane of rotation, in space clamped and free across it."""
    sag = 0.0 if dimension == "planar" else gravity
    content = rotor(dimension, "revolute", spring, sag)
    found = frequencies(content, bar(length, radius, stiffened))
    stiffness = STEEL * math.pi * radius**4 / 4.0
    roots = spring_hinged_roots(spring * length / stiffness)
    if dimension == "spatial":
        roots = [*roots, 1.875104, 4.694091]
    exact = sorted(bending(root, length, radius) for root in roots)
    assert found[: len(exact)] == pytest.approx(exact, rel=4e-3)


def spring_hinged_roots(ratio: float) -> list[float]:
    """First two beta l of a beam on a hinge with a torsion spring, its other end free.

    b (sinh b cos b - cosh b sin b) + ratio (1 + cos b cosh b) = 0, ratio = k l / EI.
    """

    def left(b: float) -> float:
        swing = math.sinh(b) * math.cos(b) - math.cosh(b) * math.sin(b)
        return b * swing + ratio * (1.0 + math.cos(b) * math.cosh(b))

    return [brentq(left, 1e-3, 1.875), brentq(left, 3.9, 4.694)]


def massless() -> SID:
    """A bar whose first shape function carries more momentum than its mass matrix."""
    sid = bar(1.0, 0.01, stiffened=False)
    light = sid.Me.m0.copy()
    light[0, 0] *= 0.2
    return replace(sid, Me=Taylor(light))


def test_modes_of_an_impossible_body_are_refused_by_name() -> None:
    content = scene(
        {"bar": {"sid": "-"}, "hub": {"mass": 1e-3, "inertia": [1e-6] * 3}},
        {"pin": {"type": "revolute", "markers": ["hub", "bar.2"]}},
        dimension="spatial",
    )
    system = compile_scene(
        content, ".", {"bar": massless()}, accept_defects=True, keep_joints=True
    )
    with pytest.raises(SimulationError, match="N719.*bar"):
        linearise(system, about="start")


def test_inertia_is_needed_where_the_frame_of_a_body_moves() -> None:
    """A bar that sags by more than its thickness: without geometric stiffening its SID
    has no inertia left to turn about its long axis. On a wall that does not matter,
    and nothing is said; only what keeps the constraints of the wall cannot start."""
    content = rotor("spatial", "fixed", gravity=G)
    less = content.bodies["bar"].model_copy(update={"quadratic_inertia": False})
    content = content.model_copy(update={"bodies": {"bar": less}})
    sid = bar(3.0, 0.01, stiffened=False)
    system = compile_scene(content, ".", {"bar": sid}, keep_joints=True)
    found = static_equilibrium(system)
    result = found.result()
    assert np.isfinite(result.multipliers).all()
    load = DENSITY * math.pi * 0.01**2 * G
    sag = load * 3.0**4 / (8.0 * STEEL * math.pi * 0.01**4 / 4.0)
    tip = sid.node("2").phi.m0[2] @ found.z[-sid.nq :]
    assert tip == pytest.approx(-sag, rel=1e-3)
    elastic = [float(q) for q in found.z[-sid.nq :]]
    started = content.model_dump(by_alias=True, exclude_none=True, mode="json")
    started["bodies"]["bar"]["initial"] = {"elastic": elastic}
    again = compile_scene(
        validate_data(started, SceneFile), ".", {"bar": sid}, keep_joints=True
    )
    with pytest.raises(SimulationError, match="t = 0 s: N307 bar"):
        simulate(again)
    run = simulate(compile_scene(validate_data(started, SceneFile), ".", {"bar": sid}))
    assert run.completed
    assert "N703" not in codes(result)


def test_an_equilibrium_without_inertia_is_no_start() -> None:
    """The same bar on a hinge along it: it may turn about its long axis, about which
    the bent bar has no positive inertia. What is said of `simulate` is true."""
    content = rotor("spatial", "revolute", spring=1.0, gravity=G)
    table = content.model_dump(by_alias=True, exclude_none=True, mode="json")
    table["joints"]["hub"]["axis"] = [1.0, 0.0, 0.0]
    for quadratic in (True, False):
        table["bodies"]["bar"]["quadratic_inertia"] = quadratic
        described = validate_data(table, SceneFile)
        sids = {"bar": bar(3.0, 0.01, stiffened=False)}
        system = compile_scene(described, ".", sids, keep_joints=True)
        found = static_equilibrium(system)
        assert ("N703" in codes(found)) != quadratic
        elastic = [float(q) for q in found.z[-sids["bar"].nq :]]
        start = described.with_({"bodies.bar.initial": {"elastic": elastic}})
        started = compile_scene(start.with_({"time.end": 1e-3}), ".", sids)
        if quadratic:
            assert simulate(started).completed
        else:
            with pytest.raises(SimulationError, match="t = 0 s"):
                simulate(started)


@pytest.mark.parametrize("start", [0.4, -0.3])
def test_inverse_dynamics_stops_where_forces_are_not_determined(start: float) -> None:
    """Crank and rod of the same length reach the dead point at an output time."""
    end = 1.0 / 0.9
    rate = (0.5 * math.pi - start) / (0.9 * end)
    drive = polynomial(start, rate)
    content = slider_crank(start, speeds=(rate, -rate), drive=drive, end=end).scene
    system = compile_scene(content, keep_joints=True)
    with pytest.raises(SimulationError, match="N310") as failure:
        inverse_dynamics(system)
    result = failure.value.result
    assert result is not None and not result.completed
    assert 80 < len(result.t) <= 90 and result.t[-1] < 1.0
    assert np.isfinite(result.multipliers).all()
    assert result["piston.x"] == pytest.approx(2 * np.cos(start + rate * result.t))


def test_inverse_dynamics_asks_for_no_inertia() -> None:
    """Prescribed completely, a body moves as it is told however little it weighs."""
    content = scene(
        {"rod": slender_rod(1.0, 2.0), "ghost": {"mass": 1e-30}},
        {
            "hinge": {"type": "revolute", "markers": ["ground", "rod.a"]},
            "tip": {"type": "coincident", "markers": ["rod.b", "ghost"]},
        },
        {"turn": {"joint": "hinge", "function": polynomial(0.2, 3.0, 1.5)}},
        record=["turn.mz", "hinge.fx", "tip.fy"],
        gravity=[0.0, -G],
    )
    found = inverse_dynamics(compile_scene(content, keep_joints=True))
    angle = 0.2 + 3.0 * found.t + 1.5 * found.t**2
    torque = 2.0 / 3.0 * 3.0 + 2.0 * G * 0.5 * np.cos(angle)
    assert found["turn.mz"] == pytest.approx(torque, rel=1e-9)
