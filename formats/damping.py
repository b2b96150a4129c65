"""Damping of models and of bodies of scenes."""

from typing import Literal

from .toml.tables import Field, Table


class RayleighDamping(Table):
    """alpha Me + beta Ke."""

    type: Literal["rayleigh"] = "rayleigh"
    alpha: float = Field(default=0.0, ge=0, description="of the mass [1/s]")
    beta: float = Field(default=0.0, ge=0, description="of the stiffness [s]")
