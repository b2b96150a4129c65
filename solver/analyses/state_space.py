"""State space of a linearised mechanism between its inputs and its outputs.

The small motions (y, w) of `state_matrix`, eq. (23), are written in independent
coordinates p and their velocities, with the states of control laws as states:

    x' = A x + B u,   y = C x + D u.

The second-order form follows by eliminating the velocities. Derivatives are central
differences of the complete equations, as for natural modes: the Newton matrices of a
run leave terms out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import (
    Diagnostic,
    WithDiagnostics,
    diagnose,
    without,
)
from sidtool.formats.scene import INPUTS, unit_of

from ..diagnostics.body_loads import find_state_warnings
from ..output.energies import is_energy_integral
from ..system.errors import SimulationError
from ..system.system import System
from .frozen_inputs import with_polynomial_inputs
from .input_effects import (
    DERIVATIVE_NAMES,
    input_notes,
    input_unit,
    refuse_prescribed_motion,
)
from .linearisation import linearised_at, steady_residual
from .operating_point import operating_point
from .state_matrix import corner_notes
from .state_space_forms import (
    DescriptorForm,
    SecondOrderForm,
    descriptor_form,
)
from .steady_responses import (
    EQUAL_RESPONSE,
    LinearisedScene,
    in_steady_axes,
    response_change_notes,
)

#: What is expected where a scene has no inputs.
NO_INPUTS = "a table [inputs.NAME] in the scene, and a force or a drive that takes it"


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
        *corner_notes(mechanics, chosen.small),
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
