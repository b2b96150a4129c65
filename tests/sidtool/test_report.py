"""What the tool says about a SID is true, whatever the SID."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.api.scene import read
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Taylor, rigid_node, rigid_sid
from sidtool.formats.result import Result
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.text import counted_noun
from sidtool.report.analyses import _damping_text, describe_equilibrium
from sidtool.report.result import describe_result
from sidtool.report.sid import (
    describe_sid,
    frame_kind_of,
    label_without_frequency,
    natural_modes,
)
from sidtool.report.tables import set_options, text_table, without_rounding
from sidtool.report.validation import judge_sid, judgement_as_text
from tests.codes import only, with_code
from tests.places import SLIDER_CRANK

from ..bodies import particle_body


@pytest.mark.parametrize("nq", [0, 1, 4])
@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("nodes", [0, 1, 3])
def test_any_body_is_described_and_judged(nq: int, planar: bool, nodes: int) -> None:
    sid = particle_body(nq, 12, planar=planar, nodes=nodes)
    text = describe_sid(sid)
    assert counted_noun(nq, "mode") in text and counted_noun(nodes, "node") in text
    assert "nan" not in text
    assert judgement_as_text(judge_sid(sid, None), strict=True)


def test_what_is_not_compared_and_what_fails_is_told_by_codes(tmp_path: Path) -> None:
    """A rigid reference; then a body whose mass is not that of its blocks."""
    sid = particle_body(2, 12)
    write_sid(tmp_path / "rigid.h5", rigid_sid(1.0, np.zeros(3), np.eye(3)))
    judged = judge_sid(sid, tmp_path / "rigid.h5")
    assert {each.severity for each in with_code(judged, "N940")} == {"info"}
    wrong = judge_sid(replace(sid, mdCM=Taylor(sid.mdCM.m0)), None)
    found = only(wrong, "N904")
    assert found.severity == "error"
    text = judgement_as_text(wrong, strict=False)
    assert found.line in " ".join(text.split())
    rows = re.findall(r"^I\d+", text, re.MULTILINE)
    failed = [check.id for check in wrong.checks if check.failed]
    assert "I4" in failed and rows == failed  # what holds is counted
    text = judgement_as_text(wrong, strict=False, all_rows=True)
    rows = re.findall(r"^I\d+", text, re.MULTILINE)
    assert rows == [f"I{k}" for k in range(1, 22)]


def test_effective_masses_of_all_modes_add_up_to_the_mass() -> None:
    """Modes that span all motions of the particles carry the whole mass."""
    particles = 3
    sid = particle_body(3 * particles, particles)
    total = sum(mode.effective_mass for mode in natural_modes(sid))
    assert total == pytest.approx(np.full(3, sid.mass), rel=1e-9)


def test_frequencies_do_not_depend_on_the_basis() -> None:
    sid = particle_body(4, 12, seed=3)
    turn = np.random.default_rng(0).normal(size=(4, 4))
    blocks = {name: getattr(sid, name).m0 for name in ("Me", "Ke", "Ct")}
    turned = replace(
        sid,
        Me=Taylor(turn.T @ blocks["Me"] @ turn),
        Ke=Taylor(turn.T @ blocks["Ke"] @ turn),
        Ct=Taylor(turn.T @ blocks["Ct"]),
        nodes=(),
    )
    for here, there in zip(natural_modes(sid), natural_modes(turned), strict=True):
        assert there.frequency == pytest.approx(here.frequency, rel=1e-9)
        assert there.effective_mass == pytest.approx(here.effective_mass, rel=1e-8)


def test_frames_are_distinguished() -> None:
    rod = read(SLIDER_CRANK / "rod_q4.SID_FEM")
    assert frame_kind_of(rod) == "tangent frame, fixed to node 1 at its origin"
    assert frame_kind_of(rigid_sid(1.0, [0, 0, 0], np.eye(3))) == "rigid body"
    free = replace(
        rod, Ct=Taylor(np.zeros((5, 3))), Cr=Taylor(np.zeros((5, 3))), nodes=()
    )
    assert frame_kind_of(free).startswith("mean axes")


def test_info_of_a_body_lists_stiffening_and_stress() -> None:
    sid = particle_body(2, 6, stiffening=True)
    text = describe_sid(sid)
    assert "geom. stiffening   carried\n" in text and "stress             not" in text
    sigma = Taylor(np.zeros((6, 1)), np.ones((2, 6, 1)))
    nodes = (replace(sid.nodes[0], sigma=sigma), *sid.nodes[1:])
    assert "stress             at 1 node\n" in describe_sid(replace(sid, nodes=nodes))
    text = describe_sid(read(SLIDER_CRANK / "rod_q4.SID_FEM"))
    assert "geom. stiffening   not carried; a simulation shows whether it" in text


def test_nodes_that_no_shape_function_moves_are_marked() -> None:
    rod = read(SLIDER_CRANK / "rod_q4.SID_FEM")
    first, second = rod.nodes
    both = replace(rod, nodes=(first, replace(second, phi=first.phi, psi=first.psi)))
    lines = describe_sid(both).splitlines()
    assert lines[-2].endswith("rests in the frame")
    assert lines[-1].endswith("no shape function moves it")


def test_options_that_are_printed_can_be_pasted_into_a_shell() -> None:
    given = {f"geometry.section.height[{k}]": 0.1 + k / 3.0 for k in range(5)}
    for changes in (given, dict([*given.items()][:1])):
        lines = "\n".join(set_options({}, {"rod": changes})).split(":", 1)[1]
        words = shlex.split(lines.replace("\\\n", ""))  # as a shell joins lines
        assert len(lines.strip().splitlines()) in (1, len(changes))
        assert words[::2] == ["--set"] * len(changes)
        assert words[1::2] == [f"{key}={value!r}" for key, value in changes.items()]


def test_a_rigid_body_with_nodes() -> None:
    sid = rigid_sid(2.0, [0.5, 0, 0], np.eye(3), (rigid_node("7", [1, 2, 3]),))
    text = describe_sid(sid)
    assert "1 node, 0 modes" in text
    assert [line.split() for line in text.splitlines()][-1] == ["7", "1", "2", "3"]


def test_a_body_without_mass_is_still_described() -> None:
    rod = read(SLIDER_CRANK / "rod_q4.SID_FEM")
    empty: SID = replace(rod, mass=0.0, Me=Taylor(np.zeros((5, 5))))
    assert "nan" not in describe_sid(empty)


def test_tables_align_numbers_to_the_right() -> None:
    text = text_table(["name", "m"], [["a", "1.5"], ["long", "-10.25"]])
    assert text == "name       m\n----  ------\na        1.5\nlong  -10.25"


def test_escape_sequences_of_a_file_do_not_reach_the_terminal(tmp_path: Path) -> None:
    body = particle_body(2, 8)
    labels = ("\x1b[31mred", "\x9b2Jgone")
    path = tmp_path / "body.h5"
    write_sid(path, replace(body, title="\x1b]0;owned\x07title", labels=labels))
    text = describe_sid(read_sid(path))
    assert "owned" in text and "red" in text and "gone" in text
    assert not {"\x1b", "\x07", "\x9b"} & set(text)
    assert "\x1b" not in str(InputError("found \x1b[2J", source="\x1b]0;x\x07"))


def test_rounding_is_shown_as_nothing() -> None:
    """A centre that is 1e-17 m beside the frame of a body of 1 m lies in it."""
    sid = read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")
    off = np.array([[1e-17], [-3e-17], [2e-17]]) * sid.mass
    described = describe_sid(replace(sid, mdCM=replace(sid.mdCM, m0=off)))
    assert "centre of mass     0 0 0\n" in described
    real = replace(sid, mdCM=replace(sid.mdCM, m0=1e7 * off))
    assert "centre of mass     1e-10 -3e-10 2e-10\n" in describe_sid(real)


def test_rounding_is_printed_as_zero_and_numbers_of_joints_share_a_line(ran) -> None:
    """Bending of a planar bar leaves its modes across the plane at rest; data have all
    digits.
    """
    folder = ran("beam")
    equilibrium = sidtool.static_equilibrium(folder / "scene.toml")
    text = describe_equilibrium(equilibrium)
    assert re.search(r"^bar.q1 +-0.00349", text, re.M)
    assert re.search(r"^bar.q2 +0$", text, re.M)
    assert re.search(r"^wall +f1, f2 +0, 15.4017  N$", text, re.M)
    assert counted_noun(equilibrium.iterations, "iteration") in text
    assert abs(dict(zip(*_names_and_values(equilibrium), strict=True))["bar.q2"]) > 0.0
    result = read(folder / "result.h5")
    assert isinstance(result, Result) and np.abs(result["bar.q2"]).max() > 0.0
    assert re.search(r"^bar.q2( +0){4}$", describe_result(result), re.M)


def _names_and_values(equilibrium: Any) -> tuple[tuple[str, ...], np.ndarray]:
    result = equilibrium.result()
    return result.names, result.values[0]


def test_values_are_rounding_against_those_of_their_unit() -> None:
    values = [1e-17, 2.0, 3e-9, 1e-15, np.nan]
    units = ["m", "m", "N", "rad", "N"]
    kept = without_rounding(values, units)
    assert kept[:4].tolist() == [0.0, 2.0, 3e-9, 0.0] and np.isnan(kept[4])


def test_labels_repeat_no_frequency() -> None:
    label = "Attachment 8 : 73.904 Hz, 100 % attachment mode"
    short = "Attachment 8, 100 % attachment mode"
    assert label_without_frequency(label, 73.9037) == short
    assert label_without_frequency(label, 74.9) == label
    assert label_without_frequency("Eigen Mode 2 : 16.709 Hz", 16.709) == "Eigen Mode 2"


def test_long_tables_say_what_they_leave_out() -> None:
    rows = [[f"q{k}", "1"] for k in range(50)]
    table = text_table(["output", "value"], rows, 8)
    assert table.splitlines()[-1] == "... and 42 more (-v prints all)"
    assert len(table.splitlines()) == 11 and table.html.count("<tr>") == 51
    assert len(text_table(["output", "value"], rows[:9], 8).splitlines()) == 11
    brief = text_table(["name", "law"], [["f", "x" * 300]], 8, brief=True)
    assert len(brief.splitlines()) == 3 and brief.endswith("...")


def test_modes_without_oscillation_have_a_decay_time() -> None:
    """Of eigenvalues -2 and 0.5 1/s."""
    texts = [_damping_text(complex(x), np.sign(-x)) for x in (-2.0, 0.5)]
    assert texts == ["decay in 0.5 s", "growth in 2 s"]
    assert _damping_text(complex(-3.0, 4.0), 0.6) == "0.6"


def test_a_reference_without_tolerance_is_not_judged() -> None:
    """But for values of the table that have one; 'missed' counts judged ones only."""
    reference = SLIDER_CRANK / "rod_iga.SID_FEM"
    sid = read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")
    last = judgement_as_text(judge_sid(sid, reference), strict=False).splitlines()[-1]
    assert last.endswith("reference not judged: no --tolerance given")
    judged = judge_sid(sid, reference, tolerance=1e-12)
    last = judgement_as_text(judged, strict=False).splitlines()[-1]
    missed = re.search(r"(\d+) of (\d+) judged reference values missed", last)
    assert missed and 0 < int(missed[1]) <= int(missed[2]) and last.startswith("bad")
