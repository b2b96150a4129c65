"""Scene files: what moves, how it is joined and driven, and what is recorded."""

from ..toml.expressions import (
    Instruction as Instruction,
    Postfix as Postfix,
    parse_expression as parse_expression,
)
from .accuracy import Tolerance as Tolerance, tolerance as tolerance
from .base import (
    Placement as Placement,
    Time as Time,
    as_3d as as_3d,
    orientation_matrix as orientation_matrix,
    position_3d as position_3d,
    rotation_matrix as rotation_matrix,
)
from .bodies import (
    Body as Body,
    Box as Box,
    Cylinder as Cylinder,
    Damping as Damping,
    ElasticInitial as ElasticInitial,
    FrequencyDamping as FrequencyDamping,
    Ground as Ground,
    Initial as Initial,
    Marker as Marker,
    ModalDamping as ModalDamping,
    RayleighDamping as RayleighDamping,
    RigidBody as RigidBody,
    Shape as Shape,
    SidBody as SidBody,
    SidDamping as SidDamping,
    Sphere as Sphere,
    SurfaceMesh as SurfaceMesh,
)
from .file import (
    SceneFile as SceneFile,
    read_input_table as read_input_table,
    read_scene as read_scene,
    with_inputs as with_inputs,
)
from .forces import (
    Actuator as Actuator,
    Bushing as Bushing,
    Characteristic as Characteristic,
    Force as Force,
    Friction as Friction,
    PointForce as PointForce,
    SpringDamper as SpringDamper,
)
from .functions import (
    Constant as Constant,
    Function as Function,
    Given as Given,
    Harmonic as Harmonic,
    InputFunction as InputFunction,
    Piece as Piece,
    Polynomial as Polynomial,
    SineRamp as SineRamp,
    SmoothStep as SmoothStep,
    Spline as Spline,
    Sum as Sum,
    coefficients as coefficients,
)
from .joints import (
    Coincident as Coincident,
    Coupling as Coupling,
    Cylindrical as Cylindrical,
    Distance as Distance,
    Drive as Drive,
    Fixed as Fixed,
    Gear as Gear,
    Joint as Joint,
    JointFriction as JointFriction,
    PlanarJoint as PlanarJoint,
    PointOnLine as PointOnLine,
    PointOnPlane as PointOnPlane,
    Prismatic as Prismatic,
    Revolute as Revolute,
    Spherical as Spherical,
    Universal as Universal,
    coupled_coordinates as coupled_coordinates,
    driven_coordinate as driven_coordinate,
    marker_names as marker_names,
)
from .laws import (
    Expression as Expression,
    ForceFunction as ForceFunction,
    Input as Input,
    Pid as Pid,
)
from .outputs import (
    BODY_STRESSES as BODY_STRESSES,
    DISPLACEMENTS as DISPLACEMENTS,
    FRICTION_QUANTITIES as FRICTION_QUANTITIES,
    IN_BODY as IN_BODY,
    INPUTS as INPUTS,
    KIND as KIND,
    MOMENTA as MOMENTA,
    ORIENTATIONS as ORIENTATIONS,
    PEAK_STRESS as PEAK_STRESS,
    SCENE_QUANTITIES as SCENE_QUANTITIES,
    SECTION_FORCES as SECTION_FORCES,
    STATE as STATE,
    STRESS_NORM as STRESS_NORM,
    STRESSES as STRESSES,
    TURNING as TURNING,
    VALUE as VALUE,
    OutputName as OutputName,
    coordinate_of as coordinate_of,
    is_along_coordinate as is_along_coordinate,
    is_elastic as is_elastic,
    is_joint_output as is_joint_output,
    is_rate as is_rate,
    is_section_force as is_section_force,
    is_stress as is_stress,
    marker_reference as marker_reference,
    parse_output as parse_output,
)
from .signal_files import LookupTable as LookupTable
from .tables import (
    Accuracy as Accuracy,
    Event as Event,
    Outputs as Outputs,
    OutputTimes as OutputTimes,
    output_times as output_times,
)
from .units import unit_of as unit_of
from .wildcards import (
    expand_names as expand_names,
    has_wildcard as has_wildcard,
    known_outputs as known_outputs,
    matching_names as matching_names,
    observed_outputs as observed_outputs,
    owners_of as owners_of,
    rarer_outputs as rarer_outputs,
)
