"""Recorded quantities: from states at the output times to named columns."""

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    FRICTION_QUANTITIES,
    IN_BODY,
    INPUTS,
    MOMENTA,
    ORIENTATIONS,
    SCENE_QUANTITIES,
    STATE,
    TURNING,
    VALUE,
    OutputName,
    coordinate_of,
    is_along_coordinate,
    is_elastic,
    is_rate,
    is_section_force,
    is_stress,
    parse_output,
)

from ..integrators import loop_state
from ..spatial import system_arrays as at
from ..system.rotated_markers import to_3d, to_rotation_matrices
from ..system.system import System
from ..system.work_arrays import new_work_arrays
from .body_outputs import (
    MarkerMotion,
    SceneOutputs,
    frame_motion,
    marker_motion,
    momentum_column,
    position_in_body,
    stress_column,
)
from .energies import EnergyIntegrals
from .reactions import (
    COMPONENTS,
    coordinate_column,
    force_row,
    friction_column,
    multiplier_row,
    output_wrench,
    restore_eliminated_joints,
)
from .samples import (
    EvaluatedForces,
    Samples,
    StateSampler,
    with_minimum_norm_multipliers,
)
from .section_forces import section_force_column


@dataclass(frozen=True, eq=False)
class RecordedOutputs:
    """Named columns (nt, n), and the states that they were made of.

    Attributes
    ----------
    system
        The scene whose joint forces are reported, with all joints if they are.
    undetermined
        Its constraint rows that the motion does not determine.
    """

    names: tuple[str, ...]
    values: Array
    samples: Samples
    system: System
    undetermined: tuple[int, ...]

    @property
    def multipliers(self) -> Array:
        """(nt, rows)."""
        return self.samples.multipliers


def evaluate_outputs(
    sampler: StateSampler,
    times: Array,
    z: Array,
    v: Array,
    integrals: EnergyIntegrals | None = None,
    samples: Samples | None = None,
) -> RecordedOutputs:
    """Evaluates the outputs of the scene at the given states.

    Parameters
    ----------
    integrals
        The steps of the run, for energies that are integrals.
    samples
        What is known of the states; default they are projected, and solved for
        accelerations and multipliers.
    """
    system, work = sampler.system, sampler.work
    if samples is None:
        samples = sampler.sample(times, z, v)
        samples = with_minimum_norm_multipliers(system, work, times, samples)
    full, motion = restore_eliminated_joints(system, times, samples)
    if system.full_system is not None:
        motion = with_minimum_norm_multipliers(
            full, new_work_arrays(full), times, motion
        )
    evaluated = EvaluatedForces(full, motion, times, work if full is system else None)
    quantities = SceneOutputs(system, work, times, samples, integrals, evaluated)
    names = system.scene.outputs.record
    columns = [output_column(quantities, text) for text in names]
    values = np.column_stack(columns) if columns else np.zeros((len(times), 0))
    return RecordedOutputs(names, values, samples, full, motion.undetermined)


def output_column(quantities: SceneOutputs, text: str) -> Array:
    """The values (nt,) of one output."""
    owner, _, quantity = parse_output(text)
    if owner in (INPUTS, *SCENE_QUANTITIES):
        return quantities.column(owner, quantity)
    return _column(quantities.evaluated, text)


