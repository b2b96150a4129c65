"""Axes in which a linearised scene, its inputs and its outputs are constant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import (
    Diagnostic,
    diagnose,
)
from sidtool.formats.scene import unit_of

from ..system.errors import SimulationError
from .dense_equations import DenseEquations
from .input_effects import (
    input_effects,
)
from .output_derivatives import OutputEvaluation
from .reference_axes import axis_angular_velocities, body_axes
from .state_matrix import linear_equations, small_motions
from .state_space_forms import FirstOrderForm
from .steady_axes import (
    ROTATION_ROUNDING,
    SteadyAxes,
    shared_steady_axes,
    steady_motion,
    turned_states,
    turning_times,
)

#: Responses that change by a smaller part are constant; responses below this part of
#: the largest in the same unit are rounding.
EQUAL_RESPONSE, ROUNDED_RESPONSE = 1e-3, 1e-7


class LinearisedScene:
    """The equations about a state, seen in axes with given spins."""

    def __init__(
        self,
        mechanics: DenseEquations,
        z: Array,
        v: Array,
        omegas: Array,
        names: Sequence[str],
        coefficients: Mapping[str, slice],
        *,
        at_rest: bool = False,
    ) -> None:
        self.mechanics, self.z, self.v, self.omegas = mechanics, z, v, omegas
        self.names, self.coefficients = names, coefficients
        self.equations = linear_equations(mechanics, z, v, omegas, at_rest=at_rest)
        self.small = small_motions(mechanics, self.equations)
        self.evaluation = OutputEvaluation(self.equations, mechanics)
        self.effects = [
            input_effects(self.evaluation, self.equations, name, coefficients[name])
            for name in names
        ]
        self.form = FirstOrderForm(
            self.evaluation, self.equations, self.small, self.effects
        )

    def in_axes(self, omegas: Array) -> LinearisedScene:
        """The same in other axes."""
        return LinearisedScene(
            self.mechanics, self.z, self.v, omegas, self.names, self.coefficients
        )

    def after(self, dt: float) -> tuple[LinearisedScene, Array]:
        """The equations after a steady motion of some time [s], and their states by
        those here."""
        mechanics, start = self.mechanics, self.mechanics.t
        numbers, scale = mechanics.system.arrays.real_data, mechanics.scale
        mechanics.evaluate(self.z, self.v)
        z, v, turned = steady_motion(mechanics, self.z, self.v, self.omegas, dt)
        origins = [self.coefficients[name].start - 1 for name in self.names]
        try:
            mechanics.t = start + dt
            numbers[origins] = mechanics.t
            there = LinearisedScene(
                mechanics, z, v, self.omegas, self.names, self.coefficients
            )
        finally:
            mechanics.t = start
            numbers[origins] = start
        X, _ = turned_states(
            mechanics,
            self.equations.free_directions,
            there.equations.free_directions,
            turned * scale / scale[:, None],
            self.equations.n_positions,
        )
        raw = np.eye(len(self.form.A))
        raw[np.ix_(self.form.raw_rows, self.form.raw_rows)] = X
        back = np.linalg.inv(self.form.coordinates)
        return there, there.form.coordinates @ raw @ back

    def response_changes(self, spin: float) -> Array:
        """Parts (outputs,) by which the responses to the inputs change as the bodies
        turn.

        Parameters
        ----------
        spin
            Of the fastest body [rad/s].
        """
        self.mechanics.evaluate(self.z, self.v)
        own = axis_angular_velocities(self.mechanics)
        changes = [
            self._changes_after(dt, spin) for dt in turning_times(own, self.omegas)
        ]
        return np.max(changes, axis=0)

    def _changes_after(self, dt: float, spin: float) -> Array:
        """The same by a motion of some time [s]."""
        names, form = self.evaluation.names, self.form
        try:
            there, X = self.after(dt)
        except SimulationError:
            return np.ones(len(names))
        if there.form.A.shape != form.A.shape:
            return np.ones(len(names))
        B_back, C_back = np.linalg.solve(X, there.form.B), there.form.C @ X
        sizes = np.abs(np.linalg.eigvals(form.A))
        sizes = sizes[sizes > EQUAL_RESPONSE * spin]
        change, largest = np.zeros((2, len(names)))
        lowest = float(sizes.min(initial=np.inf)) if len(sizes) else spin
        typical = float(np.median(sizes)) if len(sizes) else spin
        for omega in (0.37 * lowest, 1.7 * lowest, np.sqrt(lowest * typical)):
            inverse = np.linalg.inv(1j * omega * np.eye(len(form.A)) - form.A)
            here = form.C @ inverse @ form.B
            changes = np.hstack(
                [C_back @ inverse @ form.B - here, form.C @ inverse @ B_back - here]
            )
            change = np.maximum(change, np.abs(changes).max(axis=1, initial=0.0))
            largest = np.maximum(largest, np.abs(here).max(axis=1, initial=0.0))
        units = [unit_of(name, self.mechanics.system.scene) for name in names]
        for unit in {*units}:
            alike = np.array([other == unit for other in units])
            rounding = ROUNDED_RESPONSE * largest[alike].max()
            largest[alike] = np.maximum(largest[alike], rounding / EQUAL_RESPONSE)
        return change / np.maximum(largest, 1e-300)


def in_steady_axes(
    found: LinearisedScene, axes: SteadyAxes
) -> tuple[LinearisedScene, SteadyAxes, Array]:
    """The equations in axes in which inputs and outputs are constant, too.

    In the axes of a rotor its equations are constant, but a force in inertial axes
    turns in them. Axes are tried until the response of all outputs is constant.

    Returns
    -------
    equations, axes
        In which responses change least.
    changes : (outputs,)
        Parts by which they change.
    """
    mechanics, z, v = found.mechanics, found.z, found.v
    mechanics.evaluate(z, v)
    own = body_axes(mechanics, v / mechanics.scale, mechanics.accelerations()[0])
    spin = float(np.linalg.norm(own, axis=1).max(initial=0.0))
    time = mechanics.system.scene.time
    if spin * (time.end - time.start) < ROTATION_ROUNDING:
        return found, axes, np.zeros(len(found.evaluation.names))
    best, changes = found, found.response_changes(spin)
    others = shared_steady_axes(mechanics, z, v, own)
    while changes.max(initial=0.0) > EQUAL_RESPONSE:
        candidate = next(others, None)
        if candidate is None:
            break
        other = found.in_axes(candidate.omegas)
        remaining = other.response_changes(spin)
        if remaining.max(initial=0.0) < changes.max(initial=0.0):
            best, axes, changes = other, candidate, remaining
    mechanics.evaluate(z, v)
    return best, axes, changes


def response_change_notes(names: Sequence[str], changes: Array) -> Iterator[Diagnostic]:
    """Outputs whose response changes as the bodies turn (N726)."""
    changing = changes > EQUAL_RESPONSE
    if changing.any():
        listed = ", ".join(n for n, found in zip(names, changing, strict=True) if found)
        yield diagnose("N726", listed, change=float(min(changes.max(), 1.0)))
