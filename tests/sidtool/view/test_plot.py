"""Pictures hold what they should, with units, and nothing is cut off."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.formats.field import write_field
from sidtool.formats.model import ModelFile
from sidtool.formats.result import Result, write_result
from sidtool.formats.scene import SceneFile, read_scene, unit_of
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.extra_outputs import outputs_at
from sidtool.pipeline.model_to_sid import field_from_model
from sidtool.plot import bodies, results
from sidtool.plot.curves import axis_label, group_outputs
from sidtool.plot.figure import saved_figure
from tests.codes import unwrapped
from tests.places import SLIDER_CRANK
from tests.solver.scenes import scene

from ..bodies import volume
from ..models import IGA, QM6, rod, rod_data
from ..pipeline.test_afterwards import spatial_wheel

STARTS = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
TWO_MODES = {"method": "modal", "modes": 2}
Shown = Callable[..., Any]


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Figures in place of the files that they would become."""
    retained: list[Any] = []
    for module in (bodies, results):
        monkeypatch.setattr(
            module, "save_figure", lambda page, path: retained.append(page)
        )
    return retained


@pytest.fixture(scope="module")
def wheel() -> Result:
    """A wheel at 7 rad/s, seen ten times a second; its rim has a marker."""
    content = spatial_wheel(7.0, 0.1)
    content["bodies"]["wheel"]["markers"] = {"rim": {"position": [0.5, 0, 0]}}
    content["outputs"] = {"record": ["wheel.rim.x", "wheel.x"]}
    return sidtool.simulate(validate_data(content, SceneFile))


@pytest.mark.parametrize("with_field", [True, False])
@pytest.mark.parametrize("kind", ["plane", "solid"])
def test_no_shape_leaves_its_window(
    kind: str, with_field: bool, pages: list[Any]
) -> None:
    model = (
        rod(QM6, reduction=TWO_MODES)
        if kind == "plane"
        else volume({"type": "hex20", "elements": [6, 1, 1]}, modes=2)
    )
    sid, field = field_from_model(model)
    bodies.plot_sid(Path("x.png"), sid, field if with_field else None)
    (page,) = pages
    assert len(page.axes) == sid.nq + 1
    for axes in page.axes:
        points = drawn_points(axes)
        limits = [axes.get_xlim(), axes.get_ylim()]
        if hasattr(axes, "get_zlim"):
            limits.append(axes.get_zlim())
        assert len(limits) == points.shape[1] == (3 if kind == "solid" else 2)
        for column, (low, high) in zip(points.T, limits, strict=True):
            assert low < column.min() <= column.max() < high
        assert axes.get_xlabel() == "x [m]"
    moved = (
        drawn_points(page.axes[1])[:, 1].max() - drawn_points(page.axes[0])[:, 1].max()
    )
    if kind == "plane":
        assert 0.03 < moved < 0.1


def drawn_points(axes: Any) -> np.ndarray:
    """Corners of all faces."""
    faces = axes.collections[-1]
    if hasattr(faces, "_faces"):
        return np.asarray(faces._faces, float).reshape(-1, 3)
    if hasattr(faces, "_vec"):  # matplotlib 3.10.0
        return np.asarray(faces._vec[:3], float).T
    return np.concatenate([path.vertices for path in faces.get_paths()])


def test_shapes_are_named_by_number_and_frequency(pages: list[Any]) -> None:
    sid = sidtool.read(SLIDER_CRANK / "rod_q4.SID_FEM")
    notes = bodies.plot_sid(Path("x.png"), sid)
    titles = [axes.get_title(loc="left") for axes in pages[0].axes]
    assert titles[1].startswith("q1, 31.7 Hz") and "3.14 kg" in titles[0]
    assert notes == [
        "drawn from the nodes of its SID, joined to their neighbours (its surface is "
        "not known)"
    ]
    assert notes[0] == pages[0].get_suptitle()


def test_a_field_of_another_body_is_refused() -> None:
    _, field = field_from_model(rod(IGA))
    sid = sidtool.read(SLIDER_CRANK / "rod_q4.SID_FEM")
    with pytest.raises(InputError, match="has other"):
        bodies.plot_sid(Path("x.png"), sid, field)