def _column(evaluated: EvaluatedForces, text: str) -> Array:
    """The values (nt,) of one output of a part of the scene."""
    system, samples, name = evaluated.system, evaluated.samples, parse_output(text)
    if is_stress(name.quantity):
        return stress_column(system, samples, name)
    if name.owner in system.scene.forces and name.quantity == VALUE:
        return np.asarray(samples.factors[:, force_row(system, name.owner)])
    if name.marker == STATE and name.owner not in system.scene.bodies:
        row = system.arrays.body[state_row(system, name)]
        return np.asarray(samples.v[:, row[at.VEL]])
    if is_section_force(name):
        return section_force_column(evaluated, name)
    if name.quantity in MOMENTA:
        return momentum_column(evaluated, name.owner, name.quantity)
    if name.marker:
        m = system.markers[name.owner, name.marker]
        return _marker_column(system, samples, m, name.quantity)
    coordinate = name.owner, coordinate_of(name.quantity)
    if coordinate in system.coordinates:
        measured = evaluated.coordinate(*coordinate)
        return np.asarray(measured["rate" if is_rate(name.quantity) else "measure"])
    if is_along_coordinate(name.quantity):
        return coordinate_column(evaluated, name.owner, name.quantity)
    if name.quantity in FRICTION_QUANTITIES:
        return friction_column(system, samples, name.owner, name.quantity)
    if name.quantity in COMPONENTS:
        return output_wrench(evaluated, name.owner)[:, COMPONENTS.index(name.quantity)]
    if name.owner not in system.scene.bodies:
        row = multiplier_row(system, name.owner, name.quantity)
        return np.asarray(samples.multipliers[:, row])
    if is_elastic(name.quantity):
        return elastic_column(system, samples.z, samples.v, text)
    return _body_column(system, samples, name.owner, name.quantity)


def state_row(system: System, name: OutputName) -> int:
    """Row of the body that carries a state of a law.

    Raises
    ------
    InputError
        There is no such state.
    """
    for b, data in enumerate(system.bodies):
        if data.name == ".".join(name):
            return b
    raise InputError(
        f"the law of {name.owner} has no state {name.quantity!r}",
        place="outputs.record",
        expected="one of its states",
    )


def is_elastic_coordinate(system: System, text: str) -> bool:
    """True for an elastic coordinate of a body or its rate."""
    name = parse_output(text)
    is_of_body = name.owner in system.scene.bodies and not name.marker
    return is_of_body and is_elastic(name.quantity)


def elastic_column(system: System, z: Array, v: Array, text: str) -> Array:
    """An elastic coordinate of a body or its rate at states, (nt,)."""
    name = parse_output(text)
    data = system.bodies[system.index(name.owner)]
    row = system.arrays.body[system.index(name.owner)]
    velocity = name.quantity.startswith("v")
    source = v if velocity else z
    last = row[at.VEL] + row[at.NV] if velocity else row[at.POS] + row[at.NP]
    first = int(last - row[at.NQ])
    number = data.elastic_number(name.quantity, f"outputs.record, {text}")
    return np.asarray(source[:, first + data.coordinate_numbers.index(number)])


def _body_column(system: System, samples: Samples, owner: str, quantity: str) -> Array:
    frame = system.frames(samples.frames[:, system.index(owner)])
    if quantity in ORIENTATIONS:
        R = frame_motion(system, samples, system.index(owner)).R
        return orientation_column(R, quantity)
    if quantity.endswith(IN_BODY):
        motion = frame_motion(system, samples, system.index(owner))
        V = {"v": motion.V, "w": motion.W}[quantity[0]]
        return V[:, "xyz".index(quantity[1])]
    if quantity == "angle":
        return np.asarray(
            frame["angle"] if system.planar else _rotation_angle(frame["p"])
        )
    axis, kind = "xyz".index(quantity[-1]), quantity[0]
    if len(quantity) == 1:
        return np.asarray(to_3d(frame["x"])[:, axis])
    along = to_rotation_matrices(frame["R"])[:, axis]
    return np.asarray(np.einsum("tj,tj->t", along, to_3d(frame[kind])))


def _rotation_angle(p: Array) -> Array:
    """Of the rotation of quaternions (nt, 4)."""
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(p[:, 1:], axis=1), p[:, 0]))


def _marker_column(system: System, samples: Samples, m: int, quantity: str) -> Array:
    point = system.points(samples.points[:, m])
    if quantity in (*ORIENTATIONS, *TURNING):
        return _rotation_column(marker_motion(system, samples, m), quantity)
    axis = "xyz".index(quantity[-1])
    if quantity[0] == "u":
        return _elastic_displacement(system, samples, m)[:, axis]
    kind = "x" if len(quantity) == 1 else quantity[0]
    return np.asarray(to_3d(point[kind])[:, axis])


