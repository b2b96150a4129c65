"""``sidtool info``: what is in a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from .common import tell
from .inputs import piped


@click.command()
@click.argument("file", metavar="FILE", type=piped)
def info(file: Path) -> None:
    """Tell what is in a SID, model, scene or result.

    \b
    For a SID: modes with frequency, kind, boundary condition, effective mass and share
    in the static deformation; frame, stiffening, stress, nodes, dialect.
    For a model: geometry, material, discretisation, frame, reduction, damping, and
    where every marker is; for the last the body is discretised. Of an imported mesh or
    matrices also mass, centre, inertia, free frequencies and node sets.
    For a scene: bodies, joints, drives and forces with their numbers, degrees of
    freedom, redundancies, total mass, what the simulation keeps or drops, and of
    flexible bodies frequencies, excitation and expected stiffening.
    For a result: outputs with their range, cost, drift of the constraints, and what
    each shape function contributed; of a run that was asked for an accuracy the error
    of each output, the error budget beside its cost, and what was left out and why.

    \b
    Examples:
      sidtool info rod.SID_FEM
      sidtool info slider_crank.toml

    Exit status: 0 done; 2 the file cannot be read, or the body of a model cannot be
    made: what the model says is told, and the reason.
    """
    from ..kinds import expect_kind, read
    from ..report.data import data_of

    kind = expect_kind(file, "sid", "model", "scene", "result")
    content = read(file)
    if kind == "model":
        _model(content, file)
    else:
        tell(DESCRIBERS[kind](content, file), lambda: data_of(content))


def _sid(content: Any, _: Path) -> str:
    from ..report.sid import describe_sid

    return describe_sid(content)


def _model(content: Any, path: Path) -> None:
    """Tells what a model says, also where its body cannot be made.

    Raises
    ------
    InputError : it cannot.
    """
    from sidtool.formats.errors import InputError

    from ..frontends.registry import finite_element_model
    from ..report.imported import describe_import
    from ..report.model import describe_model

    try:
        body = finite_element_model(content)
        text = describe_model(content, body)
        if content.geometry.type in ("mesh", "matrices"):
            text += f"\n\n{describe_import(body)}"
        failure = None
    except InputError as error:
        text, failure = describe_model(content), error
    tell(text, content.said)
    if failure is not None:
        raise failure.located(path)


def _scene(content: Any, path: Path) -> str:
    from sidtool.formats.errors import InputError
    from sidtool.solver import compile_scene, describe

    from ..made import converted
    from ..report.scene import describe_scene
    from ..swaps import with_initial_state

    folder = path.parent
    try:
        whole, made, told = converted(with_initial_state(content, folder), folder)
        lines = describe(compile_scene(whole, folder, made, accept_defects=True))
    except InputError as error:
        raise error.located(path) from None
    return "\n".join(
        [
            describe_scene(content),
            "",
            *(line for of_body in told.values() for line in of_body),
            *lines,
        ]
    )


def _result(content: Any, _: Path) -> str:
    from ..report.result import describe_result

    return describe_result(content)


DESCRIBERS: dict[str, Callable[[Any, Path], str]] = {
    "sid": _sid,
    "scene": _scene,
    "result": _result,
}
