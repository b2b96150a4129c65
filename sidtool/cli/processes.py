"""The processes of a command that may share its work under mpirun."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click

#: How many processes mpirun started, as Open MPI and MPICH say it.
_MPI_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")


class _Alone:
    """The only process."""

    rank = 0

    def go_on(self) -> None:
        """There is nobody to wait for."""


@contextmanager
def started(engine: str | None) -> Iterator[Any]:
    """Yield the processes of this run, of which the first writes and speaks.

    Raises
    ------
    InputError : the engine is not there, or mpirun started one that works alone.
    """
    asked = engine or os.environ.get("SIDTOOL_FACTORS")
    if asked != "slepc":
        _refuse_mpirun()
        yield _Alone()
        return
    from ..reduction.slepc import PartnerFailed, together

    try:
        with together() as processes:
            yield processes
    except PartnerFailed:
        click.get_current_context().exit(1)


def _refuse_mpirun() -> None:
    from sidtool.formats.errors import InputError

    count = next((os.environ[name] for name in _MPI_SIZES if name in os.environ), "1")
    if count != "1":
        raise InputError(
            f"mpirun started {count} processes that would all do the same",
            place="--engine",
            expected="slepc, the engine that shares the work",
        )
