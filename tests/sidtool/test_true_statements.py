"""Statements about runs, files and comparisons that used to be untrue."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.importers.mesh_files import read_mesh
from sidtool.mesh.imported_mesh import LEFT_OUT, unread_keyword_notes
from sidtool.report.result import run_summary
from sidtool.solver import compile_scene, simulate
from sidtool.solver.system.errors import SimulationError
from tests.codes import codes, with_code
from tests.sidtool.importers.mesh_files import bdf_text, inp_text, msh_4, rod_mesh
from tests.solver.scenes import scene, slender_rod
from tests.steel_bars import steel_bar


def blocked_crank(**time: float) -> object:
    """A crank of 1 m and a rod of 0.5 m: the crank cannot turn beyond 30 degrees."""
    bodies = {
        "crank": slender_rod(1.0),
        "rod": slender_rod(0.5, position=[1.0, 0.0]),
        "slider": {"mass": 1.0, "initial": {"position": [1.5, 0.0]}},
    }
    joints = {
        "a": {"type": "revolute", "markers": ["ground", "crank.a"]},
        "b": {"type": "revolute", "markers": ["crank.b", "rod.a"]},
        "c": {"type": "coincident", "markers": ["rod.b", "slider"]},
        "d": {"type": "point_on_line", "markers": ["ground", "slider"]},
    }
    swing = {"type": "harmonic", "amplitude": 1.0, "frequency": 1.0}
    push = {"type": "force", "marker": "crank.b", "force": [0.0, 50.0]}
    return scene(
        bodies,
        joints,
        {"m": {"joint": "a", "function": swing}},
        forces={"push": push},
        end=1.0,
    )


@pytest.mark.parametrize("integrator", ["radau9", "radau13"])
def test_speeds_where_a_run_stops_are_no_sign_of_units_or_turns(
    integrator: str,
) -> None:
    """The crank turns by less than a radian, and the force is 50 N."""
    with pytest.raises(SimulationError) as stop:
        simulate(compile_scene(blocked_crank()), integrator=integrator, rtol=1e-3)
    result = stop.value.result
    assert result is not None and "N218" not in codes(result)
    title = run_summary(result).splitlines()[0]
    assert title.endswith("STOPPED at 0.0877054 of 1 s (8.8 %)")


def test_ignored_keywords_are_not_called_without_effect() -> None:
    idle, left_out = unread_keyword_notes(["*STEP", f"*NONSTRUCTURAL MASS{LEFT_OUT}"])
    assert (idle.code, idle.data["keywords"]) == ("N112", ("*STEP",))
    named = left_out.code, left_out.data["keywords"]
    assert named == ("N113", ("*NONSTRUCTURAL MASS",))
    assert unread_keyword_notes([]) == []


#: A mesh, what may follow in its file, and whether that may change the body.
UNREAD = {
    ".msh": [("$Periodic\n0\n$EndPeriodic\n", "Periodic", False)]
    + [("$Ghosts\n0\n$EndGhosts\n", "Ghosts", True)],
    ".inp": [
        ("*NODE PRINT\n", "NODE PRINT", False),
        ("*NONSTRUCTURAL MASS, ELSET=ALL\n5.0\n", "NONSTRUCTURAL MASS", True),
        ("*STEP\n*CLOAD\n1, 1, 1.0\n*END STEP\n", "CLOAD", False),
    ],
    ".bdf": [
        ("FORCE,1,1,,1.0,0.,0.,1.\n", "FORCE", False),
        ("NSML,1,PSHELL,1,5.0\n", "NSML", True),
    ],
}


@pytest.mark.parametrize(
    ("suffix", "text", "name", "changes"),
    [(suffix, *case) for suffix, cases in UNREAD.items() for case in cases],
)
def test_readers_distinguish_content_that_can_change_a_body(
    tmp_path: Path, suffix: str, text: str, name: str, changes: bool
) -> None:
    """Of what `geometry.ignore` leaves out, the body lacks some, and other is idle."""
    path, mesh = tmp_path / f"rod{suffix}", rod_mesh("hex8")
    if suffix == ".msh":
        path.write_text(msh_4(mesh) + text, encoding="utf-8")
    elif suffix == ".inp":
        path.write_text(inp_text(mesh) + text, encoding="utf-8")
    else:
        body = bdf_text(mesh).replace("ENDDATA", f"{text}ENDDATA")
        path.write_text(body, encoding="utf-8")
    found = [d for d in read_mesh(path, [name]).diagnostics if name in str(d)]
    assert [each.code for each in found] == ["N113" if changes else "N112"]


def test_a_start_in_equilibrium_has_no_warning(
    tmp_path: Path,
) -> None:
    """The block of a heavily bent body is not positive, its frame being prescribed."""
    bar = {"sid": "bar.SID_FEM", "markers": {"a": 1, "b": 2}}
    described = scene(
        {"bar": bar},
        {"wall": {"type": "fixed", "markers": ["ground", "bar.a"]}},
        gravity=[0.0, -1600.0],
        end=0.01,
        initial={"state": "static"},
    )
    sids = {"bar": steel_bar(width=0.04, modes=6)}
    with pytest.warns(sidtool.DiagnosticWarning, match="N411"):
        result = sidtool.simulate(described, sids=sids)
        rest = sidtool.static_equilibrium(described, sids=sids)
    assert result.completed and np.isfinite(result.positions).all()
    assert "N703" not in codes(result) + codes(rest)


@pytest.mark.parametrize(
    ("joints", "forces", "rests"),
    [
        ("fixed", {}, True),
        ("revolute", {}, True),
        ("", {}, False),
        ("", {"pull": 30.0}, False),
        ("revolute", {"turn": 40.0}, False),
    ],
)
def test_a_static_start_does_not_vibrate_where_there_is_one(
    joints: str, forces: dict[str, float], rests: bool
) -> None:
    bar = {"sid": "bar.SID_FEM", "markers": {"a": 1, "b": 2}}
    loads: dict[str, object] = {
        "push": {"type": "force", "marker": "bar.b", "force": [0.0, -20.0]}
    }
    for name, torque in forces.items():
        loads[name] = {"type": "force", "marker": "bar.a", "torque": torque}
    wall = {"wall": {"type": joints, "markers": ["ground", "bar.a"]}} if joints else {}
    described = scene({"bar": bar}, wall, gravity=[0.0, -9.81] if joints else [0, 0],
                      forces=loads, end=0.05)  # fmt: skip
    sids = {"bar": bent_bar()}
    result = sidtool.simulate(described, sids=sids)
    (found,) = [*with_code(result, "N219"), *with_code(result, "N220")]
    assert found.subject == "bar"
    at_rest = {"initial.state": "static"}
    if rests:
        resting = sidtool.simulate(described.with_(at_rest), sids=sids)
        assert resting.completed and not {"N219", "N220"} & {*codes(resting)}
    else:
        with pytest.raises(sidtool.InputError):
            sidtool.simulate(described.with_(at_rest), sids=sids)


@cache
def bent_bar() -> sidtool.SID:
    return steel_bar(width=0.02, modes=2)
