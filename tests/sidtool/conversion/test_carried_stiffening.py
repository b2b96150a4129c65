"""Has a SID geometric stiffening? Inertia that turns with its section is none."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from sidtool import sid_from_shapes
from sidtool.conversion.geometric_stiffness import add_geometric_stiffening
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.geometric_stiffening import has_stiffening
from sidtool.formats.model import ModelFile
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import (
    assembled_sid,
    finite_element_model,
    sid_from_model,
)
from sidtool.reduction.body_frames import FRAMES as BODY_FRAMES
from sidtool.reduction.methods import REDUCTIONS

from ..beams import beam_data as plane_data
from ..bodies import beam_data, volume_data

ROTATION_ALONE = {"acceleration": False, "angular_acceleration": False, "markers": []}
#: Tables [stiffening], and whether the SID has it then.
TABLES = {"none": (None, False), "all": ({}, True), "rotation": (ROTATION_ALONE, True)}
FRAMES: dict[str, dict[str, Any]] = {
    "tangent": {"type": "tangent", "marker": "crank_pin"},
    "chord": {"type": "chord", "markers": ["crank_pin", "piston_pin"]},
    "mean axes": {"type": "buckens"},
}


def _solid(modes: int) -> tuple[dict[str, Any], str]:
    return volume_data({"type": "hex20", "elements": [6, 1, 1]}, modes), "left"


def _cube(modes: int) -> tuple[dict[str, Any], str]:
    data = volume_data({"type": "hex20", "elements": [1, 1, 1]}, modes)
    ends = (-0.5, 0.5)
    data["geometry"]["control_points"] = [
        [[[x, y, z] for z in ends] for y in ends] for x in (0.0, 0.5, 1.0)
    ]
    return data, "left"


def _beam(modes: int, **changes: Any) -> tuple[dict[str, Any], str]:
    data = beam_data({"type": "beam", "elements": 12, **changes}, modes)
    return data, "start"


def _plane(modes: int, height: float = 0.01) -> tuple[dict[str, Any], str]:
    data = plane_data({"type": "iga", "degrees": [3, 2], "elements": [8, 1]})
    sides = (-height / 2, height / 2)
    data["geometry"]["control_points"] = [[[x, y] for y in sides] for x in (0.0, 1.0)]
    root, tip = data["markers"].values()
    data["markers"] = {"crank_pin": root, "piston_pin": tip}
    data["reduction"] = {"method": "modal", "modes": modes}
    return data, "left"


PARTS = {
    "beam that twists": lambda: _beam(16),
    "beam, one shape": lambda: _beam(1),
    "lumped beam": lambda: _beam(14, theory="timoshenko", mass="lumped"),
    "solid": lambda: _solid(6),
    "cube, one shape": lambda: _cube(1),
    "plane bar": lambda: _plane(4),
    "square, one shape": lambda: _plane(1, 1.0),
}


@cache
def discretised(part: str) -> FiniteElementModel:
    data, _ = PARTS[part]()
    data |= {"frame": FRAMES["mean axes"]}
    return finite_element_model(validate_data(data, ModelFile))


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("part", PARTS)
def test_stiffening_is_what_stress_does(part: str, frame: str) -> None:
    """Also where it is of rotation alone, in a compact body with one shape function."""
    data, end = PARTS[part]()
    clamp = {"clamp": end} if frame == "tangent" else {}
    data |= {"frame": FRAMES[frame] | clamp, "stiffening": {}}
    model, body = validate_data(data, ModelFile), discretised(part)
    reference = BODY_FRAMES[model.frame.type](body, model.frame)
    basis = REDUCTIONS[model.reduction.method](body, reference, model.reduction)
    basis = replace(basis, space=None)
    plain = assembled_sid(body, reference, basis, model.damping)
    assert not has_stiffening(plain)
    for table in ({}, ROTATION_ALONE):
        requested = validate_data(data | {"stiffening": table}, ModelFile).stiffening
        assert requested is not None
        sid = add_geometric_stiffening(plain, body, reference, basis, requested)
        assert has_stiffening(sid), table


@pytest.mark.parametrize("table", TABLES)
def test_a_model_has_the_stiffening_that_its_file_requests(table: str) -> None:
    data, end = PARTS["beam that twists"]()
    requested, expected = TABLES[table]
    data |= {"frame": FRAMES["tangent"] | {"clamp": end}}
    data |= {} if requested is None else {"stiffening": requested}
    sid = sid_from_model(validate_data(data, ModelFile))
    assert has_stiffening(sid) is expected


def test_a_section_that_twists_is_pulled_by_rotation() -> None:
    """A flat section turns into the plane of rotation, whose inertia it raises.

    rho (Iyy - Izz) beside rho (Iyy + Izz) of Me: width 0.01, height 0.06 to 0.03.
    """
    data, end = _beam(16)
    data["frame"] = FRAMES["tangent"] | {"clamp": end}
    data["geometry"]["section"]["height"] = 0.06
    sid = sid_from_model(validate_data(data, ModelFile))
    twist = int(np.abs(sid.node(2).psi.m0[0]).argmax())
    most = sid.Oe.first_order(16)[twist, twist, :3].max() / sid.Me.m0[twist, twist]
    assert most == pytest.approx((0.06**2 - 0.01**2) / (0.06**2 + 0.01**2), rel=1e-6)


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
@pytest.mark.parametrize("modes", [8, 20, 40])
def test_matrices_of_a_coarse_beam_have_no_stiffening(mass: str, modes: int) -> None:
    """How inertia turns with its section is not in a mass matrix: Oe m1 has errors."""
    settings = {"type": "beam", "elements": 8, "theory": "timoshenko", "mass": mass}
    data = beam_data(settings) | {"frame": {"type": "buckens"}}
    body = finite_element_model(validate_data(data, ModelFile))
    dense, stiffness = body.mass.toarray(), body.stiffness.toarray()
    shapes = scipy.linalg.eigh(stiffness, dense)[1][:, 6 : 6 + modes]
    rows, axes = np.nonzero(body.table >= 0)
    order = np.argsort(body.table[rows, axes])
    sid = sid_from_shapes(
        dense,
        stiffness,
        body.positions,
        shapes,
        {1: 0, 2: len(body.positions) - 1},
        dofs=np.column_stack([rows, axes + 1])[order],
    )
    assert not has_stiffening(sid)


def test_a_file_gives_the_same_stiffening(tmp_path: Path) -> None:
    for table, expected in TABLES.values():
        data, end = _beam(16)
        data["frame"] = FRAMES["tangent"] | {"clamp": end}
        data |= {} if table is None else {"stiffening": table}
        sid = sid_from_model(validate_data(data, ModelFile))
        for ending in ("SID_FEM", "h5"):
            path = tmp_path / f"{expected}.{ending}"
            write_sid(path, sid)
            assert has_stiffening(read_sid(path)) is expected
