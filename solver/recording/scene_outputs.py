"""Outputs of the whole scene: energies, momenta, residuals of constraints."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..space.layout import Work
from ..system import kernel_calls
from ..system.scene import System
from . import energies
from .energy_history import History
from .momenta import momentum_column
from .sampling import Samples
from .told import Told


class SceneQuantities:
    """Columns of energies, momenta and residuals at the recorded times."""

    def __init__(
        self,
        system: System,
        work: Work,
        times: Array,
        samples: Samples,
        history: History | None,
        told: Told,
    ) -> None:
        self.system, self.work = system, work
        self.times, self.samples, self.history = times, samples, history
        self.told = told

    def column(self, owner: str, quantity: str) -> Array:
        """Values (nt,) of one of `sidtool.formats.scene.outputs.SCENE_QUANTITIES`."""
        if owner == "constraint":
            return self._residuals[quantity]
        if owner in ("momentum", "angular_momentum"):
            name = f"{owner}_{quantity}"
            return momentum_column(self.told, "", name)
        return getattr(self, quantity)  # type: ignore[no-any-return]

    @cached_property
    def kinetic(self) -> Array:
        return energies.kinetic(self.told)

    @cached_property
    def elastic(self) -> Array:
        return energies.elastic(self.told)

    @cached_property
    def potential(self) -> Array:
        return energies.potential(self.told)

    @property
    def dissipated(self) -> Array:
        return self._integrals[0]

    @property
    def supplied(self) -> Array:
        return self._integrals[1]

    @property
    def balance(self) -> Array:
        kept = self.kinetic + self.elastic + self.potential
        return kept + self.dissipated - self.supplied

    @cached_property
    def _integrals(self) -> tuple[Array, Array]:
        assert self.history is not None
        return self.history.until(self.times)

    @cached_property
    def _residuals(self) -> dict[str, Array]:
        """Largest |c| and |dc/dt|."""
        found = np.zeros((len(self.times), 2))
        clocks = self.system.clocks(self.times)
        for i, (t, clock) in enumerate(zip(self.times, clocks, strict=True)):
            self.work.clock[0] = clock
            z, v = self.samples.z[i], self.samples.v[i]
            kernel_calls.evaluate(self.system, self.work, t, z, v)
            rows = np.abs(self.work.row[:, [at.C_VALUE, at.C_RATE]])
            found[i] = rows.max(axis=0, initial=0.0)
        return {"position": found[:, 0], "velocity": found[:, 1]}
