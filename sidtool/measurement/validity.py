"""Limits of the linear theory of a SID, and coordinates comparable between two SIDs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.result import Result
from sidtool.formats.result.accuracy_report import MAX_DEFLECTION, MAX_ROTATION
from sidtool.formats.scene import is_elastic
from sidtool.formats.scene import parse_output as parsed

#: Largest relative change of stiffness that a SID without geometric stiffening may
#: neglect.
MAX_UNMODELLED_STIFFENING = 0.25


class OutsideTheory(InputError):
    """Raised if a body leaves the range of its SID, so that errors cannot be
    estimated.
    """


def check_validity(result: Result) -> None:
    """Check the finest run at its output times and ends of steps.

    Raises
    ------
    OutsideTheory : a body bends by more than a tenth of its length, rotates elastically
        by more than 0.15 rad, or lacks a geometric stiffening that matters.
    """
    for name, body in result.bodies.items():
        place = f"bodies.{name}"
        measure = body.found or body.expected
        lacks_stiffening = not measure.carried and not measure.axial
        if lacks_stiffening and (
            measure.diverges or abs(measure.ratio) > MAX_UNMODELLED_STIFFENING
        ):
            raise OutsideTheory(
                f"outside of what the SID of {name} describes: {measure.sentence()}",
                place=place,
                expected="a SID with geometric stiffening",
            )
        if body.deflection > MAX_DEFLECTION:
            raise _validity_notes(
                place,
                f"{name} deforms by {body.deflection:.2g} of its length, where small "
                f"deformations end at {MAX_DEFLECTION:g}",
                body.deflection / MAX_DEFLECTION,
            )
        turned = body.rotation
        if turned > MAX_ROTATION:
            raise _validity_notes(
                place,
                f"{name} turns elastically by {turned:.2g} rad, where small rotations "
                f"end at {MAX_ROTATION:g}",
                turned / MAX_ROTATION,
            )


def missing_stiffening_notes(
    stiffness: Mapping[str, float], change: str, matters: bool
) -> Iterator[str]:
    """Return sentences on the geometric stiffening that the models of bodies lack.

    stiffness : relative change of stiffness that it would cause, by body
    change : text on the change of outputs by all of it
    matters : whether that change exceeds the allowed error

    Raises
    ------
    OutsideTheory : it matters, and changes a stiffness by more than a quarter.
    """
    for name, ratio in stiffness.items():
        would = f"it would be {100.0 * ratio:+.3g} % of the stiffness"
        if matters and abs(ratio) > MAX_UNMODELLED_STIFFENING:
            raise OutsideTheory(
                f"geometric stiffening is not in the model of {name}: {would}, and "
                f"would change {change}",
                place=f"bodies.{name}",
                expected="a model with a table [stiffening]",
            )
        yield (
            f"geometric stiffening of {name}: not in its model, and not in these "
            f"errors; {would} at the most, and would change {change}"
        )


def elastic_coordinates(name: str, result: Result) -> np.ndarray:
    """Return elastic coordinates (nt, nq) in the order of the SID; zero for omitted
    ones.
    """
    sid: SID = result.sids[name]
    q = np.zeros((len(result.t), sid.nq))
    for k in range(sid.nq):
        column = f"{name}.q{k + 1}"
        if column in result.position_names:
            q[:, k] = result.positions[:, result.position_names.index(column)]
    return q


def _validity_notes(place: str, what: str, times: float) -> OutsideTheory:
    parts = math.ceil(times)
    return OutsideTheory(
        f"outside of the theory of small deformations: {what}",
        place=place,
        expected=f"the body cut into {parts} or more, each a SID of its own, tied by "
        "joints of type fixed, so that none deforms that far; `simulate` without "
        "`wanted` gives numbers whose error is not known",
    )


#: Relative tolerance for equal frequencies: a shape function has the same frequency in
#: two bases, and its neighbours have others.
SAME_FREQUENCY_TOLERANCE = 0.05


def is_incomparable(
    output: str, before: Mapping[str, SID], after: Mapping[str, SID]
) -> bool:
    """Return whether an output belongs to a shape function that another SID lacks. The
    result is also True if the shape function cannot be distinguished from others there.
    """
    name = parsed(output)
    if name.marker or not is_elastic(name.quantity) or name.owner not in before:
        return False
    sids = before[name.owner], after[name.owner]
    number = int(name.quantity.lstrip("vq")) - 1
    return sids[0] is not sids[1] and not _is_in_both(number, *sids)


def _is_in_both(number: int, *sids: SID) -> bool:
    """Return whether a shape function is the only one near its frequency in both
    SIDs.
    """
    squares = [np.diag(sid.Ke.m0) / np.diag(sid.Me.m0) for sid in sids]
    if number >= min(map(len, squares)):
        return False
    own = squares[0][number]
    near = [
        np.abs(values - own) <= 2.0 * SAME_FREQUENCY_TOLERANCE * own
        for values in squares
    ]
    return all(rows[number] and rows.sum() == 1 for rows in near)
