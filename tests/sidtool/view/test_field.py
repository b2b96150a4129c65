"""The full field of a body: where its points are, how they move, and their stresses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sidtool.cli.main import run
from sidtool.discretisation.registry import finite_element_model
from sidtool.field.body_field import sample_body
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.stress import node_stress
from sidtool.formats.field import Field, mismatch_text, read_field, write_field
from sidtool.formats.model import ModelFile
from sidtool.pipeline.files import kind_of
from sidtool.pipeline.model_to_sid import field_from_model
from tests.codes import unwrapped
from tests.places import EXAMPLES

from ..bodies import WIDTH, beam, volume
from ..models import IGA, Q4, QM6, annulus, rod

SOLIDS = {kind: {"type": kind, "elements": [6, 2, 1]} for kind in ("hex8", "tet4")}
SOLIDS |= {kind: {"type": kind, "elements": [4, 2, 1]} for kind in ("hex20", "tet10")}
PLANE = {"q4": rod(Q4), "qm6": rod(QM6), "iga": rod(IGA), "annulus": annulus(IGA)}
SPACE = {kind: volume(settings) for kind, settings in SOLIDS.items()}
SPACE["iga"] = volume({"type": "iga", "degrees": [2, 2, 1], "elements": [4, 1, 1]})


@pytest.mark.parametrize("name", [*PLANE, *(f"{kind} solid" for kind in SPACE)])
def test_a_linear_displacement_has_its_uniform_stress_everywhere(name: str) -> None:
    """Hooke's law of a given gradient; also on curved and distorted elements."""
    model = SPACE[name.removesuffix(" solid")] if "solid" in name else PLANE[name]
    body = finite_element_model(model)
    d = body.dimension
    gradient = 1e-4 * np.random.default_rng(3).standard_normal((d, d))
    fields = np.zeros((body.ndof, 1))
    fields[body.table[:, :d], 0] = body.positions @ gradient.T
    sampled = sample_body(body)
    moved = sampled.displacement(fields)[:, :d, 0]
    assert np.allclose(moved, sampled.positions[:, :d] @ gradient.T, atol=1e-15)
    assert sampled.stress is not None
    found, expected = sampled.stress(fields)[..., 0], hooke(gradient)
    assert np.allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def hooke(gradient: np.ndarray, e: float = 2.1e11, nu: float = 0.3) -> np.ndarray:
    """xx, yy, zz, xy, yz, xz; of 2 x 2 gradients in plane stress."""
    strain = 0.5 * (gradient + gradient.T)
    shear = e / (2 * (1 + nu))
    if len(strain) == 2:
        xx, yy = strain[0, 0], strain[1, 1]
        normal = e / (1 - nu**2) * np.array([xx + nu * yy, yy + nu * xx])
        return np.array([*normal, 0, 2 * shear * strain[0, 1], 0, 0])
    lame = e * nu / ((1 + nu) * (1 - 2 * nu))
    tensor = 2 * shear * strain + lame * np.trace(strain) * np.eye(3)
    return tensor[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]


