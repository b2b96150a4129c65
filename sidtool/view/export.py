"""Export of the motion of a result for ParaView: VTKHDF, or VTU with PVD.

Source: Kitware, "VTK File Formats" (VTKHDF 2.0, unstructured grids with steps; XML).
"""

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from xml.sax.saxutils import quoteattr

import h5py
import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import iterate_with_progress
from sidtool.formats.base.sid import Array
from sidtool.formats.base.stress import von_mises
from sidtool.formats.field import Field
from sidtool.formats.file_names import check_ending
from sidtool.formats.result import Result
from sidtool.formats.storage.atomic import atomic_path, temporary_folder
from sidtool.formats.storage.hdf5_files import (
    NewFile,
    closed_or_discarded,
    put_texts,
)
from sidtool.formats.storage.operating_system import flush_to_disk, replace_file
from sidtool.solver.output.body_outputs import FrameMotion, frame_motion
from sidtool.solver.output.energies import elastic_coordinates
from sidtool.solver.simulation.replay import replay

from ..field.body_surfaces import body_surfaces
from .body_fields import Given, find_fields
from .links import Anchor, Link
from .motion import sample_motion

Indices = NDArray[np.int64]
#: Cell types of VTK by element kind; the order of nodes is the same.
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

#: Point data and their number of components.
POINT_DATA = {"displacement": 3, "velocity": 3, "stress": 6, "von_mises": 1}
_KINDS = {"f": "Float32", "i": "Int64", "u": "UInt8"}


