"""Five flexible machines beside Exudyn: ratio of the times at equal error."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene
from sidtool.solver.system.system import System
from sidtool.study import Setting

from . import scenes
from .machine import describe_machine
from .peers.exudyn_scene import ExudynSettings, run as solve
from .precision import (
    Run,
    at_equal_error,
    errors_of,
    line,
    own_runs,
    runs_table,
    settled,
    truth_of,
)
from .report import Report, Table

WANTED = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
RTOLS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
#: Fixed steps of an output step of sidtool, and tolerances of its Newton iteration.
OWN_STEPS, OWN_TOLERANCES = (1, 2, 5, 10, 20), (1e-3, 1e-5)
#: Integrators of sidtool with error control, and with fixed steps: the others resolve
#: vibrations that positions do not show.
CONTROLLED = ("radau5", "radau9", "radau13")
FIXED = ("generalised_alpha", "trapezoidal", "radau5", "radau9")
#: Steps of an output step, and tolerances of Newton's iteration, of Exudyn.
STEPS = (1, 2, 5, 10, 20, 50, 100, 200)
TOLERANCES = (1e-3, 1e-5, 1e-8)
#: Exudyn gets no finer step after a run of so many seconds.
LONGEST = 5.0
NAME = "Exudyn generalised-alpha"
STEEL = {"youngs_modulus": 2.1e11, "poissons_ratio": 0.3, "density": 7850.0}


@dataclass(frozen=True)
class Machine:
    """A scene as a table, and the SIDs of its flexible bodies by their names."""

    title: str
    scene: dict[str, Any]
    sids: Mapping[str, SID]

    def tables(self, quadratic_inertia: bool) -> SceneFile:
        table = json.loads(json.dumps(self.scene))
        for name in self.sids:
            table["bodies"][name]["sid"] = "given"
            if quadratic_inertia:
                table["bodies"][name]["quadratic_inertia"] = True
        return SceneFile.model_validate(table)

    @property
    def every(self) -> float:
        """Time between outputs [s]."""
        return float(self.scene["time"]["output_step"])

    def system(self, quadratic_inertia: bool = False) -> System:
        return compile_scene(
            self.tables(quadratic_inertia), Path.cwd(), dict(self.sids)
        )


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Measure the machines one after the other, both programs by turns."""
    tables = list[Table]()
    for make in (arm, rotor, chain, satellite, four_bar):
        machine = make()
        say(f" {machine.title}")
        tables += _tables(machine, say)
    return Report(
        title="Flexible machines beside Exudyn",
        tables=tables,
        remarks=[
            "Error: greatest deviation of a recorded position over its greatest value, "
            "the worst of all. Exudyn keeps the moments of inertia quadratic in the "
            "elastic coordinates and is compared with a reference that does, too; its "
            "equations are solved dense or sparse, whichever is faster."
        ],
        machine=describe_machine(),
    )


def _tables(machine: Machine, say: Callable[[str], None]) -> Iterator[Table]:
    system = machine.system()
    truth, uncertainty = truth_of(system)
    every = machine.every
    settings = [Setting(name, rtol=rtol) for name in CONTROLLED for rtol in RTOLS]
    settings += [
        Setting(name, rtol, every / count)
        for name in FIXED
        for count in OWN_STEPS
        for rtol in OWN_TOLERANCES
    ]
    runs = [_worst(one) for one in own_runs(system, truth, say, settings)]
    runs += [_worst(one) for one in _exudyn_runs(machine, say)]
    runs = settled(runs, WANTED)
    caption = (
        f"{machine.title}: seconds to reach an error, and how many times as long "
        "Exudyn takes with its best setting. "
        f"The reference is good to {uncertainty:.0e}."
    )
    yield at_equal_error(runs, WANTED, (NAME,), caption)
    yield runs_table(runs, ("position",), f"{machine.title}: runs worth their time.")


def _worst(one: Run) -> Run:
    return Run(one.method, one.setting, (max(one.errors),), one.seconds, one.again)


