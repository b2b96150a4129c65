"""The full field of a flexible body, of which a SID keeps a few nodes: mesh, surface,
shape functions and stresses at all nodes. A sealed HDF5 file beside the SID.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from .base.errors import InputError
from .base.sid import SID, Array
from .file_names import check_ending
from .storage.hdf5_files import check_contents, check_seal, write_sealed
from .storage.unreadable import unreadable_error

FORMAT = "sidtool field"
VERSION = 1
#: A SID and a field belong together if Ke, the places of nodes and their shape
#: functions agree to this part of the largest entry: text files keep fewer digits.
MATCH_TOLERANCE = 1e-6
_ENTRIES = ("stiffness", "places", "node_shapes")


@dataclass(frozen=True, eq=False)
class Field:
    """A body in its body frame, at all nodes of its mesh.

    Attributes
    ----------
    title : of the model
    positions : (n, 3) [m]
    shapes : (n, 3, nq) displacement per elastic coordinate
    triangles : (m, 3) rows of `positions`: the outer surface, or a plane body itself
    cells : kind -> (ne, k) rows of `positions`; kinds are those of
        `sidtool.mesh.reference_elements`
    thickness : of a plane body [m], 0 for others
    stress : (n, 6, nq) xx, yy, zz, xy, yz, xz per elastic coordinate [Pa]; None where
        it is not known, as of beams
    initial_stress : (n, 6) at q = 0 [Pa]
    stiffness, places, node_shapes : Ke (nq, nq), and of the nodes of the SID their
        positions (k, 3) and shape functions (k, 3, nq), by which the two are known to
        belong together
    """

    title: str
    positions: Array
    shapes: Array
    triangles: NDArray[np.int64]
    cells: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    thickness: float = 0.0
    stress: Array | None = None
    initial_stress: Array = field(default_factory=lambda: np.zeros((0, 6)))
    stiffness: Array = field(default_factory=lambda: np.zeros((0, 0)))
    places: Array = field(default_factory=lambda: np.zeros((0, 3)))
    node_shapes: Array = field(default_factory=lambda: np.zeros((0, 3, 0)))

    @property
    def nq(self) -> int:
        """Number of elastic coordinates."""
        return self.shapes.shape[2]

    def displacement(self, q: Array) -> Array:
        """(n, 3) elastic displacements in the body frame for q (nq,)."""
        return self.shapes @ q

    def stresses(self, q: Array) -> Array:
        """(n, 6) stresses for q (nq,) [Pa].

        Raises
        ------
        InputError : they are not known.
        """
        if self.stress is None:
            raise InputError(
                "holds no stresses", expected="the field of a body of solid elements"
            )
        return self.initial_stress + self.stress @ q


def field_of(sid: SID, content: Field) -> Field:
    """A field with what it needs to know its SID again."""
    return replace(
        content,
        stiffness=sid.Ke.m0,
        places=np.array([node.position for node in sid.nodes]).reshape(-1, 3),
        node_shapes=sid.shapes[0],
    )


def mismatch_text(content: Field, sid: SID) -> str:
    """Why a field is not that of a SID; empty if it is."""
    if content.nq != sid.nq:
        return f"has {content.nq} elastic coordinates, the SID {sid.nq}"
    other = field_of(sid, content)
    if other.places.shape != content.places.shape:
        return f"was written with {len(content.places)} nodes, the SID has others"
    for name, what in zip(_ENTRIES, ("Ke", "nodes", "shape functions"), strict=True):
        own, given = getattr(content, name), getattr(other, name)
        size = np.abs(own).max(initial=0.0)
        if np.abs(own - given).max(initial=0.0) > MATCH_TOLERANCE * size:
            return f"has other {what} than the SID"
    return ""


def write_field(path: str | os.PathLike[str], content: Field) -> None:
    """Write a field, wholly or not at all.

    Raises
    ------
    InputError, OSError : see `sidtool.formats.storage.hdf5_files.write_sealed`.
    """
    check_ending(path, "field")
    write_sealed(path, lambda file: _write_content(file, content))


def read_field(path: str | os.PathLike[str]) -> Field:
    """Read a field.

    Raises
    ------
    InputError : there is no such file, or it is no whole field of this version.
    """
    try:
        check_seal(Path(path))
        with h5py.File(path, "r") as file:
            _check_format(file)
            check_contents(file)
            return _read_content(file)
    except InputError as error:
        raise error.located(path) from None
    except (OSError, LookupError, TypeError, ValueError, RuntimeError) as error:
        if not Path(path).is_file():
            raise unreadable_error(path, "a field file") from None
        raise InputError(
            f"cannot be read ({error})", source=path, expected="a whole field file"
        ) from None


def _check_format(file: h5py.File) -> None:
    format_name, version = file.attrs.get("format"), file.attrs.get("format_version")
    if format_name != FORMAT or version != VERSION:
        raise InputError(
            f"found the format {format_name!r}, version {version}",
            expected=f"{FORMAT!r}, version {VERSION}, as `convert --field` writes it",
        )


def _write_content(file: h5py.File, content: Field) -> None:
    file.attrs.update(
        format=FORMAT,
        format_version=VERSION,
        title=content.title,
        thickness=content.thickness,
        meaning="a flexible body in its body frame, at all nodes; SI units; stresses "
        "xx yy zz xy yz xz",
    )
    arrays = {
        "positions": content.positions,
        "shapes": content.shapes,
        "triangles": content.triangles,
        **{name: getattr(content, name) for name in _ENTRIES},
        **{f"cells/{kind}": nodes for kind, nodes in content.cells.items()},
    }
    if content.stress is not None:
        arrays |= {"stress": content.stress, "initial_stress": content.initial_stress}
    for name, array in arrays.items():
        packed = {"compression": "gzip", "shuffle": True} if array.size else {}
        file.create_dataset(name, data=array, **packed)


def _read_content(file: h5py.File) -> Field:
    numbers = {name: np.asarray(file[name][()], float) for name in _ENTRIES}
    positions, shapes = (
        np.asarray(file[name][()], float) for name in ("positions", "shapes")
    )
    triangles = np.asarray(file["triangles"][()], np.int64)
    cells = {
        kind: np.asarray(nodes[()], np.int64)
        for kind, nodes in file.get("cells", {}).items()
    }
    stress = initial = None
    if "stress" in file:
        stress = np.asarray(file["stress"][()], float)
        initial = np.asarray(file["initial_stress"][()], float)
    n, nq = len(positions), shapes.shape[-1]
    _check_shapes(n, nq, positions, shapes, stress, initial)
    for nodes in (triangles, *cells.values()):
        if nodes.size and not 0 <= nodes.min() <= nodes.max() < n:
            raise ValueError("it names nodes that it does not have")
    return Field(
        title=str(file.attrs["title"]),
        positions=positions,
        shapes=shapes,
        triangles=triangles.reshape(-1, 3),
        cells=cells,
        thickness=float(file.attrs["thickness"]),
        stress=stress,
        initial_stress=np.zeros((n, 6)) if initial is None else initial,
        **numbers,
    )


def _check_shapes(
    n: int,
    nq: int,
    positions: Array,
    shapes: Array,
    stress: Array | None,
    initial: Array | None,
) -> None:
    fits = positions.shape == (n, 3) and shapes.shape == (n, 3, nq)
    if stress is not None and initial is not None:
        fits = fits and stress.shape == (n, 6, nq) and initial.shape == (n, 6)
    if not fits:
        raise ValueError("its arrays do not fit each other")
