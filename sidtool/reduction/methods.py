"""Reduction methods by the `reduction.method` of a model file.

A reduction method takes a body, its frame and the settings, and reduces the body to a
`ReducedBasis`, whose `reconstruct` returns the displacement of the whole body. The
space of the body with the supports of frame and `fix` may be passed, with its factors.

Source of the rational Krylov vectors: J. Fehr, P. Eberhard, "Simulation process of
flexible multibody systems with non-modal model order reduction techniques", Multibody
System Dynamics 25, 2011; E. Grimme, "Krylov projection methods for model reduction",
1997.
"""

import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from sidtool.formats.base.complex_step import without_rounding
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model.reduction import (
    AttachmentReduction,
    CraigBamptonReduction,
    HertingReduction,
    KrylovReduction,
    ModalReduction,
    UserReduction,
)
from sidtool.formats.storage.hdf5_files import check_own_data, check_size

from ..eigensolvers.eigenpair_derivatives import modal_stiffness
from ..elements.finite_element_model import FiniteElementModel
from .admissible_space import AdmissibleSpace, constrained_space
from .body_frames import Frame, clamped_dofs, motion_names, motion_rows
from .reduced_basis import (
    ReducedBasis,
    ShapeFamily,
    orient_shapes,
    orthonormal_basis,
    to_hertz,
)

#: Number of frequencies of the full mesh that a basis is compared with.
COMPARED_FREQUENCIES = 10
#: Components of a field below this fraction of the size of the body are rounding.
_ROUNDING = 1e-12


def user_shapes(
    model: FiniteElementModel,
    frame: Frame,
    settings: UserReduction,
) -> ReducedBasis:
    """Return the columns of a matrix as an orthonormal basis.

    Raises
    ------
    InputError : the file cannot be read, or its matrix does not fit the model.
    """
    path = Path(settings.file)
    shapes = read_matrix(path, settings.name)
    expected = f"a finite matrix with {model.ndof} rows, one per degree of freedom"
    if shapes.ndim != 2 or shapes.shape[0] != model.ndof or not shapes.shape[1]:
        size = " x ".join(map(str, shapes.shape)) or "a single number"
        raise InputError(f"the array is {size}", source=path, expected=expected)
    if not np.isfinite(shapes).all():
        raise InputError(
            "holds numbers that are not finite", source=path, expected=expected
        )
    held = clamped_dofs(model, frame, settings.fixed_names)
    shapes = np.where(held[:, None], 0.0, shapes)
    return orthonormal_basis(
        model, frame, [ShapeFamily("user shape", shapes)], "User Shape"
    )


def read_matrix(path: Path, name: str | None = None) -> Array:
    """Read a dense array from .npy, .npz, .mtx or HDF5.

    Parameters
    ----------
    name : of the array, if the file holds several

    Raises
    ------
    InputError : the file cannot be read, or there is no such array.
    """
    readers = {
        ".npy": _read_npy,
        ".npz": _read_npz,
        ".mtx": _read_mtx,
        ".h5": _read_hdf5,
        ".hdf5": _read_hdf5,
    }
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"'{path.suffix}' is no kind of matrix file",
            source=path,
            expected=", ".join(readers),
        )
    try:
        return np.asarray(reader(path, name), float)
    except InputError as error:
        raise error.located(path) from None
    except (OSError, ValueError, TypeError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"cannot be read ({error})", source=path) from None


def _read_npy(path: Path, _: str | None) -> Any:
    return np.load(path, allow_pickle=False)


def _read_npz(path: Path, name: str | None) -> Any:
    with np.load(path, allow_pickle=False) as file:
        if {"format", "shape", "data"} <= set(file.files):
            return sp.load_npz(path).toarray()
        return file[_select_array(path, list(file.files), name)]


def _read_mtx(path: Path, _: str | None) -> Any:
    from scipy.io import mmread

    matrix = mmread(path)
    return matrix.toarray() if sp.issparse(matrix) else matrix


def _read_hdf5(path: Path, name: str | None) -> Any:
    import h5py

    with h5py.File(path, "r") as file:
        check_own_data(file)
        arrays = [key for key, part in file.items() if isinstance(part, h5py.Dataset)]
        known = name is not None and name in file
        dataset = file[name if known else _select_array(path, arrays, name)]
        check_size(dataset)
        return dataset[()]


def _select_array(path: Path, names: list[str], name: str | None) -> str:
    if name is None and len(names) == 1:
        return names[0]
    if name in names:
        return str(name)
    raise InputError(
        f"holds the arrays {', '.join(names) or '(none)'}",
        source=path,
        place="reduction.name",
        expected="the name of one of them",
    )


__all__ = [
    "COMPARED_FREQUENCIES",
    "REDUCTIONS",
    "ReducedBasis",
    "modal_truncation",
    "orient_shapes",
]


