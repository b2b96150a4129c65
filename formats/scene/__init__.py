"""Scene files: what moves, how it is joined and driven, and what is recorded."""

from __future__ import annotations

from .base import Placement, as_3d, position_3d, rotation
from .bodies import Body, ElasticInitial, Ground, Initial, Marker, RigidBody, SidBody
from .drives import Drive
from .file import Accuracy, Outputs, SceneFile, Time, output_times, read_scene
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
from .outputs import OutputName, marker_reference, parse_output

__all__ = [
    "Accuracy",
    "Body",
    "Coincident",
    "Constant",
    "Drive",
    "ElasticInitial",
    "Fixed",
    "Function",
    "Given",
    "Ground",
    "Harmonic",
    "Initial",
    "Joint",
    "Marker",
    "OutputName",
    "Outputs",
    "Piece",
    "Placement",
    "PointOnLine",
    "Polynomial",
    "Prismatic",
    "Revolute",
    "RigidBody",
    "SceneFile",
    "SidBody",
    "SmoothStep",
    "Spline",
    "Time",
    "as_3d",
    "coefficients",
    "marker_reference",
    "output_times",
    "parse_output",
    "position_3d",
    "read_scene",
    "rotation",
]
