"""Types of the tables of a model file, and its material.

Checks of a model file that a type alone cannot express; all raise `InputError`.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated

from ..base.errors import InputError
from ..toml.tables import Field, Number, Table, Takes

Point3 = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1, le=10_000_000)]
Names = str | tuple[str, ...]


def as_tuple(names: Names) -> tuple[str, ...]:
    """One name or several, as several."""
    return (names,) if isinstance(names, str) else names


class Material(Table):
    """Linear elastic and isotropic."""

    youngs_modulus: Takes[Positive, float | str] = Field(
        description="Young's modulus in Pa"
    )
    poissons_ratio: Number = Field(gt=-1, lt=0.5, description="a number below 0.5")
    density: Takes[Positive, float | str] = Field(description="the density in kg/m^3")


def check_knots(knots: Sequence[float], degree: int, count: int, place: str) -> None:
    """Whether a knot vector is open and fits `count` functions of `degree`.

    Raises
    ------
    InputError : it does not.
    """
    if count <= degree:
        raise InputError(
            f"gives {count} functions of degree {degree}",
            place=place,
            expected=f"at least {degree + 1} functions",
        )
    if len(knots) != count + degree + 1:
        raise InputError(
            f"has {len(knots)} knots",
            place=place,
            expected=f"{count + degree + 1} for {count} functions of degree {degree}",
        )
    if any(b < a for a, b in zip(knots, knots[1:], strict=False)):
        raise InputError("decreases", place=place, expected="knots in rising order")
    for end in (knots[0], knots[-1]):
        if knots.count(end) != degree + 1:
            raise InputError(
                f"has the end knot {end:g} {knots.count(end)} times",
                place=place,
                expected=f"{degree + 1} times, i.e. an open knot vector",
            )
    inner = [k for k in knots if knots[0] < k < knots[-1]]
    for knot in inner:
        if inner.count(knot) > degree:
            raise InputError(
                f"has the inner knot {knot:g} {inner.count(knot)} times",
                place=place,
                expected=f"at most {degree} times, or the patch falls apart there",
            )


def check_grid(rows: Sequence[Sequence[object]], columns: int, place: str) -> None:
    """Whether every row of a nested list has the same number of entries."""
    for i, row in enumerate(rows):
        if len(row) != columns:
            raise InputError(
                f"has {len(row)} entries",
                place=f"{place}[{i}]",
                expected=f"{columns} entries in every row",
            )


def check_name(name: str, known: Iterable[str], what: str, place: str) -> None:
    """Whether `name` is among the known ones."""
    if name not in known:
        raise InputError(
            f"there is no {what} {name!r}",
            place=place,
            expected=f"one of {', '.join(known)}",
        )


def check_node_numbers(nodes: Mapping[str, int]) -> None:
    """Whether every marker has a node number of its own."""
    owner: dict[int, str] = {}
    for name, node in nodes.items():
        if node in owner:
            raise InputError(
                f"node {node} belongs to marker {owner[node]} already",
                place=f"markers.{name}.node",
                expected="a number of its own for every marker",
            )
        owner[node] = name
