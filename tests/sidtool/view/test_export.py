"""Files for ParaView, opened by VTK's own readers."""

from __future__ import annotations

import errno
import json
import shutil
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.stress import von_mises
from sidtool.formats.field import Field, write_field
from sidtool.formats.result import Result, write_result
from sidtool.formats.scene import read_scene
from sidtool.pipeline.model_to_sid import field_from_model
from sidtool.solver.output.body_outputs import FrameMotion
from sidtool.view import export
from sidtool.view.body_fields import peak_stresses
from sidtool.view.export import (
    ExportBody,
    ExportMesh,
    _join_cells,
    export_mesh,
    write_pvd,
    write_vtkhdf,
)
from tests.codes import unwrapped
from tests.formats.test_growing import little_room
from tests.places import SLIDER_CRANK

from ..beams import clamped_beam
from ..bodies import WIDTH, volume
from ..models import IGA, QM6, rod


@pytest.fixture(scope="module")
def rod_with_field() -> tuple[sidtool.SID, Field]:
    return field_from_model(rod({**QM6, "elements": [40, 4]}))


@pytest.fixture(scope="module")
def result(rod_with_field: tuple[sidtool.SID, Field]) -> Result:
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    time = scene.time.model_copy(update={"end": 1.6, "output_step": 0.05})
    scene = scene.model_copy(update={"time": time})
    return sidtool.simulate(
        scene, base_folder=SLIDER_CRANK, sids={"rod": rod_with_field[0]}
    )


@pytest.fixture(scope="module")
def mesh(result: Result, rod_with_field: tuple[sidtool.SID, Field]) -> ExportMesh:
    return export_mesh(result, {"rod": rod_with_field[1]})


def vtk() -> Any:
    return import_module("vtkmodules.all")


def arrays(grid: Any) -> dict[str, np.ndarray]:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    data = grid.GetPointData()
    names = [data.GetArrayName(k) for k in range(data.GetNumberOfArrays())]
    found = {name: vtk_to_numpy(data.GetArray(name)) for name in names}
    found["points"] = vtk_to_numpy(grid.GetPoints().GetData())
    found["body"] = vtk_to_numpy(grid.GetCellData().GetArray("body"))
    return {name: np.array(values) for name, values in found.items()}


def read_hdf(path: Path, t: float) -> Any:
    reader = vtk().vtkHDFReader()
    assert reader.CanReadFile(str(path))
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    reader.UpdateTimeStep(t)
    return reader.GetOutputDataObject(0)


def read_vtu(path: Path) -> Any:
    reader = vtk().vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


@pytest.mark.needs("vtk")
def test_beams_are_tubes_with_the_volume_of_the_beam(tmp_path: Path) -> None:
    """Closed surfaces that VTK measures: 0.2 m of 8 x 6 mm, and a rigid arm beside."""
    reduction = {"method": "modal", "modes": 2}
    model = clamped_beam(0.2, (0.008, 0.006), elements=3, reduction=reduction)
    sid, field = field_from_model(model)
    scene = sidtool.Scene(
        dimension="spatial",
        time=sidtool.Time(end=0.01, output_step=0.01),
        bodies={
            "bar": sidtool.SidBody(sid="bar.h5", markers={"root": 1}),
            "arm": sidtool.RigidBody(
                mass=1.0, inertia=[1.0] * 3, markers={"end": {"position": [1, 0, 0]}}
            ),
        },
        joints={"hold": sidtool.Fixed(markers=["ground", "bar.root"])},
    )
    ran = scene.simulate(sids={"bar": sid})
    created = export_mesh(ran, {"bar": field})
    write_vtkhdf(tmp_path / "m.vtkhdf", created)
    grid = read_hdf(tmp_path / "m.vtkhdf", 0.0)
    for number, part in enumerate(created.parts):
        choose = vtk().vtkThreshold()
        choose.SetInputData(grid)
        choose.SetInputArrayToProcess(0, 0, 0, 1, "body")
        choose.SetLowerThreshold(number)
        choose.SetUpperThreshold(number)
        skin = vtk().vtkGeometryFilter()
        skin.SetInputConnection(choose.GetOutputPort())
        measure = vtk().vtkMassProperties()
        measure.SetInputConnection(skin.GetOutputPort())
        measure.Update()
        if part.name == "bar":
            assert measure.GetVolume() == pytest.approx(0.2 * 0.008 * 0.006, rel=1e-4)
        low, high = part.positions.min(axis=0), part.positions.max(axis=0)
        assert 0 < measure.GetVolume() <= np.prod(high - low) * (1 + 1e-4)


