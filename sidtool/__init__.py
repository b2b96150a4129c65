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

# `setup.py` puts formats/ and solver/ into the installed package. In a clone they are
# next to it, and are found there without an installation.
_CLONE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
if all(
    os.path.isfile(f"{_CLONE}/{name}/__init__.py") for name in ("formats", "solver")
):
    __path__.append(_CLONE)

if TYPE_CHECKING:
    from sidtool.formats.base.errors import InputError as InputError
    from sidtool.formats.base.sid import SID as SID
    from sidtool.formats.diagnostics import Diagnostic as Diagnostic
    from sidtool.formats.diagnostics.record import (
        DiagnosticWarning as DiagnosticWarning,
    )
    from sidtool.solver.functions.callables import Timed as Timed
    from sidtool.solver.functions.control_laws import Law as Law
    from sidtool.solver.system.errors import SimulationError as SimulationError

    from .api.analyses import (
        CampbellDiagram as CampbellDiagram,
        FloquetModes as FloquetModes,
        campbell as campbell,
        floquet as floquet,
        inverse_dynamics as inverse_dynamics,
        linearise as linearise,
        static_equilibrium as static_equilibrium,
    )
    from .api.bodies import export_body as export_body, superelement as superelement
    from .api.compiled_scene import CompiledScene as CompiledScene
    from .api.identify import identify as identify
    from .api.interrupts import Interrupted as Interrupted
    from .api.model import Model as Model
    from .api.operations import (
        compare as compare,
        convert as convert,
        repair as repair,
        simulate as simulate,
        validate as validate,
    )
    from .api.optimise import optimise as optimise
    from .api.plant import Plant as Plant, PlantEvent as PlantEvent
    from .api.result import Result as Result
    from .api.scene import Scene as Scene, read as read
    from .api.sensitivity import gradient as gradient, sensitivity as sensitivity
    from .api.state_space import (
        FrequencyResponse as FrequencyResponse,
        StateSpace as StateSpace,
        state_space as state_space,
    )
    from .api.study import study as study, sweep as sweep
    from .api.tables import *  # noqa: F403
    from .model_derivatives.design_variables import ShapeVariable as ShapeVariable
    from .model_derivatives.sid_derivatives import (
        SidDerivatives as SidDerivatives,
        sid_derivatives as sid_derivatives,
    )
    from .pipeline.extra_outputs import outputs as outputs
    from .pipeline.files import write as write
    from .pipeline.sid_from_arrays import (
        sid_from_blocks as sid_from_blocks,
        sid_from_shapes as sid_from_shapes,
    )
    from .view.animation import animate as animate
    from .view.body_fields import peak_stresses as peak_stresses

