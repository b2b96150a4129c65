"""Error of a reduced basis against the full mesh, and suggestions of better methods.

Frequencies and the compliance at loaded markers follow from the factors that the
reduction computed. If the basis is poor, other methods are measured as well, so that a
suggested method is known to be better.
"""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import DIRECTIONS, Array, ComplianceShares, SixComponents
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.model import ModelFile
from sidtool.formats.model.reduction import (
    AttachmentReduction,
    CraigBamptonReduction,
    HertingReduction,
    ReductionSettings,
)
from sidtool.formats.sid_subset import inertia_load_scales, missing_inertia_shares

from ..elements.finite_element_model import FiniteElementModel, MarkerRows
from .admissible_space import AdmissibleSpace
from .body_frames import Frame, clamped_dofs, motion_names, motion_rows
from .methods import COMPARED_FREQUENCIES, REDUCTIONS
from .reduced_basis import ReducedBasis, to_hertz

#: The error above which other methods are tried.
_POOR_ERROR = 0.01
#: Errors below this are equal; then fewer shape functions are better.
_EQUAL_ERROR = 1e-6
#: Errors in per cent below this may be rounding.
_ROUNDING = 1e-4
#: Number of entries of the loads at markers above which no error is measured.
_MAX_LOAD_ENTRIES = 50_000_000
#: The same limit for markers that are not interfaces.
_LARGEST_BESIDE = 5_000_000
#: Energies under rotation about an axis, below this share of the largest, are rounding
#: or do not matter.
_NO_ENERGY = 1e-6
_UNKNOWN: SixComponents = (None,) * 6
_TITLES = {
    "attachment": "attachment",
    "herting": "Herting",
    "craig_bampton": "Craig-Bampton",
}
#: Values of diagnostics if no other method is suggested.
_NO_BETTER: dict[str, Any] = {"remedy": "", "better": "", "better_modes": 0}


@dataclass(frozen=True, eq=False)
class FullModelReference:
    """The full mesh: frequencies [Hz], loads (k, ndof) and their compliances (k,)."""

    frequencies: Array
    names: tuple[str, ...]
    rows: Array
    compliances: Array


@dataclass(frozen=True, eq=False)
class BasisErrors:
    """Relative errors of a basis.

    Attributes
    ----------
    frequencies : (n,) of the first ones; positive if too high
    compliances : (k,) displacement along unit loads at markers; positive if too small
    names : k texts
    hertz : (n,) the frequencies of the full mesh
    count : of shape functions
    """

    frequencies: Array
    compliances: Array
    names: tuple[str, ...]
    hertz: Array
    count: int

    @property
    def lowest_square(self) -> float:
        """Square of the lowest natural angular frequency of the basis [1/s^2]."""
        return float((2.0 * np.pi * self.hertz[0] * (1.0 + self.frequencies[0])) ** 2)

    @property
    def worst(self) -> float:
        """The largest of all errors."""
        both = np.concatenate([self.frequencies, self.compliances])
        return float(np.abs(both).max(initial=0.0))


def has_moment_loads(marker: MarkerRows, settings: ReductionSettings) -> bool:
    """Return whether moments are loads: by the settings, or if a marker has its own
    rotation.
    """
    return bool(getattr(settings, "rotations", marker.gradient is None))


def full_model_reference(
    body: FiniteElementModel,
    space: AdmissibleSpace,
    markers: list[MarkerRows],
    settings: ReductionSettings,
    count: int,
) -> FullModelReference:
    """Return the first `count` frequencies, and the compliance at some markers."""
    pairs = [(marker, has_moment_loads(marker, settings)) for marker in markers]
    rows = [motion_rows(body, marker, rotations=turn) for marker, turn in pairs]
    names = [motion_names(body, marker, rotations=turn) for marker, turn in pairs]
    loads = np.vstack([np.zeros((0, body.ndof)), *rows])
    compliances = np.einsum("ij,ji->i", loads, space.static(loads.T))
    flat = np.array([name for group in names for name in group], object)
    effective = space.effective_loads(loads.T) & (compliances > 0)
    squares, _ = space.modes(min(COMPARED_FREQUENCIES, count))
    return FullModelReference(
        to_hertz(squares),
        tuple(flat[effective]),
        loads[effective],
        compliances[effective],
    )


