"""State space of a linearised mechanism between its inputs and its outputs.

The small motions (y, w) of `state_matrix`, eq. (23), are written in independent
coordinates p and their velocities, with the states of control laws as states:

    x' = A x + B u,   y = C x + D u.

The second-order form follows by eliminating the velocities. Derivatives are central
differences of the complete equations, as for natural modes: the Newton matrices of a
run leave terms out.

Axes in which a linearised scene, its inputs and its outputs are constant.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, WithDiagnostics, diagnose, without
from sidtool.formats.scene import INPUTS, unit_of

from ..diagnostics.body_loads import find_state_warnings
from ..output.energies import is_energy_integral
from ..system.errors import SimulationError
from ..system.system import System
from .dense_equations import DenseEquations
from .frozen_inputs import with_polynomial_inputs
from .input_effects import (
    DERIVATIVE_NAMES,
    input_effects,
    input_notes,
    input_unit,
    refuse_prescribed_motion,
)
from .linearisation import linearised_at, operating_point, steady_residual
from .output_derivatives import OutputEvaluation
from .reference_axes import axis_angular_velocities
from .state_derivatives import corner_notes
from .state_matrix import linear_equations, small_motions
from .state_space_forms import (
    DescriptorForm,
    FirstOrderForm,
    SecondOrderForm,
    descriptor_form,
)
from .steady_axes import (
    ROTATION_ROUNDING,
    SteadyAxes,
    body_axes_at,
    shared_steady_axes,
    steady_motion,
    turned_states,
    turning_times,
)

#: Responses that change by a smaller part are constant; responses below this part of
#: the largest in the same unit are rounding.
EQUAL_RESPONSE, ROUNDED_RESPONSE = 1e-3, 1e-7

#: What is expected where a scene has no inputs.
NO_INPUTS = "a table [inputs.NAME] in the scene, and a force or a drive that takes it"


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
        equations = linear_equations(mechanics, z, v, at_rest=at_rest)
        self.equations = equations.in_axes(mechanics, omegas)
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
    own = body_axes_at(mechanics, found.equations)
    spin = float(np.linalg.norm(own, axis=1).max(initial=0.0))
    time = mechanics.system.scene.time
    if spin * (time.end - time.start) < ROTATION_ROUNDING:
        return found, axes, np.zeros(len(found.evaluation.names))
    best, changes = found, found.response_changes(spin)
    others = shared_steady_axes(mechanics, found.equations, own)
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


@dataclass(frozen=True, eq=False)
class StateSpace(WithDiagnostics):
    """A mechanism linearised between inputs and outputs: x' = A x + B u, y = C x + D u.

    x, u and y are changes from the operating point, in SI units.

    Attributes
    ----------
    A : (n, n)
        Of the states in their rates.
    B : (n, inputs)
        Of the inputs in the rates.
    C : (outputs, n)
        Of the states in the outputs.
    D : (outputs, inputs)
        Of the inputs in the outputs.
    state_names, state_units : (n,)
        Of x: independent displacements, their velocities and states of control laws.
        Displacements of frames are along and about the axes of the body.
    input_names, input_units : (inputs,)
        Of u.
    output_names, output_units : (outputs,)
        Of y.
    second_order
        The same as M p'' + C p' + K p = B u.
    descriptor
        The same with all coordinates and multipliers, if requested.
    about
        "static", "start", or the time [s] of the state in a run.
    time
        Of the operating point [s].
    is_steady
        False where the equations are those of one instant of a motion that changes
        them: then they describe the motion for times that are short against it.
    state_rates : (n,)
        x' at the operating point, zero in a steady state.
    inputs : (inputs,)
        Values at the operating point.
    outputs : (outputs,)
        Likewise.
    positions, velocities
        z_I and z_II at the operating point.
    diagnostics
        What has to be known of it; `notes` and `warnings` give it as sentences.
    title
        Of the scene.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    state_names: tuple[str, ...]
    state_units: tuple[str, ...]
    input_names: tuple[str, ...]
    input_units: tuple[str, ...]
    output_names: tuple[str, ...]
    output_units: tuple[str, ...]
    second_order: SecondOrderForm
    descriptor: DescriptorForm | None
    about: str | float
    time: float
    is_steady: bool
    state_rates: Array
    inputs: Array
    outputs: Array
    positions: Array
    velocities: Array
    diagnostics: tuple[Diagnostic, ...] = ()
    title: str = ""

    @property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues (n,) of A [1/s], by growing size."""
        values = np.linalg.eigvals(self.A)
        return values[np.argsort(np.abs(values), kind="stable")]


def state_space(
    system: System,
    about: str = "static",
    state: tuple[Array, Array] | None = None,
    time: float | None = None,
    *,
    inputs: Sequence[str] | None = None,
    descriptor: bool = False,
) -> StateSpace:
    """Linearise a scene between its inputs and its recorded outputs.

    Parameters
    ----------
    about, state, time
        As of `operating_point`.
    inputs
        Names of inputs of the scene, default all.
    descriptor
        Also return the descriptor form.

    Raises
    ------
    InputError
        There is no such input or state; friction of a joint has no derivative; a
        descriptor form is requested of an input that prescribes a motion.
    SimulationError
        There is no static equilibrium, the state is a singular configuration, or its
        inertia is not positive; an output is not a number there.
    """
    names = _checked_inputs(system, inputs)
    system, integrals = _without_integrals(system)
    try:
        point = operating_point(system, about, state, time)
    except SimulationError as error:
        if about != "static" or state is not None:
            raise
        causes = diagnose("N727"), *error.diagnostics
        raise SimulationError(causes, error.result) from None
    z, v, t = point.z, point.v, point.t
    system, coefficients = with_polynomial_inputs(point.system, t)
    mechanics, axes, _, causes = linearised_at(system, t, z, v)
    at_rest = about == "static" and state is None and not causes
    chosen = LinearisedScene(
        mechanics, z, v, axes.omegas, names, coefficients, at_rest=at_rest
    )
    changes = np.zeros(len(chosen.evaluation.names))
    if not causes:
        chosen, axes, changes = in_steady_axes(chosen, axes)
    equations, effects = chosen.equations, chosen.effects
    evaluation, form = chosen.evaluation, chosen.form
    residual = steady_residual(mechanics, chosen.small)
    second = form.second_order()
    if descriptor:
        refuse_prescribed_motion(effects)
    found = (
        *find_state_warnings(system, z[None]),
        *point.diagnostics,
        *((diagnose("N715"), *causes) if causes else ()),
        *axes.diagnostics,
        *response_change_notes(evaluation.names, changes),
        *mechanics.notes(),
        *corner_notes(mechanics, chosen.small.z, chosen.small.v, chosen.small.corners),
        *point.law_diagnostics,
        *(note for effect in effects for note in input_notes(effect)),
        *((diagnose("N728", names=integrals),) if integrals else ()),
    )
    scene = system.scene
    return StateSpace(
        A=form.A,
        B=form.B,
        C=form.C,
        D=form.D,
        state_names=form.state_names,
        state_units=form.state_units,
        input_names=tuple(e.name + DERIVATIVE_NAMES[e.order] for e in effects),
        input_units=tuple(input_unit(system, e) for e in effects),
        output_names=evaluation.names,
        output_units=tuple(unit_of(name, scene) for name in evaluation.names),
        second_order=second,
        descriptor=descriptor_form(evaluation, equations, effects)
        if descriptor
        else None,
        about=about if state is None else t,
        time=t,
        is_steady=not causes and bool((changes <= EQUAL_RESPONSE).all()),
        state_rates=form.state_rates(residual),
        inputs=np.array([effect.value for effect in effects]),
        outputs=evaluation.values,
        positions=z,
        velocities=v,
        diagnostics=without(found, scene.diagnostics.ignore),
        title=scene.title,
    )


def _without_integrals(system: System) -> tuple[System, tuple[str, ...]]:
    """The system that records no integrals along a run, and their names."""
    outputs = system.scene.outputs
    integrals = tuple(filter(is_energy_integral, outputs.record))
    if not integrals:
        return system, ()
    record = tuple(name for name in outputs.record if name not in integrals)
    changed = outputs.model_copy(update={"record": record})
    scene = system.scene.model_copy(update={"outputs": changed})
    return replace(system, scene=scene), integrals


def _checked_inputs(system: System, names: Sequence[str] | None) -> tuple[str, ...]:
    known = tuple(system.input_rows)
    if names is None:
        return known
    plain = tuple(name.removeprefix(f"{INPUTS}.") for name in names)
    for name in plain:
        if name not in known:
            expected = f"one of {', '.join(known)}" if known else NO_INPUTS
            raise InputError(f"found {name!r}", place="inputs", expected=expected)
    return tuple(dict.fromkeys(plain))