def test_models_show_mesh_markers_net_and_ties(pages: list[Any]) -> None:
    tie = {"type": "rigid", "to": ["right"]}
    data = rod_data(IGA)
    data["markers"]["piston_pin"] = {"node": 2, "tie": tie}
    model = validate_data(data, ModelFile)
    assert bodies.plot_model(Path("x.png"), model) == ["grey lines: the control net"]
    (axes,) = pages[0].axes
    texts = [text.get_text().strip() for text in axes.texts]
    assert texts == ["crank_pin", "piston_pin"]
    (legend,) = pages[0].legends
    assert legend.get_texts()[0].get_text() == "piston_pin: rigid tie"
    lines = [line for line in axes.lines if line.get_linewidth() == 0.5]
    assert len(lines) == 13 + 4  # of 13 x 4 control points


def test_curves_follow_the_motion_between_output_times(
    wheel: Result, pages: list[Any]
) -> None:
    """x = 0.5 cos 7 t; straight lines between output times miss it by 0.03."""
    assert results.plot_result(Path("x.png"), wheel) == []
    line = pages[0].axes[0].lines[0]
    t, x = line.get_xdata(), line.get_ydata()
    assert len(t) >= 2000
    assert np.abs(x - 0.5 * np.cos(7.0 * t)).max() < 1e-3
    assert pages[0].axes[0].get_ylabel() == "wheel.rim.x [m]"
    assert pages[0].axes[-1].get_xlabel() == "t [s]"
    straight = np.interp(t, wheel.t, wheel["wheel.rim.x"])
    assert np.abs(straight - x).max() > 0.02


def test_coarse_output_times_are_noted(pages: list[Any]) -> None:
    content = spatial_wheel(7.0, 0.8)
    content["outputs"] = {"record": ["wheel.wz"]}
    result = sidtool.simulate(validate_data(content, SceneFile))
    (notes,) = results.plot_result(Path("x.png"), result)
    assert notes.startswith("N821")


@pytest.mark.parametrize(("step", "followed"), [(5e-3, False), (2e-4, True)])
def test_vibrations_faster_than_output_times_are_not_invented(
    step: float, followed: bool, pages: list[Any]
) -> None:
    """x = 1 + 1e-3 cos(w t) at 228 Hz: the acceleration never exceeds 1e-3 w^2."""
    omega, amplitude = 2 * np.pi * 228.0, 1e-3
    spring = {"type": "spring_damper", "markers": ["ground", "mass"]}
    spring |= {"stiffness": 2.0 * omega**2, "rest": 1.0}
    content = scene(
        {"mass": {"mass": 2.0, "inertia": 1.0, "initial": {"position": [1.001, 0.0]}}},
        {},
        forces={"spring": spring},
        end=0.1,
        steps=round(0.1 / step),
    )
    recorded = content.with_({"outputs.record": ["mass.ax", "mass.x"]})
    result = sidtool.simulate(recorded)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        results.plot_result(Path("x.png"), result)
    fast = [w.message for w in caught if str(w.message).startswith("N820")]
    assert bool(fast) != followed
    line = pages[0].axes[0].lines[0]
    exact = -amplitude * omega**2 * np.cos(omega * np.asarray(line.get_xdata()))
    assert np.abs(line.get_ydata()).max() < 1.001 * amplitude * omega**2
    if followed:
        assert line.get_ydata() == pytest.approx(exact, abs=2e-2 * np.abs(exact).max())
    else:
        assert isinstance(fast[0], sidtool.DiagnosticWarning)
        assert fast[0].data["names"] == ("mass.ax", "mass.x")


def test_forces_of_an_analysis_are_drawn_as_it_found_them(pages: list[Any]) -> None:
    """Quasi-static: free vibrations of the same states would need other forces."""
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    outputs = scene.outputs.model_copy(update={"record": ("bearing.mz",)})
    time = scene.time.model_copy(update={"end": 1.0, "output_step": 0.05})
    scene = scene.model_copy(update={"outputs": outputs, "time": time})
    found = sidtool.inverse_dynamics(scene, base_folder=SLIDER_CRANK, quasi_static=True)
    results.plot_result(Path("x.png"), found)
    line = pages[0].axes[0].lines[0]
    assert np.array_equal(line.get_ydata(), found["bearing.mz"])
    drawn = outputs_at(found, ["bearing.mz"], found.t)["bearing.mz"]
    assert np.array_equal(drawn, found["bearing.mz"])
    with pytest.raises(InputError, match="there is no output 'bearing.fx'"):
        results.plot_result(Path("x.png"), found, names="bearing.fx")


