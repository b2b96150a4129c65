"""Fixtures that several test modules share."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Tests assert no wall-clock times: neither does hypothesis on a busy machine.
settings.register_profile(
    "sidtool", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("sidtool")

# Where the suite itself was started with ignored signals (`nohup make test &`), the
# commands that it starts and ends would inherit that.
for number, usual in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, usual)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Modules and tests live as long as the suite: no search for garbage among them."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(scope="session")
def field_data() -> Path:
    """The folder of SID files that other tools wrote; it is not part of the clone."""
    default = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("SIDTOOL_FIELD_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"the real files from the field are not here ({folder.name})")
    return folder
