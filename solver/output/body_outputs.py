"""Motion, momenta and stresses of bodies and markers at recorded states.

Planar scenes are embedded in the plane z = 0, so that all vectors have three
components.

Outputs of the whole scene, and outputs that are not available afterwards.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.base.stress import (
    node_stress,
    peak_stress,
    stress_nodes,
    stress_norm,
    von_mises,
)
from sidtool.formats.scene import (
    FRICTION_QUANTITIES,
    INPUTS,
    MOMENTA,
    PEAK_STRESS,
    STRESS_NORM,
    STRESSES,
    Given,
    OutputName,
    SceneFile,
    is_section_force,
    parse_output,
)
from sidtool.formats.scene.outputs import is_joint_output

from ..dynamics.drives import function_values
from ..spatial import system_arrays as at
from ..spatial.system_arrays import WorkArrays
from ..system import work_arrays
from ..system.rotated_markers import to_3d, to_rotation_matrices
from ..system.system import System
from . import energies
from .energies import EnergyIntegrals, elastic_coordinates, is_energy_integral
from .samples import EvaluatedForces, Samples

_ACCELERATIONS = ("ax", "ay", "az")
#: What makes them available.
MUST_BE_RECORDED = "to be recorded in the run: outputs.record of the scene"


@dataclass(frozen=True, eq=False)
class MarkerMotion:
    """Motion of a marker in inertial axes.

    Attributes
    ----------
    x, v, w : (nt, 3)
        Position, velocity and angular velocity.
    R : (nt, 3, 3)
        Orientation.
    angle
        Angle of a planar marker, counted over full turns [rad].
    """

    x: Array
    v: Array
    R: Array
    w: Array
    angle: Array


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Of a body frame: inertial position X, orientation R; body-resolved V and W."""

    X: Array
    R: Array
    V: Array
    W: Array


def marker_motion(system: System, samples: Samples, m: int) -> MarkerMotion:
    """Motion of the marker in row m of the marker table."""
    point = system.points(samples.points[:, m])
    if system.planar:
        angle = point["angle"]
        R = np.column_stack([np.cos(angle), np.sin(angle)])
    else:
        angle, R = np.full(len(point), np.nan), point["R"]
    x, v, w = (to_3d(point[part]) for part in "xvw")
    return MarkerMotion(x, v, to_rotation_matrices(R), w, angle)


def frame_motion(system: System, samples: Samples, b: int) -> FrameMotion:
    """Motion of the frame of the body in row b of the body table."""
    frame = system.frames(samples.frames[:, b])
    x, v, w = (to_3d(frame[part]) for part in "xvw")
    return FrameMotion(x, to_rotation_matrices(frame["R"]), v, w)


def position_in_body(system: System, samples: Samples, m: int) -> Array:
    """Body-resolved position of a marker on its deformed body, (nt, 3)."""
    return to_3d(system.points(samples.points[:, m])["d"])


def momentum_column(evaluated: EvaluatedForces, owner: str, quantity: str) -> Array:
    """One of `MOMENTA` of a body, or of all if the owner is empty, (nt,).

    Inertial components [kg m/s]; angular ones about the inertial origin [kg m2/s].
    """
    kind, axis = divmod(MOMENTA.index(quantity), 3)
    rows = [evaluated.system.index(owner)] if owner else slice(None)
    values = evaluated.bodies[("momentum", "angular")[kind]][:, rows, axis]
    return np.asarray(values.sum(axis=1))


def stress_column(system: System, samples: Samples, name: OutputName) -> Array:
    """BODY.MARKER.sigma_xx to .von_mises, or BODY.peak_von_mises and .norm_von_mises,
    (nt,) [Pa]."""
    b = system.index(name.owner)
    data = system.bodies[b]
    q, _ = elastic_coordinates(system, samples, b)
    if name.quantity == PEAK_STRESS:
        return peak_stress(data.sid, q)
    if name.quantity == STRESS_NORM:
        return stress_norm(data.sid, q)
    stress = node_stress(data.sid, data.node(name.marker).id, q)
    if name.quantity == STRESSES[-1]:
        return von_mises(stress)
    return stress[:, STRESSES.index(name.quantity)]


def check_stress(system: System, name: OutputName) -> None:
    """Refuse stresses that a SID does not hold.

    Raises
    ------
    InputError
        The body, or the node, has no stress rows.
    """
    data = system.bodies[system.index(name.owner)]
    known = stress_nodes(data.sid)
    place = f"outputs.record, {'.'.join(part for part in name if part)}"
    if not known:
        raise InputError(
            f"the SID of {name.owner} holds no stress",
            place=place,
            expected="a body converted with a table [stress]",
        )
    if name.marker and data.node(name.marker).sigma is None:
        more = ", ..." if len(known) > 8 else ""
        raise InputError(
            f"node {data.node(name.marker).id} of {name.owner} carries no stress",
            place=place,
            expected=f"a marker on one of the nodes {', '.join(known[:8])}{more}",
        )


