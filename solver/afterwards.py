"""A run looked at again: its result holds scene, SIDs and states, and so all outputs.

Nothing is integrated. The scene is compiled and assembled as for the run, and outputs
are evaluated at the states of the result, which are positions and velocities.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, expanded
from sidtool.formats.sid import Array
from sidtool.formats.toml.reading import validated

from . import compile_scene, warmup
from .functions.callables import Derivatives
from .functions.laws import Law
from .recording.grip_choice import regripped, with_grips
from .recording.interpolation import interpolated
from .recording.outputs import position_names, record, velocity_names
from .recording.sampling import Sampler, Samples
from .recording.told import tells_of_bodies
from .recording.untold import lost_laws, sampled_laws, untold
from .space import layout as at
from .start.assembly import assemble
from .start.loads import with_prescribed_friction
from .start.new_control import closed_below
from .start.settings import settings_of
from .start.turn_counts import keep_turns, starting_turns
from .system import kernel_calls
from .system.scene import System
from .system.storage import new_work

#: Rotations between two output times beyond which turns cannot be counted [rad].
LARGEST_TURN = 0.5 * np.pi

#: Variations of outputs below this share of their size are none, and the least size.
_FLAT, _NOTHING = 1e-6, 1e-300

Programs = Mapping[str, Derivatives | Law]


@dataclass(frozen=True, eq=False)
class Replay:
    """A compiled scene and the states that a result holds.

    system : the scene, assembled as at the start of the run; laws that are lost act not
    t, z, v : (nt,), (nt, .), (nt, .)
    forces_known : whether all forces of the run act at all times
    """

    system: System
    t: Array
    z: Array
    v: Array
    forces_known: bool = True

    def outputs(self, times: Array | None = None) -> dict[str, Array]:
        """The outputs of the scene by name, (nt,) each.

        times : default those of the result; between them states are interpolated by
            cubic Hermite polynomials and projected on the constraints
        """
        t, z, v = self.states(times)
        regripped(self.system, t, z, v)
        found = record(self._sampler, t, z, v)
        return dict(zip(found.names, found.values.T, strict=True))

    def samples(self, times: Array | None = None) -> Samples:
        """Frames and markers at some times, see `outputs`."""
        t, z, v = self.states(times)
        regripped(self.system, t, z, v)
        return self._sampler.sample(t, z, v)

    def states(self, times: Array | None) -> tuple[Array, Array, Array]:
        """Times, positions and velocities, as copies."""
        if times is None or len(self.t) < 2:
            return self.t.copy(), self.z.copy(), self.v.copy()
        known = (self.t, self.z, self.v)
        regripped(self.system, *known)
        return times.copy(), *self._between(known, times)

    def uncertainty(self) -> float:
        """How far states between output times may be off, relative to their range.

        Every other output time is predicted from its neighbours, whose distance is
        twice as large: the error between neighbours is a sixteenth of that.
        """
        if len(self.t) < 3:
            return 1.0
        thin, left_out = self._thinned()
        z, _ = self._between((thin.t, thin.z, thin.v), self.t[left_out].copy())
        ranges = np.ptp(self.z, axis=0)
        moving = ranges > 1e-6 * ranges.max(initial=0.0)
        errors = np.abs(z - self.z[left_out])[:, moving].max(axis=0) / ranges[moving]
        return float(errors.max(initial=0.0)) / 16.0

    def unresolved(self, known: dict[str, Array]) -> dict[str, float]:
        """How far each output is off where every other output time is left out, at
        these, relative to its range: about one for what varies faster than output
        times follow, and sixteen times the error between them for what they follow.

        known : the outputs at the times of the result, see `outputs`
        """
        if len(self.t) < 3:
            return {}
        thin, left_out = self._thinned()
        predicted = thin.outputs(self.t[left_out].copy())
        found = {}
        for name, values in known.items():
            size = max(np.ptp(values), _FLAT * np.abs(values).max(), _NOTHING)
            found[name] = float(np.abs(predicted[name] - values[left_out]).max() / size)
        return found

    def _thinned(self) -> tuple[Replay, slice]:
        """Every other state, and where those between them stand here."""
        t, z, v = (part[::2].copy() for part in (self.t, self.z, self.v))
        return replace(self, t=t, z=z, v=v), slice(1, 2 * len(t) - 2, 2)

    def _between(
        self, known: tuple[Array, Array, Array], times: Array
    ) -> tuple[Array, Array]:
        return interpolated(self._sampler, known, times, forces_known=self.forces_known)

    @cached_property
    def _sampler(self) -> Sampler:
        settings = settings_of(self.system, None, None, None, None)
        return Sampler(self.system, closed_below(self.system, settings))


def replay(
    result: Result,
    names: Iterable[str] = (),
    drives: Programs | None = None,
    forces: Programs | None = None,
    between: bool = False,
) -> Replay:
    """The scene of a result with other outputs, at the states of the result.

    names : of outputs, also with wildcards
    drives, forces : callables that the run was made with, by name; results keep what
        was seen of functions of time, so that only laws are missed
    between : the outputs are to be told between the times of the result, too

    Raises
    ------
    InputError : the result does not hold its scene or SIDs, a name is that of no
        output or of one that states do not tell (see `untold`), or rotations are too
        fast to be counted.
    """
    laws = {**result.laws, **(drives or {}), **(forces or {})}
    told = scene_of(result)
    scene = _scene_of(result, tuple(names), laws, between)
    warmup.ensure(scene.dimension == "planar", (), tells_of_bodies(scene))
    system = compile_scene(
        scene,
        sids=dict(result.sids),
        accept_defects=True,
        drives={n: law for n, law in laws.items() if n not in told.forces},
        forces={n: law for n, law in laws.items() if n in told.forces},
        keep_joints="analysis" in result.settings,
    )
    system, start = assemble(system)
    v = _columns(result.velocities, result.velocity_names, velocity_names(system))
    if np.isnan(v).any():
        raise _unlike("velocities")
    z = _columns(result.positions, result.position_names, position_names(system))
    turns = z.shape[1] - system.n_turns
    if np.isnan(z[:, :turns]).any():
        raise _unlike("positions")
    if np.isnan(z).any() and len(z):
        _count_turns(system, result.t, z, v)
    whole = not lost_laws(told, laws) and not sampled_laws(told, laws)
    system = with_grips(with_prescribed_friction(system, start))
    return Replay(system, result.t, z, v, whole)


def scene_of(result: Result) -> SceneFile:
    """The scene that a result was made with.

    Raises
    ------
    InputError : the result holds none.
    """
    if not result.scene:
        raise InputError("holds no scene", expected="a result of a simulation")
    return validated(json.loads(result.scene), SceneFile, source="scene of the result")


def _scene_of(
    result: Result, names: tuple[str, ...], laws: Programs, between: bool
) -> SceneFile:
    """With these outputs and without events and forces and drives whose laws are lost;
    without names, no outputs at all."""
    scene = scene_of(result)
    missing = [name for name in scene.flexible if name not in result.sids]
    if missing:
        raise InputError(
            f"holds no SID of {', '.join(missing)}",
            expected="a result of this version of sidtool; simulate again",
        )
    record = expanded(names, scene, result.sids)
    for name, (why, expected) in untold(record, scene, laws, between).items():
        raise InputError(f"{name} {why}", expected=expected)
    content: dict[str, Any] = json.loads(result.scene)
    content.pop("events", None)
    for name in lost_laws(scene, laws):
        if name in scene.drives:
            del content["drives"][name]
        else:  # other laws may read its length
            content["forces"][name]["function"] = {"type": "constant", "value": 0.0}
    content["outputs"] = {"record": list(record)}
    try:
        return validated(content, SceneFile, source="scene of the result")
    except InputError as error:
        if not (error.place or "").startswith("outputs."):
            raise
        # Asked for by name: not a mistake of the scene.
        raise InputError(error.problem, expected=error.expected) from None


def _columns(table: Array, known: tuple[str, ...], wanted: tuple[str, ...]) -> Array:
    """Columns by name, those that are not known as NaN."""
    places = {name: i for i, name in enumerate(known)}
    found = np.full((len(table), len(wanted)), np.nan)
    for column, name in enumerate(wanted):
        if name in places:
            found[:, column] = table[:, places[name]]
    return found


def _count_turns(system: System, t: Array, z: Array, v: Array) -> None:
    """Fills in angles that were not counted in the run, each from the one before.

    Raises
    ------
    InputError : one turns too far between two times.
    """
    work, n = new_work(system), system.n_turns
    fresh = np.isnan(z[:, z.shape[1] - n :]).any(axis=0)
    before = starting_turns(system)
    for k, clock in enumerate(system.clocks(t)):
        part = z[k, z.shape[1] - n :]
        part[fresh] = before[fresh]
        work.clock[0] = clock
        kernel_calls.evaluate(system, work, t[k], z[k], v[k])
        keep_turns(system, work, z[k])
        step = t[k] - t[k - 1] if k else 0.0
        way = np.maximum(
            np.abs(part - before) if k else 0.0,
            step * np.abs(work.turn[:n, at.TURN_RATE]),
        )
        if (way[fresh] > LARGEST_TURN).any():
            raise InputError(
                f"a joint turns by more than a quarter between output times at "
                f"t = {t[k]:.6g} s, where its angle cannot be counted afterwards",
                expected="a smaller output_step, or the angle recorded in the run",
            )
        before = part.copy()


def _unlike(what: str) -> InputError:
    return InputError(
        f"its {what} are not those of its scene",
        expected="a result of this version of sidtool",
    )
