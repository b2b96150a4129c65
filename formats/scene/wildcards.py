"""Expansion of wildcards in output names.

`*` stands for any letters within one part of a name: `rod.*.ux`, `*.x`, `bearing.*`.
Velocities in body axes (`vx_body`), orientations as quaternions or rotation vectors,
rotation of markers and momenta of bodies are found where nothing else is: `rod.*` does
not mean them, `rod.*_body` does. What is zero in planar scenes is not found there.
"""

from collections.abc import Iterable, Iterator, Mapping
from fnmatch import fnmatchcase
from typing import NoReturn

from ..base.errors import InputError
from ..base.sid import SID
from ..base.stress import stress_nodes
from .bodies import RigidBody, SidBody
from .connections import (
    multipliers,
    owner_table,
    quantities_of_drive,
    quantities_of_force,
    quantities_of_joint,
)
from .joints import marker_names
from .laws import states_of
from .outputs import (
    BODY_STRESSES,
    DISPLACEMENTS,
    ELASTIC,
    FRICTION_QUANTITIES,
    IN_BODY,
    INPUTS,
    MOMENTA,
    ORIENTATIONS,
    RATE,
    SCENE_QUANTITIES,
    SECTION_FORCES,
    STATE,
    STRESSES,
    TURNING,
    VALUE,
    VELOCITIES,
)
from .tables import SceneTables
from .values import expected_names

_SPATIAL = tuple(kind + axis for kind in ("", "v", "a") for axis in "xyz")
#: By dimension: quantities of points, of bodies besides, of joints and forces,
#: elastic displacements.
_POINT = {"spatial": _SPATIAL, "planar": tuple(n for n in _SPATIAL if n[-1] != "z")}
_BODY = {"spatial": ("angle", "wx", "wy", "wz"), "planar": ("angle", "wz")}
_WRENCH = {
    "spatial": ("fx", "fy", "fz", "mx", "my", "mz"),
    "planar": ("fx", "fy", "mz"),
}
_RARE = {
    "spatial": (*(v + IN_BODY for v in VELOCITIES), *ORIENTATIONS, *MOMENTA),
    "planar": ("vx_body", "vy_body", "momentum_x", "momentum_y", "angular_momentum_z"),
}
_RARE_OF_MARKER = {"spatial": (*TURNING, *ORIENTATIONS), "planar": _BODY["planar"]}
_DISPLACEMENT = {"spatial": DISPLACEMENTS, "planar": DISPLACEMENTS[:2]}


#: Markers and sections of a body in a message.
_LISTED_PARTS = 5


def has_wildcard(text: str) -> bool:
    """Check whether a name stands for others; q* and vq* of one owner are
    names, too.
    """
    owner, _, quantity = text.rpartition(".")
    return "*" in owner or ("*" in quantity and not ELASTIC.fullmatch(quantity))


def matching_names(pattern: str, names: Iterable[str]) -> list[str]:
    """Return the names that match a pattern, part by part."""
    parts = pattern.split(".")
    return [
        name
        for name in names
        if len(name_parts := name.split(".")) == len(parts)
        and all(map(fnmatchcase, name_parts, parts))
    ]


def expand_names(
    texts: Iterable[str], scene: SceneTables, sids: Mapping[str, SID], place: str = ""
) -> tuple[str, ...]:
    """Return the names without wildcards, each once.

    Raises
    ------
    InputError : a pattern matches nothing in this scene.
    """
    texts, expanded = tuple(texts), dict[str, None]()
    known: list[str] = []
    if any("*" in text for text in texts):
        known = list(known_outputs(scene, sids))
    for text in texts:
        names = [text]
        if "*" in text:
            names = matching_names(text, known) or matching_names(
                text, rarer_outputs(scene)
            )
        if not names and has_wildcard(text):
            _raise_unknown(text, [*known, *rarer_outputs(scene)], place)
        expanded |= dict.fromkeys(names)
    return tuple(expanded)


def _raise_unknown(pattern: str, known: list[str], place: str) -> NoReturn:
    """Raise a pattern that finds nothing: its owner is not there, or has no such."""
    owner, _, quantity = pattern.rpartition(".")
    fits = matching_names(owner, owners_of(known))
    if fits:
        problem = f"{fits[0]} has no output {quantity!r}"
        listed = (n.rpartition(".") for n in known)
        expected = "one of " + ", ".join(q for o, _, q in listed if o == fits[0])
        parts = [o for o in owners_of(known) if o.startswith(f"{fits[0]}.")]
        if parts:
            more = ", ..." if len(parts) > _LISTED_PARTS else ""
            expected += f", or those of {', '.join(parts[:_LISTED_PARTS])}{more}"
    else:
        problem = f"nothing in this scene is called {owner!r}"
        expected = expected_names(owner, owners_of(known), "part")
    raise InputError(
        f"{pattern!r} stands for no output, as {problem}",
        place=place or None,
        expected=expected,
    )


