"""Description of model files, imported files and scene files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model import Material, ModelFile, NodeMarker
from sidtool.formats.model.frames import FrameGeometry
from sidtool.formats.model.geometry import NurbsGeometry, VolumeGeometry
from sidtool.formats.model.reduction import BuckensFrame
from sidtool.formats.scene import (
    INPUTS,
    Body,
    Drive,
    Event,
    Force,
    Joint,
    OutputTimes,
    Polynomial,
    SceneFile,
    SidBody,
    driven_coordinate,
    marker_names,
    unit_of,
)
from sidtool.formats.scene.base import Table
from sidtool.formats.text import counted_noun

from .diagnostics import diagnostic_lines
from .result import before_run
from .tables import TextBlock, format_numbers, named_values, text_table

if TYPE_CHECKING:
    from sidtool.solver.diagnostics.run_summary import BodyEquations

    from ..elements.finite_element_model import FiniteElementModel

#: Number of elastic frequencies in the description, and degrees of freedom above which
#: they are left out: they would take minutes.
_FREQUENCIES, _MANY_DOFS = 10, 60_000
#: Keys of forces that are not listed as parameters.
_NO_NUMBERS = frozenset(["type", "marker", "markers", "joint", "coordinate"])
_LONG = frozenset(["polynomial", "spline", "table", "sum", "callable"])
#: Largest numbers of rows of each table of a scene, and of markers, on a screen.
MAX_ROWS, MAX_MARKERS = 6, 40


def describe_model(
    model: ModelFile,
    body: FiniteElementModel | None = None,
    most: int | None = None,
) -> str:
    """Describe a model by lines and a table of markers; with the body also their
    positions.

    most : largest number of markers and of diagnostics, if it is limited
    """
    parts: list[str] = [*model_parts(model, body, most)]
    parts += [diagnostic_lines(body.diagnostics, most)] if body else []
    return "\n\n".join(part for part in parts if part)


def model_parts(
    model: ModelFile,
    body: FiniteElementModel | None = None,
    most: int | None = None,
) -> list[TextBlock]:
    """The same, one by one."""
    entries = [
        ("title", model.title or "(none)"),
        ("geometry", _geometry_text(model)),
        *_thickness_text(model),
        ("material", _material_text(model.material)),
        ("discretisation", _discretisation_text(model)),
        ("frame", _frame_text(model)),
        ("reduction", _reduction_text(model)),
        ("damping", _damping_text(model)),
    ]
    rows = [
        [name, str(marker.node), _marker_position_text(marker)]
        for name, marker in model.markers.items()
    ]
    heads = ["marker", "node", "place"]
    if body is not None:
        heads.append("at [m]")
        size = float(np.abs(body.positions).max())
        for row in rows:
            row.append(format_numbers(body.marker(row[0]).position, size))
    return [named_values(entries), text_table(heads, rows, most)]


def _thickness_text(model: ModelFile) -> list[tuple[str, str]]:
    thickness = getattr(model.geometry, "thickness", None)
    return [] if thickness is None else [("thickness", f"{thickness:g} m")]


def _material_text(material: Material | None) -> str:
    if material is None:
        return "that of the file"
    return (
        f"E = {material.youngs_modulus:g} Pa, nu = {material.poissons_ratio:g}, "
        f"rho = {material.density:g} kg/m3"
    )


def _reduction_text(model: ModelFile) -> str:
    modes = getattr(model.reduction, "modes", None)
    counted = "" if modes is None else f", {counted_noun(modes, 'mode')}"
    return f"{model.reduction.method}{counted}"


def _geometry_text(model: ModelFile) -> str:
    geometry = model.geometry
    if isinstance(geometry, FrameGeometry):
        members = counted_noun(len(geometry.members), "member")
        return f"frame, {len(geometry.points)} points, {members}"
    if not isinstance(geometry, NurbsGeometry | VolumeGeometry):
        file = getattr(geometry, "file", None) or getattr(geometry, "stiffness", None)
        moved = [
            f"{name} by {morph.amount:g}"
            for name, morph in getattr(geometry, "morphs", {}).items()
            if morph.amount != 0.0
        ]
        return ", ".join([geometry.type + (f" of {file}" if file else ""), *moved])
    net: Any = geometry.control_points
    counts = []
    for _ in geometry.degrees:
        counts.append(str(len(net)))
        net = net[0]
    points = " x ".join(counts)
    degrees = " and ".join(map(str, geometry.degrees))
    rational = "" if geometry.weights is None else ", with weights"
    kind = geometry.type.replace("_", " ")
    return f"{kind} patch, degrees {degrees}, {points} control points{rational}"


def _discretisation_text(model: ModelFile) -> str:
    entries = model.discretisation.model_dump(exclude_none=True)
    kind, state = entries.pop("type"), entries.pop("state", "")
    parts = [
        f"{key} {_size_text(value)}" for key, value in entries.items() if key != "knots"
    ]
    return ", ".join(filter(None, [kind, *parts, state.replace("_", " ")]))


def _size_text(value: object) -> str:
    if isinstance(value, tuple):
        return " x ".join(map(str, value))
    return str(value).replace("_", " ")


def _frame_text(model: ModelFile) -> str:
    frame = model.frame
    markers = " and ".join(frame.marker_names)
    edges = " and ".join(frame.clamped_edges)
    at = f" at {markers}" if markers else ""
    return f"{frame.type}{at}" + (f", clamped: {edges}" if edges else "")


def _damping_text(model: ModelFile) -> str:
    damping = model.damping
    if damping is None:
        return "none"
    return f"{damping.type}, alpha = {damping.alpha:g} 1/s, beta = {damping.beta:g} s"


def _marker_position_text(marker: NodeMarker) -> str:
    if marker.at == "axis":
        return "on the axis of what it is tied to"
    if marker.edge is not None and marker.at is None:
        return f"end {marker.edge}"
    if marker.point is not None:
        return f"point {marker.point}"
    if marker.member is not None:
        return f"member {marker.member} at {marker.at:.6g}"
    if marker.edge is not None:
        at = marker.at if isinstance(marker.at, tuple) else (marker.at,)
        return f"edge {marker.edge} at {_join_values(at)}"
    if marker.parameters is not None:
        return f"parameters {_join_values(marker.parameters)}"
    if marker.mesh_node is not None:
        return f"mesh node {marker.mesh_node}"
    if marker.position is None:
        return "where it is tied"
    return f"position {_join_values(marker.position)} m"


def _join_values(values: tuple[float | None, ...]) -> str:
    return ", ".join("" if value is None else f"{value:.6g}" for value in values)


def describe_import(body: FiniteElementModel, verbose: bool = False) -> str:
    """Describe mass, centre of mass, inertia and free frequencies of a body.

    verbose : free frequencies also of bodies with very many degrees of freedom
    """
    mass, centre, inertia = _body_inertia(body)
    rigid = _rigid_frequencies(body, centre)
    if body.ndof > _MANY_DOFS and not verbose:
        elastic = f"left out for {body.ndof} degrees of freedom; -v computes them"
    else:
        found = _free_frequencies(body)
        elastic = f"{format_numbers(found)} Hz" if found.size else "(none)"
    size = float(np.abs(body.positions).max())
    entries = [
        ("nodes", str(len(body.positions))),
        ("mass", f"{mass:.9g} kg"),
        ("centre", f"{format_numbers(centre, size)} m"),
        ("inertia about it", f"{format_numbers(inertia)} kg m2{_principal_axes(body)}"),
        (
            f"{len(rigid)} rigid motions",
            f"at most {rigid.max():.2g} Hz, as the stiffness resists them",
        ),
        ("free frequencies", elastic),
    ]
    return named_values(entries)


def node_set_table(body: FiniteElementModel, most: int | None = None) -> str:
    """Tabulate the node sets of a body; `most` limits their number."""
    size = float(np.abs(body.positions).max())
    rows = [
        [name, str(len(nodes)), *_extent_text(body.positions[nodes], size)]
        for name, nodes in body.node_sets.items()
        if len(nodes)
    ]
    if not rows:
        return "no node sets"
    return text_table(["node set", "nodes", "from [m]", "to [m]"], rows, most)


def _body_inertia(body: FiniteElementModel) -> tuple[float, Array, Array]:
    """Return mass, centre (3,), and inertia xx, yy, zz, xy, yz, xz about it; for a
    plane body zz only.
    """
    rigid = body.rigid_body_modes()
    gram = rigid.T @ (body.mass @ rigid)
    mass = gram[0, 0]
    if body.dimension == 2:
        centre = np.array([gram[1, 2], -gram[0, 2], 0.0]) / mass
        about = body.rigid_body_modes(centre)[:, 2]
        return mass, centre, np.array([about @ (body.mass @ about)])
    centre = np.array([-gram[2, 4], gram[2, 3], -gram[1, 3]]) / mass
    about = body.rigid_body_modes(centre)[:, 3:]
    j = about.T @ (body.mass @ about)
    return mass, centre, np.array([*np.diag(j), j[0, 1], j[1, 2], j[0, 2]])


def _principal_axes(body: FiniteElementModel) -> str:
    return " (zz)" if body.dimension == 2 else " (xx, yy, zz, xy, yz, xz)"


def _rigid_frequencies(body: FiniteElementModel, centre: Array) -> Array:
    """Return frequencies [Hz] of rigid motions by the stiffness."""
    rigid = body.rigid_body_modes(centre)
    energy = np.einsum("ik,ik->k", rigid, body.stiffness @ rigid)
    inertia = np.einsum("ik,ik->k", rigid, body.mass @ rigid)
    return np.sqrt(np.abs(energy) / inertia) / (2 * np.pi)


def _free_frequencies(body: FiniteElementModel) -> Array:
    """Return the first elastic frequencies [Hz]; none if they cannot be computed."""
    from ..reduction.admissible_space import constrained_space
    from ..reduction.body_frames import buckens_frame

    space = constrained_space(body, buckens_frame(body, BuckensFrame(type="buckens")))
    free = space.stiffness.shape[0] - space.rigid.shape[1]
    try:
        values, _ = space.modes(min(_FREQUENCIES, free))
    except InputError:
        return np.zeros(0)
    return np.sqrt(np.maximum(values, 0.0)) / (2 * np.pi)


def _extent_text(points: Array, size: float) -> list[str]:
    return [
        format_numbers(points.min(axis=0), size),
        format_numbers(points.max(axis=0), size),
    ]


def describe_scene(scene: SceneFile, most: int | None = None) -> str:
    """Describe a scene by lines and tables of bodies, joints, drives and forces.

    most : largest number of rows of each table, if it is limited
    """
    return "\n\n".join(scene_parts(scene, most))


def equation_tables(
    bodies: Sequence[BodyEquations], most: int | None = None
) -> list[TextBlock]:
    """Tabulate what is integrated of each body, and what is expected of flexible ones.

    Bodies that are alike share a row; `most` limits the rows of each table.
    """
    terms = list(next((body.terms for body in bodies if body.terms), ()))
    rows = [
        [body.frame, str(body.elastic or "")]
        + [body.terms.get(term, "") for term in terms]
        + ([", ".join(body.stiffened)] if terms else [])
        for body in bodies
    ]
    header = ["body", "frame", "elastic", *terms, *(["stiffened at"] if terms else [])]
    names = [body.name for body in bodies]
    tables = [text_table(header, _shared_rows(names, rows), most)]
    expected = {body.name: body.expected for body in bodies if body.expected}
    if expected:
        header = ["body", "highest mode", "excitation", "expected stiffening"]
        shared = _shared_rows(list(expected), [*map(before_run, expected.values())])
        tables.append(text_table(header, shared, most))
    return tables


def _shared_rows(names: Sequence[str], rows: Sequence[list[str]]) -> list[list[str]]:
    """Rows under their names; those that are the same are one, under all names."""
    shared: dict[tuple[str, ...], list[str]] = {}
    for name, cells in zip(names, rows, strict=True):
        shared.setdefault(tuple(cells), []).append(name)
    return [[", ".join(alike), *cells] for cells, alike in shared.items()]


def _output_times(scene: SceneFile) -> str:
    time = scene.time
    if time.output_step is None and time.output_times is None:
        return "no output times"
    return counted_noun(len(OutputTimes(scene)), "output time")


def scene_parts(scene: SceneFile, most: int | None = None) -> list[TextBlock]:
    """The same, one by one; `most` limits the rows of each table."""
    accuracy = scene.accuracy
    entries = [
        ("title", scene.title or "(none)"),
        ("dimension", scene.dimension),
        (
            "gravity",
            _format_vector(scene.gravity) + " m/s2" if scene.gravity else "none",
        ),
        (
            "time",
            f"{scene.time.start:g} s to {scene.time.end:g} s, {_output_times(scene)}",
        ),
        (
            "integration",
            f"{accuracy.integrator}, "
            + (
                f"fixed step {accuracy.step:g} s"
                if accuracy.step
                else f"relative tolerance {accuracy.rtol:g}"
            ),
        ),
        ("outputs", ", ".join(scene.outputs.record) or "none"),
    ]
    if scene.parameters:
        known = (f"{name} = {value:g}" for name, value in scene.parameters.items())
        entries.insert(1, ("parameters", ", ".join(known)))
    parts = [named_values(entries)]
    bodies = [[name, *_body_row(body)] for name, body in scene.bodies.items()]
    parts.append(text_table(["body", "kind", "", "markers"], bodies, most))
    if scene.joints:
        joints = [[name, *_joint_row(joint)] for name, joint in scene.joints.items()]
        parts.append(
            text_table(
                ["joint", "kind", "markers", "axis", "coordinates"],
                joints,
                most,
                brief=most is not None,
            )
        )
    if scene.drives:
        drives = [
            [name, *_drive_row(drive, scene)] for name, drive in scene.drives.items()
        ]
        header = ["drive", "of", "coordinate", "function"]
        parts.append(text_table(header, drives, most, brief=most is not None))
    if scene.forces:
        forces = [[name, *_force_row(force)] for name, force in scene.forces.items()]
        header = ["force", "kind", "acts on", "numbers"]
        parts.append(text_table(header, forces, most, brief=most is not None))
    if scene.inputs:
        inputs = [[name, *_input_row(name, scene)] for name in scene.inputs]
        parts.append(
            text_table(
                ["input", "initial", "unit", "then"],
                inputs,
                most,
                brief=most is not None,
            )
        )
    if scene.events:
        events = [[name, *_event_row(event)] for name, event in scene.events.items()]
        parts.append(
            text_table(["event", "when", "then"], events, most, brief=most is not None)
        )
    return parts


def _body_row(body: Body) -> list[str]:
    markers = ", ".join(body.markers)
    if isinstance(body, SidBody):
        terms = [body.sid or f"made of {body.model}"]
        if body.damping is not None:
            terms.append(f"damping {body.damping.type}")
        if body.frame == "held":
            terms.append("frame held")
        if body.quadratic_inertia:
            terms.append("quadratic inertia")
        if not body.geometric_stiffening:
            terms.append("without geometric stiffening")
        if body.shape_functions is not None:
            numbers = ", ".join(map(str, sorted(body.shape_functions)))
            terms.append(f"shape functions {numbers}")
        kind = "taken as rigid" if body.rigid else "flexible"
        return [kind, ", ".join(terms), markers]
    kind, description = "point mass", f"{body.mass:g} kg"
    if body.inertia is not None:
        kind, description = (
            "rigid",
            f"{description}, inertia {_format_amount(body.inertia)} kg m2",
        )
    return [kind, description, markers]


def _joint_row(joint: Joint) -> list[str]:
    axis = getattr(joint, "axis", None)
    between = " - ".join(marker_names(joint) or getattr(joint, "joints", ()))
    coordinates = ", ".join(joint.coordinates)
    return [joint.type, between, _format_vector(axis) if axis else "", coordinates]


def _drive_row(drive: Drive, scene: SceneFile) -> list[str]:
    function = _format_amount(drive.function)
    if isinstance(drive.function, Polynomial):
        function += f", {counted_noun(len(drive.function.pieces), 'piece')}"
    of = drive.joint or drive.marker or ""
    what = driven_coordinate(drive, scene.joints)
    if drive.of != "value":
        what = f"{drive.of} of {what}"
    return [of, what, function]


def _force_row(force: Force) -> list[str]:
    pair = getattr(force, "markers", None) or (getattr(force, "marker", None),)
    joint = getattr(force, "joint", None)
    if joint is None:
        return [force.type, " - ".join(map(str, pair)), format_parameters(force)]
    coordinate = getattr(force, "coordinate", None)
    on = f"{joint}, {coordinate}" if coordinate else joint
    return [force.type, on, format_parameters(force)]


def format_parameters(part: Table) -> str:
    """Return stiffness, damping, rest, gains and other given numbers as text.

    Functions of time are described by their kind, tables by the number of their points.
    """
    texts = []
    for name, key in type(part).model_fields.items():
        value = getattr(part, name)
        if name in part.model_fields_set and name not in _NO_NUMBERS:
            texts.append(f"{key.alias or name} {_format_amount(value)}")
    return ", ".join(texts)


def _format_amount(value: Any) -> str:
    if isinstance(value, Table):
        kind = getattr(value, "type", "")
        inner = "" if kind in _LONG else format_parameters(value)
        points = getattr(value, "deflection", getattr(value, "times", None))
        if points is not None:
            inner = f"{len(points)} points"
        return " ".join(filter(None, [kind, f"({inner})" if inner else ""]))
    if isinstance(value, tuple) and len(value) == 1:
        return _format_amount(value[0])
    if isinstance(value, tuple):
        return "[" + " ".join(map(_format_amount, value)) + "]"
    if isinstance(value, dict):
        return ", ".join(
            f"{name} = {_format_amount(entry)}" for name, entry in value.items()
        )
    return f"{value:g}" if isinstance(value, float) else str(value)


def _input_row(name: str, scene: SceneFile) -> list[str]:
    signal = scene.inputs[name]
    then: str = signal.interpolation
    if signal.times is not None:
        then += f", {counted_noun(len(signal.times), 'value')} in the table"
    return [f"{signal.initial:g}", unit_of(f"{INPUTS}.{name}", scene) or "none", then]


def _event_row(event: Event) -> list[str]:
    how = "" if event.direction == "both" else f", {event.direction}"
    count = "" if event.count is None else f", count {event.count}"
    return [f"{event.quantity} = {event.value:g}{how}", event.action + count]


def _format_vector(vector: tuple[float, ...]) -> str:
    return " ".join(f"{component:g}" for component in vector)
