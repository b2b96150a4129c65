"""How many digits a file was printed with, seen from the numbers themselves.

Numbers printed with n significant digits are multiples of a unit of their own decade,
those of a fixed-point print (%f) multiples of one unit. Shape functions and integrals
use all the digits they are given, so that a few dozen numbers tell. An identity between
printed numbers holds to their rounding and no better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.sid import SID, Array

#: Prints of more digits than these are as good as exact; see the registered bounds.
_EXACT_DIGITS = 12
_MOST_DECIMALS = 12
#: So many numbers are asked, and fewer than these tell nothing.
_MOST, _LEAST = 20_000, 30
#: So many are printed in one way, and use its last digit, which is 0 in a tenth.
_NEARLY_ALL, _MOSTLY = 0.99, 0.6


@dataclass(frozen=True)
class Rounding:
    """Largest rounding of an entry: absolute, and relative to it. Both 0: exact."""

    absolute: float = 0.0
    relative: float = 0.0
    words: str = ""

    def share(self, size: float) -> float:
        """Of an entry, relative to the largest one `size` of its block."""
        return self.relative + (self.absolute / size if size > 0.0 else 0.0)


def rounding_of(sid: SID) -> Rounding:
    """The print that the numbers of a SID show."""
    numbers = _numbers(sid)
    if len(numbers) < _LEAST:
        return Rounding()
    decimals = _least(numbers, np.ones_like(numbers), range(1, _MOST_DECIMALS))
    tens = 10.0 ** -np.floor(np.log10(np.abs(numbers)))
    digits = _least(numbers, tens, range(1, _EXACT_DIGITS - 1))
    if digits is not None:
        words = f"printed with {digits + 1} digits"
        return Rounding(relative=0.5 * 10.0**-digits, words=words)
    if decimals is not None:
        words = f"printed with {decimals} decimals"
        return Rounding(absolute=0.5 * 10.0**-decimals, words=words)
    return Rounding()


def _least(numbers: Array, scale: Array, places: range) -> int | None:
    """Decimals that nearly all scaled numbers end in, and most of them need."""
    for place in places:
        fits = _ends(numbers * scale, place)
        if fits.mean() >= _NEARLY_ALL:
            short = _ends(numbers * scale, place - 1)
            return place if 1.0 - short.mean() >= _MOSTLY else None
    return None


def _ends(scaled: Array, place: int) -> Array:
    """Which numbers have no digits behind this decimal, but for their binary form."""
    raised = scaled * 10.0**place
    gap = np.abs(raised - np.rint(raised))
    return np.asarray(gap <= 1e-14 * np.abs(raised) + 1e-300)


def _numbers(sid: SID) -> Array:
    """Numbers of all blocks and nodes that are not zero, thinned out evenly."""
    entries = [sid.J, sid.mdCM, sid.Ct, sid.Cr, sid.Gr, sid.Ge, sid.Oe, sid.Me, sid.Ke]
    step = max(1, len(sid.nodes) // 200)
    entries += [t for node in sid.nodes[::step] for t in (node.origin, node.phi)]
    parts = [part for t in entries for part in (t.m0, t.m1) if part is not None]
    found = np.concatenate([part.ravel() for part in parts])
    found = found[found != 0.0]
    return found[:: max(1, len(found) // _MOST)]