def _exudyn_runs(machine: Machine, say: Callable[[str], None]) -> Iterator[Run]:
    """Runs with the linear solver that is faster with the first step."""
    truth, _ = truth_of(machine.system(quadratic_inertia=True))
    scene = machine.tables(quadratic_inertia=True)
    every = machine.every

    def tried(settings: ExudynSettings) -> tuple[dict[str, Array], float]:
        return solve(scene, machine.sids, settings)

    try:
        seconds = {
            sparse: tried(ExudynSettings(every / 10, 1e-5, sparse))[1]
            for sparse in (False, True)
        }
    except ImportError:
        say("Exudyn is not installed: left out")
        return
    sparse = min(seconds, key=lambda key: seconds[key])
    for steps in STEPS:
        longest = 0.0
        for tolerance in TOLERANCES:
            settings = ExudynSettings(every / steps, tolerance, sparse)
            try:
                values, seconds_of_run = tried(settings)
            except RuntimeError as failure:
                say(f"  {failure}")
                continue
            longest = max(longest, seconds_of_run)
            setting = f"{settings.step:g} s, {tolerance:.0e}"
            again = lambda settings=settings: tried(settings)[1]  # noqa: E731
            made = Run(NAME, setting, errors_of(values, truth), seconds_of_run, again)
            say(line(made))
            yield made
        if longest > LONGEST:
            return


def _scene(title: str, dimension: str, end: float, every: float) -> dict[str, Any]:
    return {
        "format": "sidtool scene",
        "version": 1,
        "title": title,
        "dimension": dimension,
        "time": {"end": end, "output_step": every},
    }


def _converted(**tables: Any) -> SID:
    head = {"format": "sidtool model", "version": 1, "title": "Body"}
    return sid_from_model(ModelFile.model_validate_json(json.dumps(head | tables)))


def _block(
    length: float, width: float, height: float, begin: float = 0.0
) -> dict[str, Any]:
    """A volume along x, the middle of its left face at (begin, 0, 0)."""
    return {
        "type": "nurbs_volume",
        "degrees": [1, 1, 1],
        "knots": [[0, 0, 1, 1]] * 3,
        "control_points": [
            [
                [[x, y, z] for z in (-height / 2, height / 2)]
                for y in (-width / 2, width / 2)
            ]
            for x in (begin, begin + length)
        ],
    }


def solid_bar(
    length: float, width: float, height: float, modes: int, **material: float
) -> SID:
    """A clamped bar of hex20, its free end an interface of Craig and Bampton."""
    centre = {"at": [0.5, 0.5]}
    return _converted(
        material=STEEL | material,
        geometry=_block(length, width, height),
        discretisation={"type": "hex20", "elements": [10, 2, 2]},
        frame={"type": "tangent", "marker": "near", "clamp": "left"},
        markers={
            "near": {"node": 1, "edge": "left", "tie": {"type": "rigid", "to": "left"}}
            | centre,
            "far": {"node": 2, "edge": "right", "tie": {"type": "rigid", "to": "right"}}
            | centre,
        },
        reduction={"method": "craig_bampton", "interfaces": ["far"], "modes": modes},
        damping={"type": "rayleigh", "alpha": 0.0, "beta": 1e-5},
    )


def arm() -> Machine:
    """Two links of solids on hinges about z and y, a load, and a force on it."""
    links = solid_bar(0.8, 0.03, 0.04, 4)
    names = {"near": 1, "far": 2}
    scene = _scene("Spatial arm with links of solids", "spatial", 1.0, 0.01) | {
        "bodies": {
            "base": {
                "mass": 5.0,
                "inertia": [0.05, 0.05, 0.05],
                "markers": {"top": {"position": [0.0, 0.0, 0.1]}},
            },
            "upper": {"markers": names, "initial": {"position": [0.0, 0.0, 0.1]}},
            "fore": {"markers": names, "initial": {"position": [0.8, 0.0, 0.1]}},
            "load": {
                "mass": 4.0,
                "inertia": [0.01, 0.01, 0.01],
                "initial": {"position": [1.6, 0.0, 0.1]},
            },
        },
        "joints": {
            "column": {"type": "revolute", "markers": ["ground", "base"]},
            "shoulder": {
                "type": "revolute",
                "axis": [0.0, 1.0, 0.0],
                "markers": ["base.top", "upper.near"],
            },
            "elbow": {
                "type": "revolute",
                "axis": [0.0, 1.0, 0.0],
                "markers": ["upper.far", "fore.near"],
            },
            "hand": {"type": "fixed", "markers": ["fore.far", "load"]},
        },
        "forces": {
            "pull": {"type": "force", "marker": "load", "force": [-20.0, 30.0, 40.0]}
        },
        "outputs": {"record": ["load.x", "load.y", "load.z"]},
    }
    return Machine(scene["title"], scene, {"upper": links, "fore": links})


