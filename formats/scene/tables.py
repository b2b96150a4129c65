"""Tables of a scene: time, accuracy, outputs, start, and all of them together.

Events: instants at which a quantity crosses a value.

Output times of a scene.
"""

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import StringConstraints, model_validator

from ..base.errors import InputError
from ..toml.files import Diagnostics, File
from ..toml.reading import PARAMETERS, PARAMETERS_MEAN
from ..toml.tables import (
    Entries,
    Field,
    Number,
    OptionalInteger,
    OptionalNumber,
    Takes,
    Texts,
)
from .base import Table, Time, Vector
from .bodies import Body, ElasticInitial, Ground, Initial, SidBody
from .forces import Force
from .joints import Drive, Joint
from .laws import Input
from .outputs import INSTANTANEOUS, SCENE_QUANTITIES, parse_output
from .signal_files import LookupTable
from .values import raise_failure

MAX_OUTPUT_TIMES = 10_000_000


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


class OutputTimes:
    """Times of the rows of the result [s], increasing; a slice of them is an array.

    Multiples of the output step from the start; the end is one of them if it fits.

    Raises
    ------
    InputError : there are too many, or the scene defines none.
    """

    def __init__(self, scene: "SceneTables") -> None:
        self._time = scene.time
        self._span = scene.time.end - scene.time.start
        self._count = len(scene.time.output_times or ())
        step = scene.time.output_step
        if step is None and scene.time.output_times is None:
            raise InputError(
                "neither is given",
                place="time",
                expected="one of output_step and output_times",
            )
        if step is None:
            return
        steps = self._span / step * (1 + 1e-12) + 1e-9
        if not steps < MAX_OUTPUT_TIMES + 1:
            count = int(steps) if steps < 1e15 else f"{steps:.3g}"
            raise InputError(
                f"asks for {count} output times",
                place="time.output_step",
                expected=f"at most {MAX_OUTPUT_TIMES}",
            )
        self._count = int(steps) + 1

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, part: slice) -> NDArray[np.float64]:
        time, last = self._time, self._count - 1
        if time.output_step is None:
            return np.array(time.output_times)[part]
        steps = np.arange(*part.indices(self._count), dtype=np.float64)
        if abs(last * time.output_step - self._span) <= 1e-9 * self._span:
            return time.start + self._span * steps / max(last, 1)
        return time.start + time.output_step * steps


def output_times(scene: "SceneTables") -> NDArray[np.float64]:
    """All of them, (nt,)."""
    return OutputTimes(scene)[:]


#: Limits of the requested relative error; what is feasible is measured.
MIN_RELATIVE_ERROR, MAX_RELATIVE_ERROR = 1e-10, 0.5
Relative = Annotated[float, Field(ge=MIN_RELATIVE_ERROR, le=MAX_RELATIVE_ERROR)]
Amount = Annotated[str, StringConstraints(min_length=1)]
Wanted = Relative | Annotated[dict[str, Relative | Amount], Field(min_length=1)]


class Accuracy(Table):
    """How the motion is integrated; a fixed `step` replaces the error control.

    With `wanted` the model and how it is integrated are chosen by measurement, and
    `rtol` and `integrator` do not count.
    """

    wanted: Takes[Wanted | None, float | Mapping[str, float | str] | None] = Field(
        default=None,
        description="error that outputs may have: a part of the variation of all that "
        'are recorded, such as 1e-3, or a table such as {"piston.x" = "1e-6 m", '
        '"pin.fx" = "0.1 %", "rod.q*" = 1e-3} of those that count. The cheapest model '
        "that keeps it is found: shape functions, rigid bodies, terms, integrator",
    )
    rtol: Number = Field(
        default=1e-6,
        ge=1e-13,
        le=0.1,
        description="error of the run, relative to the largest motion",
    )
    integrator: str = Field(
        default="radau9",
        description="radau5, radau9, radau13, dop853 (not stiff), generalised_alpha, "
        "trapezoidal, or auto: dop853 for rigid bodies, radau9 else and where they are "
        "stiff",
    )
    step: OptionalNumber = Field(default=None, gt=0, description="fixed step [s]")
    spectral_radius: Number = Field(
        default=0.8,
        ge=0,
        le=1,
        description="of generalised_alpha: what it leaves of a vibration far too fast "
        "for the step, 0 nothing to 1 all",
    )


class Outputs(Table):
    """What is recorded: BODY.QUANTITY, BODY.MARKER.QUANTITY, JOINT.QUANTITY, ..."""

    record: Texts = Field(
        default=(),
        description="of bodies x, vx, ax, angle, wz, q1, q*, peak_von_mises, "
        "norm_von_mises, quaternion_0 to _3, rotation_x, momentum_x, "
        "angular_momentum_x; of markers x, vx, ax, ux, angle, wz, quaternion_0 to _3, "
        "rotation_x, sigma_xx, von_mises; "
        "of sections N, Vy, Vz, T, My, Mz; "
        "of joints angle, angle_rate, displacement, ... as they have them; of joints, "
        "drives and forces fx, mz and, along their coordinate, force or torque, power; "
        "of joints and drives the multipliers f1, f2, ...; of springs, dampers and "
        "actuators length, deflection, rate; energy.kinetic, constraint.position, "
        "momentum.x, angular_momentum.x, inputs.NAME, ...; y and z likewise; `*` "
        "stands for any letters within a part: rod.*.ux, *.x, pin.f*",
    )


class RunResult(Protocol):
    """Result of a run, such as `sidtool.Result`."""

    @property
    def t(self) -> NDArray[np.float64]:
        """(nt,) output times [s]."""

    @property
    def positions(self) -> NDArray[np.float64]:
        """(nt, .) positions of the bodies."""