@dataclass(frozen=True, eq=False)
class ExportBody:
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
        """Return points and point data at time k in inertial axes. Stresses are in body
        axes, and NaN if they are not known.
        """
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

    ends : parts with one point each, which move with the bodies of the markers
    """

    name: str
    ends: tuple[ExportBody, ExportBody]
    cells: Mapping[str, Indices]
    source: str

    @property
    def positions(self) -> Array:
        """Return positions (2, 3), each in the frame of its own body."""
        return np.concatenate([end.positions for end in self.ends])

    def at(self, k: int) -> dict[str, Array]:
        """Return the points of the line, see `ExportBody.at`; displacements are those
        of the markers.
        """
        a, b = (end.at(k) for end in self.ends)
        return {name: np.concatenate([a[name], b[name]]) for name in a}


@dataclass(frozen=True, eq=False)
class ExportMesh:
    """All bodies and links with their points one after another.

    connectivity, offsets, types : cells as VTK has them
    body : number of the body of every cell; links are numbered behind the bodies
    """

    t: Array
    parts: tuple[ExportBody | Line, ...]
    connectivity: Indices
    offsets: Indices
    types: NDArray[np.uint8]
    body: Indices
    notes: tuple[str, ...]

    @property
    def n_points(self) -> int:
        return sum(len(part.positions) for part in self.parts)

    def steps(self) -> Iterator[dict[str, Array]]:
        """Yield the data of `ExportBody.at` for all bodies together, time by time."""
        for k in iterate_with_progress(range(len(self.t)), "writing times"):
            parts = [part.at(k) for part in self.parts]
            yield {name: np.concatenate([f[name] for f in parts]) for name in parts[0]}


def export_mesh(
    result: Result, fields: Given | None = None, folder: Path | None = None
) -> ExportMesh:
    """Return the bodies of a result: flexible ones by all cells of their full field if
    it is known, else as they are drawn. Springs, dampers, actuators and rods between
    markers are lines.

    Raises
    ------
    InputError : the result does not hold its scene, or a field is not that of its SID.
    """
    again = replay(result)
    system, samples = again.system, again.samples()
    folders = [folder or Path("."), Path(".")]
    known = find_fields(system.scene, result.sids, fields or {}, folders)
    sampled = sample_motion(result, times=again.t, folders=folders)
    rows = {data.name: b for b, data in enumerate(system.bodies)}
    parts: list[ExportBody | Line] = []
    for surface in body_surfaces(
        system.scene, system.bodies, known, sampled.size, folders
    ):
        b = rows[surface.name]
        q, rates = elastic_coordinates(system, samples, b)
        positions, cells = surface.positions, {"tri3": surface.triangles}
        shapes, stress, initial = surface.shapes, surface.stress, surface.initial_stress
        field = known.get(surface.name)
        if field is not None and field.cells:
            positions, cells = field.positions, dict(field.cells)
            shapes, initial = field.shapes[..., : q.shape[1]], field.initial_stress
            stress = None if field.stress is None else field.stress[..., : q.shape[1]]
        motion = frame_motion(system, samples, b)
        parts.append(
            ExportBody(
                surface.name,
                positions,
                cells,
                shapes,
                stress,
                initial,
                motion,
                q,
                rates,
                surface.source,
            )
        )
    by_name = {part.name: part for part in parts if isinstance(part, ExportBody)}
    parts += [_line(link, by_name, len(again.t)) for link in sampled.links]
    notes = tuple(f"{p.name} is {_point_data_names(p, known)}" for p in parts)
    return ExportMesh(again.t, tuple(parts), *_join_cells(parts), notes)


def _line(link: Link, bodies: Mapping[str, ExportBody], count: int) -> Line:
    """Return a link between the points to which its ends are fixed, at `count`
    times.
    """
    a, b = (_point(end, bodies.get(end.body), count) for end in link.ends)
    cells = {"line2": np.array([[0, 1]], np.int64)}
    return Line(link.name, (a, b), cells, f"a line, the {link.kind}")


def _point(end: Anchor, body: ExportBody | None, count: int) -> ExportBody:
    """Return a point of a body, or of the ground, as a part."""
    if body is None:
        zero, no_shapes = np.zeros((count, 3)), np.zeros((count, 0))
        turns = np.tile(np.eye(3), (count, 1, 1))
        frame, q, rates = FrameMotion(zero, turns, zero, zero), no_shapes, no_shapes
    else:
        frame, q, rates = body.frame, body.q, body.rates
    return ExportBody(
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


def _point_data_names(part: ExportBody | Line, known: Mapping[str, Field]) -> str:
    if part.name in known and known[part.name].cells:
        count = sum(map(len, part.cells.values()))
        return f"the {count} cells of its full field"
    return part.source


def _join_cells(
    parts: Sequence[ExportBody | Line],
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


def write_export(path: Path, mesh: ExportMesh) -> None:
    """Write a file in the format of its ending, .vtkhdf or .pvd.

    Raises
    ------
    InputError : it has another ending.
    """
    check_ending(path, "export")
    write = write_pvd if path.suffix.lower() == ".pvd" else write_vtkhdf
    write(path, mesh)


def write_vtkhdf(path: Path, mesh: ExportMesh) -> None:
    """Write all times into one file; the cells are stored once.

    VTKHDF/CellData/body numbers the bodies, whose names are the dataset /bodies.
    """
    n = mesh.n_points
    with closed_or_discarded(NewFile(path)) as new:
        new.put(partial(_write_cells, mesh))
        for k, step in enumerate(mesh.steps()):
            new.put(partial(_write_step, slice(k * n, (k + 1) * n), step))


def _write_cells(mesh: ExportMesh, file: h5py.File) -> None:
    """Write all but the motion, and create the datasets of that."""
    n, count = mesh.n_points, len(mesh.t)
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
    _write_steps(root, mesh.t, n)
    data = root.create_group("PointData")
    _create_rows(root, "Points", n, count, 3)
    for name, width in POINT_DATA.items():
        _create_rows(data, name, n, count, width)


def _write_step(rows: slice, step: Mapping[str, Array], file: h5py.File) -> None:
    root = file["VTKHDF"]
    root["Points"][rows] = step["points"]
    for name in POINT_DATA:
        if step[name].any():
            root["PointData"][name][rows] = step[name]


def _create_rows(group: h5py.Group, name: str, n: int, count: int, width: int) -> None:
    """Create the rows of all times, which are 0 and take no space until written.

    Compression by gzip saves 7 to 17 % of a motion and takes ten times as long.
    """
    shape = (n * count, width) if width > 1 else (n * count,)
    chunks = (max(n, 1), width) if width > 1 else (max(n, 1),)
    group.create_dataset(name, shape, "f4", chunks=chunks, fillvalue=0.0)


def _write_steps(root: h5py.Group, t: Array, n: int) -> None:
    """Write the offsets of each time: points are appended, cells do not change."""
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = len(t)
    steps["Values"] = t
    offsets = np.zeros(len(t), np.int64)
    each = n * np.arange(len(t), dtype=np.int64)
    steps["PartOffsets"], steps["NumberOfParts"] = offsets, offsets + 1
    steps["PointOffsets"] = each
    steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = offsets[:, None]
    for name in POINT_DATA:
        steps[f"PointDataOffsets/{name}"] = each
    steps["CellDataOffsets/body"] = offsets


def write_pvd(path: Path, mesh: ExportMesh) -> None:
    """Write one VTU per time into a folder next to the PVD, and the PVD. Files of an
    earlier motion are kept until all new ones are written. While they are moved into
    place there is no PVD, so it never names files of two motions.

    Raises
    ------
    InputError : the name is not UTF-8, in which a PVD names its files.
    """
    folder = path.with_suffix("")
    if folder.name != folder.name.encode(errors="replace").decode():
        raise InputError(
            "is no name in UTF-8", source=path, expected="another -o, or .vtkhdf"
        )
    entries = []
    with temporary_folder(folder) as written:
        for k, (t, step) in enumerate(zip(mesh.t, mesh.steps(), strict=True)):
            file = written / f"{folder.name}_{k:05d}.vtu"
            file.write_text(_vtu_text(mesh, step), encoding="ascii")
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
    folder, text = path.with_suffix(""), path.read_text("utf-8", errors="replace")
    path.unlink()
    for file in folder.glob("*.vtu"):
        if quoteattr(f"{folder.name}/{file.name}") in text:
            file.unlink()


def _vtu_text(mesh: ExportMesh, step: dict[str, Array]) -> str:
    data = "\n".join(_vtu_array(name, step[name]) for name in POINT_DATA)
    cells = "\n".join(
        (
            _vtu_array("connectivity", mesh.connectivity),
            _vtu_array("offsets", mesh.offsets[1:]),
            _vtu_array("types", mesh.types),
        )
    )
    return (
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" '
        'byte_order="LittleEndian" header_type="UInt64">\n<UnstructuredGrid>\n'
        f'<Piece NumberOfPoints="{mesh.n_points}" NumberOfCells="{len(mesh.types)}">\n'
        f"<Points>\n{_vtu_array('points', step['points'])}\n</Points>\n"
        f"<Cells>\n{cells}\n</Cells>\n<PointData>\n{data}\n</PointData>\n"
        f"<CellData>\n{_vtu_array('body', mesh.body)}\n</CellData>\n"
        "</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"
    )


def _vtu_array(name: str, values: NDArray[np.generic]) -> str:
    kind = values.dtype.kind
    small = values.astype("<f4" if kind == "f" else values.dtype.newbyteorder("<"))
    raw = np.ascontiguousarray(small).tobytes()
    text = base64.b64encode(np.uint64(len(raw)).astype("<u8").tobytes() + raw)
    width = values.shape[1] if values.ndim > 1 else 1
    return (
        f'<DataArray type="{_KINDS[kind]}" Name="{name}" NumberOfComponents="{width}" '
        f'format="binary">{text.decode()}</DataArray>'
    )
