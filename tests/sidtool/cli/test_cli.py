"""The command line: exit status, messages, and no file after wrong input."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import pytest

from sidtool.cli.main import cli, run
from sidtool.formats.diagnostics.record import DiagnosticWarning
from tests.codes import only_warning, unwrapped
from tests.places import SLIDER_CRANK
from tests.solver.compiler.small_kernels import scaled


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the example to spoil, and an empty folder `out` beside it."""
    shutil.copytree(SLIDER_CRANK, tmp_path / "example")
    (tmp_path / "out").mkdir()
    return tmp_path


def without_version(sid: Path) -> str:
    """The text of a SID file but for the version of sidtool that its title names."""
    text, count = re.subn(r"\[sidtool [\d.]+;", "[", sid.read_text(encoding="utf-8"))
    assert count == 1
    return text


def refused(
    arguments: list[object], capsys: pytest.CaptureFixture[str], folder: Path
) -> str:
    """The one message of a command that must end with status 2 and write nothing."""
    assert run([str(argument) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    error = unwrapped(captured.err)
    assert error.count("\n") == 1 and "Traceback" not in error
    assert list((folder / "out").iterdir()) == []
    return error


def spoiled(folder: Path, file: str, old: str, new: str) -> Path:
    path = folder / "example" / file
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


def _imported(modules: tuple[str, ...], *arguments: object) -> tuple[str, str]:
    """The output of a command, and which of some modules it has imported."""
    words = [str(argument) for argument in arguments]
    code = (
        f"import sys; from sidtool.cli.main import run; run({words!r});"
        f"print([m for m in {modules!r} if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        encoding="utf-8",
    )
    return done.stdout, done.stderr.strip()


def test_help_needs_no_heavy_import() -> None:
    """Help answers at once because nothing heavy is imported for it."""
    heavy = ("numpy", "scipy", "numba", "h5py", "pydantic", "rich", "matplotlib")
    text, imported = _imported(heavy, "--help")
    assert imported == "[]"
    assert "simulate" in text


def test_a_simulation_imports_what_it_needs(folder: Path) -> None:
    """Conversion and the search for an accuracy need SciPy, half a second more, and
    kernels that are not on disk need numba.
    """
    heavy = ("scipy.linalg", "scipy.sparse", "scipy.interpolate", "matplotlib", "numba")
    heavy += ("sidtool.formats.model",)
    if not version("numpy").startswith("1."):  # which imports it by itself
        heavy += ("numpy.ma",)
    scene, result = folder / "example" / "slider_crank.toml", folder / "out" / "r.h5"
    changes = ("--quiet", "--set", "time.end=0.01")
    _, imported = _imported(heavy, "simulate", scene, "-o", result, *changes)
    assert result.is_file()
    assert imported == "[]"


@pytest.mark.parametrize("command", sorted(cli.commands))
def test_every_command_explains_itself(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([command, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"Usage: sidtool {command}" in text
    assert command == "demo" or f"sidtool {command} " in text.split("Example", 1)[1]


def test_a_wrong_command_is_a_wrong_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["simulat"]) == 2
    assert "simulate" in unwrapped(capsys.readouterr().err)
    assert run(["convert", "x.toml"]) == 2
    assert "'-o'" in unwrapped(capsys.readouterr().err)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("density = 7850.0", "", "material.density: is missing"),
        ("density = 7850.0", "density = '7850 kg'", "found '7850 kg'; expected a n"),
        ("density = 7850.0", "density = -1", "found -1; expected a number greater"),
        ("density =", "densty =", "material.densty: is not a known key"),
        ('clamp = "left"', 'clamp = "lefft"', "frame.clamp"),
        ("[0, 0, 0, 1, 1, 1]", "[0, 0, 1, 1, 1]", "geometry.knots[0]"),
        ("thickness = 0.01", "thickness = nan", "geometry.thickness: found nan"),
        ("[material]", "[material", "line 6, column"),
        ('type = "q4"', 'type = "q5"', "discretisation.type: found 'q5'"),
        ('format = "sidtool model"', "", "format: is missing"),
    ],
)
def test_a_wrong_model_is_refused(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    old: str,
    new: str,
    message: str,
) -> None:
    path = spoiled(folder, "rod_q4.toml", old, new)
    error = refused(["convert", path, "-o", folder / "out/a.SID_FEM"], capsys, folder)
    assert error.startswith(f"sidtool: {path}: ")
    assert message in error


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("end = 3.0", "", "time.end: is missing"),
        ("mass = 5.0", "mass = -5.0", "bodies.piston.mass: found -5.0"),
        ("mass = 5.0", "mass = '5 kg'", "bodies.piston.mass: found '5 kg'"),
        ('"crank.pin"', '"crank.pon"', "crank has no marker 'pon'"),
        ("piston_pin = 2", "piston_pin = 7", "7"),
        ("rod_q4.SID_FEM", "rod_q5.SID_FEM", "rod_q5.SID_FEM"),
        ('integrator = "radau9"', 'integrator = "euler"', "euler"),
        ('"rod.q5"', '"rod.q9"', "q9"),
    ],
)
def test_a_wrong_scene_is_refused(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    old: str,
    new: str,
    message: str,
) -> None:
    path = spoiled(folder, "slider_crank.toml", old, new)
    targets = ["-o", folder / "out/r.h5", "-o", folder / "out/r.csv"]
    error = refused(["simulate", path, *targets], capsys, folder)
    assert str(folder / "example") in error
    assert message in error