def measure_basis_errors(
    body: FiniteElementModel,
    space: AdmissibleSpace,
    basis: ReducedBasis,
    full: FullModelReference,
) -> BasisErrors:
    """Return the errors of a basis; free rigid motions are known.

    Raises
    ------
    numpy.linalg.LinAlgError : rounding makes the shape functions dependent.
    """
    shapes = _in_mean_axes(body, space, basis)
    mass = shapes.T @ (body.mass @ shapes)
    squares, vectors = scipy.linalg.eigh(basis.stiffness, mass)
    motions = full.rows @ (shapes @ vectors)
    compliances = (motions**2 / squares).sum(axis=1)
    frequencies = to_hertz(squares)[: len(full.frequencies)]
    known = full.frequencies[: len(frequencies)]
    return BasisErrors(
        frequencies / known - 1,
        1 - compliances / full.compliances,
        full.names,
        known,
        len(squares),
    )


def _in_mean_axes(
    body: FiniteElementModel, space: AdmissibleSpace, basis: ReducedBasis
) -> Array:
    """Shape functions (ndof, nq) without the momenta of admissible rigid motions."""
    if not space.rigid.shape[1]:
        return basis.shapes
    rigid = space.displacements(space.rigid)
    momenta = body.mass @ rigid
    motion = np.linalg.solve(momenta.T @ rigid, momenta.T @ basis.shapes)
    return np.asarray(basis.shapes - rigid @ motion)


@dataclass(frozen=True, eq=False)
class BasisQuality:
    """Quality of a basis, and better alternatives.

    Attributes
    ----------
    diagnostic : its errors (N160), a warning where they are large (N161) or unknown
        (N165)
    carried : shares of the compliance at all markers, for its SID
    """

    diagnostic: Diagnostic
    carried: ComplianceShares | None = None


def assess_basis(
    body: FiniteElementModel, frame: Frame, basis: ReducedBasis, model: ModelFile
) -> BasisQuality | None:
    """Assess a basis. Return None if nothing can be measured: the method solved no
    equations, or there are too many markers.
    """
    settings = model.reduction
    if basis.space is None:
        return None
    space = basis.space.for_comparison()
    markers = _loaded_markers(body, frame, settings)
    if 6 * len(markers) * body.ndof > _MAX_LOAD_ENTRIES:
        return None
    try:
        full = full_model_reference(body, space, markers, settings, len(basis.labels))
        own = measure_basis_errors(body, space, basis, full)
        shares_of_compliance = _compliance_shares(
            body, frame, space, basis, own, settings
        )
        if own.worst <= _POOR_ERROR:
            return BasisQuality(_errors_of(own, settings), shares_of_compliance)
        better = _suggested_methods(
            body, frame, space, full, markers, settings, own.worst
        )
        code = "N161" if _is_poor(own, settings) else "N160"
        return BasisQuality(
            _errors_of(own, settings, code, better), shares_of_compliance
        )
    except InputError as error:
        return BasisQuality(diagnose("N165", reason=error.problem))
    except np.linalg.LinAlgError:
        reason = "rounding hides its mass matrix"
        return BasisQuality(diagnose("N165", reason=reason))


def spin_stress_note(
    body: FiniteElementModel, basis: ReducedBasis, frame: Frame, model: ModelFile
) -> Diagnostic | None:
    """N166 on centrifugal loads of bodies with stress and stiffening, whose stress the
    shape functions lack.

    Return None if they hold it. Measured by strain energies under the loads of a steady
    rotation about each axis.
    """
    stiffening = model.stiffening
    if model.stress is None or stiffening is None or basis.space is None:
        return None
    if not stiffening.centrifugal:
        return None
    axes = ("x", "y", "z") if body.dimension == 3 else ("z",)
    loads = _rotation_loads(body, frame)[:, : len(axes)]
    space = basis.space.for_comparison()
    full, own = _static_energies(body, space, basis, loads)
    counts = full > _NO_ENERGY * full.max(initial=0.0)
    missing = np.where(counts, 1.0 - own / np.where(counts, full, 1.0), 0.0)
    poor = missing > _POOR_ERROR
    if not poor.any():
        return None
    names = tuple(axis for axis, is_poor in zip(axes, poor, strict=True) if is_poor)
    return diagnose("N166", axes=names, missing=float(missing.max()))


def held_marker_note(
    body: FiniteElementModel, frame: Frame, basis: ReducedBasis, model: ModelFile
) -> Diagnostic | None:
    """N162 on what modes of the free body lack if a joint fixes the marker of their
    frame.

    Return None if nothing is missing, or if the frame is clamped or of another kind.
    """
    if basis.space is None or frame.rows is None or model.frame.type != "tangent":
        return None
    mass = basis.shapes.T @ (body.mass @ basis.shapes)
    squares, _ = basis.space.with_constraints(frame.rows).modes(1)
    own = float(
        to_hertz(scipy.linalg.eigh(basis.stiffness, mass, eigvals_only=True))[0]
    )
    true = float(to_hertz(squares)[0])
    if abs(own / true - 1) <= _POOR_ERROR:
        return None
    marker = model.frame.marker
    return diagnose("N162", marker=str(marker), own=own, full=true)


