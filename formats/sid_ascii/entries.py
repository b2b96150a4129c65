"""The entries of one expansion, packed into arrays while they are read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..sid import Array
from .lines import Lines
from .raw import RawTaylor
from .values import reals

#: Entries that may stand as Python objects, at ten times the memory of packed ones.
BATCH = 8192


class Entries:
    """Fills with indices, numbers as text and line numbers; `finish` gives arrays."""

    def __init__(self, name: str, lines: Lines) -> None:
        self.codes: list[int] = []
        self.texts: list[str] = []
        self.numbers: list[int] = []
        self._name = name
        self._lines = lines
        self._start = lines.number
        self._letter = ""
        self._packed: list[tuple[NDArray[np.int64], Array, NDArray[np.int64]]] = []

    def pack(self) -> None:
        """Turn what has been collected into arrays.

        Raises
        ------
        InputError : one of the texts is not a finite number.
        """
        if not self._packed and self.texts:
            sample = self.texts[0].upper()
            self._letter = next((char for char in "DE" if char in sample), "")
        values = reals(self.texts, self.numbers, self._lines)
        codes = np.array(self.codes, dtype=np.int64)
        self._packed.append((codes, values, np.array(self.numbers, dtype=np.int64)))
        for collected in (self.codes, self.texts, self.numbers):
            collected.clear()

    def finish(self, header: dict[str, tuple[int, int]]) -> RawTaylor:
        """The whole expansion."""
        self.pack()
        codes, values, numbers = zip(*self._packed, strict=True)
        return RawTaylor(
            name=self._name,
            line=self._start,
            header=header,
            codes=np.concatenate(codes),
            values=np.concatenate(values),
            lines=np.concatenate(numbers),
            letter=self._letter,
        )