@pytest.mark.needs("vtk")
@pytest.mark.parametrize("kind", ["vtkhdf", "pvd"])
def test_vtk_reads_the_motion_of_the_markers(
    kind: str, result: Result, mesh: ExportMesh, tmp_path: Path
) -> None:
    """The points at both pins: places, velocities and displacements of the outputs."""
    path = tmp_path / f"motion.{kind}"
    (write_vtkhdf if kind == "vtkhdf" else write_pvd)(path, mesh)
    rod_part = next(part for part in mesh.parts if part.name == "rod")
    first = sum(len(p.positions) for p in mesh.parts[: mesh.parts.index(rod_part)])
    for k in (0, 11, 25, 32):
        t = float(result.t[k])
        if kind == "vtkhdf":
            grid = read_hdf(path, t)
        else:
            grid = read_vtu(tmp_path / "motion" / f"motion_{k:05d}.vtu")
        found = arrays(grid)
        assert grid.GetNumberOfPoints() == mesh.n_points
        for name, place in (("crank_pin", [0, 0, 0]), ("piston_pin", [1, 0, 0])):
            row = int(np.linalg.norm(rod_part.positions - place, axis=1).argmin())
            assert np.allclose(rod_part.positions[row], place, atol=1e-12)
            for data, stem in (("points", ""), ("velocity", "v")):
                columns = [result[f"rod.{name}.{stem}{axis}"][k] for axis in "xy"]
                assert np.allclose(found[data][first + row], [*columns, 0], atol=2e-6)
            c, s = np.cos(result["rod.angle"][k]), np.sin(result["rod.angle"][k])
            ux, uy = (result[f"rod.{name}.u{axis}"][k] for axis in "xy")
            own = [c * ux - s * uy, s * ux + c * uy, 0]
            assert np.allclose(found["displacement"][first + row], own, atol=1e-9)


@pytest.mark.needs("vtk")
def test_stresses_are_those_of_the_field_and_unknown_elsewhere(
    result: Result,
    mesh: ExportMesh,
    rod_with_field: tuple[sidtool.SID, Field],
    tmp_path: Path,
) -> None:
    write_vtkhdf(tmp_path / "m.vtkhdf", mesh)
    k = 30
    found = arrays(read_hdf(tmp_path / "m.vtkhdf", float(result.t[k])))
    q = result["rod.q*"][k]
    expected = rod_with_field[1].stresses(q)
    names = [part.name for part in mesh.parts]
    counts = [len(part.positions) for part in mesh.parts]
    first = sum(counts[: names.index("rod")])
    inside = slice(first, first + counts[names.index("rod")])
    size = np.abs(expected).max()
    assert np.allclose(found["stress"][inside], expected, atol=1e-6 * size)
    assert np.allclose(
        found["von_mises"][inside], von_mises(expected), atol=1e-6 * size
    )
    others = np.delete(np.arange(mesh.n_points), np.arange(mesh.n_points)[inside])
    assert np.isnan(found["stress"][others]).all()
    assert set(found["body"]) == {0, 1, 2}


