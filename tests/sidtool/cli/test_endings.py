"""No file gets a name whose ending says that it is something else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import cli, run
from sidtool.formats.base.errors import InputError
from sidtool.formats.field import write_field
from sidtool.formats.file_names import OUTPUT_KINDS, check_ending
from sidtool.pipeline.model_to_sid import field_from_model
from sidtool.view.html_report import write_report
from tests.codes import unwrapped

from ..bodies import volume

Thing = Any
#: What writes a thing, and what it is.
WRITERS: dict[str, tuple[Callable[[Path, Thing], Any], str]] = {
    "sid": (
        lambda path, written_things: sidtool.write(path, written_things["sid"]),
        "sid",
    ),
    "field": (
        lambda path, written_things: write_field(path, written_things["field"]),
        "field",
    ),
    "plot": (
        lambda path, written_things: written_things["result"].plot(path=path),
        "picture",
    ),
    "animate": (
        lambda path, written_things: written_things["result"].animate(path),
        "page",
    ),
    "report": (
        lambda path, written_things: write_report(
            path, written_things["result"], {}, path
        ),
        "page",
    ),
}


@pytest.fixture(scope="module")
def written_things() -> dict[str, Thing]:
    """A SID, its field, and a stone that flies."""
    sid, field = field_from_model(volume({"type": "hex8", "elements": [2, 1, 1]}))
    start = sidtool.Initial(velocity=[1.0, 2.0])
    result = sidtool.Scene(
        dimension="planar",
        gravity=[0.0, -9.81],
        time=sidtool.Time(end=0.2, output_step=0.1),
        bodies={"stone": sidtool.RigidBody(mass=1.0, initial=start)},
        outputs=sidtool.Outputs(record=["stone.x", "stone.y"]),
    ).simulate()
    return {"sid": sid, "field": field, "result": result}


@pytest.mark.parametrize("writer", WRITERS)
def test_writers_refuse_the_endings_of_other_kinds(
    writer: str, written_things: dict[str, Thing], tmp_path: Path
) -> None:
    write, kind = WRITERS[writer]
    own = {e for k in (kind, "film") for e in OUTPUT_KINDS[k].endings}
    others = {e for other in OUTPUT_KINDS.values() for e in other.endings} - own
    for ending in sorted({*others, ".toml", ".PNG" if kind != "picture" else ".CSV"}):
        with pytest.raises(InputError, match=f"the ending {ending.lower()} does not"):
            write(tmp_path / f"x{ending}", written_things)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", [".csv", ".txt", ".dat", ".h5", ".HDF5", ""])
def test_the_ending_determines_the_format_of_a_result(
    ending: str, written_things: dict[str, Thing], tmp_path: Path
) -> None:
    """`.txt` had HDF5 inside."""
    path, result = tmp_path / f"r{ending}", written_things["result"]
    result.save(path)
    if ending in OUTPUT_KINDS["table"].endings:
        numbers = np.loadtxt(path, delimiter=",", skiprows=1)
        np.testing.assert_array_equal(numbers[:, 1:], result.values)
    else:
        np.testing.assert_array_equal(sidtool.read(path).values, result.values)


def test_a_result_is_not_written_as_something_else(
    written_things: dict[str, Thing], tmp_path: Path
) -> None:
    for ending in (".sid_fem", ".json", ".html", ".vtkhdf", ".toml", ".gif"):
        with pytest.raises(InputError, match=f"the ending {ending} does not say"):
            written_things["result"].save(tmp_path / f"r{ending}")
    assert not list(tmp_path.iterdir())


def test_any_ending_is_allowed_if_it_selects_no_format() -> None:
    for kind, written in OUTPUT_KINDS.items():
        for name in ("run", "run.of_today"):
            if not written.chooses:
                check_ending(name, kind)
                continue
            with pytest.raises(InputError, match=r"an ending out of \."):
                check_ending(name, kind)


#: Commands that write files, and endings that none of their files has.
COMMANDS = {
    "convert": (["{sid}", "-o"], (".csv", ".png", ".json")),
    "convert --field": (["{model}", "-o", "x.h5", "--field"], (".csv", ".SID_FEM")),
    "simulate": (["{scene}", "-o"], (".json", ".png", ".SID_FEM")),
    "analyse static": (["{scene}", "-o"], (".json", ".png", ".SID_FEM")),
    "analyse modes": (["{scene}", "-o"], (".h5", ".csv", ".png")),
    "analyse inverse": (["{scene}", "-o"], (".json", ".png", ".SID_FEM")),
    "outputs": (["{result}", "--add", "stone.vx", "-o"], (".json", ".png")),
    "plot": (["{result}", "-o"], (".csv", ".jpg", ".h5", "")),
    "animate": (["{result}", "-o"], (".csv", ".png", ".avi", "")),
    "export": (["{result}", "-o"], (".h5", ".vtu", "")),
    "report": (["{result}", "-o"], (".pdf", ".htm", "")),
    "trim": (["{sid}", "{scene}", "-o"], (".csv", ".png", ".json")),
    "study": (["{scene}", "-o"], (".json", ".csv", ".txt", ".png", ".h5")),
    "sweep": (
        ["{scene}", "--over", "time.end=1", "--of", "stone.x.max", "-o"],
        (".json", ".h5", ""),
    ),
    "sensitivity": (
        ["{scene}", "--with", "stone.mass", "--of", "max(stone.x)", "-o"],
        (".json", ".h5", ".png"),
    ),
    "optimise": (["{scene}", "-o"], (".csv", ".h5", "")),
    "identify": (["{scene}", "--with", "stone.mass", "-o"], (".csv", ".h5", "")),
    "stations": (["{result}", "-o"], (".txt", ".h5", "")),
    "linearise": (["{scene}", "-o"], (".h5", ".csv", "")),
    "response": (["{scene}", "-o"], (".h5", ".npz", "")),
    "fmu": (["{scene}", "-o"], (".zip", ".dll", "")),
    "demo": (["-o"], (".html", ".png")),
    "new": ([], (".toml", ".py", ".h5")),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_refuse_them_before_any_work(
    command: str,
    written_things: dict[str, Thing],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    written_things["result"].save("r.h5")
    sidtool.Scene.of_result(written_things["result"]).save("s.toml")
    sidtool.write("b.SID_FEM", written_things["sid"])
    names = {"result": "r.h5", "scene": "s.toml", "sid": "b.SID_FEM", "model": "s.toml"}
    before = set(tmp_path.iterdir())
    arguments, endings = COMMANDS[command]
    words = [word.format(**names) for word in (*command.split(), *arguments)]
    words = [w for i, w in enumerate(words) if not (i == 1 and w.startswith("--"))]
    for ending in endings:
        assert run([*words, f"x{ending}"]) == 2
        stderr = unwrapped(capsys.readouterr().err)
        said = ("which the ending", "it has no ending", "and the ending")
        assert any(words in stderr for words in said), stderr
    assert set(tmp_path.iterdir()) == before


def test_all_commands_that_write_files_are_tried() -> None:
    """`new` takes its folder as an argument."""
    tried = {name.split()[0] for name in COMMANDS}
    writing = {
        name
        for name, command in cli.commands.items()
        if any("-o" in p.opts for p in command.params)
    }
    assert writing | {"new"} == tried - {"analyse"}
