"""What a run asks of each flexible body, before it and after it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from formats.result import FlexibleBody
from formats.sid import SID, Array
from formats.stiffening import Stiffening

from .assembly import Start
from .bodies import frequencies, modal_squares, symmetric
from .body_loads import foreseen_loads, recorded_loads, turning_loads
from .energies import elastic_state
from .excitation import drive_history, excitation, fastest_rotation
from .prescribed import prescribed_frames, start_frame
from .sampling import Samples
from .scene import System
from .stiffening import largest_stiffening

#: Instants at which the deflection is looked at.
INSTANTS = 256


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
        amplitudes, shares = _contributions(sid, q)
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


def _contributions(sid: SID, q: Array) -> tuple[Array, Array]:
    """Largest |q| and elastic energy of each coordinate, see `FlexibleBody`."""
    largest = np.nanmax(np.abs(q), axis=0, initial=0.0)
    scaled = q / (largest.max() or 1.0)
    energies = scaled * (scaled @ symmetric(sid.Ke.m0))
    total = np.nanmax(energies.sum(axis=1), initial=0.0)
    return largest, np.nanmax(np.abs(energies), axis=0) / (total or 1.0)


def _worse(one: Stiffening, other: Stiffening) -> Stiffening:
    return max(one, other, key=lambda s: (s.diverges, abs(s.ratio)))


def _deflection(sid: SID, q: Array) -> float:
    """Largest displacement over the size of the body.

    Of the nodes that move most with a coordinate, at instants of large amplitudes.
    """
    size = _size(sid)
    if not sid.nodes or not size:
        return 0.0
    shapes = np.array([node.phi.m0 for node in sid.nodes])
    lengths = np.linalg.norm(shapes, axis=1)
    shapes = shapes[np.unique(lengths.argmax(axis=0))]
    bound = np.nan_to_num(np.abs(q) @ lengths.max(axis=0))
    rows = q[np.argsort(-bound)[:INSTANTS]]
    scale = np.nanmax(np.abs(rows), initial=0.0) or 1.0
    u = np.einsum("tl,nal->tna", rows / scale, shapes)
    return float(np.nanmax(np.linalg.norm(u, axis=2), initial=0.0) / size * scale)


def _size(sid: SID) -> float:
    """The largest extent of origin, centre of mass and nodes [m]."""
    places = [np.zeros(3), sid.mdCM.m0[:, 0] / (sid.mass or 1.0)]
    places += [node.position for node in sid.nodes]
    return float(np.linalg.norm(np.ptp(places, axis=0)))
