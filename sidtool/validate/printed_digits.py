"""Printed precision of a file, detected from its numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.sid import SID, Array

#: More digits than this count as exact; see the registered bounds.
_EXACT_DIGITS = 12
_MOST_DECIMALS = 12
#: Largest number of examined numbers, and the least one that is sufficient.
_MAX_NUMBERS, _MIN_NUMBERS = 20_000, 30
#: Share of numbers printed in one way, and share that use the last digit, which is 0 in
#: a tenth of them.
_PRINTED_SHARE, _LAST_DIGIT_SHARE = 0.99, 0.6


@dataclass(frozen=True)
class Rounding:
    """Largest rounding of an entry: absolute, and relative to it. Both 0: exact."""

    absolute: float = 0.0
    relative: float = 0.0
    words: str = ""

    def share(self, size: float) -> float:
        """Return the rounding of an entry relative to the largest one, `size`, of its
        block.
        """
        return self.relative + (self.absolute / size if size > 0.0 else 0.0)


def rounding_of(sid: SID) -> Rounding:
    """Return the rounding that the numbers of a SID show."""
    numbers = _sampled_numbers(sid)
    if len(numbers) < _MIN_NUMBERS:
        return Rounding()
    decimals = _least_decimals(numbers, np.ones_like(numbers), range(1, _MOST_DECIMALS))
    tens = 10.0 ** -np.floor(np.log10(np.abs(numbers)))
    digits = _least_decimals(numbers, tens, range(1, _EXACT_DIGITS - 1))
    if digits is not None:
        words = f"printed with {digits + 1} digits"
        return Rounding(relative=0.5 * 10.0**-digits, words=words)
    if decimals is not None:
        words = f"printed with {decimals} decimals"
        return Rounding(absolute=0.5 * 10.0**-decimals, words=words)
    return Rounding()


def _least_decimals(numbers: Array, scale: Array, places: range) -> int | None:
    """Return the number of decimals that nearly all scaled numbers have, and most of
    them need.
    """
    for place in places:
        fits = _ends_at_decimal(numbers * scale, place)
        if fits.mean() >= _PRINTED_SHARE:
            short = _ends_at_decimal(numbers * scale, place - 1)
            return place if 1.0 - short.mean() >= _LAST_DIGIT_SHARE else None
    return None


def _ends_at_decimal(scaled: Array, place: int) -> Array:
    """Return which numbers have no digits after this decimal, except for binary
    rounding.
    """
    raised = scaled * 10.0**place
    gap = np.abs(raised - np.rint(raised))
    return np.asarray(gap <= 1e-14 * np.abs(raised) + 1e-300)


def _sampled_numbers(sid: SID) -> Array:
    """Return non-zero numbers of all blocks and nodes, sampled evenly."""
    entries = [sid.J, sid.mdCM, sid.Ct, sid.Cr, sid.Gr, sid.Ge, sid.Oe, sid.Me, sid.Ke]
    step = max(1, len(sid.nodes) // 200)
    entries += [t for node in sid.nodes[::step] for t in (node.origin, node.phi)]
    parts = [part for t in entries for part in (t.m0, t.m1) if part is not None]
    numbers = np.concatenate([part.ravel() for part in parts])
    numbers = numbers[numbers != 0.0]
    return numbers[:: max(1, len(numbers) // _MAX_NUMBERS)]
