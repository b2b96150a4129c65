"""What a run asks of each flexible body, before it and while it goes on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from sidtool.formats.result import FlexibleBody
from sidtool.formats.result.bodies import (
    LARGE,
    LARGE_ROTATION,
    MEANINGLESS,
    describe_deformation,
    limit_sentences,
)
from sidtool.formats.sid import SID, Array
from sidtool.formats.sid_mass import body_size
from sidtool.formats.stiffening import Stiffening

from ..recording.energies import elastic_state
from ..recording.sampling import Samples
from ..recording.told import Told
from ..space import layout as at
from ..start.assembly import Start
from ..system.bodies.vibration import frequencies, modal_squares
from ..system.scene import System
from .body_loads import foreseen_loads, recorded_loads
from .energy_shares import EnergyShares
from .excitation import drive_history, excitation
from .inertia import changes_of_inertia, is_stiffened, new_maxima
from .prescribed import prescribed_frames, start_frame
from .stiffening import largest_stiffening

#: Numbers that are computed together.
NUMBERS = 1 << 18


def expected_bodies(system: System, start: Start) -> dict[str, FlexibleBody]:
    """Frequencies, excitation and expected stiffening of all flexible bodies.

    start : the assembled start of the system
    """
    if not system.flexible:
        return {}
    history = system.once(drive_history)
    excited = excitation(system, history)
    frames = prescribed_frames(system, history)
    found: dict[str, FlexibleBody] = {}
    for data in system.flexible:
        frame = frames.get(data.name)
        if frame is None:
            frame = start_frame(system, start.z, start.v, data.name)
        loads = foreseen_loads(system, frame, history.times, data.name)
        expected = largest_stiffening(data.sid, loads, history.times)
        found[data.name] = FlexibleBody(
            highest_frequency(data.sid),
            excited,
            expected,
            labels=data.sid.labels,
            names=tuple(f"q{number}" for number in data.numbers),
        )
    return found


class Reached:
    """What flexible bodies met so far in a run.

    expected : what was said of them before
    """

    def __init__(self, system: System, expected: Mapping[str, FlexibleBody]) -> None:
        self.system, self.bodies = system, dict(expected)
        self._shares = {name: EnergyShares(self._sid(name)) for name in expected}

    def _sid(self, name: str) -> SID:
        return self.system.bodies[self.system.index(name)].sid

    def add(self, samples: Samples, times: Array) -> None:
        """Some states (nt,), in any order."""
        told = Told(self.system, samples, times)
        inertia = self._inertia(samples, times)
        for name, body in self.bodies.items() if len(times) else ():
            sid = self._sid(name)
            q, _ = elastic_state(self.system, samples, self.system.index(name))
            loads = recorded_loads(told, name)
            least = abs(body.found.ratio) if body.found else 0.0
            found = largest_stiffening(sid, loads, times, least)
            largest = np.nanmax(np.abs(q), axis=0, initial=0.0)
            self.bodies[name] = replace(
                body,
                found=_joined(body.found, replace(found, inertia=inertia[name])),
                amplitudes=np.maximum(body.amplitudes, largest)
                if body.found
                else largest,
                deflection=deflection(sid, q, body.deflection),
                rotation=elastic_rotation(sid, q, body.rotation),
            )

    def _inertia(self, samples: Samples, times: Array) -> dict[str, float]:
        """Changes of the inertia of all bodies where they deform as never before."""
        rows: dict[str, Array] = dict.fromkeys(self.bodies, np.zeros(0, int))
        for name, body in self.bodies.items() if len(times) else ():
            b = self.system.index(name)
            if is_stiffened(self.system, b):
                q, _ = elastic_state(self.system, samples, b)
                before = body.amplitudes if body.found else np.zeros(q.shape[1])
                rows[name] = new_maxima(q, before)
        return changes_of_inertia(self.system, rows, samples, times)

    def go_on(self, times: Array, z: Array) -> None:
        """The states after those of the last call, in the order of time."""
        for name, shares in self._shares.items():
            row = self.system.arrays.body[self.system.index(name)]
            end = int(row[at.POS] + row[at.NP])
            shares.add(times, z[:, end - int(row[at.NQ]) : end])

    def all(self) -> dict[str, FlexibleBody]:
        """With what is known of the whole run."""
        return {
            name: body
            if body.found is None
            else replace(
                body,
                frequencies=frequencies(self._sid(name)) / (2.0 * np.pi),
                energy_shares=self._shares[name].parts(),
            )
            for name, body in self.bodies.items()
        }


def highest_frequency(sid: SID) -> float:
    """Of the modes of (Ke, Me) [Hz]; of single coordinates if Me is no mass matrix."""
    return float(np.sqrt(max(modal_squares(sid)[-1], 0.0))) / (2.0 * np.pi)


def _worse(one: Stiffening, other: Stiffening) -> Stiffening:
    return max(one, other, key=lambda s: (s.diverges, abs(s.ratio)))


def _joined(before: Stiffening | None, found: Stiffening) -> Stiffening:
    """The worse one, with the largest change of inertia of both."""
    if before is None:
        return found
    largest = max(before.inertia, found.inertia)
    return replace(_worse(before, found), inertia=largest)


def deflection(sid: SID, q: Array, least: float) -> float:
    """Largest displacement of a node over the size of the body, `least` at least.

    q : (nt, nq)
    """
    size = body_size(sid)
    if not sid.nodes or not size:
        return 0.0
    shapes = np.array([node.phi.m0 for node in sid.nodes])
    return _largest(shapes, q, least * size) / size


def elastic_rotation(sid: SID, q: Array, least: float) -> float:
    """Largest rotation of a node by deformation, q (nt, nq), `least` at least [rad]."""
    if not sid.nodes:
        return 0.0
    return _largest(np.array([node.psi.m0 for node in sid.nodes]), q, least)


def bound_deformation(sid: SID, largest: Array) -> tuple[float, float]:
    """Bounds of `deflection` and `elastic_rotation` where |q| (nq,) is not exceeded."""
    size, bounds = body_size(sid), []
    for part in ("phi", "psi") if sid.nodes else ():
        shapes = np.array([getattr(node, part).m0 for node in sid.nodes])
        bounds.append(float((np.linalg.norm(shapes, axis=1) @ largest).max()))
    if not bounds:
        return 0.0, 0.0
    return (bounds[0] / size if size else 0.0), bounds[1]


def _largest(shapes: Array, q: Array, least: float) -> float:
    """Largest length of shapes (nodes, 3, nq) times q (nt, nq), `least` at least.

    The sum of |Phi_l| |q_l| bounds it: the largest bounds are looked at first.
    """
    lengths = np.linalg.norm(shapes, axis=1)
    bounds = np.zeros(len(q))
    for part in _parts(len(q), len(shapes)):
        bounds[part] = np.nan_to_num((np.abs(q[part]) @ lengths.T).max(axis=1))
    order, found = np.argsort(-bounds), least
    for part in _parts(len(q), shapes.size):
        rows = order[part]
        if bounds[rows[0]] <= found:
            break
        u = np.einsum("tl,nal->tna", q[rows], shapes)
        found = max(found, float(np.nanmax(np.linalg.norm(u, axis=2))))
    return found


def _parts(count: int, numbers: int) -> Iterator[slice]:
    """Rows in groups that are not large, of so many numbers each."""
    size = max(1, NUMBERS // max(numbers, 1))
    yield from (slice(first, first + size) for first in range(0, count, size))


def find_state_warnings(system: System, z: Array) -> tuple[str, ...]:
    """One sentence for each body beyond linear theory, the worst first.

    z : (nt, n positions) states
    """
    excess, sentences = {}, {}
    for name, (bent, turned) in _measure_deformations(system, z).items():
        excess[name] = max(bent / LARGE, turned / LARGE_ROTATION)
        sentences[name] = describe_deformation(name, bent, turned)
    order = sorted(excess, key=lambda name: -excess[name])
    return limit_sentences([(n, sentences[n]) for n in order if sentences[n]])


def find_state_failure(system: System, z: Array) -> str:
    """Why states z (nt, n positions) mean nothing; empty where they mean something."""
    found = _measure_deformations(system, z)
    worst = max(found, key=lambda name: found[name][0], default="")
    if not worst or not found[worst][0] > MEANINGLESS:
        return ""
    return (
        f"gives numbers without meaning: {describe_deformation(worst, *found[worst])}"
    )


def _measure_deformations(system: System, z: Array) -> dict[str, tuple[float, float]]:
    """Largest deflection over size, and largest elastic rotation [rad], by body."""
    found = {}
    for data in system.flexible if len(z) else ():
        row = system.arrays.body[system.index(data.name)]
        end = int(row[at.POS] + row[at.NP])
        q = z[:, end - int(row[at.NQ]) : end]
        bent = deflection(data.sid, q, 0.0), elastic_rotation(data.sid, q, 0.0)
        found[data.name] = bent
    return found
