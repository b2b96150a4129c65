"""Replace SIDs in scenes, make bodies rigid, and describe the consequences."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.base.errors import InputError, printable
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.diagnostics.record import warn_of_each
from sidtool.formats.file_names import path_of, scene_given
from sidtool.formats.motion_kinds import motion_kinds
from sidtool.formats.result import Result, read_result
from sidtool.formats.result.data import TABLES
from sidtool.formats.scene import ElasticInitial, RigidBody, SceneFile, SidBody
from sidtool.formats.sid_files import read_sid
from sidtool.formats.storage.cache import content_digest
from sidtool.formats.storage.operating_system import path_from
from sidtool.formats.toml.files import locate_errors
from sidtool.formats.toml.tables import name_object, named_object

from .files import expect_kind
from .scene_models import convert_bodies

if TYPE_CHECKING:
    from sidtool.formats.model import ModelFile
    from sidtool.solver.system.system import System

Path_ = str | os.PathLike[str]
Sids = Mapping[str, SID | Path_]
Programs = Mapping[str, Any]

PLACE = "initial.file"
#: Output times closer than this fraction of the time span are equal to the requested
#: one.
NEAR = 1e-9
#: Position, orientation, velocity and angular velocity of a body, by dimension.
_FRAME = {
    "planar": ("x y", "angle", "vx vy", "wz"),
    "spatial": (
        "x y z",
        "quaternion_0 quaternion_1 quaternion_2 quaternion_3",
        "vx vy vz",
        "wx wy wz",
    ),
}
#: Text in the scene of a result for a SID that was given as an object.
PROGRAM_SID_TEXT = "(given by a program)"
#: Converted SIDs of models that were given as objects, by their placeholder texts.
_CONVERTED_OBJECTS: dict[str, SID] = {}
#: Largest number of elastic coordinates in a note.
MAX_LISTED = 3


def apply_changes(
    scene: SceneFile,
    folder: Path,
    sids: Mapping[str, SID | str | os.PathLike[str]],
    rigid: Iterable[str],
) -> tuple[SceneFile, dict[str, SID], list[Diagnostic]]:
    """Return the scene with replacements, its SIDs, and diagnostics of both.

    folder : relative paths of the scene begin here

    Raises
    ------
    InputError : a file cannot be read, or a name is not that of a body with a SID.
    """
    plain = take_as_rigid(scene, rigid)
    content, replaced = replace_sids(plain, sids, folder)
    content, model_sids, notes = convert_bodies(content, folder)
    converted = [each for of_body in notes.values() for each in of_body]
    others = {name: replaced[name] for name in sids}
    found = [
        *replaced_sid_notes(plain, folder, others),
        *rigid_body_notes(plain),
        *converted,
    ]
    return content, replaced | model_sids, [*found, *reduced_body_notes(plain)]


def replaced_sid_notes(
    scene: SceneFile, folder: Path, sids: Mapping[str, SID]
) -> Iterator[Diagnostic]:
    """Describe how other SIDs change the meaning of a scene, see
    `changed_shape_notes`.
    """
    return changed_shape_notes(
        scene, sids, lambda name: sid_of(scene.sid_bodies[name], folder)
    )


@contextmanager
def compiled_scene(
    scene: SceneFile | Path_,
    sids: Sids | None,
    base_folder: Path_ | None,
    accept_defects: bool,
    programs: tuple[Programs | None, Programs | None],
) -> Iterator[System]:
    """A scene with all its joints; input errors name its file."""
    from sidtool.solver import compile_scene

    if not isinstance(scene, SceneFile):
        expect_kind(path_of(scene, "scene", "a sidtool.Scene"), "scene")
    scene = scene_given(scene)
    folder = Path(base_folder or scene.folder)
    with locate_errors(scene):
        content, replaced = replace_sids(scene, sids or {}, folder)
        content, model_sids, _ = convert_bodies(content, folder)
        yield compile_scene(
            content,
            folder,
            replaced | model_sids,
            accept_defects=accept_defects,
            drives=programs[0],
            keep_joints=True,
            forces=programs[1],
        )


def take_as_rigid(scene: SceneFile, names: Iterable[str]) -> SceneFile:
    """Return the scene with these bodies rigid, as by `rigid = true`.

    Raises
    ------
    InputError : a name is not that of a body with a SID.
    """
    bodies, known = dict(scene.bodies), scene.flexible
    for name in names:
        if name not in known:
            raise InputError(
                f"found {name!r}",
                place="--rigid",
                expected=", ".join(known) or "a body with a SID in the scene",
            )
        bodies[name] = bodies[name].model_copy(update={"rigid": True})
    return scene.model_copy(update={"bodies": bodies})


def rigid_body_notes(scene: SceneFile) -> Iterator[Diagnostic]:
    """Yield N240 on rigid bodies and on their outputs that are not recorded."""
    from sidtool.solver.system.body_data import elastic_outputs, is_taken_as_rigid

    rigid = [name for name in scene.bodies if is_taken_as_rigid(scene, name)]
    if not rigid:
        return
    left = elastic_outputs(scene)
    lost = f", not recorded: {', '.join(left)}" if left else ""
    yield diagnose("N240", ", ".join(rigid), lost=lost)


def reduced_body_notes(scene: SceneFile) -> Iterator[Diagnostic]:
    """Yield N241 on each body with neglected shape functions or terms."""
    for name, body in scene.sid_bodies.items():
        if body.shape_functions is not None and not body.rigid:
            numbers = ", ".join(map(str, sorted(body.shape_functions)))
            reduction = f"shape functions {numbers} of {body.sid}"
            yield diagnose("N241", name, reduction=reduction)
        if not (body.geometric_stiffening or body.rigid):
            yield diagnose("N241", name, reduction="no geometric stiffening")


def sid_of(body: SidBody, folder: Path) -> SID:
    """Return the SID of a body, from its file or from the given object.

    Raises
    ------
    InputError : the file cannot be read, or the model not converted.
    """
    given = named_object(body.sid)
    if given is None:
        given = named_object(body.model)
    return read_sid(folder / body.sid) if given is None else _sid_of_object(given)


def _program_sids(scene: SceneFile) -> dict[str, SID]:
    """Return the SIDs of bodies that were given as objects."""
    return {
        name: sid_of(body, scene.folder)
        for name, body in scene.sid_bodies.items()
        if named_object(body.sid) is not None or named_object(body.model) is not None
    }


def _sid_of_object(given: SID | ModelFile) -> SID:
    """Return an object that is a SID, or convert a model once."""
    from .model_to_sid import sid_from_model

    if isinstance(given, SID):
        return given
    key = name_object(given)
    if key not in _CONVERTED_OBJECTS:
        sid = _CONVERTED_OBJECTS[key] = sid_from_model(given)
        warn_of_each(sid.diagnostics)
    return _CONVERTED_OBJECTS[key]


def replace_sids(
    scene: SceneFile, sids: Mapping[str, SID | str | os.PathLike[str]], folder: Path
) -> tuple[SceneFile, dict[str, SID]]:
    """Return the scene that names its replaced SIDs, and the SIDs by body.

    folder : relative paths of the scene begin here

    Raises
    ------
    InputError : a file cannot be read, or a name is not that of a flexible body.
    """
    from sidtool.solver.diagnostics.checks import check_replaced_sids

    scene = with_initial_state(scene, folder)
    sids = {**_program_sids(scene), **sids}
    if not sids:
        return scene, {}
    check_replaced_sids(scene, sids)
    bodies, replaced = dict(scene.bodies), {}
    for name, given in sids.items():
        if isinstance(given, SID):
            replaced[name], text = given, PROGRAM_SID_TEXT
        else:
            replaced[name] = read_sid(given)
            # Results store the name as text, so bytes that are not UTF-8 are escaped.
            text = printable(path_from(folder, Path(given)))
        bodies[name] = bodies[name].model_copy(update={"sid": text, "model": None})
    return scene.model_copy(update={"bodies": bodies}), replaced


def with_initial_state(scene: SceneFile, folder: Path) -> SceneFile:
    """Return the scene with the initial state of the result that it names, if any.

    Parameters
    ----------
    folder : folder of the path of the result

    Raises
    ------
    InputError : the file is no result, was made in the other dimension, or lacks a body
        of the scene or the requested time.
    """
    start = scene.initial
    if start.state != "result" or start.file is None:
        return scene
    given = named_object(start.file)
    result = read_result(folder / start.file) if given is None else given
    try:
        last = _at_time(result, start.time)
        changes = _starting_values(scene, last)
    except InputError as error:
        raise error.located(str(start.file)) from None
    changes |= {"file": None, "time": None}
    return scene.model_copy(update={"initial": start.model_copy(update=changes)})


def _at_time(result: Result, time: float | None) -> Result:
    """Return the result at one of its times, by default the last one."""
    if not len(result.t):
        raise InputError("holds no state", place=PLACE, expected="a run that began")
    row = len(result.t) - 1
    if time is not None:
        row = int(np.abs(result.t - time).argmin())
        span = max(float(np.ptp(result.t)), abs(time))
        if abs(result.t[row] - time) > NEAR * span:
            raise InputError(
                f"holds no state at t = {time:.9g} s",
                place="initial.time",
                expected=f"one of its output times, such as {result.t[row]:.9g}",
            )
    part = slice(row, row + 1)
    tables = {name: getattr(result, name)[part] for name in TABLES}
    return replace(result, t=result.t[part], events=(), **tables)


def _starting_values(scene: SceneFile, last: Result) -> dict[str, Any]:
    """Return initial values of bodies, rotation counts, law states, and digests of
    SIDs.
    """
    from sidtool.solver.simulation.replay import replay, scene_of

    before = scene_of(last)
    if before.dimension != scene.dimension:
        raise InputError(
            f"is of a {before.dimension} scene",
            place=PLACE,
            expected=f"a result of a {scene.dimension} one",
        )
    missing = [name for name in scene.bodies if name not in before.bodies]
    if missing:
        raise InputError(
            f"has no body {missing[0]!r}",
            place=PLACE,
            expected="a result with all bodies of the scene; it has "
            + ", ".join(before.bodies),
        )
    quantities = " ".join(_FRAME[scene.dimension]).split()
    names = [f"{body}.{q}" for body in scene.bodies for q in quantities]
    known = replay(last, names).outputs()
    coordinates = {name: float(values[0]) for name, values in known.items()}
    z = dict(zip(last.position_names, map(float, last.positions[0]), strict=True))
    v = dict(zip(last.velocity_names, map(float, last.velocities[0]), strict=True))
    bodies, sids = {}, {}
    for name, body in scene.bodies.items():
        values = _frame(name, scene.dimension, coordinates)
        if f"{name}.e0" in z:  # with its sign, which the angle of a body counts
            values["quaternion"] = tuple(z[f"{name}.e{k}"] for k in range(4))
        if isinstance(body, RigidBody) and body.inertia is None:
            values = {key: values[key] for key in ("position", "velocity")}
        elastic = any(key.startswith(f"{name}.q") and key in z for key in z)
        if isinstance(body, SidBody) and not body.rigid and elastic:
            numbers = body.numbers(last.sids[name].nq)
            values["elastic"] = tuple(z.get(f"{name}.q{k}", 0.0) for k in numbers)
            rates = tuple(v.get(f"{name}.vq{k}", 0.0) for k in numbers)
            values["elastic_velocity"] = rates
            sids[name] = content_digest(last.sids[name])
        bodies[name] = ElasticInitial(**values)
    owners = {*before.bodies, *scene.bodies}
    others = {n: x for n, x in z.items() if n.rpartition(".")[0] not in owners}
    return {
        "bodies": bodies,
        "rotations": {n: x for n, x in others.items() if n not in v and "(" not in n},
        "states": {n: x for n, x in v.items() if f"{n} (integral)" in z},
        "sids": sids,
    }


def _frame(body: str, dimension: str, coordinates: dict[str, float]) -> dict[str, Any]:
    """Return the table `initial` of a frame."""
    position, turn, velocity, spin = (
        tuple(coordinates[f"{body}.{quantity}"] for quantity in texts.split())
        for texts in _FRAME[dimension]
    )
    if dimension == "planar":
        turned: dict[str, Any] = {"angle": turn[0], "angular_velocity": spin[0]}
    else:
        turned = {"quaternion": turn, "angular_velocity": spin}
    return {"position": position, "velocity": velocity, **turned}


def changed_shape_notes(
    scene: SceneFile, sids: Mapping[str, SID], former_of: Callable[[str], SID]
) -> Iterator[Diagnostic]:
    """Return N242 on each body whose elastic coordinates belong to other shapes.

    The kinds of motion, such as bending in y, are compared for the coordinates that
    both SIDs have. Nothing is compared if the file of the scene cannot be read.

    sids : SIDs that replace the files of the bodies with these names
    former_of : returns the SID that the scene names for a body, or raises InputError
    """
    for name, sid in sids.items():
        body = scene.sid_bodies.get(name)
        if body is None or not body.sid:
            continue
        try:
            former = motion_kinds(former_of(name))
        except InputError:
            continue
        pairs = enumerate(zip(motion_kinds(sid), former, strict=False), 1)
        changed = [f"q{k} is {a}, was {b}" for k, (a, b) in pairs if a != b]
        if changed:
            more = len(changed) - MAX_LISTED
            listed_changes = changed[:MAX_LISTED] + (
                [f"{more} more"] if more > 0 else []
            )
            yield diagnose("N242", name, file=str(body.sid), changes=listed_changes)
