"""Outputs of a finished run, evaluated from its recorded states.

A result contains scene, SIDs and states. The scene is compiled and assembled as for the
run; positions and velocities are those of the result, nothing is integrated.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, expand_names
from sidtool.formats.toml.reading import validate_data

from .. import compile_scene
from ..compiler import precompile
from ..functions.callables import Derivatives
from ..functions.control_laws import Law
from ..initial_state.assembly import assemble
from ..initial_state.given_state import initial_rotations, store_rotations
from ..initial_state.initial_friction import with_prescribed_friction
from ..initial_state.integrator_start import constraint_tolerances, run_settings
from ..output.body_outputs import missing_laws, sampled_laws, unavailable_outputs
from ..output.columns import evaluate_outputs, position_names, velocity_names
from ..output.samples import (
    Samples,
    StateSampler,
    interpolate_states,
    needs_body_quantities,
)
from ..output.stick_slip import set_friction_states, with_friction_states
from ..spatial import system_arrays as at
from ..system import work_arrays
from ..system.system import System
from ..system.work_arrays import new_work_arrays

#: Rotations between two output times beyond which turns cannot be counted [rad].
MAX_ROTATION = 0.5 * np.pi

#: Variations of outputs below this share of their size are none, and the least size.
_CONSTANT_VARIATION, _MIN_SIZE = 1e-6, 1e-300

#: Output times whose frames, markers and forces are in memory together, and numbers
#: of their states.
_ROWS_AT_ONCE, _NUMBERS_AT_ONCE = 100_000, 5_000_000

GivenFunctions = Mapping[str, Derivatives | Law]


@dataclass(frozen=True, eq=False)
class Replay:
    """A compiled scene and the states that a result holds.

    Attributes
    ----------
    system
        The scene, assembled as at the start of the run; laws that are lost act not.
    t, z, v : (nt,)
        (nt, .), (nt, .).
    forces_known
        Whether all forces of the run act at all times.
    """

    system: System
    t: Array
    z: Array
    v: Array
    forces_known: bool = True

    def outputs(self, times: Array | None = None) -> dict[str, Array]:
        """The outputs of the scene by name, (nt,) each.

        Parameters
        ----------
        times
            Default those of the result; between them states are interpolated by cubic
            Hermite polynomials and projected on the constraints.
        """
        t, z, v = self.states(times)
        set_friction_states(self.system, t, z, v)
        values = np.empty((len(t), len(self.system.scene.outputs.record)))
        numbers = max(1, z.shape[1] + v.shape[1])
        count = max(1, min(_ROWS_AT_ONCE, _NUMBERS_AT_ONCE // numbers))
        for row in range(0, len(t), count):
            rows = slice(row, row + count)
            t_block, z_block, v_block = (part[rows].copy() for part in (t, z, v))
            found = evaluate_outputs(self._sampler, t_block, z_block, v_block)
            values[rows] = found.values
        return dict(zip(self.system.scene.outputs.record, values.T, strict=True))

    def samples(self, times: Array | None = None) -> Samples:
        """Frames and markers at some times, see `columns`."""
        t, z, v = self.states(times)
        set_friction_states(self.system, t, z, v)
        return self._sampler.sample(t, z, v)

    def states(self, times: Array | None) -> tuple[Array, Array, Array]:
        """Times, positions and velocities, as copies."""
        if times is None or len(self.t) < 2:
            return self.t.copy(), self.z.copy(), self.v.copy()
        known = (self.t, self.z, self.v)
        set_friction_states(self.system, *known)
        return times.copy(), *self._interpolate(known, times)

    def state_interpolation_error(self) -> float:
        """Error of states between output times, relative to their range.

        Every other output time is predicted from its neighbours, at twice the distance:
        the error between neighbours is a sixteenth of that.
        """
        if len(self.t) < 3:
            return 1.0
        reduced, omitted = self._every_other_state()
        z, _ = self._interpolate(
            (reduced.t, reduced.z, reduced.v), self.t[omitted].copy()
        )
        ranges = np.ptp(self.z, axis=0)
        moving = ranges > 1e-6 * ranges.max(initial=0.0)
        errors = np.abs(z - self.z[omitted])[:, moving].max(axis=0) / ranges[moving]
        return float(errors.max(initial=0.0)) / 16.0

    def interpolation_errors(self, known: dict[str, Array]) -> dict[str, float]:
        """How far each output is off where every other output time is left out, at
        these, relative to its range: about one for what varies faster than output
        times follow, and sixteen times the error between them for what they follow.

        Parameters
        ----------
        known
            The outputs at the times of the result, see `columns`.
        """
        if len(self.t) < 3:
            return {}
        reduced, omitted = self._every_other_state()
        predicted = reduced.outputs(self.t[omitted].copy())
        found = {}
        for name, values in known.items():
            size = max(
                np.ptp(values), _CONSTANT_VARIATION * np.abs(values).max(), _MIN_SIZE
            )
            found[name] = float(np.abs(predicted[name] - values[omitted]).max() / size)
        return found

    def _every_other_state(self) -> tuple[Replay, slice]:
        """Every other state, and where those between them stand here."""
        t, z, v = (part[::2].copy() for part in (self.t, self.z, self.v))
        return replace(self, t=t, z=z, v=v), slice(1, 2 * len(t) - 2, 2)

    def _interpolate(
        self, known: tuple[Array, Array, Array], times: Array
    ) -> tuple[Array, Array]:
        return interpolate_states(
            self._sampler, known, times, forces_known=self.forces_known
        )

    @cached_property
    def _sampler(self) -> StateSampler:
        settings = run_settings(self.system, None, None, None, None)
        return StateSampler(self.system, constraint_tolerances(self.system, settings))


def replay(
    result: Result,
    names: Iterable[str] = (),
    drives: GivenFunctions | None = None,
    forces: GivenFunctions | None = None,
    between: bool = False,
) -> Replay:
    """The scene of a result with other outputs, at the states of the result.

    Parameters
    ----------
    names
        Of outputs, also with wildcards.
    drives, forces
        Callables that the run was made with, by name; results keep what was seen of
        functions of time, so that only laws are missed.
    between
        The outputs are also evaluated between the times of the result.

    Raises
    ------
    InputError
        The result does not hold its scene or SIDs, a name is that of no output or of
        one that states do not determine (see `unavailable_outputs`), or rotations are
        too fast to be counted.
    """
    laws = {**result.laws, **(drives or {}), **(forces or {})}
    original_scene = scene_of(result)
    scene = _scene_with_outputs(result, tuple(names), laws, between)
    precompile.ensure_compiled(
        scene.dimension == "planar", (), needs_body_quantities(scene)
    )
    system = compile_scene(
        scene,
        sids=dict(result.sids),
        accept_defects=True,
        drives={n: law for n, law in laws.items() if n not in original_scene.forces},
        forces={n: law for n, law in laws.items() if n in original_scene.forces},
        keep_joints="analysis" in result.settings,
    )
    system, start = assemble(system)
    v = _columns_by_name(
        result.velocities, result.velocity_names, velocity_names(system)
    )
    if np.isnan(v).any():
        raise _mismatch_error("velocities")
    z = _columns_by_name(
        result.positions, result.position_names, position_names(system)
    )
    first_rotation = z.shape[1] - system.n_rotation_counters
    if np.isnan(z[:, :first_rotation]).any():
        raise _mismatch_error("positions")
    if np.isnan(z).any() and len(z):
        _count_rotations(system, result.t, z, v)
    forces_known = not missing_laws(original_scene, laws) and not sampled_laws(
        original_scene, laws
    )
    system = with_friction_states(with_prescribed_friction(system, start))
    return Replay(system, result.t, z, v, forces_known)


def scene_of(result: Result) -> SceneFile:
    """The scene that a result was made with.

    Raises
    ------
    InputError
        The result holds none.
    """
    if not result.scene:
        raise InputError("holds no scene", expected="a result of a simulation")
    return validate_data(
        json.loads(result.scene), SceneFile, source="scene of the result"
    )


def _scene_with_outputs(
    result: Result, names: tuple[str, ...], laws: GivenFunctions, between: bool
) -> SceneFile:
    """The scene with these outputs, without events and without lost laws.

    Forces and drives whose laws are lost are left out; without names there are no
    outputs.
    """
    scene = scene_of(result)
    missing = [name for name in scene.flexible if name not in result.sids]
    if missing:
        raise InputError(
            f"holds no SID of {', '.join(missing)}",
            expected="a result of this version of sidtool; simulate again",
        )
    record = expand_names(names, scene, result.sids)
    for name, (why, expected) in unavailable_outputs(
        record, scene, laws, between
    ).items():
        raise InputError(f"{name} {why}", expected=expected)
    content: dict[str, Any] = json.loads(result.scene)
    content.pop("events", None)
    for name in missing_laws(scene, laws):
        if name in scene.drives:
            del content["drives"][name]
        else:  # other laws may read its length
            content["forces"][name]["function"] = {"type": "constant", "value": 0.0}
    content["outputs"] = {"record": list(record)}
    if scene.initial.state == "static":  # the states of the result take its place
        content["initial"] = {}
    try:
        return validate_data(content, SceneFile, source="scene of the result")
    except InputError as error:
        if not (error.place or "").startswith("outputs."):
            raise
        # Requested by name: not a mistake of the scene.
        raise InputError(error.problem, expected=error.expected) from None


def _columns_by_name(
    table: Array, known: tuple[str, ...], names: tuple[str, ...]
) -> Array:
    """Columns by name, those that are not known as NaN."""
    columns = {name: i for i, name in enumerate(known)}
    found = np.full((len(table), len(names)), np.nan)
    for column, name in enumerate(names):
        if name in columns:
            found[:, column] = table[:, columns[name]]
    return found


def _count_rotations(system: System, t: Array, z: Array, v: Array) -> None:
    """Fills in angles that were not counted in the run, each from the one before.

    Raises
    ------
    InputError
        One turns too far between two times.
    """
    work, n = new_work_arrays(system), system.n_rotation_counters
    is_missing = np.isnan(z[:, z.shape[1] - n :]).any(axis=0)
    before = initial_rotations(system)
    for k, clock in enumerate(system.clocks(t)):
        part = z[k, z.shape[1] - n :]
        part[is_missing] = before[is_missing]
        work.interval_time[0] = clock
        work_arrays.evaluate(system, work, t[k], z[k], v[k])
        store_rotations(system, work, z[k])
        step = t[k] - t[k - 1] if k else 0.0
        change = np.maximum(
            np.abs(part - before) if k else 0.0,
            step * np.abs(work.rotation_counter[:n, at.ROTATION_RATE]),
        )
        if (change[is_missing] > MAX_ROTATION).any():
            raise InputError(
                f"a joint turns by more than a quarter between output times at "
                f"t = {t[k]:.6g} s, where its angle cannot be counted afterwards",
                expected="a smaller output_step, or the angle recorded in the run",
            )
        before = part.copy()


def _mismatch_error(what: str) -> InputError:
    return InputError(
        f"its {what} are not those of its scene",
        expected="a result of this version of sidtool",
    )
