"""Paths of files that tests read, and features that only POSIX has."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
DOCS = ROOT / "docs"
#: Pages of the documentation that people write.
PAGES = sorted(
    page
    for page in DOCS.rglob("*.md")
    if not {"generated", "_build"} & set(page.relative_to(DOCS).parts)
)
SLIDER_CRANK = EXAMPLES / "slider_crank"

#: Named pipes, /dev, limits of resources, permissions, links, signals to processes.
posix = pytest.mark.skipif(sys.platform == "win32", reason="behaviour of POSIX")
