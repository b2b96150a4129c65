"""What a model file describes."""

from __future__ import annotations

from formats.model import Marker, ModelFile

from .tables import named, plural, table


def describe_model(model: ModelFile) -> str:
    """Lines and a table of markers."""
    material, geometry = model.material, model.geometry
    entries = [
        ("title", model.title or "(none)"),
        ("geometry", _geometry(model)),
        ("thickness", f"{geometry.thickness:g} m"),
        (
            "material",
            f"E = {material.youngs_modulus:g} Pa, nu = {material.poissons_ratio:g}, "
            f"rho = {material.density:g} kg/m3",
        ),
        ("discretisation", _discretisation(model)),
        ("frame", _frame(model)),
        (
            "reduction",
            f"{model.reduction.method}, {plural(model.reduction.modes, 'mode')}",
        ),
        ("damping", _damping(model)),
    ]
    rows = [
        [name, str(marker.node), _place(marker)]
        for name, marker in model.markers.items()
    ]
    return named(entries) + "\n\n" + table(["marker", "node", "place"], rows)


def _geometry(model: ModelFile) -> str:
    geometry = model.geometry
    points = f"{len(geometry.control_points)} x {len(geometry.control_points[0])}"
    degrees = " and ".join(map(str, geometry.degrees))
    rational = "" if geometry.weights is None else ", with weights"
    return (
        f"{geometry.type} patch, degrees {degrees}, {points} control points{rational}"
    )


def _discretisation(model: ModelFile) -> str:
    entries = model.discretisation.model_dump(exclude_none=True)
    kind, state = entries.pop("type"), entries.pop("state", "")
    parts = [f"{key} {_by(value)}" for key, value in entries.items() if key != "knots"]
    return ", ".join([kind, *parts, state.replace("_", " ")])


def _by(value: object) -> str:
    if isinstance(value, tuple):
        return " x ".join(map(str, value))
    return str(value).replace("_", " ")


def _frame(model: ModelFile) -> str:
    edges = " and ".join(model.frame.clamped_edges)
    return f"{model.frame.type} at {model.frame.marker}, clamped edge: {edges}"


def _damping(model: ModelFile) -> str:
    damping = model.damping
    if damping is None:
        return "none"
    return f"{damping.type}, alpha = {damping.alpha:g} 1/s, beta = {damping.beta:g} s"


def _place(marker: Marker) -> str:
    if marker.edge is not None:
        return f"edge {marker.edge} at {marker.at:g}"
    if marker.parameters is not None:
        return "parameters {:g}, {:g}".format(*marker.parameters)
    return "position {:g}, {:g} m".format(*marker.position or ())
