"""Fixtures that several test modules share."""

from __future__ import annotations

import gc
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tests.optional import NAMES, Machine

# Tests assert no wall-clock times: neither does hypothesis on a busy machine.
settings.register_profile(
    "sidtool", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("sidtool")

# Where the suite itself was started with ignored signals (`nohup make test &`), the
# commands that it starts and ends would inherit that.
for name, usual in (
    ("SIGINT", signal.default_int_handler),
    ("SIGHUP", signal.SIG_DFL),  # Windows has none
):
    number = getattr(signal, name, None)
    if number is not None and signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, usual)

# Hidden from here on: what a test module imports must be on every machine.
MACHINE = Machine()
STARTED_IN = os.getcwd()


def pytest_unconfigure() -> None:
    MACHINE.close()


def _needed(item: pytest.Item) -> list[str]:
    return [name for mark in item.iter_markers("needs") for name in mark.args]


#: Files of few tests that take longest, about 70 and 30 s.
LONG_FILES = ("test_examples.py", "test_docs.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what needs a program or package that this machine does not have.

    Files that take longest come first, those of many tests before those of few, so
    that workers that take files in turn finish together.
    """
    sizes = Counter(item.path for item in items)
    items.sort(key=lambda i: (i.path.name not in LONG_FILES, -sizes[i.path], i.path))
    for item in items:
        for name in _needed(item):
            if name not in NAMES:
                raise pytest.UsageError(f"{item.nodeid}: unknown need {name!r}")
            if not MACHINE.has(name):
                item.add_marker(pytest.mark.skip(reason=f"{name} is not installed"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """A test finds the optional programs and packages that it is marked with."""
    with MACHINE.showing(_needed(item)):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Iterator[None]:
    """A test leaves the working folder as it was: a folder of its own is removed."""
    yield
    try:
        folder = os.getcwd()
    except FileNotFoundError:
        folder = ""
    if folder != STARTED_IN:
        os.chdir(STARTED_IN)
        pytest.fail(f"leaves the working folder {folder or 'that is removed'}")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Modules and tests live as long as the suite: no search for garbage among them,
    and fewer later, as the many small objects of a test do not refer to each other.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
        gc.set_threshold(50_000, 20, 20)


@pytest.fixture(scope="session")
def field_data() -> Path:
    """The folder of SID files that other tools wrote; it is not part of the clone."""
    default = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("SIDTOOL_FIELD_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"the real files from the field are not here ({folder.name})")
    return folder


@pytest.fixture(scope="session")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder of an example, after the commands of its README."""
    from tests.commands import run_page
    from tests.example_runs import copy_examples

    top = tmp_path_factory.mktemp("examples")
    copy_examples(top)

    @cache
    def run(name: str) -> Path:
        run_page(top / name / "README.md", top / name)
        return top / name

    return run
