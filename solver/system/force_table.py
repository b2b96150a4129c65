"""Forces of a scene as rows of the force table; bushings become several rows.

To add a kind of force, add an entry to `_COMPILERS`.

Forces F = -K g - D g' on several measures g of two markers, with full matrices.

The symmetric parts are sums of products w w^T: each is a spring or damper on the
weighted sum w g of the measures, so that its energy is known. The antisymmetric rest of
K and D has no potential and is a law that reads the measures.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    Actuator,
    Bushing,
    Expression,
    Force,
    Friction,
    Given,
    Pid,
    PointForce,
    SceneFile,
    SpringDamper,
    as_3d,
    marker_reference,
)

from ..dynamics import control_laws as op
from ..functions.control_laws import Law as GivenLaw
from ..functions.function_table import FunctionTable
from ..spatial import system_arrays as at
from .force_rows import (
    NO_FORCE,
    ControlledForce,
    ForceLaw,
    ForceRow,
    joint_coordinate,
    polynomial_force,
    tabulated_force,
)

#: Eigenvalues below this part of the largest are rounding of the matrix.
_ROUNDING = 1e-14

_AXES = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]


def as_matrix(values: tuple[float, ...] | tuple[tuple[float, ...], ...]) -> Array:
    """The matrix of rows, or with values on its diagonal, (n, n)."""
    given = np.array(values, float)
    return np.diag(given) if given.ndim == 1 else given


def symmetric_force_rows(
    measures: Sequence[ForceRow], K: Array, D: Array
) -> list[ForceRow]:
    """Springs and dampers on the measures, and on sums of those that are coupled."""
    K, D = (K + K.T) / 2.0, (D + D.T) / 2.0
    uncoupled = ~np.array(
        [np.delete(np.abs(K[i]) + np.abs(D[i]), i).any() for i in range(len(K))]
    )
    rows = [
        replace(
            measure,
            law=ForceLaw(
                stiffness=polynomial_force((k,)), damping=polynomial_force((d,))
            ),
        )
        for measure, k, d, is_alone in zip(
            measures, np.diag(K), np.diag(D), uncoupled, strict=True
        )
        if is_alone and (k != 0.0 or d != 0.0)
    ]
    coupled = [int(i) for i in np.flatnonzero(~uncoupled)]
    coupled_measures = [measures[i] for i in coupled]
    for size, weights in _rank_one_terms(K[np.ix_(coupled, coupled)]):
        rows += _combined_force_rows(
            coupled_measures, weights, ForceLaw(stiffness=polynomial_force((size,)))
        )
    for size, weights in _rank_one_terms(D[np.ix_(coupled, coupled)]):
        rows += _combined_force_rows(
            coupled_measures, weights, ForceLaw(damping=polynomial_force((size,)))
        )
    return rows


def _rank_one_terms(matrix: Array) -> Iterator[tuple[float, Array]]:
    """Sizes and vectors whose products with themselves add up to a matrix.

    Lengths and angles are made comparable first, for the sake of rounding.
    """
    diagonal = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    sizes, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    least = _ROUNDING * np.abs(sizes).max(initial=0.0)
    for size, vector in zip(sizes, vectors.T, strict=True):
        if abs(size) > least:
            yield float(size), vector * scale


def _combined_force_rows(
    measures: list[ForceRow], weights: Array, law: ForceLaw
) -> list[ForceRow]:
    """The rows of a force on a weighted sum of measures."""
    used = [(m, float(w)) for m, w in zip(measures, weights, strict=True) if w != 0.0]
    data = (float(len(used)), *(weight for _, weight in used))
    read = [replace(measure, is_measure=True) for measure, _ in used]
    return [*read, replace(measures[0], kind=at.COMBINED_MEASURE, data=data, law=law)]


def antisymmetric_force_rows(
    measures: Sequence[ForceRow], K: Array, D: Array
) -> list[ForceRow]:
    """The rows of laws that give each measure its force of the others."""
    K, D = (K - K.T) / 2.0, (D - D.T) / 2.0
    rows: list[ForceRow] = []
    for i, measure in enumerate(measures):
        others = [int(j) for j in np.flatnonzero((K[i] != 0.0) | (D[i] != 0.0))]
        if not others:
            continue
        entries: list[tuple[float, float, float]] = []
        for number, j in enumerate(others):
            for order, factor in enumerate((K[i, j], D[i, j])):
                is_first = not entries
                entries.append((op.MEASURE, number, order))
                entries.append((op.CONSTANT, -factor, 0.0))
                entries.append((op.MULTIPLY, 0.0, 0.0))
                if not is_first:
                    entries.append((op.ADD, 0.0, 0.0))
        flat = [float(entry) for triple in entries for entry in triple]
        code = (float(len(others)), float(len(entries)), *flat)
        rows += [replace(measures[j], is_measure=True) for j in others]
        law = ForceLaw(applied=1.0)
        control = ControlledForce({}, ())
        rows.append(replace(measure, law=law, code=code, control=control))
    return rows


def compile_forces(
    scene: SceneFile,
    functions: FunctionTable,
    planar: bool,
    programs: Mapping[str, Any],
    rows_of: Callable[[ForceRow], list[ForceRow]],
) -> tuple[ForceRow, ...]:
    """The elements of all forces of a scene.

    Parameters
    ----------
    programs
        Callables and laws that replace the functions of forces.
    rows_of
        Adds to an element that may have a law what belongs to that.

    Raises
    ------
    InputError
        A callable for a force that does not exist or is no function of time.
    """
    _check_programs(scene, programs)
    rows: list[ForceRow] = []
    for name, force in scene.forces.items():
        function, row = getattr(force, "function", None), -1
        program = programs.get(name)
        is_law = isinstance(program or function, Expression | Pid | GivenLaw)
        if not is_law and (function is not None or program is not None):
            place = f"forces.{name}.function"
            row = functions.add(function or Given(type="callable"), place, program)
        context = _Context(name, scene, planar, row)
        for element in _COMPILERS[type(force)](force, context):
            rows += rows_of(element)
    return tuple(rows)


def force_element(scene: SceneFile, name: str) -> ForceRow:
    """The element of a force along one coordinate, without its function."""
    force, planar = scene.forces[name], scene.dimension == "planar"
    (element,) = _COMPILERS[type(force)](force, _Context(name, scene, planar, -1))
    return element


def _check_programs(scene: SceneFile, programs: Mapping[str, Any]) -> None:
    timed = [name for name, force in scene.forces.items() if hasattr(force, "function")]
    for name in programs:
        if name not in timed:
            known = scene.forces.get(name)
            problem = f"there is no force {name!r} for a callable"
            if known is not None:
                problem = f"{name} is a {known.type}, which is no function of time"
            raise InputError(
                problem,
                place="forces",
                expected=", ".join(timed) or "a force or an actuator in the scene",
            )


@dataclass(frozen=True)
class _Context:
    name: str
    scene: SceneFile
    planar: bool
    function: int


def _point_force(force: PointForce, context: _Context) -> list[ForceRow]:
    components = as_3d(force.force)
    torque = np.zeros(3)
    if force.torque is not None:
        torque[:] = force.torque if isinstance(force.torque, tuple) else 0.0
        if context.planar:
            torque[2] = float(np.ravel(force.torque)[-1])
    data = [*components[:2], torque[2]] if context.planar else [*components, *torque]
    kind = at.INERTIAL_LOAD if force.axes == "inertial" else at.FOLLOWER_LOAD
    marker = marker_reference(force.marker)
    values = tuple(map(float, data))
    return [
        ForceRow(context.name, kind, None, marker, values, ForceLaw(), context.function)
    ]


def _spring_damper(force: SpringDamper, context: _Context) -> list[ForceRow]:
    stiffness = polynomial_force(force.stiffness)
    if force.table is not None:
        stiffness = tabulated_force(force.table)
    law = ForceLaw(
        rest=force.rest, stiffness=stiffness, damping=polynomial_force(force.damping)
    )
    return [
        _line_or_joint_force(force.markers, force.joint, force.coordinate, law, context)
    ]


def _actuator(force: Actuator, context: _Context) -> list[ForceRow]:
    law = ForceLaw(rest=force.rest, applied=1.0)
    return [
        _line_or_joint_force(force.markers, force.joint, force.coordinate, law, context)
    ]


def _friction(force: Friction, context: _Context) -> list[ForceRow]:
    viscous = polynomial_force((force.viscous,)) if force.viscous else NO_FORCE
    law = ForceLaw(friction=force.force, speed=force.speed, damping=viscous)
    return [_line_or_joint_force(None, force.joint, force.coordinate, law, context)]


def _line_or_joint_force(
    markers: tuple[str, str] | None,
    joint: str | None,
    coordinate: str | None,
    law: ForceLaw,
    context: _Context,
) -> ForceRow:
    """A force along the line between two markers, or on the coordinate of a joint."""
    if joint is None:
        assert markers is not None
        a, b = (marker_reference(text) for text in markers)
        return ForceRow(
            context.name, at.DISTANCE_MEASURE, a, b, (), law, context.function
        )
    name = coordinate or context.scene.joints[joint].coordinates[0]
    measure = joint_coordinate(context.scene, joint, name)
    return replace(measure, name=context.name, law=law, function=context.function)


def _bushing(force: Bushing, context: _Context) -> list[ForceRow]:
    a, b = (marker_reference(text) for text in force.markers)
    measures: list[tuple[int, tuple[float, ...]]]
    if context.planar:
        measures = [
            (at.DISPLACEMENT_MEASURE, (0.0,)),
            (at.DISPLACEMENT_MEASURE, (0.5 * math.pi,)),
        ]
        measures.append((at.ANGLE_MEASURE, (0.0,)))
    else:
        measures = [(at.DISPLACEMENT_MEASURE, e) for e in _AXES]
        measures += (
            _shaft_measures(force.shaft) if force.shaft else _rotation_vector_measures()
        )
    rows = [
        ForceRow(context.name, kind, a, b, data, ForceLaw()) for kind, data in measures
    ]
    K = as_matrix(force.stiffness)
    D = np.zeros(K.shape) if force.damping is None else as_matrix(force.damping)
    return [*symmetric_force_rows(rows, K, D), *antisymmetric_force_rows(rows, K, D)]


def _rotation_vector_measures() -> list[tuple[int, tuple[float, ...]]]:
    """Components of the rotation vector."""
    return [(at.ROTATION_VECTOR_MEASURE, e) for e in _AXES]


def _shaft_measures(shaft: str) -> list[tuple[int, tuple[float, ...]]]:
    """The angle about an axis of the first marker, and sines of its tilts about the
    other two: components of the shaft across the axis."""
    k = "xyz".index(shaft)
    i, j = (k + 1) % 3, (k + 2) % 3
    minus_j = tuple(-c for c in _AXES[j])
    angles = {
        i: (at.DIRECTION_COSINE_MEASURE, (*minus_j, *_AXES[k])),
        j: (at.DIRECTION_COSINE_MEASURE, (*_AXES[i], *_AXES[k])),
        k: (at.ANGLE_MEASURE, (*_AXES[i], *_AXES[j])),
    }
    return [angles[axis] for axis in range(3)]


_COMPILERS: dict[type[Force], Callable[..., list[ForceRow]]] = {
    PointForce: _point_force,
    SpringDamper: _spring_damper,
    Actuator: _actuator,
    Bushing: _bushing,
    Friction: _friction,
}