def modal_truncation(
    model: FiniteElementModel,
    frame: Frame,
    settings: ModalReduction,
    space: AdmissibleSpace | None = None,
) -> ReducedBasis:
    """Return the lowest elastic modes of the supported or free body, mass-normalised.

    See `orient_shapes` for their signs.

    Raises
    ------
    InputError : the model has fewer degrees of freedom than requested modes.
    """
    space = space or constrained_space(model, frame, settings.fixed_names)
    values, shapes = space.modes(settings.modes)
    if frame.rows is not None:
        normal = ShapeFamily("normal", shapes)
        return replace(
            orthonormal_basis(model, frame, [normal], "Eigen Mode"), space=space
        )
    shapes = orient_shapes(shapes, model)
    return ReducedBasis(
        shapes=shapes,
        stiffness=modal_stiffness(model.stiffness, values, shapes),
        labels=tuple(
            f"Eigen Mode{i:5d} :{f:13.3f} Hz" for i, f in enumerate(to_hertz(values), 1)
        ),
        shares={"normal": np.ones(len(values))},
        space=space,
    )


def craig_bampton(
    model: FiniteElementModel,
    frame: Frame,
    settings: CraigBamptonReduction,
    space: AdmissibleSpace | None = None,
) -> ReducedBasis:
    """Constraint modes of the interfaces and modes with fixed interfaces.

    Source: R. Craig, M. Bampton, "Coupling of substructures for dynamic analyses",
    AIAA J. 6 (7), 1968.
    """
    outer = space or constrained_space(model, frame, settings.fixed_names)
    inner, constraint = _constraint_modes(model, outer, settings)
    _, normal = inner.modes(settings.modes)
    families = [ShapeFamily("fixed-interface mode", normal), constraint]
    return replace(
        orthonormal_basis(model, frame, families, "Craig-Bampton"), space=outer
    )


def attachment_modes(
    model: FiniteElementModel,
    frame: Frame,
    settings: AttachmentReduction,
    space: AdmissibleSpace | None = None,
) -> ReducedBasis:
    """Normal modes, static answers to unit loads at markers and to its own inertia.

    Source: R. Craig, "Structural Dynamics", Wiley 1981, chapter 19.
    """
    space = space or constrained_space(model, frame, settings.fixed_names)
    _, normal = space.modes(settings.modes, COMPARED_FREQUENCIES)
    rows, names = _interface_rows(model, settings.interfaces, settings.rotations)
    families = [
        ShapeFamily("normal mode", normal),
        _static_answers(space, rows.T, "attachment mode", names),
    ]
    if settings.inertia_relief:
        families.append(_inertia_relief(model, frame, space))
    if settings.centrifugal:
        fields = model.linear_fields(frame.origin)
        loads = model.mass @ _without_rounding(model, fields)
        families.append(_static_answers(space, loads, "centrifugal mode"))
    return replace(orthonormal_basis(model, frame, families, "Attachment"), space=space)


def herting_modes(
    model: FiniteElementModel,
    frame: Frame,
    settings: HertingReduction,
    space: AdmissibleSpace | None = None,
) -> ReducedBasis:
    """Constraint modes, inertia-relief modes, and modes with free interfaces.

    The normal modes enter relative to the constraint modes, which does not change the
    space.

    Source: D. Herting, "A general purpose, multi-stage, component modal synthesis
    method", Finite Elements in Analysis and Design 1, 1985.
    """
    outer = space or constrained_space(model, frame, settings.fixed_names)
    inner, constraint = _constraint_modes(model, outer, settings)
    _, normal = outer.modes(settings.modes, COMPARED_FREQUENCIES)
    relief = _inertia_relief(model, frame, inner)
    families = [ShapeFamily("free-interface mode", normal), constraint, relief]
    return replace(orthonormal_basis(model, frame, families, "Herting"), space=outer)


def krylov_reduction(
    model: FiniteElementModel,
    frame: Frame,
    settings: KrylovReduction,
    space: AdmissibleSpace | None = None,
) -> ReducedBasis:
    """Rational Krylov vectors that match the transfer functions between markers.

    See `krylov_vectors`. For a body that is accelerated with its frame, responses to
    uniform accelerations are matched, too.
    """
    space = space or constrained_space(model, frame, settings.fixed_names)
    rows, names = _interface_rows(model, settings.interfaces, settings.rotations)
    loads = [rows.T]
    if not space.rigid.shape[1]:
        rigid = model.rigid_body_modes(frame.origin)
        loads.append(model.mass @ _without_rounding(model, rigid))
        names += tuple(f"acceleration {i + 1}" for i in range(loads[1].shape[1]))
    columns = np.hstack(loads)
    effective = space.effective_loads(columns)
    names = tuple(name for name, there in zip(names, effective, strict=True) if there)
    families = [
        ShapeFamily(
            f"at {f:g} Hz", shapes, tuple(f"{n} at {f:g} Hz" for n in names) * m
        )
        for f, shapes, m in krylov_vectors(space, columns[:, effective], settings)
    ]
    return replace(orthonormal_basis(model, frame, families, "Krylov"), space=space)


