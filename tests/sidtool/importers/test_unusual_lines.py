"""Lines that are rare and mean something: read as the format means them, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sidtool.formats.base.errors import InputError
from sidtool.importers.matrix_market import read_matrix_market
from sidtool.importers.mesh_files import read_mesh
from sidtool.mesh.materials import Material
from sidtool.mesh.mesh import Mesh

from .test_number_texts import CELL, CORNERS, DECKS

POSITIONS = np.array(CORNERS, dtype=float)


def mesh_of(folder: Path, ending: str, *changes: tuple[str, str]) -> Mesh:
    """Read a deck of one cell with some changes of its text."""
    text = DECKS[ending]
    for before, behind in changes:
        assert before in text
        text = text.replace(before, behind)
    path = folder / f"file.{ending}"
    path.write_bytes(text.encode("latin-1"))
    return read_mesh(path).mesh


@pytest.mark.parametrize("character", ["\x85", "\x1c", "\f"])
def test_only_ends_of_lines_end_lines(tmp_path: Path, character: str) -> None:
    """The byte 0x85 is an ellipsis of Windows."""
    for ending, before, comment in (
        ("inp", "2, 1., 0.", "** {}3, 9., 9., 9.\n"),
        ("bdf", "GRID    2", "$ {}GRID,99,,9.,9.,9.\n"),
    ):
        line = comment.format(character) + before
        found = mesh_of(tmp_path, ending, (before, line))
        assert_array_equal(found.positions[:8], POSITIONS)
        assert 99 not in found.labels


def test_a_page_of_a_listing_shifts_no_fields(tmp_path: Path) -> None:
    found = mesh_of(tmp_path, "bdf", ("GRID    5", "\fGRID    5"))
    assert_array_equal(found.positions[:8], POSITIONS)


def test_elements_of_several_groups_of_gmsh_count_once(tmp_path: Path) -> None:
    """Version 2.2 has them once for each group, with other numbers."""
    cell = CELL.replace(",", " ")
    again = f"\n2\n1 5 2 3 3 {cell}\n7 5 2 -4 3 {cell}\n"
    before = f"\n1\n1 5 2 3 3 {cell}\n"
    found = mesh_of(tmp_path, "msh", (before, again))
    (block,) = found.blocks
    assert_array_equal(block.labels, [1])
    assert set(found.node_sets) == {"3.3", "3.4"}


def test_a_blank_in_a_coordinate_of_gmsh(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has 4 coordinates") as caught:
        mesh_of(tmp_path, "msh", ("2 1 0 0", "2 1 .5 0 0"))
    assert caught.value.place == "line 7"


@pytest.mark.parametrize("form", ["(3i9,1p3e9.1)", "( 3I9, 3d9.1 )", "(3i9.9,3g9.1)"])
def test_formats_of_archives(tmp_path: Path, form: str) -> None:
    """With blank integers, which are zero."""
    blank = ("        2        0        0", "        2                  ")
    found = mesh_of(tmp_path, "cdb", ("(3i9,3e9.1)", form), blank)
    assert_array_equal(found.positions, POSITIONS)


def test_a_format_without_coordinates(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no coordinates"):
        mesh_of(tmp_path, "cdb", ("(3i9,3e9.1)", "(3i9)"))


def test_symmetric_matrices_with_both_triangles(tmp_path: Path) -> None:
    path = tmp_path / "k.mtx"
    head = "%%MatrixMarket matrix coordinate real"
    entries = "2 2 3\n1 1 1.\n1 2 2.\n2 1 2.\n"
    path.write_text(f"{head} general\n{entries}", encoding="utf-8")
    assert_array_equal(read_matrix_market(str(path)).toarray(), [[1, 2], [2, 0]])
    path.write_text(f"{head} symmetric\n{entries}", encoding="utf-8")
    with pytest.raises(InputError, match="row 2, column 1 and row 1, column 2"):
        read_matrix_market(str(path))
    path.write_text(
        f"{head} general\n{'9' * 12} {'9' * 12} 1\n1 1 1.\n", encoding="utf-8"
    )
    with pytest.raises(InputError, match="has sizes"):
        read_matrix_market(str(path))


def bulk_density(folder: Path, before: str, ending: str = "ENDDATA\n") -> float:
    """The density of a deck of bulk data behind other lines."""
    path = folder / "part.bdf"
    path.write_text(
        before + DECKS["bdf"].replace("ENDDATA\n", ending), encoding="utf-8"
    )
    (material,) = read_mesh(path).materials.values()
    assert isinstance(material, Material)
    return material.density


@pytest.mark.parametrize("line", ["PARAM,WTMASS,2.59-3", "param   wtmass .00259 $ lb"])
def test_wtmass_of_case_control(tmp_path: Path, line: str) -> None:
    """It takes precedence over that of the bulk data, and may be in a file."""
    (tmp_path / "case.inc").write_text(f"SPC = 1\n{line}\n", encoding="utf-8")
    for control in (line, "INCLUDE 'case.inc'"):
        before = f"INCLUDE 'no.dmap'\nCEND\n{control}\nBEGIN BULK\n"
        assert bulk_density(tmp_path, before) == 2.59e-3
        assert bulk_density(tmp_path, before, "PARAM,WTMASS,3.\n") == 2.59e-3
    assert bulk_density(tmp_path, "CEND\nBEGIN BULK\n", "PARAM,WTMASS,3.\n") == 3.0


def test_superelements_before_the_bulk_data_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="BEGIN SUPER=1") as caught:
        bulk_density(tmp_path, "CEND\nBEGIN SUPER=1\nGRID,1\nBEGIN BULK\n")
    assert caught.value.place == "line 2"


def test_names_of_included_files_extend_over_lines(tmp_path: Path) -> None:
    (tmp_path / "materials").mkdir()
    (tmp_path / "materials" / "one.bdf").write_text("SET1,7,1\n", encoding="utf-8")
    text = "INCLUDE 'materials/\n        one.bdf'\n"
    found = mesh_of(tmp_path, "bdf", ("SET1,1,3\n", text))
    assert_array_equal(found.node_sets["SET7"], [0])


def test_fields_behind_the_last_column(tmp_path: Path) -> None:
    line = f"{'GRID    2               1.      0.      0.':72}"
    found = mesh_of(tmp_path, "bdf", (line.rstrip(), f"{line}a,b"))
    assert_array_equal(found.positions[:8], POSITIONS)
    for old, new in ((" 1.      0.", " 1       0."), ("MAT1,1,9.", "MAT1,1,9")):
        with pytest.raises(InputError, match="with a decimal point"):
            mesh_of(tmp_path, "bdf", (old, new))
    with pytest.raises(InputError, match="node 2 is in the coordinate system -1"):
        mesh_of(tmp_path, "bdf", ("GRID    2         ", "GRID    2       -1"))


PLACED = (
    "*PART, NAME=P\n{}*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, PART=P\n{}"
    "*END INSTANCE\n*END ASSEMBLY\n*MATERIAL"
)


def placed(folder: Path, lines: str) -> Mesh:
    """Read a deck of a part whose instance has some lines."""
    head, rest = DECKS["inp"].split("*MATERIAL")
    material = rest.split("*SOLID")[0]
    part = f"{head}*SOLID SECTION, ELSET=E, MATERIAL=M\n"
    path = folder / "file.inp"
    path.write_text(PLACED.format(part, lines) + material, encoding="utf-8")
    return read_mesh(path).mesh


def test_lines_of_instances(tmp_path: Path) -> None:
    """A blank line before the axis is a zero shift."""
    turned = POSITIONS @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    axis = "0., 0., 0., 0., 0., 1., 90.\n"
    for lines in (f"0.\n{axis}", f"\n{axis}", axis):
        assert_allclose(placed(tmp_path, lines).positions, turned, atol=1e-15)
    for lines in (
        "1., 2., 3., 4.\n",
        "0.\n0., 0., 0., 0., 0., 1.\n",
        "0.\n0., 0., 0., 0., 0., 1.,\n90.\n",
        "0.\n0., 0., 1., 0., 0., 1., 90.\n",
    ):
        with pytest.raises(InputError, match="INSTANCE has a line of"):
            placed(tmp_path, lines)


def test_further_numbers_of_a_line(tmp_path: Path) -> None:
    for line, longer, message in (
        ("1, 3\n", "1, 3, 5\n", "a line of 3 directions"),
        ("NSET=N\n3", "NSET=N, GENERATE\n1, 3, 1, 5", "found '1, 3, 1, 5'"),
        ("9., .3", "9,0, 0,3", "ELASTIC of material M has 4 numbers"),
        ("2, 1., 0., 0.", "2, 1,5, 0,2, 0,7", "node 2 has 6 coordinates"),
    ):
        with pytest.raises(InputError, match=message):
            mesh_of(tmp_path, "inp", (line, longer))
    normal = ("2, 1., 0., 0.", "2, 1., 0., 0., .6, .8")
    assert_array_equal(mesh_of(tmp_path, "inp", normal).positions, POSITIONS)


@pytest.mark.parametrize("lines", ["5.\n6.\n", "5., 6.\n", "5.\n*MASS, ELSET=P\n6.\n"])
def test_lines_of_masses(tmp_path: Path, lines: str) -> None:
    element = f"*ELEMENT, TYPE=MASS, ELSET=P\n9, 1\n*MASS, ELSET=P\n{lines}*NSET"
    with pytest.raises(InputError, match=r"\*MASS (has|already)"):
        mesh_of(tmp_path, "inp", ("*NSET", element))
