"""Identities I1 to I17: consistent bodies pass, and every check can fail."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sidtool.conversion.frame_change import FrameChange, apply_frame_change
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import (
    BLOCK_SHAPES,
    SID,
    Array,
    Taylor,
    axis_major,
    by_mode,
    rigid_sid,
)
from sidtool.formats.diagnostics import diagnose
from sidtool.formats.diagnostics.identities import IDENTITY_TEXTS
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.report.sid import describe_sid
from sidtool.validate import (
    change_basis,
    check,
    compare,
    convert_units,
    guess_units,
    repair,
    report,
    to_json,
    verdict,
)
from sidtool.validate.checks import Check
from sidtool.validate.identity import IDENTITIES
from tests.bodies import particle_body
from tests.solver.scenes import with_cubic_energy

check(rigid_sid(1.0, np.zeros(3), np.eye(3)))  # fills the registry


def _by_id(sid: SID) -> dict[str, Check]:
    return {c.id: c for c in check(sid)}


def test_the_registry_is_complete_with_its_severities() -> None:
    errors = {"I1", "I2", "I3", "I4", "I5", "I6", "I7", "I13", "I14"}
    errors |= {"I18", "I19", "I20", "I21"}
    assert list(_by_id(particle_body(1, 4))) == [f"I{k}" for k in range(1, 22)]
    assert {i for i, entry in IDENTITIES.items() if entry.severity == "error"} == errors


@pytest.mark.parametrize("stiffening", [False, True])
@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("nq", [0, 1, 2, 5])
def test_particles_fulfil_every_identity(
    nq: int, planar: bool, stiffening: bool
) -> None:
    checks = check(particle_body(nq, 12, planar, seed=nq, stiffening=stiffening))
    assert verdict(checks, strict=True)
    measured = {c.id: c.measured for c in checks if c.measured is not None}
    # Labels have three decimals; nothing else is rounded.
    assert measured.pop("I15", 0.0) < 1e-4
    assert max(measured.values()) < 1e-12


def test_the_verdicts_do_not_depend_on_the_basis() -> None:
    body = particle_body(4, 12, seed=4)
    mixed = change_basis(
        body, np.random.default_rng(0).normal(size=(4, 4)), labels=body.labels
    )
    assert verdict(check(mixed), strict=True)


def test_rigid_bodies_have_only_a_mass_to_judge() -> None:
    checks = check(rigid_sid(2.0, [0.1, 0.0, 0.0], np.diag([1.0, 2.0, 2.5])))
    applicable = {c.id for c in checks if c.verdict != "not applicable"}
    assert applicable == {"I1", "I14", "I16"} and verdict(checks, strict=True)


# --- every check can fail -----------------------------------------------------------


def _m0(name: str, change: Callable[[Array], Array]) -> Callable[[SID], SID]:
    def perturb(sid: SID) -> SID:
        block = getattr(sid, name)
        return replace(sid, **{name: replace(block, m0=change(block.m0.copy()))})

    return perturb


def _m1(name: str, change: Callable[[Array], Array]) -> Callable[[SID], SID]:
    def perturb(sid: SID) -> SID:
        block = getattr(sid, name)
        return replace(sid, **{name: replace(block, m1=change(block.m1.copy()))})

    return perturb


def _without_energy(sid: SID) -> SID:
    """A force on the second coordinate that the first one makes, but not back."""
    term = np.zeros((sid.nq, sid.nq, sid.nq))
    term[0, 1, 0] = 1.0
    return replace(sid, Ke=replace(sid.Ke, m1=term))


def _nudged(array: Array) -> Array:
    """The largest entry changed by 1e-9 of itself: visible in a print of 12 digits."""
    array.flat[np.abs(array).argmax()] *= 1.0 + 1e-9
    return array


def _node(name: str) -> Callable[[SID], SID]:
    def perturb(sid: SID) -> SID:
        first, *others = sid.nodes
        entry = getattr(first, name)
        changed = replace(first, **{name: replace(entry, m1=_nudged(entry.m1.copy()))})
        return replace(sid, nodes=(changed, *others))

    return perturb


def _wrong_title(sid: SID) -> SID:
    wrong = diagnose("N842", announced="5 nodes and 4 modes", found="2 and 4")
    return replace(sid, diagnostics=(wrong,))


def _symmetric_part(Cr1: Array) -> Array:
    Cr1[0, 1] += 1e-9 * np.abs(Cr1).max()
    Cr1[1, 0] += 1e-9 * np.abs(Cr1).max()
    return Cr1


def _skewed_gr(Gr: Array) -> Array:
    per_mode = by_mode(Gr, 4).copy()
    per_mode[0] += np.abs(Gr).max() * np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 0]])
    return axis_major(per_mode)


def _one_product_only(Oe1: Array) -> Array:
    Oe1[..., 3] += np.triu(Oe1[..., 3], 1)
    return Oe1


def _coupled(De: Array) -> Array:
    De[0, 1] = De[1, 0] = 0.1 * De[0, 0]
    return De


def _reflected(sid: SID) -> SID:
    first, *others = sid.nodes
    mirror = first.AP.m0 @ np.diag([1.0, 1.0, -1.0])
    moved = replace(first, AP=replace(first.AP, m0=mirror))
    return replace(sid, nodes=(moved, *others))


PERTURBATIONS: dict[str, Callable[[SID], SID]] = {
    "I1": _wrong_title,
    "I2": _node("origin"),
    "I3": _node("AP"),
    "I4": _m1("mdCM", _nudged),
    "I5": _m0("Oe", _nudged),
    "I6": _m0("Gr", lambda Gr: Gr + 1e-9 * np.abs(Gr).max()),
    "I7": _m0("Ge", _nudged),
    "I8": _m0("Ge", _nudged),
    "I9": _m1("Cr", _symmetric_part),
    "I10": _m0("Gr", _skewed_gr),
    "I11": _m1("Oe", _one_product_only),
    "I12": _m0("Me", lambda Me: 1.5 * Me),
    "I13": _m0("Ke", lambda Ke: -Ke),
    "I14": _m0("Ct", lambda Ct: 10.0 * Ct),
    "I15": _m0("Ke", lambda Ke: 1.1 * Ke),
    "I16": _m0("J", lambda J: J + [[200.0], [0], [0], [0], [0], [0]]),
    "I17": _m0("De", _coupled),
    "I18": _reflected,
    "I19": _m0("Oe", np.zeros_like),
    "I20": _m1("Ct", np.negative),
    "I21": _without_energy,
}


def _one_sided() -> SID:
    """Particles far from the origin of their frame, as those of a tower."""
    body = particle_body(4, 12, seed=7, stiffening=True)
    change = FrameChange(-np.array([0.0, 5.0, 9.0]), np.zeros((4, 3)), np.zeros((4, 3)))
    return apply_frame_change(body, change)


@pytest.mark.parametrize("name", IDENTITIES)
def test_every_check_can_fail(name: str) -> None:
    body = _one_sided() if name == "I20" else particle_body(4, 12, seed=7)
    assert _by_id(body)[name].verdict == "passed"
    found = _by_id(PERTURBATIONS[name](body))[name]
    assert found.verdict == "failed" and found.meaning
    assert found.measured is not None and found.bound is not None
    assert found.diagnostic.code == IDENTITY_TEXTS[name].code


def test_only_an_error_decides_unless_strict() -> None:
    body = particle_body(4, 12, seed=7)
    warned = check(PERTURBATIONS["I17"](body))
    assert verdict(warned) and not verdict(warned, strict=True)
    assert not verdict(check(PERTURBATIONS["I4"](body)))


@pytest.mark.parametrize("block", ["Me", "Ke", "De"])
def test_asymmetry_is_measured(block: str) -> None:
    def lopsided(matrix: Array) -> Array:
        matrix[0, 1] += 1e-6 * np.abs(matrix).max()
        return matrix

    found = _by_id(_m0(block, lopsided)(particle_body(3, 12)))["I13"]
    assert found.verdict == "failed" and found.measured == pytest.approx(1e-6, rel=0.1)


def test_elastic_forces_of_first_order_are_reported_and_checked() -> None:
    soft = with_cubic_energy(particle_body(3, 12), seed=2)
    assert "elastic forces     quadratic in q (Ke m1)" in describe_sid(soft)
    assert "elastic forces     linear" in describe_sid(particle_body(3, 12))
    checked = _by_id(soft)["I21"]
    assert checked.verdict == "passed" and "quadratic in q (Ke m1)" in checked.detail
    assert _by_id(particle_body(3, 12))["I21"].detail == "elastic forces are linear"
    assert "no energy" in _by_id(_without_energy(soft))["I21"].detail


@pytest.mark.parametrize("block", ["Me", "De", "ksigma"])
def test_terms_without_an_equation_are_reported_before_a_simulation(block: str) -> None:
    body = particle_body(2, 12)
    there = getattr(body, block)
    with_m1 = replace(there, m1=np.ones((2, *there.m0.shape)))
    found = _by_id(replace(body, **{block: with_m1}))["I21"]
    assert found.failed and f"{block} in the SID has a first-order term" in found.detail


def test_counts_come_from_the_reader(tmp_path: Path) -> None:
    path = tmp_path / "body.SID_FEM"
    write_sid(path, particle_body(2, 9))
    text = path.read_text(encoding="utf-8").splitlines(keepends=True)
    text[0] = "    7" + text[0][5:]
    path.write_text("".join(text), encoding="utf-8")
    found = _by_id(read_sid(path))["I1"]
    assert found.verdict == "failed" and "7 nodes" in found.detail


# --- geometric stiffening, planar bodies, singular ones -------------------------------


def test_stiffening_is_recognised_and_not_taken_for_an_error() -> None:
    checks = _by_id(particle_body(4, 12, seed=1, stiffening=True))
    assert checks["I7"].verdict == checks["I8"].verdict == "passed"
    assert "Cr1 - Cr1^T" in checks["I7"].detail
    assert checks["I9"].verdict == checks["I12"].verdict == "not applicable"


def test_noise_of_the_writer_is_not_an_error() -> None:
    body = particle_body(1, 12, seed=2)
    noise = 1e-17 * np.ones((1, 1, 3))
    noisy = replace(
        body, Cr=Taylor(body.Cr.m0, noise), Ge=Taylor(axis_major(2 * noise))
    )
    checks = _by_id(noisy)
    assert all(checks[name].verdict == "passed" for name in ("I7", "I8", "I9"))


def test_planar_data_are_judged_in_their_plane() -> None:
    body = particle_body(2, 9, planar=True, seed=3)
    only_zz = body.J.m0 * [[0], [0], [1], [0], [0], [0]]
    flat = replace(body, J=Taylor(only_zz, body.J.m1))
    checks = _by_id(flat)
    assert checks["I14"].verdict == "passed" and "planar body" in checks["I14"].detail
    assert checks["I10"].verdict == checks["I16"].verdict == "not applicable"


def test_a_line_beam_without_polar_inertia_has_a_note() -> None:
    rod = rigid_sid(1.0, [0.5, 0.0, 0.0], np.diag([0.0, 1 / 3, 1 / 3]))
    # A rod along the diagonal of space: no axis of the frame is special.
    diagonal = rigid_sid(1.0, [0.3, 0.3, 0.3], np.eye(3) / 3 - np.ones((3, 3)) / 9)
    assert "no moment of inertia about x" in _by_id(rod)["I14"].detail
    assert "singular" in _by_id(diagonal)["I14"].detail


@pytest.mark.parametrize("absurd", [np.nan, np.inf, -1e200])
@pytest.mark.parametrize(
    "judge",
    [
        check,
        guess_units,
        repair,
        lambda sid: compare(sid, particle_body(2, 9)),
        lambda sid: compare(particle_body(2, 9), sid),
        lambda sid: convert_units(sid, "SI", "mm-t-s"),
    ],
)
def test_absurd_numbers_are_refused_by_name(
    judge: Callable[[SID], object], absurd: float
) -> None:
    body = particle_body(2, 9)
    with pytest.raises(InputError, match="Ke"):
        judge(replace(body, Ke=Taylor(np.full((2, 2), absurd))))


@pytest.mark.parametrize("factor", [0.0, -1.0, 1e90, 1e-200])
@pytest.mark.parametrize("block", ["mass", *BLOCK_SHAPES])
def test_strange_numbers_are_judged_without_an_exception(
    block: str, factor: float
) -> None:
    body = particle_body(3, 12)
    if block == "mass":
        strange = replace(body, mass=factor * body.mass)
    else:
        strange = _m0(block, lambda m0: factor * m0)(body)
    checks = check(strange)
    comparison, guess = compare(strange, body), guess_units(strange)
    json.loads(to_json(checks, comparison, guess))
    json.loads(to_json(checks, compare(body, strange), guess))


def test_rows_and_json_are_complete() -> None:
    checks = check(PERTURBATIONS["I14"](particle_body(4, 12, seed=7)))
    rows = report(checks)
    assert [row["id"] for row in rows] == [c.id for c in checks]
    assert "cannot move freely" in rows[13]["meaning"]
    data = json.loads(to_json(checks))
    assert data["passed"] is False and data["checks"][13]["verdict"] == "failed"
