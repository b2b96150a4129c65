"""How the energy of a flexible body is shared by its elastic coordinates."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import SID, Array

from ..recording.energies import deformation_energies


class EnergyShares:
    """Parts of the elastic energy by coordinates, meant over the time so far.

    Between two states they go from one value to the other in a straight line.
    Coordinates count relative to the largest one so far, whose square may be no number.
    """

    def __init__(self, sid: SID) -> None:
        self._sid = sid
        self._sums = np.zeros(sid.nq)
        self._last: tuple[Array, Array] = np.zeros(0), np.zeros((0, sid.nq))
        self._largest = 0.0

    def add(self, times: Array, q: Array) -> None:
        """States (nt, nq) after those of the last call, in the order of time."""
        if not len(times):
            return
        self._scale(float(np.abs(q[np.isfinite(q)]).max(initial=0.0)))
        size = self._largest or 1.0
        energies = deformation_energies(self._sid, q / size, size)
        energies = np.where(np.isfinite(energies), energies, 0.0)
        times = np.concatenate([self._last[0], times])
        energies = np.concatenate([self._last[1], energies])
        self._sums += 0.5 * np.diff(times) @ (energies[1:] + energies[:-1])
        self._last = times[-1:].copy(), energies[-1:].copy()

    def parts(self) -> Array:
        """(nq,), their sum is one; of the last state if there is no other time."""
        sums = self._sums if self._sums.any() else self._last[1].sum(axis=0)
        return np.asarray(sums / (sums.sum() or 1.0))

    def _scale(self, largest: float) -> None:
        if largest > self._largest:
            factor = (self._largest / largest) ** 2
            self._sums, self._largest = factor * self._sums, largest
            self._last = self._last[0], factor * self._last[1]
