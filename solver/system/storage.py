"""Work arrays of one run."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sidtool.formats.sid import SID, Array
from sidtool.formats.storage.kept import kept

from ..compiler.tables import Table
from ..equations.forces import programs
from ..linear.lapack import lapack
from ..linear.memory import ComplexFactors, Factors, Memory
from ..space import layout as at
from ..space.spaces import FRAMES, MODES, POINTS, STIFFENED, TURNING
from .bodies.packing import elastic_mass, shape_functions, symmetric
from .bodies.vibration import modal_squares
from .forces.elements import most_read
from .scene import System

#: Weight of stiffness against mass in the metric of projections: radians of the slowest
#: mode of a body, if it had the mass of the heaviest body.
STIFFER = 1e3
#: Eigenvalues below this part of the largest one are zero.
ZERO = 1e-12
#: Intermediate results of one body or marker.
SCRATCH = 32


def new_work(system: System) -> at.Work:
    """What kernels write, for one run of a system."""
    sliding = system.lasting(_work)()
    sliding.phi[:] = system.lasting(_shape_functions)
    sliding.M[:] = system.lasting(_elastic_masses)
    sliding.factor[:] = 1.0
    return sliding.replaced(row=np.zeros((system.n_rows, at.N_ROW)), sliding=sliding)


def _work(system: System) -> Callable[[], at.Work]:
    """Makes `Work` with the rows of coordinates with friction."""
    body, marker = system.arrays.body, system.arrays.marker
    blocks = int((body[:, at.NV] ** 2).sum())
    entries = segment_entries(system)
    largest = max(1, int(body[:, at.NV].max()))
    turns = sum(len(turn.angles) for turn in system.turns)
    read = most_read(system.forces)
    most, space = int(body[:, at.NQ].max()), system.space
    frame, point = FRAMES[space].record.size, POINTS[space].record.size
    rubbing = len(system.rubbing)
    return at.Work.maker(
        frame=(len(body), frame),
        point=(len(marker), point),
        phi=(system.arrays.n_phi,),
        M=(blocks,),
        Rp=(blocks,),
        Rv=(blocks,),
        f=(system.n_velocities,),
        C=(entries,),
        Gp=(entries,),
        Gv=(entries,),
        row=(rubbing, at.N_ROW),
        turn=(turns, at.N_TURNED),
        measure=(len(system.forces), 2),
        factor=(len(system.forces),),
        slope=(len(system.forces), 2),
        stack=(programs.DEPTH * (1 + 2 * read),),
        lapse=(programs.LAPSED_MEASURES + 2 * read,),
        clock=(1,),
        scratch=(max(2 * largest, SCRATCH),),
        modal=(MODES[space].record.size * most,),
        stiffened=(STIFFENED[space].record.size * most,),
        turning=(TURNING[space].record.size,),
        rub=(rubbing,),
        load=(rubbing,),
        rubbing=(rubbing, at.MOST_LOADS),
        sliding=None,
    )


def segment_entries(system: System) -> int:
    """Stored entries of the constraint Jacobian and of the directions of forces."""
    arrays = system.arrays
    return int(arrays.body[arrays.newton.segment[:, at.S_BODY], at.NV].sum())


def _shape_functions(system: System) -> Array:
    """Phi and Psi of all markers at q = 0."""
    arrays = system.arrays
    phi = np.zeros(arrays.n_phi)
    for (body, name), m in system.markers.items():
        data = system.bodies[arrays.marker[m, at.M_BODY]]
        assert data.name == body
        values = shape_functions(data.node(name), system.planar).ravel()
        start = arrays.marker[m, at.M_PHI]
        phi[start : start + len(values)] = values
    return phi


def band(rows: int, width: int) -> tuple[int, int]:
    """Shape of an array that holds a band matrix of so many rows.

    width : columns of the band beside the diagonal, on both sides together

    Kernels find entry [i, j] as in a full matrix, i times the length of a row and j
    after the first one. With rows as short as the band is wide, entry [i, j] stands
    where a later row has begun, but no two entries of the band share a place.
    """
    length = min(max(width, 1), rows)
    entries = (rows - 1) * length + rows
    return (-(-entries // length) if rows else 0), length


def new_memory(system: System, pairs: int) -> Memory:
    """Factors for a method with `pairs` complex eigenvalues."""
    memory = system.lasting(_memory, pairs)()
    memory.metric[:] = system.once(stiffness_metric)
    return memory


def _memory(system: System, pairs: int) -> Callable[[], Memory]:
    body = system.arrays.body
    blocks = int((body[:, at.NV] ** 2).sum())
    entries, n, m = segment_entries(system), system.n_velocities, system.n_rows
    largest = int(body[:, at.NV].max())
    width, rows = system.arrays.newton.bandwidth, system.n_newton_rows
    schur = band(rows, 3 * width)
    frame, rubbing = FRAMES[system.space].record.size, len(system.rubbing)

    def factors(kind: type[Table], systems: int, precision: str) -> Callable[[], Table]:
        return kind.maker(
            A=(systems, blocks),
            G=(systems, entries),
            Y=(systems, entries),
            S=(systems, *schur),
            pivots=(systems, n + len(body)),
            row_pivots=(systems, rows),
            x=(n,),
            p=(n,),
            g=(rows,),
            lapack=lapack(precision, largest),
        )

    return Memory.maker(
        real=factors(Factors, 1, "d"),
        complex=factors(ComplexFactors, pairs, "z"),
        mass_A=(blocks,),
        mass_W=(entries,),
        mass_S=band(m, system.arrays.bandwidth),
        M=(blocks,),
        C=(entries,),
        frame=(len(body), frame),
        metric=(blocks,),
        acceleration=(n,),
        multiplier=(m,),
        dx=(n,),
        dmu=(m,),
        rub_X=(rubbing, n),
        rub_L=(rubbing, m),
        rub_P=(rubbing, rubbing + 2),
        rub_A=(rubbing, rubbing),
        rub_t=(rubbing,),
        rub_pivots=(rubbing,),
    )


def _elastic_masses(system: System) -> Array:
    """Blocks of M that do not depend on the state."""
    return _elastic_blocks(system, elastic_mass)


def stiffness_metric(system: System) -> Array:
    """tau^2 Ke of all bodies, so large that deforming it costs more than moving others.

    It depends neither on units nor on the basis of the shape functions, nor on the
    density of the body.
    """
    heaviest = max(data.sid.mass for data in system.bodies)

    def metric(sid: SID) -> Array:
        share = heaviest / sid.mass if sid.mass > 0.0 else 1.0
        slowest = _slowest(sid)
        weight = STIFFER**2 * share / slowest if slowest else 0.0
        return np.asarray(weight * symmetric(sid.Ke.m0))

    return _elastic_blocks(system, metric)


@kept
def _slowest(sid: SID) -> float:
    """Square of the angular frequency of the slowest mode that deforms a body
    [rad2/s2], 0 if there is none."""
    squares = modal_squares(sid)
    return float(min(squares[squares > ZERO * squares.max(initial=0.0)], default=0.0))


def _elastic_blocks(system: System, matrix: Callable[[SID], Array]) -> Array:
    """A matrix of each SID in the elastic part of the block of its body."""
    values = np.zeros(int((system.arrays.body[:, at.NV] ** 2).sum()))
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        nv, rd, start = row[at.NV], row[at.RD], row[at.BLOCK]
        if data.sid.nq == 0 or nv == 0:
            continue
        block = values[start : start + nv * nv].reshape(nv, nv)
        block[rd:, rd:] = matrix(data.sid)
    return values
