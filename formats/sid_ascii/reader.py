"""Reading an ASCII SID file of any known dialect."""

import os
from pathlib import Path

import numpy as np

from ..base.errors import InputError
from ..base.sid import SID
from ..storage.unreadable import unreadable_error
from .assembly import assemble
from .lines import LineReader
from .parser import parse_sid


def read_ascii(path: str | os.PathLike[str]) -> SID:
    """Read the SID in an ASCII file; `SID.dialect` states how it was written.

    Numbers are not changed, even if the body is physically impossible.
    Symmetric matrices that the file stores twice are averaged where the two halves
    differ by print noise.

    Raises
    ------
    InputError : the file cannot be opened or is not a SID file; names the line.
    """
    source = os.fspath(path)
    try:
        with Path(path).open(encoding="latin-1") as stream:
            raw = parse_sid(LineReader(stream, source))
    except OSError as error:
        raise unreadable_error(source, "a SID file", error) from error
    try:
        # identities among numbers near the largest float may overflow harmlessly
        with np.errstate(over="ignore", invalid="ignore"):
            return assemble(raw, source)
    except InputError as error:
        raise error.located(source) from error
