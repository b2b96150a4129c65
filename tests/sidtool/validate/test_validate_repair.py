"""Repair: what is rebuilt, what is listed, and what stays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sidtool.conversion.frame_change import FrameChange, apply_frame_change
from sidtool.formats.base.sid import BLOCK_SHAPES, SID, Array, Taylor, rigid_sid
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.validate import check, repair
from tests.bodies import particle_body


def _verdicts(sid: SID) -> dict[str, str]:
    return {c.id: c.verdict for c in check(sid)}


def _one_product_only(body: SID) -> SID:
    """Oe1 as PY_SID writes it: C3_ab without C3_ba in the columns xy, yz and xz."""
    Oe1 = body.Oe.first_order(body.nq).copy()
    Oe1[..., 3:] += np.triu(Oe1[..., 3:].T, 1).T - np.tril(Oe1[..., 3:].T, -1).T
    return replace(body, Oe=Taylor(body.Oe.m0, Oe1))


@pytest.mark.parametrize("stiffening", [False, True])
@pytest.mark.parametrize("nq", [0, 1, 4])
def test_a_sound_body_comes_back_as_it_is(nq: int, stiffening: bool) -> None:
    body = particle_body(nq, 12, stiffening=stiffening)
    assert repair(body) == (body, ())


def test_a_rigid_body_needs_no_repair() -> None:
    body = rigid_sid(1.0, np.zeros(3), np.eye(3))
    assert repair(body) == (body, ())


@pytest.mark.parametrize("stiffening", [False, True])
def test_lost_blocks_are_rebuilt(stiffening: bool) -> None:
    body = particle_body(4, 12, seed=1, stiffening=stiffening)
    missing = _one_product_only(
        replace(body, Gr=Taylor(np.zeros((3, 12))), Ge=Taylor(np.zeros((4, 12))))
    )
    repaired, changes = repair(missing)
    assert repaired.Gr.m0 == pytest.approx(body.Gr.m0, abs=1e-12)
    assert repaired.Ge.m0 == pytest.approx(body.Ge.m0, abs=1e-12)
    assert repaired.Oe.m1 == pytest.approx(body.Oe.m1, abs=1e-12)
    assert {change.block for change in changes} == {"Gr", "Ge", "Oe"}
    assert "failed" not in _verdicts(repaired).values()


def _value(sid: SID, block: str, entry: str) -> float:
    kind, _, rest = entry.partition("(")
    index = [int(text) - 1 for text in rest.rstrip(")").split(",")]
    taylor = getattr(sid, block)
    if kind == "m0":
        return float(taylor.m0[index[0], index[1]])
    return float(taylor.m1[index[1], index[0], index[2]])


def _numbers(sid: SID) -> Array:
    parts = [getattr(sid, name) for name in BLOCK_SHAPES]
    return np.concatenate(
        [a.ravel() for part in parts for a in (part.m0, part.first_order(sid.nq))]
    )


def test_every_changed_number_is_listed_and_no_other() -> None:
    body = particle_body(3, 12, seed=2)
    Ge = body.Ge.m0.copy()
    Ge[1, 5] += 0.25
    broken = _one_product_only(replace(body, Ge=Taylor(Ge)))
    repaired, changes = repair(broken)
    for change in changes:
        assert _value(broken, change.block, change.entry) == change.before
        assert _value(repaired, change.block, change.entry) == change.after
        assert change.before != change.after and change.reason
    different = np.count_nonzero(_numbers(broken) != _numbers(repaired))
    assert different == len(changes)
    assert [c.entry for c in changes if c.block == "Ge"] == ["m0(2,6)"]


def test_blocks_that_do_not_follow_from_others_are_unchanged() -> None:
    body = particle_body(3, 12, seed=3)
    odd = replace(body, Ke=Taylor(-body.Ke.m0), Ct=Taylor(7.0 * body.Ct.m0))
    assert repair(odd) == (odd, ())


@pytest.mark.parametrize(
    ("file", "blocks"),
    [
        ("Beam_3m.SID_FEM", {"Gr", "Oe"}),
        ("balken1m.SID_FEM", {"Gr", "Ge"}),
        ("beam.SID_FEM", {"Gr", "Oe"}),
        ("example.sid_fem", {"Gr", "Ge", "Cr"}),
    ],
)
def test_field_files(field_data: Path, file: str, blocks: set[str]) -> None:
    sid = read_sid(field_data / "sid" / file)
    repaired, changes = repair(sid)
    assert {change.block for change in changes} == blocks
    verdicts = _verdicts(repaired)
    mended = [verdicts[name] for name in ("I6", "I7", "I8", "I11")]
    # FEMBS put a symmetric part into Cr1 of the example; Ge follows the exact theory.
    assert mended == ["passed"] * 4
    assert verdicts["I10"] in ("passed", "not applicable")
    again, more = repair(repaired)
    assert again is repaired and not more


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("shift", [0.0, 30.0])
def test_a_sound_file_comes_back_as_it_is(
    tmp_path: Path, seed: int, shift: float
) -> None:
    """Twelve digits of a sound body, also stiffened and with its frame far away."""
    body = particle_body(4, 12, seed=seed, stiffening=True)
    change = FrameChange(shift * np.ones(3), np.zeros((4, 3)), np.zeros((4, 3)))
    write_sid(tmp_path / "sound.SID_FEM", apply_frame_change(body, change))
    found = read_sid(tmp_path / "sound.SID_FEM")
    assert repair(found) == (found, ())
