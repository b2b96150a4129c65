"""What replaces parts of a scene: other SIDs, and the state of another result."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.errors import InputError, printable
from sidtool.formats.model import ModelFile
from sidtool.formats.result import Result, read_result
from sidtool.formats.result.data import TABLES
from sidtool.formats.scene import ElasticInitial, RigidBody, SceneFile, SidBody
from sidtool.formats.sid import SID
from sidtool.formats.sid_files import read_sid
from sidtool.formats.storage.operating_system import path_from
from sidtool.formats.storage.sid_content import content_digest
from sidtool.formats.toml.objects import name_object, named_object

PLACE = "initial.file"
#: Output times that are nearer than this part of the time span are the one asked for.
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
#: What stands in the scene of a result for a SID that came from a program.
FROM_PROGRAM = "(given by a program)"
#: SIDs of models that are objects, by the texts that stand for these.
_MADE: dict[str, SID] = {}


def sid_of(body: SidBody, folder: Path) -> SID:
    """The SID of a body: of its file, or the object that stands in its place.

    Raises
    ------
    InputError : the file cannot be read, or the model not converted.
    """
    given = named_object(body.sid)
    if given is None:
        given = named_object(body.model)
    return read_sid(folder / body.sid) if given is None else _converted(given)


def _objects(scene: SceneFile) -> dict[str, SID]:
    """SIDs of bodies for which a program gave an object."""
    return {
        name: sid_of(body, scene.folder)
        for name, body in scene.sid_bodies.items()
        if named_object(body.sid) is not None or named_object(body.model) is not None
    }


def _converted(given: SID | ModelFile) -> SID:
    """The SID that an object is, or that is made of a model, once."""
    from .convert import sid_from_model

    if isinstance(given, SID):
        return given
    key = name_object(given)
    if key not in _MADE:
        _MADE[key] = sid_from_model(given)
    return _MADE[key]


def swapped(
    scene: SceneFile, sids: Mapping[str, SID | str | os.PathLike[str]], folder: Path
) -> tuple[SceneFile, dict[str, SID]]:
    """The scene that names what it is simulated with, and the SIDs by body.

    folder : relative paths of the scene begin here

    Raises
    ------
    InputError : a file cannot be read, or a name is not that of a flexible body.
    """
    from sidtool.solver.advice.checks import check_replaced

    scene = with_initial_state(scene, folder)
    sids = {**_objects(scene), **sids}
    if not sids:
        return scene, {}
    check_replaced(scene, sids)
    bodies, found = dict(scene.bodies), {}
    for name, given in sids.items():
        if isinstance(given, SID):
            found[name], text = given, FROM_PROGRAM
        else:
            found[name] = read_sid(given)
            # Results keep the name as text, which bytes that are not UTF-8 are not.
            text = printable(path_from(folder, Path(given)))
        bodies[name] = bodies[name].model_copy(update={"sid": text, "model": None})
    return scene.model_copy(update={"bodies": bodies}), found


def with_initial_state(scene: SceneFile, folder: Path) -> SceneFile:
    """The scene with the numbers of the result that it starts from, if it does.

    folder : the path of the result begins here

    Raises
    ------
    InputError : the file is no result, was made in the other dimension, or lacks a body
        of the scene or the time asked for.
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
    """The result at one of its times alone, by default the last one."""
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
    """Where bodies begin, counted rotations, states of laws, and digests of SIDs."""
    from sidtool.solver.afterwards import replay, scene_of

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
    found = {name: float(values[0]) for name, values in known.items()}
    z = dict(zip(last.position_names, map(float, last.positions[0]), strict=True))
    v = dict(zip(last.velocity_names, map(float, last.velocities[0]), strict=True))
    bodies, sids = {}, {}
    for name, body in scene.bodies.items():
        values = _frame(name, scene.dimension, found)
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


def _frame(body: str, dimension: str, found: dict[str, float]) -> dict[str, Any]:
    """What a table `initial` says of a frame."""
    position, turn, velocity, spin = (
        tuple(found[f"{body}.{quantity}"] for quantity in texts.split())
        for texts in _FRAME[dimension]
    )
    if dimension == "planar":
        turned: dict[str, Any] = {"angle": turn[0], "angular_velocity": spin[0]}
    else:
        turned = {"quaternion": turn, "angular_velocity": spin}
    return {"position": position, "velocity": velocity, **turned}
