"""Paths of files that tests read, and features that only POSIX has."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
SLIDER_CRANK = EXAMPLES / "slider_crank"

#: Named pipes, /dev, limits of resources, permissions, links, signals to processes.
posix = pytest.mark.skipif(sys.platform == "win32", reason="behaviour of POSIX")