def _rotation_column(motion: MarkerMotion, quantity: str) -> Array:
    """Orientation or angular velocity of a marker.

    In space its angle is that of the whole rotation, 0 to pi [rad].
    """
    if quantity in ORIENTATIONS:
        return orientation_column(motion.R, quantity)
    if quantity != "angle":
        return motion.w[:, "xyz".index(quantity[-1])]
    if np.isfinite(motion.angle).any():
        return motion.angle
    parts = [orientation_column(motion.R, f"rotation_{axis}") for axis in "xyz"]
    return np.asarray(np.linalg.norm(parts, axis=0))


def _elastic_displacement(system: System, samples: Samples, m: int) -> Array:
    """Elastic displacement of a marker in the body frame, (nt, 3)."""
    reference = next(key for key, row in system.markers.items() if row == m)
    body = system.bodies[int(system.arrays.marker[m, at.M_BODY])]
    return position_in_body(system, samples, m) - body.node(reference[1]).position


def position_names(system: System) -> tuple[str, ...]:
    """Names of the entries of z_I: coordinates of bodies, then counted rotations."""
    rigid = {2: "x y", 3: "x y angle" if system.planar else "x y z", 0: ""}
    rigid |= {7: "x y z e0 e1 e2 e3"}
    turns = [
        name
        for rotation in system.rotations
        if rotation.is_counted
        for name in rotation.angles
    ]
    names = _coordinate_names(system, at.NP, rigid, "q", " (integral)")
    return (*names, *turns)


def velocity_names(system: System) -> tuple[str, ...]:
    """Names of the entries of z_II; velocities of frames are in body axes."""
    axes = "vx vy wz" if system.planar else "vx vy vz wx wy wz"
    names = [name + IN_BODY for name in axes.split()]
    rigid = {n: " ".join(names[:n]) for n in (0, 2, 3, 6)}
    return _coordinate_names(system, at.NV, rigid, "vq", "")


def _coordinate_names(
    system: System, size: int, rigid: dict[int, str], elastic: str, state: str
) -> tuple[str, ...]:
    names: list[str] = []
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        nq = int(row[at.NQ])
        if not data.is_scene_body:
            names += [data.name + state] * nq
            continue
        parts = rigid[int(row[size]) - nq].split()
        parts += [f"{elastic}{k}" for k in data.coordinate_numbers]
        names += [f"{data.name}.{part}" for part in parts]
    return tuple(names)


def multiplier_names(system: System) -> tuple[str, ...]:
    """Names of the Lagrange multipliers, by joint or drive."""
    counts: dict[str, int] = {}
    names = {}
    for row in system.rows:
        for i in range(row.count):
            counts[row.name] = counts.get(row.name, 0) + 1
            names[row.first + i] = f"{row.name}.f{counts[row.name]}"
    return tuple(names[i] for i in range(system.n_rows))


def fastest_body(system: System, control: loop_state.StepLoopState) -> str:
    """The body with the largest scaled velocity, to name when a run stops."""
    best, size = "none", -1.0
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        part = slice(row[at.VEL], row[at.VEL] + row[at.NV])
        scaled = np.abs(control.v[part] / control.scale_v[part])
        finite = np.where(np.isfinite(scaled), scaled, np.inf)
        if finite.max(initial=-1.0) > size:
            best, size = data.name, float(finite.max(initial=-1.0))
    return best


def orientation_column(R: Array, quantity: str) -> Array:
    """One of `sidtool.formats.scene.ORIENTATIONS` of rotation matrices (nt, 3, 3).

    quaternion_0 is the scalar part and not negative; the rotation vector has at most
    the length pi [rad].
    """
    from scipy.spatial.transform import Rotation  # a quarter of a second

    column = np.full(len(R), np.nan)
    known = np.isfinite(R).all(axis=(1, 2))
    if known.any():
        rotation = Rotation.from_matrix(R[known])
        if quantity.startswith("quaternion"):
            parts = np.roll(rotation.as_quat(canonical=True), 1, axis=1)
            column[known] = parts[:, int(quantity[-1])]
        else:
            column[known] = rotation.as_rotvec()[:, "xyz".index(quantity[-1])]
    return column
