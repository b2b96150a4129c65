"""Events: moments at which a quantity passes a value, noted or the end of the run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from ..toml.constructor_types import Field, Number, OptionalInteger
from .base import Table
from .checks.failures import fail
from .outputs import INSTANTANEOUS, SCENE_QUANTITIES, parse_output

if TYPE_CHECKING:
    from .file import SceneFile


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
    """What an event looks at is one number that the state at one time decides.

    Raises
    ------
    InputError : it is a list of outputs, or an integral over the run.
    """
    if "*" in text:
        fail(place, f"{text} stands for several outputs", "one of them")
    name = parse_output(text)
    if name.owner in SCENE_QUANTITIES and name.quantity not in INSTANTANEOUS:
        listed = ", ".join(f"energy.{quantity}" for quantity in INSTANTANEOUS[:3])
        fail(place, f"{text} is nothing that an event can look at", listed)


def watched(scene: SceneFile) -> tuple[str, ...]:
    """Outputs that the scene records or its events look at."""
    looked_at = (event.quantity for event in scene.events.values())
    return tuple(dict.fromkeys([*scene.outputs.record, *looked_at]))
