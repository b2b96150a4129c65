"""Kernels for callers in Python."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array

from ..equations import equations
from ..equations.drives import drive_values
from ..space.layout import Work
from .scene import System


def evaluate(system: System, work: Work, t: float, z: Array, v: Array) -> None:
    """M, f, C and the constraints of eq. (3) at one state, into `work`."""
    at = equations
    kernel = at.evaluate_in_plane if system.planar else at.evaluate_in_space
    kernel(system.arrays, work, t, z, v)
    go_on(system)


def go_on(system: System) -> None:
    """Raises what stopped a callable of a law while a kernel ran, as Ctrl-C does."""
    for native in system.natives:
        native.go_on()


def linearise(
    system: System, work: Work, t: float, z: Array, v: Array, acc: Array, lam: Array
) -> None:
    """Derivatives of eq. (3) at the state that was just evaluated, into `work`."""
    at = equations
    kernel = at.linearise_in_plane if system.planar else at.linearise_in_space
    kernel(system.arrays, work, t, z, v, acc, lam)


def complete(system: System, work: Work, acc: Array) -> None:
    """Adds what z_II' contributes to the accelerations in `work`."""
    at = equations
    kernel = at.complete_in_plane if system.planar else at.complete_in_space
    kernel(system.arrays, work, acc)


def function_history(system: System, row: int, clocks: Array, times: Array) -> Array:
    """Values and two derivatives (nt, 3) of a row of the table of functions.

    clocks : (nt,) times inside the smooth intervals that the times count to, see
        `System.clocks`
    """
    found = np.zeros((len(times), 3))
    clocks, times = np.ascontiguousarray(clocks), np.ascontiguousarray(times)
    drive_values(system.arrays, row, clocks, times, found)
    return found
