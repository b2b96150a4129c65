"""Limits of the linear theory of a SID, and coordinates comparable between two SIDs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.result import OutputError, Result
from sidtool.formats.result.accuracy_report import (
    MAX_DEFLECTION,
    MAX_ROTATION,
    deformation_diagnostics,
    stiffening_diagnostic,
)
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
                stiffening_diagnostic(name, measure).message_line,
                place=place,
                expected="a SID with geometric stiffening",
            )
        for beyond in deformation_diagnostics(name, body.deflection, body.rotation):
            parts = math.ceil(
                max(body.deflection / MAX_DEFLECTION, body.rotation / MAX_ROTATION)
            )
            raise OutsideTheory(
                beyond.message_line,
                place=place,
                expected=f"the body cut into {parts} or more, each a SID of its own, "
                "tied by joints of type fixed; `simulate` without `wanted` gives "
                "numbers whose error is not known",
            )


def missing_stiffening_diagnostics(
    stiffness: Mapping[str, float], change: OutputError, matters: bool
) -> Iterator[Diagnostic]:
    """Diagnose geometric stiffening that the models of bodies lack (N606).

    stiffness : relative change of stiffness that it would cause, by body
    change : largest change of an output by all of it
    matters : whether it changes an output by more than is allowed, and considerably

    Raises
    ------
    OutsideTheory : it matters, and changes a stiffness by more than a quarter.
    """
    for name, ratio in stiffness.items():
        found = diagnose("N606", name, ratio=ratio, **change.values())
        if matters and abs(ratio) > MAX_UNMODELLED_STIFFENING:
            raise OutsideTheory(
                found.message_line,
                place=f"bodies.{name}",
                expected="a model with a table [stiffening]",
            )
        if change.error > change.allowed:
            yield found


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
