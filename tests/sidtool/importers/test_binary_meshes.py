"""Binary Gmsh meshes, packed here as the reference manual of Gmsh says."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sidtool.formats.base.errors import InputError
from sidtool.importers.mesh_files import read_mesh
from tests.codes import only

from .mesh_files import msh_2, msh_4, rod_mesh


def packed(text: str, order: str) -> bytes:
    """The binary form of a text mesh of version 2.2 or 4.1."""
    lines = iter(text.splitlines())
    out = b""
    for line in lines:
        name = line[1:]
        body = []
        for inner in lines:
            if inner.startswith("$End"):
                break
            body.append(inner.split())
        out += f"${name}\n".encode()
        if name == "MeshFormat":
            version = body[0][0]
            out += f"{version} 1 8\n".encode() + struct.pack(order + "i", 1) + b"\n"
        elif name == "PhysicalNames":
            out += "".join(" ".join(words) + "\n" for words in body).encode()
        else:
            out += _PACKERS[version, name](body, order) + b"\n"
        out += f"$End{name}\n".encode()
    return out


def _nodes_2(body: list[list[str]], order: str) -> bytes:
    rows = (
        struct.pack(f"{order}i3d", int(n), *map(float, xyz)) for n, *xyz in body[1:]
    )
    return f"{body[0][0]}\n".encode() + b"".join(rows)


def _elements_2(body: list[list[str]], order: str) -> bytes:
    out = f"{body[0][0]}\n".encode()
    for label, kind, tags, *words in body[1:]:
        out += struct.pack(f"{order}3i", int(kind), 1, int(tags))
        numbers = [int(label), *map(int, words)]
        out += struct.pack(f"{order}{len(numbers)}i", *numbers)
    return out


def _entities(body: list[list[str]], order: str) -> bytes:
    counts = list(map(int, body[0]))
    out = struct.pack(f"{order}4Q", *counts)
    rows = iter(body[1:])
    for dimension, count in enumerate(counts):
        for _ in range(count):
            tag, *words = next(rows)
            size = 3 if dimension == 0 else 6
            out += struct.pack(f"{order}i{size}d", int(tag), *map(float, words[:size]))
            rest = list(map(int, words[size:]))
            for _ in range(1 if dimension == 0 else 2):
                n = rest.pop(0)
                out += struct.pack(f"{order}Q{n}i", n, *rest[:n])
                rest = rest[n:]
    return out


def _nodes_4(body: list[list[str]], order: str) -> bytes:
    out = struct.pack(f"{order}4Q", *map(int, body[0]))
    rows = iter(body[1:])
    for dimension, tag, parametric, count in rows:
        head = int(dimension), int(tag), int(parametric), int(count)
        out += struct.pack(f"{order}3iQ", *head)
        for _ in range(head[-1]):
            out += struct.pack(f"{order}Q", int(next(rows)[0]))
        for _ in range(head[-1]):
            out += struct.pack(f"{order}3d", *map(float, next(rows)))
    return out


def _elements_4(body: list[list[str]], order: str) -> bytes:
    out = struct.pack(f"{order}4Q", *map(int, body[0]))
    rows = iter(body[1:])
    for dimension, tag, kind, count in rows:
        head = int(dimension), int(tag), int(kind), int(count)
        out += struct.pack(f"{order}3iQ", *head)
        for _ in range(head[-1]):
            words = list(map(int, next(rows)))
            out += struct.pack(f"{order}{len(words)}Q", *words)
    return out


_PACKERS = {
    ("2.2", "Nodes"): _nodes_2,
    ("2.2", "Elements"): _elements_2,
    ("4.1", "Entities"): _entities,
    ("4.1", "Nodes"): _nodes_4,
    ("4.1", "Elements"): _elements_4,
}
WRITERS = {"2.2": msh_2, "4.1": msh_4}


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("version", WRITERS)
@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_binary_mesh_is_that_of_its_text(
    tmp_path: Path, kind: str, version: str, order: str
) -> None:
    text = WRITERS[version](rod_mesh(kind))
    (tmp_path / "a.msh").write_text(text, encoding="utf-8")
    (tmp_path / "b.msh").write_bytes(packed(text, order))
    plain, binary = (read_mesh(tmp_path / f"{n}.msh") for n in "ab")
    assert_allclose(binary.mesh.positions, plain.mesh.positions, rtol=0, atol=0)
    assert_array_equal(binary.mesh.blocks[0].nodes, plain.mesh.blocks[0].nodes)
    assert_array_equal(binary.mesh.labels, plain.mesh.labels)
    assert binary.mesh.node_sets.keys() == plain.mesh.node_sets.keys()
    assert_array_equal(binary.mesh.node_sets["left"], plain.mesh.node_sets["left"])


@pytest.mark.parametrize("version", WRITERS)
def test_binary_mesh_that_is_cut_off_ends_in_a_message(
    tmp_path: Path, version: str
) -> None:
    whole = packed(WRITERS[version](rod_mesh("hex8")), "<")
    for size in range(30, len(whole) - 15, 97):
        (tmp_path / "cut.msh").write_bytes(whole[:size])
        with pytest.raises(InputError, match=r"cut\.msh"):
            read_mesh(tmp_path / "cut.msh")


def test_binary_sections_that_change_nothing_are_passed_over(tmp_path: Path) -> None:
    text = msh_4(rod_mesh("hex8"))
    more = b"$Periodic\n" + struct.pack("<Q", 0) + b"\n$EndPeriodic\n"
    (tmp_path / "a.msh").write_bytes(packed(text, "<") + more)
    mesh = read_mesh(tmp_path / "a.msh")
    assert only(mesh, "N112").data["keywords"] == ("$Periodic",)
