"""A print with few digits is no defect, and a defect is none of the print."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sidtool.conversion.frame_change import (
    FrameChange,
    apply_frame_change,
    change_frame,
)
from sidtool.formats.base.sid import SID, Array, Taylor
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.validate import check, verdict
from sidtool.validate.checks import rounding_of
from tests.bodies import particle_body

FORMATS = ["%.4f", "%.6f", "%.5e", "%.7e", "%.9g"]


def printed(sid: SID, form: str) -> SID:
    """Every number of a body as a file in this format has it."""

    def each(array: Array | None) -> Array | None:
        texts = None if array is None else [float(form % x) for x in array.flat]
        return None if array is None else np.reshape(texts, array.shape).astype(float)

    def block(entry: Taylor) -> Taylor:
        return replace(entry, m0=each(entry.m0), m1=each(entry.m1))  # type: ignore[arg-type]

    names = ("origin", "phi", "psi", "AP")
    nodes = tuple(
        replace(node, **{name: block(getattr(node, name)) for name in names})
        for node in sid.nodes
    )
    blocks: dict[str, Any] = {name: block(b) for name, b in sid.blocks.items()}
    return replace(sid, nodes=nodes, **blocks)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("seed", range(3))
def test_print_rounding_is_reported_and_passes(form: str, seed: int) -> None:
    body = printed(particle_body(4, 40, seed=seed, stiffening=seed == 1), form)
    checks = check(body)
    assert verdict(checks), [c.id for c in checks if c.failed]
    details = {c.id: c.detail for c in checks if "rounding only" in c.detail}
    assert {"I5", "I6"} <= set(details)
    unit = f"{form[2]} decimals" if form[3] == "f" else "digits"
    assert all(unit in detail for detail in details.values())


def _lost(sid: SID) -> SID:
    return replace(sid, Oe=Taylor(sid.Oe.m0 * 1.002, sid.Oe.m1))


def _mixed(sid: SID) -> SID:
    return replace(sid, Gr=Taylor(sid.Gr.m0[:, ::-1]))


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(("name", "spoil"), [("I5", _lost), ("I6", _mixed)])
def test_defects_are_detected_despite_print_rounding(
    form: str, name: str, spoil: Callable[[SID], SID]
) -> None:
    checks = check(printed(spoil(particle_body(4, 40, seed=3)), form))
    assert name in {c.id for c in checks if c.failed}


def test_a_body_of_few_numbers_is_not_taken_for_a_rough_print() -> None:
    body = particle_body(1, 4, nodes=0)
    rough = printed(body, "%.0e")
    assert rounding_of(rough).share(1.0) == 0.0
    assert not verdict(check(rough))


def test_full_prints_are_exact(tmp_path: Path) -> None:
    body = particle_body(4, 40)
    write_sid(tmp_path / "body.SID_FEM", body)
    for sid in (body, read_sid(tmp_path / "body.SID_FEM")):
        assert rounding_of(sid).share(1.0) == 0.0


@pytest.mark.parametrize("distance", [30.0, 300.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_change_of_frame_leaves_no_rounding(
    tmp_path: Path, seed: int, distance: float
) -> None:
    """Large numbers of a far frame, printed, then taken back to mean axes."""
    rng = np.random.default_rng(seed)
    away = FrameChange(
        distance * np.ones(3), np.zeros((3, 3)), 0.3 * rng.normal(size=(3, 3))
    )
    far = tmp_path / "far.SID_FEM"
    write_sid(far, apply_frame_change(particle_body(3, 12, seed=seed), away))
    assert verdict(check(read_sid(far)))
    back = tmp_path / "back.SID_FEM"
    write_sid(back, change_frame(read_sid(far), "buckens"))
    failed = {c.id for c in check(read_sid(back)) if c.failed and c.severity == "error"}
    assert not failed
