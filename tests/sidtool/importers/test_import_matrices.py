"""Matrices of other programs: the same body from every format, and their checks."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from numpy.testing import assert_allclose

from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile, read_model
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.validate import check
from tests.codes import codes, only

from ..bodies import BEAMS, beam, volume, volume_data
from .mesh_files import inp_text, rod_mesh

BLOCK = {"type": "hex20", "elements": [4, 1, 1]}


@pytest.fixture(scope="module")
def solid() -> FiniteElementModel:
    return finite_element_model(volume(BLOCK))


def table(body: FiniteElementModel) -> np.ndarray:
    """(ndof, 2) node number, counted from 1, and direction."""
    dofs = np.zeros((body.ndof, 2), int)
    for node, row in enumerate(body.table):
        for direction, dof in enumerate(row):
            if dof >= 0:
                dofs[dof] = node + 1, direction + 1
    return dofs


def nodes(body: FiniteElementModel) -> np.ndarray:
    return np.column_stack([np.arange(1, len(body.positions) + 1), body.positions])


def lines(matrix: sp.csr_matrix, labels: list[str]) -> str:
    c = sp.tril(matrix).tocoo()
    rows = zip(c.row, c.col, c.data, strict=True)
    return "\n".join(f"{labels[i]} {labels[j]} {float(v)!r}" for i, j, v in rows) + "\n"


def write_nodes(folder: Path, body: FiniteElementModel) -> None:
    text = "\n".join(" ".join(map(repr, map(float, r[1:]))) for r in nodes(body))
    numbered = [f"{i + 1} {row}" for i, row in enumerate(text.splitlines())]
    (folder / "nodes.txt").write_text("\n".join(numbered) + "\n", encoding="utf-8")


def as_calculix(folder: Path, body: FiniteElementModel) -> dict[str, str]:
    write_nodes(folder, body)
    labels = [str(i + 1) for i in range(body.ndof)]
    (folder / "rod.sti").write_text(lines(body.stiffness, labels), encoding="utf-8")
    (folder / "rod.mas").write_text(lines(body.mass, labels), encoding="utf-8")
    dofs = "\n".join(f"{n}.{d}" for n, d in table(body))
    (folder / "rod.dof").write_text(dofs + "\n", encoding="utf-8")
    return {
        "stiffness": "rod.sti",
        "mass": "rod.mas",
        "dofs": "rod.dof",
        "nodes": "nodes.txt",
    }


def as_abaqus(folder: Path, body: FiniteElementModel) -> dict[str, str]:
    write_nodes(folder, body)
    labels = [f"{n},{d}," for n, d in table(body)]
    for name, matrix in (("k", body.stiffness), ("m", body.mass)):
        (folder / f"{name}.mtx").write_text(lines(matrix, labels), encoding="utf-8")
    return {"stiffness": "k.mtx", "mass": "m.mtx", "nodes": "nodes.txt"}


def as_matrix_market(folder: Path, body: FiniteElementModel) -> dict[str, str]:
    write_nodes(folder, body)
    scipy.io.mmwrite(folder / "k.mtx", body.stiffness)
    scipy.io.mmwrite(folder / "m.mtx", body.mass)
    return {"stiffness": "k.mtx", "mass": "m.mtx", "nodes": "nodes.txt"}


def arrays(body: FiniteElementModel) -> dict[str, np.ndarray]:
    triplets = {}
    for name, matrix in (("stiffness", body.stiffness), ("mass", body.mass)):
        c = matrix.tocoo()
        triplets[name] = np.column_stack([c.row, c.col, c.data])
    return triplets | {"nodes": nodes(body), "dofs": table(body)}


def as_npz(folder: Path, body: FiniteElementModel) -> dict[str, str]:
    np.savez(folder / "rod.npz", **arrays(body))
    return {"file": "rod.npz"}


def as_npz_in_upper_case(folder: Path, body: FiniteElementModel) -> dict[str, str]:
    (folder / as_npz(folder, body)["file"]).rename(folder / "ROD.NPZ")
    return {"file": "ROD.NPZ"}


def as_hdf5(folder: Path, body: FiniteElementModel) -> dict[str, str]:
    with h5py.File(folder / "rod.h5", "w") as file:
        for name, value in arrays(body).items():
            file[name] = value
        del file["mass"]
        file["mass"] = body.mass.toarray()
    return {"file": "rod.h5"}


FORMATS: dict[str, Callable[[Path, FiniteElementModel], dict[str, str]]] = {
    "calculix": as_calculix,
    "abaqus": as_abaqus,
    "matrix market": as_matrix_market,
    "npz": as_npz,
    "NPZ": as_npz_in_upper_case,
    "hdf5": as_hdf5,
}


def model(folder: Path, files: dict[str, Any], **changes: Any) -> Path:
    data = volume_data({"type": "matrices"}, 5)
    del data["material"]
    data["geometry"] = {"type": "matrices", **files}
    data["frame"] = {"type": "buckens"}
    data["markers"] = {
        "crank_pin": {"node": 1, "mesh_node": 1},
        "piston_pin": {"node": 2, "mesh_node": 3},
    }
    data |= changes
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return folder / "model.json"


@pytest.fixture(scope="module")
def native() -> SID:
    """The block of the native mesh."""
    own = volume_data(BLOCK, 5) | {"frame": {"type": "buckens"}}
    return sid_from_model(validate_data(own, ModelFile))


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_body(
    tmp_path: Path, name: str, solid: FiniteElementModel, native: SID
) -> None:
    sid = sid_from_model(model(tmp_path, FORMATS[name](tmp_path, solid)))
    assert sid.from_matrices
    assert_allclose(np.diag(sid.Ke.m0), np.diag(native.Ke.m0), rtol=1e-6)
    assert_allclose(sid.J.m0, native.J.m0, rtol=1e-9, atol=1e-9)
    assert sid.mass == pytest.approx(3.14, rel=1e-10)


def test_full_mass_with_rotations(tmp_path: Path) -> None:
    """A beam by its matrices alone: mass, J, Ct, Cr, Me as from its own field."""
    settings = BEAMS["lumped"] | {"elements": 12}
    body = finite_element_model(beam(settings))
    files = as_npz(tmp_path, body)
    sid = sid_from_model(model(tmp_path, files))
    own = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    own["geometry"] = beam(settings).geometry.model_dump(mode="json")
    own["discretisation"] = settings
    own["material"] = volume_data(BLOCK)["material"]
    own["markers"] = {
        "crank_pin": {"node": 1, "parameters": [0]},
        "piston_pin": {"node": 2, "parameters": [1 / 6]},
    }
    (tmp_path / "own.json").write_text(json.dumps(own), encoding="utf-8")
    expected = sid_from_model(tmp_path / "own.json")
    assert sid.mass == pytest.approx(expected.mass, rel=1e-12)
    scale = np.abs(expected.J.m0).max()
    assert_allclose(sid.J.m0, expected.J.m0, atol=1e-10 * scale)
    assert_allclose(sid.Me.m0, expected.Me.m0, atol=1e-9)
    assert_allclose(np.diag(sid.Ke.m0), np.diag(expected.Ke.m0), rtol=1e-6)
    turned = (sid.Oe.m1 - expected.Oe.m1)[range(sid.nq), range(sid.nq)]
    assert 0.1 < np.abs(turned).max() < 0.12  # half elements turn as rigid ones
    errors = [c for c in check(sid) if c.severity == "error" and c.verdict == "failed"]
    assert not errors


def spoil_symmetry(data: dict[str, np.ndarray]) -> None:
    rows = data["stiffness"]
    upper = np.flatnonzero(rows[:, 0] < rows[:, 1])
    rows[upper[0], 2] += 1e-3 * np.abs(rows[:, 2]).max()


def drop_mass(data: dict[str, np.ndarray]) -> None:
    data["mass"] = data["mass"][(data["mass"][:, :2] != 7).all(axis=1)]


def negative_stiffness(data: dict[str, np.ndarray]) -> None:
    data["stiffness"][:, 2] *= -1


def ground(data: dict[str, np.ndarray]) -> None:
    extra = [[0, 0, np.abs(data["stiffness"][:, 2]).max()]]
    data["stiffness"] = np.vstack([data["stiffness"], extra])


def swap_nodes(data: dict[str, np.ndarray]) -> None:
    data["nodes"][[0, -1], 1:] = data["nodes"][[-1, 0], 1:]


def hold(data: dict[str, np.ndarray]) -> None:
    keep = np.arange(3, len(data["dofs"]))
    for name in ("stiffness", "mass"):
        inside = (data[name][:, :2] >= 3).all(axis=1)
        data[name] = data[name][inside] - [3, 3, 0]
    data["dofs"] = data["dofs"][keep]


def lose_direction(data: dict[str, np.ndarray]) -> None:
    hold(data)
    data["dofs"][0] = [2, 6]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (spoil_symmetry, "stiffness matrix is not symmetric"),
        (drop_mass, "have no mass, the first in row 8"),
        (negative_stiffness, "stiffness matrix has negative eigenvalues"),
        (ground, "resists rigid motion"),
        (swap_nodes, "node positions that fit the matrix"),
        (hold, "resists rigid motion"),
        (lose_direction, "has no degree of freedom 1"),
        (lambda data: data.pop("dofs"), "dofs: is missing"),
        (lambda data: data["dofs"].__setitem__(0, [999, 1]), "belongs to node 999"),
        (lambda data: data["dofs"].__setitem__(0, [2, 1]), "direction 1 twice"),
        (lambda data: data["mass"].__setitem__((0, 0), 1e20), "mass: has a row"),
        (lambda data: data["nodes"].__setitem__((0, 0), 1.5), "nodes: has a row"),
    ],
)
def test_unsound_matrices(
    tmp_path: Path,
    spoil: Callable[[dict[str, np.ndarray]], None],
    message: str,
    solid: FiniteElementModel,
) -> None:
    data = arrays(solid)
    spoil(data)
    np.savez(tmp_path / "rod.npz", **data)
    with pytest.raises(InputError) as caught:
        sid_from_model(model(tmp_path, {"file": "rod.npz"}))
    assert message in str(caught.value) and "rod.npz" in str(caught.value)


def test_node_sets_of_matrix_files(tmp_path: Path) -> None:
    """A set clamps the rod as its edge does: the frequencies of the native mesh."""
    native = volume({"type": "hex8", "elements": [6, 2, 2]}, 5)
    body = finite_element_model(native)
    left = np.flatnonzero(body.positions[:, 0] < 1e-9) + 1
    frame = {"type": "tangent", "marker": "crank_pin", "clamp": "left"}
    expected = sid_from_model(native)
    for write in (as_npz, as_hdf5):
        files = write(tmp_path, body)
        if write is as_npz:
            np.savez(tmp_path / "rod.npz", **arrays(body), **{"set.left": left})
        else:
            with h5py.File(tmp_path / "rod.h5", "a") as file:
                file["set.left"] = left
        sid = sid_from_model(model(tmp_path, files, frame=frame))
        assert_allclose(np.diag(sid.Ke.m0), np.diag(expected.Ke.m0), rtol=1e-7)
    np.savez(tmp_path / "rod.npz", **arrays(body), **{"set.left": left + 9999})
    with pytest.raises(InputError, match="set.left: holds other than numbers of nodes"):
        sid_from_model(model(tmp_path, {"file": "rod.npz"}, frame=frame))


def test_mass_against_the_geometry(tmp_path: Path, solid: FiniteElementModel) -> None:
    files = as_npz(tmp_path, solid)
    sid_from_model(model(tmp_path, files | {"expected_mass": 3.14}))
    with pytest.raises(InputError, match="holds 3.14 kg; expected 3140 kg"):
        sid_from_model(model(tmp_path, files | {"expected_mass": 3140.0}))


def test_printed_digits_do_not_hold_the_body(
    tmp_path: Path, solid: FiniteElementModel
) -> None:
    """Rounded entries are no springs to the ground.

    The entries are 1e9 times the lowest eigenvalue: springs of their last digit, 1e-14,
    would change it by more than 1e-6.
    """
    files = as_npz(tmp_path, solid)
    expected = sid_from_model(model(tmp_path, files))
    data = arrays(solid)
    data["stiffness"][:, 2] = [float(f"{x:.13e}") for x in data["stiffness"][:, 2]]
    np.savez(tmp_path / "rod.npz", **data)
    sid = sid_from_model(model(tmp_path, files))
    assert_allclose(np.diag(sid.Ke.m0), np.diag(expected.Ke.m0), rtol=2e-7)
    body = finite_element_model(read_model(tmp_path / "model.json"))
    force = body.stiffness @ np.tile(np.eye(3), (body.ndof // 3, 1))
    assert np.abs(force).max() < 1e-15 * abs(body.stiffness).sum(axis=1).max()


def test_too_few_digits_are_refused(tmp_path: Path, solid: FiniteElementModel) -> None:
    """Eight digits of this slender body change its first frequency by 8 %."""
    data = arrays(solid)
    data["stiffness"][:, 2] = [float(f"{x:.7e}") for x in data["stiffness"][:, 2]]
    np.savez(tmp_path / "rod.npz", **data)
    with pytest.raises(InputError, match="which hides how the body bends"):
        sid_from_model(model(tmp_path, {"file": "rod.npz"}))


def test_a_cut_off_matrix(tmp_path: Path, solid: FiniteElementModel) -> None:
    files = as_calculix(tmp_path, solid)
    text = (tmp_path / "rod.sti").read_text(encoding="utf-8").rstrip()
    (tmp_path / "rod.sti").write_text(text.rsplit(" ", 1)[0], encoding="utf-8")
    with pytest.raises(InputError, match="is the file cut off") as caught:
        sid_from_model(model(tmp_path, files))
    assert "rod.sti: line" in str(caught.value)


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet10"])
def test_calculix_itself(tmp_path: Path, kind: str) -> None:
    """Its matrices give its own free frequencies; its mesh those of our elements.

    A straight rod of constant height: CalculiX integrates the mass of C3D20 with 27
    points, which is exact for parallelepipeds only (1.4e-5 of a tapered rod).
    """
    mesh = rod_mesh(kind)
    x, y, _ = mesh.positions.T
    for at in np.unique(x.round(9)):
        section = np.isclose(x, at, atol=1e-8)
        y[section] *= 0.03 / np.abs(y[section]).max()
    text = inp_text(mesh).replace("C3D8I", "C3D8").replace("C3D20R", "C3D20")
    text = text.split("*STEP")[0]
    steps = {
        "own": "*BOUNDARY\nLEFT,1,3\n*STEP\n*FREQUENCY\n6\n*END STEP\n",
        "free": "*STEP\n*FREQUENCY,SOLVER=MATRIXSTORAGE\n6\n*END STEP\n",
    }
    for name, step in steps.items():
        (tmp_path / f"{name}.inp").write_text(text + step, encoding="utf-8")
        subprocess.run(["ccx", name], cwd=tmp_path, capture_output=True, check=False)
    rows = [
        line.split()
        for line in (tmp_path / "own.dat").read_text(encoding="utf-8").splitlines()
    ]
    own = [float(r[3]) for r in rows if len(r) == 5 and r[0].isdigit()][:5]
    clamp = {"type": "tangent", "marker": "crank_pin", "clamp": "LEFT"}
    markers = {
        "crank_pin": {"node": 1, "position": [0.0, -0.03, -0.005]},
        "piston_pin": {"node": 2, "position": [1.0, -0.03, -0.005]},
    }
    files = {
        "stiffness": "free.sti",
        "mass": "free.mas",
        "dofs": "free.dof",
        "nodes": "free.inp",
    }
    path = model(tmp_path, files, frame=clamp, markers=markers)
    found = np.sqrt(np.diag(sid_from_model(path).Ke.m0)) / (2 * np.pi)
    # Its table of frequencies has seven digits: half of the last one is up to 5e-7.
    assert_allclose(found, own, rtol=5e-7)
    data = json.loads(path.read_text(encoding="utf-8"))
    data["geometry"] = {"type": "mesh", "file": "own.inp"}
    data["discretisation"] = {"type": "mesh"}
    path.write_text(json.dumps(data), encoding="utf-8")
    ours = np.sqrt(np.diag(sid_from_model(path).Ke.m0)) / (2 * np.pi)
    # CalculiX integrates tetrahedra with fewer points.
    assert_allclose(ours, own, rtol=1e-6 if kind != "tet10" else 2e-2)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_torsion_of_matrices_turns_the_inertia(
    tmp_path: Path, axis: int, mass: str
) -> None:
    """J of a bar that is twisted by theta = f q along its axis, as its sections turn.

    J_yy grows by (Iz - Iy) rho f^2 q^2 dx, J_zz shrinks by as much, J = J0 - q Oe1 q;
    rho (Iy + Iz) f^2 integrates to the modal mass 1. A consistent matrix of slender
    beams has four fifths of the sections' inertia in its displacements, where it cannot
    be distinguished from that of the line; a note reports this.
    """
    axes = np.roll(np.eye(3), -axis, axis=0)
    height, width = 0.05, 0.01
    data = beam(BEAMS["beam"]).model_dump(mode="json", exclude_none=True)
    data["geometry"]["start"] = [0.0, 0.0, 0.0]
    data["geometry"]["end"] = list(axes[0])
    data["geometry"]["y_axis"] = list(axes[1])
    section = {"shape": "rectangle", "height": height, "width": width}
    data["geometry"]["section"] = section
    data["discretisation"] = {"type": "beam", "elements": 10, "mass": mass}
    body = finite_element_model(validate_data(data, ModelFile))
    shape = np.zeros((body.ndof, 1))
    along = np.cos(np.pi * np.linspace(0.0, 1.0, 11))
    shape[body.table[:, 3:]] = (along[:, None] * axes[0])[..., None]
    np.save(tmp_path / "shapes.npy", shape)
    user = {"method": "user", "file": str(tmp_path / "shapes.npy")}
    ends = {
        name: {"node": n, "mesh_node": at}
        for name, n, at in [("a", 1, 1), ("b", 2, 11)]
    }
    path = model(tmp_path, as_npz(tmp_path, body), markers=ends, reduction=user)
    sid = sid_from_model(path)
    found = codes(finite_element_model(read_model(path)))
    assert ("N126" in found) == (mass == "consistent")
    iy, iz = height * width**3, width * height**3
    ratio = (iy - iz) / (iy + iz)
    expected = np.zeros((3, 3))
    expected[1, 1], expected[2, 2] = ratio, -ratio
    expected = axes.T @ expected @ axes
    found = sid.Oe.m1[0, 0]
    if mass == "consistent":
        assert (np.sign(np.round(found[:3], 9)) == np.sign(np.diag(expected))).all()
        return
    assert_allclose(found, [*np.diag(expected), 0.0, 0.0, 0.0], atol=1e-6)
    del data["damping"]
    data |= {"reduction": user, "frame": {"type": "buckens"}}
    own = sid_from_model(validate_data(data, ModelFile))
    assert_allclose(own.Oe.m1[0, 0], found, atol=1e-6)


def test_untied_markers_do_not_turn(tmp_path: Path, solid: FiniteElementModel) -> None:
    """Nodes of solids have displacements alone: psi is zero, which is named."""
    end = np.flatnonzero(solid.positions[:, 0] > solid.positions[:, 0].max() - 1e-9)
    np.savez(tmp_path / "rod.npz", **arrays(solid), **{"set.end": end + 1})
    files = {"file": "rod.npz"}
    sid = sid_from_model(model(tmp_path, files))
    assert only(sid, "N147").data == {
        "markers": ("crank_pin", "piston_pin"),
        "axes": ("x", "y", "z"),
    }
    assert not any(node.psi.m0.any() for node in sid.nodes)
    tied = {"node": 2, "mesh_node": 3, "tie": {"type": "distributing", "to": "end"}}
    own = {"crank_pin": {"node": 1, "mesh_node": 1}, "piston_pin": tied}
    sid = sid_from_model(model(tmp_path, files, markers=own))
    assert only(sid, "N147").data["markers"] == ("crank_pin",)
    beams = finite_element_model(beam(BEAMS["lumped"] | {"elements": 12}))
    assert "N147" not in codes(sid_from_model(model(tmp_path, as_npz(tmp_path, beams))))