def test_axes_have_numbers_without_an_offset() -> None:
    """Of 12 m that vary by 1 um matplotlib writes 1.19999e1 beside the axis."""
    t = np.linspace(0.0, 1.0, 50)
    with saved_figure(None, size=(4, 3)) as axes:
        axes.plot(t, 12.0 + 1e-6 * np.sin(9 * t))
        axes.figure.canvas.draw()
    assert axes.yaxis.get_offset_text().get_text() == ""
    assert axes.get_yticklabels()[1].get_text().startswith("11.999999")


def test_spectra_show_amplitudes(wheel: Result, pages: list[Any]) -> None:
    t = np.linspace(0, 10, 2000, endpoint=False)
    found = results.amplitude_spectrum(3.0 + 0.7 * np.sin(2 * np.pi * 12.0 * t))
    assert found.argmax() == 120 and found.max() == pytest.approx(0.7, rel=1e-3)
    results.plot_result(Path("x.png"), wheel, "spectrum", "wheel.rim.x")
    line = pages[0].axes[0].lines[0]
    peak = line.get_xdata()[line.get_ydata().argmax()]
    assert peak == pytest.approx(7.0 / (2 * np.pi), abs=0.26)


def test_energies_are_drawn_with_their_sum(wheel: Result, pages: list[Any]) -> None:
    results.plot_result(Path("x.png"), wheel, "energy")
    upper, lower = pages[0].axes
    histories = {line.get_label(): line.get_ydata() for line in upper.lines}
    assert histories["kinetic"] == pytest.approx(0.5 * 0.2 * 49.0, rel=1e-4)
    assert histories["sum"] == pytest.approx(histories["kinetic"])
    assert np.abs(lower.lines[0].get_ydata()).max() < 1e-4


def test_groups_and_units() -> None:
    names = ["rod.q1", "rod.q2", "piston.x", "rod.q10", "rod.tip.vx"]
    assert group_outputs(names) == [
        ["rod.q1", "rod.q2", "rod.q10"],
        ["piston.x"],
        ["rod.tip.vx"],
    ]
    assert axis_label(["rod.q1", "rod.q2"], unit_of) == "rod.q"
    assert axis_label(["rod.tip.vx"], unit_of) == "rod.tip.vx [m/s]"
    units = {
        "a.x": "m",
        "a.angle": "rad",
        "a.wz": "rad/s",
        "a.b.ax": "m/s\N{SUPERSCRIPT TWO}",
        "a.b.uy": "m",
        "a.vx_body": "m/s",
        "a.b.von_mises": "Pa",
        "a.peak_von_mises": "Pa",
        "j.angle_rate": "rad/s",
        "j.displacement_rate": "m/s",
        "j.fx": "N",
        "j.mz": "N m",
        "j.f2": "",
        "a.vq3": "",
        "motor.value": "",
        "motor.state.x": "",
        "energy.kinetic": "J",
        "constraint.position": "",
    }
    assert {name: unit_of(name) for name in units} == units


@pytest.mark.parametrize("ending", STARTS)
def test_the_command_draws_every_kind_of_file(
    ending: str, wheel: Result, tmp_path: Path
) -> None:
    write_result(tmp_path / "r.h5", wheel)
    sid, field = field_from_model(rod(QM6, reduction=TWO_MODES))
    sidtool.write(tmp_path / "rod.SID_FEM", sid)
    write_field(tmp_path / "rod.field.h5", field)
    files = ["r.h5", "rod.SID_FEM", "rod.field.h5"] if ending == ".png" else ["r.h5"]
    for source in (*(tmp_path / name for name in files), SLIDER_CRANK / "rod_q4.toml"):
        target = tmp_path / f"{source.stem}{ending}"
        assert run(["plot", str(source), "-o", str(target), "--force"]) == 0
        assert target.read_bytes().startswith(STARTS[ending])


def test_the_command_reports_wrong_input(
    wheel: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "r.h5"
    write_result(path, wheel)
    sid = str(SLIDER_CRANK / "rod_q4.SID_FEM")
    cases = [
        ([str(path), "-o", "x.jpg"], "which the ending .jpg does not say"),
        ([str(path), "-o", "x.csv"], "which the ending .csv does not say"),
        ([str(path), "-o", "x.png", "--outputs", "wheel.q1"], "wheel is rigid"),
        ([str(path), "-o", "x.png", "--field", sid], "says nothing of a result"),
        ([sid, "-o", "x.png", "--kind", "drift"], "says nothing of a sid"),
        ([str(SLIDER_CRANK / "slider_crank.toml"), "-o", "x.png"], "is a scene file"),
    ]
    for arguments, message in cases:
        assert run(["plot", *arguments]) == 2, arguments
        assert message in unwrapped(capsys.readouterr().err)
