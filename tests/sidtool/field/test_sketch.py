"""What is drawn of a body of which nodes alone are known."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.field.body_surfaces import surface_of_sid
from sidtool.field.surface import border_edges, convex_hull, node_bars
from sidtool.pipeline.model_to_sid import field_from_model
from sidtool.plot import bodies

from ..bodies import volume

EDGES = np.array([3.0, 0.4, 0.2])


def grid(*counts: int) -> np.ndarray:
    lines = [np.linspace(0.0, e, n) for e, n in zip(EDGES, counts, strict=True)]
    return np.array(list(itertools.product(*lines)))


def turned(points: np.ndarray) -> np.ndarray:
    """Anywhere in space: a rotation and a shift."""
    matrix, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    return points @ matrix.T + [4.0, -2.0, 1.0]


def test_a_hull_is_closed_and_has_all_points_of_its_faces() -> None:
    places = turned(grid(5, 3, 3))
    phi = np.random.default_rng(2).normal(size=(len(places), 3, 2))
    found = convex_hull(places, phi)
    assert found is not None
    positions, triangles, shapes = found
    inner = 3  # of 5 x 3 x 3 points 3 x 1 x 1 are inside
    assert len(positions) == len(places) - inner
    rows = [int(np.linalg.norm(places - p, axis=1).argmin()) for p in positions]
    assert np.array_equal(places[rows], positions)
    assert np.array_equal(phi[rows], shapes)
    assert not len(border_edges(triangles))
    p, q, r = np.moveaxis(positions[triangles] - positions.mean(axis=0), 1, 0)
    signed = np.einsum("pa,pa->p", p, np.cross(q, r)) / 6
    assert (signed > -1e-12).all()  # all faces look outwards
    assert signed.sum() == pytest.approx(EDGES.prod())


@pytest.mark.parametrize("counts", [(4, 1, 1), (4, 3, 1), (2, 1, 1)])
def test_points_in_a_plane_or_on_a_line_have_no_hull(
    counts: tuple[int, int, int],
) -> None:
    places = turned(grid(*counts))
    assert convex_hull(places, np.zeros((len(places), 3, 1))) is None


def test_bars_join_the_neighbours_of_a_grid_without_diagonals() -> None:
    places = turned(grid(4, 3, 1))
    fixed = np.zeros((12, 3, 1))
    positions, triangles, _ = node_bars(places, fixed, fixed, 0.01)
    ends = positions.reshape(-1, 2, 4, 3).mean(axis=2)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert sorted(np.round(lengths, 9)) == [0.2] * 8 + [1.0] * 9
    assert len(triangles) > 0


def test_ends_without_rotations_are_joined_by_straight_lines() -> None:
    """Half the displacement in the middle; with rotations known the line bends."""
    places = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    phi = np.zeros((2, 3, 1))
    phi[1, 1] = 1.0
    psi = np.zeros((2, 3, 1))
    positions, _, shapes = node_bars(places, phi, psi, 0.01)
    assert np.allclose(shapes[:, 1, 0], positions[:, 0])
    psi[:, 2] = [[0.3], [1.5]]
    positions, _, shapes = node_bars(places, phi, psi, 0.01)
    x = positions[:, 0]
    cubic = 0.3 * (x - 2 * x**2 + x**3) + 3 * x**2 - 2 * x**3 + 1.5 * (x**3 - x**2)
    assert np.allclose(shapes[:, 1, 0], cubic)


def test_pictures_note_an_unknown_surface(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A solid with stress points: its hull in place of a zigzag between these."""
    pages = []
    monkeypatch.setattr(bodies, "save_figure", lambda page, path: pages.append(page))
    model = volume({"type": "hex20", "elements": [4, 1, 1]}, 2)
    sid, field = field_from_model(model)
    bodies.plot_sid(Path("x.png"), sid, field)
    assert not any("not known" in text.get_text() for text in pages[0].texts)
    notes = bodies.plot_sid(Path("x.png"), sid)
    assert notes[0].endswith("(its surface is not known)")
    every = [text.get_text() for text in pages[1].texts] + [pages[1].get_suptitle()]
    assert notes[0] in every
    drawn = surface_of_sid("body", sid, 0.01)
    assert drawn.is_sketched
    assert isinstance(sid, sidtool.SID)
