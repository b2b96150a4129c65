"""Meshes in motion for ParaView: one VTKHDF file, or VTU files and a PVD beside them.

Source: Kitware, "VTK File Formats" (VTKHDF 2.0, unstructured grids with steps; XML).
"""

from __future__ import annotations

import base64
from pathlib import Path
from xml.sax.saxutils import quoteattr

import h5py
import numpy as np
from numpy.typing import NDArray

from sidtool.formats.endings import check_ending
from sidtool.formats.sid import Array
from sidtool.formats.storage.atomic import atomic_path, temporary_folder
from sidtool.formats.storage.hdf5_data import put_texts
from sidtool.formats.storage.operating_system import flush_to_disk, replace_file

from .exported import Exported

#: Data at points, and their components.
POINT_DATA = {"displacement": 3, "velocity": 3, "stress": 6, "von_mises": 1}
_KINDS = {"f": "Float32", "i": "Int64", "u": "UInt8"}


def write_export(path: Path, mesh: Exported) -> None:
    """Write what the ending says, .vtkhdf or .pvd.

    Raises
    ------
    InputError : it has another ending.
    """
    check_ending(path, "export")
    write = write_pvd if path.suffix.lower() == ".pvd" else write_vtkhdf
    write(path, mesh)


def write_vtkhdf(path: Path, mesh: Exported) -> None:
    """Write all times into one file; the cells are stored once.

    VTKHDF/CellData/body numbers the bodies, whose names are the dataset /bodies.
    """
    n, count = mesh.n_points, len(mesh.t)
    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0])
        root.attrs.create("Type", b"UnstructuredGrid", dtype="S16")
        for name, value in (
            ("NumberOfPoints", n),
            ("NumberOfCells", len(mesh.types)),
            ("NumberOfConnectivityIds", len(mesh.connectivity)),
        ):
            root[name] = np.full(1, value, np.int64)
        root["Connectivity"], root["Offsets"] = mesh.connectivity, mesh.offsets
        root["Types"] = mesh.types
        root["CellData/body"] = mesh.body
        put_texts(file, "bodies", [part.name for part in mesh.parts])
        _steps(root, mesh.t, n)
        data = root.create_group("PointData")
        places = {"points": _rows(root, "Points", n, count, 3)}
        for name, width in POINT_DATA.items():
            places[name] = _rows(data, name, n, count, width)
        for k, step in enumerate(mesh.steps()):
            for name, dataset in places.items():
                dataset[k * n : (k + 1) * n] = step[name]


def _rows(group: h5py.Group, name: str, n: int, count: int, width: int) -> h5py.Dataset:
    shape = (n * count, width) if width > 1 else (n * count,)
    chunks = (max(n, 1), width) if width > 1 else (max(n, 1),)
    return group.create_dataset(
        name, shape, "f4", chunks=chunks, compression="gzip", compression_opts=1
    )


def _steps(root: h5py.Group, t: Array, n: int) -> None:
    """Where the parts of each time begin: points follow each other, cells stay."""
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = len(t)
    steps["Values"] = t
    still = np.zeros(len(t), np.int64)
    each = n * np.arange(len(t), dtype=np.int64)
    steps["PartOffsets"], steps["NumberOfParts"] = still, still + 1
    steps["PointOffsets"] = each
    steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = still[:, None]
    for name in POINT_DATA:
        steps[f"PointDataOffsets/{name}"] = each
    steps["CellDataOffsets/body"] = still


def write_pvd(path: Path, mesh: Exported) -> None:
    """Write one VTU for each time into a folder beside it, and the PVD.

    An earlier motion stays until all files of the new one are written. While they take
    their places there is no PVD, so that none names files of two motions.
    """
    folder = path.with_suffix("")
    entries = []
    with temporary_folder(folder) as written:
        for k, (t, step) in enumerate(zip(mesh.t, mesh.steps(), strict=True)):
            file = written / f"{folder.name}_{k:05d}.vtu"
            file.write_text(_vtu(mesh, step), encoding="ascii")
            flush_to_disk(file)
            name = quoteattr(f"{folder.name}/{file.name}")
            entries.append(f'<DataSet timestep="{float(t)!r}" part="0" file={name}/>')
        folder.mkdir(exist_ok=True)
        _remove_motion(path)
        for file in sorted(written.iterdir()):
            replace_file(file, folder / file.name)
    text = "\n".join(entries)
    with atomic_path(path) as temporary:
        temporary.write_text(
            '<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0">\n'
            f"<Collection>\n{text}\n</Collection>\n</VTKFile>\n",
            encoding="utf-8",
        )


def _remove_motion(path: Path) -> None:
    """Remove a PVD and the files that it names in its folder."""
    if not path.is_file():
        return
    folder, text = path.with_suffix(""), path.read_text(encoding="utf-8")
    path.unlink()
    for file in folder.glob("*.vtu"):
        if quoteattr(f"{folder.name}/{file.name}") in text:
            file.unlink()


def _vtu(mesh: Exported, step: dict[str, Array]) -> str:
    data = "\n".join(_array(name, step[name]) for name in POINT_DATA)
    cells = "\n".join(
        (
            _array("connectivity", mesh.connectivity),
            _array("offsets", mesh.offsets[1:]),
            _array("types", mesh.types),
        )
    )
    return (
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" '
        'byte_order="LittleEndian" header_type="UInt64">\n<UnstructuredGrid>\n'
        f'<Piece NumberOfPoints="{mesh.n_points}" NumberOfCells="{len(mesh.types)}">\n'
        f"<Points>\n{_array('points', step['points'])}\n</Points>\n"
        f"<Cells>\n{cells}\n</Cells>\n<PointData>\n{data}\n</PointData>\n"
        f"<CellData>\n{_array('body', mesh.body)}\n</CellData>\n"
        "</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"
    )


def _array(name: str, values: NDArray[np.generic]) -> str:
    kind = values.dtype.kind
    small = values.astype("<f4" if kind == "f" else values.dtype.newbyteorder("<"))
    raw = np.ascontiguousarray(small).tobytes()
    text = base64.b64encode(np.uint64(len(raw)).astype("<u8").tobytes() + raw)
    width = values.shape[1] if values.ndim > 1 else 1
    return (
        f'<DataArray type="{_KINDS[kind]}" Name="{name}" NumberOfComponents="{width}" '
        f'format="binary">{text.decode()}</DataArray>'
    )
