"""Linearisation of an assembled mechanism: frequencies, damping ratios, mode shapes.

The state should be an equilibrium, or a steady motion such as a constant rotation,
which stands still in axes that turn, so that its matrices do not depend on time.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import Array

from ..advice.body_measures import find_state_warnings
from ..errors import SimulationError
from ..recording.outputs import position_names, velocity_names
from ..start.assembly import assemble
from ..system.scene import System
from ..system.sizes import coordinate_sizes
from .axes import spins_of_bodies, turning
from .held import unsampled, with_integrated_rates
from .mechanics import Mechanics, refuse_prescribed
from .rigid_motions import spectrum
from .rubbing import mechanics_at
from .state_matrix import SmallMotions, state_matrix
from .static import static_equilibrium
from .steady_axes import CHANGING, steady_axes
from .whirl import Whirl, whirl_of

STATES = ("static", "start")
#: A state is near another one that differs by less than this part of the sizes; what is
#: left of the accelerations there, relative to them.
NEAR, STEADY = 0.05, 1e-6
#: Ways below this share of the sizes lead nowhere; frequencies that differ by less than
#: this share are the same, and those below this share of the square of the highest are
#: rounding.
AT_REST, SAME, ROUNDING = 1e-12, 0.01, 1e-11
#: Axes in which modes are seen.
INERTIAL, ROTATING = "inertial", "rotating with each body"
#: Accelerations below this part of those of the forces are rounding.
BALANCED = 1e-12


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Natural modes about a state.

    eigenvalues : (n,) [1/s], one of each complex pair, by growing frequency
    frequencies : (n,) |eigenvalue| / 2 pi [Hz]
    damping_ratios : (n,) -Re / |eigenvalue|; 1 or more (in size) without oscillation
    shapes : (n, velocity coordinates) complex, displacements in the body frames, the
        largest entry 1
    names : of the velocity coordinates
    z, v : the state
    notes : what has to be known of it, and of the state
    warnings : those of the notes that say that numbers may be wrong
    frame : the axes in which `eigenvalues`, `frequencies` and `shapes` are seen
    inertial_frequencies : (n,) [Hz] in axes that do not turn
    rotating_frequencies : (n,) [Hz] in the axes of the bodies that move
    whirl : (n,) of each mode "forward", "backward", or "" for none
    rigid : (n,) True for rigid motions, whose eigenvalues are known exactly
    """

    eigenvalues: np.ndarray
    frequencies: Array
    damping_ratios: Array
    shapes: np.ndarray
    names: tuple[str, ...]
    z: Array
    v: Array
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    frame: str = INERTIAL
    inertial_frequencies: Array = field(default_factory=lambda: np.zeros(0))
    rotating_frequencies: Array = field(default_factory=lambda: np.zeros(0))
    whirl: tuple[str, ...] = ()
    rigid: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))


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
    about : "static", the static equilibrium, or "start", the assembled start with its
        velocities
    state : (z_I, z_II) instead, as in a result's positions and velocities
    time : of the drives at that state [s], default the start
    frozen : give the modes of the instant also where the equations of small motions
        change in time or the state is no steady motion; they do not describe a motion

    Raises
    ------
    InputError : there is no such state, or the start cannot be assembled, or friction
        of a joint has no derivative there.
    SimulationError : there is no static equilibrium, a body deforms by more than its
        own size in it, the state is a singular configuration, its inertia is not
        positive, or it has no modes, see `frozen`.
    """
    refuse_prescribed(system)
    system, told = unsampled(system)
    of_state: tuple[str, ...] = ()
    if about not in STATES:
        raise InputError(f"found {about!r}", expected=f"one of {', '.join(STATES)}")
    if state is not None:
        system, _ = assemble(system)
        z, v = (np.array(part, float) for part in state)
        _check_size(system, z, v)
        system, z, v = _with_integrated_rates(system, z, v)
    elif about == "static":
        found = static_equilibrium(system)
        system, z, v, of_state = found.system, found.z, found.v, found.notes
    else:
        system, start = assemble(with_integrated_rates(system))
        z, v = start.z, start.v
    t = system.scene.time.start if time is None else time
    mechanics = mechanics_at(system, t, z, v)
    mechanics.set_scale(z, stiffness=0.0)
    spins, seen = steady_axes(mechanics, z, v)
    small = state_matrix(mechanics, z, v, spins)
    unsteady = _unsteady(mechanics, small)
    causes = unsteady or tuple(text for text in seen if text == CHANGING)
    if causes and not frozen:
        raise SimulationError(f"there are no natural modes: {causes[0]}")
    seen = tuple(text for text in seen if text != CHANGING)
    unsteady = tuple(f"frozen values of one instant: {text}" for text in causes)
    warnings = find_state_warnings(system, z[None])
    notes = (*warnings, *of_state, *unsteady, *seen, *mechanics.notes(), *told)
    modes = _modes(mechanics, small)
    return replace(modes, notes=tuple(dict.fromkeys(notes)), warnings=warnings)


def _unsteady(mechanics: Mechanics, small: SmallMotions) -> tuple[str, ...]:
    """Whether the state is far from rest and from steady motion, and what leaves it.

    Near is where the equations, taken as linear, have such a state. It may be near and
    have other modes: a column that nothing compresses yet accelerates, and is stiff.
    """
    matrix, motion, moved = small.matrix, small.motion, small.moved
    z, v, spins = small.z, small.v, small.spins
    mechanics.evaluate(z, v)
    a, slow = mechanics.accelerations()[0], v / mechanics.scale
    left = motion.T @ (a - turning(mechanics, spins) @ slow)
    force = np.abs(mechanics.force).max(initial=0.0)
    force = max(force, mechanics.force_size(z))
    mechanics.evaluate(z, v)
    if np.abs(left).max(initial=0.0) <= BALANCED * force:
        return ()
    forces = np.concatenate([np.zeros(len(matrix) - len(left)), -left])
    shift = np.linalg.lstsq(matrix, forces, rcond=1e-10)[0]
    sizes = coordinate_sizes(mechanics.system) / mechanics.scale
    way = np.abs(moved @ shift) / sizes
    rest = np.abs(matrix @ shift - forces).max(initial=0.0)
    names = velocity_names(mechanics.system)
    first = names[int(np.argmax(np.abs(motion @ left) / sizes))]
    if way.max(initial=0.0) < NEAR and rest <= STEADY * np.abs(left).max(initial=0.0):
        if way.max(initial=0.0) < AT_REST:
            return ()
        beside = mechanics.moved(z, moved @ shift)
        there = state_matrix(mechanics, beside, v, spins).matrix
        mechanics.evaluate(z, v)
        return _changed_modes(matrix, there, first)
    return (
        f"the state is neither near rest nor near a steady motion, {first} "
        "accelerates: modes tell of small motions about such states only",
    )


def _changed_modes(here: Array, there: Array, first: str) -> tuple[str, ...]:
    """Whether the matrix of the state of rest beside the own has other frequencies."""
    own, other = (np.sort(np.abs(np.linalg.eigvals(m))) for m in (here, there))
    if own.shape != other.shape:
        return ()
    apart = np.abs(own**2 - other**2)
    change = apart / np.maximum(own**2, ROUNDING * own.max(initial=0.0) ** 2)
    k = int(np.argmax(change > 2 * SAME)) if len(change) else 0
    if not len(change) or change[k] <= 2 * SAME:
        return ()
    f, g = (values[k] / (2.0 * np.pi) for values in (own, other))
    return (
        f"the state is near rest or steady motion, but {first} accelerates, so that "
        f"loads which stiffen or soften are not there yet: {f:.4g} Hz here is {g:.4g} "
        'Hz in that state; look about it, by initial = { state = "static" }',
    )


def _with_integrated_rates(
    system: System, z: Array, v: Array
) -> tuple[System, Array, Array]:
    """The system whose drives of constant rate prescribe values, in the same state."""
    integrated = with_integrated_rates(system)
    if integrated is system:
        return system, z, v
    integrated, _ = assemble(integrated)
    found = []
    for names, part in ((position_names, z), (velocity_names, v)):
        columns = {name: i for i, name in enumerate(names(system))}
        if not columns.keys() >= set(names(integrated)):
            return system, z, v
        found.append(part[[columns[name] for name in names(integrated)]])
    return integrated, found[0], found[1]


def _check_size(system: System, z: Array, v: Array) -> None:
    wanted = (system.n_positions,), (system.n_velocities,)
    if (z.shape, v.shape) != wanted:
        raise InputError(
            f"the state has {z.size} positions and {v.size} velocities",
            place="state",
            expected=f"{wanted[0][0]} and {wanted[1][0]} of the same scene, compiled "
            "in the same way",
        )


def _modes(mechanics: Mechanics, small: SmallMotions) -> Linearisation:
    """Natural modes of the matrix of small motions, of pairs one, by frequency."""
    z, v, spins = small.z, small.v, small.spins
    found = spectrum(mechanics, small)
    order = np.argsort(np.abs(found.values), kind="stable")
    kept = [k for k in order if found.values[k].imag >= 0.0]
    values, rigid = found.values[kept], found.rigid[kept]
    shapes = (small.moved @ found.vectors[:, kept]).T * mechanics.scale
    for shape in shapes:
        largest = shape[np.argmax(np.abs(shape))] if len(shape) else 1.0
        shape /= largest if largest != 0.0 else 1.0
    size = np.abs(values)
    mechanics.evaluate(z, v)
    turns = bool(spins_of_bodies(mechanics).any())
    whirls = [
        whirl_of(mechanics, spins, float(abs(value.imag)), shape)
        if turns and value.imag
        else Whirl((float(abs(value)),), float(abs(value)), "")
        for value, shape in zip(values, shapes, strict=True)
    ]
    return Linearisation(
        eigenvalues=values,
        frequencies=size / (2.0 * np.pi),
        damping_ratios=-values.real / np.where(size > 0.0, size, 1.0),
        shapes=shapes,
        names=velocity_names(mechanics.system),
        z=z,
        v=v,
        frame=ROTATING if spins.any() else INERTIAL,
        inertial_frequencies=np.array([w.inertial[0] for w in whirls]) / (2.0 * np.pi),
        rotating_frequencies=np.array([w.rotating for w in whirls]) / (2.0 * np.pi),
        whirl=tuple(w.direction for w in whirls),
        rigid=rigid,
    )
