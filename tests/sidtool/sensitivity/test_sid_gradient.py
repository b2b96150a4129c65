"""Gradients by all numbers of a SID: each block against neighbouring systems."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.api.motion_problem import RunOptions
from sidtool.api.sensitivity import parse_problem
from sidtool.formats.base.sid import BLOCK_SHAPES, SID, Array, Node, Taylor
from sidtool.solver.simulation.linearised_run import LinearisedRun
from sidtool.solver.simulation.motion_derivatives import MotionDerivatives
from sidtool.solver.simulation.sid_gradient import sid_gradient
from tests.solver.scenes import soft_body

#: Affine in all blocks but in products of shape functions, so that steps may be large.
STEP = 1e-4
SHAPES = "origin", "phi", "psi"
WITH_M1 = "J", "Cr", "Oe"


def scene(planar: bool, **body: Any) -> sidtool.Scene:
    """A flexible body on a joint, with a body at its end that a spring pulls."""
    axes = 2 if planar else 3
    turning = 4.0 if planar else [3.0, 4.0, -2.0]
    bob = {"mass": 0.5, "inertia": 0.05 if planar else [0.05, 0.04, 0.03]}
    joint = "revolute" if planar else "spherical"
    return sidtool.Scene(
        dimension="planar" if planar else "spatial",
        gravity=[0.0, -9.81, 0.0][:axes],
        time={"end": 0.2, "output_step": 0.1},
        accuracy={"step": 0.04, "integrator": "radau5"},
        bodies={
            "soft": {
                "sid": "soft",
                "markers": {"foot": "1", "end": "2"},
                "initial": {
                    "angular_velocity": turning,
                    "elastic": [0.02, -0.03, 0.01],
                    "elastic_velocity": [0.3, 0.2, -0.4],
                },
            }
            | body,
            "bob": bob,
        },
        joints={
            "pin": {"type": joint, "markers": ["ground", "soft.foot"]},
            "flange": {"type": "fixed", "markers": ["soft.end", "bob"]},
        },
        forces={
            "spring": {
                "type": "spring_damper",
                "markers": ["ground", "bob"],
                "rest": 0.2,
                "stiffness": 30.0,
                "damping": 1.0,
            }
        },
    )


def random_like(values: Array, rng: np.random.Generator) -> Array:
    size = np.abs(values).max(initial=0.0)
    return rng.uniform(-1.0, 1.0, values.shape) * (values != 0.0) * size


def direction(sid: SID, block: str, m1: bool = False) -> SID:
    """Random derivatives of one block, or of its first-order term; others are 0."""
    rng = np.random.default_rng(5)
    blocks = {}
    for name in BLOCK_SHAPES:
        term, on = getattr(sid, name), float(name == block)
        m0 = random_like(term.m0, rng) * on * (not m1)
        if name in ("Me", "Ke", "De"):
            m0 = m0 + m0.T
        first = None
        if term.m1 is not None:
            first = random_like(term.m1, rng) * on * m1
            if name == "Cr":
                first = first - first.transpose(1, 0, 2)
        blocks[name] = Taylor(m0, first)
    nodes = []
    for node in sid.nodes:
        parts = {
            name: Taylor(random_like(getattr(node, name).m0, rng) * (name == block))
            for name in SHAPES
        }
        nodes.append(Node(node.id, AP=Taylor(np.zeros((3, 3))), **parts))
    mass = sid.mass * (block == "mass")
    return replace(sid, mass=mass, nodes=tuple(nodes), **blocks)


def moved(sid: SID, by: SID, step: float) -> SID:
    def added(one: Taylor, other: Taylor) -> Taylor:
        m1 = one.m1
        if m1 is not None and other.m1 is not None:
            m1 = m1 + step * other.m1
        return Taylor(one.m0 + step * other.m0, m1)

    blocks = {n: added(getattr(sid, n), getattr(by, n)) for n in BLOCK_SHAPES}
    nodes = tuple(
        replace(one, **{n: added(getattr(one, n), getattr(other, n)) for n in SHAPES})
        for one, other in zip(sid.nodes, by.nodes, strict=True)
    )
    return replace(sid, mass=sid.mass + step * by.mass, nodes=nodes, **blocks)


@pytest.mark.parametrize(
    ("planar", "body"),
    [
        (True, {}),
        (False, {"quadratic_inertia": False}),
        (False, {"quadratic_inertia": True}),
        (False, {"shape_functions": [1, 3], "quadratic_inertia": False}),
    ],
    ids=["plane", "space", "quadratic", "selected"],
)
@pytest.mark.filterwarnings("ignore::sidtool.DiagnosticWarning")
def test_each_block_against_neighbouring_systems(
    planar: bool, body: dict[str, Any]
) -> None:
    """The derivative through the motion alone, for any seeds."""
    sid = soft_body(3, 4, planar=planar)
    content = scene(planar, **body)
    if "shape_functions" in body:
        initial = {"soft.initial.elastic": None, "soft.initial.elastic_velocity": None}
        content = content.with_(initial)
    options = RunOptions(sids={"soft": sid}, method="adjoint")
    problem = parse_problem(content, "bob.mass", "final(bob.x)", options)
    point = problem.at(problem.x0)
    assert point.history is not None and point.grid is not None
    run = LinearisedRun(point.history.motion, point.grid)
    derivatives = MotionDerivatives(run)
    count = len(run.motion.steps.t)
    shape = count, run.nz + run.nv, 2
    gradient = derivatives.adjoint(np.random.default_rng(0).standard_normal(shape))
    found = sid_gradient(derivatives, gradient, "soft")
    names = [(name, False) for name in ("mass", *BLOCK_SHAPES, *SHAPES)]
    largest = 0.0
    for name, m1 in [*names, *((name, True) for name in WITH_M1)]:
        by = direction(sid, name, m1)
        systems = [
            problem.compiled.system_with({}, {"soft": moved(sid, by, e)})
            for e in (STEP, -STEP)
        ]
        change = derivatives.parameter_change((systems[0], systems[1]), STEP, 1.0)
        change = replace(change, start=np.zeros_like(change.start))
        expected = gradient.along(change)
        scale = np.abs(gradient.residual * change.residual[:, :, None]).sum(axis=(0, 1))
        scale += 1e-6 * largest
        assert (np.abs(found.along(by) - expected) <= 1e-8 * scale).all(), (name, m1)
        largest = max(largest, scale.max())
