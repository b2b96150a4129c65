"""Work arrays and factors of one run; evaluation of one state from Python."""

from collections.abc import Callable

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.storage.cache import cached_by_identity

from ..compiler.tables import Table
from ..dynamics import control_laws, equations_of_motion
from ..dynamics.drives import function_values
from ..linear.block_factors import lapack_routines
from ..linear.factor_storage import ComplexFactors, Factors, Memory
from ..spatial import system_arrays as at
from ..spatial.dimension import FRAMES, MEAN_AXES, MODES, POINTS, STIFFENED_COORDINATE
from ..spatial.system_arrays import WorkArrays
from .body_data import squared_frequencies
from .force_rows import max_measures_read
from .sid_packing import elastic_mass, shape_functions, symmetrise
from .system import System

#: Weight of stiffness against mass in the metric of projections: radians of the slowest
#: mode of a body, if it had the mass of the heaviest body.
STIFFNESS_WEIGHT = 1e3
#: Eigenvalues below this part of the largest one are zero.
ZERO = 1e-12
#: Intermediate results of one body or marker.
MIN_SCRATCH = 32


def new_work_arrays(system: System) -> at.WorkArrays:
    """What kernels write, for one run of a system."""
    friction_work = system.cached_by_topology(_work_maker)()
    friction_work.phi[:] = system.cached_by_topology(_shape_functions)
    friction_work.M[:] = system.cached_by_topology(_elastic_masses)
    friction_work.force_scale[:] = 1.0
    return friction_work.replaced(
        row=np.zeros((system.n_rows, at.N_ROW)), friction_subsystem=friction_work
    )


def _work_maker(system: System) -> Callable[[], at.WorkArrays]:
    """Makes `WorkArrays` with the rows of coordinates with friction."""
    body, marker = system.arrays.body, system.arrays.marker
    blocks = int((body[:, at.NV] ** 2).sum())
    entries = segment_entries(system)
    largest = max(1, int(body[:, at.NV].max()))
    n_rotations = sum(len(rotation.angles) for rotation in system.rotations)
    n_measures = max_measures_read(system.forces)
    largest_nq, space = int(body[:, at.NQ].max()), system.space
    frame, point = FRAMES[space].record.size, POINTS[space].record.size
    n_friction = len(system.friction_joints)
    return at.WorkArrays.maker(
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
        row=(n_friction, at.N_ROW),
        rotation_counter=(n_rotations, at.N_ROTATION_STATE),
        measure=(len(system.forces), 2),
        force_scale=(len(system.forces),),
        law_derivative=(len(system.forces), 2),
        stack=(control_laws.STACK_DEPTH * (1 + 2 * n_measures),),
        law_failure=(control_laws.FAILURE_MEASURES + 2 * max(n_measures, 1),),
        interval_time=(1,),
        scratch=(max(2 * largest, MIN_SCRATCH),),
        modal_scratch=(MODES[space].record.size * largest_nq,),
        stiffened_scratch=(STIFFENED_COORDINATE[space].record.size * largest_nq,),
        rotation_scratch=(MEAN_AXES[space].record.size,),
        friction_force=(n_friction,),
        joint_load=(n_friction,),
        friction_limit_derivative=(n_friction, at.MAX_LOAD_ROWS),
        friction_subsystem=None,
    )


def segment_entries(system: System) -> int:
    """Stored entries of the constraint Jacobian and of the directions of forces."""
    arrays = system.arrays
    return int(arrays.body[arrays.newton_subsystem.segment[:, at.S_BODY], at.NV].sum())


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


