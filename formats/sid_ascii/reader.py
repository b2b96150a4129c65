"""Reading an ASCII SID file of any known dialect."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..sid import SID
from ..storage.unreadable import unreadable
from .assembly import assemble
from .lines import Lines
from .parser import parse


def read_ascii(path: str | os.PathLike[str]) -> SID:
    """The SID in an ASCII file; `SID.dialect` tells how it was written.

    Numbers are kept as they stand, also where the body is physically impossible.
    Symmetric matrices that the file stores twice are averaged where the two halves
    differ by print noise.

    Raises
    ------
    InputError : the file cannot be opened or is not a SID file; names the line.
    """
    source = os.fspath(path)
    try:
        with Path(path).open(encoding="latin-1") as stream:
            raw = parse(Lines(stream, source))
    except OSError as error:
        raise unreadable(source, "a SID file", error) from error
    try:
        # identities among numbers near the largest float may overflow harmlessly
        with np.errstate(over="ignore", invalid="ignore"):
            return assemble(raw, source)
    except InputError as error:
        raise error.located(source) from error
