"""Node sets whose names are known only when a file has been read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError


class NamedSets(dict[str, NDArray[np.int64]]):
    """Node sets by name; only a set that exists and is complete can be looked up.

    Attributes
    ----------
    undefined : set -> its members that the file does not define, in words
    """

    def __init__(
        self,
        sets: Mapping[str, NDArray[np.int64]] | None = None,
        undefined: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(sets or {})
        self.undefined = dict(undefined or {})

    def __getitem__(self, name: str) -> NDArray[np.int64]:
        if name in self.undefined:
            raise InputError(
                f"the set {name!r} names {self.undefined[name]}, which the file does "
                "not define",
                expected="a set of nodes and elements of the file",
            )
        return super().__getitem__(name)

    def __missing__(self, name: str) -> NoReturn:
        known = ", ".join(sorted(self)) or "none (the file names no set)"
        raise InputError(f"there is no node set {name!r}", expected=f"one of {known}")
