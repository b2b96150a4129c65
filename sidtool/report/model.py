"""What a model file describes."""

from __future__ import annotations

from typing import Any

import numpy as np

from sidtool.formats.model import Material, ModelFile, NodeMarker
from sidtool.formats.model.geometry import NurbsGeometry, VolumeGeometry

from ..frontends.finite_element_model import FiniteElementModel
from .tables import Block, listed, named, plural, table


def describe_model(model: ModelFile, body: FiniteElementModel | None = None) -> str:
    """Lines and a table of markers; with the body also where they are."""
    parts: list[str] = [*model_parts(model, body)]
    parts += ["\n".join(f"note: {note}" for note in body.notes)] if body else []
    return "\n\n".join(part for part in parts if part)


def model_parts(
    model: ModelFile, body: FiniteElementModel | None = None
) -> list[Block]:
    """The same, one by one."""
    entries = [
        ("title", model.title or "(none)"),
        ("geometry", _geometry(model)),
        *_thickness(model),
        ("material", _material(model.material)),
        ("discretisation", _discretisation(model)),
        ("frame", _frame(model)),
        ("reduction", _reduction(model)),
        ("damping", _damping(model)),
    ]
    rows = [
        [name, str(marker.node), _place(marker)]
        for name, marker in model.markers.items()
    ]
    heads = ["marker", "node", "place"]
    if body is not None:
        heads.append("at [m]")
        size = float(np.abs(body.positions).max())
        for row in rows:
            row.append(listed(body.marker(row[0]).position, size))
    return [named(entries), table(heads, rows)]


def _thickness(model: ModelFile) -> list[tuple[str, str]]:
    thickness = getattr(model.geometry, "thickness", None)
    return [] if thickness is None else [("thickness", f"{thickness:g} m")]


def _material(material: Material | None) -> str:
    if material is None:
        return "that of the file"
    return (
        f"E = {material.youngs_modulus:g} Pa, nu = {material.poissons_ratio:g}, "
        f"rho = {material.density:g} kg/m3"
    )


def _reduction(model: ModelFile) -> str:
    modes = getattr(model.reduction, "modes", None)
    counted = "" if modes is None else f", {plural(modes, 'mode')}"
    return f"{model.reduction.method}{counted}"


def _geometry(model: ModelFile) -> str:
    geometry = model.geometry
    if not isinstance(geometry, NurbsGeometry | VolumeGeometry):
        file = getattr(geometry, "file", None) or getattr(geometry, "stiffness", None)
        return geometry.type + (f" of {file}" if file else "")
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


def _discretisation(model: ModelFile) -> str:
    entries = model.discretisation.model_dump(exclude_none=True)
    kind, state = entries.pop("type"), entries.pop("state", "")
    parts = [f"{key} {_by(value)}" for key, value in entries.items() if key != "knots"]
    return ", ".join(filter(None, [kind, *parts, state.replace("_", " ")]))


def _by(value: object) -> str:
    if isinstance(value, tuple):
        return " x ".join(map(str, value))
    return str(value).replace("_", " ")


def _frame(model: ModelFile) -> str:
    frame = model.frame
    markers = " and ".join(frame.marker_names)
    edges = " and ".join(frame.clamped_edges)
    at = f" at {markers}" if markers else ""
    return f"{frame.type}{at}" + (f", clamped: {edges}" if edges else "")


def _damping(model: ModelFile) -> str:
    damping = model.damping
    if damping is None:
        return "none"
    return f"{damping.type}, alpha = {damping.alpha:g} 1/s, beta = {damping.beta:g} s"


def _place(marker: NodeMarker) -> str:
    if marker.at == "axis":
        return "on the axis of what it is tied to"
    if marker.edge is not None and marker.at is None:
        return f"end {marker.edge}"
    if marker.edge is not None:
        at = marker.at if isinstance(marker.at, tuple) else (marker.at,)
        return f"edge {marker.edge} at {_listed(at)}"
    if marker.parameters is not None:
        return f"parameters {_listed(marker.parameters)}"
    if marker.mesh_node is not None:
        return f"mesh node {marker.mesh_node}"
    if marker.position is None:
        return "where it is tied"
    return f"position {_listed(marker.position)} m"


def _listed(values: tuple[float | None, ...]) -> str:
    return ", ".join("" if value is None else f"{value:.6g}" for value in values)
