"""ANSYS .cdb meshes, through a package made for them."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from formats.errors import InputError

from .imported import ImportedMesh, RawElement, assembled_mesh, read_lines

#: ANSYS element type -> corners-only kind, kind with middle nodes.
_ANSYS = {
    185: ("hex8", "hex8"),
    45: ("hex8", "hex8"),
    186: ("hex20", "hex20"),
    95: ("hex20", "hex20"),
    187: ("tet10", "tet10"),
    92: ("tet10", "tet10"),
    285: ("tet4", "tet4"),
    182: ("quad4", "quad4"),
    42: ("quad4", "quad4"),
    183: ("quad8", "quad8"),
}


def read_cdb(path: str | Path, ignored: frozenset[str] = frozenset()) -> ImportedMesh:
    """The mesh of an ANSYS archive; needs mapdl-archive.

    Raises
    ------
    InputError : mapdl-archive is not installed, or the file is no sound mesh.
    """
    read_lines(path)
    module = _needed("mapdl_archive", "mapdl-archive", path)
    data = _guarded(lambda: module.Archive(str(path), parse_vtk=False), path)
    try:
        return _guarded(lambda: _from_ansys(data), path)
    except InputError as error:
        raise error.located(path) from None


def _from_ansys(data: Any) -> ImportedMesh:
    nodes = {
        int(label): (float(xyz[0]), float(xyz[1]), float(xyz[2]))
        for label, xyz in zip(data.nnum, data.nodes, strict=True)
    }
    types = {int(key): int(kind) for key, kind in data.ekey}
    raw = []
    for entry in data.elem:
        material, key, label = int(entry[0]), int(entry[1]), int(entry[8])
        listed = [int(n) for n in entry[10:] if n]
        if types.get(key) not in _ANSYS:
            raise InputError(
                f"element {label} is of type {types.get(key)}",
                expected="one of " + ", ".join(map(str, _ANSYS)),
            )
        kind, listed = _collapsed(_ANSYS[types[key]][0], listed)
        raw.append(RawElement(label, kind, listed, f"element {label}", str(material)))
    sets = {name: [int(n) for n in ids] for name, ids in data.node_components.items()}
    return ImportedMesh(assembled_mesh(nodes, raw, sets))


def _collapsed(kind: str, nodes: list[int]) -> tuple[str, list[int]]:
    """Hexahedra whose nodes coincide, as ANSYS writes prisms and tetrahedra."""
    distinct = list(dict.fromkeys(nodes))
    if kind == "hex8" and len(distinct) == 4:
        return "tet4", distinct
    if kind == "hex8" and len(distinct) == 6:
        return "wedge6", distinct
    return kind, nodes


def _needed(module: str, package: str, path: str | Path) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise InputError(
            f"needs the package {package}, which is not installed",
            source=path,
            expected=f"pip install {package}, or the mesh as .inp or .msh",
        ) from None
    except Exception as error:
        raise InputError(
            f"needs the package {package}, which does not work here ({error})",
            source=path,
            expected=f"a {package} that fits this Python and NumPy, or the mesh as "
            ".inp or .msh",
        ) from None


def _guarded(read: Callable[[], Any], path: str | Path) -> Any:
    """Whatever a foreign reader raises, as one message."""
    try:
        return read()
    except InputError:
        raise
    except (Exception, SystemExit) as error:  # noqa: BLE001
        text = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(
            f"cannot be read ({text})", source=path, expected="a valid file"
        ) from None
