"""Types of the tables of a model file, and the table of Rayleigh damping."""

from typing import Annotated, Literal

from ..toml.constructor_types import Field, Number, Takes
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


class Material(Table):
    """Linear elastic and isotropic."""

    youngs_modulus: Takes[Positive, float | str] = Field(
        description="Young's modulus in Pa"
    )
    poissons_ratio: Number = Field(gt=-1, lt=0.5, description="a number below 0.5")
    density: Takes[Positive, float | str] = Field(description="the density in kg/m^3")