def rotor() -> Machine:
    """A disc out of balance on a shaft in two elastic bearings, at 300 rad/s."""
    ends = [0.0, 0.0, 0.0], [0.0, 0.0, 0.6]
    shaft = _converted(
        material=STEEL,
        geometry={
            "type": "beam",
            "start": ends[0],
            "through": [[0.0, 0.0, 0.4]],
            "end": ends[1],
            "y_axis": [1.0, 0.0, 0.0],
            "section": {"shape": "circle", "diameter": 0.025},
        },
        discretisation={"type": "beam", "elements": 12},
        frame={"type": "tangent", "marker": "left", "clamp": "start"},
        markers={
            "left": {"node": 1, "edge": "start"},
            "seat": {"node": 2, "position": [0.0, 0.0, 0.4]},
            "right": {"node": 3, "edge": "end"},
        },
        reduction={
            "method": "craig_bampton",
            "interfaces": ["seat", "right"],
            "modes": 4,
        },
    )
    spin = [0.0, 0.0, 300.0]
    bearing = {
        "type": "bushing",
        "stiffness": [5e6, 5e6, 5e6, 0.0, 0.0, 0.0],
        "damping": [500.0, 500.0, 500.0, 0.0, 0.0, 0.0],
        "shaft": "z",
    }
    scene = _scene(
        "Rotor out of balance in elastic bearings", "spatial", 0.2, 0.001
    ) | {
        "ground": {"markers": {"right": {"position": ends[1]}}},
        "bodies": {
            "shaft": {
                "markers": {"left": 1, "seat": 2, "right": 3},
                "initial": {"angular_velocity": spin},
            },
            "disc": {
                "mass": 10.0,
                "inertia": [0.03, 0.03, 0.05],
                "markers": {"bore": {"position": [-1e-3, 0.0, 0.0]}},
                "initial": {
                    "position": [1e-3, 0.0, 0.4],
                    "velocity": [0.0, 0.3, 0.0],
                    "angular_velocity": spin,
                },
            },
        },
        "joints": {"seat": {"type": "fixed", "markers": ["shaft.seat", "disc.bore"]}},
        "forces": {
            "left": bearing | {"markers": ["ground", "shaft.left"]},
            "right": bearing | {"markers": ["ground.right", "shaft.right"]},
        },
        "outputs": {"record": ["disc.x", "disc.y", "shaft.right.x"]},
    }
    return Machine(scene["title"], scene, {"shaft": shaft})


def chain(links: int = 100) -> Machine:
    """Flexible links with four modes, which fall from the horizontal."""
    names = [f"link{i}" for i in range(links)]
    ends = ["ground", *(f"{name}.b" for name in names)]
    scene = _scene(f"Chain of {links} flexible links", "planar", 1.0, 0.01) | {
        "gravity": [0.0, -scenes.GRAVITY],
        "bodies": {
            name: {
                "markers": {"a": 1, "b": 2},
                "initial": {"position": [0.2 * i, 0.0]},
            }
            for i, name in enumerate(names)
        },
        "joints": {
            f"pin{i}": {"type": "revolute", "markers": [ends[i], f"{name}.a"]}
            for i, name in enumerate(names)
        },
        "outputs": {"record": [f"{names[k]}.b.y" for k in (4, 19)]},
    }
    return Machine(scene["title"], scene, dict.fromkeys(names, scenes.link()))


