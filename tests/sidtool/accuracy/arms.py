"""Flexible arms in short scenes, for tests of accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import sidtool
from sidtool.accuracy.mesh_choice import RefinedBodies, refine_bodies
from sidtool.accuracy.reference_run import Reference, make_reference
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.scene import SceneFile
from sidtool.measurement.candidates import finest_model as scene_finest
from sidtool.measurement.request import requested
from sidtool.measurement.runs import Runs
from sidtool.pipeline.model_cache import Refinement
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.pipeline.scene_models import body_models
from sidtool.solver import compile_scene
from sidtool.solver.system.system import System
from tests.bodies import particle_body

from ..beams import beam

TIGHT = {"integrator": "dop853", "rtol": 1e-12}


@cache
def cantilever(modes: int = 3, *, stiffened: bool = False) -> SID:
    """Length, mass and bending stiffness of one; first frequency 3.516 rad/s."""
    mesh = {"type": "iga", "degrees": [3, 2], "elements": [10, 1]}
    more: dict[str, Any] = {"stiffening": {}} if stiffened else {}
    reduction = {"method": "modal", "modes": modes}
    return sid_from_model(beam(mesh, reduction=reduction, **more))


def spun(speed: float, within: float, **changes: Any) -> SceneFile:
    """An arm whose root is turned from rest to a speed [rad/s] within a time [s]."""
    content: dict[str, Any] = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": 1.2 * within, "output_step": within / 25},
        "bodies": {"arm": {"sid": "arm", "markers": {"root": 1, "tip": 2}}},
        "joints": {"hub": {"type": "revolute", "markers": ["ground", "arm.root"]}},
        "drives": {
            "spin": {
                "joint": "hub",
                "function": {
                    "type": "sine_ramp",
                    "of": "rate",
                    "start": 0.0,
                    "end": speed,
                    "from": 0.0,
                    "to": within,
                },
            }
        },
        "outputs": {"record": ["arm.tip.uy", "arm.tip.x", "hub.mz"]},
    }
    return SceneFile.model_validate(content | changes)


def swinging(end: float = 0.8, **changes: Any) -> SceneFile:
    """An arm that hangs on a pin and falls from level."""
    content: dict[str, Any] = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "gravity": [0.0, -0.3],
        "time": {"end": end, "output_step": end / 20},
        "bodies": {"arm": {"sid": "arm", "markers": {"root": 1, "tip": 2}}},
        "joints": {"pin": {"type": "revolute", "markers": ["ground", "arm.root"]}},
        "outputs": {"record": ["arm.tip.x", "arm.tip.y", "pin.fx"]},
    }
    return SceneFile.model_validate(content | changes)


def simulated(scene: SceneFile, sid: SID, **more: Any) -> sidtool.Result:
    return sidtool.simulate(scene, sids={"arm": sid}, **more)


def reference_of(scene: SceneFile, sids: Mapping[str, SID], wanted: float) -> Reference:
    """What a search measures errors against."""

    def compiled(content: SceneFile, sids: Mapping[str, SID]) -> System:
        return compile_scene(content, ".", sids)

    request = requested(scene, sids, wanted)
    runs = Runs(scene, sids, compiled, request.names)
    return make_reference(runs, scene_finest(scene, sids), request)


def refined(scene: SceneFile, wanted: Any) -> RefinedBodies:
    """The bodies of a search, without what it chooses among their shape functions."""
    models = body_models(scene, Path())
    sids = {name: model.sid(Refinement()).sid for name, model in models.items()}

    def compiled(content: SceneFile, found: Any) -> Any:
        return compile_scene(content, ".", found)

    return refine_bodies(scene, sids, models, requested(scene, sids, wanted), compiled)


def particles(spatial: bool) -> tuple[SceneFile, SID]:
    """A cloud of particles, soft and stiff shape functions, thrown about a pin."""
    sid = particle_body(4, 9, planar=not spatial, seed=5)
    Ke = np.diag([4e3, 9e3, 6e5, 5e6])
    sid = replace(sid, Ke=Taylor(Ke), De=Taylor(2e-4 * Ke))
    spin = [0.5, 1.0, 3.0] if spatial else 3.0
    scene = swinging(
        0.4,
        dimension="spatial" if spatial else "planar",
        gravity=[0.0, -9.81, 0.0] if spatial else [0.0, -9.81],
        bodies={
            "arm": {
                "sid": "arm",
                "markers": {"root": 1, "tip": 2},
                "initial": {"angular_velocity": spin},
            }
        },
        joints={
            "pin": {
                "type": "spherical" if spatial else "revolute",
                "markers": ["ground", "arm.root"],
            }
        },
    )
    return scene, sid


def finest(scene: SceneFile) -> SceneFile:
    """With every term that its bodies have."""
    bodies = {
        n: b.model_copy(update={"quadratic_inertia": True})
        for n, b in scene.bodies.items()
    }
    return scene.model_copy(update={"bodies": bodies})
