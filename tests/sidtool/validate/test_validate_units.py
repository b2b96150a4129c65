"""Units: the physics survives a conversion, and the guess finds the system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    BLOCK_SHAPES,
    NODE_SHAPES,
    SID,
    Array,
    Taylor,
    rigid_sid,
)
from sidtool.formats.model import ModelFile
from sidtool.formats.sid_mass import coupled_mass_matrix
from sidtool.formats.toml.reading import validate_data
from sidtool.mesh.unit_systems import UNIT_SYSTEMS, unit_system
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.validate import (
    change_basis,
    check,
    convert_units,
    guess_units,
    rescale,
)
from sidtool.validate.body_modes import free_body, held_body
from sidtool.validate.frequencies import free_modes, held_modes
from tests.bodies import particle_body
from tests.codes import codes, only
from tests.sidtool.bodies import beam_data
from tests.sidtool.models import QM6, rod
from tests.sidtool.networks import clamped, mean_axis, random_network, sid_of


def _parts(sid: SID) -> list[Array]:
    entries = [getattr(sid, name) for name in BLOCK_SHAPES]
    entries += [getattr(node, name) for node in sid.nodes for name in NODE_SHAPES]
    present = [entry for entry in entries if entry is not None]
    return [a for entry in present for a in (entry.m0, entry.first_order(sid.nq))]


@pytest.mark.parametrize("system", UNIT_SYSTEMS)
def test_there_and_back(system: str) -> None:
    body = particle_body(3, 9, stiffening=True)
    there = convert_units(body, "SI", system)
    back = convert_units(there, system, "SI")
    for before, after in zip(_parts(body), _parts(back), strict=True):
        assert after == pytest.approx(before, rel=1e-14)
    assert back.mass == pytest.approx(body.mass)


@pytest.mark.parametrize("system", UNIT_SYSTEMS)
def test_frequencies_and_deflections_are_those_of_the_same_body(system: str) -> None:
    body = particle_body(3, 9, nodes=2, seed=1)
    units = UNIT_SYSTEMS[system]
    other = convert_units(body, "SI", system)
    for modes in (held_modes, free_modes):
        seconds = modes(other)[0] / units.time**2
        assert seconds == pytest.approx(modes(body)[0], rel=1e-9)
    force = units.mass * units.length / units.time**2
    deflection = held_body(other, other.nodes).flexibility() * units.length / force
    expected = held_body(body, body.nodes).flexibility()
    assert deflection == pytest.approx(expected, rel=1e-9)
    rigid = tuple(range(6))
    found = free_body(other, other.nodes, rigid).flexibility() * units.length / force
    expected = free_body(body, body.nodes, rigid).flexibility()
    assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max()


def test_kinetic_energy_with_dimensionless_elastic_coordinates() -> None:
    body = particle_body(2, 9, seed=2)
    units = UNIT_SYSTEMS["mm-t-s"]
    other = convert_units(body, "SI", "mm-t-s")
    q = np.array([1e-3, -2e-3])
    state = np.array([0.3, -0.1, 0.2, 1.0, 2.0, -3.0, 0.4, 0.5])
    scaled = np.concatenate([state[:3] / units.length, state[3:]])
    energy = scaled @ coupled_mass_matrix(other, q) @ scaled
    unit = units.mass * units.length**2
    assert energy * unit == pytest.approx(state @ coupled_mass_matrix(body, q) @ state)


@pytest.mark.parametrize("system", UNIT_SYSTEMS)
@pytest.mark.parametrize("stiffening", [False, True])
def test_the_verdicts_do_not_depend_on_units(system: str, stiffening: bool) -> None:
    body = particle_body(3, 12, seed=3, stiffening=stiffening)
    other = convert_units(body, "SI", system)
    before = [(c.id, c.verdict) for c in check(body) if c.id != "I15"]
    assert [(c.id, c.verdict) for c in check(other) if c.id != "I15"] == before


def test_known_factors() -> None:
    rod = rigid_sid(7.85, [0.5, 0.0, 0.0], np.diag([0.1, 2.0, 2.0]))
    steel = convert_units(rod, "SI", "mm-t-s")
    assert steel.mass == pytest.approx(7.85e-3)
    assert steel.mdCM.m0[0, 0] == pytest.approx(7.85e-3 * 500.0)
    assert steel.J.m0[1, 0] == pytest.approx(2.0 * 1e-3 * 1e6)


@pytest.mark.parametrize(("name", "system"), [("SI", "m-kg-s"), (" MM-T-S", "mm-t-s")])
def test_names_of_systems(name: str, system: str) -> None:
    assert unit_system(name).name == system


@pytest.mark.parametrize("system", UNIT_SYSTEMS.values(), ids=UNIT_SYSTEMS)
def test_the_named_force_is_the_derived_one(system: object) -> None:
    newtons = {
        "N": 1.0,
        "kN": 1e3,
        "mN": 1e-3,
        "dyn": 1e-5,
        "lbf": 4.4482216152605,
    }
    derived = system.mass * system.length / system.time**2  # type: ignore[attr-defined]
    assert derived == pytest.approx(newtons[system.force])  # type: ignore[attr-defined]


def _with_sigma(sid: SID) -> SID:
    node = replace(sid.nodes[0], sigma=Taylor(np.ones((6, 1))))
    return replace(sid, nodes=(node, *sid.nodes[1:]))


def test_sigma_of_a_sid_of_ours_is_stress() -> None:
    """Only SIDs converted by sidtool have the compliance shares of the shape
    functions.
    """
    created = sid_from_model(rod({**QM6, "elements": [40, 4]}))
    body = replace(created, nodes=_with_sigma(created).nodes)
    assert body.carried is not None
    in_mpa = convert_units(body, "SI", "mm-t-s").nodes[0].sigma
    assert in_mpa is not None
    assert in_mpa.m0 == pytest.approx(np.full((6, 1), 1e-6))
    with pytest.raises(InputError, match="does not define what sigma holds"):
        convert_units(replace(body, carried=None), "SI", "mm-t-s")


def test_sigma_needs_a_statement() -> None:
    body = _with_sigma(particle_body(1, 9))
    with pytest.raises(InputError, match="node 1, sigma"):
        convert_units(body, "SI", "mm-t-s")
    stress = convert_units(body, "SI", "mm-t-s", sigma="stress").nodes[0].sigma
    force = convert_units(body, "SI", "mm-t-s", sigma="section force").nodes[0].sigma
    assert stress is not None and stress.m0[:, 0] == pytest.approx(1e-6)
    assert force is not None
    assert force.m0[:, 0] == pytest.approx([1.0] * 3 + [1e3] * 3)


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_factors(factor: float) -> None:
    with pytest.raises(InputError, match="length"):
        rescale(particle_body(1, 9), length=factor, mass=1.0, time=1.0)


def test_unknown_system_and_unknown_contents() -> None:
    body = particle_body(1, 9)
    with pytest.raises(InputError, match="mm-t-s"):
        convert_units(body, "SI", "furlongs")
    with pytest.raises(InputError, match="block Kgeo"):
        convert_units(replace(body, extra={"Kgeo": Taylor(np.eye(1))}), "SI", "mm-t-s")
    higher = replace(body, Ke=Taylor(body.Ke.m0, mn=np.ones((1, 1, 1))))
    with pytest.raises(InputError, match="block Ke"):
        convert_units(higher, "SI", "mm-t-s")
    with pytest.raises(InputError, match="one row per elastic coordinate"):
        change_basis(body, np.eye(2))


# --- guessing -------------------------------------------------------------------------


def _steel_link(labels: bool = True) -> SID:
    """7.85 kg of steel in SI, 1 m long, with two modes below and above 100 Hz."""
    network = random_network(4, 1)
    masses = network.masses / network.masses.sum() * 7.85
    size = np.array([1.0, 0.04, 0.03])
    points = network.points / np.ptp(network.points, axis=0) * size
    shaped = replace(network, masses=masses, points=points)
    body = change_basis(sid_of(shaped, clamped), np.eye(6)[:, :2], labels=("", ""))
    omega = 2 * np.pi * np.array([41.0, 230.0])
    modes = held_modes(body)[1]
    inverse = np.linalg.inv(modes)
    body = replace(body, Ke=Taylor(inverse.T @ np.diag(omega**2) @ inverse))
    texts = tuple(f"Eigen Mode {f:13.3f} Hz" for f in (41.0, 230.0))
    return replace(body, labels=texts) if labels else body


@pytest.mark.parametrize("labels", [True, False])
@pytest.mark.parametrize(
    "system", ["m-kg-s", "mm-t-s", "mm-kg-ms", "mm-g-ms", "mm-kg-s"]
)
def test_the_guess_finds_the_system(system: str, labels: bool) -> None:
    guess = guess_units(convert_units(_steel_link(labels), "SI", system))
    assert guess.system == system and guess.certain
    assert codes(guess) == ([] if system == "m-kg-s" else ["N930"])
    assert all(each.data["system"] == system for each in guess.diagnostics)


def test_inches_are_certain_only_with_frequencies_in_the_labels() -> None:
    labelled, unlabelled = (
        guess_units(convert_units(_steel_link(labels), "SI", "in-lbf-s"))
        for labels in (True, False)
    )
    assert labelled.system == unlabelled.system == "in-lbf-s"
    assert labelled.certain and not unlabelled.certain
    assert labelled.nearly == [] and unlabelled.nearly[0] in UNIT_SYSTEMS


def test_a_mixture_is_noticed() -> None:
    """Stiffness in N/mm beside masses in kg: frequencies are off by sqrt(1000)."""
    body = _steel_link()
    mixed = replace(body, Ke=Taylor(1e-3 * body.Ke.m0))
    ratio = only(guess_units(mixed), "N932").data["ratio"]
    assert ratio == pytest.approx(1000**0.5, rel=1e-3)


def test_a_body_of_no_system_is_noticed() -> None:
    """A link of 1e28 kg/m3, as no unit of mass and length makes of a solid."""
    body = _steel_link(labels=False)
    heavy = {name: Taylor(1e25 * getattr(body, name).m0) for name in ("J", "mdCM")}
    guess = guess_units(replace(body, mass=1e25 * body.mass, **heavy))
    assert codes(guess) == ["N931"]


def test_nothing_to_judge_by() -> None:
    guess = guess_units(rigid_sid(1.0, np.zeros(3), np.zeros((3, 3))))
    assert guess.system is None and not guess.diagnostics


def test_a_free_body_with_labels_is_understood() -> None:
    network = random_network(4, 2)
    free = sid_of(network, mean_axis)
    hertz = np.sqrt(network.modes()[0]) / (2 * np.pi)
    attached = sid_of(network, clamped)
    texts = tuple(f"{f:.6f} Hz" for f in hertz)
    for body in (free, attached):
        labelled = replace(body, labels=texts)
        assert {c.id: c for c in check(labelled)}["I15"].verdict == "passed"
        assert "N932" not in codes(guess_units(labelled))


@pytest.mark.parametrize(
    ("length", "height", "width", "density"),
    [(40.0, 0.5, 2.0, 100.0), (80.0, 0.8, 3.5, 90.0), (0.7, 0.006, 0.06, 1200.0)],
)
def test_a_blade_in_si_is_in_si(
    length: float, height: float, width: float, density: float
) -> None:
    """Hollow, so of little density, and long; feet and slugs would fit, too."""
    data = beam_data({"type": "beam", "elements": 20}, 4)
    section = {"shape": "rectangle", "height": height, "width": width}
    data["geometry"] = {
        "type": "beam",
        "start": [0, 0, 0],
        "end": [length, 0, 0],
        "section": section,
    }
    data["material"] |= {"density": density, "youngs_modulus": 3e9}
    guess = guess_units(sid_from_model(validate_data(data, ModelFile)))
    assert guess.system == "m-kg-s" and not guess.warnings
