"""Couplings: weighted sums of the coordinates of other joints that stay constant."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction

from sidtool.formats.errors import InputError
from sidtool.formats.scene import Coupling, Gear, Joint, coupled_coordinates

from ..space.layout import ANGLE
from .joints import Primitive, joint_parts, weighted

#: Largest whole numbers of a ratio of angles in spatial scenes.
TEETH = 10_000
SAME_RATIO = 1e-12


def coupling_terms(
    name: str, joint: Gear | Coupling, joints: Mapping[str, Joint], planar: bool
) -> list[tuple[str, Primitive]]:
    """(joint, primitive) of each term of the sum, the first with its constant.

    An angle in space is known from the orientations of two markers, up to whole turns.
    When the weights of all angles are in ratios of whole numbers, the sum is known up
    to a period, and the constraint holds exactly and without memory for any number of
    turns.

    Raises
    ------
    InputError : weights of angles in space are not in ratios of whole numbers.
    """
    found = []
    for other, coordinate, weight in coupled_coordinates(joint, dict(joints)):
        parts = joint_parts(joints[other], planar)
        found.append((other, parts.coordinates[coordinate], weight))
    weights = [weight for _, part, weight in found if part.kind == ANGLE]
    period = 0.0 if planar else 2.0 * math.pi * _unit(weights, name)
    terms = weighted([term[1:] for term in found], joint.offset, period)
    return list(zip((name for name, _, _ in found), terms, strict=True))


def _unit(weights: list[float], name: str) -> float:
    """The largest number of which all weights are whole multiples; 0 for no weights."""
    if not weights:
        return 0.0
    base = abs(weights[0])
    ratios = []
    for weight in weights:
        exact = weight / base
        ratio = Fraction(exact).limit_denominator(TEETH)
        if abs(ratio.numerator) > TEETH or abs(ratio - exact) > SAME_RATIO * abs(exact):
            raise InputError(
                f"couples angles in the ratio {exact:.12g}",
                place=f"joints.{name}",
                expected="a ratio of whole numbers (of teeth) in a spatial scene, "
                f"none above {TEETH}",
            )
        ratios.append(ratio)
    denominator = math.lcm(*(ratio.denominator for ratio in ratios))
    common = math.gcd(*(int(ratio * denominator) for ratio in ratios))
    return base * common / denominator
