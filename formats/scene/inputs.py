"""Inputs of a scene: signals from outside, for forces, drives and control laws."""

from collections.abc import Mapping
from typing import Literal

from ..toml.constructor_types import Field, Number, OptionalNumbers
from .functions import SIGNAL_FILE, TIME_COLUMN, VALUE_COLUMN
from .signal_files import SCALE
from .signal_table import SignalTable

#: How an input goes on between its values, by the number of continuous derivatives
#: plus one.
INTERPOLATIONS = ("hold", "linear", "smooth")


class Input(SignalTable):
    """A signal that comes from outside of the scene.

    A program that advances the scene as a plant sets it. In a run it follows its table
    `times`, `values`, or stays at `initial`. Held values jump, so that a drive cannot
    prescribe them as positions or rates: it takes a held acceleration, a linear rate, a
    smooth position, or the state of a formula that follows the input with a lag.
    """

    initial: Number = Field(
        default=0.0, description="value at the start, and before the first held time"
    )
    unit: str | None = Field(
        default=None,
        description="such as N m; default that of the force that it alone scales, or "
        "of what it prescribes",
    )
    interpolation: Literal["hold", "linear", "smooth"] = Field(
        default="hold",
        description="between values: hold the last one, straight lines, or a cubic "
        "spline; of a plant the way through the next communication step",
    )
    file: str | None = Field(default=None, description=SIGNAL_FILE)
    time: str | int | None = Field(default=None, description=TIME_COLUMN)
    value: str | int | None = Field(default=None, description=VALUE_COLUMN)
    scale: float | None = Field(default=None, description=SCALE)
    times: OptionalNumbers = Field(
        default=None, min_length=1, description="of a table for runs [s], growing"
    )
    values: OptionalNumbers = Field(
        default=None, min_length=1, description="as many as there are times"
    )

    @property
    def continuity(self) -> int:
        """0 if its value may jump, 1 if its rate may, 2 if neither does."""
        return INTERPOLATIONS.index(self.interpolation)


def without_tables(inputs: Mapping[str, Input]) -> dict[str, None]:
    """Changes of a scene, see `File.with_`, by which its inputs have no tables: where a
    program sets them, they begin with `initial`."""
    named = [name for name, signal in inputs.items() if signal.times is not None]
    return {
        f"inputs.{name}.{key}": None for name in named for key in ("times", "values")
    }
