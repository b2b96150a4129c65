"""Rayleigh damping, which model files and scene files know."""

from __future__ import annotations

from typing import Literal

from .toml.constructor_types import Field
from .toml.tables import Table


class RayleighDamping(Table):
    """alpha Me + beta Ke."""

    type: Literal["rayleigh"] = "rayleigh"
    alpha: float = Field(default=0.0, ge=0, description="of the mass [1/s]")
    beta: float = Field(default=0.0, ge=0, description="of the stiffness [s]")
