"""What the digits of SID files leave open.

A number that was printed with d digits stands for all that are printed alike: it may be
off by half a unit of the last digit. The finest model is run again with every number
moved by that much, up or down by what its digits are: equal numbers stay equal, so that
symmetric blocks stay symmetric, as printing keeps them. In one such run the changes may
cancel by chance, so that there are `DRAWS` of them; theory, section 16.

How many digits there are is seen in the numbers themselves, so that copies of a text
file as HDF5 count as well, and what was computed, which has sixteen, does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import NODE_SHAPES, SID, Array, Node, Taylor

from .reference import Reference
from .runs import Runs

#: More digits cannot be told from all that a number has.
MOST = 13
#: Of different numbers, how many there are at least, how many have no more digits than
#: are printed, and how many have all of them.
LEAST, WITHIN, FULL = 10, 0.9, 0.5
#: Numbers that end this many digits earlier were not rounded: one in a thousand would.
ROUND = 3
#: Of a product with a power of ten, by rounding.
EXACT = 1e-15
#: Runs with other signs, and the change that counts over the largest that is seen.
DRAWS, SAFETY = 3, 3.0
#: Digits are left out if they, magnified this much by the motion and by places, are
#: below this share.
MAGNIFIED, PLACED, NOTHING = 1e5, 10.0, 0.05
#: The upper bits of a product with it are those of no pattern in the digits.
MIXING = np.uint64(0x9E3779B97F4A7C15)
#: Of what is allowed, the most that digits may take.
TOO_MUCH = 0.5


@dataclass(frozen=True)
class Printed:
    """How the numbers of a file were printed.

    count : significant digits, or decimals
    fixed : whether it counts decimals
    """

    count: int
    fixed: bool

    @property
    def relative(self) -> float:
        """Half a unit of the last digit over the number, at most."""
        return np.inf if self.fixed else 5.0 * 10.0**-self.count

    def __str__(self) -> str:
        return f"{self.count} {'decimals' if self.fixed else 'digits'}"


def printed(sid: SID) -> Printed | None:
    """How its numbers were printed; None where they have all digits."""
    numbers = np.unique(np.abs(np.concatenate(list(_numbers(sid)))))
    numbers = numbers[numbers > 0.0]
    if len(numbers) < LEAST:
        return None
    found = []
    for fixed in (False, True):
        counts = _counts(numbers, fixed)
        count = int(np.quantile(counts, WITHIN, method="higher"))
        share = float((counts == count).mean())
        if count <= MOST and share >= FULL:
            found.append((share, Printed(count, fixed)))
    return max(found, key=lambda pair: pair[0])[1] if found else None


def moved(sid: SID, how: Printed, draw: int) -> SID:
    """The SID with its numbers half a unit of the last digit away."""

    def part(values: Array | None) -> Array | None:
        return None if values is None else _moved(values, how, draw)

    def block(one: Taylor) -> Taylor:
        m0 = _moved(one.m0, how, draw)
        return replace(one, m0=m0, m1=part(one.m1), mn=part(one.mn))

    def node(one: Node) -> Node:
        entries = {name: getattr(one, name) for name in NODE_SHAPES}
        found = {n: block(entry) for n, entry in entries.items() if entry is not None}
        return replace(one, **found)  # type: ignore[arg-type]

    return replace(
        sid,
        mass=float(_moved(np.array([sid.mass]), how, draw)[0]),
        nodes=tuple(map(node, sid.nodes)),
        **{name: block(one) for name, one in sid.blocks.items()},  # type: ignore[arg-type]
    )


def with_digits(runs: Runs, reference: Reference) -> tuple[Reference, tuple[str, ...]]:
    """The reference with what digits leave open, and what there is to be said.

    Raises
    ------
    InputError : digits leave open more than half of what is allowed.
    """
    every = {n: printed(runs.sids[n]) for n in runs.scene.sid_bodies}
    found = {n: how for n, how in every.items() if how is not None}
    if not found:
        return reference, ()
    told = ", ".join(f"{how} of {name}" for name, how in found.items())
    if _is_nothing(runs, reference, found):
        return reference, (f"{told}: far below what is asked for",)
    changes = [_change(runs, reference, found, draw) for draw in range(DRAWS)]
    open_ = SAFETY * np.max(changes, axis=0)
    if not np.isfinite(open_).all():
        text = "the scene does not run with others that are printed alike"
        return reference, (f"{told}: not judged, as {text}",)
    row = reference.worst(open_)
    seen = f"{open_[row]:.1e} {reference.units[row]}".rstrip()
    name = runs.names[row]
    if reference.use(open_) > TOO_MUCH:
        raise InputError(
            f"{told} tell {name} to {seen} only, where "
            f"{reference.allowed[row]:.1e} may be wrong",
            place="accuracy.wanted",
            expected="a larger error, or files with more digits",
        )
    return replace(reference, digits=open_), (f"{told}: leave {seen} in {name} open",)


def _change(
    runs: Runs, reference: Reference, found: Mapping[str, Printed], draw: int
) -> Array:
    """What other numbers that are printed alike change, (n,)."""
    others = {n: moved(runs.sids[n], how, draw) for n, how in found.items()}
    return runs.changed_by(others, reference.choice, reference.setting)


def _is_nothing(runs: Runs, reference: Reference, found: Mapping[str, Printed]) -> bool:
    """Whether digits are far below what is allowed, so that no run is needed."""
    most = max(how.relative for how in found.values())
    if most >= 1.0:
        return False
    sizes = np.abs(runs.columns(reference.choice, reference.result)).max(axis=0)
    changes = most * (MAGNIFIED * reference.variation + PLACED * sizes)
    return reference.use(changes) <= NOTHING


def _numbers(sid: SID) -> Iterator[Array]:
    yield np.array([sid.mass])
    entries = [getattr(node, name) for node in sid.nodes for name in NODE_SHAPES]
    for one in (*sid.blocks.values(), *entries):
        if one is not None:
            parts = (one.m0, one.m1, one.mn)
            yield from (part.ravel() for part in parts if part is not None)


def _counts(numbers: Array, fixed: bool) -> Array:
    """Digits that positive numbers need, `MOST` + 1 for all that they have."""
    counts = np.full(numbers.shape, MOST + 1)
    shift = 0 if fixed else np.floor(np.log10(numbers)) + 1.0
    for count in range(MOST + 1):
        scaled = numbers * 10.0 ** (count - shift)
        exact = np.abs(scaled - np.rint(scaled)) <= EXACT * scaled
        counts[exact & (scaled < 10.0**MOST) & (counts > MOST)] = count
    return counts


def _moved(values: Array, how: Printed, draw: int) -> Array:
    result = values.copy()
    rows = values != 0.0
    numbers = np.abs(values[rows])
    exponents = np.floor(np.log10(numbers))
    last = np.full(len(numbers), -how.count) if how.fixed else exponents - how.count + 1
    digits = np.rint(numbers * 10.0**-last).astype(np.uint64)
    up = (digits * MIXING >> np.uint64(63 - draw) & np.uint64(1)).astype(bool)
    rounded = _counts(numbers, how.fixed) > how.count - ROUND
    step = np.where(rounded, np.where(up, 0.5, -0.5) * 10.0**last, 0.0)
    result[rows] += np.sign(values[rows]) * step
    return result
