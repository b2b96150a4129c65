"""Mechanisms of many constraints: random ones with closed loops, ladders, chains."""

from __future__ import annotations

from typing import Any

import numpy as np

from sidtool.formats.scene import SceneFile
from sidtool.solver.system.system import System
from tests.solver.scenes import compiled, scene, slender_rod

#: Length of the links of a chain.
LINK = 0.1


def network(seed: int, space: bool) -> System:
    """A tree of links, loops that leave it at least one motion, and joints that are
    said twice, at random. In space all axes are parallel: each loop has three
    constraints too many."""
    rng = np.random.default_rng(seed)
    count, axes = int(rng.integers(5, 11)), 3 if space else 2
    places = rng.uniform(-1.0, 1.0, (count, axes))
    markers: list[dict[str, Any]] = [{} for _ in range(count)]
    ground: dict[str, Any] = {}
    joints: dict[str, Any] = {}

    def marker(body: int, place: np.ndarray) -> str:
        own = ground if body < 0 else markers[body]
        here = place if body < 0 else place - places[body]
        own[f"m{len(own)}"] = {"position": here.tolist()}
        return f"{'ground' if body < 0 else f'b{body}'}.m{len(own) - 1}"

    def pin(a: int, b: int) -> None:
        place = rng.uniform(-1.0, 1.0, axes)
        found = {"type": "revolute", "markers": [marker(a, place), marker(b, place)]}
        joints[f"j{len(joints)}"] = found

    for body in range(count):
        pin(int(rng.integers(-1, body)), body)
    for _ in range(int(rng.integers(0, 1 + (count - 1) // 2))):
        pin(*(int(b) for b in rng.choice(count, 2, replace=False)))
    for name in rng.choice(list(joints), int(rng.integers(0, 3)), replace=False):
        joints[f"again_{name}"] = joints[str(name)]
    bodies = {
        f"b{k}": {
            "mass": float(rng.uniform(0.5, 2.0)),
            "inertia": [0.1, 0.2, 0.3] if space else 0.1,
            "markers": markers[k],
            "initial": {"position": places[k].tolist()},
        }
        for k in range(count)
    }
    table = {"markers": ground}
    return compiled(
        scene(bodies, joints, ground=table, dimension="spatial" if space else "planar")
    )


def ladder(cells: int, space: bool = False, **initial: Any) -> System:
    """Two rails of links that are pinned to each other, and rungs between them.

    In space all axes are parallel: each cell has three constraints too many.

    initial : of the first link, beside its place
    """
    bodies: dict[str, Any] = {}
    joints: dict[str, Any] = {}

    def vector(x: float, y: float) -> list[float]:
        return [x, y, 0.0] if space else [x, y]

    half = {"a": {"position": vector(-0.5, 0.0)}, "b": {"position": vector(0.5, 0.0)}}

    def bar(name: str, x: float, y: float, angle: float = 0.0) -> None:
        turn = {"axis_angle": [0.0, 0.0, angle]} if space else {"angle": angle}
        bodies[name] = {
            "mass": 1.0,
            "inertia": [0.01, 1 / 12, 1 / 12] if space else 1 / 12,
            "markers": half,
            "initial": {"position": vector(x, y), **turn},
        }

    def pin(a: str, b: str) -> None:
        joints[f"p{len(joints)}"] = {"type": "revolute", "markers": [a, b]}

    low, up = "ground.low", "ground.up"
    for k in range(cells):
        bar(f"low{k}", k + 0.5, 0.0)
        bar(f"up{k}", k + 0.5, 1.0)
        bar(f"rung{k}", k + 1.0, 0.5, np.pi / 2)
        pin(low, f"low{k}.a")
        pin(up, f"up{k}.a")
        low, up = f"low{k}.b", f"up{k}.b"
        pin(low, f"rung{k}.a")
        pin(up, f"rung{k}.b")
    bodies["low0"]["initial"] |= initial
    ends = {
        name: {"position": vector(0.0, y)} for name, y in (("low", 0.0), ("up", 1.0))
    }
    return compiled(
        scene(
            bodies,
            joints,
            ground={"markers": ends},
            dimension="spatial" if space else "planar",
        )
    )


def hanging_chain(count: int, **more: Any) -> SceneFile:
    """A straight chain of links, hinged to the ground at its first end."""
    bodies = {
        f"l{k}": slender_rod(LINK, 0.1, position=[k * LINK, 0.0]) for k in range(count)
    }
    pairs = [(f"l{k - 1}.b", f"l{k}.a") for k in range(1, count)]
    hinges = [("ground", "l0.a"), *pairs]
    joints = {
        f"j{k}": {"type": "revolute", "markers": list(ends)}
        for k, ends in enumerate(hinges)
    }
    return scene(bodies, joints | more.pop("joints", {}), **more)
