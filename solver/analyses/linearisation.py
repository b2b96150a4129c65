"""Linearisation of an assembled mechanism: frequencies, damping ratios, mode shapes.

The state should be an equilibrium or a steady motion such as a constant rotation; in
axes that rotate with it the matrices of a steady motion are constant.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, WithDiagnostics, diagnose, without

from ..diagnostics.body_loads import find_state_warnings
from ..initial_state.assembly import assemble
from ..output.columns import position_names, velocity_names
from ..spatial import system_arrays as at
from ..system.characteristic_sizes import RESTING_RATE, coordinate_sizes
from ..system.errors import SimulationError
from ..system.system import System
from .dense_equations import DenseEquations, least_squares, refuse_eliminated_joints
from .frozen_inputs import with_continuous_laws, with_integrated_drives
from .joint_friction import equations_at
from .multi_blade import mixing_matrix
from .reference_axes import axis_angular_velocities, body_axes, frame_rotation_matrix
from .rigid_motions import spectrum
from .state_derivatives import corner_notes
from .state_matrix import (
    SmallMotions,
    linear_equations,
    small_motions,
    state_matrix,
)
from .static_equilibrium import FORCE_ROUNDING, static_equilibrium
from .steady_axes import SteadyAxes, steady_axes
from .whirl import Whirl, mode_whirl

STATES = ("static", "start")


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """An assembled system in a state.

    Attributes
    ----------
    system
        With continuous control laws; about the static equilibrium with constant
        functions of time.
    z, v
        The state.
    t
        The time of the drives [s].
    diagnostics, law_diagnostics
        Of the equilibrium, and of the control laws.
    """

    system: System
    z: Array
    v: Array
    t: float
    diagnostics: tuple[Diagnostic, ...] = ()
    law_diagnostics: tuple[Diagnostic, ...] = ()


def operating_point(
    system: System,
    about: str = "static",
    state: tuple[Array, Array] | None = None,
    time: float | None = None,
) -> OperatingPoint:
    """Return the system in the state that is to be linearised.

    Parameters
    ----------
    about
        "static", the static equilibrium, or "start", the assembled start with its
        velocities.
    state : (z_I, z_II)
        Instead, as in a result's positions and velocities.
    time
        Of the drives at that state [s], default the start.

    Raises
    ------
    InputError
        There is no such state, or the start cannot be assembled.
    SimulationError
        There is no static equilibrium.
    """
    refuse_eliminated_joints(system)
    system, of_laws = with_continuous_laws(system)
    found: tuple[Diagnostic, ...] = ()
    if about not in STATES:
        expected = f"one of {', '.join(STATES)}"
        raise InputError(f"found {about!r}", place="about", expected=expected)
    if state is not None:
        system, _ = assemble(system)
        z, v = (np.array(part, float) for part in state)
        _check_size(system, z, v)
        system, z, v = _with_integrated_rates(system, z, v)
    elif about == "static":
        equilibrium = static_equilibrium(system)
        system, found = equilibrium.system, equilibrium.diagnostics
        z, v = equilibrium.z, equilibrium.v
    else:
        system, start = assemble(with_integrated_drives(system))
        z, v = start.z, start.v
    t = system.scene.time.start if time is None else time
    return OperatingPoint(system, z, v, t, found, of_laws)


def _with_integrated_rates(
    system: System, z: Array, v: Array
) -> tuple[System, Array, Array]:
    """The system whose drives of constant rate prescribe values, in the same state."""
    integrated = with_integrated_drives(system)
    if integrated is system:
        return system, z, v
    integrated, _ = assemble(integrated)
    rates = []
    for names, part in ((position_names, z), (velocity_names, v)):
        columns = {name: i for i, name in enumerate(names(system))}
        if not columns.keys() >= set(names(integrated)):
            return system, z, v
        rates.append(part[[columns[name] for name in names(integrated)]])
    return integrated, rates[0], rates[1]


def _check_size(system: System, z: Array, v: Array) -> None:
    shapes = (system.n_positions,), (system.n_velocities,)
    if (z.shape, v.shape) != shapes:
        raise InputError(
            f"the state has {z.size} positions and {v.size} velocities",
            place="state",
            expected=f"{shapes[0][0]} and {shapes[1][0]} of the same scene, compiled "
            "in the same way",
        )


#: A state is near another one that differs by less than this part of the sizes; what is
#: left of the accelerations there, relative to them.
NEAR_STATE, STEADY_RESIDUAL = 0.05, 1e-6
#: Accelerations that drives demand are rounding below this part of those of the loads,
#: or of the squares of the rates.
DRIVEN = 1e-8
#: Singular values of the state matrix that are cut on the way to it, of the largest.
SOFT_DIRECTIONS = (1e-10, 1e-13)
#: Ways below this share of the sizes lead nowhere; frequencies that differ by less than
#: this share are the same, and those below this share of the square of the highest are
#: rounding.
NO_DISPLACEMENT, EQUAL_FREQUENCY, ROUNDING = 1e-12, 0.01, 1e-11
#: A state is steady when the way to steady motion is shorter than this share of the
#: sizes and of the velocities; Newton steps towards it.
STEADY_STATE, MAX_SHIFTS = 1e-9, 4
#: Of rotations and deformations, where that of displacements is one.
ROTATION_MOBILITY = 1e-4
SAG_ADVICE = (
    'Analyse the straight shaft, without state = "static": one that sags would '
    "rotate about its bent axis."
)
STEADY_ADVICE = 'Use about = "static", or "start" with a scene in steady motion.'
HELD_ADVICE = 'Use about = "static": there drives hold their values.'
FROZEN_ADVICE = "With --frozen (frozen = true) they are those of one instant."
#: Axes in which modes are seen.
INERTIAL, ROTATING = "inertial", "rotating with each body"
#: Code of the note on modes that grow.
GROWING = "N714"
#: Damping ratios are negative below this; smaller ones are rounding.
INSTABILITY_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Linearisation(WithDiagnostics):
    """Natural modes about a state.

    Attributes
    ----------
    eigenvalues : (n,)
        [1/s], one of each complex pair, by growing frequency.
    frequencies : (n,)
        |eigenvalue| / 2 pi [Hz], 0 of a real eigenvalue, which does not oscillate.
    damping_ratios : (n,)
        -Re / |eigenvalue|; 1 or -1 without oscillation.
    shapes : (n, velocity coordinates)
        Complex, displacements in the body frames, the largest entry 1.
    names
        Of the velocity coordinates.
    z, v
        The state.
    diagnostics
        What has to be known of it, and of the state; `notes` and `warnings` give it
        as sentences.
    frame
        The axes in which `eigenvalues`, `coordinate_frequencies` and `shapes` are seen.
    inertial_frequencies : (n,)
        [Hz] of the (damped) oscillation in axes that do not turn.
    rotating_frequencies : (n,)
        [Hz] of the (damped) oscillation in the axes of the bodies that move.
    whirl : (n,)
        Each mode "forward", "backward", or "" for none.
    rigid : (n,)
        True for rigid motions, whose eigenvalues are known exactly.
    speed
        Of the body that rotates fastest [rad/s].
    scales : (velocity coordinates,)
        Sizes of the coordinates of equal kinetic energy; shapes divided by them can be
        compared.
    """

    eigenvalues: np.ndarray
    frequencies: Array
    damping_ratios: Array
    shapes: np.ndarray
    names: tuple[str, ...]
    z: Array
    v: Array
    diagnostics: tuple[Diagnostic, ...] = ()
    frame: str = INERTIAL
    inertial_frequencies: Array = field(default_factory=lambda: np.zeros(0))
    rotating_frequencies: Array = field(default_factory=lambda: np.zeros(0))
    whirl: tuple[str, ...] = ()
    rigid: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    speed: float = 0.0
    scales: Array = field(default_factory=lambda: np.zeros(0))


def linearise(
    system: System,
    about: str = "static",
    state: tuple[Array, Array] | None = None,
    time: float | None = None,
    *,
    frozen: bool = False,
) -> Linearisation:
    """Natural modes of a scene.

    Parameters
    ----------
    about, state, time
        As of `operating_point`.
    frozen
        Give the modes of the instant also where the equations of small motions change
        in time or the state is no steady motion; they do not describe a motion.

    Raises
    ------
    InputError
        There is no such state, or the start cannot be assembled, or friction of a joint
        has no derivative there.
    SimulationError
        There is no static equilibrium, a body deforms by more than its own size in it,
        the state is a singular configuration, its inertia is not positive, or it has no
        modes, see `frozen`.
    """
    point = operating_point(system, about, state, time)
    system, z, v, t = point.system, point.z, point.v, point.t
    mechanics, axes, small, causes = linearised_at(system, t, z, v, multi_blade=True)
    if causes and not frozen:
        mechanics.evaluate(z, v)
        is_static = system.scene.initial.state == "static"
        sags = is_static and _is_rotating(mechanics)
        remedy = SAG_ADVICE if sags else FROZEN_ADVICE
        raise SimulationError((diagnose("N718", t=t, remedy=remedy), *causes))
    modes = _natural_modes(mechanics, small, axes.highest)
    found = (
        *find_state_warnings(system, z[None]),
        *point.diagnostics,
        *((diagnose("N715"), *causes) if causes else ()),
        *axes.diagnostics,
        *(() if causes else _growth_notes(modes)),
        *mechanics.notes(),
        *corner_notes(mechanics, small.z, small.v, small.corners),
        *point.law_diagnostics,
    )
    return replace(modes, diagnostics=without(found, system.scene.diagnostics.ignore))


def linearised_at(
    system: System, t: float, z: Array, v: Array, *, multi_blade: bool = False
) -> tuple[DenseEquations, SteadyAxes, SmallMotions, tuple[Diagnostic, ...]]:
    """Equations at a state, axes in which they are constant, the small motions in them
    about the steady motion next to the state, and why these do not describe a motion,
    if so."""
    mechanics = equations_at(system, t, z, v)
    mechanics.set_scale(z, stiffness=0.0)
    equations = linear_equations(mechanics, z, v)
    axes = steady_axes(mechanics, equations, multi_blade=multi_blade)
    seen = equations.in_axes(mechanics, axes.omegas, axes.blades)
    small = small_motions(mechanics, seen)
    steady, causes = near_steady_motion(mechanics, small)
    return mechanics, axes, steady, causes or axes.changing


def modes_at(
    system: System, t: float, z: Array, v: Array
) -> tuple[Linearisation, tuple[Diagnostic, ...]]:
    """Natural modes at a state, and why they do not describe a motion, if so."""
    mechanics, axes, small, causes = linearised_at(system, t, z, v)
    return _natural_modes(mechanics, small, axes.highest), causes


def growing(modes: Linearisation) -> NDArray[np.bool_]:
    """Which modes (n,) have negative damping beyond rounding."""
    return (modes.damping_ratios < -INSTABILITY_TOLERANCE) & ~modes.rigid


def _growth_notes(modes: Linearisation) -> Iterator[Diagnostic]:
    """Modes with negative damping, of equations that are constant (N714)."""
    yield from growth_notes(growing(modes), modes.eigenvalues.real)


def growth_notes(grows: NDArray[np.bool_], rates: Array) -> Iterator[Diagnostic]:
    """The modes that grow, with the largest of their rates [1/s] (N714).

    Parameters
    ----------
    grows, rates : (n,)
    """
    numbers = [str(k + 1) for k in np.flatnonzero(grows)]
    if numbers:
        subject = "mode" if len(numbers) == 1 else "modes"
        rate = float(rates[grows].max())
        yield diagnose(GROWING, f"{subject} {', '.join(numbers)}", rate=rate)


def steady_residual(mechanics: DenseEquations, small: SmallMotions) -> Array:
    """Rates of (y, w) at the state, zero in a steady motion."""
    mechanics.evaluate(small.z, small.v)
    a, slow = mechanics.accelerations()[0], small.v / mechanics.scale
    W = frame_rotation_matrix(mechanics, small.omegas)
    W = W + mixing_matrix(mechanics, small.blades)
    return np.concatenate([small.drift, small.free_directions.T @ (a - W @ slow)])


def driven_accelerations(mechanics: DenseEquations, z: Array, v: Array) -> Array:
    """Accelerations (n,) that functions of time of drives demand in a state, relative
    to the sizes of coordinates [1/s^2]; zero where they are rounding of the loads or of
    the squares of the rates. What laws demand is not known and left out."""
    system = mechanics.system
    none, constraint = np.zeros(system.n_velocities), system.arrays.constraint
    by_law = constraint[constraint[:, at.C_LAW] >= 0, at.ROW]
    mechanics.evaluate(z, none)
    C, gamma = (np.delete(x, by_law, 0) for x in (mechanics.jacobian, mechanics.gamma))
    a = least_squares(C, gamma)
    sizes = coordinate_sizes(system)
    found = np.abs(a) * mechanics.scale / sizes
    rate = np.abs(v / sizes).max(initial=0.0)
    is_rounding = (
        np.abs(a).max(initial=0.0) <= DRIVEN * mechanics.force_size(z)
        or found.max(initial=0.0) <= DRIVEN * rate**2
    )
    return none if is_rounding else found


def near_steady_motion(
    mechanics: DenseEquations, small: SmallMotions
) -> tuple[SmallMotions, tuple[Diagnostic, ...]]:
    """Small motions about the steady motion near a state, or why the state is far from
    rest and from steady motion (N710, N711).

    Near is where the equations, taken as linear, have such a state. It may be near and
    have other modes: a column that nothing compresses yet accelerates, and is stiff.
    About a state that is not quite steady the equations lack what its own accelerations
    contribute, and modes that keep their energy seem to grow.
    """
    names = velocity_names(mechanics.system)
    sizes = coordinate_sizes(mechanics.system) / mechanics.scale
    driven = driven_accelerations(mechanics, small.z, small.v)
    mechanics.evaluate(small.z, small.v)
    if driven.any():
        return small, (_unsteady(mechanics, names[int(driven.argmax())]),)
    residual = steady_residual(mechanics, small)[len(small.drift) :]
    force = np.abs(mechanics.force).max(initial=0.0)
    force = max(force, mechanics.force_size(small.z))
    mechanics.evaluate(small.z, small.v)
    if np.abs(residual).max(initial=0.0) <= FORCE_ROUNDING * force:
        return small, ()
    shift, displacement, remaining = _steady_shift(mechanics, small)
    first = names[int(np.argmax(np.abs(small.free_directions @ residual) / sizes))]
    if displacement >= NEAR_STATE or remaining > STEADY_RESIDUAL * np.abs(residual).max(
        initial=0.0
    ):
        return small, (_unsteady(mechanics, first),)
    if displacement < NO_DISPLACEMENT:
        return small, ()
    steady = _shifted(mechanics, small, shift)
    own, other = (spectrum(mechanics, each).values for each in (small, steady))
    mechanics.evaluate(small.z, small.v)
    causes = _changed_mode_notes(own, other, first)
    if causes:
        return small, causes
    for _ in range(MAX_SHIFTS):
        shift, displacement, _ = _steady_shift(mechanics, steady)
        rates = np.abs(steady.velocity_directions @ shift) / sizes
        speed = np.abs(steady.v / mechanics.scale / sizes).max(initial=0.0)
        if max(displacement, rates.max(initial=0.0) / (1.0 + speed)) < STEADY_STATE:
            break
        steady = _shifted(mechanics, steady, shift)
    return steady, ()


def _unsteady(mechanics: DenseEquations, coordinate: str) -> Diagnostic:
    """What the state evaluated last is not (N710)."""
    advice = STEADY_ADVICE
    if mechanics.system.scene.initial.state == "static":
        advice = SAG_ADVICE if _is_rotating(mechanics) else HELD_ADVICE
    return diagnose("N710", coordinate=coordinate, remedy=advice)


def _is_rotating(mechanics: DenseEquations) -> bool:
    """True if axes of a body rotate in the state evaluated last, beyond rounding."""
    time = mechanics.system.scene.time
    rates = np.abs(axis_angular_velocities(mechanics)).max(initial=0.0)
    return bool(rates * (time.end - time.start) > RESTING_RATE)


def _steady_shift(
    mechanics: DenseEquations, small: SmallMotions
) -> tuple[Array, float, float]:
    """Way to steady motion by the linear equations, its largest displacement in sizes
    of the coordinates, and what it leaves of the accelerations.

    Directions that no force resists are cut. Those that gravity alone holds, beside
    stiff bodies, are cut only where that leaves no accelerations.
    """
    rates = steady_residual(mechanics, small)
    mechanics.evaluate(small.z, small.v)
    sizes = coordinate_sizes(mechanics.system) / mechanics.scale
    for cut in SOFT_DIRECTIONS:
        shift = np.asarray(np.linalg.lstsq(small.matrix, -rates, rcond=cut)[0], float)
        remaining = np.abs(small.matrix @ shift + rates).max(initial=0.0)
        if remaining <= STEADY_RESIDUAL * np.abs(rates).max(initial=0.0):
            break
    moved = np.abs(small.position_directions @ shift) / sizes
    return shift, float(moved.max(initial=0.0)), float(remaining)


def _shifted(
    mechanics: DenseEquations, small: SmallMotions, shift: Array
) -> SmallMotions:
    """Small motions about a state beside that of others, which meets the joints.

    There bodies move, rather than turn or deform, at other rates: relative rotations
    within the steady motion are no small motions.
    """
    z = mechanics.displaced(small.z, small.position_directions @ shift)
    z = mechanics.closed(z)
    v = small.v
    if v.any():  # what rests stays at rest, without rounding
        v = v + mechanics.scale * (small.velocity_directions @ shift)
        mechanics.evaluate(z, v)
        mobility = np.full(len(v), ROTATION_MOBILITY)
        axes = 2 if mechanics.system.planar else 3
        for row in mechanics.system.arrays.body:
            mobility[row[at.VEL] : row[at.VEL] + min(axes, int(row[at.RD]))] = 1.0
        step = least_squares(mechanics.jacobian * mobility, -mechanics.constraint_rates)
        v = v + mechanics.scale * mobility * step
        rates = np.abs(v) / coordinate_sizes(mechanics.system)
        v = np.where(rates > NO_DISPLACEMENT * rates.max(), v, 0.0)
    return state_matrix(mechanics, z, v, small.omegas, small.blades)


def _changed_mode_notes(
    eigenvalues: np.ndarray, others: np.ndarray, first: str
) -> tuple[Diagnostic, ...]:
    """Frequencies that differ from those of the steady state near by (N711)."""
    values = [v[np.argsort(np.abs(v), kind="stable")] for v in (eigenvalues, others)]
    if values[0].shape != values[1].shape:
        return ()
    own, other = np.abs(values)
    rounding = ROUNDING * own.max(initial=0.0) ** 2
    distances = np.abs(own**2 - other**2) - rounding
    change = distances / np.maximum(own**2, rounding)
    k = int(np.argmax(change > 2 * EQUAL_FREQUENCY)) if len(change) else 0
    if not len(change) or change[k] <= 2 * EQUAL_FREQUENCY:
        return ()
    f, g = (_natural_frequencies(v[k]) for v in values)
    return (diagnose("N711", here=float(f), there=float(g), coordinate=first),)


def _natural_frequencies(eigenvalues: np.ndarray) -> Array:
    """|eigenvalue| / 2 pi [Hz] of those that oscillate, 0 of real ones."""
    return np.where(eigenvalues.imag, np.abs(eigenvalues), 0.0) / (2.0 * np.pi)


def _natural_modes(
    mechanics: DenseEquations, small: SmallMotions, highest: float
) -> Linearisation:
    """Natural modes of the matrix of small motions, of pairs one, by frequency, below
    an angular frequency."""
    z, v, spins = small.z, small.v, small.omegas
    modes = spectrum(mechanics, small)
    order = np.argsort(np.abs(modes.values), kind="stable")
    below = np.abs(modes.values) < highest * (1.0 - 1e-9)
    selected = [k for k in order if modes.values[k].imag >= 0.0 and below[k]]
    values, rigid = modes.values[selected], modes.rigid[selected]
    shapes = (
        small.position_directions @ modes.vectors[:, selected]
    ).T * mechanics.scale
    for shape in shapes:
        largest = shape[np.argmax(np.abs(shape))] if len(shape) else 1.0
        shape /= largest if largest != 0.0 else 1.0
    size = np.abs(values)
    mechanics.evaluate(z, v)
    own = body_axes(mechanics, v / mechanics.scale, mechanics.accelerations()[0])
    is_rotating = bool(own.any())
    whirls = [
        mode_whirl(mechanics, own, spins, float(abs(value.imag)), shape, small.blades)
        if is_rotating and value
        else Whirl((float(abs(value.imag)),), float(abs(value.imag)), "")
        for value, shape in zip(values, shapes, strict=True)
    ]
    return Linearisation(
        eigenvalues=values,
        frequencies=_natural_frequencies(values),
        damping_ratios=-values.real / np.where(size > 0.0, size, 1.0),
        shapes=shapes,
        names=velocity_names(mechanics.system),
        z=z,
        v=v,
        frame=ROTATING if spins.any() else INERTIAL,
        inertial_frequencies=np.array([w.inertial_frequencies[0] for w in whirls])
        / (2.0 * np.pi),
        rotating_frequencies=np.array([w.rotating_frequency for w in whirls])
        / (2.0 * np.pi),
        whirl=tuple(w.direction for w in whirls),
        rigid=rigid,
        speed=float(np.linalg.norm(own, axis=1).max(initial=0.0)),
        scales=mechanics.scale.copy(),
    )
