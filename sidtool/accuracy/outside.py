"""Where the theory of a SID ends, and what would do instead."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.result.bodies import LARGE, LARGE_ROTATION
from sidtool.formats.sid import SID

#: A SID without geometric stiffening must not see more change of stiffness than this.
UNSTIFFENED = 0.25


class OutsideTheory(InputError):
    """No error can be told: a body leaves what its SID describes."""


def check_inside(result: Result) -> None:
    """Looks at the finest run, at its output times and ends of steps.

    Raises
    ------
    OutsideTheory : a body bends by more than a tenth of its length, turns elastically
        by more than 0.15 rad, or lacks a geometric stiffening that matters much.
    """
    for name, body in result.bodies.items():
        place = f"bodies.{name}"
        found = body.found or body.expected
        lacking = not found.carried and not found.axial
        if lacking and (found.diverges or abs(found.ratio) > UNSTIFFENED):
            raise OutsideTheory(
                f"outside of what the SID of {name} describes: {found.sentence()}",
                place=place,
                expected="a SID with geometric stiffening",
            )
        if body.deflection > LARGE:
            raise _too_far(
                place,
                f"{name} deforms by {body.deflection:.2g} of its length, where small "
                f"deformations end at {LARGE:g}",
                body.deflection / LARGE,
            )
        turned = body.rotation
        if turned > LARGE_ROTATION:
            raise _too_far(
                place,
                f"{name} turns elastically by {turned:.2g} rad, where small rotations "
                f"end at {LARGE_ROTATION:g}",
                turned / LARGE_ROTATION,
            )


def told_lack(
    stiffness: Mapping[str, float], change: str, matters: bool
) -> Iterator[str]:
    """Sentences on the geometric stiffening that the models of bodies lack.

    stiffness : the change that it would be, of that of each body
    change : of outputs, by all of it, in words
    matters : whether that is much

    Raises
    ------
    OutsideTheory : it matters, and is more than a quarter of a stiffness.
    """
    for name, ratio in stiffness.items():
        would = f"it would be {100.0 * ratio:+.3g} % of the stiffness"
        if matters and abs(ratio) > UNSTIFFENED:
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
    """(nt, nq) of a result, in the order of its SID; zero for those left out."""
    sid: SID = result.sids[name]
    q = np.zeros((len(result.t), sid.nq))
    for k in range(sid.nq):
        column = f"{name}.q{k + 1}"
        if column in result.position_names:
            q[:, k] = result.positions[:, result.position_names.index(column)]
    return q


def _too_far(place: str, what: str, times: float) -> OutsideTheory:
    parts = math.ceil(times)
    return OutsideTheory(
        f"outside of the theory of small deformations: {what}",
        place=place,
        expected=f"the body cut into {parts} or more, each a SID of its own, tied by "
        "joints of type fixed, so that none deforms that far; `simulate` without "
        "`wanted` gives numbers whose error is not known",
    )
