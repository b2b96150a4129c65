"""Gmsh, geomdl and G+Smo files: nothing in them is lost without a word."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.geometry.nurbs_patch import patch_from_model
from sidtool.importers.mesh_files import read_mesh
from sidtool.importers.nurbs_files import read_patches
from tests.codes import codes

from ..elements.test_frontend_patches import GISMO, geomdl
from ..models import IGA, annulus
from .mesh_files import msh_2, msh_4, rod_mesh

MSH = {"2.2": msh_2, "4.1": msh_4}


@pytest.mark.parametrize("version", MSH)
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("$EndElements", "9 8 7\n$EndElements", "Elements holds more than it announ"),
        ("$EndNodes", "77 0 0 0\n$EndNodes", "Nodes holds more than it announces"),
        ("$EndNodes\n", "$EndNodes\n$Nodes\n0\n$EndNodes\n", "holds .Nodes twice"),
        ("$PhysicalNames\n2", "$PhysicalNames\n3", "announces 3 names and holds 2"),
        (
            "$EndElements",
            "$EndElements\n$PartitionedEntities\n1\n$EndPartitionedEntities",
            "PartitionedEntities, which is not supported",
        ),
    ],
)
def test_what_a_gmsh_file_holds_besides(
    tmp_path: Path, version: str, old: str, new: str, message: str
) -> None:
    path = tmp_path / "rod.msh"
    path.write_text(
        MSH[version](rod_mesh("hex8")).replace(old, new, 1), encoding="utf-8"
    )
    with pytest.raises(InputError, match=message):
        read_mesh(path)


@pytest.mark.parametrize("version", MSH)
def test_a_gmsh_file_gives_notes_on_its_content(tmp_path: Path, version: str) -> None:
    path = tmp_path / "rod.msh"
    text = MSH[version](rod_mesh("hex8"))
    path.write_text(text + "$Periodic\n0\n$EndPeriodic\n", encoding="utf-8")
    mesh = read_mesh(path)
    assert codes(mesh) == ["N110", "N111", "N112"]
    read, idle, unread = mesh.diagnostics
    counts = {"elements": 6, "given": 10, "used": 28, "nodes": 28}
    assert read.data == counts | {"kinds": ("6 hex8",)}
    assert idle.data["count"] == 4
    assert unread.data["keywords"] == ("$Periodic",)


def arc() -> dict[str, Any]:
    return geomdl(patch_from_model(annulus(IGA).geometry))


def test_trimmed_and_unknown_parts_of_geomdl_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "arc.json"
    curve = {"type": "freeform", "data": []}
    cases: list[tuple[dict[str, Any], str]] = [
        ({"trims": {"count": 1, "data": [curve]}}, "has trim curves"),
        ({"trims": [curve]}, "has trim curves"),
        ({"holes": 3}, "holes: is not known"),
    ]
    for more, message in cases:
        data = arc()
        data["shape"]["data"][0].update(more)
        path.write_text(json.dumps(data), encoding="utf-8")
        with pytest.raises(InputError, match=message):
            read_patches(path)
    data = arc()
    data["shape"]["data"][0].update({"trims": {"count": 0, "data": []}, "delta": [1]})
    path.write_text(json.dumps(data), encoding="utf-8")
    assert list(read_patches(path)) == ["patch1"]
    data["shape"]["count"] = 2
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(InputError, match="announces 2 patches and holds 1"):
        read_patches(path)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('<patches type="id_range">7 7</patches>', ""),
        ('<patches type="id_range">7 9</patches>', "patch8, patch9"),
        ('<patches type="id_index">3</patches>', "patch3, patch7"),
    ],
)
def test_a_multipatch_lists_all_patches(
    tmp_path: Path, table: str, message: str
) -> None:
    path = tmp_path / "arc.xml"
    table = f'<MultiPatch parDim="2" id="0">{table}</MultiPatch></xml>'
    path.write_text(GISMO.replace("</xml>", table), encoding="utf-8")
    if not message:
        assert list(read_patches(path)) == ["patch7"]
        return
    with pytest.raises(InputError, match=message):
        read_patches(path)


def test_control_points_whose_squares_overflow_are_refused(tmp_path: Path) -> None:
    """No point of a search tree is nearest to points at infinite distance."""
    assert "  2 0  1 1" in GISMO
    (tmp_path / "arc.xml").write_text(
        GISMO.replace("  2 0  1 1", "  1e308 0  1 1"), encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"control point is at 1e\+308"):
        read_patches(tmp_path / "arc.xml")


def test_encodings_that_no_parser_reads_are_refused(tmp_path: Path) -> None:
    text = GISMO.replace('encoding="UTF-8"', 'encoding="UTF-32"')
    assert text != GISMO
    (tmp_path / "arc.xml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="encoding"):
        read_patches(tmp_path / "arc.xml")


def test_patches_with_one_id_are_refused(tmp_path: Path) -> None:
    body = GISMO.split("<xml>")[1].split("</xml>")[0]
    (tmp_path / "arc.xml").write_text(
        GISMO.replace("</xml>", body + "</xml>"), encoding="utf-8"
    )
    with pytest.raises(InputError, match="patch7: is given twice"):
        read_patches(tmp_path / "arc.xml")
