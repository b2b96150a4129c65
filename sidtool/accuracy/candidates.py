"""What of a model can be left out, and models as scenes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from sidtool.formats.errors import InputError
from sidtool.formats.scene import SceneFile, SidBody, is_elastic, is_stress
from sidtool.formats.scene import parse_output as parsed
from sidtool.formats.sid import SID
from sidtool.formats.stiffening import has_stiffening
from sidtool.solver.system.bodies.unstiffened import can_be_unstiffened

from .flat import in_plane

Numbers = tuple[int, ...]

FLEXIBILITY = "flexibility"
SHAPE = "shape function"
SHAPES = "shape functions"
STIFFENING = "geometric stiffening"
QUADRATIC = "quadratic inertia"
SPACE = "space"


@dataclass(frozen=True)
class Candidate:
    """One thing that can be left out.

    body : empty for the third dimension, which all have
    number : of a shape function
    numbers : of shape functions that are left out together
    """

    body: str
    what: str
    number: int | None = None
    numbers: Numbers = ()


@dataclass(frozen=True)
class Choice:
    """A model: what of each flexible body is kept.

    kept : shape functions by number; none for a rigid body
    quadratic : bodies with quadratic inertia
    unstiffened : bodies whose geometric stiffening is left out
    flat : a spatial scene as a planar one
    """

    kept: tuple[tuple[str, Numbers], ...]
    quadratic: frozenset[str]
    unstiffened: frozenset[str] = frozenset()
    flat: bool = False

    def without(self, *candidates: Candidate) -> Choice:
        """The model without these."""
        kept, bare, quadratic = dict(self.kept), self.unstiffened, self.quadratic
        flat = self.flat
        for c in candidates:
            if c.what == FLEXIBILITY:
                kept[c.body] = ()
            elif c.what == SHAPE:
                kept[c.body] = tuple(k for k in kept[c.body] if k != c.number)
            elif c.what == SHAPES:
                kept[c.body] = tuple(k for k in kept[c.body] if k not in c.numbers)
            elif c.what == STIFFENING:
                bare = bare | {c.body}
            elif c.what == SPACE:
                flat = True
            else:
                quadratic = quadratic - {c.body}
        return Choice(tuple(kept.items()), quadratic, bare, flat)

    def is_part_of(self, whole: Choice) -> bool:
        """Whether a model keeps nothing but what another one has."""
        own, all_ = dict(self.kept), dict(whole.kept)
        kept = own.keys() == all_.keys() and all(
            set(numbers) <= set(all_[name]) for name, numbers in own.items()
        )
        return kept and self.quadratic <= whole.quadratic

    def elastic(self, name: str) -> bool:
        return bool(dict(self.kept).get(name))

    def knows(self, output: str) -> bool:
        """Whether the model has this output, which is nothing otherwise."""
        name, kept = parsed(output), dict(self.kept)
        if name.owner not in kept:
            return True
        if is_stress(name.quantity):
            return bool(kept[name.owner])
        if name.marker or not is_elastic(name.quantity):
            return True
        if output.endswith("*"):
            return bool(kept[name.owner])
        return int(name.quantity.lstrip("vq")) in kept[name.owner]


def finest(scene: SceneFile, sids: Mapping[str, SID]) -> Choice:
    """All shape functions and all terms that the scene and its SIDs have."""
    kept, quadratic = {}, set()
    for name, body in scene.sid_bodies.items():
        sid = sids[name]
        kept[name] = body.numbers(sid.nq)
        if kept[name] and sid.Oe.first_order(sid.nq).any():
            quadratic.add(name)
    return Choice(tuple(kept.items()), frozenset(quadratic))


def stiffened(
    scene: SceneFile, sids: Mapping[str, SID], flat: bool = False
) -> dict[str, bool]:
    """Bodies that have geometric stiffening, and whether they can do without."""
    planar = flat or scene.dimension == "planar"
    return {
        name: can_be_unstiffened(sids[name], planar)
        for name, body in scene.sid_bodies.items()
        if body.geometric_stiffening and not body.rigid and has_stiffening(sids[name])
    }


def as_scene(scene: SceneFile, choice: Choice, sids: Mapping[str, SID]) -> SceneFile:
    """The scene that says what is kept; it asks for no accuracy.

    Raises
    ------
    InputError : it is to be planar, and cannot be.
    """
    bodies: dict[str, Any] = dict(scene.bodies)
    for name, numbers in choice.kept:
        bodies[name] = _body(bodies[name], name, numbers, choice, sids[name].nq)
    accuracy = scene.accuracy.model_copy(update={"wanted": None})
    found = scene.model_copy(update={"bodies": bodies, "accuracy": accuracy})
    if not choice.flat:
        return found
    planar = in_plane(found)
    if planar is None:
        raise InputError("the scene cannot be written in the plane z = 0")
    return planar


def recording(scene: SceneFile, names: tuple[str, ...]) -> SceneFile:
    """The scene with these outputs recorded."""
    outputs = scene.outputs.model_copy(update={"record": names})
    return scene.model_copy(update={"outputs": outputs})


def _body(body: SidBody, name: str, numbers: Numbers, choice: Choice, nq: int) -> Any:
    if not numbers:
        return body.model_copy(update={"rigid": True})
    before = body.numbers(nq)
    initial = {}
    for key in ("elastic", "elastic_velocity"):
        values = getattr(body.initial, key)
        if values is not None and len(values) == len(before):
            pairs = zip(before, values, strict=True)
            initial[key] = tuple(value for k, value in pairs if k in numbers)
    whole = len(numbers) == nq
    return body.model_copy(
        update={
            "shape_functions": None if whole else numbers,
            "geometric_stiffening": body.geometric_stiffening
            and name not in choice.unstiffened,
            "quadratic_inertia": name in choice.quadratic,
            "initial": body.initial.model_copy(update=initial),
        }
    )


def loaded_nodes(scene: SceneFile, name: str) -> dict[str, str]:
    """Nodes of a body where joints, drives and forces act, by what they call them."""
    known = scene.sid_bodies[name].markers
    parts = (*scene.joints.values(), *scene.forces.values(), *scene.drives.values())
    texts = [text for part in parts for text in getattr(part, "markers", None) or ()]
    texts += [text for part in parts if (text := getattr(part, "marker", None))]
    named = (text.partition(".") for text in texts)
    return {m: known.get(m, m) for owner, _, m in named if owner == name and m}


def shape_functions(choice: Choice) -> list[Candidate]:
    """One candidate for each shape function."""
    return [Candidate(n, SHAPE, k) for n, numbers in choice.kept for k in numbers]


def with_all_shapes(choice: Choice, all_: Choice) -> Choice:
    """The model with the shape functions of another."""
    return replace(choice, kept=all_.kept)


def with_all_terms(choice: Choice, all_: Choice) -> Choice:
    """The model with the terms of another."""
    return replace(choice, quadratic=all_.quadratic, unstiffened=all_.unstiffened)
