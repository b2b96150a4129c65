"""Models that several tests of studies share."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sidtool.measurement import tasks

from ..beams import beam_data
from .parts import IGA, Q4


@pytest.fixture(autouse=True)
def timed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Conversions and runs of studies are not repeated for their computing times."""
    monkeypatch.setattr(tasks, "MIN_TOTAL_SECONDS", 1e-9)
    monkeypatch.setattr(tasks, "MAX_REPEATS", 1)


@pytest.fixture
def models(tmp_path: Path) -> list[Path]:
    """A unit cantilever as Q4 and as IGA, with two modes."""
    found = []
    for name, mesh in (("q4", Q4), ("iga", IGA)):
        data = beam_data(mesh, reduction={"method": "modal", "modes": 2})
        found.append(tmp_path / f"{name}.json")
        found[-1].write_text(json.dumps(data), encoding="utf-8")
    return found
