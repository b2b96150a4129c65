"""Dense matrices from the headers and entries of a Taylor expansion."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.sid import Array, Taylor
from .codes import M0, M1, MN
from .lines import RawTaylor, ReadingNotes

ZERO, DIAGONAL, SYMMETRIC, GENERAL, IDENTITY = range(5)

#: Halves of a symmetric matrix that differ less than this differ in print only.
PRINT_NOISE = 1e-9
#: Numbers in one block of unknown shape, or of order 2; more is a damaged file.
MAX_NUMBERS = 20_000_000
#: Numbers of all unknown blocks together beyond so many for each that the file holds.
MAX_UNKNOWN, MAX_EMPTY = 1_000_000, 50


@dataclass(frozen=True)
class ReadingContext:
    """Known properties of the file while its expansions are filled."""

    source: str
    nq: int
    m1_index: str
    notes: ReadingNotes
    unknown: list[int] = field(default_factory=list)

    def error(self, problem: str, expected: str, line: int) -> InputError:
        """An error at a line of the file."""
        place = f"line {line}"
        return InputError(problem, source=self.source, place=place, expected=expected)


def header_value(raw: RawTaylor, item: str, default: int) -> int:
    """The value of a header item, or its default where a writer omits it."""
    return raw.header.get(item, (default, 0))[0]


def dense_expansion(
    raw: RawTaylor, shape: tuple[int, int], place: str, to: ReadingContext
) -> Taylor:
    """The dense expansion of the given shape.

    Raises
    ------
    InputError : header or indices do not fit; an index occurs twice.
    """
    _check_header(raw, shape, to)
    repeated = raw.codes.repeated
    if repeated is not None:
        line = int(raw.lines[repeated])
        raise to.error(f"an entry of {raw.name} stands here again", "each once", line)
    m0 = _m0(raw, shape, place, to)
    m1 = mn = None
    if raw.codes.has(M1):
        m1 = _scatter(raw, M1, (to.nq, *shape), to)
    if raw.codes.has(MN):
        kinds, _, second, third = raw.codes.kinds_and_indices
        modes = third if to.m1_index == "rcl" else second
        count = header_value(raw, "nqn", 0) or int(modes[kinds == MN].max())
        _check_size(raw, count * shape[0] * shape[1], to)
        mn = _scatter(raw, MN, (count, *shape), to)
    order = header_value(raw, "order", 1 if m1 is not None else 0)
    if order == 0 and m1 is not None:
        problem = "has first-order terms, but declares order 0"
        to.notes.add("N840", place, problem=problem, taken="they are used", remedy="")
    return Taylor(m0, m1, mn, order)


def shape_of_unknown_block(raw: RawTaylor, to: ReadingContext) -> tuple[int, int]:
    """The shape of a block that this project does not know."""
    kinds, rows, second, third = raw.codes.kinds_and_indices
    columns = np.where((kinds == M0) | (to.m1_index == "rcl"), second, third)
    shape = (
        header_value(raw, "nrow", int(rows.max(initial=0))),
        header_value(raw, "ncol", int(columns.max(initial=0))),
    )
    factor = to.nq + 1 if (kinds == M1).any() else 1
    numbers = shape[0] * shape[1] * factor
    to.unknown.append(numbers - MAX_EMPTY * len(raw.codes))
    if sum(to.unknown) > MAX_UNKNOWN:
        problem = f"{raw.name} and the unknown blocks before it declare many zeros"
        expected = f"at most {MAX_UNKNOWN} numbers that are not in the file"
        raise to.error(problem, expected, raw.line)
    _check_size(raw, numbers, to)
    return shape


def symmetrise(matrices: Array) -> Array:
    """Symmetric (..., n, n); elements that agree stay as they are, however large."""
    transposed = np.swapaxes(matrices, -1, -2)
    mean = matrices / 2 + transposed / 2
    return np.where(matrices == transposed, matrices, mean)


def _check_header(raw: RawTaylor, shape: tuple[int, int], to: ReadingContext) -> None:
    expected = {
        "nrow": (shape[0],),
        "ncol": (shape[1],),
        "nq": (to.nq, 0),
        "order": (0, 1, 2),
        "structure": (ZERO, DIAGONAL, SYMMETRIC, GENERAL, IDENTITY),
    }
    for item, allowed in expected.items():
        value, line = raw.header.get(item, (allowed[0], 0))
        if value not in allowed:
            choices = " or ".join(str(choice) for choice in allowed)
            raise to.error(f"{raw.name} declares {item} = {value}", choices, line)


def _check_size(raw: RawTaylor, numbers: int, to: ReadingContext) -> None:
    if numbers > MAX_NUMBERS:
        problem = f"{raw.name} would have {numbers} numbers"
        raise to.error(problem, f"at most {MAX_NUMBERS}", raw.line)


def _scatter(
    raw: RawTaylor, kind: int, shape: tuple[int, ...], to: ReadingContext
) -> Array:
    """The entries of a kind in a zero array; indices start at 1."""
    selected, places = raw.codes.places(kind, shape, to.m1_index)
    if (places < 0).any():
        line = int(raw.lines[selected][places < 0][0])
        ranges = " x ".join(str(size) for size in shape)
        raise to.error(
            f"an index of {raw.name} is out of range",
            f"indices of {ranges} (modes x rows x columns)"
            if len(shape) == 3
            else f"indices of {ranges} (rows x columns)",
            line,
        )
    dense = np.zeros(math.prod(shape))
    dense[places] = raw.values[selected]
    return dense.reshape(shape)


def _m0(
    raw: RawTaylor, shape: tuple[int, int], place: str, to: ReadingContext
) -> Array:
    """m0 from entries and declared structure; where they disagree, entries win."""
    dense = _scatter(raw, M0, shape, to)
    structure = header_value(raw, "structure", GENERAL)
    square = shape[0] == shape[1]
    if structure == IDENTITY and square:
        identity = np.eye(shape[0])
        if not dense.any() or not (dense - identity)[dense != 0.0].any():
            return identity
    if structure == SYMMETRIC and square:
        present = np.zeros(math.prod(shape), dtype=bool)
        present[raw.codes.places(M0, shape, to.m1_index)[1]] = True
        return _mirror_halves(dense, present.reshape(shape), place, to)
    if not _is_consistent(dense, structure):
        names = ("zero", "diagonal", "symmetric", "general", "the identity")
        problem = f"has other entries than {names[structure]}, its declared structure"
        to.notes.add("N840", place, problem=problem, taken="they are used", remedy="")
    return dense


def _is_consistent(dense: Array, structure: int) -> bool:
    if structure == ZERO:
        return not dense.any()
    if structure == DIAGONAL:
        rows, columns = np.nonzero(dense)
        return bool((rows == columns).all())
    return structure == GENERAL


def _mirror_halves(
    dense: Array, present: NDArray[np.bool_], place: str, to: ReadingContext
) -> Array:
    """Both halves from what is stored: a missing partner is mirrored."""
    full = np.where(present, dense, np.where(present.T, dense.T, 0.0))
    if not present.size:
        return full
    difference = np.abs(full - full.T).max()
    if difference <= PRINT_NOISE * np.abs(full).max():
        return symmetrise(full)
    problem = "declared symmetric, but its halves differ"
    to.notes.add("N840", place, problem=problem, taken="both are used", remedy="")
    return full
