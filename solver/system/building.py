"""From a scene and its SIDs to the flat tables of a compiled scene.

Compiling keeps only what the scene needs: a frame whose motion is prescribed has no
coordinates, a planar body has three, a point mass does not rotate, and terms of the
SID that are zero are not evaluated.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import (
    STATE,
    Constant,
    Given,
    SceneFile,
    as_3d,
    coordinate_of,
    expanded,
    parse_output,
    watched,
)
from sidtool.formats.sid import SID, rigid_sid

from ..functions.callables import Derivatives
from ..functions.law_drives import value_at_start
from ..functions.laws import Law, LawParts
from ..functions.pool import Pool
from ..functions.table import FunctionTable
from ..space import layout as at
from .bodies.body_tables import body_table, marker_table, with_prescribed_frames
from .bodies.data import BodyData, body_data, rigid_nodes
from .bodies.eliminated import asks_for_joints, eliminated_frames, eliminated_joints
from .bodies.held_frames import with_held_frames
from .bodies.rigid_bodies import without_elasticity
from .bodies.turned_markers import with_turned_markers
from .constant_rates import with_integrated_rates
from .constraint_tables import constraint_tables
from .constraints import Constraint, constraints_of
from .forces.elements import Element, force_table, joint_coordinate
from .forces.friction import friction_tables, place_in_newton, rubbing_joints
from .forces.laws import LawTable, laws_of, state_bodies
from .forces.rows import compile_forces
from .forces.samples import with_samples
from .ingredients import Ingredients, Reference, driven_coordinates
from .newton_rows import newton_rows
from .scene import GROUND_NAME, System
from .sizes import mechanism_size
from .turns import Coordinate, Turn, turn_table, with_turns


def build_system(
    scene: SceneFile,
    sids: Mapping[str, SID],
    drives: Mapping[str, Derivatives | Law] | None = None,
    keep_joints: bool = False,
    forces: Mapping[str, Derivatives | Law] | None = None,
    sampled: bool = True,
    before: System | None = None,
) -> System:
    """Flat tables of a scene, before its initial conditions are looked at.

    sids : of all bodies that have one; see `read_sids`
    drives, forces : callables and laws that replace functions, by name
    keep_joints : joints stay constraints even where they prescribe a frame
    sampled : False to let laws with a sample time act all the time
    before : a system of another such scene, whose bodies are taken where they are the
        same objects

    Raises
    ------
    InputError : a marker does not exist.
    """
    original = scene
    scene = with_held_frames(_with_all_names(without_elasticity(scene), sids))
    planar, pool = scene.dimension == "planar", Pool()
    drives, forces = drives or {}, forces or {}
    known = {} if before is None else _unchanged(before, scene, sids)
    data = {
        name: known.get(name) or body_data(name, body, sids, planar)
        for name, body in scene.bodies.items()
    }
    data[GROUND_NAME] = known.get(GROUND_NAME) or _ground(scene)
    scene, data = with_turned_markers(scene, data)
    functions = FunctionTable(pool, (scene.time.start, scene.time.end))
    _check_names(scene, drives)
    laws = laws_of(scene, forces, drives, sampled)
    drive_index = _drive_functions(scene, functions, drives, laws)
    frames = eliminated_frames(scene, data, laws)
    data |= state_bodies(laws)
    table = LawTable(scene, data, functions, laws, forces)
    elements = compile_forces(scene, functions, planar, forces, table.rows)
    led, elements = _with_led(elements, scene, table)
    scene = _with_programs(scene, functions.given, forces, drives)
    others = [name for name in scene.bodies if name not in frames]
    order = (GROUND_NAME, *frames, *others, *state_bodies(laws))
    parts = Ingredients(scene, data, frames, order, drive_index, led, pool)
    cut = replace(_system(parts, functions, elements), sids=sids, source=original)
    if any(law.sample_time is not None for law in laws.values()):
        given = original, sids, drives, keep_joints, forces
        again = partial(build_system, *given, sampled=False, before=before)
        cut = replace(cut, unsampled=again)
    rated = with_integrated_rates(original, laws, drives)
    if rated is not None:
        with_states = rated, sids, drives, keep_joints, forces, sampled
        cut = replace(
            cut, integrated=partial(build_system, *with_states, before=before)
        )
    if not frames:
        return cut

    def every_joint() -> System:
        whole = _system(replace(parts, frames={}), functions, elements)
        carrying = with_prescribed_frames(whole.arrays.body, cut.arrays.body)
        return replace(
            whole,
            carrying=carrying,
            sids=sids,
            unsampled=cut.unsampled,
            integrated=cut.integrated,
        )

    if keep_joints:
        return every_joint()
    asked = asks_for_joints(scene, cut.eliminated)
    return replace(cut, every_joint=every_joint, whole=every_joint() if asked else None)


def _unchanged(
    before: System, scene: SceneFile, sids: Mapping[str, SID]
) -> dict[str, BodyData]:
    """The data of bodies and of the ground that are still the same objects."""
    known = {data.name: replace(data, turned={}) for data in before.bodies}
    was = before.scene
    if was.dimension != scene.dimension:
        return {}
    same = {
        name
        for name, body in scene.bodies.items()
        if body is was.bodies.get(name) and sids.get(name) is before.sids.get(name)
    }
    if scene.ground is was.ground:
        same.add(GROUND_NAME)
    return {name: known[name] for name in same}


def _with_led(
    elements: tuple[Element, ...], scene: SceneFile, table: LawTable
) -> tuple[dict[str, int], tuple[Element, ...]]:
    """Where the laws of drives stand behind the rows of forces, and all rows."""
    led = {}
    for name in scene.drives:
        if name in table.laws:
            rows = table.rows_of_drive(name)
            first = next(k for k, row in enumerate(rows) if row.rates is not None)
            led[name] = len(elements) + first
            elements += tuple(rows)
    return led, elements


def _with_programs(
    scene: SceneFile,
    seen: Mapping[str, Given],
    forces: Mapping[str, object],
    drives: Mapping[str, object],
) -> SceneFile:
    """The scene with what a program gave in the place of what its file says.

    seen : of functions of time, by their places; laws can only be named
    """
    given = {f"forces.{name}.function": Given() for name in forces}
    given |= {f"drives.{name}.function": Given() for name in drives}
    for place, function in (given | dict(seen)).items():
        table, name, _ = place.split(".")
        parts = dict(getattr(scene, table))
        parts[name] = parts[name].model_copy(update={"function": function})
        scene = scene.model_copy(update={table: parts})
    return scene


def _with_all_names(scene: SceneFile, sids: Mapping[str, SID]) -> SceneFile:
    """The scene with the outputs that its wildcards stand for."""
    record = expanded(scene.outputs.record, scene, sids, "outputs.record")
    outputs = scene.outputs.model_copy(update={"record": record})
    return scene.model_copy(update={"outputs": outputs})


def _system(
    parts: Ingredients, functions: FunctionTable, elements: tuple[Element, ...]
) -> System:
    constraints, pool = constraints_of(parts), parts.pool
    elements, coordinates, turns = _turning(parts, elements)
    markers = _used_markers(parts, constraints, [*elements, *coordinates.values()])
    body = body_table(parts, markers)
    marker, phi = marker_table(parts, markers)
    tables = constraint_tables(parts, constraints, markers, body, marker)
    n_rows = sum(row.count for row in tables.rows)
    entries = int(body[tables.segment[:, at.S_BODY], at.NV].sum())
    force = force_table(elements, markers, parts.order, pool)
    measures = force_table(tuple(coordinates.values()), markers, parts.order, pool)
    turn = turn_table(turns, markers, pool)
    rubbing = rubbing_joints(parts, constraints, tables.constraint)
    friction, sliding, pieces, offset = friction_tables(
        rubbing, markers, body, marker, entries, pool
    )
    rows_of_newton = newton_rows(
        body, marker, tables.segment, pieces, n_rows, offset, force, tables.constraint
    )
    place_in_newton(friction, tables.segment, pieces, rows_of_newton.segment)
    counted = sum(len(turn.angles) for turn in turns if turn.counted)
    arrays = at.System(
        body=body,
        marker=marker,
        constraint=tables.constraint,
        segment=tables.segment,
        drive=functions.table(),
        planar=parts.planar,
        n_pos=body[:, at.NP].sum() + counted,
        n_vel=body[:, at.NV].sum(),
        n_rows=n_rows,
        bandwidth=tables.bandwidth,
        n_phi=phi,
        n_entries=entries,
        n_sliding=offset,
        n_turns=counted,
        pool=pool.array(),
        gravity=as_3d(parts.scene.gravity),
        slack=np.zeros(n_rows),
        force=force,
        turn=turn,
        dropped=np.zeros((0, at.N_DROPPED), np.int64),
        newton=None,
        friction=friction,
        grip=np.zeros((len(rubbing), at.N_GRIP)),
        sliding=None,
    )
    arrays = arrays.replaced(
        sliding=arrays.replaced(constraint=sliding, segment=pieces, n_rows=len(rubbing))
    )
    newton = arrays.replaced(**rows_of_newton._asdict())
    return System(
        scene=parts.scene,
        arrays=arrays.replaced(newton=newton),
        bodies=tuple(parts.data[name] for name in parts.order),
        markers=markers,
        rows=tables.rows,
        eliminated=eliminated_joints(parts.scene, parts.frames),
        breaks=with_samples(functions.breaks(), elements, parts.scene.time),
        causes=functions.causes(),
        length=mechanism_size(parts.scene, parts.data, markers),
        forces=elements,
        coordinates=coordinates,
        measures=measures,
        turns=turns,
        rubbing=rubbing,
        from_start=tables.from_start,
        led=parts.led,
        features=functions.features(),
        seen=functions.seen,
    )


def _turning(
    parts: Ingredients, elements: tuple[Element, ...]
) -> tuple[tuple[Element, ...], dict[Coordinate, Element], tuple[Turn, ...]]:
    """Forces and watched joint coordinates, with what counts their turns."""
    scene = parts.scene
    names = [parse_output(text) for text in watched(scene)]
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
    return with_turns(elements, coordinates, drives)


def _ground(scene: SceneFile) -> BodyData:
    nodes = rigid_nodes(scene.ground.markers)
    sid = rigid_sid(0.0, np.zeros(3), np.zeros((3, 3)), nodes)
    return BodyData(GROUND_NAME, sid, False, False, {}, of_scene=False)


def _check_names(scene: SceneFile, programs: Mapping[str, object]) -> None:
    """Raises a callable for a drive that does not exist."""
    for name in programs:
        if name not in scene.drives:
            raise InputError(
                f"there is no drive {name!r} for a callable",
                place="drives",
                expected=", ".join(scene.drives) or "a drive in the scene",
            )


def _drive_functions(
    scene: SceneFile,
    functions: FunctionTable,
    programs: Mapping[str, Any],
    laws: Mapping[str, LawParts],
) -> dict[str, int]:
    """Row of the function of each drive; of one with a law, its value at the start."""
    rows = {}
    for name, drive in scene.drives.items():
        place = f"drives.{name}.function"
        if name in laws:
            value = value_at_start(laws[name], scene.time.start, place)
            rows[name] = functions.add(Constant(value=value), place)
        else:
            rows[name] = functions.add(drive.function, place, programs.get(name), 2)
    return rows


def _used_markers(
    parts: Ingredients, constraints: Iterable[Constraint], forces: Iterable[Element]
) -> dict[Reference, int]:
    """Only markers that something uses, sorted by body; rows of their table."""
    used = {reference for c in constraints for reference in (c.a, c.b)}
    used |= {ref for frame in parts.frames.values() for ref in (frame.base, frame.tip)}
    used |= {
        ref
        for force in forces
        for ref in (force.a, force.b)
        if ref is not None and force.kind < at.COORDINATE
    }
    outputs = [parse_output(text) for text in watched(parts.scene)]
    laws = {**parts.scene.forces, **parts.scene.drives}
    used |= {
        (name.owner, name.marker)
        for name in outputs
        if name.marker and not (name.owner in laws and name.marker == STATE)
    }
    for reference in used:
        parts.node(reference)
    ranked = sorted(used, key=lambda ref: (parts.order.index(ref[0]), ref[1]))
    return {reference: i for i, reference in enumerate(ranked)}