def band_shape(rows: int, width: int) -> tuple[int, int]:
    """Shape of an array that holds a band matrix of so many rows.

    Kernels find entry [i, j] as in a full matrix, i times the length of a row and j
    after the first one. With rows as short as the band is wide, entry [i, j] stands
    where a later row has begun, but no two entries of the band share a place.

    Parameters
    ----------
    width
        Columns of the band beside the diagonal, on both sides together.
    """
    length = min(max(width, 1), rows)
    entries = (rows - 1) * length + rows
    return (-(-entries // length) if rows else 0), length


def new_memory(system: System, pairs: int) -> Memory:
    """Factors for a method with `pairs` complex eigenvalues."""
    memory = system.cached_by_topology(_memory_maker, pairs)()
    memory.metric[:] = system.cached(stiffness_metric)
    return memory


def _memory_maker(system: System, pairs: int) -> Callable[[], Memory]:
    body = system.arrays.body
    blocks = int((body[:, at.NV] ** 2).sum())
    entries, n, m = segment_entries(system), system.n_velocities, system.n_rows
    largest = int(body[:, at.NV].max())
    width, rows = system.arrays.newton_subsystem.bandwidth, system.n_newton_rows
    schur = band_shape(rows, 3 * width)
    frame, n_friction = FRAMES[system.space].record.size, len(system.friction_joints)

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
            lapack=lapack_routines(precision, largest),
        )

    return Memory.maker(
        real=factors(Factors, 1, "d"),
        complex=factors(ComplexFactors, pairs, "z"),
        mass_A=(blocks,),
        mass_W=(entries,),
        mass_S=band_shape(m, system.arrays.bandwidth),
        M=(blocks,),
        C=(entries,),
        frame=(len(body), frame),
        metric=(blocks,),
        acceleration=(n,),
        multiplier=(m,),
        dx=(n,),
        dmu=(m,),
        friction_X=(n_friction, n),
        friction_L=(n_friction, m),
        friction_P=(n_friction, n_friction + 3),
        friction_A=(n_friction, n_friction),
        friction_t=(n_friction,),
        friction_pivots=(n_friction,),
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
        slowest = _lowest_squared_frequency(sid)
        weight = STIFFNESS_WEIGHT**2 * share / slowest if slowest else 0.0
        return np.asarray(weight * symmetrise(sid.Ke.m0))

    return _elastic_blocks(system, metric)


@cached_by_identity
def _lowest_squared_frequency(sid: SID) -> float:
    """Square of the angular frequency of the slowest mode that deforms a body
    [rad2/s2], 0 if there is none."""
    squares = squared_frequencies(sid)
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


def evaluate(system: System, work: WorkArrays, t: float, z: Array, v: Array) -> None:
    """M, f, C and the constraints of eq. (3) at one state, into `work`."""
    at = equations_of_motion
    kernel = at.evaluate_in_plane if system.planar else at.evaluate_in_space
    kernel(system.arrays, work, t, z, v)
    raise_pending(system)


def raise_pending(system: System) -> None:
    """Raises what stopped a callable of a law while a kernel ran, as Ctrl-C does."""
    for native in system.natives:
        native.raise_pending()


def linearise(
    system: System,
    work: WorkArrays,
    t: float,
    z: Array,
    v: Array,
    acc: Array,
    lambda_: Array,
) -> None:
    """Derivatives of eq. (3) at the state that was just evaluated, into `work`."""
    at = equations_of_motion
    kernel = at.linearise_in_plane if system.planar else at.linearise_in_space
    kernel(system.arrays, work, t, z, v, acc, lambda_)


def complete_accelerations(system: System, work: WorkArrays, acc: Array) -> None:
    """Adds what z_II' contributes to the accelerations in `work`."""
    at = equations_of_motion
    kernel = at.complete_in_plane if system.planar else at.complete_in_space
    kernel(system.arrays, work, acc)


def function_history(
    system: System, row: int, interval_times: Array, times: Array
) -> Array:
    """Values and two derivatives (nt, 3) of a row of the table of functions.

    Parameters
    ----------
    interval_times : (nt,)
        Times inside the smooth intervals that the times count to, see `System.clocks`.
    """
    histories = np.zeros((len(times), 3))
    interval_times, times = (
        np.ascontiguousarray(interval_times),
        np.ascontiguousarray(times),
    )
    function_values(system.arrays, row, interval_times, times, histories)
    return histories