@pytest.mark.needs("vtk")
@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet4", "tet10", "iga"])
def test_cells_have_the_order_of_vtk(kind: str, tmp_path: Path) -> None:
    """VTK's own volumes of the cells, all positive, add up to that of the body."""
    settings = {"type": kind, "elements": [8, 2, 1]}
    if kind == "iga":
        settings = {"type": "iga", "degrees": [2, 2, 1], "elements": [6, 2, 1]}
    _, field = field_from_model(volume(settings))
    fixed = FrameMotion(np.zeros((1, 3)), np.eye(3)[None], *np.zeros((2, 1, 3)))
    none = np.zeros((1, field.nq))
    part = ExportBody(
        "rod",
        field.positions,
        field.cells,
        field.shapes,
        field.stress,
        field.initial_stress,
        fixed,
        none,
        none,
        "",
    )
    mesh = ExportMesh(np.zeros(1), (part,), *_join_cells([part]), ())
    write_vtkhdf(tmp_path / "m.vtkhdf", mesh)
    sizes = vtk().vtkCellSizeFilter()
    sizes.SetInputData(read_hdf(tmp_path / "m.vtkhdf", 0.0))
    sizes.Update()
    from vtkmodules.util.numpy_support import vtk_to_numpy

    volumes = vtk_to_numpy(sizes.GetOutput().GetCellData().GetArray("Volume"))
    assert (volumes > 0).all()
    assert volumes.sum() == pytest.approx(0.04 * WIDTH, rel=1e-2)


def test_the_peak_is_the_largest_stress_of_all_points_and_times(
    result: Result, mesh: ExportMesh, rod_with_field: tuple[sidtool.SID, Field]
) -> None:
    """Against all exported stresses, and E kappa y where it is."""
    field = rod_with_field[1]
    peak = peak_stresses(result, {"rod": field})["rod"]
    most = max(np.nanmax(step["von_mises"]) for step in mesh.steps())
    assert most <= peak.stress < 1.2 * most
    assert peak.stress == pytest.approx(von_mises(peak.components))
    row = int(np.linalg.norm(field.positions - peak.place, axis=1).argmin())
    assert np.allclose(field.positions[row], peak.place)
    k = int(np.abs(result.t - peak.time).argmin())
    assert abs(result.t[k] - peak.time) <= 0.025 + 1e-9
    x, y, _ = peak.place
    assert abs(y) > 0.9 * 0.06 * ((x - 0.5) ** 2 + 0.25)


def test_the_peak_is_that_of_beam_theory(
    rod_with_field: tuple[sidtool.SID, Field],
) -> None:
    """The first mode alone: E kappa y from the deflection of its axis."""
    sid, field = field_from_model(rod({**IGA, "elements": [24, 2]}))
    on_axis = np.flatnonzero(np.abs(field.positions[:, 1]) < 1e-9)
    x = field.positions[on_axis, 0]
    w = np.polynomial.Polynomial.fit(x, field.shapes[on_axis, 1, 0], 12)
    s = np.linspace(0.1, 0.9, 400)
    theory = 2.1e11 * np.abs(w.deriv(2)(s)) * 0.06 * ((s - 0.5) ** 2 + 0.25)
    q = np.eye(sid.nq)[0]
    stress = von_mises(field.stresses(q))
    assert stress.max() == pytest.approx(theory.max(), rel=2e-2)
    place = field.positions[stress.argmax(), 0]
    assert place == pytest.approx(s[theory.argmax()], abs=0.05)
    del rod_with_field


def test_without_a_field_there_is_no_peak(result: Result) -> None:
    with pytest.raises(InputError, match="no full field with stresses"):
        peak_stresses(result)