#: Tables of scenes and models; see `sidtool.api.tables`.
_TABLES = """
    Accuracy Actuator AttachmentReduction BeamDiscretisation BeamGeometry Box
    BoxSection BuckensFrame Bushing CSection Characteristic ChordFrame
    CircularSection Coincident Constant Coupling CraigBamptonReduction Cylinder
    Cylindrical Distance Drive ElasticInitial Event Expression Fixed FrameGeometry
    FrameMass FrameMember FrameSpring FrequencyDamping Friction Gear GeneralSection
    Given Ground Harmonic HertingReduction ISection IgaDiscretisation Initial Input
    InputFunction JointFriction KrylovReduction LSection LookupTable LumpedMass
    Marker Material MatricesDiscretisation MatricesGeometry MemberOffsets
    MemberReleases MeshDiscretisation MeshGeometry ModalDamping ModalReduction
    Morph NodeMarker NurbsGeometry Outputs PatchesGeometry Pid Piece PlanarJoint
    PlaneCut PointForce PointOnLine PointOnPlane Polynomial Prestress Prismatic
    Q4Discretisation RayleighDamping RectangularSection Revolute RigidBody Screw
    SectionForces SidBody SidDamping SineRamp SmoothStep SolidDiscretisation Sphere
    Spherical Spline SpringDamper Start State StationTable Stiffening StressRecovery
    Sum SurfaceMesh TSection TangentFrame Tie Time TubeSection Universal
    UserReduction VolumeGeometry
""".split()  # noqa: SIM905
_HOME = {
    **dict.fromkeys(_TABLES, "sidtool.api.tables"),
    "CompiledScene": "sidtool.api.compiled_scene",
    "InputError": "sidtool.formats.base.errors",
    "Diagnostic": "sidtool.formats.diagnostics",
    "CampbellDiagram": "sidtool.api.analyses",
    "FloquetModes": "sidtool.api.analyses",
    "FrequencyResponse": "sidtool.api.state_space",
    "StateSpace": "sidtool.api.state_space",
    "DiagnosticWarning": "sidtool.formats.diagnostics.record",
    "Interrupted": "sidtool.api.interrupts",
    "Model": "sidtool.api.model",
    "Plant": "sidtool.api.plant",
    "PlantEvent": "sidtool.api.plant",
    "Result": "sidtool.api.result",
    "SID": "sidtool.formats.base.sid",
    "Scene": "sidtool.api.scene",
    "ShapeVariable": "sidtool.model_derivatives.design_variables",
    "SidDerivatives": "sidtool.model_derivatives.sid_derivatives",
    "SimulationError": "sidtool.solver.system.errors",
    "Law": "sidtool.solver.functions.control_laws",
    "Timed": "sidtool.solver.functions.callables",
    "animate": "sidtool.view.animation",
    "compare": "sidtool.api.operations",
    "convert": "sidtool.api.operations",
    "export_body": "sidtool.api.bodies",
    "floquet": "sidtool.api.analyses",
    "gradient": "sidtool.api.sensitivity",
    "identify": "sidtool.api.identify",
    "inverse_dynamics": "sidtool.api.analyses",
    "campbell": "sidtool.api.analyses",
    "linearise": "sidtool.api.analyses",
    "optimise": "sidtool.api.optimise",
    "outputs": "sidtool.pipeline.extra_outputs",
    "peak_stresses": "sidtool.view.body_fields",
    "read": "sidtool.api.scene",
    "repair": "sidtool.api.operations",
    "sid_derivatives": "sidtool.model_derivatives.sid_derivatives",
    "sid_from_blocks": "sidtool.pipeline.sid_from_arrays",
    "sid_from_shapes": "sidtool.pipeline.sid_from_arrays",
    "sensitivity": "sidtool.api.sensitivity",
    "simulate": "sidtool.api.operations",
    "state_space": "sidtool.api.state_space",
    "static_equilibrium": "sidtool.api.analyses",
    "study": "sidtool.api.study",
    "superelement": "sidtool.api.bodies",
    "sweep": "sidtool.api.study",
    "validate": "sidtool.api.operations",
    "write": "sidtool.pipeline.files",
}

__version__ = "1.0.0"
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that the command line starts fast."""
    if name not in _HOME:
        raise AttributeError(_unknown(name), name=name)
    return getattr(import_module(_HOME[name]), name)


def _unknown(name: str) -> str:
    """Describe an unknown name with the nearest known one.

    Python adds no suggestion of its own if the error has the argument `name`.
    """
    near: list[str] = []
    if not name.startswith("__"):  # which tools ask each module for
        from difflib import get_close_matches

        folded = {known.lower(): known for known in __all__}
        near = [folded[n] for n in get_close_matches(name.lower(), folded, n=1)]
    there = f"perhaps {near[0]}" if near else "dir(sidtool) lists all"
    return f"module {__name__!r} has no attribute {name!r}; {there}"


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


class _Face(ModuleType):
    """Module type that keeps public names for functions.

    Importing the package `sidtool.validate` would put it in the place of the function
    `sidtool.validate`.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Face