def _loaded_markers(
    body: FiniteElementModel,
    frame: Frame,
    settings: ReductionSettings,
    all_markers: bool = False,
) -> list[MarkerRows]:
    """Return the interfaces, or all markers that can move."""
    held = clamped_dofs(body, frame, settings.fixed_names)
    chosen = settings.interface_names
    if all_markers or not chosen:
        chosen = tuple(m.name for m in body.markers)
    return [
        marker
        for marker in map(body.marker, chosen)
        if not held[marker.displacement.indices].all()
        and marker.name not in settings.fixed_names
    ]


def _compliance_shares(
    body: FiniteElementModel,
    frame: Frame,
    space: AdmissibleSpace,
    basis: ReducedBasis,
    own: BasisErrors,
    settings: ReductionSettings,
) -> ComplianceShares:
    """Return the measured shares, those at other markers, and under inertia loads."""
    rows: dict[str, list[float | None]] = {}
    parts, known = (
        [own],
        {marker.name for marker in _loaded_markers(body, frame, settings)},
    )
    everywhere = _loaded_markers(body, frame, settings, all_markers=True)
    others = [marker for marker in everywhere if marker.name not in known]
    if 6 * len(others) * body.ndof <= _LARGEST_BESIDE:
        full = full_model_reference(body, space, others, settings, 0)
        parts.append(measure_basis_errors(body, space, basis, full))
    for part in parts:
        for name, error in zip(part.names, part.compliances.tolist(), strict=True):
            marker, _, way = name.rpartition(" ")
            row = rows.setdefault(str(body.marker(marker).node), list(_UNKNOWN))
            row[DIRECTIONS.index(way)] = min(max(1.0 - error, 0.0), 1.0)
    missing = _missing_inertia_shares(body, frame, space, basis, own.lowest_square)
    return ComplianceShares(
        bool(space.rigid.shape[1]),
        {name: tuple(row) for name, row in rows.items()},
        missing,
    )


def _missing_inertia_shares(
    body: FiniteElementModel,
    frame: Frame,
    space: AdmissibleSpace,
    basis: ReducedBasis,
    lowest_square: float,
) -> tuple[float, ...]:
    """Return the missing inertia shares, see `ComplianceShares.lost`.

    A free body takes part in accelerations as a whole, which do not deform it; its
    inertia balances what a rotation leaves of force and moment. Of a body that can
    move in some directions only, the shares are not known.
    """
    motions = body.rigid_body_modes(frame.origin)
    free = space.rigid.shape[1]
    if free not in (0, motions.shape[1]):
        return ()
    loads = body.mass @ motions
    inertia = np.einsum("ij,ij->j", motions, loads)
    ways = ([0, 1, 5, 8] if body.dimension == 2 else list(range(12)))[free:]
    scales = inertia_load_scales(inertia[0], inertia[body.dimension :])[ways]
    loads = np.hstack([loads[:, free:], _rotation_loads(body, frame)]) * scales
    full, own = np.zeros(12), np.zeros(12)
    full[ways], own[ways] = _static_energies(body, space, basis, loads)
    return missing_inertia_shares(full, own, float(inertia[0] / lowest_square))


def _rotation_loads(body: FiniteElementModel, frame: Frame) -> Array:
    """Loads (ndof, 6) of a steady rotation up to their sign, (ndof, 1) of a plane body:
    about x, y and z, and of the products xy, yz and xz of the angular velocities.
    """
    loads = (body.mass @ body.linear_fields(frame.origin)).real
    if body.dimension == 2:
        return np.asarray(loads)
    # columns of S in the order xx, xy, xz, yy, yz, zz
    squares, products = loads[:, [0, 3, 5]], loads[:, [1, 4, 2]]
    return np.hstack([squares.sum(axis=1)[:, None] - squares, products])


def _static_energies(
    body: FiniteElementModel, space: AdmissibleSpace, basis: ReducedBasis, loads: Array
) -> tuple[Array, Array]:
    """Twice the strain energy under loads (ndof, n) of the full body and of its shape
    functions.
    """
    felt = (_in_mean_axes(body, space, basis).T @ loads).real
    stiffness = basis.stiffness.real
    sizes = np.sqrt(np.maximum(np.diag(stiffness), np.finfo(float).tiny))
    balanced, share = stiffness / np.outer(sizes, sizes), felt / sizes[:, None]
    return (
        np.einsum("ij,ij->j", loads, space.static(loads)).real,
        np.einsum("ij,ij->j", share, np.linalg.lstsq(balanced, share, rcond=None)[0]),
    )


