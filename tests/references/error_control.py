"""Three published problems with recorded motion, and the error of a run of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.solver import compile_scene, simulate
from sidtool.solver.system.system import System
from tests.places import SLIDER_CRANK

from . import test_andrews, test_simeon


def _founding() -> System:
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    return compile_scene(scene, SLIDER_CRANK)


def _simeon() -> System:
    scene = _recorded(test_simeon.scene(True), 0.001, list(test_simeon.END))
    bodies = {"rod": test_simeon.connecting_rod()}
    return compile_scene(scene, ".", bodies, accept_defects=True)


def _andrews() -> System:
    angles = [f"{name}.angle" for name in test_andrews.BODIES]
    return compile_scene(_recorded(test_andrews.squeezer(), 0.0003, angles))


def _recorded(scene: SceneFile, every: float, names: list[str]) -> SceneFile:
    table: dict[str, Any] = scene.model_dump(by_alias=True, exclude_none=True)
    table["time"] = {"end": table["time"]["end"], "output_step": every}
    table["outputs"] = {"record": names}
    return SceneFile.model_validate(table)


CASES: dict[str, Callable[[], System]] = {
    "founding": _founding,
    "Simeon": _simeon,
    "Andrews": _andrews,
}


@cache
def compiled(case: str) -> System:
    return CASES[case]()


@cache
def reference(case: str) -> Result:
    """A run of order 13 that is more accurate than any that is measured."""
    return simulate(compiled(case), integrator="radau13", rtol=1e-12)


def relative_error(case: str, result: Result) -> float:
    """The largest error of positions: of elastic coordinates relative to the largest of
    them, of places to the size of the mechanism, of angles to a radian.

    A run that stopped early is compared as far as it went, without the state in which
    it stopped.
    """
    exact = reference(case)
    count = int(np.isin(result.t, exact.t).sum())
    deformation = [np.abs(exact[n]).max() for n in exact.names if ".q" in n]
    sizes = {"q": max(deformation, default=1.0), "x": compiled(case).length}
    errors = []
    for name in exact.names:
        quantity = name.split(".")[1]
        if quantity.startswith("v"):
            continue
        size = sizes.get(quantity[0], 1.0)
        off = result[name][:count] - exact[name][:count]
        errors.append(float(np.abs(off).max()) / size)
    return max(errors)
