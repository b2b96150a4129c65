"""First-order, second-order and descriptor form of a linearised scene.

Independent coordinates of a linearised mechanism: their choice, names and units.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, qr

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import INPUTS, unit_of

from ..output.columns import multiplier_names, velocity_names
from ..spatial import system_arrays as at
from ..system.system import System
from .frozen_inputs import state_entries
from .input_effects import DERIVATIVE_NAMES, InputEffects
from .output_derivatives import OutputEvaluation
from .state_matrix import LinearEquations, SmallMotions

#: Elastic coordinates are chosen before rotations, and these before displacements,
#: unless the others move so many times as much, in units of equal kinetic energy.
ELASTIC, ROTATION, TRANSLATION = 16.0, 4.0, 1.0
#: Of a displacement along an axis of the body, and about it, by the velocity.
_DISPLACEMENTS = {"v": "", "w": "rotation_"}


@dataclass(frozen=True)
class CoordinateNames:
    """Names and units of the n velocity coordinates and of their displacements."""

    displacements: tuple[str, ...]
    displacement_units: tuple[str, ...]
    velocities: tuple[str, ...]
    velocity_units: tuple[str, ...]


def coordinate_names(system: System) -> CoordinateNames:
    """Return names and units of the coordinates of a linearised mechanism.

    Displacements of frames are those along and about the axes of the body, such as
    `arm.x_body` and `arm.rotation_z_body`.
    """
    velocities = velocity_names(system)
    names, units, velocity_units = [], [], []
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        first, end = int(row[at.VEL]), int(row[at.VEL] + row[at.NV])
        for k in range(first, end):
            owner, _, quantity = velocities[k].rpartition(".")
            rate = unit_of(velocities[k], system.scene)
            if not data.is_scene_body:
                names.append(f"{velocities[k]} (integral)")
                units.append(f"{rate} s".strip())
            elif k < first + int(row[at.RD]):
                prefix = _DISPLACEMENTS[quantity[0]]
                names.append(f"{owner}.{prefix}{quantity[1:]}")
                units.append("rad" if prefix else "m")
            else:
                names.append(f"{owner}.{quantity[1:]}")
                units.append("")
            velocity_units.append(rate)
    return CoordinateNames(
        tuple(names), tuple(units), tuple(velocities), tuple(velocity_units)
    )


def choose_coordinates(
    system: System, directions: Array, candidates: Array
) -> Sequence[int]:
    """Choose independent coordinates among the rows of a basis of free directions.

    Parameters
    ----------
    directions : (n, d)
        Scaled free directions.
    candidates : (n,)
        True for the rows that can be chosen.

    Returns
    -------
    rows
        d row numbers, growing; the d x d part of the basis in them is well conditioned.
    """
    weights = np.full(len(directions), ELASTIC)
    for row in system.arrays.body:
        u, rd = int(row[at.VEL]), int(row[at.RD])
        translations = min(rd, 2 if system.planar else 3)
        weights[u : u + rd] = ROTATION
        weights[u : u + translations] = TRANSLATION
    weights = np.where(candidates, weights, 0.0)
    count = directions.shape[1]
    if not count:
        return []
    _, _, order = qr((directions * weights[:, None]).T, mode="economic", pivoting=True)
    return sorted(int(k) for k in order[:count])


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


class FirstOrderForm:
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
        effects: Sequence[InputEffects],
    ) -> None:
        self.system, scale = evaluation.system, evaluation.mechanics.scale
        self.equations, self.scale = equations, scale
        n, n_y = len(scale), equations.n_positions
        second = [effect for effect in effects if effect.order == 2]
        first = [effect for effect in effects if effect.order == 1]
        X, V = small.position_directions, small.velocity_directions
        outputs = evaluation.by_states(small.changes)
        columns = np.vstack([X, V, small.matrix, outputs])

        def of_inputs(selected: Sequence[InputEffects], order: int) -> Array:
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
        second: Sequence[InputEffects],
        first: Sequence[InputEffects],
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


def descriptor_form(
    evaluation: OutputEvaluation,
    equations: LinearEquations,
    effects: Sequence[InputEffects],
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
