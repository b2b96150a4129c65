"""Models that several tests of studies share."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ..beams import beam_data
from .parts import IGA, Q4


@pytest.fixture
def models(tmp_path: Path) -> list[Path]:
    """A unit cantilever as Q4 and as IGA, with two modes."""
    found = []
    for name, mesh in (("q4", Q4), ("iga", IGA)):
        data = beam_data(mesh, reduction={"method": "modal", "modes": 2})
        found.append(tmp_path / f"{name}.json")
        found[-1].write_text(json.dumps(data), encoding="utf-8")
    return found