def owners_of(names: Iterable[str]) -> list[str]:
    """Return the owners before the quantities of names, each once."""
    return list(dict.fromkeys(name.rpartition(".")[0] for name in names))


def quantities_of(owner: str, scene: SceneTables) -> list[str]:
    """Return the quantities of a part of a scene that are known without its SIDs."""
    names = (
        name.rpartition(".")
        for outputs in (known_outputs(scene, {}), rarer_outputs(scene))
        for name in outputs
    )
    return [quantity for name_owner, _, quantity in names if name_owner == owner]


def rarer_outputs(scene: SceneTables) -> Iterator[str]:
    """Return the outputs for wildcards that match none of `known_outputs`."""
    for name, body in scene.bodies.items():
        point_mass = isinstance(body, RigidBody) and body.inertia is None
        rare = _RARE[scene.dimension]
        yield from _qualified_names(
            name, [q for q in rare if q in MOMENTA or not point_mass]
        )
        for marker in () if point_mass else body.markers:
            yield from _qualified_names(
                f"{name}.{marker}", _RARE_OF_MARKER[scene.dimension]
            )


def known_outputs(scene: SceneTables, sids: Mapping[str, SID]) -> Iterator[str]:
    """The outputs of a scene that wildcards find first; see the top of this module."""
    dimension = scene.dimension
    for name, body in scene.bodies.items():
        yield from _qualified_names(name, (*_POINT[dimension], *_BODY[dimension]))
        if isinstance(body, SidBody):
            yield from _flexible_outputs(name, body, sids.get(name), dimension)
        else:
            for marker in body.markers:
                yield from _qualified_names(f"{name}.{marker}", _POINT[dimension])
    for name, joint in scene.joints.items():
        for coordinate in joint.coordinates:
            yield from _qualified_names(name, (coordinate, coordinate + RATE))
        if marker_names(joint):
            yield from _qualified_names(name, _WRENCH[dimension])
        yield from _qualified_names(name, quantities_of_joint(joint))
        yield from _qualified_names(name, _multiplier_outputs(name, scene))
        if getattr(joint, "friction", None) is not None:
            yield from _qualified_names(name, sorted(FRICTION_QUANTITIES))
    for name, drive in scene.drives.items():
        if drive.joint is None or marker_names(scene.joints[drive.joint]):
            yield from _qualified_names(name, _WRENCH[dimension])
        yield from _qualified_names(name, quantities_of_drive(drive, scene))
        yield from _qualified_names(name, _multiplier_outputs(name, scene))
        yield from _qualified_names(f"{name}.{STATE}", drive.states)
    for name, force in scene.forces.items():
        yield from _qualified_names(name, _WRENCH[dimension])
        along = quantities_of_force(force, scene)
        yield from _qualified_names(
            name, [q for q in along if not _has_quantity(name, q, scene)]
        )
        function = getattr(force, "function", None)
        if function is not None:
            yield f"{name}.{VALUE}"
        yield from _qualified_names(f"{name}.{STATE}", states_of(function))
    yield from _qualified_names(INPUTS, scene.inputs)
    for owner, quantities in SCENE_QUANTITIES.items():
        yield from _qualified_names(owner, quantities)


def _flexible_outputs(
    name: str, body: SidBody, sid: SID | None, dimension: str
) -> Iterator[str]:
    elastic = sid is not None and not body.rigid
    if sid is not None and elastic:
        for prefix in ("q", "vq"):
            yield from _qualified_names(
                name, (f"{prefix}{k}" for k in body.numbers(sid.nq))
            )
    nodes_with_stress = set(stress_nodes(sid)) if sid is not None and elastic else set()
    if nodes_with_stress:
        yield from _qualified_names(name, BODY_STRESSES)
    for section in sid.sections if sid is not None and elastic else ():
        yield from _qualified_names(f"{name}.{section.name}", SECTION_FORCES)
    for marker, node in body.markers.items():
        yield from _qualified_names(f"{name}.{marker}", _POINT[dimension])
        if elastic:
            yield from _qualified_names(f"{name}.{marker}", _DISPLACEMENT[dimension])
        if node in nodes_with_stress:
            yield from _qualified_names(f"{name}.{marker}", STRESSES)


def _multiplier_outputs(name: str, scene: SceneTables) -> list[str]:
    return [f"f{k + 1}" for k in range(multipliers(name, scene))]


def _has_quantity(force: str, quantity: str, scene: SceneTables) -> bool:
    """Whether a joint or drive with the name of a force has this quantity already."""
    joint = scene.joints.get(force)
    is_coordinate = joint is not None and quantity in joint.coordinates
    return is_coordinate or owner_table(force, quantity, scene) != "forces"


def _qualified_names(owner: str, quantities: Iterable[str]) -> Iterator[str]:
    return (f"{owner}.{quantity}" for quantity in quantities)


def observed_outputs(scene: SceneTables) -> tuple[str, ...]:
    """Outputs that the scene records or its events look at."""
    looked_at = (event.quantity for event in scene.events.values())
    return tuple(dict.fromkeys([*scene.outputs.record, *looked_at]))