def test_a_joint_that_cannot_be_closed_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = '[joints.weld]\ntype = "fixed"\nmarkers = ["ground", "crank.pin"]\n\n'
    path = spoiled(
        folder, "slider_crank.toml", "# From rest to", f"{more}# From rest to"
    )
    error = refused(["simulate", path, "-o", folder / "out/r.h5"], capsys, folder)
    assert str(path) in error and "weld" in error


def test_an_unreachable_start_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = '[joints.post]\ntype = "coincident"\nmarkers = ["ground.far", "crank.pin"]\n'
    path = spoiled(
        folder,
        "slider_crank.toml",
        "# From rest to",
        f"[ground.markers]\nfar = {{ position = [5.0, 0.0] }}\n\n{more}\n# From rest",
    )
    error = refused(["simulate", path, "-o", folder / "out/r.h5"], capsys, folder)
    assert str(path) in error and "post" in error


def test_a_cut_off_sid_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sid = folder / "example" / "rod_q4.SID_FEM"
    whole = sid.read_text(encoding="utf-8")
    sid.write_text(whole[: len(whole) // 2], encoding="utf-8")
    for arguments in (
        ["simulate", folder / "example/slider_crank.toml", "-o", folder / "out/r.h5"],
        ["convert", sid, "-o", folder / "out/b.h5"],
        ["validate", sid],
        ["info", sid],
    ):
        error = refused(arguments, capsys, folder)
        assert str(sid) in error
        assert "line" in error


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["convert", "none.toml", "-o", "out/a.h5"], "there is no such file"),
        (["convert", "example/rod_q4.SID_FEM", "-o", "out/a", "--timing"], "--timing"),
        (["convert", "example", "-o", "out/a.h5"], "is a folder"),
        (["convert", "example/slider_crank.toml", "-o", "out/a.h5"], "is a scene file"),
        (["convert", "example/rod_q4.toml", "-o", "none/a.h5"], str(Path("none/a.h5"))),
        (["convert", "example/rod_q4.toml", "-o", "out"], "is a folder"),
        (
            ["convert", "example/rod_q4.SID_FEM", "-o", "out/a", "--units", "SI"],
            "--units: found 'SI'; expected FROM:TO",
        ),
        (
            ["convert", "example/rod_q4.SID_FEM", "-o", "out/a", "--units", "SI:ell"],
            "ell",
        ),
        (["simulate", "example/rod_q4.toml", "-o", "out/r.h5"], "is a model file"),
        (["simulate", "none.toml"], "there is no such file"),
        (
            ["simulate", "example/slider_crank.toml", "--rtol", "2", "-o", "out/r.h5"],
            "--rtol: found 2.0",
        ),
        (
            ["simulate", "example/slider_crank.toml", "--step", "0", "-o", "out/r.h5"],
            "--step: found 0.0",
        ),
        (
            ["simulate", "example/slider_crank.toml", "--sid", "rode=x"],
            "--sid: found 'rode=x'; expected BODY=FILE with a BODY out of rod",
        ),
        (
            ["simulate", "example/slider_crank.toml", "-o", "none/r.csv"],
            str(Path("none/r.csv")),
        ),
        (["validate", "example/frequencies.toml"], "expected a SID, model or scene"),
        (["validate", "example/rod_q4.SID_FEM", "--reference", "no.toml"], "no.toml"),
        (["info", "none"], "there is no such file"),
        (["info", "example/frequencies.toml"], "is a reference file"),
    ],
)
def test_other_wrong_input(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[object],
    message: str,
) -> None:
    monkeypatch.chdir(folder)
    assert message in refused(arguments, capsys, folder)


