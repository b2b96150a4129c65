"""Bars of decks are drawn from node to node, as they bend."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sidtool.field.body_surfaces import surface_of_field
from sidtool.formats.base.sid import SID
from sidtool.formats.field import Field
from sidtool.pipeline.model_to_sid import field_from_model
from tests.sidtool.beams import clamped_beam
from tests.sidtool.importers.bars.decks import (
    AREA,
    IY,
    IZ,
    MATERIAL,
    PBAR,
    bulk,
    grids,
    model,
)

#: Two long legs side by side, joined at one end only: the nearest neighbour of the
#: first node is no node that it has a bar to.
PLACES = np.array([[0, 0, 0], [1, 0, 0], [1, 0.05, 0], [0, 0.05, 0], [0, 0.05, 0.5]])
LEGS = ((0, 1), (1, 2), (2, 3), (3, 4))


def deck(places: np.ndarray, legs: tuple[tuple[int, int], ...], *cards: str) -> str:
    bars = [
        f"CBAR,{k},1,{a + 1},{b + 1},0.2,-0.3,0.9" for k, (a, b) in enumerate(legs, 1)
    ]
    return bulk(*grids(places), *bars, *cards, PBAR, MATERIAL)


def test_bars_join_the_nodes_that_their_deck_joins(tmp_path: Path) -> None:
    frame = {"type": "tangent", "marker": "p"}
    path = model(tmp_path, deck(PLACES, LEGS), frame=frame, modes=2)
    _, field = field_from_model(path)
    drawn = surface_of_field("frame", field)
    assert drawn.source == "its full field"
    corner = np.sqrt(3 * (IY + IZ) / AREA)
    ends = PLACES[np.array(LEGS)]
    for share in np.linspace(0, 1, 9):
        there = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
        distance = np.linalg.norm(drawn.positions[:, None] - there, axis=2).min(axis=0)
        np.testing.assert_allclose(distance, corner, rtol=1e-9)
    gap = np.linalg.norm(drawn.positions - [0, 0.025, 0], axis=1)
    assert gap.min() > 0.02


def assert_bends(sid: SID, field: Field, pieces: int, atol: float) -> None:
    """A bar of 2 m, drawn in more pieces than these, as its exact static solution."""
    push = sid.nodes[1].phi.m0.T @ np.array([0.0, 1.0, 0.0])
    moved = field.displacement(np.linalg.solve(sid.Ke.m0, push))
    sections = moved.reshape(-1, 4, 3).mean(axis=1)
    s = field.positions.reshape(-1, 4, 3).mean(axis=1)[:, 0] / 2.0
    assert len(s) > pieces
    cubic = s**2 * (3 - s) / 2
    np.testing.assert_allclose(sections[:, 1] / sections[-1, 1], cubic, atol=atol)


def test_a_bar_bends_as_its_static_solution(tmp_path: Path) -> None:
    """Pushed at its end a clamped bar moves by s^2 (3 - s) / 2 of the end."""
    path = model(
        tmp_path,
        deck(np.array([[0, 0, 0], [2.0, 0, 0]]), ((0, 1),)),
        frame={"type": "tangent", "marker": "p"},
        markers={n: {"node": k, "mesh_node": k} for k, n in ((1, "p"), (2, "tip"))},
        reduction={
            "method": "attachment", "interfaces": ["tip"], "modes": 0, "fix": "p",
            "inertia_relief": False,
        },
    )  # fmt: skip
    sid, field = field_from_model(path)
    assert_bends(sid, field, 4, 1e-5)


def test_a_beam_of_one_element_bends_as_its_static_solution() -> None:
    """It was drawn as a straight piece between its two nodes."""
    reduction = {"method": "attachment", "interfaces": ["tip"], "modes": 0}
    reduction |= {"inertia_relief": False}
    found = clamped_beam(2.0, (0.02, 0.01), elements=1, reduction=reduction)
    sid, field = field_from_model(found)
    assert_bends(sid, field, 40, 1e-12)
