"""The coupled mass matrix: kinetic energy, and bodies that cannot move freely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, Taylor, rigid_sid
from sidtool.formats.sid_mass import (
    IN_PLANE,
    central_inertia,
    centre_of_mass,
    coupled_mass_matrix,
    free_modal_mass,
    free_motion,
    plane_of_motion,
)
from tests.bodies import particle_body


def test_kinetic_energy_is_that_of_the_particles() -> None:
    masses = np.array([1.0, 2.0, 0.5])
    points = np.array([[0.1, 0.2, 0.0], [1.0, -0.3, 0.4], [0.2, 0.5, -0.7]])
    inertia = sum(
        m * (p @ p * np.eye(3) - np.outer(p, p))
        for m, p in zip(masses, points, strict=True)
    )
    body = rigid_sid(masses.sum(), masses @ points / masses.sum(), inertia)
    velocity, omega = np.array([0.3, -0.2, 0.7]), np.array([1.1, 0.4, -0.6])
    energy = 0.5 * masses @ ((velocity + np.cross(omega, points)) ** 2).sum(axis=1)
    state = np.concatenate([velocity, omega])
    assert 0.5 * state @ coupled_mass_matrix(body) @ state == pytest.approx(energy)


@pytest.mark.parametrize("planar", [False, True])
def test_mass_matrix_of_the_deformed_body_is_its_first_order_expansion(
    planar: bool,
) -> None:
    body = particle_body(3, 8, planar, seed=3)
    q = 1e-3 * np.arange(1.0, 4.0)
    step = coupled_mass_matrix(body, q) - coupled_mass_matrix(body)
    assert np.allclose(
        coupled_mass_matrix(body, 2 * q), coupled_mass_matrix(body) + 2 * step
    )
    assert np.allclose(step[:3, 6:], np.zeros((3, 3)))
    assert np.allclose(step[3:6, 6:].T, body.Cr.at(q) - body.Cr.m0)


def test_central_inertia_does_not_depend_on_the_origin() -> None:
    tensor = np.diag([1.0, 2.0, 2.5])
    centre, mass = np.array([3.0, -2.0, 0.5]), 4.0
    shifted = tensor + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    body = rigid_sid(mass, centre, shifted)
    assert np.allclose(centre_of_mass(body), centre)
    assert np.allclose(central_inertia(body), tensor)


@pytest.mark.parametrize("nq", [0, 1, 4])
@pytest.mark.parametrize("planar", [False, True])
def test_particles_can_move_freely(nq: int, planar: bool) -> None:
    body = particle_body(nq, 9, planar, seed=nq)
    assert free_motion(body).possible and free_motion(body, IN_PLANE[2]).possible
    assert plane_of_motion(body) == (2 if planar else None)
    eigenvalues = np.linalg.eigvalsh(coupled_mass_matrix(body))
    assert eigenvalues.min() > 0.0


def test_the_deciding_number_is_free_of_units_and_basis() -> None:
    body = particle_body(4, 9, seed=5)
    smallest = free_motion(body).smallest
    share = np.linalg.eigvals(np.linalg.solve(body.Me.m0, free_modal_mass(body)))
    assert smallest == pytest.approx(share.real.min(), rel=1e-10)


def test_line_beam_without_polar_inertia_is_singular() -> None:
    rod = rigid_sid(1.0, [0.5, 0.0, 0.0], np.diag([0.0, 1 / 3, 1 / 3]))
    motion = free_motion(rod)
    assert motion.smallest == 0.0 and "no moment of inertia about x" in motion.reason
    assert free_motion(rod, IN_PLANE[2]).possible


def test_planar_data_move_in_their_plane_only() -> None:
    rod = rigid_sid(1.0, [0.5, 0.0, 0.0], np.diag([0.0, 0.0, 1 / 3]))
    assert plane_of_motion(rod) == 2
    assert "negative about y" in free_motion(rod).reason
    assert free_motion(rod, IN_PLANE[2]).smallest == 1.0


def test_more_momentum_than_modal_mass_is_indefinite() -> None:
    body = particle_body(2, 9, seed=2)
    greedy = replace(body, Ct=Taylor(4.0 * body.Ct.m0))
    motion = free_motion(greedy)
    assert motion.smallest < 0.0 and "indefinite" in motion.reason
    assert not motion.possible
    assert np.linalg.eigvalsh(coupled_mass_matrix(greedy)).min() < 0.0


@pytest.mark.parametrize(
    ("mass", "inertia", "reason"),
    [
        (0.0, np.eye(3), "mass is not positive"),
        (-1.0, np.eye(3), "mass is not positive"),
        (1.0, np.zeros((3, 3)), "no moment of inertia"),
        (1.0, -np.eye(3), "negative"),
    ],
)
def test_impossible_rigid_bodies(mass: float, inertia: np.ndarray, reason: str) -> None:
    assert reason in free_motion(rigid_sid(mass, np.zeros(3), inertia)).reason


def test_modal_mass_that_is_not_positive() -> None:
    body = particle_body(2, 9, seed=2)
    broken: SID = replace(body, Me=Taylor(np.diag([1.0, -1.0])))
    assert "Me is not positive definite" in free_motion(broken).reason