def test_convert_prints_how_long_each_stage_took(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The durations of all stages are those of the conversion."""
    model = str(folder / "example/rod_q4.toml")
    begin = time.monotonic()
    assert (
        run(["convert", model, "-o", str(folder / "a.h5"), "--timing", "--json"]) == 0
    )
    most = time.monotonic() - begin
    stages = json.loads(capsys.readouterr().out)["timing"]
    names = [each["stage"] for each in stages]
    assert names[0] == "discretising" and names[-1] == "integrating the inertia"
    assert 0.0 < sum(each["seconds"] for each in stages) <= most
    assert run(["convert", model, "-o", str(folder / "b.h5"), "--timing"]) == 0
    assert names[0] in capsys.readouterr().out


def test_convert_there_and_back(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sid = folder / "example" / "rod_q4.SID_FEM"
    assert run(["convert", str(sid), "-o", str(folder / "a.h5")]) == 0
    assert run(["convert", str(folder / "a.h5"), "-o", str(folder / "b.SID_FEM")]) == 0
    assert without_version(folder / "b.SID_FEM") == without_version(sid)
    assert "5 shape functions, 31.7011, 200.553" in capsys.readouterr().out


def test_convert_to_other_units(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sid, there = folder / "example" / "rod_q4.SID_FEM", folder / "mm.h5"
    assert run(["convert", str(sid), "-o", str(there), "--units", "SI:mm-t-s"]) == 0
    capsys.readouterr()
    assert run(["info", str(there)]) == 0
    text = capsys.readouterr().out
    assert "0.003140069778" in text
    assert "31.7011" in text


def test_repair_of_a_good_sid_changes_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sid, out = folder / "example" / "rod_q4.SID_FEM", folder / "a.SID_FEM"
    assert run(["convert", str(sid), "-o", str(out), "--repair"]) == 0
    assert "repair: 0 numbers changed" in capsys.readouterr().out
    assert without_version(out) == without_version(sid)


def test_repair_lists_what_it_changes(
    folder: Path, capsys: pytest.CaptureFixture[str], field_data: Path
) -> None:
    """The file of PY_SID has second-order terms of Oe that are not symmetric."""
    source = field_data / "sid" / "Beam_3m.SID_FEM"
    assert run(["convert", str(source), "-o", str(folder / "a.h5"), "--repair"]) == 0
    text = capsys.readouterr().out
    assert "Oe" in text and "symmetric in the modes" in text


def test_validate_a_good_and_a_bad_sid(
    capsys: pytest.CaptureFixture[str], field_data: Path
) -> None:
    good = [str(SLIDER_CRANK / "rod_q4.SID_FEM")]
    assert run(["validate", *good]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("good: 0 errors")
    table = ["--reference", str(SLIDER_CRANK / "frequencies.toml")]
    assert run(["validate", *good, *table, "--strict"]) == 0
    assert "paper, ANSYS" in capsys.readouterr().out
    assert run(["validate", str(field_data / "sid" / "Beam_3m.SID_FEM")]) == 1
    assert "this body cannot move freely" in capsys.readouterr().out


def test_validate_judges_the_distance_to_another_sid(
    capsys: pytest.CaptureFixture[str],
) -> None:
    files = [str(SLIDER_CRANK / "rod_q4.SID_FEM"), "--reference"]
    files.append(str(SLIDER_CRANK / "rod_iga.SID_FEM"))
    assert run(["validate", *files]) == 0
    assert run(["validate", *files, "--tolerance", "1e-6"]) == 1
    capsys.readouterr()


def test_validate_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    sid = str(SLIDER_CRANK / "rod_q4.SID_FEM")
    assert run(["validate", sid, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["passed"] is True
    assert [check["id"] for check in data["checks"]][:2] == ["I1", "I2"]
    assert data["units"]["candidates"][0]["system"] == "m-kg-s"


def test_info_of_a_sid(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(SLIDER_CRANK / "rod_q4.SID_FEM")]) == 0
    lines = capsys.readouterr().out.splitlines()
    modes = [line.split() for line in lines if "Eigen Mode" in line]
    assert [mode[1] for mode in modes] == [
        "31.7011",
        "200.5533",
        "560.6341",
        "1082.3189",
        "1254.9495",
    ]
    assert [mode[2:4] for mode in modes] == [["bending", "y"]] * 4 + [["axial", "x"]]
    assert any("tangent frame, fixed to node 1" in line for line in lines)


def test_info_of_a_model_and_a_scene(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(SLIDER_CRANK / "rod_iga.toml")]) == 0
    text = capsys.readouterr().out
    assert "degrees 2 and 1" in text and "functions 25 x 8" in text
    assert run(["info", str(SLIDER_CRANK / "slider_crank.toml")]) == 0
    text = capsys.readouterr().out
    for word in ("point mass", "point_on_line", "polynomial, 2 pieces", "301 output"):
        assert word in text


def test_info_of_a_scene_lists_damping_and_the_markers_of_forces(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (SLIDER_CRANK / "slider_crank.toml").read_text(encoding="utf-8")
    rod = (SLIDER_CRANK / "rod_q4.SID_FEM").as_posix()
    more = f'{rod}"\ndamping = {{ type = "frequency" }} #'
    scene = tmp_path / "damped.toml"
    friction = """
[forces.rub]
type = "friction"
joint = "slider"
coordinate = "displacement"
force = 2
speed = 0.01
"""
    scene.write_text(
        text.replace("rod_q4.SID_FEM", more, 1).replace(
            "inertia = false", "inertia = true"
        )
        + friction,
        encoding="utf-8",
    )
    assert run(["info", str(scene)]) == 0
    stdout = capsys.readouterr().out
    assert "rod_q4.SID_FEM," in stdout
    assert "damping" in stdout and "quadratic" in stdout  # a long path wraps the cell
    assert "slider, displacement" in stdout


@pytest.mark.parametrize("kind", ["model", "scene", "reference"])
def test_the_schema_is_json(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["schema", kind]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["type"] == "object"
    assert schema["properties"]["format"]["const"] == f"sidtool {kind}"


def test_a_closed_pipe_is_no_error() -> None:
    """Also when its reader is gone before the first word (it was status 1 then)."""
    for arguments in (
        ["schema", "scene"],
        ["info", str(SLIDER_CRANK / "rod_q4.SID_FEM")],
    ):
        process = subprocess.Popen(
            [sys.executable, "-m", "sidtool", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
        )
        assert process.stdout is not None
        process.stdout.close()
        assert (process.communicate()[1], process.returncode) == ("", 0)


def test_interruption_is_reported_in_one_word(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("sidtool.pipeline.files.kind_of", interrupt)
    assert run(["info", "x"]) == 130
    assert "interrupted" in unwrapped(capsys.readouterr().err)


def test_a_warmup_that_stores_nothing_has_failed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One kernel stands for all."""
    # Imported before `find_kernel` is replaced, which it would keep.
    import sidtool.fmu.linking  # noqa: F401
    from sidtool.solver.compiler import kernel_cache, precompile

    kernel = scaled(2.0)
    monkeypatch.setattr(precompile, "all_groups", lambda _: [("small:scaled",)])
    monkeypatch.setattr(precompile, "find_kernel", lambda name: kernel)
    monkeypatch.setattr(kernel_cache, "_warned", set())
    monkeypatch.setattr(precompile, "_available", set())
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(Path(__file__) / "cache"))
    with pytest.warns(DiagnosticWarning) as told:
        assert run(["warmup"]) == 1
    assert only_warning(told).code == "N810"
    monkeypatch.undo()
    assert "kernels compiled" in capsys.readouterr().out


def test_a_warmup_compiles_the_kernels_of_units(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One kernel stands for all; the second warm-up has nothing to do."""
    from sidtool.fmu import linking
    from sidtool.solver.compiler import precompile

    kernel = scaled(2.0)
    units = [("sidtool_scaled", kernel, kernel.signatures[0])]
    monkeypatch.setattr(precompile, "all_groups", lambda _: [])
    monkeypatch.setattr(linking, "library_kernels", lambda *_: units)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    for said in ("1 kernels compiled", "nothing to compile"):
        assert run(["warmup", "--fmu"]) == 0
        assert said in capsys.readouterr().out
    assert len(list(tmp_path.glob("*/*.kernel"))) == 1
