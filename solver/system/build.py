"""Builds a compiled scene from a scene and its SIDs.

Only what the scene needs is compiled: a prescribed frame has no coordinates, a planar
body has three, a point mass does not rotate, and zero SID terms are not evaluated.

Drives of constant rate or acceleration as functions of time.

The integral of a rate is the state of a law, which no prescribed motion contains. Where
the rate or the acceleration is a constant, the integral is a polynomial of time.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array, rigid_sid
from sidtool.formats.scene import (
    INPUTS,
    STATE,
    Constant,
    Drive,
    Function,
    Given,
    Harmonic,
    InputFunction,
    Instruction,
    Polynomial,
    SceneFile,
    as_3d,
    coordinate_of,
    expand_names,
    is_section_force,
    observed_outputs,
    parse_output,
)

from ..functions.callables import Derivatives
from ..functions.control_laws import CompiledLaw, Law, LawInstruction, TimeLaw
from ..functions.function_table import FunctionTable, RealData
from ..functions.law_derivatives import evaluate_law, initial_value
from ..spatial import system_arrays as at
from .body_data import (
    BodyData,
    body_data,
    rigid_nodes,
    with_held_frames,
    without_elasticity,
)
from .body_table import (
    body_table,
    eliminated_frames,
    eliminated_joints,
    marker_table,
    needs_reactions,
    with_prescribed_frames,
)
from .build_inputs import BuildInputs, MarkerKey, driven_coordinates
from .characteristic_sizes import mechanism_size
from .constraint_table import constraint_tables
from .control_laws import LawTable, compile_laws, state_bodies
from .force_rows import ForceRow, force_table, joint_coordinate
from .force_table import compile_forces
from .joint_friction import (
    Coordinate,
    CountedRotation,
    assign_rotation_counters,
    compile_friction_joints,
    friction_tables,
    rotation_table,
    set_newton_rows,
)
from .joints import Constraint, constraints_of
from .newton_pattern import newton_rows
from .rotated_markers import with_rotated_markers
from .sensors import add_sample_times
from .system import GROUND_NAME, System


def integrate_constant_rates(
    scene: SceneFile, laws: Mapping[str, CompiledLaw], given: Iterable[str]
) -> SceneFile | None:
    """The scene whose drives of constant rate or acceleration prescribe values; None
    where there are none.

    Outputs of the states that are left out are no longer recorded.

    Parameters
    ----------
    laws
        Of forces and drives.
    given
        Drives whose functions a program gives.
    """
    changed: dict[str, Drive] = {}
    for name, drive in scene.drives.items():
        if drive.of == "value" or name in given:
            continue
        value = _constant_value(laws[name])
        if value is not None:
            coefficients = (
                (value,) if drive.of == "rate" else (drive.start_rate, value / 2.0)
            )
            changed[name] = _polynomial_drive(
                drive, scene.time.start, (drive.start, *coefficients)
            )
    if not changed:
        return None
    removed = tuple(
        f"{name}.{part}" for name in changed for part in ("state.", "value")
    )
    recorded = tuple(
        name for name in scene.outputs.record if not name.startswith(removed)
    )
    outputs = scene.outputs.model_copy(update={"record": recorded})
    drives = {**scene.drives, **changed}
    return scene.model_copy(update={"drives": drives, "outputs": outputs})


def _polynomial_drive(drive: Drive, start: float, terms: tuple[float, ...]) -> Drive:
    piece = {"from": start, "coefficients": terms}
    function = Polynomial.model_validate({"pieces": [piece]})
    changes = {"of": "value", "start": 0.0, "start_rate": 0.0, "function": function}
    return drive.model_copy(update=changes)


def _constant_value(law: CompiledLaw) -> float | None:
    """The number that a law is, whatever moves; None if it is no such number."""
    numbers = [_constant_instruction(part) for part in law.value]
    if law.states or law.sample_time is not None or None in numbers:
        return None
    value = evaluate_law(tuple(part for part in numbers if part is not None), 0.0, {})
    return value if math.isfinite(value) else None


def _constant_instruction(part: LawInstruction) -> LawInstruction | None:
    """A part of a law that changes neither in time nor with the motion."""
    if isinstance(part, TimeLaw):
        value = _constant_function(part.function)
        return None if value is None else Instruction("number", value)
    plain = isinstance(part, Instruction) and part.kind not in ("name", "time")
    return part if plain else None


def _constant_function(function: Function) -> float | None:
    if isinstance(function, Constant):
        return function.value
    if isinstance(function, Harmonic) and function.amplitude == 0.0:
        return function.offset
    if isinstance(function, Polynomial):
        first, *rest = function.pieces
        if not rest and first.coefficients and not any(first.coefficients[1:]):
            return first.coefficients[0]
    return None


def build_system(
    scene: SceneFile,
    sids: Mapping[str, SID],
    drives: Mapping[str, Derivatives | Law] | None = None,
    keep_joints: bool = False,
    forces: Mapping[str, Derivatives | Law] | None = None,
    sampled: bool = True,
    before: System | None = None,
    rotations: Mapping[str, Array] | None = None,
) -> System:
    """Flat tables of a scene, before its initial conditions are looked at.

    Parameters
    ----------
    sids
        Of all bodies that have one; see `read_sids`.
    drives, forces
        Callables and laws that replace functions, by name.
    keep_joints
        Joints stay constraints even where they prescribe a frame.
    sampled
        False to let laws with a sample time act all the time.
    before
        A system of another such scene, whose bodies are taken where they are the same
        objects.
    rotations
        Of second markers of joints, see `with_rotated_markers`.

    Raises
    ------
    InputError
        A marker does not exist.
    """
    original = scene
    scene = with_held_frames(_with_expanded_outputs(without_elasticity(scene), sids))
    planar, real_data = scene.dimension == "planar", RealData()
    drives, forces = drives or {}, forces or {}
    known = {} if before is None else _reusable_bodies(before, scene, sids)
    data = {
        name: known.get(name) or body_data(name, body, sids, planar)
        for name, body in scene.bodies.items()
    }
    data[GROUND_NAME] = known.get(GROUND_NAME) or _ground_body(scene)
    scene, data = with_rotated_markers(scene, data, rotations)
    span = scene.time.start, scene.time.end
    functions = FunctionTable(real_data, span, scene.inputs)
    _check_drive_names(scene, drives)
    laws = compile_laws(scene, forces, drives, sampled)
    drive_index = _add_drive_functions(scene, functions, drives, laws)
    frames = eliminated_frames(scene, data, laws)
    carriers = state_bodies(laws, scene.initial.states or {})
    data |= carriers
    table = LawTable(scene, data, functions, laws, forces)
    elements = compile_forces(scene, functions, planar, forces, table.rows)
    drive_law_rows, elements = _add_drive_laws(elements, scene, table)
    input_rows = {
        name: functions.add(InputFunction(name=name), f"{INPUTS}.{name}")
        for name in scene.inputs
    }
    scene = _with_given_functions(scene, functions.given_functions, forces, drives)
    others = [name for name in scene.bodies if name not in frames]
    order = (GROUND_NAME, *frames, *others, *carriers)
    parts = BuildInputs(
        scene,
        data,
        frames,
        order,
        drive_index,
        drive_law_rows,
        real_data,
        input_rows,
    )
    reduced = replace(
        _assemble_tables(parts, functions, elements), sids=sids, source=original
    )
    if any(law.sample_time is not None for law in laws.values()):
        given = original, sids, drives, keep_joints, forces
        make_continuous = partial(
            build_system, *given, sampled=False, before=before, rotations=rotations
        )
        reduced = replace(reduced, make_continuous=make_continuous)
    rate_scene = integrate_constant_rates(original, laws, drives)
    if rate_scene is not None:
        with_states = rate_scene, sids, drives, keep_joints, forces, sampled
        reduced = replace(
            reduced,
            make_integrated=partial(
                build_system, *with_states, before=before, rotations=rotations
            ),
        )
    if not frames:
        return reduced

    def make_full_system() -> System:
        full = _assemble_tables(replace(parts, frames={}), functions, elements)
        prescribed_body_table = with_prescribed_frames(
            full.arrays.body, reduced.arrays.body
        )
        return replace(
            full,
            prescribed_body_table=prescribed_body_table,
            sids=sids,
            make_continuous=reduced.make_continuous,
            make_integrated=reduced.make_integrated,
        )

    if keep_joints:
        return make_full_system()
    reactions_needed = needs_reactions(scene, reduced.eliminated)
    return replace(
        reduced,
        make_full_system=make_full_system,
        full_system=make_full_system() if reactions_needed else None,
    )


def _reusable_bodies(
    before: System, scene: SceneFile, sids: Mapping[str, SID]
) -> dict[str, BodyData]:
    """The data of bodies and of the ground that are still the same objects."""
    known = {data.name: replace(data, rotated_markers={}) for data in before.bodies}
    previous_scene = before.scene
    if previous_scene.dimension != scene.dimension:
        return {}
    same = {
        name
        for name, body in scene.bodies.items()
        if body is previous_scene.bodies.get(name)
        and sids.get(name) is before.sids.get(name)
    }
    if scene.ground is previous_scene.ground:
        same.add(GROUND_NAME)
    return {name: known[name] for name in same}


def _add_drive_laws(
    elements: tuple[ForceRow, ...], scene: SceneFile, table: LawTable
) -> tuple[dict[str, int], tuple[ForceRow, ...]]:
    """Where the laws of drives stand behind the rows of forces, and all rows."""
    drive_law_rows = {}
    for name in scene.drives:
        if name in table.laws:
            rows = table.rows_of_drive(name)
            first = next(
                k for k, row in enumerate(rows) if row.derivative_rows is not None
            )
            drive_law_rows[name] = len(elements) + first
            elements += tuple(rows)
    return drive_law_rows, elements


def _with_given_functions(
    scene: SceneFile,
    sampled: Mapping[str, Given],
    forces: Mapping[str, object],
    drives: Mapping[str, object],
) -> SceneFile:
    """The scene with what a program gave in place of what its file says.

    Parameters
    ----------
    sampled
        Of functions of time, by their places; laws can only be named.
    """
    given = {f"forces.{name}.function": Given() for name in forces}
    given |= {f"drives.{name}.function": Given() for name in drives}
    for place, function in (given | dict(sampled)).items():
        table, name, _ = place.split(".")
        parts = dict(getattr(scene, table))
        parts[name] = parts[name].model_copy(update={"function": function})
        scene = scene.model_copy(update={table: parts})
    return scene


def _with_expanded_outputs(scene: SceneFile, sids: Mapping[str, SID]) -> SceneFile:
    """The scene with the outputs that its wildcards stand for."""
    record = expand_names(scene.outputs.record, scene, sids, "outputs.record")
    outputs = scene.outputs.model_copy(update={"record": record})
    return scene.model_copy(update={"outputs": outputs})


def _assemble_tables(
    parts: BuildInputs, functions: FunctionTable, elements: tuple[ForceRow, ...]
) -> System:
    constraints, real_data = constraints_of(parts), parts.real_data
    elements, coordinates, rotations = _assign_rotations(parts, elements)
    markers = _used_markers(parts, constraints, [*elements, *coordinates.values()])
    body = body_table(parts, markers)
    marker, phi = marker_table(parts, markers)
    tables = constraint_tables(parts, constraints, markers, body, marker)
    n_rows = sum(row.count for row in tables.rows)
    entries = int(body[tables.segment[:, at.S_BODY], at.NV].sum())
    force = force_table(elements, markers, parts.order, real_data)
    measures = force_table(tuple(coordinates.values()), markers, parts.order, real_data)
    rotation_table_ = rotation_table(rotations, markers, real_data)
    friction_joints = compile_friction_joints(parts, constraints, tables.constraint)
    friction, friction_constraints, friction_segments, offset = friction_tables(
        friction_joints, markers, body, marker, entries, real_data
    )
    rows_of_newton = newton_rows(
        body,
        marker,
        tables.segment,
        friction_segments,
        n_rows,
        offset,
        force,
        tables.constraint,
    )
    set_newton_rows(friction, tables.segment, friction_segments, rows_of_newton.segment)
    counted = sum(len(rotation.angles) for rotation in rotations if rotation.is_counted)
    arrays = at.SystemArrays(
        body=body,
        marker=marker,
        constraint=tables.constraint,
        segment=tables.segment,
        drive=functions.table(),
        planar=parts.planar,
        n_positions=body[:, at.NP].sum() + counted,
        n_velocities=body[:, at.NV].sum(),
        n_rows=n_rows,
        bandwidth=tables.bandwidth,
        n_phi=phi,
        n_entries=entries,
        n_sliding=offset,
        n_rotation_counters=counted,
        real_data=real_data.array(),
        gravity=as_3d(parts.scene.gravity),
        regularisation=np.zeros(n_rows),
        force=force,
        rotation_counter=rotation_table_,
        inactive_segments=np.zeros((0, at.N_INACTIVE_SEGMENT), np.int64),
        newton_subsystem=None,
        friction=friction,
        friction_state=np.zeros((len(friction_joints), at.N_FRICTION_STATE)),
        friction_subsystem=None,
    )
    arrays = arrays.replaced(
        friction_subsystem=arrays.replaced(
            constraint=friction_constraints,
            segment=friction_segments,
            n_rows=len(friction_joints),
        )
    )
    newton = arrays.replaced(**rows_of_newton._asdict())
    return System(
        scene=parts.scene,
        arrays=arrays.replaced(newton_subsystem=newton),
        bodies=tuple(parts.data[name] for name in parts.order),
        markers=markers,
        rows=tables.rows,
        eliminated=eliminated_joints(parts.scene, parts.frames),
        breaks=add_sample_times(functions.breaks(), elements, parts.scene.time),
        break_causes=functions.break_causes(),
        length=mechanism_size(parts.scene, parts.data, markers),
        forces=elements,
        coordinates=coordinates,
        measures=measures,
        rotations=rotations,
        friction_joints=friction_joints,
        set_at_start=tables.set_at_start,
        drive_law_rows=parts.drive_law_rows,
        features=functions.features(),
        input_rows=parts.input_rows,
        input_continuity=functions.required_continuity,
        lookup_rows=functions.lookup_rows,
        shortest_features=functions.shortest_features,
    )


def _assign_rotations(
    parts: BuildInputs, elements: tuple[ForceRow, ...]
) -> tuple[
    tuple[ForceRow, ...], dict[Coordinate, ForceRow], tuple[CountedRotation, ...]
]:
    """Forces and watched joint coordinates, with what counts their turns."""
    scene = parts.scene
    names = [parse_output(text) for text in observed_outputs(scene)]
    keys = [
        (name.owner, coordinate_of(name.quantity))
        for name in names
        if name.owner in scene.joints and coordinate_of(name.quantity)
    ]
    coordinates = {key: joint_coordinate(scene, *key) for key in keys}
    if parts.planar:
        return elements, coordinates, ()
    drives = {
        (joint, coordinate): parts.drive_index[name]
        for joint, driven in driven_coordinates(scene).items()
        for coordinate, name in driven.items()
    }
    return assign_rotation_counters(elements, coordinates, drives)


def _ground_body(scene: SceneFile) -> BodyData:
    nodes = rigid_nodes(scene.ground.markers)
    sid = rigid_sid(0.0, np.zeros(3), np.zeros((3, 3)), nodes)
    return BodyData(GROUND_NAME, sid, False, False, {}, is_scene_body=False)


def _check_drive_names(scene: SceneFile, programs: Mapping[str, object]) -> None:
    """Raises a callable for a drive that does not exist."""
    for name in programs:
        if name not in scene.drives:
            raise InputError(
                f"there is no drive {name!r} for a callable",
                place="drives",
                expected=", ".join(scene.drives) or "a drive in the scene",
            )


def _add_drive_functions(
    scene: SceneFile,
    functions: FunctionTable,
    programs: Mapping[str, Any],
    laws: Mapping[str, CompiledLaw],
) -> dict[str, int]:
    """Row of the function of each drive; of one with a law, its value at the start."""
    rows = {}
    for name, drive in scene.drives.items():
        place = f"drives.{name}.function"
        if name in laws:
            value = initial_value(laws[name], scene.time.start, place)
            rows[name] = functions.add(Constant(value=value), place)
        else:
            rows[name] = functions.add(drive.function, place, programs.get(name), 2)
    return rows


def _used_markers(
    parts: BuildInputs, constraints: Iterable[Constraint], forces: Iterable[ForceRow]
) -> dict[MarkerKey, int]:
    """Only markers that something uses, sorted by body; rows of their table."""
    used = {reference for c in constraints for reference in (c.a, c.b)}
    used |= {ref for frame in parts.frames.values() for ref in (frame.base, frame.tip)}
    used |= {
        ref
        for force in forces
        for ref in (force.a, force.b)
        if ref is not None and force.kind < at.COORDINATE_MEASURE
    }
    outputs = [parse_output(text) for text in observed_outputs(parts.scene)]
    laws = {**parts.scene.forces, **parts.scene.drives}
    used |= {
        (name.owner, name.marker)
        for name in outputs
        if name.marker
        and not is_section_force(name)
        and not (name.owner in laws and name.marker == STATE)
    }
    for reference in used:
        parts.node(reference)
    ranked = sorted(used, key=lambda ref: (parts.order.index(ref[0]), ref[1]))
    return {reference: i for i, reference in enumerate(ranked)}
