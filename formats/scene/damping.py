"""Damping of flexible bodies, in place of what their SID holds."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from ..damping import RayleighDamping
from ..toml.constructor_types import Field
from .base import Table

Values = tuple[Annotated[float, Field(ge=0)], ...]


class SidDamping(Table):
    """The matrix De of the SID."""

    type: Literal["sid"] = "sid"


def _numbers(value: Any) -> Any:
    single = isinstance(value, int | float) and not isinstance(value, bool)
    if single:
        return (float(value),)
    return tuple(value) if isinstance(value, list) else value


class ModalDamping(Table):
    """A share of the critical damping for each natural mode of Me and Ke.

    One value holds for all modes; several are for the modes by growing frequency.
    """

    type: Literal["modal"] = "modal"
    ratio: Annotated[
        Values,
        BeforeValidator(_numbers, json_schema_input_type=float | Values),
        Field(min_length=1, description="damping ratio of all or of each mode"),
    ]


class FrequencyDamping(Table):
    """The default of commercial codes: by the frequency of each natural mode.

    1 % of the critical damping up to 100 Hz, 10 % up to 1000 Hz, critical beyond.
    """

    type: Literal["frequency"] = "frequency"


Damping = Annotated[
    SidDamping | RayleighDamping | ModalDamping | FrequencyDamping,
    Field(discriminator="type"),
]