def test_the_command_writes_files_and_prints_notes(
    result: Result,
    rod_with_field: tuple[sidtool.SID, Field],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source, field = tmp_path / "r.h5", tmp_path / "rod.h5"
    write_result(source, result)
    write_field(field, rod_with_field[1])
    given = ["--field", f"rod={field}"]
    target = tmp_path / "m.vtkhdf"
    assert run(["export", str(source), "-o", str(target), *given]) == 0
    text = capsys.readouterr().out
    assert "rod is the 160 cells of its full field" in text and "33 times" in text
    assert run(["export", str(source), "-o", str(target), *given]) == 0  # replaced
    capsys.readouterr()
    assert run(["export", str(source), "--json", *given]) == 0
    data = json.loads(capsys.readouterr().out)["rod"]
    assert (
        data["von_mises"]
        == peak_stresses(result, {"rod": rod_with_field[1]})["rod"].stress
    )
    assert run(["export", str(source), "--peak", *given]) == 0
    assert "von Mises Pa" in capsys.readouterr().out
    cases = [
        ([str(source)], "there is nothing to do"),
        ([str(source), "-o", "m.vtk"], "which the ending .vtk does not say"),
        ([str(source), "-o", "m.png"], "which the ending .png does not say"),
        ([str(source), "--peak"], "no full field with stresses"),
        ([str(SLIDER_CRANK / "rod_q4.SID_FEM"), "--peak"], "is no option for a sid"),
    ]
    for arguments, message in cases:
        assert run(["export", *arguments]) == 2, arguments
        assert message in unwrapped(capsys.readouterr().err)


def test_thousands_of_bodies_are_named(tmp_path: Path) -> None:
    """Names as an attribute must fit into 64 kB."""
    fixed = FrameMotion(np.zeros((1, 3)), np.eye(3)[None], *np.zeros((2, 1, 3)))
    none = np.zeros((1, 0))
    point, cells = np.zeros((1, 3)), {"tri3": np.zeros((1, 3), int)}
    shapes, initial = np.zeros((1, 3, 0)), np.zeros((1, 6))
    names = tuple(f"body{k}" for k in range(5000))
    parts = tuple(
        ExportBody(name, point, cells, shapes, None, initial, fixed, none, none, "")
        for name in names
    )
    mesh = ExportMesh(np.zeros(1), parts, *_join_cells(list(parts)), ())
    write_vtkhdf(tmp_path / "m.vtkhdf", mesh)
    with h5py.File(tmp_path / "m.vtkhdf") as file:
        body = file["VTKHDF/CellData/body"][()]
        assert tuple(file["bodies"].asstr()[body]) == names


@pytest.mark.parametrize("room", [0, 600, 9000])
def test_a_full_disk_ends_no_export_half_written(
    room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """libhdf5 ended the process when the file could not grow."""
    little_room(monkeypatch, room, tmp_path)
    with pytest.raises(OSError) as caught:
        write_vtkhdf(tmp_path / "m.vtkhdf", still_points(300, 1.0))
    assert caught.value.errno == errno.ENOSPC
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_names_the_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    write_pvd(tmp_path / "m.pvd", still_points(2, 1.0))
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.setattr(export, "flush_to_disk", full)
    with pytest.raises(OSError, match="No space") as caught:
        write_pvd(tmp_path / "m.pvd", still_points(3, 2.0))
    assert caught.value.filename == str(tmp_path / "m")
    assert sorted(tmp_path.rglob("*")) == before


def still_points(count: int, x: float) -> ExportMesh:
    """A point that rests at x."""
    zeros = np.zeros((count, 3))
    place = zeros + [x, 0.0, 0.0]
    fixed = FrameMotion(place, np.tile(np.eye(3), (count, 1, 1)), zeros, zeros)
    point, cells = np.zeros((1, 3)), {"tri3": np.zeros((1, 3), int)}
    none, initial = np.zeros((count, 0)), np.zeros((1, 6))
    shapes = np.zeros((1, 3, 0))
    part = ExportBody("p", point, cells, shapes, None, initial, fixed, none, none, "")
    return ExportMesh(np.arange(float(count)), (part,), *_join_cells([part]), ())


def content(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.parametrize("stop", ["writing", "moving"])
def test_no_pvd_names_files_of_two_motions(
    stop: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_pvd(tmp_path / "m.pvd", still_points(4, 1.0))
    (tmp_path / "m" / "notes.vtu").write_bytes(b"of the user")
    before = content(tmp_path)

    def interrupt(*arguments: Any) -> Any:
        done.append(None)
        if len(done) > 2:
            raise KeyboardInterrupt
        return usual(*arguments)

    done: list[None] = []
    name = "_vtu_text" if stop == "writing" else "replace_file"
    usual = getattr(export, name)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(export, name, interrupt)
        write_pvd(tmp_path / "m.pvd", still_points(3, 2.0))
    if stop == "writing":
        assert content(tmp_path) == before
    else:
        assert not (tmp_path / "m.pvd").exists()
    write_pvd(tmp_path / "m.pvd", still_points(3, 2.0))
    other = tmp_path / "other"
    other.mkdir()
    write_pvd(other / "m.pvd", still_points(3, 2.0))
    expected = content(other) | {"m/notes.vtu": b"of the user"}
    shutil.rmtree(other)
    assert content(tmp_path) == {str(Path(k)): v for k, v in expected.items()}


def test_links_are_lines_between_their_markers() -> None:
    """A spring from the ground to a marker of a moving body, a rod, and a joint spring,
    which has no line: ends and their velocities are outputs of the markers."""
    moving = {"position": [0.5, 0.0], "velocity": [0.0, 1.0], "angular_velocity": 3.0}
    scene = sidtool.Scene(
        dimension="planar",
        time=sidtool.Time(end=0.2, output_step=0.1),
        bodies={
            "bar": sidtool.RigidBody(
                mass=1.0,
                inertia=0.1,
                markers={"tip": {"position": [0.2, 0.1]}},
                initial=moving,
            ),
            "bob": sidtool.RigidBody(mass=1.0, initial={"position": [1.0, 0.5]}),
        },
        ground={"markers": {"wall": {"position": [0.0, 2.0]}}},
        joints={"rod": sidtool.Distance(markers=["bar.tip", "bob"])},
        forces={
            "spring": sidtool.SpringDamper(
                markers=["ground.wall", "bar.tip"], stiffness=5.0
            )
        },
        outputs=sidtool.Outputs(record=["bar.tip.*", "bob.*", "spring.length"]),
    )
    result = scene.simulate()
    created = export_mesh(result)
    names = [part.name for part in created.parts]
    assert sorted(names[-2:]) == ["rod", "spring"]
    rod, spring = (created.parts[names.index(name)] for name in ("rod", "spring"))
    assert (created.types == 3).sum() == 2 and created.body.max() == len(names) - 1
    for k in range(len(result.t)):
        at, of_rod = spring.at(k), rod.at(k)
        assert np.allclose(at["points"][0], [0.0, 2.0, 0.0])
        tip = [result[f"bar.tip.{q}"][k] for q in ("x", "y", "vx", "vy")]
        assert np.allclose(at["points"][1], [*tip[:2], 0.0], atol=1e-12)
        assert np.allclose(at["velocity"][1], [*tip[2:], 0.0], atol=1e-12)
        assert not at["velocity"][0].any()
        way = np.linalg.norm(np.diff(at["points"], axis=0))
        assert way == pytest.approx(result["spring.length"][k], rel=1e-12)
        bob = [result[f"bob.{q}"][k] for q in ("x", "y")]
        assert np.allclose(of_rod["points"], [[*tip[:2], 0.0], [*bob, 0.0]], atol=1e-12)


@pytest.mark.needs("vtk")
@pytest.mark.parametrize("ending", ["vtkhdf", "pvd"])
def test_lines_are_read_by_vtk(ending: str, tmp_path: Path) -> None:
    scene = sidtool.Scene(
        dimension="planar",
        gravity=[0.0, -9.81],
        time=sidtool.Time(end=0.1, output_step=0.1),
        bodies={"bob": sidtool.RigidBody(mass=1.0, initial={"position": [1.0, 0.0]})},
        joints={"rod": sidtool.Distance(markers=["ground", "bob"])},
        outputs=sidtool.Outputs(record=["bob.x", "bob.y"]),
    )
    result = scene.simulate()
    path = tmp_path / f"m.{ending}"
    export.write_export(path, export_mesh(result))
    if ending == "vtkhdf":
        grid = read_hdf(path, 0.1)
    else:
        grid = read_vtu(tmp_path / "m" / "m_00001.vtu")
    line = grid.GetCell(grid.GetNumberOfCells() - 1)
    assert line.GetCellType() == 3
    ends = [line.GetPoints().GetPoint(k) for k in range(2)]
    bob = [result["bob.x"][-1], result["bob.y"][-1], 0.0]
    assert np.allclose(ends, [[0.0, 0.0, 0.0], bob], atol=1e-6)
