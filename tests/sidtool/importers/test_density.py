"""`geometry.density` completes materials and leaves E and nu to the file."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.discretisation.mesh_body import imported_mesh_model
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import codes, only, with_code

from .decks import MATERIAL, STEEL, Block, frequencies
from .mesh_files import bdf_text, mesh_model, rod_mesh

BLOCK = Block((4, 1, 1), (0.4, 0.1, 0.1))


def converted(folder: Path, name: str, text: str, **changes: Any) -> SID:
    (folder / name).write_text(text, encoding="utf-8")
    frame = changes.pop("frame", {"type": "buckens"})
    path = mesh_model(
        folder,
        name,
        frame=frame,
        markers={"p": {"node": 1, "mesh_node": 1}},
        reduction={"method": "modal", "modes": 2, **changes.pop("reduction", {})},
    )
    data = json.loads(path.read_text(encoding="utf-8"))
    del data["material"]
    data |= changes.pop("top", {})
    data["geometry"].update(changes)
    path.write_text(json.dumps(data), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sid_from_model(path)


def inp(*densities: str) -> str:
    """Half of the block of steel, the other half of something softer."""
    rows = BLOCK.element_lines().splitlines()
    text = f"*NODE\n{BLOCK.node_lines()}"
    for k, (e, own) in enumerate(zip((2.1e11, 7e10), densities, strict=True)):
        half = "\n".join(rows[2 * k : 2 * k + 2])
        text += f"*ELEMENT, TYPE=C3D8I, ELSET=E{k}\n{half}\n"
        text += f"*MATERIAL, NAME=M{k}\n*ELASTIC\n{e!r}, 0.3\n{own}"
        text += f"*SOLID SECTION, ELSET=E{k}, MATERIAL=M{k}\n"
    return text


def bdf(*densities: str, more: str = "") -> str:
    lines = ["BEGIN BULK", more]
    for i, (x, y, z) in enumerate(BLOCK.points, 1):
        lines.append(f"GRID,{i},,{x!r},{y!r},{z!r}")
    for i, e in enumerate(BLOCK.elements, 1):
        part = 1 + (i > 2)
        lines.append(f"CHEXA,{i},{part},{','.join(map(str, e[:6]))}\n,{e[6]},{e[7]}")
    for k, (e, rho) in enumerate(zip(("2.1+11", "7.+10"), densities, strict=True), 1):
        lines += [f"PSOLID,{k},{k}", f"MAT1,{k},{e},,0.3,{rho}"]
    return "\n".join([*lines, "ENDDATA", ""])


def cdb(*densities: str) -> str:
    lines = ["/PREP7", "ET,1,185", "KEYOPT,1,2,3"]
    for i, (x, y, z) in enumerate(BLOCK.points, 1):
        lines.append(f"N,{i},{x!r},{y!r},{z!r}")
    for i, e in enumerate(BLOCK.elements, 1):
        lines += [f"MAT,{1 + (i > 2)}", f"EN,{i},{','.join(map(str, e))}"]
    for k, (e, rho) in enumerate(zip(("2.1E11", "7E10"), densities, strict=True), 1):
        lines += [f"MP,EX,{k},{e}", f"MP,PRXY,{k},0.3"]
        lines += [f"MP,DENS,{k},{rho}"] if rho else []
    return "\n".join([*lines, ""])


GIVEN = "*DENSITY\n7850.\n"
DECKS = {
    "inp": (inp(GIVEN, GIVEN), inp("", ""), inp(GIVEN, "")),
    "bdf": (bdf("7850.", "7850."), bdf("", "0."), bdf("7850.", "")),
    "cdb": (cdb("7850.", "7850."), cdb("", ""), cdb("7850.", "")),
}


@pytest.mark.parametrize("ending", DECKS)
def test_deck_without_densities_is_that_with_them(tmp_path: Path, ending: str) -> None:
    whole, none, one = DECKS[ending]
    expected = converted(tmp_path, f"a.{ending}", whole)
    with pytest.raises(InputError, match=r"geometry\.density"):
        converted(tmp_path, f"b.{ending}", none)
    for text in (none, one):
        found = converted(tmp_path, f"c.{ending}", text, density=7850.0)
        assert found.mass == pytest.approx(expected.mass, rel=1e-12)
        assert_allclose(frequencies(found), frequencies(expected), rtol=1e-9)


def test_density_is_in_si_and_weights_do_not_apply_to_it(tmp_path: Path) -> None:
    """The deck in mm, t and s; PARAM WTMASS is for densities of the file."""
    volume = 0.4 * 0.1 * 0.1 * 1e-9
    text = bdf("", "", more="PARAM,WTMASS,0.5")
    text = text.replace("2.1+11", "2.1+5").replace("7.+10", "7.+4")
    sid = converted(tmp_path, "a.bdf", text, density=7850.0, unit="mm-t-s")
    assert sid.mass == pytest.approx(7850 * volume, rel=1e-9)


def test_table_material_leaves_nothing_to_complete(tmp_path: Path) -> None:
    material = {"youngs_modulus": 2e11, "poissons_ratio": 0.3, "density": 7e3}
    with pytest.raises(InputError, match=r"geometry\.density"):
        text = bdf("", "")
        converted(tmp_path, "a.bdf", text, density=1.0, top={"material": material})


def test_solids_without_any_mass_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"geometry\.density"):
        converted(tmp_path, "a.bdf", bdf("", ""), density=0.0)


def test_stick_whose_mass_is_in_points(tmp_path: Path) -> None:
    """A massless cantilever with two masses: influence numbers a^2 (3 b - a) / 6 EI.

    Three nodes have no mass, and nothing but the masses' 1e-9 kg m^2 turns.
    """
    length, masses, bend = 2.0, np.array([3.0, 5.0]), np.array([1e-7, 4e-7])
    nodes = [f"GRID,{i + 1},,{length * i / 5},0.,0." for i in range(6)]
    bars = [f"CBAR,{i},1,{i},{i + 1},0.,1.,0." for i in range(1, 6)]
    cards = ["MAT1,1,2.1+11,,0.3", f"PBAR,1,1,1.-3,{bend[0]},{bend[1]},1.-7"]
    for k, (node, m) in enumerate(zip((4, 6), masses, strict=True), 8):
        cards += [f"CONM2,{k},{node},,{m},,,,", ",1.-9,,1.-9,,,1.-9"]
    text = "\n".join(["BEGIN BULK", *nodes, *bars, *cards, "ENDDATA", ""])
    frame = {"type": "tangent", "marker": "p"}
    held = {"frame": frame, "reduction": {"fix": ["p"]}}
    sid = converted(tmp_path, "a.bdf", text, density=0.0, **held)
    assert sid.mass == pytest.approx(masses.sum(), rel=1e-12)
    a, b = 1.2, 2.0
    influence = np.array(
        [[2 * a**3, a**2 * (3 * b - a)], [a**2 * (3 * b - a), 2 * b**3]]
    )
    slow = 1 / np.linalg.eigvals(influence * masses).real.max()
    expected = np.sqrt(slow * 6 * 2.1e11 * bend) / (2 * np.pi)
    assert_allclose(frequencies(sid), expected, rtol=1e-5)
    with pytest.raises(InputError, match=r"geometry\.density"):
        converted(tmp_path, "b.bdf", text)


def test_rigid_motion_without_inertia_is_refused(tmp_path: Path) -> None:
    """Two points turn freely about the line between them."""
    text = (
        "BEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nCBAR,1,1,1,2,0.,1.,0.\n"
        "MAT1,1,2.1+11,,0.3\nPBAR,1,1,1.-3,1.-7,1.-7,1.-7\nCONM2,1,1,,5.\n"
        "CONM2,2,2,,5.\nENDDATA\n"
    )
    with pytest.raises(InputError, match="inertia"):
        converted(tmp_path, "a.bdf", text, density=0.0)


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("ending", ["inp", "bdf"])
def test_engine_gets_the_density_too(tmp_path: Path, ending: str) -> None:
    plate = Block((4, 4), (1.0, 1.0))
    if ending == "inp":
        steel = MATERIAL.format(**STEEL)
        text = (
            f"*NODE\n{plate.node_lines()}*ELEMENT, TYPE=S4, ELSET=E\n"
            f"{plate.element_lines()}{steel}*SHELL SECTION, ELSET=E, MATERIAL=S\n0.02\n"
        )
        plain = text.replace("*DENSITY\n7850.0\n", "")
    else:
        grids = [
            f"GRID,{i},,{x!r},{y!r},0." for i, (x, y) in enumerate(plate.points, 1)
        ]
        shells = [
            f"CQUAD4,{i},1,{','.join(map(str, e))}"
            for i, e in enumerate(plate.elements, 1)
        ]
        steel = "MAT1,1,2.1+11,,0.3,7850."
        lines = ["BEGIN BULK", *grids, *shells, "PSHELL,1,1,0.02,1,,1", steel]
        text = "\n".join([*lines, "ENDDATA", ""])
        plain = text.replace(",7850.", "")
    assert plain != text
    engine = {"engine": "calculix", "order": 2}
    expected = converted(tmp_path, f"a.{ending}", text, **engine)
    found = converted(tmp_path, f"b.{ending}", plain, density=7850.0, **engine)
    assert found.mass == pytest.approx(7850 * 0.02, rel=1e-9)
    assert_allclose(frequencies(found), frequencies(expected), rtol=1e-9)


@pytest.mark.parametrize("ending", DECKS)
def test_density_without_effect_is_named(tmp_path: Path, ending: str) -> None:
    for text, is_idle in ((DECKS[ending][0], True), (DECKS[ending][2], False)):
        (tmp_path / f"a.{ending}").write_text(text, encoding="utf-8")
        path = mesh_model(tmp_path, f"a.{ending}", frame={"type": "buckens"})
        data = json.loads(path.read_text(encoding="utf-8"))
        del data["material"]
        data["markers"] = {"p": {"node": 1, "mesh_node": 1}}
        data["geometry"] |= {"density": 5000.0, "file": str(tmp_path / f"a.{ending}")}
        mesh = imported_mesh_model(ModelFile.checked(data, "test"))
        found = with_code(mesh, "N121", "N145")
        assert [note.code for note in found] == ["N145" if is_idle else "N121"]
        assert not is_idle or found[0].subject == "geometry.density"


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("geometry.thickness", 0.1),
        ("discretisation.state", "plane_strain"),
        ("discretisation.formulation", "full_integration"),
    ],
)
def test_choices_for_elements_that_a_mesh_lacks_are_refused(
    tmp_path: Path, key: str, value: Any
) -> None:
    tets = bdf_text(rod_mesh("tet10"))
    (tmp_path / "a.bdf").write_text(tets, encoding="utf-8")
    path = mesh_model(tmp_path, "a.bdf")
    with pytest.raises(InputError) as caught:
        imported_mesh_model(ModelFile.load(path, {key: value}))
    assert caught.value.place == key


def test_order_of_elements_beside_own_shells_is_named(tmp_path: Path) -> None:
    """A shell with an offset is none of CalculiX."""
    text = (
        "BEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,1.,1.,0.\n"
        "GRID,4,,0.,1.,0.\nCQUAD4,1,1,1,2,3,4,,0.1\nPSHELL,1,1,0.02,1,,1\n"
        "MAT1,1,2.1+11,,0.3,7850.\nENDDATA\n"
    )
    (tmp_path / "a.bdf").write_text(text, encoding="utf-8")
    path = mesh_model(tmp_path, "a.bdf", frame={"type": "buckens"})
    data = json.loads(path.read_text(encoding="utf-8"))
    del data["material"]
    data["markers"] = {"p": {"node": 1, "mesh_node": 1}}
    for order in (1, 2):
        data["geometry"] |= {"engine": "calculix", "order": order}
        data["geometry"]["file"] = str(tmp_path / "a.bdf")
        mesh = imported_mesh_model(ModelFile.checked(data, "test"))
        assert only(mesh, "N145").subject == "geometry.order"
        assert "N132" in codes(mesh)
