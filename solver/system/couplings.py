"""Couplings: weighted sums of the coordinates of other joints that stay constant."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction

from sidtool.formats.errors import InputError
from sidtool.formats.scene import Coupling, Gear, Joint, coupled_coordinates

from ..kernels.layout import (
    ANGLE,
    COUPLED_ALONG,
    COUPLED_ANGLE,
    TERM_PLANAR,
    TERM_SPATIAL,
    W_CONSTANT,
)
from .joints import Primitive, joint_parts

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
    terms = []
    for k, (other, part, weight) in enumerate(found):
        start = TERM_PLANAR if planar else TERM_SPATIAL
        data = (*part.data, weight, 0.0, period, 0.0)
        from_start = -1
        if k == 0:
            data = (*part.data, weight, joint.offset or 0.0, period, 1.0)
            from_start = start + W_CONSTANT if joint.offset is None else -1
        kind = COUPLED_ANGLE if part.kind == ANGLE else COUPLED_ALONG
        terms.append((other, Primitive(kind, data, part.swapped, from_start)))
    return terms


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
