"""Bodies and their models."""

from __future__ import annotations

from tests.steel_bars import bar_data

from .gallery import (
    converted,
    mistake,
    plate_data,
)


@mistake("geometry: the map folds or is mirrored", "right-handed map")
def outline_is_mirrored() -> str:
    data = plate_data()
    data["geometry"]["control_points"].reverse()
    return converted(data)


@mistake("markers.tip", "outside the geometry", r"near by is \(1, 0\)")
def marker_lies_beside_the_part() -> str:
    data = plate_data()
    data["markers"]["tip"] = {"node": 2, "position": [1.5, 0.0]}
    return converted(data)


@mistake("frame.markers", "at the same place", "two markers at a distance")
def chord_has_no_length() -> str:
    return converted(plate_data(frame={"type": "chord", "markers": ["tip", "tip"]}))


@mistake("stiffening.prestress: the body buckles", "below the buckling load")
def prestress_is_beyond_buckling() -> str:
    forces = {"tip": [-1e6, 0.0, 0.0]}
    return converted(bar_data(stiffening={"prestress": {"forces": forces}}))


@mistake(
    "N141 f1 to f3 of quad4 elements are too stiff by up to 24 %", "incompatible modes"
)
def mesh_locks() -> str:
    mesh = {"type": "q4", "elements": [10, 1], "formulation": "full_integration"}
    return converted(plate_data(discretisation=mesh))


@mistake(
    "N162 held at root", r"105\.6 Hz instead of 83\.02", 'fix = "root"', "Craig-Bampton"
)
def frame_at_a_marker_is_no_clamp() -> str:
    data = plate_data(frame={"type": "tangent", "marker": "root"})
    tie = {"type": "distributing", "to": "left"}
    data["markers"]["root"] = {"node": 1, "tie": tie}
    return converted(data)
