"""Effects of the inputs of a scene on its linearised equations and outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import (
    Diagnostic,
    diagnose,
)
from sidtool.formats.scene import INPUTS, unit_of

from ..system.errors import SimulationError
from ..system.system import System
from .output_derivatives import (
    AGREEMENT,
    MAX_REFINEMENTS,
    REFINEMENT,
    OutputEvaluation,
)
from .state_matrix import (
    LinearEquations,
    Sources,
)

#: What the name of an input of the scene gets as its derivative, by the order.
DERIVATIVE_NAMES = ("", ".rate", ".acceleration")
#: Change of an input, relative to its value or to 1.
INPUT_PERTURBATION = 1e-3
_SQUARED = "\N{SUPERSCRIPT TWO}"


@dataclass(frozen=True, eq=False)
class InputEffects:
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


def input_effects(
    evaluation: OutputEvaluation,
    equations: LinearEquations,
    name: str,
    coefficients: slice,
) -> InputEffects:
    """Effects of an input, by differences of the equations at fixed a and lambda.

    What an input does not change is equal to the last bit, as its polynomial is about
    the time of the state. The rate of an input that is held is zero.
    """
    mechanics = evaluation.mechanics
    numbers = mechanics.system.arrays.real_data
    continuity = mechanics.system.scene.inputs[name].continuity
    changes, steps, order = [], list[float](), 0
    for k, factor in enumerate(_COEFFICIENTS):
        step, change = _equation_changes(evaluation, equations, coefficients.start + k)
        steps.append(step)
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
        outputs[:, k] = evaluation.by_input(number, factor, found, k, steps[k])
    return InputEffects(
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
) -> tuple[float, list[Array]]:
    """Derivatives of f + C^T lambda - M a, and of the constraints their values, rates
    and gamma - C a, by a number of the real data; and the step at which they agree
    best with those of the next shorter one."""
    mechanics = evaluation.mechanics
    numbers = mechanics.system.arrays.real_data
    a, multipliers = equations.accelerations, equations.multipliers
    given = float(numbers[k])

    def differences(step: float) -> list[Array]:
        ends = []
        for sign in (1.0, -1.0):
            numbers[k] = given + sign * step
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
        return [(p - m) / (2.0 * step) for p, m in zip(*ends, strict=True)]

    def first_differences(step: float) -> tuple[float, list[Array]]:
        """A step that no law is undefined within, as a root is below zero."""
        for _ in range(MAX_REFINEMENTS):
            try:
                return step, differences(step)
            except SimulationError:
                step /= REFINEMENT
        return step, differences(step)

    found: list[tuple[float, float, list[Array]]] = []
    try:
        step, coarse = first_differences(INPUT_PERTURBATION * max(abs(given), 1.0))
        for _ in range(MAX_REFINEMENTS):
            fine = differences(step / REFINEMENT)
            pairs = zip(fine, coarse, strict=True)
            error = max(np.abs(f - c).max(initial=0.0) for f, c in pairs)
            found.append((float(error), step, coarse))
            if error <= AGREEMENT * max(np.abs(c).max(initial=0.0) for c in coarse):
                break
            step, coarse = step / REFINEMENT, fine
    finally:
        numbers[k] = given
        mechanics.evaluate(evaluation.z, evaluation.v)
    _, step, best = min(found, key=itemgetter(0))
    return step, best


def derivative_note(effects: InputEffects) -> Diagnostic:
    """An input that is replaced by its derivative (N725)."""
    derivative = ("value", "rate", "second derivative")[effects.order]
    return diagnose("N725", f"inputs.{effects.name}", derivative=derivative)


def input_unit(system: System, effects: InputEffects) -> str:
    unit = unit_of(f"{INPUTS}.{effects.name}", system.scene)
    if effects.order == 0 or not unit:
        return unit
    if effects.order == 1 and unit.endswith("/s"):
        return unit + _SQUARED
    return unit + ("", "/s", f"/s{_SQUARED}")[effects.order]


def refuse_prescribed_motion(effects: Sequence[InputEffects]) -> None:
    for effect in effects:
        if effect.order:
            raise InputError(
                f"the descriptor form has no derivatives of the input {effect.name}",
                place="descriptor",
                expected="inputs of forces or accelerations",
            )
