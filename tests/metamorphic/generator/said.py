"""What a transformation returns, and small steps that many of them share."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from tests.metamorphic.generator.case import AXIAL, VECTORS, Case, Table, Values
from tests.metamorphic.generator.differences import Sizes, kind as kind, variation

Back = Callable[[Values], Values]


def same(values: Values) -> Values:
    return values


@dataclass(frozen=True, eq=False)
class Said:
    """The same scene said differently.

    back : from what it measures to the measures of the original; may leave some out
    slack : relative difference that the description itself makes in such a motion
    first : row of the original at which it begins
    settings : of its run
    base : what it is compared with in place of the original
    sizes : what differences are relative to
    """

    case: Case
    back: Back = same
    slack: Callable[[Values], float] = lambda values: 0.0  # noqa: E731
    first: int = 0
    settings: dict[str, Any] = field(default_factory=dict)
    base: Case | None = None
    sizes: Sizes = variation


def copied(case: Case) -> Table:
    return copy.deepcopy(case.table)


def owner(measure: str) -> str:
    return measure.split(".", 1)[0]


def without(values: Values, dropped: Callable[[str], bool]) -> Values:
    return {name: value for name, value in values.items() if not dropped(name)}


def is_coordinate(case: Case, measure: str) -> bool:
    """A coordinate of a joint, or its rate."""
    return owner(measure) in case.table["joints"] and kind(measure) not in VECTORS


def vectors_times(values: Values, matrix: Array, axial: float = 1.0) -> Values:
    """All vectors in other axes; axial ones are multiplied by a sign as well."""
    new = dict(values)
    for name, value in values.items():
        if kind(name) in VECTORS and kind(name) != "u":
            sign = axial if kind(name) in AXIAL else 1.0
            new[name] = sign * value @ matrix.T
    return new


def components(vector: Array, planar: bool) -> list[float]:
    return [float(x) for x in vector[: 2 if planar else 3]]


def spin(vector: Array, planar: bool) -> Any:
    return float(vector[2]) if planar else [float(x) for x in vector]


def as_spin(value: Any) -> Array:
    """An angular velocity or a torque as (3,)."""
    if value is None:
        return np.zeros(3)
    return np.array([0.0, 0.0, value] if np.ndim(value) == 0 else value, float)


def with_table(case: Case, table: Table, **more: Any) -> Case:
    return replace(case, table=table, **more)
