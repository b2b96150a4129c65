"""Effects of the inputs of a scene on its linearised equations and outputs."""

from collections.abc import Iterator, Sequence
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
from .power_laws import POWER_LAW, limits, power_law_limit
from .state_derivatives import CORNER, CORNER_ROUNDING
from .state_matrix import LinearEquations, Sources

#: What the name of an input of the scene gets as its derivative, by the order.
DERIVATIVE_NAMES = ("", ".rate", ".acceleration")
#: Change of an input, relative to its value or to 1.
INPUT_PERTURBATION = 1e-3
_SQUARED = "\N{SUPERSCRIPT TWO}"

#: Coefficients of the polynomial of an input, by its value and its derivatives.
_COEFFICIENTS = (1.0, 1.0, 0.5)


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
    has_corner
        Whether a force has a corner or a jump at the value.
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
    has_corner: bool

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
    changes, steps, order, has_corner = [], list[list[float]](), 0, False
    for k, factor in enumerate(_COEFFICIENTS):
        number = coefficients.start + k
        own, change, is_corner = _equation_changes(evaluation, equations, number)
        steps.append(own)
        is_used = k <= continuity
        has_corner |= is_used and is_corner
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
        has_corner,
    )


def _equation_changes(
    evaluation: OutputEvaluation, equations: LinearEquations, k: int
) -> tuple[list[float], list[Array], bool]:
    """Derivatives of f + C^T lambda - M a, and of the constraints their values, rates
    and gamma - C a, by a number of the real data; before them the step at which they
    agree best with those of the next shorter one, or all steps of a power law, behind
    them whether forces have a corner or a jump."""
    mechanics = evaluation.mechanics
    numbers = mechanics.system.arrays.real_data
    a, multipliers = equations.accelerations, equations.multipliers
    given = float(numbers[k])
    z, v = evaluation.z, evaluation.v
    size_of_forces = mechanics.force_size_in_motion(z, v)
    least = CORNER_ROUNDING * size_of_forces
    rounding = np.finfo(float).eps * size_of_forces
    middle = mechanics.force.copy()
    sizes, bends = list[float](), list[float]()

    def differences(step: float) -> list[Array]:
        ends, forces = [], []
        for sign in (1.0, -1.0):
            numbers[k] = given + sign * step
            mechanics.evaluate(evaluation.z, evaluation.v)
            C, force = mechanics.jacobian, mechanics.force.copy()
            forces.append(force)
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
        bend = np.abs(sum(forces) - 2.0 * middle).max(initial=0.0)
        bends.append(float(bend) / step if bend > least else 0.0)
        size = float(np.abs(forces[0] - forces[1]).max(initial=0.0))
        sizes.append(size / step if size > least else 0.0)
        return [(p - m) / (2.0 * step) for p, m in zip(*ends, strict=True)]

    def first_differences(step: float) -> tuple[float, list[Array]]:
        """A step that no law is undefined within, as a root is below zero."""
        for _ in range(MAX_REFINEMENTS):
            try:
                return step, differences(step)
            except SimulationError:
                step /= REFINEMENT
        return step, differences(step)

    def is_rounded(step: float, change: list[Array]) -> bool:
        """Whether rounding of all forces hides digits of a change of them."""
        size = np.abs(change[0]).max(initial=0.0)
        return bool(0.0 < AGREEMENT * size < rounding / step)

    found: list[tuple[float, float, list[Array]]] = []
    agrees = acts = False
    try:
        step, coarse = first_differences(INPUT_PERTURBATION * max(abs(given), 1.0))
        widened = 0
        while is_rounded(step, coarse) and widened < MAX_REFINEMENTS:
            try:
                step, coarse = REFINEMENT * step, differences(REFINEMENT * step)
            except SimulationError:
                break
            widened += 1
        del sizes[:-1], bends[:-1]
        for _ in range(MAX_REFINEMENTS + widened):
            acts |= bool(coarse[0].any())
            fine = differences(step / REFINEMENT)
            pairs = zip(fine, coarse, strict=True)
            error = max(np.abs(f - c).max(initial=0.0) for f, c in pairs)
            error += acts * rounding / step
            found.append((float(error), step, coarse))
            size = max(np.abs(c).max(initial=0.0) for c in coarse)
            agrees = error <= AGREEMENT * size
            if agrees:
                break
            step, coarse = step / REFINEMENT, fine
    finally:
        numbers[k] = given
        mechanics.evaluate(evaluation.z, evaluation.v)
    error, step, best = min(found, key=itemgetter(0))
    agrees |= bool(error < 4.0 * rounding / step)
    if len(bends) < POWER_LAW:
        bend = bends[-1] if bends[-1] > 0.5 * bends[0] else 0.0
    else:
        bend = float(limits([np.array(one) for one in bends])[0])
    is_bent = bend > CORNER * sizes[-1]
    if not agrees and not is_bent:
        force = power_law_limit([one[2][0] for one in found], best[0])
        if not np.array_equal(force, best[0]):
            return [one[1] for one in found], [force, *best[1:]], False
    jumps = not agrees and sizes[-1] > 2.0 * sizes[0]
    return [step], best, is_bent or jumps


def input_notes(effects: InputEffects) -> Iterator[Diagnostic]:
    """An input that is replaced by its derivative (N725), or at a corner (N745)."""
    if effects.order:
        derivative = ("value", "rate", "second derivative")[effects.order]
        yield diagnose("N725", f"inputs.{effects.name}", derivative=derivative)
    if effects.has_corner:
        yield diagnose("N745", f"inputs.{effects.name}")


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
