"""Control laws of forces and drives: formulas and PID controllers of outputs.

Inputs of a scene: signals from outside, for forces, drives and control laws.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import PrivateAttr

from ..toml.expressions import Postfix, parse_expression
from ..toml.tables import (
    Entries,
    Field,
    Number,
    OptionalNumber,
    OptionalNumbers,
    OptionalTwoNumbers,
    Takes,
)
from .base import Table
from .functions import (
    SIGNAL_FILE,
    TIME_COLUMN,
    VALUE_COLUMN,
    Constant,
    Function,
    Given,
    Harmonic,
    InputFunction,
    Polynomial,
    SineRamp,
    SmoothStep,
    Spline,
    Sum,
)
from .signal_files import SCALE, LookupTable, SignalTable

#: How an input goes on between its values, by the number of continuous derivatives
#: plus one.
INTERPOLATIONS = ("hold", "linear", "smooth")

_LIMITS = "lower and upper bound of the value"
_SAMPLE = (
    "time between two samples [s]: the value is computed from what is measured at a "
    "sample and held until the next; default none, all the time"
)


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


class State(Table):
    """A number that a law keeps, as an integral or a filter does.

    It follows the differential equation x' = `rate`; that of a law with a sample time
    becomes `next` at each sample, after the value was computed.
    """

    initial: Number = Field(default=0.0, description="at the start")
    rate: str | None = Field(default=None, description="a formula, as `value`")
    next: str | None = Field(default=None, description="a formula, with sample_time")


class Expression(Table):
    """A formula of outputs, such as "-50*elbow.angle - 3*elbow.angle_rate + 2*sin(t)".

    Names are t, pi, parameters, terms, states, inputs of the scene, and outputs that
    are positions or velocities:
    coordinates of joints and their rates, places and velocities of markers and rigid
    bodies, elastic coordinates; states of other laws as FORCE.state.NAME or
    DRIVE.state.NAME. Names with a hyphen are quoted. Operators are + - * / and **;
    functions are sin cos tan asin acos atan atan2 sinh cosh tanh exp log sqrt abs sign
    min max, clip(x, lower, upper), and lookup(TABLE, x) or lookup(TABLE, x, y) of the
    tables of the scene.
    """

    type: Literal["expression"] = "expression"
    value: str = Field(
        description="the formula [N] or [N m]; of a point force the factor, of a drive "
        "what it prescribes"
    )
    parameters: Takes[dict[str, float], Mapping[str, float | str]] = Field(
        default_factory=dict, description="numbers by name, beside those of the scene"
    )
    terms: Takes[dict[str, str], Mapping[str, str]] = Field(
        default_factory=dict,
        description="parts of the formulas by name, formulas themselves, such as "
        'r = "sqrt(load.x^2 + load.y^2)"; they may read each other',
    )
    states: Takes[dict[str, State], Mapping[str, State | Entries]] = Field(
        default_factory=dict, description="numbers that the law keeps, by name"
    )
    limits: OptionalTwoNumbers = Field(default=None, description=_LIMITS)
    sample_time: OptionalNumber = Field(default=None, gt=0, description=_SAMPLE)
    _shared: dict[str, float] = PrivateAttr(default_factory=dict)
    _tables: dict[str, LookupTable] = PrivateAttr(default_factory=dict)

    def parse(self, text: str) -> Postfix:
        """The instructions of one of its formulas.

        Raises
        ------
        InputError : states where the formula is invalid.
        """
        return parse_expression(text, self.known, self.terms)

    @property
    def known(self) -> dict[str, float]:
        """Its parameters and those of its scene, which its own names hide."""
        shared = {k: v for k, v in self._shared.items() if k not in self.states}
        return shared | self.parameters

    @property
    def tables(self) -> dict[str, LookupTable]:
        """The tables of its scene."""
        return self._tables

    def share(
        self, parameters: dict[str, float], tables: dict[str, LookupTable]
    ) -> None:
        """Makes the parameters and the tables of its scene known."""
        self._shared, self._tables = parameters, tables


class Pid(Table):
    """A controller: p e + i (integral of e) + d e' of e = reference - measured.

    With `limits` the integral follows e + (limited - unlimited value) / (i T), so that
    it does not wind up; T is `anti_windup`. With `filter` e' passes a first-order lag.
    """

    type: Literal["pid"] = "pid"
    measured: str = Field(description="an output that is a position or a velocity")
    reference: Takes[float | str | Function, float | str | Function | Entries] = Field(
        default=0.0, description="a number, an output, or a function of time"
    )
    p: Number = Field(default=0.0, description="[N/m], [N m/rad]")
    i: Number = Field(default=0.0, description="[N/(m s)], [N m/(rad s)]")
    d: Number = Field(default=0.0, description="[N s/m], [N m s/rad]")
    filter: OptionalNumber = Field(
        default=None, gt=0, description="time constant of the lag [s], default none"
    )
    limits: OptionalTwoNumbers = Field(default=None, description=_LIMITS)
    anti_windup: OptionalNumber = Field(
        default=None,
        gt=0,
        description="T [s], default sqrt(|d / i|), or |p / i| without d",
    )
    sample_time: OptionalNumber = Field(default=None, gt=0, description=_SAMPLE)


#: What scales a force, or a drive prescribes: a function of time, or a law.
ForceFunction = Annotated[
    Constant
    | Polynomial
    | Harmonic
    | SmoothStep
    | SineRamp
    | Spline
    | InputFunction
    | Sum
    | Given
    | Expression
    | Pid,
    Field(discriminator="type"),
]


def states_of(function: object) -> tuple[str, ...]:
    """Return the names of the states of a control law of a scene."""
    if isinstance(function, Expression):
        return tuple(function.states)
    if not isinstance(function, Pid):
        return ()
    lagged = function.d != 0.0 and function.filter is not None
    has_state = {"derivative": lagged, "integral": function.i != 0.0}
    return tuple(name for name, is_kept in has_state.items() if is_kept)