def satellite() -> Machine:
    """A spinning hub with a panel of 20 shape functions on either side."""
    panels = {
        name: _converted(
            material={"youngs_modulus": 2e9, "poissons_ratio": 0.3, "density": 120.0},
            geometry=_block(2.5, 0.8, 0.02, begin),
            discretisation={"type": "hex20", "elements": [10, 3, 1]},
            frame={"type": "tangent", "marker": "hinge", "clamp": inner},
            markers={
                "hinge": {"node": 1, "edge": inner, "at": [0.5, 0.5]},
                "end": {"node": 2, "edge": name, "at": [1.0, 0.5]},
            },
            reduction={"method": "modal", "modes": 20},
            damping={"type": "rayleigh", "alpha": 0.0, "beta": 2e-4},
        )
        for name, inner, begin in (("right", "left", 0.0), ("left", "right", -2.5))
    }
    spin = [0.1, 0.3, 0.6]
    bodies: dict[str, Any] = {
        "hub": {
            "mass": 400.0,
            "inertia": [90.0, 80.0, 100.0],
            "markers": {
                "right": {"position": [0.6, 0.0, 0.0]},
                "left": {"position": [-0.6, 0.0, 0.0]},
            },
            "initial": {"angular_velocity": spin},
        }
    }
    joints, outputs = {}, list[str]()
    for name in panels:
        place = np.array(bodies["hub"]["markers"][name]["position"])
        bodies[name] = {
            "markers": {"hinge": 1, "end": 2},
            "initial": {
                "position": place.tolist(),
                "velocity": np.cross(spin, place).tolist(),
                "angular_velocity": spin,
            },
        }
        joints[f"{name}_hinge"] = {
            "type": "fixed",
            "markers": [f"hub.{name}", f"{name}.hinge"],
        }
        outputs += [f"{name}.end.{axis}" for axis in "xyz"]
    title = "Satellite with 40 shape functions"
    scene = _scene(title, "spatial", 4.0, 0.05) | {
        "bodies": bodies,
        "joints": joints,
        "forces": {
            "jet": {"type": "force", "marker": "hub", "force": [0.0, 20.0, 50.0]}
        },
        "outputs": {"record": outputs},
    }
    return Machine(title, scene, panels)


def four_bar() -> Machine:
    """A coupler with 100 shape functions between a crank and a rocker under gravity."""
    scene = _scene("Four-bar with 100 shape functions", "planar", 1.0, 0.01) | {
        "gravity": [0.0, -scenes.GRAVITY],
        "ground": {"markers": {"rocker": {"position": [1.0, 0.0]}}},
        "bodies": {
            "crank": {
                "mass": 1.0,
                "inertia": 0.01,
                "markers": {
                    "low": {"position": [0.0, -0.15]},
                    "high": {"position": [0.0, 0.15]},
                },
                "initial": {"position": [0.0, 0.15]},
            },
            "coupler": {
                "markers": {"left": 1, "right": 2},
                "initial": {"position": [0.0, 0.3]},
            },
            "rocker": {
                "mass": 1.5,
                "inertia": 0.02,
                "markers": {
                    "low": {"position": [0.0, -0.15]},
                    "high": {"position": [0.0, 0.15]},
                    "centre": {"position": [0.0, 0.0]},
                },
                "initial": {"position": [1.0, 0.15]},
            },
        },
        "joints": {
            "bearing": {"type": "revolute", "markers": ["ground", "crank.low"]},
            "crank_pin": {
                "type": "revolute",
                "markers": ["crank.high", "coupler.left"],
            },
            "rocker_pin": {
                "type": "revolute",
                "markers": ["coupler.right", "rocker.high"],
            },
            "pivot": {"type": "revolute", "markers": ["rocker.low", "ground.rocker"]},
        },
        "forces": {
            "pull": {"type": "force", "marker": "rocker.centre", "force": [30.0, 0.0]}
        },
        "outputs": {"record": ["coupler.left.x", "coupler.right.y"]},
    }
    return Machine(scene["title"], scene, {"coupler": scenes.rod(100)})
