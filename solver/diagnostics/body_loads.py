"""Loads of flexible bodies for geometric stiffening, and bounds of their deformation.

Before a run: the start and what drives prescribe. After it: the recorded states with
the forces of joints.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.geometric_stiffening import LoadStiffening
from sidtool.formats.result import FlexibleBody
from sidtool.formats.result.accuracy_report import (
    MAX_DEFLECTION,
    MAX_ROTATION,
    deformation_diagnostics,
    meaningless_body,
    worst_first,
)
from sidtool.formats.sid_mass import body_size
from sidtool.formats.storage.cache import cached_by_identity

from ..initial_state.assembly import StateVectors
from ..output.body_outputs import frame_motion
from ..output.energies import elastic_coordinates
from ..output.samples import EvaluatedForces, Samples
from ..spatial import system_arrays as at
from ..system.body_data import coordinate_frequencies, squared_frequencies
from ..system.rotated_markers import to_3d
from ..system.system import System
from ..system.work_arrays import function_history
from .excitation import (
    FrameHistory,
    drive_history,
    excitation,
    prescribed_frames,
    start_frame,
)
from .geometric_stiffening import (
    Loads,
    changes_of_inertia,
    has_stiffened_inertia,
    largest_stiffening,
    rows_of_new_maxima,
)
from .vibration import EnergyShares

#: Numbers that are computed together.
MAX_NUMBERS = 1 << 18


def recorded_loads(evaluated: EvaluatedForces, body: str) -> Loads:
    """Loads of a flexible body at recorded states."""
    system, samples = evaluated.system, evaluated.samples
    b = system.index(body)
    frame = frame_motion(system, samples, b)
    of = system.frames(samples.frames[:, b])
    a, alpha = to_3d(of["a"]), to_3d(of["al"])
    a = a - np.einsum("tji,j->ti", frame.R, system.arrays.gravity)
    forces: dict[str, Array] = {}
    moments: dict[str, Array] = {}
    for marker, force, moment in _body_wrenches(evaluated, body):
        node = system.bodies[b].node(marker)
        for store, vector, m1 in (
            (forces, force, node.phi.m1),
            (moments, moment, node.psi.m1),
        ):
            if m1 is not None and m1.any():
                local = np.einsum("tji,tj->ti", frame.R, vector)
                store[node.id] = store.get(node.id, 0.0) + local
    return Loads(frame.W, a, alpha, forces, moments)


def expected_loads(
    system: System, frame: FrameHistory, times: Array, body: str
) -> Loads:
    """Loads of a body by the motion of its frame, gravity and given forces.

    Parameters
    ----------
    frame
        Motion at the times (nt,), or at one time that stands for all of them.
    """
    acting = list(_expected_forces(system, frame, times, body))
    if len(frame.w) == 1 and any(len(force) > 1 for _, force, _ in acting):
        frame = frame.repeated(len(times))
    forces: dict[str, Array] = {}
    moments: dict[str, Array] = {}
    nothing = np.zeros_like(frame.w)
    for node, force, moment in acting:
        forces[node] = forces.get(node, nothing) + force
        moments[node] = moments.get(node, nothing) + moment
    gravity = np.einsum("tji,j->ti", frame.R, system.arrays.gravity)
    return Loads(frame.w, frame.a - gravity, frame.alpha, forces, moments)


def _expected_forces(
    system: System, frame: FrameHistory, times: Array, body: str
) -> Iterator[tuple[str, Array, Array]]:
    """Node, force and moment (nt or 1, 3) in body axes of the given forces."""
    for element in system.forces:
        if element.kind > at.FOLLOWER_LOAD or element.b[0] != body or element.code:
            continue
        node = system.bodies[system.index(body)].node(element.b[1])
        factor = np.ones((1, 1))
        if element.function >= 0:
            factor = _function_values(system, element.function, times)[:, None]
        pair = _components(system.planar, element.data)
        if element.kind == at.FOLLOWER_LOAD:
            force, moment = (factor * (node.AP.m0 @ vector) for vector in pair)
        else:
            force, moment = (
                factor * np.einsum("tji,j->ti", frame.R, vector) for vector in pair
            )
        yield node.id, force, moment


def _components(planar: bool, data: tuple[float, ...]) -> tuple[Array, Array]:
    """Force and moment, (3,) each, of the data of a given force."""
    if planar:
        return np.array([*data[:2], 0.0]), np.array([0.0, 0.0, data[2]])
    return np.array(data[:3]), np.array(data[3:])


def _function_values(system: System, function: int, times: Array) -> Array:
    """Values (nt,) of a row of the table of functions."""
    return function_history(system, function, system.clocks(times), times)[:, 0]


def has_force_stiffening(sid: SID) -> bool:
    """Does a node carry stiffening by a force or a moment?"""
    terms = [term.m1 for node in sid.nodes for term in (node.phi, node.psi)]
    return any(m1 is not None and m1.any() for m1 in terms)


def _body_wrenches(
    evaluated: EvaluatedForces, body: str
) -> Iterator[tuple[str, Array, Array]]:
    """Marker, force and moment in inertial axes, of all that acts on a body."""
    system = evaluated.system
    if not has_force_stiffening(system.bodies[system.index(body)].sid):
        return
    for (on, marker), m in system.markers.items():
        if on == body:
            total = evaluated.wrench(m)
            yield marker, total[:, :3], total[:, 3:]


def expected_bodies(system: System, start: StateVectors) -> dict[str, FlexibleBody]:
    """Frequencies, excitation and expected stiffening of all flexible bodies.

    Parameters
    ----------
    start
        The assembled start of the system.
    """
    if not system.flexible:
        return {}
    history = system.cached(drive_history)
    excited = excitation(system, history)
    frames = prescribed_frames(system, history)
    bodies: dict[str, FlexibleBody] = {}
    for data in system.flexible:
        frame = frames.get(data.name)
        if frame is None:
            frame = start_frame(system, start.z, start.v, data.name)
        loads = expected_loads(system, frame, history.times, data.name)
        expected = largest_stiffening(data.sid, loads, history.times)
        bodies[data.name] = FlexibleBody(
            highest_frequency(data.sid),
            excited,
            expected,
            labels=data.sid.labels,
            names=tuple(f"q{number}" for number in data.coordinate_numbers),
        )
    return bodies


class LoadExtrema:
    """What flexible bodies met so far in a run.

    Attributes
    ----------
    expected
        What was said of them before.
    """

    def __init__(self, system: System, expected: Mapping[str, FlexibleBody]) -> None:
        self.system, self.bodies = system, dict(expected)
        self._shares = {name: EnergyShares(self._sid(name)) for name in expected}

    def _sid(self, name: str) -> SID:
        return self.system.bodies[self.system.index(name)].sid

    def add(self, samples: Samples, times: Array) -> None:
        """Some states (nt,), in any order."""
        evaluated = EvaluatedForces(self.system, samples, times)
        inertia = self._inertia_changes(samples, times)
        for name, body in self.bodies.items() if len(times) else ():
            sid = self._sid(name)
            q, _ = elastic_coordinates(self.system, samples, self.system.index(name))
            loads = recorded_loads(evaluated, name)
            least = abs(body.found.ratio) if body.found else 0.0
            stiffness = largest_stiffening(sid, loads, times, least)
            largest = np.nanmax(np.abs(q), axis=0, initial=0.0)
            self.bodies[name] = replace(
                body,
                found=_combine_stiffening(
                    body.found, replace(stiffness, inertia=inertia[name])
                ),
                amplitudes=np.maximum(body.amplitudes, largest)
                if body.found
                else largest,
                deflection=relative_deflection(sid, q, body.deflection),
                rotation=largest_elastic_rotation(sid, q, body.rotation),
            )

    def _inertia_changes(self, samples: Samples, times: Array) -> dict[str, float]:
        """Changes of the inertia of all bodies where they deform as never before."""
        rows: dict[str, Array] = dict.fromkeys(self.bodies, np.zeros(0, int))
        for name, body in self.bodies.items() if len(times) else ():
            b = self.system.index(name)
            if has_stiffened_inertia(self.system, b):
                q, _ = elastic_coordinates(self.system, samples, b)
                before = body.amplitudes if body.found else np.zeros(q.shape[1])
                rows[name] = rows_of_new_maxima(q, before)
        return changes_of_inertia(self.system, rows, samples, times)

    def start_after(self, times: Array, z: Array) -> None:
        """The states after those of the last call, in the order of time."""
        for name, shares in self._shares.items():
            row = self.system.arrays.body[self.system.index(name)]
            end = int(row[at.POS] + row[at.NP])
            shares.add(times, z[:, end - int(row[at.NQ]) : end])

    def results(self) -> dict[str, FlexibleBody]:
        """With what is known of the whole run."""
        return {
            name: body
            if body.found is None
            else replace(
                body,
                frequencies=coordinate_frequencies(self._sid(name)) / (2.0 * np.pi),
                energy_shares=self._shares[name].shares(),
            )
            for name, body in self.bodies.items()
        }


def highest_frequency(sid: SID) -> float:
    """Of the modes of (Ke, Me) [Hz]; of single coordinates if Me is no mass matrix."""
    return float(np.sqrt(max(squared_frequencies(sid)[-1], 0.0))) / (2.0 * np.pi)


def _larger_stiffening(one: LoadStiffening, other: LoadStiffening) -> LoadStiffening:
    return max(one, other, key=lambda s: (s.diverges, abs(s.ratio)))


def _combine_stiffening(
    before: LoadStiffening | None, new: LoadStiffening
) -> LoadStiffening:
    """The worse one, with the largest change of inertia of both."""
    if before is None:
        return new
    largest = max(before.inertia, new.inertia)
    return replace(_larger_stiffening(before, new), inertia=largest)


def relative_deflection(sid: SID, q: Array, least: float) -> float:
    """Largest displacement of a node, or of the centre of mass, over the size of the
    body, `least` at least.

    Parameters
    ----------
    q : (nt, nq)
    """
    size = body_size(sid)
    if not size:
        return 0.0
    return _largest_displacement(_shapes(sid, "phi"), q, least * size) / size


def _shapes(sid: SID, part: str) -> Array:
    """Displacements ("phi") of nodes and centre of mass, or rotations ("psi") of nodes,
    (n, 3, nq). A blade may have one node, at its root, which does not move."""
    nodes = [np.asarray(getattr(node, part).m0) for node in sid.nodes]
    if part == "phi" and sid.mass > 0.0:
        nodes.append(sid.Ct.m0.T / sid.mass)
    return np.array(nodes).reshape(-1, 3, sid.nq)


@cached_by_identity
def _shape_lengths(sid: SID, part: str) -> Array:
    """(n, nq) lengths of `_shapes`."""
    return np.asarray(np.linalg.norm(_shapes(sid, part), axis=1))


def largest_elastic_rotation(sid: SID, q: Array, least: float) -> float:
    """Largest rotation of a node by deformation, q (nt, nq), `least` at least [rad]."""
    if not sid.nodes:
        return 0.0
    return _largest_displacement(
        np.array([node.psi.m0 for node in sid.nodes]), q, least
    )


def deformation_bounds(sid: SID, largest: Array) -> tuple[float, float]:
    """Bounds of `relative_deflection` and `largest_elastic_rotation` where |q| (nq,) is
    not exceeded.
    """
    size = body_size(sid)
    moved, turned = (
        float((_shape_lengths(sid, part) @ largest).max(initial=0.0))
        for part in ("phi", "psi")
    )
    return (moved / size if size else 0.0), turned


@dataclass(frozen=True, eq=False)
class DeformationLimit:
    """Limits of linear theory of one body, as bounds of its elastic coordinates.

    Attributes
    ----------
    coordinates : of the body in z
    weights : (n, nq) deflections and rotations over the limits of `MAX_DEFLECTION` and
        `MAX_ROTATION`, for unit coordinates
    """

    coordinates: slice
    weights: Array

    def may_exceed(self, z: Array) -> bool:
        """True if the body may be beyond linear theory; False is certain."""
        return bool((self.weights @ np.abs(z[self.coordinates])).max() > 1.0)


def deformation_limits(system: System) -> list[DeformationLimit]:
    """Limits of linear theory of all flexible bodies with nodes."""
    limits = []
    for data in system.flexible:
        most = {"phi": MAX_DEFLECTION * body_size(data.sid), "psi": MAX_ROTATION}
        weights = [
            _shape_lengths(data.sid, part) / size for part, size in most.items() if size
        ]
        if not any(map(len, weights)):
            continue
        row = system.arrays.body[system.index(data.name)]
        end = int(row[at.POS] + row[at.NP])
        coordinates = slice(end - int(row[at.NQ]), end)
        limits.append(DeformationLimit(coordinates, np.concatenate(weights)))
    return limits


def _largest_displacement(shapes: Array, q: Array, least: float) -> float:
    """Largest length of shapes (nodes, 3, nq) times q (nt, nq), `least` at least.

    The sum of |Phi_l| |q_l| bounds it: the largest bounds are looked at first.
    """
    lengths = np.linalg.norm(shapes, axis=1)
    bounds = np.zeros(len(q))
    for part in _row_groups(len(q), len(shapes)):
        bounds[part] = np.nan_to_num((np.abs(q[part]) @ lengths.T).max(axis=1))
    order, largest = np.argsort(-bounds), least
    for part in _row_groups(len(q), shapes.size):
        rows = order[part]
        if bounds[rows[0]] <= largest:
            break
        u = np.einsum("tl,nal->tna", q[rows], shapes)
        largest = max(largest, float(np.nanmax(np.linalg.norm(u, axis=2))))
    return largest


def _row_groups(count: int, numbers: int) -> Iterator[slice]:
    """Rows in groups that are not large, of so many numbers each."""
    size = max(1, MAX_NUMBERS // max(numbers, 1))
    yield from (slice(first, first + size) for first in range(0, count, size))


def find_state_warnings(system: System, z: Array) -> tuple[Diagnostic, ...]:
    """Bodies beyond linear theory, the worst first (N411, N413).

    Parameters
    ----------
    z : (nt, n positions)
        States.
    """
    measured = _measure_deformations(system, z)
    found = {n: deformation_diagnostics(n, *sizes) for n, sizes in measured.items()}
    excess = {
        name: max(deflection_ / MAX_DEFLECTION, rotation / MAX_ROTATION)
        for name, (deflection_, rotation) in measured.items()
    }
    return worst_first(found, excess)


def find_state_failure(system: System, z: Array) -> tuple[Diagnostic, ...]:
    """Why states z (nt, n positions) mean nothing (N414), if so."""
    measured = _measure_deformations(system, z)
    return meaningless_body({name: sizes[0] for name, sizes in measured.items()})


def _measure_deformations(system: System, z: Array) -> dict[str, tuple[float, float]]:
    """Largest deflection over size, and largest elastic rotation [rad], by body."""
    deformations = {}
    for data in system.flexible if len(z) else ():
        row = system.arrays.body[system.index(data.name)]
        end = int(row[at.POS] + row[at.NP])
        q = z[:, end - int(row[at.NQ]) : end]
        deformation = (
            relative_deflection(data.sid, q, 0.0),
            largest_elastic_rotation(data.sid, q, 0.0),
        )
        deformations[data.name] = deformation
    return deformations