def _interface_rows(
    model: FiniteElementModel, interfaces: tuple[str, ...], rotations: bool
) -> tuple[Array, tuple[str, ...]]:
    markers = [model.marker(name) for name in interfaces]
    rows = [motion_rows(model, marker, rotations=rotations) for marker in markers]
    names = [motion_names(model, marker, rotations=rotations) for marker in markers]
    return np.vstack(rows), tuple(name for group in names for name in group)


def _constraint_modes(
    model: FiniteElementModel,
    outer: AdmissibleSpace,
    settings: CraigBamptonReduction | HertingReduction,
) -> tuple[AdmissibleSpace, ShapeFamily]:
    """Return the space with fixed interfaces, and static responses to their unit
    motions.
    """
    rows, _ = _interface_rows(model, settings.interfaces, settings.rotations)
    inner = outer.with_constraints(rows)
    count, before = len(inner.constraints), len(outer.constraints)
    motions = np.eye(count)[:, before:]
    shapes = inner.static(np.zeros((model.ndof, count - before)), motions)
    return inner, ShapeFamily("constraint mode", shapes)


def _inertia_relief(
    model: FiniteElementModel, frame: Frame, space: AdmissibleSpace
) -> ShapeFamily:
    """Return static responses to uniform accelerations; none for a free body."""
    loads = np.zeros((model.ndof, 0))
    if not space.rigid.shape[1]:
        rigid = model.rigid_body_modes(frame.origin)
        loads = model.mass @ _without_rounding(model, rigid)
    return _static_answers(space, loads, "inertia-relief mode")


def _without_rounding(model: FiniteElementModel, fields: Array) -> Array:
    """Return fields (ndof, n) that are linear in position, with rounding set to zero. A
    thin bar along x has coordinates y of 1e-17 m; responses to them would look like
    others.
    """
    size = np.ptp(model.positions.real, axis=0).max()
    return without_rounding(fields, _ROUNDING * size)


def _static_answers(
    space: AdmissibleSpace, loads: Array, kind: str, names: tuple[str, ...] = ()
) -> ShapeFamily:
    """Return static responses to loads (ndof, n), without loads that act on supports
    only.
    """
    effective = space.effective_loads(loads)
    names = tuple(name for name, there in zip(names, effective, strict=False) if there)
    return ShapeFamily(kind, space.static(loads[:, effective]), names)


Reduction = Callable[..., ReducedBasis]

#: One line adds a method.
REDUCTIONS: dict[str, Reduction] = {
    "modal": modal_truncation,
    "craig_bampton": craig_bampton,
    "attachment": attachment_modes,
    "herting": herting_modes,
    "krylov": krylov_reduction,
    "user": user_shapes,
}


def krylov_vectors(
    space: AdmissibleSpace, loads: Array, settings: KrylovReduction
) -> Iterator[tuple[float, Array, int]]:
    """(K - w^2 M)^-1 B and their derivatives by w^2, for every expansion point w.

    With these vectors the reduced transfer functions between the loads agree with the
    full ones at w in the value and in the first 2 `moments` - 1 derivatives by w^2,
    since the projection is symmetric.

    Parameters
    ----------
    loads : (ndof, n) load vectors B

    Yields
    ------
    frequency [Hz], vectors (ndof, n moments), moments

    Raises
    ------
    InputError : an expansion point is an eigenfrequency.
    """
    for frequency in settings.frequencies:
        solve = _dynamic_solver(space, 2 * np.pi * frequency)
        vectors = [solve(space.loads(loads))]
        for _ in range(settings.moments - 1):
            last = vectors[-1] / np.linalg.norm(vectors[-1], axis=0)
            vectors.append(solve(space.mass @ last))
        shapes = space.displacements(np.hstack(vectors))
        if not np.isfinite(shapes).all():
            raise _resonance_error(frequency)
        yield frequency, shapes, settings.moments


class _DynamicSolver:
    """Solves (K - w^2 M) y = f with the constraints of a space."""

    def __init__(self, space: AdmissibleSpace, omega: float) -> None:
        k, m = space.stiffness.tocsr(), space.mass.tocsr()
        rows = sp.csr_matrix(space.constraints * float(k.diagonal().real.mean()))
        matrix = k - omega**2 * m
        if rows.shape[0]:
            matrix = sp.block_array([[matrix, rows.T], [rows, None]])
        try:
            self._factors = splu(sp.csc_matrix(matrix))
        except RuntimeError:
            raise _resonance_error(omega / (2 * np.pi)) from None
        self._extra = rows.shape[0]

    def __call__(self, loads: Array) -> Array:
        padded = np.vstack([loads, np.zeros((self._extra, loads.shape[1]))])
        return self._factors.solve(padded)[: len(loads)]


def _dynamic_solver(space: AdmissibleSpace, omega: float) -> Callable[[Array], Array]:
    if omega > 0:
        return _DynamicSolver(space, omega)
    identity = sp.csr_matrix(sp.eye_array(space.stiffness.shape[0]))
    return replace(space, transform=identity).static


def _resonance_error(frequency: float) -> InputError:
    return InputError(
        f"{frequency:g} Hz is an eigenfrequency of the body",
        place="reduction.frequencies",
        expected="expansion points beside the eigenfrequencies",
    )
