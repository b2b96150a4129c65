"""State space of a linearised mechanism between its inputs and its outputs.

The small motions (y, w) of `state_matrix`, eq. (23), are written in independent
coordinates p and their velocities, with the states of control laws as states:

    x' = A x + B u,   y = C x + D u.

The second-order form follows by eliminating the velocities. Derivatives are central
differences of the complete equations, as for natural modes: the Newton matrices of a
run leave terms out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import (
    Diagnostic,
    WithDiagnostics,
    diagnose,
    without,
)
from sidtool.formats.scene import INPUTS, parse_output, unit_of

from ..diagnostics.body_loads import find_state_warnings
from ..output.columns import multiplier_names
from ..output.energies import INTEGRATED
from ..system.errors import SimulationError
from ..system.system import System
from .dense_equations import DenseEquations
from .frozen_inputs import state_entries, with_polynomial_inputs
from .joint_friction import equations_at
from .linearisation import steady_residual, unsteady_notes
from .operating_point import operating_point
from .output_derivatives import INPUT_PERTURBATION, OutputEvaluation
from .reference_axes import body_axes
from .state_coordinates import choose_coordinates, coordinate_names
from .state_matrix import (
    ROTATION_ROUNDING,
    TEST_ANGLE,
    LinearEquations,
    SmallMotions,
    Sources,
    SteadyAxes,
    linear_equations,
    shared_steady_axes,
    small_motions,
    state_matrix,
    steady_axes,
    steady_motion,
    turned_states,
)

#: What the name of an input of the scene gets as its derivative, by the order.
DERIVATIVE_NAMES = ("", ".rate", ".acceleration")
#: Responses that change by a smaller part are constant; responses below this part of
#: the largest in the same unit are rounding.
EQUAL_RESPONSE, ROUNDED_RESPONSE = 1e-3, 1e-7
#: What is expected where a scene has no inputs.
NO_INPUTS = "a table [inputs.NAME] in the scene, and a force or a drive that takes it"
_SQUARED = "\N{SUPERSCRIPT TWO}"


@dataclass(frozen=True, eq=False)
class SecondOrderForm:
    """M p'' + C p' + K p = B u, y = F p + G p' + D u.

    Attributes
    ----------
    M, C, K : (n, n)
        Mass, damping with gyroscopic terms, stiffness. They need not be symmetric: with
        control laws, friction or rotation they are not.
    B : (n, inputs)
    F, G : (outputs, n)
        Outputs of positions and of velocities; those of accelerations follow from the
        equation and are in all of F, G and D.
    D : (outputs, inputs)
    names, units : (n,)
        Of p: independent coordinates, then the integrals of the states of control laws.
    """

    M: Array
    C: Array
    K: Array
    B: Array
    F: Array
    G: Array
    D: Array
    names: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class DescriptorForm:
    """E x' = A x + B u, y = C x + D u with all coordinates and the multipliers.

    Attributes
    ----------
    E, A : (n, n)
    B : (n, inputs)
    C : (outputs, n)
    D : (outputs, inputs)
    names, units : (n,)
        Of x: displacements, velocities, multipliers. Redundant constraints leave their
        multipliers undetermined: the pencil is singular then.
    """

    E: Array
    A: Array
    B: Array
    C: Array
    D: Array
    names: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class StateSpace(WithDiagnostics):
    """A mechanism linearised between inputs and outputs: x' = A x + B u, y = C x + D u.

    x, u and y are changes from the operating point, in SI units.

    Attributes
    ----------
    A : (n, n)
    B : (n, inputs)
    C : (outputs, n)
    D : (outputs, inputs)
    state_names, state_units : (n,)
        Of x: independent displacements, their velocities and states of control laws.
        Displacements of frames are along and about the axes of the body.
    input_names, input_units : (inputs,)
    output_names, output_units : (outputs,)
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
    mechanics = equations_at(system, t, z, v)
    mechanics.set_scale(z, stiffness=0.0)
    axes = steady_axes(mechanics, z, v)
    small = state_matrix(mechanics, z, v, axes.omegas)
    causes = unsteady_notes(mechanics, small)
    causes = causes or ((axes.changing,) if axes.changing else ())
    at_rest = about == "static" and state is None and not causes
    chosen = _Linearised(
        mechanics, z, v, axes.omegas, names, coefficients, at_rest=at_rest
    )
    changes = np.zeros(len(chosen.evaluation.names))
    if not causes:
        chosen, axes, changes = _in_steady_axes(chosen, axes)
    equations, effects = chosen.equations, chosen.effects
    evaluation, form = chosen.evaluation, chosen.form
    residual = steady_residual(mechanics, chosen.small)
    second = form.second_order()
    if descriptor:
        _refuse_prescribing(effects)
    found = (
        *find_state_warnings(system, z[None]),
        *point.diagnostics,
        *((diagnose("N715"), *causes) if causes else ()),
        *axes.diagnostics,
        *_change_notes(evaluation.names, changes),
        *mechanics.notes(),
        *point.law_diagnostics,
        *(_derivative_note(effect) for effect in effects if effect.order),
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
        input_units=tuple(_input_unit(system, e) for e in effects),
        output_names=evaluation.names,
        output_units=tuple(unit_of(name, scene) for name in evaluation.names),
        second_order=second,
        descriptor=_descriptor_form(evaluation, equations, effects)
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
    names = [parse_output(text) for text in outputs.record]
    is_integral = [n.owner == "energy" and n.quantity in INTEGRATED for n in names]
    if not any(is_integral):
        return system, ()
    pairs = [*zip(outputs.record, is_integral, strict=True)]
    record = tuple(text for text, integral in pairs if not integral)
    changed = outputs.model_copy(update={"record": record})
    scene = system.scene.model_copy(update={"outputs": changed})
    left = tuple(text for text, integral in pairs if integral)
    return replace(system, scene=scene), left


class _Linearised:
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
            _input_effects(self.evaluation, self.equations, name, coefficients[name])
            for name in names
        ]
        self.form = _FirstOrderForm(
            self.evaluation, self.equations, self.small, self.effects
        )

    def in_axes(self, omegas: Array) -> _Linearised:
        """The same in other axes."""
        return _Linearised(
            self.mechanics, self.z, self.v, omegas, self.names, self.coefficients
        )

    def after(self, dt: float) -> tuple[_Linearised, Array]:
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
            there = _Linearised(
                mechanics, z, v, self.omegas, self.names, self.coefficients
            )
        finally:
            mechanics.t = start
            numbers[origins] = start
        X = turned_states(
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
        names, form = self.evaluation.names, self.form
        try:
            there, X = self.after(TEST_ANGLE / spin)
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


def _in_steady_axes(
    found: _Linearised, axes: SteadyAxes
) -> tuple[_Linearised, SteadyAxes, Array]:
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


def _change_notes(names: Sequence[str], changes: Array) -> Iterator[Diagnostic]:
    """Outputs whose response changes as the bodies turn (N726)."""
    changing = changes > EQUAL_RESPONSE
    if changing.any():
        listed = ", ".join(n for n, found in zip(names, changing, strict=True) if found)
        yield diagnose("N726", listed, change=float(min(changes.max(), 1.0)))


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


@dataclass(frozen=True, eq=False)
class _InputEffects:
    """Effects of an input and of its first two derivatives, scaled.

    Attributes
    ----------
    order
        Highest derivative with an effect: that is the input, the others are states.
    value
        Of that derivative at the operating point.
    displacements, velocities : (n, 3)
        Changes of the state that constraints demand.
    position_rates, velocity_rates : (y, 3) and (w, 3)
        Changes of the rates of (y, w).
    force, closure : (n,) and (rows,)
        Direct changes of the forces and of the constraints by the input itself.
    outputs : (outputs, 3)
        Changes of the outputs.
    """

    name: str
    order: int
    value: float
    displacements: Array
    velocities: Array
    position_rates: Array
    velocity_rates: Array
    force: Array
    closure: Array
    outputs: Array

    def column(self, order: int, n_positions: int) -> Array:
        """Changes of positions, velocities, rates of (y, w) and outputs, in one."""
        rates = self.position_rates[:n_positions, order], self.velocity_rates[:, order]
        states = self.displacements[:, order], self.velocities[:, order]
        return np.concatenate([*states, *rates, self.outputs[:, order]])


def _input_effects(
    evaluation: OutputEvaluation,
    equations: LinearEquations,
    name: str,
    coefficients: slice,
) -> _InputEffects:
    """Effects of an input, by differences of the equations at fixed a and lambda.

    What an input does not change is equal to the last bit, as its polynomial is about
    the time of the state. The rate of an input that is held is zero.
    """
    mechanics = evaluation.mechanics
    numbers = mechanics.system.arrays.real_data
    continuity = mechanics.system.scene.inputs[name].continuity
    changes, order = [], 0
    for k, factor in enumerate(_COEFFICIENTS):
        change = _equation_changes(evaluation, equations, coefficients.start + k)
        is_used = k <= continuity
        if is_used and any(part.any() for part in change):
            order = k
        changes.append([factor * is_used * part for part in change])
    force, closure, rate, gamma = (
        np.column_stack(part) for part in zip(*changes, strict=True)
    )
    displacements = equations.particular(-closure)
    free, by = np.zeros_like(displacements), Sources(force, rate, gamma)
    found = equations.responses(mechanics, displacements, free, by)
    outputs = np.zeros((len(evaluation.names), len(_COEFFICIENTS)))
    for k, factor in enumerate(_COEFFICIENTS[: order + 1]):
        number = coefficients.start + k
        outputs[:, k] = evaluation.by_input(number, factor, found, k)
    return _InputEffects(
        name,
        order,
        float(numbers[coefficients.start + order] / _COEFFICIENTS[order]),
        displacements,
        found.velocities,
        found.position_rates,
        found.velocity_rates,
        force[:, 0],
        closure[:, 0],
        outputs,
    )


#: Coefficients of the polynomial of an input, by its value and its derivatives.
_COEFFICIENTS = (1.0, 1.0, 0.5)


def _equation_changes(
    evaluation: OutputEvaluation, equations: LinearEquations, k: int
) -> list[Array]:
    """Derivatives of f + C^T lambda - M a, and of the constraints their values, rates
    and gamma - C a, by a number of the real data."""
    mechanics = evaluation.mechanics
    numbers = mechanics.system.arrays.real_data
    a, multipliers = equations.accelerations, equations.multipliers
    given = float(numbers[k])
    delta, ends = INPUT_PERTURBATION * max(abs(given), 1.0), []
    try:
        for sign in (1.0, -1.0):
            numbers[k] = given + sign * delta
            mechanics.evaluate(evaluation.z, evaluation.v)
            C, force = mechanics.jacobian, mechanics.force
            residual = np.zeros(len(C))
            residual[: len(mechanics.residual)] = mechanics.residual
            ends.append(
                (
                    force + C.T @ multipliers - mechanics.mass @ a,
                    residual,
                    mechanics.constraint_rates,
                    mechanics.gamma - C @ a,
                )
            )
    finally:
        numbers[k] = given
        mechanics.evaluate(evaluation.z, evaluation.v)
    plus, minus = ends
    return [(p - m) / (2.0 * delta) for p, m in zip(plus, minus, strict=True)]


def _derivative_note(effects: _InputEffects) -> Diagnostic:
    """An input whose derivative stands in its place (N725)."""
    derivative = ("value", "rate", "second derivative")[effects.order]
    return diagnose("N725", f"inputs.{effects.name}", derivative=derivative)


def _input_unit(system: System, effects: _InputEffects) -> str:
    unit = unit_of(f"{INPUTS}.{effects.name}", system.scene)
    if effects.order == 0 or not unit:
        return unit
    if effects.order == 1 and unit.endswith("/s"):
        return unit + _SQUARED
    return unit + ("", "/s", f"/s{_SQUARED}")[effects.order]


def _refuse_prescribing(effects: Sequence[_InputEffects]) -> None:
    for effect in effects:
        if effect.order:
            raise InputError(
                f"the descriptor form has no derivatives of the input {effect.name}",
                place="descriptor",
                expected="inputs of forces or accelerations",
            )


class _FirstOrderForm:
    """A, B, C, D in independent coordinates.

    The raw state is (y, inputs that prescribe a motion; w of y, rates of these inputs,
    states of laws, inputs of which the rate has an effect). A matrix maps it to the
    states with names, which are changes of positions and velocities.
    """

    def __init__(
        self,
        evaluation: OutputEvaluation,
        equations: LinearEquations,
        small: SmallMotions,
        effects: Sequence[_InputEffects],
    ) -> None:
        self.system, scale = evaluation.system, evaluation.mechanics.scale
        self.equations, self.scale = equations, scale
        n, n_y = len(scale), equations.n_positions
        second = [effect for effect in effects if effect.order == 2]
        first = [effect for effect in effects if effect.order == 1]
        X, V = small.position_directions, small.velocity_directions
        outputs = evaluation.by_states(small.changes)
        columns = np.vstack([X, V, small.matrix, outputs])

        def of_inputs(selected: Sequence[_InputEffects], order: int) -> Array:
            """Columns of a derivative of inputs, as those of the small motions."""
            found = [effect.column(order, n_y) for effect in selected]
            return np.column_stack([np.zeros((len(columns), 0)), *found])

        parts = (
            columns[:, :n_y],
            of_inputs(second, 0),
            columns[:, n_y : 2 * n_y],
            of_inputs(second, 1),
            columns[:, 2 * n_y :],
            of_inputs(first, 0),
        )
        counts = [part.shape[1] for part in parts]
        ends = np.cumsum(counts)
        raw, size = np.hstack(parts), int(ends[-1])
        self.n_positions = int(ends[1])
        self.raw_rows = [*range(ends[0]), *range(ends[1], ends[2])]
        self.raw_rows += range(ends[3], ends[4])
        # rates of the raw state, its own and by the inputs
        A, B = np.zeros((size, size)), np.zeros((size, len(effects)))
        A[self.raw_rows] = raw[2 * n : 2 * n + len(small.matrix)]
        A[ends[0] : ends[1], ends[2] : ends[3]] = np.eye(len(second))
        by_inputs = np.column_stack(
            [np.zeros((len(columns), 0))]
            + [effect.column(effect.order, n_y) for effect in effects]
        )
        B[self.raw_rows] = by_inputs[2 * n : 2 * n + len(small.matrix)]
        self.input_rows = {
            effects.index(effect): row
            for rows, selected in (
                (range(ends[2], ends[3]), second),
                (range(ends[4], ends[5]), first),
            )
            for row, effect in zip(rows, selected, strict=True)
        }
        for k, row in self.input_rows.items():
            B[row, k] = 1.0
        self._set_coordinates(raw[:n], raw[n : 2 * n], ends, second, first)
        inverse = np.linalg.inv(self.coordinates)
        self.A = self.coordinates @ A @ inverse
        self.B = self.coordinates @ B
        self.C = raw[2 * n + len(small.matrix) :] @ inverse
        self.D = by_inputs[2 * n + len(small.matrix) :]
        self.effects = effects

    def _set_coordinates(
        self,
        X: Array,
        V: Array,
        ends: Array,
        second: Sequence[_InputEffects],
        first: Sequence[_InputEffects],
    ) -> None:
        """Choose the states, with names and units.

        Parameters
        ----------
        X, V : (n, states)
            Changes of positions and of velocities by the raw state.
        ends
            Of the parts of the raw state.
        """
        directions = self.equations.free_directions[:, : ends[0]]
        rows = choose_coordinates(self.system, directions, self.equations.rows)
        states = state_entries(self.system)[1]
        unit = np.eye(int(ends[-1]))
        scale = self.scale[:, None]
        self.coordinates = np.vstack(
            [
                (scale * X)[rows],
                unit[ends[0] : ends[1]],
                (scale * V)[rows],
                unit[ends[2] : ends[3]],
                (scale * V)[states],
                unit[ends[4] :],
            ]
        )
        known = coordinate_names(self.system)
        of_second = [f"{INPUTS}.{effect.name}" for effect in second]
        of_first = [f"{INPUTS}.{effect.name}" for effect in first]
        units = [unit_of(name, self.system.scene) for name in of_second]
        self.state_names = (
            *(known.displacements[row] for row in rows),
            *of_second,
            *(known.velocities[row] for row in rows),
            *(f"{name}{DERIVATIVE_NAMES[1]}" for name in of_second),
            *(known.velocities[row] for row in states),
            *of_first,
        )
        self.state_units = (
            *(known.displacement_units[row] for row in rows),
            *units,
            *(known.velocity_units[row] for row in rows),
            *(f"{unit}/s" if unit else "" for unit in units),
            *(known.velocity_units[row] for row in states),
            *(unit_of(name, self.system.scene) for name in of_first),
        )
        inverse = np.linalg.inv(self.scale[rows, None] * directions[rows])
        mechanical = inverse.T @ directions.T @ self.equations.mass @ directions
        others = len(self.coordinates) - self.n_positions - len(rows)
        self.mass = block_diag(mechanical @ inverse, np.eye(others))

    def state_rates(self, residual: Array) -> Array:
        """Rates (n,) of the states at the operating point, of those of (y, w)."""
        raw = np.zeros(len(self.A))
        raw[self.raw_rows] = residual
        for k, row in self.input_rows.items():
            raw[row] = self.effects[k].value
        return np.asarray(self.coordinates @ raw)

    def second_order(self) -> SecondOrderForm:
        """Eliminate the velocities; states without positions stand for rates."""
        n, size = self.n_positions, len(self.A) - self.n_positions
        more = size - n
        A11 = block_diag(self.A[:n, :n], np.zeros((more, more)))
        A12 = np.vstack([self.A[:n, n:], np.eye(size)[n:]])
        A21 = np.hstack([self.A[n:, :n], np.zeros((size, more))])
        A22, M = self.A[n:, n:], self.mass
        outputs = np.hstack([self.C[:, :n], np.zeros((len(self.C), more))])
        by_rates = np.linalg.inv(A12)
        G = self.C[:, n:] @ by_rates
        integrals = tuple(f"{name} (integral)" for name in self.state_names[2 * n :])
        units = tuple(f"{unit} s".strip() for unit in self.state_units[2 * n :])
        return SecondOrderForm(
            M=M,
            C=-M @ (A11 + A12 @ A22 @ by_rates),
            K=-M @ A12 @ (A21 - A22 @ by_rates @ A11),
            B=M @ A12 @ self.B[n:],
            F=outputs - G @ A11,
            G=G,
            D=self.D,
            names=self.state_names[:n] + integrals,
            units=self.state_units[:n] + units,
        )


def _descriptor_form(
    evaluation: OutputEvaluation,
    equations: LinearEquations,
    effects: Sequence[_InputEffects],
) -> DescriptorForm:
    """All coordinates and multipliers, without the displacements of states of laws."""
    mechanics = evaluation.mechanics
    system, scale = mechanics.system, mechanics.scale
    if len(getattr(mechanics, "sliding_joints", ())):
        raise InputError(
            "the descriptor form has no friction of sliding joints",
            place="descriptor",
            expected="a state in which no joint with friction slides",
        )
    n, C = len(scale), equations.jacobian / scale
    positions = np.setdiff1d(np.arange(n), state_entries(system)[1])
    rows, n_z = len(C), len(positions)
    by_z, by_v = equations.by_position, equations.by_velocity
    ones, zeros = np.eye(n)[:, positions], np.zeros((n, n_z))
    outputs = np.hstack(
        [
            evaluation.by_coordinates(ones, zeros) / scale[positions],
            evaluation.by_coordinates(np.zeros((n, n)), np.eye(n)) / scale,
            np.zeros((len(evaluation.names), rows)),
        ]
    )
    rates = scale[:, None] * equations.frame_rates / scale
    forces = [by.force / np.outer(scale, scale) for by in (by_z, by_v)]
    A = np.block(
        [
            [
                rates[np.ix_(positions, positions)],
                np.eye(n)[positions],
                np.zeros((n_z, rows)),
            ],
            [forces[0][:, positions], forces[1], C.T],
            [C[:, positions], by_v.value / scale, np.zeros((rows, rows))],
        ]
    )
    mass = equations.mass / np.outer(scale, scale)
    known = coordinate_names(system)
    units = ["N" for _ in range(rows)]
    names = [*multiplier_names(system)]
    units = [unit_of(name, system.scene) for name in names]
    for k in range(len(names), rows):
        names.append(f"sticking joint {k + 1 - system.n_rows}")
        units.append("")
    return DescriptorForm(
        E=block_diag(np.eye(n_z), mass, np.zeros((rows, rows))),
        A=A,
        B=np.column_stack(
            [np.zeros((len(A), 0))]
            + [
                np.concatenate([np.zeros(n_z), e.force / scale, e.closure])
                for e in effects
            ]
        ),
        C=outputs,
        D=np.column_stack(
            [np.zeros((len(outputs), 0))] + [e.outputs[:, 0] for e in effects]
        ),
        names=(
            *(known.displacements[k] for k in positions),
            *known.velocities,
            *names,
        ),
        units=(
            *(known.displacement_units[k] for k in positions),
            *known.velocity_units,
            *units,
        ),
    )
