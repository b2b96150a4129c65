"""Node sets whose names are known only when a file has been read."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError


class NamedSets(dict[str, NDArray[np.int64]]):
    """Node sets by name; asking for one that is not there says which are."""

    def __missing__(self, name: str) -> NoReturn:
        known = ", ".join(sorted(self)) or "none (the file names no set)"
        raise InputError(f"there is no node set {name!r}", expected=f"one of {known}")
