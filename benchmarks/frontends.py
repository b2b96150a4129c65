"""The founding slider-crank with one rod by every kind of discretisation."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import sidtool
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import read_data, validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model

from .machine import describe_machine
from .report import Report, Table

EXAMPLE = Path(__file__).parents[1] / "examples" / "slider_crank"
WIDTH = 0.01
#: A mode that bends the rod out of its plane, or twists it, moves its tip less in it.
IN_PLANE = 1e-3
#: Shape functions up to the stretching mode at 1255 Hz: a solid has others between.
MODES = {2: 5, 3: 18}

PLANE: dict[str, dict[str, Any]] = {
    "Q4, 150 x 10": {
        "type": "q4",
        "elements": [150, 10],
        "formulation": "full_integration",
    },
    "Q4, incompatible modes": {
        "type": "q4",
        "elements": [150, 10],
        "formulation": "incompatible_modes",
    },
    "IGA, degrees 7 and 4": {"type": "iga", "degrees": [7, 4], "elements": [25, 8]},
}
SOLID: dict[str, dict[str, Any]] = {
    "hex8, incompatible modes": {
        "type": "hex8",
        "elements": [60, 4, 1],
        "formulation": "incompatible_modes",
    },
    "hex20": {"type": "hex20", "elements": [20, 2, 1]},
    "tet10": {"type": "tet10", "elements": [30, 2, 1]},
    "trivariate NURBS": {"type": "iga", "degrees": [4, 3, 2], "elements": [10, 1, 1]},
}
BEAM: dict[str, dict[str, Any]] = {
    "beam, Euler-Bernoulli": {"type": "beam", "elements": 30},
    "beam, Timoshenko": {"type": "beam", "elements": 30, "theory": "timoshenko"},
}


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Convert every rod, run the unchanged scene with it, and compare."""
    rows, truth = [], None
    for kind, data in models().items():
        model = validate_data(data, ModelFile)
        start = time.perf_counter()
        sid = sid_from_model(model)
        seconds = time.perf_counter() - start
        piston = _piston(sid)
        truth = piston if kind == "IGA, degrees 7 and 4" else truth
        say(f"  {kind}: {seconds:.2f} s")
        rows.append((kind, finite_element_model(model).ndof, seconds, sid, piston))
    assert truth is not None
    header = ["rod", "unknowns", "seconds", "bending 1, Hz", "bending 2", "bending 3"]
    header += ["stretching", "piston, m"]
    cells = [
        [kind, str(ndof), f"{seconds:.2f}", *_in_plane(sid), _difference(piston, truth)]
        for kind, ndof, seconds, sid, piston in rows
    ]
    caption = (
        "Frequencies in the plane of the rod clamped at the crank, and the largest "
        "difference of the piston in 3 s from that with the plane IGA rod:"
    )
    return Report(
        title="One slider-crank, every kind of rod",
        tables=[Table(caption, header, cells)],
        remarks=[
            "The clamped face holds a solid in its thickness too, which plane stress "
            "does not; plain Q4 locks a little; Euler and Bernoulli leave shear out."
        ],
        machine=describe_machine(),
    )


def models() -> dict[str, dict[str, Any]]:
    """Name -> the rod of the example as the data of a model file."""
    rod = read_data(EXAMPLE / "rod_q4.toml")
    result = dict[str, dict[str, Any]]()
    for kind, settings in PLANE.items():
        result[kind] = rod | {"discretisation": settings}
    for kind, settings in SOLID.items():
        result[kind] = rod | {"discretisation": settings} | _solid(rod)
    for kind, settings in BEAM.items():
        result[kind] = rod | {"discretisation": settings} | _beam()
    return {k: data | {"title": k} | _reduction(k) for k, data in result.items()}


def _reduction(kind: str) -> dict[str, Any]:
    dimension = 2 if kind in PLANE else 3
    return {"reduction": {"method": "modal", "modes": MODES[dimension]}}


def _solid(rod: dict[str, Any]) -> dict[str, Any]:
    sides = (-WIDTH / 2, WIDTH / 2)
    outline = rod["geometry"]["control_points"]
    middle = {"at": [0.5, 0.5]}
    return {
        "geometry": {
            "type": "nurbs_volume",
            "degrees": [2, 1, 1],
            "knots": [[0, 0, 0, 1, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1]],
            "control_points": [
                [[[*p, z] for z in sides] for p in column] for column in outline
            ],
        },
        "markers": {
            "crank_pin": {"node": 1, "edge": "left", **middle},
            "piston_pin": {"node": 2, "edge": "right", **middle},
        },
    }


def _beam() -> dict[str, Any]:
    section = {"shape": "rectangle", "height": [0.06, 0.03, 0.06], "width": WIDTH}
    return {
        "geometry": {
            "type": "beam",
            "start": [0, 0, 0],
            "end": [1, 0, 0],
            "section": section,
            "interpolation": "polynomial",
        },
        "frame": {"type": "tangent", "marker": "crank_pin", "clamp": "start"},
        "markers": {
            "crank_pin": {"node": 1, "parameters": [0]},
            "piston_pin": {"node": 2, "parameters": [1]},
        },
    }


def _piston(sid: SID) -> Any:
    """(nt,) its position with this rod [m]."""
    scene = EXAMPLE / "slider_crank.toml"
    return np.asarray(sidtool.simulate(scene, sids={"rod": sid})["piston.x"])


def _in_plane(sid: SID) -> list[str]:
    """Three bending frequencies and the stretching one [Hz]."""
    hertz = np.sqrt(np.diag(sid.Ke.m0)) / (2 * np.pi)
    tip = np.abs(sid.node(2).phi.m0)
    bending = hertz[(tip[1] > IN_PLANE) & (tip[1] > tip[0])]
    stretching = hertz[(tip[0] > IN_PLANE) & (tip[0] > tip[1])]
    return [f"{f:.3f}" for f in (*bending[:3], *stretching[:1])]


def _difference(piston: Any, truth: Any) -> str:
    return f"{np.abs(piston - truth).max():.1e}"