class SceneOutputs:
    """Columns of energies, momenta and residuals at the recorded times."""

    def __init__(
        self,
        system: System,
        work: WorkArrays,
        times: Array,
        samples: Samples,
        history: EnergyIntegrals | None,
        evaluated: EvaluatedForces,
    ) -> None:
        self.system, self.work = system, work
        self.times, self.samples, self.history = times, samples, history
        self.evaluated = evaluated

    def column(self, owner: str, quantity: str) -> Array:
        """Values (nt,) of an input, or of one of
        `sidtool.formats.scene.outputs.SCENE_QUANTITIES`.
        """
        if owner == INPUTS:
            return self._input(quantity)
        if owner == "constraint":
            return self._residuals[quantity]
        if owner in ("momentum", "angular_momentum"):
            name = f"{owner}_{quantity}"
            return momentum_column(self.evaluated, "", name)
        return getattr(self, quantity)  # type: ignore[no-any-return]

    def _input(self, name: str) -> Array:
        """Values of an input of the scene, (nt,)."""
        values = np.zeros((len(self.times), 3))
        row, clocks = self.system.input_rows[name], self.system.clocks(self.times)
        function_values(self.system.arrays, row, clocks, self.times, values)
        return values[:, 0]

    @cached_property
    def kinetic(self) -> Array:
        return energies.kinetic_energy(self.evaluated)

    @cached_property
    def elastic(self) -> Array:
        return energies.elastic_energy(self.evaluated)

    @cached_property
    def potential(self) -> Array:
        return energies.potential_energy(self.evaluated)

    @property
    def dissipated(self) -> Array:
        return self._integrals[0]

    @property
    def supplied(self) -> Array:
        return self._integrals[1]

    @property
    def balance(self) -> Array:
        stored = self.kinetic + self.elastic + self.potential
        return stored + self.dissipated - self.supplied

    @cached_property
    def _integrals(self) -> tuple[Array, Array]:
        assert self.history is not None
        return self.history.integrals_until(self.times)

    @cached_property
    def _residuals(self) -> dict[str, Array]:
        """Largest |c| and |dc/dt|."""
        residuals = np.zeros((len(self.times), 2))
        clocks = self.system.clocks(self.times)
        for i, (t, clock) in enumerate(zip(self.times, clocks, strict=True)):
            self.work.interval_time[0] = clock
            z, v = self.samples.z[i], self.samples.v[i]
            work_arrays.evaluate(self.system, self.work, t, z, v)
            rows = np.abs(self.work.row[:, [at.C_VALUE, at.C_RATE]])
            residuals[i] = rows.max(axis=0, initial=0.0)
        return {"position": residuals[:, 0], "velocity": residuals[:, 1]}


def missing_laws(scene: SceneFile, known: Mapping[str, Any]) -> tuple[str, ...]:
    """Forces and drives whose law only the program of the run had.

    Parameters
    ----------
    known
        Laws of forces and drives that are there again.
    """
    return tuple(
        name
        for name, force in {**scene.drives, **scene.forces}.items()
        if isinstance(function := getattr(force, "function", None), Given)
        and not function.terms
        and name not in known
    )


def sampled_laws(scene: SceneFile, known: Mapping[str, Any]) -> tuple[str, ...]:
    """Forces and drives with a law that holds its value between samples."""
    owners = {**scene.drives, **scene.forces}
    laws = {n: getattr(f, "function", None) for n, f in owners.items()} | {**known}
    return tuple(n for n, law in laws.items() if getattr(law, "sample_time", None))


def unavailable_outputs(
    names: Iterable[str], scene: SceneFile, known: Mapping[str, Any], between: bool
) -> dict[str, tuple[str, str]]:
    """Of the names those that cannot be evaluated later: why, and what is expected.

    Parameters
    ----------
    known
        Laws of forces and drives that are there again.
    between
        At times between those of the result.
    """
    missing = missing_laws(scene, known)
    sampled = sampled_laws(scene, known) if between else ()
    unavailable: dict[str, tuple[str, str]] = {}
    for text in names:
        name = parse_output(text)
        if is_energy_integral(text):
            why = "is an integral along the steps of the run, which are not kept"
            unavailable[text] = why, MUST_BE_RECORDED
        elif missing and _depends_on(name, scene, missing):
            why = f"depends on the law of {', '.join(missing)}, which a program gave"
            unavailable[text] = (
                why,
                "it recorded in the run, or the law in `forces`, `drives`",
            )
        elif sampled and _depends_on(name, scene, sampled):
            laws = ", ".join(sampled)
            why = f"depends on what {laws} holds between samples, which is not kept"
            unavailable[text] = why, "the output times of the result"
    return unavailable


def _depends_on(name: OutputName, scene: SceneFile, forces: tuple[str, ...]) -> bool:
    """True if an output depends on forces: on accelerations, or on one of theirs."""
    quantity = name.quantity
    own = name.owner in scene.forces and name.owner not in scene.joints
    of_joint = is_joint_output(quantity) or quantity in FRICTION_QUANTITIES
    of_joint = of_joint or is_section_force(name)
    return name.owner in forces or quantity in _ACCELERATIONS or (of_joint and not own)
