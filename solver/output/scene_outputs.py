"""Outputs of the whole scene, and outputs that are not available afterwards."""

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    FRICTION_QUANTITIES,
    INPUTS,
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
from ..system.system import System
from . import energies
from .body_outputs import momentum_column
from .energies import EnergyIntegrals, is_energy_integral
from .evaluated_forces import EvaluatedForces
from .samples import Samples


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


_ACCELERATIONS = ("ax", "ay", "az")
#: What makes them available.
MUST_BE_RECORDED = "to be recorded in the run: outputs.record of the scene"


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
