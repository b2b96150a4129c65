"""Events: instants at which a quantity crosses a value."""

from typing import Literal

from ..toml.constructor_types import Field, Number, OptionalInteger
from .base import Table
from .outputs import INSTANTANEOUS, SCENE_QUANTITIES, parse_output
from .values import raise_failure


class Event(Table):
    """A crossing of `value` by a quantity, found inside the steps of the run.

    A quantity that starts at the value, or only touches it, does not cross it.
    """

    quantity: str = Field(
        description="one of the names that [outputs] knows, such as piston.x"
    )
    value: Number = Field(default=0.0, description="in the unit of the quantity")
    direction: Literal["rising", "falling", "both"] = Field(
        default="both", description="of the quantity as it passes the value"
    )
    action: Literal["record", "stop"] = Field(
        default="record", description="note the state, or end the run there, too"
    )
    count: OptionalInteger = Field(
        default=None,
        ge=1,
        description="record: at most so many, default all; stop: at this crossing, "
        "default the first",
    )


def check_quantity(text: str, place: str) -> None:
    """Check that the quantity of an event is one number of the state at one time.

    Raises
    ------
    InputError : it is a list of outputs, or an integral over the run.
    """
    if "*" in text:
        raise_failure(place, f"{text} stands for several outputs", "one of them")
    name = parse_output(text)
    if name.owner in SCENE_QUANTITIES and name.quantity not in INSTANTANEOUS:
        listed = ", ".join(f"energy.{quantity}" for quantity in INSTANTANEOUS[:3])
        raise_failure(place, f"{text} is nothing that an event can look at", listed)
