"""What a run asks of each flexible body, before it and after it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sidtool.formats.result import FlexibleBody
from sidtool.formats.sid import SID, Array
from sidtool.formats.stiffening import Stiffening

from ..recording.energies import deformation_energies, elastic_state
from ..recording.sampling import Samples
from ..start.assembly import Start
from ..system.bodies import body_size, frequencies, modal_squares
from ..system.scene import System
from .body_loads import foreseen_loads, recorded_loads, turning_loads
from .excitation import drive_history, excitation, fastest_rotation
from .prescribed import prescribed_frames, start_frame
from .stiffening import largest_stiffening

#: Instants whose deflections are computed together.
INSTANTS = 64


def expected_bodies(system: System, start: Start) -> dict[str, FlexibleBody]:
    """Frequencies, excitation and expected stiffening of all flexible bodies.

    start : the assembled start of the system
    """
    flexible = [data for data in system.bodies if data.sid.nq]
    if not flexible:
        return {}
    history = drive_history(system)
    excited = excitation(system, history)
    frames = prescribed_frames(system, history)
    rate, drive = fastest_rotation(system, history)
    found: dict[str, FlexibleBody] = {}
    for data in flexible:
        frame = frames.get(data.name)
        if frame is None:
            frame = start_frame(system, start.z, start.v, data.name)
        loads = foreseen_loads(system, frame, history.times, data.name)
        expected = largest_stiffening(data.sid, loads, history.times)
        if data.name not in frames and rate:
            guess = _if_it_turned(system, data.sid, rate, drive)
            expected = _worse(expected, guess)
        found[data.name] = FlexibleBody(
            highest_frequency(data.sid), excited, expected, labels=data.sid.labels
        )
    return found


def _if_it_turned(system: System, sid: SID, rate: float, drive: str) -> Stiffening:
    """Stiffening of a body that turns as fast as the fastest drive."""
    loads = turning_loads(rate, system.planar)
    times = np.full(len(loads.angular_velocity), system.scene.time.start)
    guess = largest_stiffening(sid, loads, times)
    return replace(guess, condition=drive, diverges=False)


def reached_bodies(
    system: System, samples: Samples, times: Array, expected: Mapping[str, FlexibleBody]
) -> dict[str, FlexibleBody]:
    """The same with what the recorded states tell, (nt,) `times`."""
    found = dict(expected)
    if len(times) == 0:
        return found
    for name, body in expected.items():
        b = system.index(name)
        sid = system.bodies[b].sid
        q, _ = elastic_state(system, samples, b)
        loads = recorded_loads(system, samples, times, name)
        amplitudes, shares = _contributions(sid, q, times)
        found[name] = replace(
            body,
            found=largest_stiffening(sid, loads, times),
            frequencies=frequencies(sid) / (2.0 * np.pi),
            amplitudes=amplitudes,
            energy_shares=shares,
            deflection=_deflection(sid, q),
        )
    return found


def highest_frequency(sid: SID) -> float:
    """Of the modes of (Ke, Me) [Hz]; of single coordinates if Me is no mass matrix."""
    return float(np.sqrt(max(modal_squares(sid)[-1], 0.0))) / (2.0 * np.pi)


def _contributions(sid: SID, q: Array, times: Array) -> tuple[Array, Array]:
    """Largest |q| of each coordinate and its part of the energy, see `FlexibleBody`."""
    largest = np.nanmax(np.abs(q), axis=0, initial=0.0)
    weights = np.gradient(times) if len(times) > 1 else np.ones(1)
    size = float(largest.max()) or 1.0
    scaled = deformation_energies(sid, q / size, size)
    energies = np.nansum(weights[:, None] * scaled, axis=0)
    return largest, energies / (energies.sum() or 1.0)


def _worse(one: Stiffening, other: Stiffening) -> Stiffening:
    return max(one, other, key=lambda s: (s.diverges, abs(s.ratio)))


def _deflection(sid: SID, q: Array) -> float:
    """Largest displacement of a node over the size of the body.

    The sum of |Phi_l| |q_l| bounds it: the largest bounds are looked at first.
    """
    size = body_size(sid)
    if not sid.nodes or not size:
        return 0.0
    shapes = np.array([node.phi.m0 for node in sid.nodes])
    lengths = np.linalg.norm(shapes, axis=1)
    bounds = np.nan_to_num((np.abs(q) @ lengths.T).max(axis=1))
    order, found = np.argsort(-bounds), 0.0
    for first in range(0, len(order), INSTANTS):
        rows = order[first : first + INSTANTS]
        if bounds[rows[0]] <= found:
            break
        u = np.einsum("tl,nal->tna", q[rows], shapes)
        found = max(found, float(np.nanmax(np.linalg.norm(u, axis=2))))
    return found / size
