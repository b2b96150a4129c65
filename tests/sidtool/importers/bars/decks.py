"""Nastran decks of bars, and the bodies that are read from them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.pipeline.model_to_sid import sid_from_model

E, NU, RHO = 2.1e11, 0.3, 7850.0
G = E / (2 * (1 + NU))
#: Area, second moments about y and z, torsion constant.
AREA, IY, IZ, TORSION = 4e-6, 3e-13, 5e-13, 4e-13
MATERIAL = f"MAT1,1,{E!r},,{NU!r},{RHO!r}"
PBAR = f"PBAR,1,1,{AREA!r},{IZ!r},{IY!r},{TORSION!r}"
#: A frame in space and the direction of the y axis of its three legs.
PLACES = np.array([[0, 0, 0], [0.4, 0.1, 0], [0.5, 0.6, 0.2], [0.1, 0.5, 0.7]])
LEGS = ((0, 1), (1, 2), (2, 3))
UP = (0.2, -0.3, 0.9)


def grids(places: Any) -> list[str]:
    rows = np.asarray(places, float).tolist()
    return [f"GRID,{i},,{','.join(map(repr, x))}" for i, x in enumerate(rows, 1)]


def bulk(*cards: str) -> str:
    return "\n".join(["BEGIN BULK", *cards, "ENDDATA", ""])


def frame(*cards: str, tail: str = "", card: str = "CBAR") -> str:
    up = ",".join(map(repr, UP))
    bars = [
        f"{card},{k},1,{a + 1},{b + 1},{up}{tail}" for k, (a, b) in enumerate(LEGS, 1)
    ]
    return bulk(*grids(PLACES), *bars, *cards, MATERIAL)


def model(folder: Path, text: str, **more: Any) -> Path:
    (folder / "part.bdf").write_text(text, encoding="utf-8")
    data = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "mesh", "file": "part.bdf", **more.pop("geometry", {})},
        "discretisation": {"type": "mesh"},
        "frame": {"type": "buckens"},
        "markers": {"p": {"node": 1, "mesh_node": 1}},
        "reduction": {"method": "modal", "modes": more.pop("modes", 6)},
        **more,
    }
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return folder / "model.json"


def body(folder: Path, text: str, **more: Any) -> SID:
    return sid_from_model(model(folder, text, **more))
