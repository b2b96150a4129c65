"""sidtool: flexible bodies for multibody simulation, from finite elements to motion.

    import sidtool
    sid = sidtool.convert("rod_q4.toml")
    sidtool.write("rod.SID_FEM", sid)
    scene = sidtool.Scene.load("slider_crank.toml").with_({"time.end": 1.0})
    result = scene.simulate(sids={"rod": sid})
    result["piston.x"]

A scene in Python is made of the tables that its file has, `Model` likewise:

    sidtool.Scene(
        dimension="planar",
        gravity=[0.0, -9.81],
        time=sidtool.Time(end=2.0, output_step=0.01),
        bodies={"bob": sidtool.RigidBody(mass=1.0, initial={"position": [1.0, 0.0]})},
        joints={"string": sidtool.Distance(markers=["ground", "bob"])},
        outputs=sidtool.Outputs(record=["bob.*"]),
    ).save("pendulum.toml")

Bad input raises `sidtool.InputError`. Everything is imported on first use.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

# `setup.py` puts formats/ and solver/ into the installed package. In a clone they stand
# beside it, and are found there without an installation, too.
_CLONE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
if all(
    os.path.isfile(f"{_CLONE}/{name}/__init__.py") for name in ("formats", "solver")
):
    __path__.append(_CLONE)

if TYPE_CHECKING:
    from sidtool.formats.errors import InputError as InputError
    from sidtool.formats.errors import ValidityWarning as ValidityWarning
    from sidtool.formats.sid import SID as SID
    from sidtool.solver.errors import SimulationError as SimulationError
    from sidtool.solver.functions.callables import Timed as Timed
    from sidtool.solver.functions.laws import Law as Law

    from .afterwards import outputs as outputs
    from .analysing import inverse_dynamics as inverse_dynamics
    from .analysing import linearise as linearise
    from .analysing import static_equilibrium as static_equilibrium
    from .api import compare as compare
    from .api import convert as convert
    from .api import repair as repair
    from .api import simulate as simulate
    from .api import validate as validate
    from .api import write as write
    from .compiled import CompiledScene as CompiledScene
    from .conversion.building import sid_from_blocks as sid_from_blocks
    from .conversion.building import sid_from_shapes as sid_from_shapes
    from .interrupting import Interrupted as Interrupted
    from .kinds import read as read
    from .results import Result as Result
    from .scenes import Model as Model
    from .scenes import Scene as Scene
    from .study.asked import study as study
    from .sweep.asked import sweep as sweep
    from .view.animating import animate as animate
    from .view.peaks import peak_stresses as peak_stresses
    from .vocabulary import *  # noqa: F403

#: Tables of scenes and models; see `vocabulary`.
_TABLES = """
    Accuracy Actuator AttachmentReduction BeamDiscretisation BeamGeometry
    Box BuckensFrame Bushing Characteristic ChordFrame Coincident Constant Coupling
    CraigBamptonReduction Cylinder Cylindrical Distance Drive ElasticInitial Event
    Expression Fixed FrequencyDamping Friction Gear GeneralSection Given Ground
    Harmonic HertingReduction IgaDiscretisation Initial JointFriction
    KrylovReduction LumpedMass Marker Material MatricesDiscretisation
    MatricesGeometry MeshDiscretisation MeshGeometry ModalDamping ModalReduction
    NodeMarker NurbsGeometry Outputs PatchesGeometry Pid Piece PlanarJoint
    PointForce PointOnLine PointOnPlane Polynomial Prestress Prismatic
    Q4Discretisation RayleighDamping RectangularSection Revolute RigidBody
    Screw SidBody SidDamping SineRamp SmoothStep SolidDiscretisation Spherical Spline
    Sphere SpringDamper Start State Stiffening StressRecovery Sum SurfaceMesh
    TangentFrame Tie Time Universal UserReduction VolumeGeometry
""".split()  # noqa: SIM905
_HOME = {
    **dict.fromkeys(_TABLES, "sidtool.vocabulary"),
    "CompiledScene": "sidtool.compiled",
    "InputError": "sidtool.formats.errors",
    "ValidityWarning": "sidtool.formats.errors",
    "Interrupted": "sidtool.interrupting",
    "Model": "sidtool.scenes",
    "Result": "sidtool.results",
    "SID": "sidtool.formats.sid",
    "Scene": "sidtool.scenes",
    "SimulationError": "sidtool.solver.errors",
    "Law": "sidtool.solver.functions.laws",
    "Timed": "sidtool.solver.functions.callables",
    "animate": "sidtool.view.animating",
    "compare": "sidtool.api",
    "convert": "sidtool.api",
    "inverse_dynamics": "sidtool.analysing",
    "linearise": "sidtool.analysing",
    "outputs": "sidtool.afterwards",
    "peak_stresses": "sidtool.view.peaks",
    "read": "sidtool.kinds",
    "repair": "sidtool.api",
    "sid_from_blocks": "sidtool.conversion.building",
    "sid_from_shapes": "sidtool.conversion.building",
    "simulate": "sidtool.api",
    "static_equilibrium": "sidtool.analysing",
    "study": "sidtool.study.asked",
    "sweep": "sidtool.sweep.asked",
    "validate": "sidtool.api",
    "write": "sidtool.api",
}

__version__ = "0.1.0"
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    """Import on first use, so that the command line answers at once."""
    if name not in _HOME:
        raise AttributeError(_unknown(name), name=name)
    return getattr(import_module(_HOME[name]), name)


def _unknown(name: str) -> str:
    """With `name` given, Python adds no suggestion of its own, as few places do."""
    from difflib import get_close_matches

    folded = {known.lower(): known for known in __all__}
    near = get_close_matches(name.lower(), folded, n=1)
    there = f"perhaps {folded[near[0]]}" if near else "dir(sidtool) lists all"
    return f"module {__name__!r} has no attribute {name!r}; {there}"


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


class _Face(ModuleType):
    """Keep public names for functions.

    Importing the package `sidtool.validate` would put it in the place of the function
    `sidtool.validate`.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Face
