"""Stick and slip of joints with friction: decisions and their times, section 14.

Every step is made with constant friction states. After the steps the instants are
located at which a sliding joint stops or a sticking joint reaches its limit; there the
states are decided again: what slides goes on sliding, what rests sticks if it can.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..integrators import output_sampling
from ..integrators.output_sampling import (
    N_FRICTION_OUTPUT,
    OUTPUT_ACCELERATION,
    OUTPUT_CONTACT_FORCE,
    OUTPUT_FRICTION,
    OUTPUT_LOAD,
    OUTPUT_POSITION,
    OUTPUT_RATE,
)
from ..spatial import system_arrays as at
from ..spatial.coordinates import rate
from ..system import work_arrays
from ..system.characteristic_sizes import (
    RESTING_RATE,
    coordinate_sizes,
    resting_rates,
)
from ..system.joint_friction import FrictionStateHistory
from ..system.system import System
from .samples import StateSampler

#: Friction is at its limit within this part of it.
LIMIT_TOLERANCE = 1e-9
#: Events without progress in time after which a run is given up.
MAX_SIMULTANEOUS = 100
#: Progress in time that is none, relative to the time and the span of a run.
TIME_ROUNDING = 4.0 * float(np.finfo(float).eps)
#: A joint that was seen to break loose does so also where its limit seems so far, or as
#: far as the tolerance of the run.
OBSERVED_SLIP = 1e-6
#: A joint turns round where to stop it would take so many times what its load holds.
CLEAR_REVERSAL = 2.0
#: Rounding of the accelerations of a mechanism, relative to the largest of them.
ACCELERATION_ROUNDING = 1e-13
#: Joints that stick hold the same motion where so little separates them.
SHARED_MOTION = 1e-8
#: A dead point is left when the mobility of a joint grows so much, relative to the one
#: it has, while the mechanism moves by this part of its size.
DEAD_POINT_GROWTH, SMALL_MOTION = 1e16, 1e-3

#: Times, positions and velocities.
StatesOfMotion = tuple[Array, Array, Array]


def with_friction_states(
    system: System, history: FrictionStateHistory | None = None
) -> System:
    """The system with the friction states of one run, by default of its own."""
    if not system.friction_joints:
        return system
    if history is None:
        history = FrictionStateHistory(system.arrays.friction_state.copy())
    return replace(
        system,
        arrays=system.arrays.replaced(friction_state=history.current_states),
        friction_history=history,
    )


@dataclass(frozen=True)
class JointGroup:
    """Joints with friction whose coordinates only move in proportion.

    Attributes
    ----------
    joints
        Their rows.
    ratios
        Rates of their coordinates, relative to the first one.
    mobility
        Acceleration of the first coordinate by a unit force along it.
    """

    joints: NDArray[np.intp]
    ratios: Array
    mobility: float


def sticking_joints(friction_state: Array) -> NDArray[np.bool_]:
    """Which joints friction holds, (frictions,); none whose motion is prescribed."""
    states = friction_state[:, [at.SLIP_DIRECTION, at.REST_RATE]]
    return np.asarray((states == 0.0).all(axis=1), bool)


class StickSlipDecision:
    """Chooses how joints with friction move on.

    Attributes
    ----------
    changing_joints
        Joints whose friction states change next.
    reversing_contacts
        Contact points, in one row, whose force changes its side next.
    changed_joints
        Those whose friction states did last.
    groups
        Joints that hold one motion together.
    is_without_limit
        Joints that never stick, with a coefficient of zero.
    """

    def __init__(
        self, system: System, rtol: float = 0.0, closed: Array | None = None
    ) -> None:
        """Parameters
        ----------
        closed
            See `StateSampler`; default states are taken as they are.
        """
        assert system.friction_history is not None
        self.system = system
        self.sampler = StateSampler(
            system, np.zeros((0, 2)) if closed is None else closed
        )
        self.history, self.friction_state = (
            system.friction_history,
            system.friction_history.current_states,
        )
        self.work, self.memory = self.sampler.work, self.sampler.memory
        self.prescribed, self.is_at_rest = (
            self.friction_state[:, at.REST_RATE] > 0.0,
            resting_rates(system),
        )
        self.sizes, self.sliding_acceleration = coordinate_sizes(system), 0.0
        self.span = system.scene.time.end - system.scene.time.start
        self.rest_speed = np.array(
            [self._static_limit(j) for j in range(len(self.friction_state))]
        )
        self.is_without_limit = ~self.prescribed & (self.rest_speed == 0.0)
        self.largest_rate, self.rtol = np.zeros(len(self.friction_state)), rtol
        self.has_single_direction = np.array(
            [self._has_single_direction(j) for j in range(len(self.friction_state))]
        )
        self.largest_contact_force = np.zeros(self.has_single_direction.shape)
        self.largest_acceleration, self.largest_compliance = (
            np.zeros(len(self.friction_state)),
            np.zeros(len(self.friction_state)),
        )
        self.groups: list[JointGroup] = []
        self.changing_joints: list[int] = []
        self.reversing_contacts: list[int] = []
        self.changed_joints = set[int]()
        self.is_started, self._last, self._count = False, -np.inf, 0
        self._since = -np.inf

    def _static_limit(self, j: int) -> float:
        """Largest friction force per unit of load of a sticking joint."""
        law = self.system.arrays.friction[j, at.R_LAW]
        real_data = self.system.arrays.real_data
        return float(real_data[law + at.L_STATIC] * real_data[law + at.L_RADIUS])

    def _has_single_direction(self, j: int) -> list[bool]:
        """True if what presses each place of a joint has a single direction."""
        counts = [
            bool(place[1].any()) for place in self.system.friction_joints[j].weights
        ]
        return [k < len(counts) and not counts[k] for k in range(at.MAX_CONTACTS)]

    def friction_output(self, t: Array, z: Array, v: Array) -> Array:
        """Friction quantities in states of one smooth interval, (nt,
        n_frictions, .).
        """
        output = np.zeros((len(t), len(self.friction_state), N_FRICTION_OUTPUT))
        self.work.interval_time[0] = self.system.clocks(t[len(t) // 2 :])[0]
        arrays = self.system.arrays
        calls = self.sampler.kernels
        output_sampling.evaluate_friction(
            calls, arrays, self.work, self.memory, t, z, v, output
        )
        work_arrays.raise_pending(self.system)
        return output

    def choose_states(self, t: float, z: Array, v: Array) -> Diagnostic | None:
        """Decide the friction states from an instant on, into the history.

        What slides goes on sliding; what rests sticks if it can. Returns why there is
        no decision (N501, N502), if so.
        """
        progress = TIME_ROUNDING * max(abs(t), self.span)
        if t <= self._last + progress:
            self._count += 1
        else:
            self._count, self._since = 0, t
        self._last = t
        if self._count > MAX_SIMULTANEOUS:
            count = self.has_single_direction.shape[1]
            joints = self.changing_joints or [
                k // count for k in self.reversing_contacts
            ]
            return diagnose("N502", t=self._since, joints=self._joint_names(joints))
        states = np.array([t]), z[None], v[None]
        before, changing = self.friction_state.copy(), self.changing_joints
        slip_direction = self.friction_state[:, at.SLIP_DIRECTION]
        self.friction_state[:] = 0.0
        self.friction_state[:, at.REST_RATE] = before[:, at.REST_RATE]
        output = self.friction_output(*states)[0]
        stops = any(before[j, at.SLIP_DIRECTION] != 0.0 for j in changing)
        noise = self.rtol * self.largest_rate if stops else 0.0
        at_rest = np.abs(output[:, OUTPUT_RATE]) <= self.is_at_rest + noise
        at_rest[changing] = True
        slip_direction[:] = np.where(at_rest, 0.0, np.sign(output[:, OUTPUT_RATE]))
        self._set_prescribed_directions(output)
        slip_direction[self.is_without_limit] = 1.0  # either sense has no friction
        all_slide, output = slip_direction.all(), self._slide(states)
        at_rest &= ~self.prescribed & ~self.is_without_limit
        stays_stuck = (before[:, at.SLIP_DIRECTION] == 0.0) & at_rest & self.is_started
        self.friction_state[:, at.STICK_POSITION] = np.where(
            stays_stuck, before[:, at.STICK_POSITION], output[:, OUTPUT_POSITION]
        )
        for j in np.intersect1d(changing, np.flatnonzero(at_rest & ~stays_stuck)):
            if self._reverses(states, int(j), -before[j, at.SLIP_DIRECTION]):
                at_rest[j] = False
        self.changing_joints = []
        if all_slide:
            self.groups = []
            is_decided = bool(np.isfinite(output[:, OUTPUT_FRICTION]).all())
        else:
            if np.abs(v / self.sizes).max() * self.span <= RESTING_RATE:
                self._leave_dead_points(states, at_rest)
            is_decided = self._release_overloaded(
                states, at_rest, [j for j in changing if stays_stuck[j]]
            )
            self.groups = self.groups_of_one_motion()
            output = self.friction_output(*states)[0]
        self.friction_state[~self._is_sticking, at.STICK_POSITION] = 0.0
        self._set_contact_sides(output, before[:, at.CONTACT_SIDE :])
        changed = (before[:, at.SLIP_DIRECTION] != slip_direction) & self.is_started
        self.changed_joints = {*np.flatnonzero(changed).tolist(), *changing}
        self.is_started = True
        if is_decided:
            return None
        resting = self._joint_names(np.flatnonzero(at_rest))
        every = tuple(rub.joint for rub in self.system.friction_joints)
        return diagnose("N501", t=t, joints=resting or every)

    @property
    def _is_sticking(self) -> NDArray[np.bool_]:
        """Which joints friction holds, (frictions,)."""
        return sticking_joints(self.friction_state)

    def _certain_contact_force(self, output: Array) -> Array:
        """Smallest contact forces whose side is certain, (n_frictions, .).

        Relative to the largest one so far, and to the force that moves the joint most
        easily: at a dead point no force does.
        """
        self.largest_compliance = np.fmax(
            self.largest_compliance, self.memory.friction_P.diagonal()
        )
        self.largest_acceleration = np.fmax(
            self.largest_acceleration,
            np.abs(output[:, :, OUTPUT_ACCELERATION]).max(axis=0),
        )
        moving = self.largest_acceleration / np.maximum(
            self.largest_compliance, np.finfo(float).tiny
        )
        moving[self.prescribed] = 0.0
        contact_force = np.abs(output[:, :, OUTPUT_CONTACT_FORCE:]).max(axis=0)
        self.largest_contact_force = np.fmax(self.largest_contact_force, contact_force)
        return max(LIMIT_TOLERANCE, self.rtol) * np.fmax(
            self.largest_contact_force, moving[:, None]
        )

    def _set_prescribed_directions(self, output: Array) -> None:
        """Set the slip directions of prescribed motions.

        Where they rest, the direction in which they continue.
        """
        rate, acceleration = output[:, OUTPUT_RATE], output[:, OUTPUT_ACCELERATION]
        noise = self.rtol * self.largest_rate
        noise[[j for j in range(len(noise)) if j not in self.changing_joints]] = 0.0
        significant_acceleration = np.where(
            np.abs(acceleration) * self.span > self.is_at_rest, acceleration, 0.0
        )
        directions = np.where(
            np.abs(rate) > self.is_at_rest + noise, rate, significant_acceleration
        )
        self.friction_state[self.prescribed, at.SLIP_DIRECTION] = np.sign(
            directions[self.prescribed]
        )

    def _set_contact_sides(self, output: Array, before: Array) -> None:
        """Store the contact sides of sliding joints, until they change.

        Parameters
        ----------
        output
            (frictions, .) in the state, of the friction states chosen.
        """
        contact_force, certain_force = (
            output[:, OUTPUT_CONTACT_FORCE:],
            self._certain_contact_force(output[None]),
        )
        sides = np.where(before == 0.0, 1.0, before)
        sides.ravel()[self.reversing_contacts] *= -1.0
        sides = np.where(
            np.abs(contact_force) > certain_force, np.sign(contact_force), sides
        )
        slides = self.friction_state[:, at.SLIP_DIRECTION, None] != 0.0
        self.friction_state[:, at.CONTACT_SIDE :] = np.where(
            self.has_single_direction & slides, sides, 0.0
        )
        self.reversing_contacts = []

    def _reverses(self, states: StatesOfMotion, j: int, slip_direction: float) -> bool:
        """True if a joint that turns round does so far above what could stop it.

        To stop it might take any force: where other joints move on, its coordinate may
        have a stationary value. Its sense is the new one then.
        """
        self._mark_shared()
        self.friction_state[j, at.SLIP_DIRECTION] = slip_direction
        output = self.friction_output(*states)[0]
        needed = (
            output[j, OUTPUT_FRICTION] * self.memory.friction_P[j, j]
            - output[j, OUTPUT_ACCELERATION]
        )
        limit = (
            self.rest_speed[j] * output[j, OUTPUT_LOAD] * self.memory.friction_P[j, j]
        )
        if (
            slip_direction * output[j, OUTPUT_ACCELERATION] > 0.0
            and abs(needed) > CLEAR_REVERSAL * limit
        ):
            return True
        self.friction_state[j, at.SLIP_DIRECTION] = 0.0
        return False

    def _leave_dead_points(self, states: StatesOfMotion, at_rest: Array) -> None:
        """Set the slip directions of joints that a mechanism at rest moves at once.

        At a dead point the coordinate x of a joint is stationary: no friction force of
        it holds the mechanism, and its acceleration vanishes. In a motion along the
        accelerations a it goes where its second derivative, x'' of velocities along a,
        points.
        """
        t, z, v = states
        slip_direction = self.friction_state[:, at.SLIP_DIRECTION]
        for j in np.flatnonzero(at_rest):
            for direction in (1.0, -1.0):
                slip_direction[j] = direction
                acceleration = self.friction_output(*states)[0, j, OUTPUT_ACCELERATION]
                mobility, a = self.memory.friction_P[j, j], self.memory.acceleration
                size = np.abs(a / self.sizes).max()
                if not 0.0 < size < np.inf:
                    continue
                motion, displacement = a / size, np.zeros_like(z[0])
                rate(self.system.arrays, z[0], SMALL_MOTION * motion, displacement)
                moving = v + np.sqrt(size) * motion
                curvature = self.friction_output(t, z, moving)[
                    0, j, OUTPUT_ACCELERATION
                ]
                self.friction_output(t, z + displacement, v)
                is_dead = self.memory.friction_P[j, j] > DEAD_POINT_GROWTH * mobility
                if is_dead and direction * (curvature - acceleration) > 0.0:
                    at_rest[j] = False
                    break
            else:
                slip_direction[j] = 0.0

    def _mark_shared(self) -> None:
        """Mark sticking joints if some of them constrain the same motion."""
        stuck = np.flatnonzero(self._is_sticking)
        P = self.memory.friction_P[np.ix_(stuck, stuck)]
        size = np.sqrt(np.maximum(P.diagonal(), np.finfo(float).tiny))
        least_eigenvalue = np.linalg.eigvalsh(P / np.outer(size, size)).min(initial=1.0)
        self.friction_state[:, at.SHARES_MOTION] = 0.0
        self.friction_state[stuck, at.SHARES_MOTION] = float(
            least_eigenvalue < SHARED_MOTION
        )

    def _release_overloaded(
        self, states: StatesOfMotion, at_rest: Array, observed_slips: list[int]
    ) -> bool:
        """Lets go, in sequence, what friction cannot hold; False without a decision.

        Parameters
        ----------
        observed_slips
            Joints that were seen to break loose. Once released they may be braked:
            their limit is met but for rounding, and to hold them again is no way out.
        """
        slip_direction = self.friction_state[:, at.SLIP_DIRECTION]
        held, may_brake = np.zeros((2, len(slip_direction)), bool)
        for _ in range(4 * len(slip_direction) + 1):
            self._mark_shared()
            output = self.friction_output(*states)[0]
            if not np.isfinite(output[:, OUTPUT_FRICTION]).all():
                return self._release_together(states, at_rest)
            groups = self.groups_of_one_motion()
            group = next((each for each in groups if not held[each.joints].any()), None)
            if group is not None:
                observed = bool(np.isin(group.joints, observed_slips).any())
                load = output[:, OUTPUT_LOAD]
                held[group.joints] = not self._release_group(
                    states, group, load, observed
                )
                continue
            limits = self.rest_speed * output[:, OUTPUT_LOAD]
            negligible = self._negligible()
            excess = np.abs(output[:, OUTPUT_FRICTION]) - limits - negligible
            excess[observed_slips] += (
                self._observed_margin * limits[observed_slips]
                + 2.0 * negligible[observed_slips]
            )
            excess[~self._is_sticking | held] = -np.inf
            most_loaded = int(np.argmax(excess - LIMIT_TOLERANCE * limits))
            if excess[most_loaded] > LIMIT_TOLERANCE * limits[most_loaded]:
                slip_direction[most_loaded] = -np.sign(
                    output[most_loaded, OUTPUT_FRICTION]
                )
                may_brake[most_loaded] = most_loaded in observed_slips
                continue
            least = self.memory.friction_P.diagonal() * (
                LIMIT_TOLERANCE * limits + negligible
            )
            must_stick = (
                at_rest
                & ~may_brake
                & (slip_direction * output[:, OUTPUT_ACCELERATION] < -least)
            )
            if not must_stick.any():
                return True
            slip_direction[must_stick] = 0.0
        return False

    def groups_of_one_motion(self) -> list[JointGroup]:
        """Sticking joints, two or more, whose coordinates only move in proportion."""
        P, groups = self.memory.friction_P, list[JointGroup]()
        remaining = np.flatnonzero(self._is_sticking & (P.diagonal() > 0.0))
        while len(remaining):
            is_proportional = self._move_in_proportion(remaining)
            joints = remaining[is_proportional]
            if len(joints) > 1:
                first = joints[0]
                mobility = float(P[first, first])
                groups.append(JointGroup(joints, P[first, joints] / mobility, mobility))
            remaining = remaining[~is_proportional]
        return groups

    def _move_in_proportion(self, joints: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Which joints only move in proportion to the first of them, (joints,)."""
        P, first = self.memory.friction_P, joints[0]
        size = np.sqrt(np.maximum(P.diagonal()[joints] * P[first, first], 0.0))
        return np.asarray(np.abs(P[first, joints]) >= (1.0 - SHARED_MOTION) * size)

    def released_forces(self, states: StatesOfMotion, group: JointGroup) -> Array:
        """Forces (2, nt) along the first coordinate of a group that friction at its
        limit leaves, of sliding in either sense, positive in this sense.

        Negative ones brake, so that the group sticks: how its joints share what they
        hold is open, whether they hold it is not.
        """
        forces, sticking = [], self.friction_state[group.joints]
        for sign in (1.0, -1.0):
            self._let_slide(group, sign)
            self.friction_state[group.joints, at.AT_LIMIT] = 1.0
            output = self.friction_output(*states)
            forces.append(sign * output[:, group.joints[0], OUTPUT_ACCELERATION])
        self.friction_state[group.joints] = sticking
        return np.nan_to_num(np.array(forces), nan=-np.inf) / group.mobility

    def _let_slide(self, group: JointGroup, sign: float) -> None:
        self.friction_state[group.joints, at.SLIP_DIRECTION] = sign * np.sign(
            group.ratios
        )
        self.friction_state[group.joints, at.SHARES_MOTION] = 0.0

    def _release_group(
        self, states: StatesOfMotion, group: JointGroup, load: Array, observed: bool
    ) -> bool:
        """Release joints of one motion if they then accelerate in this sense.

        Parameters
        ----------
        observed
            They were seen to break loose.
        """
        forces = self.released_forces(states, group)[:, 0]
        bound = self.group_bound(group, load)
        if observed:
            bound = -bound - self._observed_margin * self._group_limit(group, load)
        if forces.max() <= bound:
            return False
        self._let_slide(group, (1.0, -1.0)[int(forces.argmax())])
        return True

    def group_bound(self, group: JointGroup, load: Array) -> float:
        """Force along the first coordinate of a group that is rounding."""
        negligible = float(self._negligible()[group.joints[0]])
        return LIMIT_TOLERANCE * self._group_limit(group, load) + negligible

    def _group_limit(self, group: JointGroup, load: Array) -> float:
        """What holds a group at most, along its first coordinate."""
        limits = self.rest_speed * load
        return float(np.abs(group.ratios) @ limits[group.joints])

    @property
    def _observed_margin(self) -> float:
        """See `OBSERVED_SLIP`: at the instant that steps show, the constraints are
        closed once more, which moves what a joint holds by a part of the tolerance."""
        return max(OBSERVED_SLIP, self.rtol)

    def _negligible(self) -> Array:
        """Friction forces that are rounding, (n_frictions,).

        They change no rate in the whole run, or the acceleration of the joint is
        rounding beside those of the mechanism: an unloaded joint at rest, as an axis
        along the weight, bears rounding errors only.
        """
        mobility = np.maximum(self.memory.friction_P.diagonal(), np.finfo(float).tiny)
        rounding = ACCELERATION_ROUNDING * self.sliding_acceleration * self.span**2
        negligible = max(1.0, rounding / RESTING_RATE) * self.is_at_rest / self.span
        return np.asarray(negligible / mobility)

    def _slide(self, states: StatesOfMotion) -> Array:
        """Friction quantities (frictions, .) if all joints slide.

        Stores the largest acceleration then, relative to the sizes of coordinates
        [1/s^2]. Joints that stick at a dead point would ask for accelerations without
        bound.
        """
        slip_direction = self.friction_state[:, at.SLIP_DIRECTION]
        before = slip_direction.copy()
        slip_direction[(before == 0.0) & ~self.prescribed] = 1.0
        output = self.friction_output(*states)[0]
        slip_direction[:] = before
        largest = np.abs(self.memory.acceleration / self.sizes).max()
        self.sliding_acceleration = float(largest) if np.isfinite(largest) else 0.0
        return output

    def _release_together(self, states: StatesOfMotion, slow: Array) -> bool:
        """Lets go all that rests and holds one motion together, one way or the other.

        Where in sequence lets go, what the last of them holds may feed loads without
        bound, though the mechanism can move.
        """
        at_rest = np.flatnonzero(slow)
        if not len(at_rest) or not self._move_in_proportion(at_rest).all():
            return False
        signs = np.sign(self.memory.friction_P[at_rest[0], at_rest])
        for sign in (signs, -signs):
            self.friction_state[at_rest, at.SLIP_DIRECTION] = sign
            self._mark_shared()
            acceleration = self.friction_output(*states)[0][
                at_rest, OUTPUT_ACCELERATION
            ]
            if np.isfinite(acceleration).all() and (sign * acceleration > 0.0).all():
                return True
        return False

    def _joint_names(self, joints: Iterable[int]) -> tuple[str, ...]:
        return tuple(self.system.friction_joints[j].joint for j in joints)


def set_friction_states(system: System, t: Array, z: Array, v: Array) -> None:
    """Puts the friction states of known states into a system `with_friction_states`,
    from each time on.

    Parameters
    ----------
    t, z, v : (nt,)
        (nt, .), (nt, .).
    """
    if system.friction_history is None:
        return
    decision = StickSlipDecision(system)
    system.friction_history.clear()
    for t_k, position, velocity in zip(t, z, v, strict=True):
        decision.choose_states(float(t_k), position, velocity)
        system.friction_history.store(float(np.nextafter(t_k, -np.inf)))
