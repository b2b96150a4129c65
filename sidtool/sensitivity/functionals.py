"""Functionals: numbers that a motion gives, such as `max_abs(rod.q1)`.

A functional is written NAME(OUTPUT) or NAME(OUTPUT, ARGUMENT).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_label
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, parse_output, unit_of
from sidtool.formats.toml.expressions import evaluate_number, split_at_commas
from sidtool.solver.system.system import System

from .history import History, Peak
from .measurements import Measurement, read_measurements

if TYPE_CHECKING:
    from sidtool.solver.analyses.linearisation import Linearisation

_FORM = re.compile(r"(\w+)\((.*)\)")
_EXPECTED = "NAME(OUTPUT), such as max_abs(rod.q1); `sidtool sensitivity -h` lists all"


class Kind(NamedTuple):
    """A kind of functional.

    Attributes
    ----------
    argument : what stands behind the output: "", "time", "power", "band" or "file"
    text : one line for `--help`
    unit : unit of a value, from the unit of the output
    """

    argument: str
    text: str
    unit: Callable[[str], str] = lambda unit: unit


def _times_second(unit: str) -> str:
    return f"{unit} s".strip()


#: Functionals of a motion, with an output.
MOTION_KINDS = {
    "max": Kind("", "largest value, at its exact instant"),
    "min": Kind("", "least value"),
    "max_abs": Kind("", "largest absolute value"),
    "mean": Kind("", "mean over time"),
    "rms": Kind("", "root of the mean square over time"),
    "integral": Kind("", "integral over time", _times_second),
    "norm": Kind("power", "norm(y, p): (mean of |y|^p)^(1/p), a smooth max_abs"),
    "final": Kind("", "value at the end of the motion"),
    "value": Kind("time", "value(y, t): value at the time t"),
    "settling_time": Kind(
        "band",
        "settling_time(y, b): time from which on y stays within b of its last value",
        lambda _: "s",
    ),
    "error": Kind("file", "error(y, FILE.csv): root mean square distance to a table"),
}
#: Functionals of the scene without a motion.
SCENE_KINDS = {
    "end_time": Kind(
        "", "time at which the motion ends, as by an event", lambda _: "s"
    ),
    "mass": Kind(
        "", "mass(BODY): mass of a body; mass(*) of all bodies", lambda _: "kg"
    ),
    "frequency": Kind("", "frequency(k): k-th natural frequency", lambda _: "Hz"),
    "damping_ratio": Kind("", "damping_ratio(k): of that mode", lambda _: ""),
    "static": Kind("", "static(y): value in the static equilibrium"),
}
KINDS = MOTION_KINDS | SCENE_KINDS


@dataclass(frozen=True)
class Functional:
    """A functional of a scene.

    Attributes
    ----------
    text : as it was written
    kind : a key of `KINDS`
    output : output of the scene; body or number of a mode for some kinds
    number : time [s], power or half width of a band; 0 if it has none
    measurement : of `error`
    is_scalar : True if the value is one number
    """

    is_scalar: ClassVar[bool] = True

    text: str
    kind: str
    output: str
    number: float = 0.0
    measurement: Measurement | None = None

    @property
    def needs_motion(self) -> bool:
        return self.kind in MOTION_KINDS or self.kind == "end_time"

    @property
    def recorded(self) -> str:
        """The output that the scene has to evaluate, or empty."""
        return self.output if self.kind in (*MOTION_KINDS, "static") else ""

    def unit(self, scene: SceneFile) -> str:
        """Unit of the value."""
        unit = unit_of(self.recorded, scene) if self.recorded else ""
        return KINDS[self.kind].unit(unit)

    def peaks(self, history: History) -> list[Peak]:
        """Where the value lies in a nominal motion, for extrema, then a rival if there
        is one.
        """
        signs = {"max": (1.0,), "min": (-1.0,), "max_abs": (1.0, -1.0)}
        if self.kind not in signs:
            return []
        return history.find_peaks(self.output, signs[self.kind])

    def scale(self, history: History | None, values: Array) -> Array:
        """Sizes of changes of the values that matter."""
        largest = 0.0
        if history is not None and self.kind == "settling_time":
            largest = history.duration
        elif history is not None and self.kind in MOTION_KINDS:
            largest = float(np.abs(history.values(self.output)).max())
        return np.maximum(np.abs(values), max(largest, float(np.finfo(float).tiny)))

    def of_motion(self, history: History, peak: Peak | None) -> float:
        """The value of a motion.

        Parameters
        ----------
        peak : of the nominal motion

        Raises
        ------
        StructureChange : the motion ends before the time of the value.
        """
        if self.kind == "end_time":
            return history.motion.end_time
        if peak is not None:
            value = history.peak_value(self.output, peak)
            return peak.sign * value if self.kind == "max_abs" else value
        if self.kind == "final":
            return float(history.at(np.array([np.inf]), self.output)[0])
        if self.kind in ("value", "error"):
            times = np.array([self.number])
            if self.measurement is not None:
                times = self.measurement.times
            values = self._values_at(history, times)
            if self.measurement is None:
                return float(values[0])
            return float(np.sqrt(np.mean((values - self.measurement.values) ** 2)))
        if self.kind == "settling_time":
            return history.settling(self.output, self.number)[0]
        y = history.values(self.output)
        if self.kind == "integral":
            return history.integral(y)
        if self.kind == "mean":
            return history.integral(y) / history.duration
        power = 2.0 if self.kind == "rms" else self.number
        mean = history.integral(np.abs(y) ** power) / history.duration
        return float(mean ** (1.0 / power))

    def weights(
        self, history: History, peak: Peak | None
    ) -> tuple[Array | None, Array]:
        """Times [s] and weights w of the derivative sum(w dy(t)) of the value of a
        motion by its output; None for the times of all points of the steps.
        """
        if peak is not None:
            sign = peak.sign if self.kind == "max_abs" else 1.0
            times, weights, _ = history.peak_samples(self.output, peak)
            return times, sign * weights
        if self.kind == "final":
            return history.t[-1:], np.ones(1)
        if self.kind == "value":
            return np.array([self.number]), np.ones(1)
        if self.measurement is not None:
            times = self.measurement.times
            difference = self._values_at(history, times) - self.measurement.values
            root = float(np.sqrt(np.mean(difference**2)))
            return times, difference / (len(times) * max(root, 1e-300))
        if self.kind == "settling_time":  # |y(t) - y(end)| = band
            t, rate = history.settling(self.output, self.number)
            return np.array([t, history.t[-1]]), np.array([-1.0, 1.0]) / rate
        weights = history.points.integration_weights(history.t)
        if self.kind == "integral":
            return None, weights
        weights = weights / history.duration
        if self.kind == "mean":
            return None, weights
        y = history.values(self.output)
        power = 2.0 if self.kind == "rms" else self.number
        value = max(self.of_motion(history, None), 1e-300)
        return None, weights * np.sign(y) * (np.abs(y) / value) ** (power - 1.0)

    def _values_at(self, history: History, times: Array) -> Array:
        start, end = history.motion.system.scene.time.start, history.motion.end_time
        rounding = 1e-9 * (end - start)
        if times.min() < start - rounding or times.max() > end + rounding:
            raise InputError(
                f"the motion lasts from {start:g} to {end:g} s",
                place=self.text,
                expected="times inside",
            )
        return history.at(np.clip(times, start, end), self.output)

    def of_system(self, system: System) -> float:
        """The value of a scene without a motion.

        Raises
        ------
        SimulationError : there is no equilibrium, or there are no modes.
        """
        if self.kind == "mass":
            return self._mass(system)
        if self.kind == "static":
            result = system.cached(_static_result)
            return float(result.values[0, result.names.index(self.output)])
        modes = system.cached(_natural_modes)
        column = modes.frequencies if self.kind == "frequency" else modes.damping_ratios
        k = int(self.output)
        if not 1 <= k <= len(column):
            raise InputError(
                f"the scene has {len(column)} natural modes",
                place=self.text,
                expected="the number of one of them",
            )
        return float(column[k - 1])

    def by_sids(self, derivatives: Iterable[tuple[str, SID, float]]) -> float | None:
        """The derivative of a value without a motion by a variable of models, None if
        it needs more than the derivatives of SIDs.

        Parameters
        ----------
        derivatives : name of a body, derivative of its SID by a number, derivative of
            the number by the variable
        """
        if self.kind != "mass":
            return None
        parts = [(f * sid.mass, body) for body, sid, f in derivatives]
        return sum(part for part, body in parts if self.output in ("*", body))

    def _mass(self, system: System) -> float:
        masses = {b.name: b.sid.mass for b in system.bodies if b.is_scene_body}
        if self.output == "*":
            return float(sum(masses.values()))
        if self.output not in masses:
            raise InputError(
                f"there is no body {self.output!r}",
                place=self.text,
                expected=f"one of {', '.join(masses)}",
            )
        return float(masses[self.output])


class Term(NamedTuple):
    """A functional, at one of its peaks if it is an extremum.

    Attributes
    ----------
    functional : the functional
    peak : where it lies in the nominal motion
    rival_of : number of the functional of which this is another peak, or -1
    """

    functional: Functional
    peak: Peak | None = None
    rival_of: int = -1

    def value(self, system: System, history: History | None) -> Array:
        """The value of a scene and its motion, (1,), or several values."""
        if self.functional.needs_motion and history is not None:
            return np.atleast_1d(self.functional.of_motion(history, self.peak))
        return np.atleast_1d(self.functional.of_system(system))


def _static_result(system: System) -> Result:
    """Outputs of the static equilibrium."""
    from sidtool.solver.analyses.static_equilibrium import static_equilibrium

    return static_equilibrium(system.full_joint_system).result()


def _natural_modes(system: System) -> Linearisation:
    """Natural modes about the static equilibrium."""
    from sidtool.solver.analyses.linearisation import linearise

    return linearise(system.full_joint_system)


def parse_functionals(
    texts: str | Iterable[str], folder: Path = Path(".")
) -> list[Functional]:
    """Parse functionals of the option `--of`; one text may hold several, with commas.

    Parameters
    ----------
    folder : of relative paths of tables

    Raises
    ------
    InputError : a text has another form.
    """
    given = [texts] if isinstance(texts, str) else [*texts]
    listed = dict.fromkeys(part for text in given for part in split_at_commas(text))
    if not listed:
        raise InputError("there is no functional", place="--of", expected=_EXPECTED)
    return [_parse(text, folder) for text in listed]


def _parse(text: str, folder: Path) -> Functional:
    match = _FORM.fullmatch(text)
    name = match[1] if match else text
    if name not in KINDS or (match is None and name != "end_time"):
        expected = _EXPECTED if match is None else f"one of {', '.join(KINDS)}"
        raise InputError(f"found {text!r}", place="--of", expected=expected)
    arguments = split_at_commas(match[2]) if match else []
    kind = KINDS[name]
    wanted = (1 if name != "end_time" else 0) + bool(kind.argument)
    if len(arguments) != wanted:
        raise InputError(
            f"found {text!r} with {len(arguments)} arguments",
            place="--of",
            expected=kind.text if kind.argument else f"{name}(...): {kind.text}",
        )
    output = arguments[0] if arguments else ""
    if name in MOTION_KINDS or name == "static":
        try:
            parse_output(output)
        except InputError as error:
            raise InputError(
                error.problem, place=f"--of {text}", expected=error.expected
            ) from None
    if name in ("frequency", "damping_ratio") and not is_label(output):
        raise InputError(f"found {text!r}", place="--of", expected=kind.text)
    if kind.argument == "file":
        path = folder / arguments[1].strip("'\"")
        return Functional(text, name, output, measurement=_measured(path, output))
    number = _number(arguments[1], text) if kind.argument else 0.0
    if kind.argument == "power" and not number >= 1.0:
        raise InputError(
            f"found {text!r}", place="--of", expected="a power of 1 or more"
        )
    if kind.argument == "band" and not number > 0.0:
        raise InputError(f"found {text!r}", place="--of", expected="a positive width")
    return Functional(text, name, output, number)


def _measured(path: Path, output: str) -> Measurement:
    """The column of an output in a table; the only column may have any name."""
    columns = read_measurements(path)
    if output not in columns and len(columns) > 1:
        raise InputError(
            f"has the columns {', '.join(columns)}", source=path, expected=output
        )
    return columns.get(output) or next(iter(columns.values()))


def _number(argument: str, text: str) -> float:
    try:
        return float(evaluate_number(argument, {}))
    except InputError:
        raise InputError(
            f"found {argument!r} in {text!r}", place="--of", expected="a number"
        ) from None


def recorded_outputs(functionals: Sequence[Functional]) -> list[str]:
    """Outputs that the scene has to evaluate, each once."""
    return list(dict.fromkeys(f.recorded for f in functionals if f.recorded))
