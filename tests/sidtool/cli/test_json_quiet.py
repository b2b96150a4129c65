"""Every command that prints numbers gives JSON alone, or nothing, when asked."""

from __future__ import annotations

import json
import re
from pathlib import Path

import click
import pytest

import sidtool
from sidtool.cli.main import cli, run
from tests.places import EXAMPLES

#: Words of each command, and a key of its data.
COMMANDS = {
    "convert": ("beam.toml -o c.SID_FEM", "modes"),
    "stations": ("mast.csv --length 2", "mass [kg]"),
    "simulate": ("scene.toml -o s.h5", "outputs"),
    "info": ("r.h5", "outputs"),
    "analyse static": ("scene.toml", "outputs"),
    "analyse modes": ("scene.toml", "modes"),
    "analyse floquet": ("pushed.toml --period 0.1", "modes"),
    "analyse inverse": ("rigid.toml", "outputs"),
    "linearise": ("pushed.toml", "A"),
    "response": ("pushed.toml --frequencies 1:10:5", "peaks"),
    "validate": ("beam.SID_FEM", "checks"),
    "outputs": ("r.h5 --add bar.tip.vy -o o.h5", "bar.tip.vy"),
    "trim": ("beam.SID_FEM scene.toml -o t.SID_FEM --accuracy bar.tip.y=1e-2", "nodes"),
    "study": ("rigid.toml --integrator radau9 --rtol 1e-2 --jobs 1", "points"),
    "sweep": ("rigid.toml --over time.end=0.01,0.02 --of bar.x.max --jobs 1", "points"),
    "sensitivity": ("rigid.toml --with bar.mass --of max(bar.x)", "sensitivities"),
    "optimise": ("design.toml", "history"),
    "identify": (
        "rigid.toml --with bar.mass --target mass(bar)=1.1+-0.1",
        "variables",
    ),
}
#: Commands that say where files are, and no numbers.
FILES = {
    "plot": "r.h5 -o p.png",
    "animate": "r.h5 -o a.html",
    "export": "r.h5 -o e.vtkhdf",
    "report": "r.h5 -o r.html",
}
#: Commands that make a start, show themselves or a schema, prepare, or need a compiler.
OTHERS = {"new", "demo", "explain", "schema", "warmup", "fmu"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The beam on a wall, for 20 ms, its result, and a rigid bar that a drive turns."""
    place = tmp_path_factory.mktemp("files")
    text = (
        (EXAMPLES / "beam/beam.toml")
        .read_text(encoding="utf-8")
        .replace("modes = 8", "modes = 2")
    )
    (place / "beam.toml").write_text(text, encoding="utf-8")
    sid = sidtool.Model.load(place / "beam.toml").convert()
    sidtool.write(place / "beam.SID_FEM", sid)
    text = (
        (EXAMPLES / "beam/scene.toml")
        .read_text(encoding="utf-8")
        .replace("end = 1.0", "end = 0.02")
    )
    (place / "scene.toml").write_text(text, encoding="utf-8")
    result = sidtool.Scene.load(place / "scene.toml").simulate()
    result.save(place / "r.h5")
    turning = {"from": 0.0, "coefficients": [0.0, 1.0, 1.0]}
    sidtool.Scene(
        dimension="planar",
        time=sidtool.Time(end=0.1, output_step=0.05),
        bodies={"bar": sidtool.RigidBody(mass=1.0, inertia=0.1)},
        joints={"pin": sidtool.Revolute(markers=["ground", "bar"])},
        drives={
            "motor": sidtool.Drive(
                joint="pin", function={"type": "polynomial", "pieces": [turning]}
            )
        },
        outputs=sidtool.Outputs(record=["bar.angle", "motor.mz"]),
    ).save(place / "rigid.toml")
    push = {"type": "input", "name": "push"}
    sidtool.Scene(
        dimension="planar",
        time=sidtool.Time(end=0.1, output_step=0.05),
        bodies={"bar": sidtool.RigidBody(mass=1.0, inertia=0.1)},
        joints={"rail": sidtool.Prismatic(markers=["ground", "bar"])},
        inputs={"push": sidtool.Input()},
        forces={
            "spring": sidtool.SpringDamper(joint="rail", stiffness=1e3, damping=1.0),
            "push": sidtool.PointForce(marker="bar", force=[1.0, 0.0], function=push),
        },
        outputs=sidtool.Outputs(record=["bar.x"]),
    ).save(place / "pushed.toml")
    table = "position [1],mass_per_length,EA,EI_y,EI_z,GJ\n0,1,1,1,1,1\n1,1,1,1,1,1\n"
    (place / "mast.csv").write_text(table, encoding="utf-8")
    design = """
        format = "sidtool design"
        version = 1
        scene = "rigid.toml"
        variables.J = { key = "bar.inertia", min = 0.05, max = 0.2 }
        objective.minimise = "max(motor.mz)"
    """
    (place / "design.toml").write_text(design, encoding="utf-8")
    return place


def leaves(group: click.Group, before: str = "") -> dict[str, click.Command]:
    found: dict[str, click.Command] = {}
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            found |= leaves(command, f"{before}{name} ")
        else:
            found[f"{before}{name}"] = command
    return found


def test_every_command_is_tried() -> None:
    everything = leaves(cli)
    assert set(everything) == {*COMMANDS, *FILES, *OTHERS}
    options = {n: {o for p in c.params for o in p.opts} for n, c in everything.items()}
    assert {n for n in options if "--json" in options[n]} >= set(COMMANDS)
    silent = {name for name in options if "--quiet" in options[name]}
    assert silent >= {*COMMANDS, *FILES} - {"info"}


@pytest.mark.parametrize("command", COMMANDS)
def test_numbers_are_json_or_nothing(
    command: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setattr("sidtool.measurement.cache.cache_path", lambda: folder / "kept")
    words, key = COMMANDS[command]
    assert run([*command.split(), *words.split(), "--json"]) == 0
    data = json.loads(capfd.readouterr().out)
    assert key in data, list(data)
    if command != "info":
        assert run([*command.split(), *words.split(), "--quiet"]) == 0
        assert capfd.readouterr().out == ""
        assert run([*command.split(), *words.split(), "--quiet", "--json"]) == 0
        assert key in json.loads(capfd.readouterr().out)


def test_ranges_of_outputs_do_not_depend_on_files(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rows that went to a file are not in the result of the run."""
    monkeypatch.chdir(folder)
    found = []
    for more in ((), ("-o", "ranges.h5")):
        assert run(["simulate", "rigid.toml", "--json", *more]) == 0
        found.append(json.loads(capsys.readouterr().out)["outputs"])
    assert found[0] == found[1] and found[0]["bar.angle"]["last"] > 0.1


def test_a_stopped_analysis_has_data(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A free body under its weight has no equilibrium."""
    monkeypatch.chdir(folder)
    free = sidtool.Scene(
        dimension="planar",
        gravity=[0.0, -9.81],
        time=sidtool.Time(end=0.1, output_step=0.05),
        bodies={"stone": sidtool.RigidBody(mass=1.0, inertia=0.1)},
    )
    free.save(folder / "free.toml")
    assert run(["analyse", "static", "free.toml", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert not data["completed"] and data["diagnostics"][0]["code"] == "N701"


@pytest.mark.parametrize("command", FILES)
def test_files_are_written_without_a_word(
    command: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    assert run([command, *FILES[command].split(), "--quiet"]) == 0
    assert capfd.readouterr().out == ""


def test_quiet_commands_print_their_notes_and_nothing_else(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """As --help says; the basis of a conversion is no note where it is good."""
    monkeypatch.chdir(folder)
    poor = (folder / "beam.toml").read_text(encoding="utf-8")
    good = poor.replace('"modal"', '"attachment"\ninterfaces = ["tip"]')
    assert good != poor
    Path("good.toml").write_text(good, encoding="utf-8")
    for model, codes in (("beam.toml", ["N161"]), ("good.toml", [])):
        assert run(["convert", model, "-o", "q.SID_FEM", "--quiet", "--force"]) == 0
        out, err = capfd.readouterr()
        assert out == "" and re.findall(r"^warning (N\d+)", err, re.M) == codes
    remarks = ["a remark"]
    monkeypatch.setattr("sidtool.view.html_report.write_report", lambda *_: remarks)
    monkeypatch.setattr("sidtool.view.animation.animate", lambda *_, **__: remarks)
    Path("n.gif").touch()
    for quiet in (True, False):
        for command, target in (("report", "n.html"), ("animate", "n.gif")):
            words = [command, "r.h5", "-o", target, *["--quiet"] * quiet]
            assert run(words) == 0
            out, err = capfd.readouterr()
            assert ("info a remark" in err) == quiet
            assert ("info a remark" in out) != quiet


def test_info_fails_if_the_body_cannot_be_discretised(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The content of the model is printed nonetheless, and the output is valid JSON."""
    monkeypatch.chdir(folder)
    deck = {"type": "mesh", "file": "missing.inp"}
    model = {
        "format": "sidtool model",
        "version": 1,
        "title": "Lost",
        "geometry": deck,
        "discretisation": {"type": "mesh"},
        "frame": {"type": "buckens"},
        "markers": {"p": {"node": 1, "mesh_node": 1}},
        "reduction": {"method": "modal", "modes": 2},
    }
    Path("lost.json").write_text(json.dumps(model), encoding="utf-8")
    assert run(["info", "lost.json"]) == 2
    out, err = capfd.readouterr()
    assert "modal" in out and "missing.inp" in err
    assert run(["info", "lost.json", "--json"]) == 2
    assert json.loads(capfd.readouterr().out)["title"] == "Lost"
    assert run(["info", "beam.toml"]) == 0
