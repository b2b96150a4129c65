"""Flexible bodies of a scene taken as rigid."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from sidtool.formats.errors import InputError
from sidtool.formats.scene import SceneFile


def as_rigid(scene: SceneFile, names: Iterable[str]) -> SceneFile:
    """The scene with these bodies rigid, as `rigid = true` would say it.

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


def told_rigid(scene: SceneFile) -> Iterator[str]:
    """A sentence about the bodies that are rigid, and what is not recorded of them."""
    from sidtool.solver.system.bodies.rigid_bodies import elastic_outputs, is_rigid

    rigid = [name for name in scene.bodies if is_rigid(scene, name)]
    if not rigid:
        return
    left = elastic_outputs(scene)
    more = f"; not recorded: {', '.join(left)}" if left else ""
    yield f"simulated as rigid: {', '.join(rigid)}{more}"


def told_left_out(scene: SceneFile) -> Iterator[str]:
    """A sentence about each body of which the scene leaves something out."""
    for name, body in scene.sid_bodies.items():
        if body.shape_functions is not None and not body.rigid:
            numbers = ", ".join(map(str, sorted(body.shape_functions)))
            yield f"{name} moves in shape functions {numbers} of {body.sid} alone"
        if not (body.geometric_stiffening or body.rigid):
            yield f"geometric stiffening of {name} is left out"
