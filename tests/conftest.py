"""Fixtures that several test modules share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Tests assert no wall-clock times: neither does hypothesis on a busy machine.
settings.register_profile(
    "sidtool", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("sidtool")


@pytest.fixture(scope="session")
def field_data() -> Path:
    """The folder of SID files that other tools wrote; it is not part of the clone."""
    default = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("SIDTOOL_FIELD_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"the real files from the field are not here ({folder.name})")
    return folder
