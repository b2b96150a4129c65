"""Error of outputs caused by the printed digits of SID files.

A number that was printed with d digits has an error of up to half a unit of the last
digit. The finest model is run again with every number changed by that amount. The sign
is a hash of its digits: equal numbers stay equal, so symmetric blocks stay symmetric.
The changes may cancel by chance, so there are `RANDOM_RUNS` such runs; theory, section
16.

The number of digits is determined from the numbers themselves. HDF5 copies of a text
file are therefore recognised, and computed numbers with sixteen digits are not
affected.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.base.sid import NODE_SHAPES, SID, Array, Node, Taylor
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..measurement.request import refuse_accuracy
from ..measurement.runs import Runs
from .reference_run import Reference

#: More digits than this are indistinguishable from full precision.
MAX_DIGITS = 13
#: Required number of distinct numbers, share of them with at most the printed digits,
#: and share of them with exactly that many.
MIN_DISTINCT_NUMBERS, PRINTED_SHARE, FULL_DIGITS_SHARE = 10, 0.9, 0.5
#: Numbers that end this many digits earlier were not rounded: for rounded numbers the
#: probability is one in a thousand.
ROUND_DIGITS = 3
#: Relative rounding error of a product with a power of ten.
RELATIVE_ROUNDING = 1e-15
#: Number of runs with other signs, and the factor on the largest change found.
RANDOM_RUNS, CHANGE_SAFETY = 3, 3.0
#: Rounding is negligible if it is below this share after magnification by the motion
#: and by positions.
MOTION_MAGNIFICATION, POSITION_MAGNIFICATION, NEGLIGIBLE_SHARE = 1e5, 10.0, 0.05
#: Multiplier of a hash: the upper bits of the product are pseudo-random.
HASH_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)
#: Largest share of the allowed error for printed digits.
MAX_ROUNDING_SHARE = 0.5


@dataclass(frozen=True)
class NumberFormat:
    """How the numbers of a file were printed.

    count : significant digits, or decimals
    fixed : whether it counts decimals
    """

    count: int
    fixed: bool

    @property
    def relative(self) -> float:
        """Return the largest relative error: half a unit of the last digit over the
        number.
        """
        return np.inf if self.fixed else 5.0 * 10.0**-self.count

    def __str__(self) -> str:
        return f"{self.count} {'decimals' if self.fixed else 'digits'}"


def printed_digits(sid: SID) -> NumberFormat | None:
    """Return how the numbers of a SID were printed, or None if they have all digits."""
    numbers = np.unique(np.abs(np.concatenate(list(_printed_numbers(sid)))))
    numbers = numbers[numbers > 0.0]
    if len(numbers) < MIN_DISTINCT_NUMBERS:
        return None
    formats = []
    for fixed in (False, True):
        counts = _digit_counts(numbers, fixed)
        count = int(np.quantile(counts, PRINTED_SHARE, method="higher"))
        share = float((counts == count).mean())
        if count <= MAX_DIGITS and share >= FULL_DIGITS_SHARE:
            formats.append((share, NumberFormat(count, fixed)))
    return max(formats, key=lambda pair: pair[0])[1] if formats else None


def perturb_last_digit(sid: SID, how: NumberFormat, draw: int) -> SID:
    """Return the SID with its numbers changed by half a unit of the last digit."""

    def part(values: Array | None) -> Array | None:
        return None if values is None else _perturb_numbers(values, how, draw)

    def block(one: Taylor) -> Taylor:
        m0 = _perturb_numbers(one.m0, how, draw)
        return replace(one, m0=m0, m1=part(one.m1), mn=part(one.mn))

    def node(one: Node) -> Node:
        entries = {name: getattr(one, name) for name in NODE_SHAPES}
        blocks = {n: block(entry) for n, entry in entries.items() if entry is not None}
        return replace(one, **blocks)  # type: ignore[arg-type]

    return replace(
        sid,
        mass=float(_perturb_numbers(np.array([sid.mass]), how, draw)[0]),
        nodes=tuple(map(node, sid.nodes)),
        **{name: block(one) for name, one in sid.blocks.items()},  # type: ignore[arg-type]
    )


def with_rounding_error(
    runs: Runs, reference: Reference
) -> tuple[Reference, tuple[Diagnostic, ...]]:
    """Return the reference with the error by printed digits, and diagnostics on it.

    Raises
    ------
    InputError : the printed digits cause more than half of the allowed error.
    """
    every = {n: printed_digits(runs.sids[n]) for n in runs.scene.sid_bodies}
    formats = {n: how for n, how in every.items() if how is not None}
    if not formats:
        return reference, ()
    if _is_rounding_negligible(runs, reference, formats):
        return reference, ()
    bodies, digits = ", ".join(formats), ", ".join(map(str, formats.values()))
    changes = [
        _change_by_rounding(runs, reference, formats, draw)
        for draw in range(RANDOM_RUNS)
    ]
    open_ = CHANGE_SAFETY * np.max(changes, axis=0)
    if not np.isfinite(open_).all():
        reason = "the scene does not run with other last digits"
        what = f"rounding of its SID file ({digits})"
        found = diagnose("N603", bodies, what=what, reason=reason, remedy="")
        return reference, (found,)
    largest = reference.largest_error(runs.names, open_)
    found = diagnose("N611", bodies, digits=digits, **largest.values())
    if reference.used_share(open_) > MAX_ROUNDING_SHARE:
        raise refuse_accuracy(
            f"{found.message_line}, {largest.allowed:.1e} allowed",
            "a larger error, or files with more digits",
        )
    return replace(reference, digits=open_), (found,)


def _change_by_rounding(
    runs: Runs, reference: Reference, formats: Mapping[str, NumberFormat], draw: int
) -> Array:
    """Return the changes (n,) of outputs by numbers that are equal when printed."""
    others = {
        n: perturb_last_digit(runs.sids[n], how, draw) for n, how in formats.items()
    }
    return runs.max_change_by(others, reference.choice, reference.setting)


def _is_rounding_negligible(
    runs: Runs, reference: Reference, formats: Mapping[str, NumberFormat]
) -> bool:
    """Return whether rounding is far below the allowed error, so that no run is
    needed.
    """
    most = max(how.relative for how in formats.values())
    if most >= 1.0:
        return False
    sizes = np.abs(runs.columns(reference.choice, reference.result)).max(axis=0)
    changes = most * (
        MOTION_MAGNIFICATION * reference.variation + POSITION_MAGNIFICATION * sizes
    )
    return reference.used_share(changes) <= NEGLIGIBLE_SHARE


def _printed_numbers(sid: SID) -> Iterator[Array]:
    yield np.array([sid.mass])
    entries = [getattr(node, name) for node in sid.nodes for name in NODE_SHAPES]
    for one in (*sid.blocks.values(), *entries):
        if one is not None:
            parts = (one.m0, one.m1, one.mn)
            yield from (part.ravel() for part in parts if part is not None)


def _digit_counts(numbers: Array, fixed: bool) -> Array:
    """Return the number of digits of positive numbers, `MAX_DIGITS` + 1 for full
    precision.
    """
    counts = np.full(numbers.shape, MAX_DIGITS + 1)
    shift = 0 if fixed else np.floor(np.log10(numbers)) + 1.0
    for count in range(MAX_DIGITS + 1):
        scaled = numbers * 10.0 ** (count - shift)
        exact = np.abs(scaled - np.rint(scaled)) <= RELATIVE_ROUNDING * scaled
        counts[exact & (scaled < 10.0**MAX_DIGITS) & (counts > MAX_DIGITS)] = count
    return counts


def _perturb_numbers(values: Array, how: NumberFormat, draw: int) -> Array:
    result = values.copy()
    rows = values != 0.0
    numbers = np.abs(values[rows])
    exponents = np.floor(np.log10(numbers))
    last = np.full(len(numbers), -how.count) if how.fixed else exponents - how.count + 1
    digits = np.rint(numbers * 10.0**-last).astype(np.uint64)
    up = (digits * HASH_MULTIPLIER >> np.uint64(63 - draw) & np.uint64(1)).astype(bool)
    rounded = _digit_counts(numbers, how.fixed) > how.count - ROUND_DIGITS
    step = np.where(rounded, np.where(up, 0.5, -0.5) * 10.0**last, 0.0)
    result[rows] += np.sign(values[rows]) * step
    return result
