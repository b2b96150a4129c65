"""A scene with its SIDs and callables in memory, and what is measured of its runs.

A measure is named OWNER.KIND or OWNER.MARKER.KIND. Vectors have three components in
the plane as well, so that runs in plane and space compare.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, output_times
from sidtool.solver import compile_scene, simulate
from sidtool.solver.functions.callables import Derivatives
from sidtool.solver.system.system import System
from tests.bodies import Cloud

Table = dict[str, Any]
#: Courses (nt, components) of measures.
Values = dict[str, Array]

#: Outputs of each kind of vector.
VECTORS = {
    "x": ("x", "y", "z"),
    "v": ("vx", "vy", "vz"),
    "a": ("ax", "ay", "az"),
    "u": ("ux", "uy", "uz"),
    "w": ("wx", "wy", "wz"),
    "f": ("fx", "fy", "fz"),
    "m": ("mx", "my", "mz"),
}
#: Those that have the last component alone in the plane.
AXIAL = ("w", "m")


@dataclass(frozen=True, eq=False)
class Case:
    """A scene as a table, SIDs and their particles by body, callables, and measures.

    halved : how often its drives were halved, for loops to follow them
    """

    table: Table
    sids: Mapping[str, SID] = field(default_factory=dict)
    measures: tuple[str, ...] = ()
    drives: Mapping[str, Derivatives] = field(default_factory=dict)
    forces: Mapping[str, Derivatives] = field(default_factory=dict)
    clouds: Mapping[str, Cloud] = field(default_factory=dict)
    halved: int = 0

    @property
    def planar(self) -> bool:
        return bool(self.table["dimension"] == "planar")

    def body(self, name: str) -> Table:
        found: Table = self.table["bodies"][name]
        return found

    def is_flexible(self, name: str) -> bool:
        return name != "ground" and "sid" in self.body(name)

    def node(self, text: str) -> str:
        """Node of a flexible body that a marker BODY.MARKER is."""
        body, marker = text.split(".")
        return str(self.body(body)["markers"].get(marker, marker))


def components(case: Case, measure: str) -> list[str | None]:
    """Outputs that are the components of a measure; None is zero."""
    owner, kind = measure.rsplit(".", 1)
    if kind in VECTORS:
        missing = () if not case.planar else (0, 1) if kind in AXIAL else (2,)
        return [
            None if k in missing else f"{owner}.{name}"
            for k, name in enumerate(VECTORS[kind])
        ]
    if kind in ("q", "vq"):
        return [f"{owner}.{kind}{k + 1}" for k in range(case.sids[owner].nq)]
    return [measure]


def scene_of(case: Case) -> SceneFile:
    names = [components(case, measure) for measure in case.measures]
    record = list(dict.fromkeys(n for part in names for n in part if n))
    return SceneFile.model_validate(case.table | {"outputs": {"record": record}})


def compiled(case: Case, *, keep_joints: bool = False) -> System:
    return compile_scene(
        scene_of(case),
        sids=case.sids,
        keep_joints=keep_joints,
        drives=case.drives,
        forces=case.forces,
    )


def measured(case: Case, result: Result) -> Values:
    """The measures of a case out of a result."""
    zero = np.zeros(len(result.t))
    return {
        measure: np.stack(
            [zero if name is None else result[name] for name in names], axis=1
        )
        if names
        else np.zeros((len(result.t), 0))
        for measure in case.measures
        for names in [components(case, measure)]
    }


def run(case: Case, *, keep_joints: bool = False, **settings: Any) -> Values:
    """What a run of the case measures.

    Raises
    ------
    SimulationError : the run stopped early.
    """
    result = simulate(compiled(case, keep_joints=keep_joints), **settings)
    return measured(case, result)


def times(case: Case) -> Array:
    return output_times(scene_of(case))