def _is_poor(errors: BasisErrors, settings: ReductionSettings) -> bool:
    """Check the errors of compliances, and of as many frequencies as requested modes.

    The highest frequencies of a basis always have errors, since its last shape
    functions are remainders.
    """
    count = _relevant_count(errors, settings)
    relevant = np.concatenate([errors.frequencies[:count], errors.compliances])
    return float(np.abs(relevant).max(initial=0.0)) > _POOR_ERROR


def _relevant_count(errors: BasisErrors, settings: ReductionSettings) -> int:
    """Return the requested number of modes; without one the lower half counts."""
    return int(getattr(settings, "modes", None) or (errors.count + 1) // 2)


def _errors_of(
    errors: BasisErrors,
    settings: ReductionSettings,
    code: str = "N160",
    better: Mapping[str, Any] = _NO_BETTER,
) -> Diagnostic:
    """Return the largest errors of frequencies and compliances as N160 or N161."""
    sizes = np.abs(errors.frequencies)
    i, count, rest = int(sizes.argmax()), len(sizes), ""
    if sizes[i] > _POOR_ERROR:
        count = min(count, _relevant_count(errors, settings))
        rest = f", {_percent(float(sizes[i]))} of f{i + 1}" if i >= count else ""
    compliance, load = 0.0, "no loads"
    if len(errors.names):
        k = int(np.abs(errors.compliances).argmax())
        compliance, load = abs(float(errors.compliances[k])), errors.names[k]
    values: dict[str, Any] = {
        "frequencies": f"f1 to f{count}" if count > 1 else "f1",
        "relevant": float(sizes[:count].max()),
        "rest": rest,
        "number": i + 1,
        "count": len(sizes),
        "frequency": float(sizes[i]),
        "hertz": float(errors.hertz[i]),
        "compliance": compliance,
        "load": load,
    }
    return diagnose(code, **values, **better)


def _percent(share: float) -> str:
    size = 100 * abs(share)
    if size < _ROUNDING:
        return f"less than {_ROUNDING:g} %"
    return f"{size:.0f} %" if size >= 10 else f"{size:.2g} %"


def _suggested_methods(
    body: FiniteElementModel,
    frame: Frame,
    space: AdmissibleSpace,
    full: FullModelReference,
    markers: list[MarkerRows],
    settings: ReductionSettings,
    worst: float,
) -> dict[str, Any]:
    """Return the best of some other methods by measured errors, for a diagnostic;
    `worst` is the error of the selected method.

    Those with fewer shape functions come first, so that the first without an error is
    the best.
    """
    candidates = []
    for other in _other_methods(settings, markers, len(full.frequencies)):
        # Small meshes have fewer modes than it takes; rounding makes shape functions
        # dependent.
        with suppress(InputError, np.linalg.LinAlgError):
            basis = REDUCTIONS[other.method](body, frame, other, space)
            found = measure_basis_errors(body, space, basis, full)
            if found.worst < worst:
                candidates.append((found, other))
            if found.worst <= _EQUAL_ERROR:
                break
    if not candidates:
        return _NO_BETTER | {"remedy": "No other method does better."}
    best, other = min(
        candidates, key=lambda pair: (max(pair[0].worst, _EQUAL_ERROR), pair[0].count)
    )
    title, errors = _TITLES[other.method], _percent(best.worst)
    remedy = f"{title} with {other.modes} modes, {best.count} functions: {errors}."
    return {
        "remedy": f"Better: {remedy}",
        "better": other.method,
        "better_modes": other.modes,
    }


def _other_methods(
    settings: ReductionSettings, markers: list[MarkerRows], count: int
) -> Iterator[AttachmentReduction | HertingReduction | CraigBamptonReduction]:
    """Yield other methods with enough modes for the compared frequencies, including the
    same method if it has fewer modes.
    """
    if not markers:
        return
    own = getattr(settings, "modes", 0)
    modes = max(own, count)
    common: dict[str, Any] = {
        "fix": settings.fix,
        "interfaces": tuple(marker.name for marker in markers),
        "rotations": all(has_moment_loads(marker, settings) for marker in markers),
    }
    if settings.method != "attachment" or own < modes:
        yield AttachmentReduction(method="attachment", modes=modes, **common)
    if settings.method != "herting" or own < modes:
        yield HertingReduction(method="herting", modes=modes, **common)
    if settings.interface_names:
        more = CraigBamptonReduction(method="craig_bampton", modes=2 * modes, **common)
        yield more
