"""What `convert` says about its basis, beside dense algebra on the full mesh."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.linalg import eigh, null_space

from sidtool.cli.main import cli
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.reduction.body_frames import FRAMES, motion_rows
from sidtool.reduction.methods import REDUCTIONS
from tests.places import EXAMPLES

from ..bodies import volume_data
from ..models import rod_data

PINS = ["crank_pin", "piston_pin"]
PLANE = {"type": "q4", "elements": [24, 3], "state": "plane_stress"}
SOLID = {"type": "hex8", "elements": [12, 2, 1]}
FREE = {"type": "buckens"}
CHORD = {"type": "chord", "markers": PINS}


def part(plane: bool, frame: dict[str, Any] | None, **reduction: Any) -> ModelFile:
    data = rod_data(PLANE) if plane else volume_data(SOLID)
    data["reduction"] = reduction
    return validate_data(data | ({"frame": frame} if frame else {}), ModelFile)


def basis_note(model: ModelFile) -> str:
    heard: list[str] = []
    sid_from_model(model, heard.append)
    (sentence,) = [text for text in heard if "basis: " in text]
    return sentence


def shares(sentence: str) -> list[float]:
    """All errors in it, in order."""
    found = re.findall(r"by (?:at most )?(less than )?([\d.e+-]+) %", sentence)
    return [0.0 if less else float(value) / 100 for less, value in found]


def measured(model: ModelFile) -> list[float]:
    """The largest error of a frequency and of a compliance, by dense algebra."""
    body = finite_element_model(model)
    frame = FRAMES[model.frame.type](body, model.frame)
    basis = REDUCTIONS[model.reduction.method](body, frame, model.reduction)
    free = ~frame.held
    ways = np.eye(body.ndof)[:, free]
    if model.frame.type == "chord":  # a rod between its pins
        ways = null_space(frame.rows)
    k, m = (ways.T @ (a @ ways) for a in (body.stiffness, body.mass))
    rigid = np.zeros((ways.shape[1], 0))
    if ways.shape[1] == body.ndof:
        rigid = body.rigid_body_modes()
    squares, vectors = eigh(k, m)
    squares, vectors = squares[rigid.shape[1] :], vectors[:, rigid.shape[1] :]
    small = np.hstack([rigid, ways.T @ basis.shapes])
    reduced, mixing = eigh(small.T @ k @ small, small.T @ m @ small)
    reduced, mixing = reduced[rigid.shape[1] :], mixing[:, rigid.shape[1] :]
    moving = [n for n in PINS if free.all() or n != "crank_pin"]
    rows = np.vstack(
        [
            motion_rows(
                body,
                body.marker(n),
                rotations=bool(model.reduction.interface_names),
            )
            for n in moving
        ]
    )
    full = ((rows @ ways @ vectors) ** 2 / squares).sum(axis=1)
    felt = full > 1e-12 * full.max()
    less = ((rows @ ways @ small @ mixing) ** 2 / reduced).sum(axis=1)
    n = min(10, len(reduced))
    return [
        float(np.abs(np.sqrt(reduced[:n] / squares[:n]) - 1).max()),
        float((1 - less[felt] / full[felt]).max()),
    ]


CASES = [
    (True, FREE, {"method": "craig_bampton", "modes": 4, "interfaces": PINS}),
    (True, CHORD, {"method": "craig_bampton", "modes": 7, "interfaces": PINS}),
    (False, FREE, {"method": "craig_bampton", "modes": 5, "interfaces": PINS}),
    (False, FREE, {"method": "craig_bampton", "modes": 5, "interfaces": PINS[:1]}),
    (False, None, {"method": "craig_bampton", "modes": 2, "interfaces": PINS[1:]}),
    (True, None, {"method": "modal", "modes": 3}),
    (False, CHORD, {"method": "modal", "modes": 6}),
]


@pytest.mark.parametrize(("plane", "frame", "reduction"), CASES)
def test_errors_are_those_of_the_full_mesh(
    plane: bool, frame: dict[str, Any] | None, reduction: dict[str, Any]
) -> None:
    model = part(plane, frame, **reduction)
    frequencies, compliance = measured(model)
    found = shares(basis_note(model))
    assert found[0] == pytest.approx(frequencies, rel=0.06, abs=1e-6)
    assert found[1] == pytest.approx(compliance, rel=0.06, abs=1e-6)


def test_the_suggested_method_has_smaller_errors() -> None:
    model = part(False, FREE, method="craig_bampton", modes=10, interfaces=PINS)
    sentence = basis_note(model)
    assert sentence.startswith("note: basis: its first 10 frequencies err by at most")
    name, modes = re.search(r"; (\w+) with (\d+) modes", sentence).groups()
    better = part(False, FREE, method=name.lower(), modes=int(modes), interfaces=PINS)
    assert max(measured(model)) > 0.05
    assert max(measured(better)) < 1e-5
    assert "err by less than" in basis_note(better)


def test_more_modes_are_advised_where_they_suffice() -> None:
    """Natural modes and static answers leave no error; other methods have some."""
    sentence = basis_note(
        part(False, FREE, method="attachment", modes=3, interfaces=PINS)
    )
    name, modes = re.search(r"; (\w+) with (\d+) modes", sentence).groups()
    assert name == "attachment"
    better = part(False, FREE, method=name, modes=int(modes), interfaces=PINS)
    assert max(measured(better)) < 1e-6


@pytest.mark.parametrize("method", ["attachment", "herting"])
@pytest.mark.parametrize("plane", [True, False])
def test_a_good_basis_has_no_advice(method: str, plane: bool) -> None:
    sentence = basis_note(part(plane, FREE, method=method, modes=10, interfaces=PINS))
    assert sentence.startswith("basis: ") and "; " not in sentence
    assert shares(sentence) == [0.0, 0.0]


def test_a_poor_basis_at_its_interfaces_is_a_warning() -> None:
    model = part(False, FREE, method="craig_bampton", modes=3, interfaces=PINS)
    with pytest.warns(UserWarning, match="basis: its first 9 frequencies err"):
        sid_from_model(model)


@pytest.mark.parametrize("modes", [2, 4])
def test_the_last_frequencies_of_a_good_basis_are_no_warning(modes: int) -> None:
    """The requested modes and the compliance are right; the remaining modes have
    errors.
    """
    interfaces = PINS[1:]
    sentence = basis_note(
        part(True, None, method="craig_bampton", modes=modes, interfaces=interfaces)
    )
    frequency, compliance = shares(sentence)[:2]
    assert frequency > 0.5 and compliance < 1e-6
    assert sentence.startswith("basis: ")


@pytest.mark.parametrize("plane", [True, False])
def test_compliance_that_is_missing_is_a_warning(plane: bool) -> None:
    """Three modes of bending do not stretch a rod, with interfaces named or without."""
    sentence = basis_note(part(plane, None, method="modal", modes=3))
    assert shares(sentence)[:2] == [0.0, 1.0]
    assert sentence.startswith("note: basis: ")


def test_the_command_prints_the_basis_error(tmp_path: Path) -> None:
    model = part(True, FREE, method="herting", modes=6, interfaces=PINS)
    (tmp_path / "rod.json").write_text(model.model_dump_json(), encoding="utf-8")
    command = ["convert", str(tmp_path / "rod.json"), "-o", str(tmp_path / "rod.h5")]
    done = CliRunner().invoke(cli, command)
    assert done.exit_code == 0, done.output
    assert "basis: its first 10 frequencies err by at most" in done.stderr


def test_bases_with_masses_hidden_by_rounding_are_not_compared(
    tmp_path: Path,
) -> None:
    """A slip of ten digits: of a beam so slender other bases are dependent."""
    text = (EXAMPLES / "rod_in_space" / "rod_beam.toml").read_text(encoding="utf-8")
    assert "end = [1.0, 0.0, 0.0]" in text
    (tmp_path / "rod.toml").write_text(
        text.replace("end = [1.0,", "end = [1e10,"), encoding="utf-8"
    )
    notes: list[str] = []
    sid_from_model(tmp_path / "rod.toml", notes.append)
    (sentence,) = [line for line in notes if "frequencies err by at most" in line]
    assert sentence.endswith("; no other method does better")


def test_fixing_the_marker_has_the_modes_of_the_held_body() -> None:
    """As the note on modes of the free body advises, with its frequency."""
    frame = {"type": "tangent", "marker": "piston_pin"}
    heard: list[str] = []
    sid_from_model(part(True, frame, method="modal", modes=3), heard.append)
    (note,) = [text for text in heard if "modes of the held body" in text]
    assert 'fix = "piston_pin" under [reduction]' in note
    (hertz,) = re.findall(r"instead of ([\d.]+) Hz", note)
    heard.clear()
    fixed = part(True, frame, method="modal", modes=3, fix="piston_pin")
    sid = sid_from_model(fixed, heard.append)
    assert not any("modes of the held body" in text for text in heard)
    first = np.sqrt(eigh(sid.Ke.m0, sid.Me.m0, eigvals_only=True)[0]) / (2 * np.pi)
    assert first == pytest.approx(float(hertz), rel=1e-4)
