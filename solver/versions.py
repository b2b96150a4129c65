"""What a result was made with."""

from __future__ import annotations

import platform

from sidtool.formats.storage.versions import version_of


def versions() -> dict[str, str]:
    """Versions of this program and of what computes under it."""
    packages = ("sidtool", "numpy", "scipy", "numba")
    return {"python": platform.python_version()} | {p: version_of(p) for p in packages}
