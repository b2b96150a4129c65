"""What a measurement was made on."""

from __future__ import annotations

import os
import platform
from datetime import date
from importlib import metadata
from pathlib import Path

import click

PACKAGES = ("sidtool", "numpy", "scipy", "numba", "exudyn", "scikit-sundae")
#: One thread: set before anything that computes is imported.
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
)


def use_one_thread() -> None:
    """Makes ratios those of the programs, not of their threads."""
    os.environ.update(ONE_THREAD)


def results_folder(
    context: click.Context, parameter: click.Parameter, path: Path | None
) -> Path | None:
    """Of an option: the folder, made if it is missing in one that is there.

    A run of hours shall not end without a place for what it found.
    """
    if path is None:
        return None
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise click.BadParameter(f"{path}: {error.strerror}") from None
    return path


def describe_machine() -> str:
    """Processor, load, date and versions, one line."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return (
        f"{_processor()}, {os.cpu_count()} processors, load {load}, one thread, "
        f"{date.today().isoformat()}; python {platform.python_version()}, "
        + ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    )


def version(package: str) -> str:
    """Version of a package, or that it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or platform.machine()
    names = [
        line.split(":", 1)[1].strip()
        for line in text.splitlines()
        if "model name" in line
    ]
    return names[0] if names else platform.machine()
