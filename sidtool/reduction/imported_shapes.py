"""Shape functions from a file of the user."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.taylor import Array
from sidtool.formats.model.reduction import UserReduction
from sidtool.formats.storage.hdf5_files import check_own_data, check_size

from ..elements.finite_element_model import FiniteElementModel
from .body_frames import Frame, clamped_dofs
from .reduced_basis import ReducedBasis, ShapeFamily, orthonormal_basis


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
