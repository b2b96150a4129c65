"""Scene files: what moves, how it is joined and driven, and what is recorded."""

from __future__ import annotations

from .base import Placement, as_3d, position_3d, rotation
from .bodies import Body, ElasticInitial, Ground, Initial, Marker, RigidBody, SidBody
from .damping import (
    Damping,
    FrequencyDamping,
    ModalDamping,
    RayleighDamping,
    SidDamping,
)
from .drives import Drive
from .file import Accuracy, Outputs, SceneFile, Time, output_times, read_scene
from .forces import (
    Actuator,
    Bushing,
    Characteristic,
    Force,
    Friction,
    PointForce,
    SpringDamper,
)
from .functions import (
    Constant,
    Function,
    Given,
    Harmonic,
    Piece,
    Polynomial,
    SmoothStep,
    Spline,
    coefficients,
)
from .joints import Coincident, Fixed, Joint, PointOnLine, Prismatic, Revolute
from .outputs import OutputName, is_of_joint, marker_reference, parse_output

__all__ = [
    "Accuracy",
    "Actuator",
    "Body",
    "Bushing",
    "Characteristic",
    "Coincident",
    "Constant",
    "Damping",
    "Drive",
    "ElasticInitial",
    "Fixed",
    "Force",
    "FrequencyDamping",
    "Friction",
    "Function",
    "Given",
    "Ground",
    "Harmonic",
    "Initial",
    "Joint",
    "Marker",
    "ModalDamping",
    "OutputName",
    "Outputs",
    "Piece",
    "Placement",
    "PointForce",
    "PointOnLine",
    "Polynomial",
    "Prismatic",
    "RayleighDamping",
    "Revolute",
    "RigidBody",
    "SceneFile",
    "SidBody",
    "SidDamping",
    "SmoothStep",
    "Spline",
    "SpringDamper",
    "Time",
    "as_3d",
    "coefficients",
    "is_of_joint",
    "marker_reference",
    "output_times",
    "parse_output",
    "position_3d",
    "read_scene",
    "rotation",
]
