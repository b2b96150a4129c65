"""Which program writes files."""

from __future__ import annotations

from functools import cache
from importlib import metadata


@cache
def version_of(package: str) -> str:
    """The version of an installed package."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def written_by() -> str:
    """What files of this program are marked with, such as "sidtool 0.1.0"."""
    return f"sidtool {version_of('sidtool')}"
