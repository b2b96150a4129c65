"""How many threads linear algebra gets from the command line."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

#: The number that OpenBLAS finds when NumPy, which is not loaded before, loads it.
FOUND = """
import os, sys
from sidtool import command

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "numpy":
            print(os.environ["OPENBLAS_NUM_THREADS"])
            sys.exit()

assert "numpy" not in sys.modules
sys.meta_path.insert(0, Finder())
sys.argv[1:] = ["convert", "none.toml", "-o", "none.SID_FEM"]
command.main()
"""


@pytest.mark.parametrize(("requested", "found"), [(None, "1"), ("3", "3")])
def test_one_thread_unless_the_user_sets_more(
    requested: str | None, found: str
) -> None:
    """With two, an IGA volume of 4 000 unknowns took 8.8 for 2.7 processor seconds."""
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    if requested is not None:
        environment["OPENBLAS_NUM_THREADS"] = requested
    result = subprocess.run(
        [sys.executable, "-c", FOUND],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        encoding="utf-8",
    )
    assert result.stdout == f"{found}\n"
