"""Bodies and links of a result as one mesh, and its points at each output time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.field import Field
from sidtool.formats.progress import counted
from sidtool.formats.result import Result
from sidtool.formats.sid import Array
from sidtool.formats.stress import von_mises
from sidtool.solver.afterwards import replay
from sidtool.solver.recording.energies import elastic_state
from sidtool.solver.recording.motion import FrameMotion, frame_motion

from .companions import Given, companions
from .drawn_bodies import drawn_bodies
from .links import Anchor, Link
from .played import played

Indices = NDArray[np.int64]
#: Kinds of elements -> numbers of VTK, which orders their nodes alike.
VTK_CELLS = {
    "line2": 3,
    "tri3": 5,
    "tri6": 22,
    "quad4": 9,
    "quad8": 23,
    "tet4": 10,
    "tet10": 24,
    "hex8": 12,
    "hex20": 25,
    "wedge6": 13,
    "wedge15": 26,
    "pyramid5": 14,
    "pyramid13": 27,
}


@dataclass(frozen=True, eq=False)
class Part:
    """One body: its points in the body frame, cells, and motion at nt times.

    frame : of the body
    q, rates : (nt, nq) elastic coordinates and their rates
    """

    name: str
    positions: Array
    cells: Mapping[str, Indices]
    shapes: Array
    stress: Array | None
    initial_stress: Array
    frame: FrameMotion
    q: Array
    rates: Array
    source: str

    def at(self, k: int) -> dict[str, Array]:
        """Points and what is known at them at time k; in inertial axes but stresses,
        which are in those of the body and NaN where they are not known."""
        R, q = self.frame.R[k], self.q[k]
        moved = self.shapes @ q
        local = self.positions + moved
        speed = self.frame.V[k] + np.cross(self.frame.W[k], local)
        speed = speed + self.shapes @ self.rates[k]
        stress = np.full((len(local), 6), np.nan)
        if self.stress is not None:
            stress = self.initial_stress + self.stress @ q
        return {
            "points": self.frame.X[k] + local @ R.T,
            "displacement": moved @ R.T,
            "velocity": speed @ R.T,
            "stress": stress,
            "von_mises": von_mises(stress),
        }


@dataclass(frozen=True, eq=False)
class Line:
    """A spring, damper, actuator or rod: a line between two markers.

    ends : parts of one point each, which move as the bodies of the markers
    """

    name: str
    ends: tuple[Part, Part]
    cells: Mapping[str, Indices]
    source: str

    @property
    def positions(self) -> Array:
        """(2, 3), each in the frame of its own body."""
        return np.concatenate([end.positions for end in self.ends])

    def at(self, k: int) -> dict[str, Array]:
        """See `Part.at`; displacements are those of the markers."""
        a, b = (end.at(k) for end in self.ends)
        return {name: np.concatenate([a[name], b[name]]) for name in a}


@dataclass(frozen=True, eq=False)
class Exported:
    """All bodies and links with their points one after another.

    connectivity, offsets, types : cells as VTK has them
    body : number of the body of every cell; links are numbered behind the bodies
    """

    t: Array
    parts: tuple[Part | Line, ...]
    connectivity: Indices
    offsets: Indices
    types: NDArray[np.uint8]
    body: Indices
    told: tuple[str, ...]

    @property
    def n_points(self) -> int:
        return sum(len(part.positions) for part in self.parts)

    def steps(self) -> Iterator[dict[str, Array]]:
        """`Part.at` of all bodies together, time by time."""
        for k in counted(range(len(self.t)), "writing times"):
            found = [part.at(k) for part in self.parts]
            yield {name: np.concatenate([f[name] for f in found]) for name in found[0]}


def exported(
    result: Result, fields: Given | None = None, folder: Path | None = None
) -> Exported:
    """The bodies of a result: flexible ones by all cells of their full field where it
    is known, else as they are drawn; and springs, dampers, actuators and rods between
    markers as lines.

    Raises
    ------
    InputError : the result does not hold its scene, or a field is not that of its SID.
    """
    again = replay(result)
    system, samples = again.system, again.samples()
    folders = [folder or Path("."), Path(".")]
    known, told = companions(system.scene, result.sids, fields or {}, folders)
    seen = played(result, times=again.t, folders=folders)
    rows = {data.name: b for b, data in enumerate(system.bodies)}
    parts: list[Part | Line] = []
    for drawn in drawn_bodies(system.scene, system.bodies, known, seen.size, folders):
        b = rows[drawn.name]
        q, rates = elastic_state(system, samples, b)
        positions, cells = drawn.positions, {"tri3": drawn.triangles}
        shapes, stress, initial = drawn.shapes, drawn.stress, drawn.initial_stress
        field = known.get(drawn.name)
        if field is not None and field.cells:
            positions, cells = field.positions, dict(field.cells)
            shapes, initial = field.shapes[..., : q.shape[1]], field.initial_stress
            stress = None if field.stress is None else field.stress[..., : q.shape[1]]
        motion = frame_motion(system, samples, b)
        parts.append(
            Part(
                drawn.name,
                positions,
                cells,
                shapes,
                stress,
                initial,
                motion,
                q,
                rates,
                drawn.source,
            )
        )
    by_name = {part.name: part for part in parts if isinstance(part, Part)}
    parts += [_line(link, by_name, len(again.t)) for link in seen.links]
    told += [f"{p.name} is {_what(p, known)}" for p in parts]
    return Exported(again.t, tuple(parts), *_cells(parts), tuple(told))


def _line(link: Link, bodies: Mapping[str, Part], count: int) -> Line:
    """A link between the points that its ends are fixed to, at `count` times."""
    a, b = (_point(end, bodies.get(end.body), count) for end in link.ends)
    cells = {"line2": np.array([[0, 1]], np.int64)}
    return Line(link.name, (a, b), cells, f"a line, the {link.kind}")


def _point(end: Anchor, body: Part | None, count: int) -> Part:
    """A point of a body, or of the ground."""
    if body is None:
        zero, still = np.zeros((count, 3)), np.zeros((count, 0))
        turns = np.tile(np.eye(3), (count, 1, 1))
        frame, q, rates = FrameMotion(zero, turns, zero, zero), still, still
    else:
        frame, q, rates = body.frame, body.q, body.rates
    return Part(
        name=end.body,
        positions=end.position[None],
        cells={},
        shapes=end.shapes[None, :, : q.shape[1]],
        stress=None,
        initial_stress=np.zeros((1, 6)),
        frame=frame,
        q=q,
        rates=rates,
        source="",
    )


def _what(part: Part | Line, known: Mapping[str, Field]) -> str:
    if part.name in known and known[part.name].cells:
        count = sum(map(len, part.cells.values()))
        return f"the {count} cells of its full field"
    return part.source


def _cells(
    parts: Sequence[Part | Line],
) -> tuple[Indices, Indices, NDArray[np.uint8], Indices]:
    connectivity, sizes, types, owners, first = [], [], [], [], 0
    for number, part in enumerate(parts):
        for kind, nodes in part.cells.items():
            connectivity.append((nodes + first).ravel())
            sizes.append(np.full(len(nodes), nodes.shape[1]))
            types.append(np.full(len(nodes), VTK_CELLS[kind], np.uint8))
            owners.append(np.full(len(nodes), number))
        first += len(part.positions)
    offsets = np.concatenate([[0], np.cumsum(np.concatenate(sizes))])
    return (
        np.concatenate(connectivity).astype(np.int64),
        offsets.astype(np.int64),
        np.concatenate(types),
        np.concatenate(owners).astype(np.int64),
    )