@pytest.mark.parametrize("kind", SPACE)
def test_the_surface_of_a_solid_is_closed_and_holds_its_volume(kind: str) -> None:
    """Divergence theorem; the volume between the parabolas is 0.04 WIDTH m^3, and
    meshes with straight edges, chords of the parabolas, hold a little more."""
    sampled = sample_body(finite_element_model(SPACE[kind]))
    a, b, c = np.moveaxis(sampled.positions[sampled.triangles], 1, 0)
    volume_inside = np.einsum("pa,pa->p", a, np.cross(b, c)).sum() / 6
    edges = np.concatenate([sampled.triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    assert {tuple(edge) for edge in edges} == {tuple(edge) for edge in edges[:, ::-1]}
    assert volume_inside == pytest.approx(0.04 * WIDTH, rel=2e-2)


@pytest.mark.parametrize(
    "model", [rod(Q4), rod(IGA), SPACE["hex20"], beam({"type": "beam", "elements": 8})]
)
def test_points_move_as_the_nodes_of_the_sid(model: ModelFile) -> None:
    """At the ends: the middle of the edge or of the section."""
    sid, field = field_from_model(model)
    for node in sid.nodes:
        distance = np.abs(field.positions - node.position)
        near = np.flatnonzero(distance[:, 0] < 1e-9)
        offset = (field.positions[near] - node.position)[:, :, None]
        turn = np.cross(np.moveaxis(node.psi.m0, 0, -1)[None], offset[..., 0][:, None])
        rigid = node.phi.m0 + np.moveaxis(turn, 1, 2)
        size = np.abs(field.shapes).max()
        assert len(near) >= 3
        assert np.allclose(field.shapes[near], rigid, atol=2e-2 * size)


def test_stresses_at_markers_are_those_of_the_sid() -> None:
    """The table [stress] evaluates markers on its own way: exact derivatives."""
    model = rod(IGA, stress={})
    inner = model.markers["piston_pin"].model_copy(
        update={"node": 7, "edge": None, "at": None, "parameters": (0.5, 1.0)}
    )
    model = model.model_copy(update={"markers": {**model.markers, "waist": inner}})
    sid, field = field_from_model(model)
    node, q = sid.node(7), np.array([2e-3, -1e-3, 3e-4, 1e-4, 2e-5])
    row = int(np.linalg.norm(field.positions - node.position, axis=1).argmin())
    assert np.allclose(field.positions[row], node.position, atol=1e-9)
    expected = node_stress(sid, 7, q)
    found = field.stresses(q)[row]
    assert np.allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def test_bending_stress_is_that_of_beam_theory() -> None:
    """sigma = -E kappa y in the waist, with kappa from the deflection of the shape."""
    fine = {"type": "hex20", "elements": [12, 2, 1]}
    _, field = field_from_model(volume(fine))
    y_part, z_part = (np.abs(field.shapes[:, axis]).max(axis=0) for axis in (1, 2))
    bending = int(np.argmax(y_part > 5 * z_part))
    x, y, _ = field.positions.T
    top = y > 0.99 * 0.06 * ((x - 0.5) ** 2 + 0.25)
    near = top & (abs(x - 0.5) < 0.26)
    kappa = 2 * np.polyfit(x[near] - 0.5, field.shapes[near, 1, bending], 6)[-3]
    waist = top & (abs(x - 0.5) < 1e-9)
    assert field.stress is not None and waist.sum() >= 2
    sigma = field.stress[waist, 0, bending]
    assert np.allclose(sigma, -2.1e11 * kappa * y[waist], rtol=3e-2)


def test_files_give_everything_back(tmp_path: Path) -> None:
    sid, field = field_from_model(rod(IGA))
    write_field(tmp_path / "rod.field.h5", field)
    back = read_field(tmp_path / "rod.field.h5")
    for name in ("positions", "shapes", "triangles", "stress", "initial_stress"):
        assert np.array_equal(getattr(back, name), getattr(field, name)), name
    assert back.thickness == field.thickness == 0.01
    assert {k: v.tolist() for k, v in back.cells.items()} == {
        k: v.tolist() for k, v in field.cells.items()
    }
    assert kind_of(tmp_path / "rod.field.h5") == "field"
    assert mismatch_text(back, sid) == ""
    stiffer = replace(sid, Ke=replace(sid.Ke, m0=1.001 * sid.Ke.m0))
    assert mismatch_text(back, stiffer) == "has other Ke than the SID"
    other, _ = field_from_model(rod(IGA, reduction={"method": "modal", "modes": 4}))
    assert mismatch_text(back, other) == "has 5 elastic coordinates, the SID 4"


def test_damaged_files_are_refused(tmp_path: Path) -> None:
    _, field = field_from_model(rod(QM6))
    path = tmp_path / "f.h5"
    wrong = replace(field, triangles=field.triangles + len(field.positions))
    write_field(path, wrong)
    with pytest.raises(InputError, match="nodes that it does not have"):
        read_field(path)
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(InputError, match="damaged or changed"):
        read_field(path)
    with pytest.raises(InputError, match="no such file"):
        read_field(tmp_path / "none.h5")


def test_a_field_without_stresses_is_refused_for_stress() -> None:
    _, field = field_from_model(beam({"type": "beam", "elements": 8}))
    assert isinstance(field, Field) and field.stress is None
    with pytest.raises(InputError, match="holds no stresses"):
        field.stresses(np.zeros(field.nq))


def test_the_command_writes_both(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = str(EXAMPLES / "slider_crank" / "rod_q4.toml")
    target, field = tmp_path / "rod.SID_FEM", tmp_path / "rod.field.h5"
    assert run(["convert", source, "-o", str(target), "--field", str(field)]) == 0
    assert "with 1661 points and stresses" in unwrapped(capsys.readouterr().out)
    given = (EXAMPLES / "slider_crank" / "rod_q4.SID_FEM").read_text(encoding="utf-8")
    assert len(target.read_text(encoding="utf-8").splitlines()) == len(
        given.splitlines()
    )
    assert read_field(field).nq == 5
    again = [
        "convert",
        str(target),
        "-o",
        str(tmp_path / "b.h5"),
        "--field",
        str(field),
    ]
    assert run(again) == 2
    assert "does not hold the whole body" in unwrapped(capsys.readouterr().err)
    units = ["--units", "mm-t-s:SI"]
    assert (
        run(["convert", source, "-o", str(target), "--field", str(field), *units]) == 2
    )
    assert "does not go with --units" in unwrapped(capsys.readouterr().err)
