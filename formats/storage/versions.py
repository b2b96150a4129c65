"""Which program writes files, and with what it computes."""

from __future__ import annotations

import platform
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


def versions() -> dict[str, str]:
    """Versions of this program and of what computes under it."""
    packages = ("sidtool", "numpy", "scipy", "numba")
    return {"python": platform.python_version()} | {p: version_of(p) for p in packages}
