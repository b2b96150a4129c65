"""Equations and mean motions between nodes of structures: MPC and RBE3 of shells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from tests.codes import with_code

from .bars.decks import (
    PBAR,
    PLACES,
    RHO,
    E,
    body,
    frame,
)
from .decks import frequencies
from .test_structures import BEAM, DIRECT, LENGTH, TURN, beam_hertz, grid, halves

THROUGH_A_FREE_NODE = (
    "GRID,99,,7.,7.,7.",
    *(f"MPC,9,99,{d},2.,{n},{d},-2." for d in range(1, 7) for n in (9, 10)),
)


def test_rotations_take_part_in_a_mean_motion(tmp_path: Path) -> None:
    """RBE3 to two nodes of a bar by all six directions: about its axis the mean of the
    rotations; across it as much of the chord as of the rotations, which have the weight
    of the displacements times the square of the distance.
    """
    middle = grid(10, (PLACES[1] + PLACES[2]) / 2)
    text = frame(PBAR, middle, "RBE3,9,,10,123456,1.,123456,2,3")
    markers = {"a": 2, "b": 3, "m": 10}
    described = {
        name: {"node": k, "mesh_node": node}
        for k, (name, node) in enumerate(markers.items(), 1)
    }
    sid = body(tmp_path, text, markers=described)
    first, last, mean = sid.nodes
    axis = PLACES[2] - PLACES[1]
    length = np.linalg.norm(axis)
    axis = axis / length
    turns = (first.psi.m0 + last.psi.m0) / 2
    chord = np.cross(axis, last.phi.m0 - first.phi.m0, axisb=0).T / length
    along = np.outer(axis, axis) @ turns
    expected = along + (turns - along + chord) / 2
    size = np.abs(expected).max()
    assert_allclose(mean.psi.m0, expected, atol=1e-9 * size)
    assert_allclose(mean.phi.m0, (first.phi.m0 + last.phi.m0) / 2, atol=1e-9 * size)


def test_nodes_on_a_line_without_rotations_have_no_mean_rotation(
    tmp_path: Path,
) -> None:
    middle = grid(10, (PLACES[1] + PLACES[2]) / 2)
    text = frame(PBAR, middle, "RBE3,9,,10,123456,1.,123,2,3", "CONM2,99,10,,1.")
    with pytest.raises(InputError) as error:
        body(tmp_path, text)
    assert "RBE3 9" in error.value.problem


@pytest.mark.parametrize("links", [DIRECT, THROUGH_A_FREE_NODE])
def test_mpc_of_all_directions_make_one_beam_of_two(
    links: tuple[str, ...], tmp_path: Path
) -> None:
    sid = body(tmp_path, halves(*links))
    assert sid.mass == pytest.approx(RHO * 1e-4 * LENGTH, rel=1e-9)
    expected = [beam_hertz(E * 1e-9, RHO * 1e-4, root) for root in BEAM]
    assert_allclose(frequencies(sid)[[0, 2]], expected, rtol=5e-3)
    (held,) = with_code(sid, "N133")
    assert held.data["count"] == sum(card.startswith("MPC") for card in links)


def test_mpc_of_displacements_and_rotations_are_a_rigid_arm(tmp_path: Path) -> None:
    """In mm: u = u0 + theta x r, where RBE2 says the same."""
    gap = 40.0
    arm = (TURN @ [gap, 0.0, 0.0]).tolist()
    links = [f"MPC,9,10,{d},1.,9,{d},-1." for d in (4, 5, 6)]
    for d in range(3):
        second, third = (d + 1) % 3, (d + 2) % 3
        links.append(
            f"MPC,9,10,{d + 1},1.,9,{d + 1},-1.,,\n"
            f",,9,{second + 4},{-arm[third]!r},9,{third + 4},{arm[second]!r}"
        )
    found = [
        frequencies(
            body(tmp_path, halves(*held, gap=gap, unit=1e-3), geometry={"unit": 1e-3})
        )
        for held in (links, ["RBE2,90,9,123456,10"])
    ]
    assert_allclose(found[0], found[1], rtol=1e-8)


def test_an_mpc_that_supports_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="resists a rigid motion"):
        body(tmp_path, halves(*DIRECT, "MPC,9,3,6,1.,5,6,1."))
