"""Types of the tables of a model file, and the table of Rayleigh damping."""

from typing import Annotated, Literal

from ..toml.constructor_types import Field
from ..toml.tables import Table

Point3 = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1, le=10_000_000)]
Names = str | tuple[str, ...]


def as_tuple(names: Names) -> tuple[str, ...]:
    """One name or several, as several."""
    return (names,) if isinstance(names, str) else names


class RayleighDamping(Table):
    """alpha Me + beta Ke."""

    type: Literal["rayleigh"] = "rayleigh"
    alpha: float = Field(default=0.0, ge=0, description="of the mass [1/s]")
    beta: float = Field(default=0.0, ge=0, description="of the stiffness [s]")