class Start(Table):
    """How bodies start; each has its position in its own table `initial`."""

    state: Literal["stated", "static", "result"] = Field(
        default="stated",
        description="result: in a state of another run, see `file`; static: in the "
        "equilibrium nearest downhill from what is stated, under gravity and the loads "
        "at the start, drives held; stated velocities stay, and bodies carry the loads "
        "of that motion; where bodies rotate about fixed axes it is a steady rotation, "
        "in which springs and bushings carry them, too, without vibration; N224 names "
        "the reason if there is none",
    )
    file: Takes[str | None, str | RunResult | None] = Field(
        default=None,
        min_length=1,
        description="result (.h5) in whose last state all bodies start, found by their "
        "names; joints, drives and forces may be others",
    )
    time: OptionalNumber = Field(
        default=None, description="another output time of `file` to start from [s]"
    )
    bodies: Takes[
        dict[str, ElasticInitial] | None, Mapping[str, ElasticInitial | Entries] | None
    ] = Field(
        default=None,
        description="where bodies start, in the place of `file`, as results hold it; "
        "their own tables `initial` then place axes of joints only",
    )
    rotations: Takes[dict[str, float] | None, Mapping[str, float] | None] = Field(
        default=None,
        description="counted rotations of joints, with their whole turns [rad], of "
        "results; static: from which the equilibrium is sought",
    )
    states: Takes[dict[str, float] | None, Mapping[str, float] | None] = Field(
        default=None,
        description="states of laws, by FORCE.state.NAME, of results; static: from "
        "which the equilibrium is sought",
    )
    sids: Takes[dict[str, str] | None, Mapping[str, str] | None] = Field(
        default=None,
        description="digests of the SIDs that elastic coordinates in `bodies` are of",
    )

    @model_validator(mode="after")
    def _begins_somewhere(self) -> Self:
        if self.state == "result" and self.file is None and self.bodies is None:
            raise ValueError("the name of a result as `file`")
        if self.state != "result" and not (self.file is None is self.bodies):
            raise ValueError('`state = "result"` beside `file`')
        of_results = ["time", "sids"]
        if self.state != "static":
            of_results += ["rotations", "states"]
        for key in of_results:
            if self.state != "result" and getattr(self, key) is not None:
                raise ValueError(f'`state = "result"` beside `{key}`')
        return self


class SceneTables(File):
    """The tables of a scene, before they are checked against each other."""

    named: ClassVar[tuple[str, ...]] = (
        "bodies",
        "joints",
        "drives",
        "forces",
        "inputs",
        "tables",
        "events",
        PARAMETERS,
    )
    either: ClassVar[tuple[tuple[str, str], ...]] = (("sid", "model"),)
    paths: ClassVar[tuple[tuple[str, ...], ...]] = (
        ("bodies", "*", "sid"),
        ("bodies", "*", "model"),
        ("bodies", "*", "shape", "file"),
        ("initial", "file"),
    )

    format: Literal["sidtool scene"] = "sidtool scene"
    version: Literal[1] = 1
    title: str = ""
    parameters: Takes[dict[str, float], Mapping[str, float | str]] = Field(
        default_factory=dict, description=PARAMETERS_MEAN
    )
    dimension: Literal["planar", "spatial"] = Field(
        description="motion in the xy plane, or in space"
    )
    gravity: Takes[Vector | None, ArrayLike | None] = Field(
        default=None, description="[m/s2], default none"
    )
    time: Takes[Time, Time | Entries] = Field(
        description="the table [time] with start, end, output_step"
    )
    accuracy: Takes[Accuracy, Accuracy | Entries] = Field(
        default=Accuracy.model_construct()
    )
    initial: Takes[Start, Start | Entries] = Field(default=Start.model_construct())
    ground: Takes[Ground, Ground | Entries] = Field(default=Ground.model_construct())
    bodies: Takes[dict[str, Body], Mapping[str, Body | Entries]] = Field(
        min_length=1, description="at least one body"
    )
    joints: Takes[dict[str, Joint], Mapping[str, Joint | Entries]] = Field(
        default_factory=dict
    )
    drives: Takes[dict[str, Drive], Mapping[str, Drive | Entries]] = Field(
        default_factory=dict
    )
    forces: Takes[dict[str, Force], Mapping[str, Force | Entries]] = Field(
        default_factory=dict
    )
    inputs: Takes[dict[str, Input], Mapping[str, Input | Entries]] = Field(
        default_factory=dict
    )
    tables: Takes[dict[str, LookupTable], Mapping[str, LookupTable | Entries]] = Field(
        default_factory=dict
    )
    events: Takes[dict[str, Event], Mapping[str, Event | Entries]] = Field(
        default_factory=dict
    )
    outputs: Takes[Outputs, Outputs | Entries] = Field(
        default=Outputs.model_construct()
    )
    diagnostics: Takes[Diagnostics, Diagnostics | Entries] = Field(
        default=Diagnostics.model_construct()
    )

    @property
    def sid_bodies(self) -> dict[str, SidBody]:
        """The bodies with a SID."""
        return {n: b for n, b in self.bodies.items() if isinstance(b, SidBody)}

    def initial_of(self, body: str) -> Initial:
        """Where a body starts: as its own table says, or in the state of a result."""
        return (self.initial.bodies or {}).get(body) or self.bodies[body].initial

    @property
    def flexible(self) -> list[str]:
        """Names of the bodies with a SID."""
        return list(self.sid_bodies)
