"""What `convert` says about its basis, beside dense algebra on the full mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.linalg import eigh, null_space

from sidtool.cli.main import cli
from sidtool.formats.diagnostics import WARNING, Diagnostic
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.reduction.body_frames import FRAMES, motion_rows
from sidtool.reduction.methods import REDUCTIONS
from tests.codes import codes, only
from tests.places import EXAMPLES
from tests.steel_bars import bar_data

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


def basis_errors(model: ModelFile) -> Diagnostic:
    return only(sid_from_model(model), "N160", "N161")


def values(errors: Diagnostic) -> list[float]:
    """The largest errors of a frequency and of a compliance."""
    found = [errors.data[name] for name in ("frequency", "compliance")]
    assert all(isinstance(value, float) for value in found)
    return [float(value) for value in found]


def better_basis(errors: Diagnostic) -> tuple[str, int]:
    """The method and the number of modes that the remedy names."""
    name, modes = errors.data["better"], errors.data["better_modes"]
    assert isinstance(name, str) and isinstance(modes, int)
    assert f"with {modes} modes" in errors.remedy
    return name, modes


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
    assert values(basis_errors(model)) == pytest.approx(
        [frequencies, compliance], rel=1e-4, abs=1e-6
    )


def test_the_suggested_method_has_smaller_errors() -> None:
    model = part(False, FREE, method="craig_bampton", modes=10, interfaces=PINS)
    errors = basis_errors(model)
    assert errors.code == "N161" and errors.data["count"] == 10
    name, modes = better_basis(errors)
    better = part(False, FREE, method=name, modes=modes, interfaces=PINS)
    assert max(measured(model)) > 0.05
    assert max(measured(better)) < 1e-5
    assert values(basis_errors(better))[0] < 1e-6


def test_more_modes_are_advised_where_they_suffice() -> None:
    """Natural modes and static answers leave no error; other methods have some."""
    errors = basis_errors(
        part(False, FREE, method="attachment", modes=3, interfaces=PINS)
    )
    name, modes = better_basis(errors)
    assert name == "attachment"
    better = part(False, FREE, method=name, modes=modes, interfaces=PINS)
    assert max(measured(better)) < 1e-6


@pytest.mark.parametrize("method", ["attachment", "herting"])
@pytest.mark.parametrize("plane", [True, False])
def test_a_good_basis_has_no_advice(method: str, plane: bool) -> None:
    errors = basis_errors(part(plane, FREE, method=method, modes=10, interfaces=PINS))
    assert errors.code == "N160" and not errors.data["better"] and not errors.remedy
    assert max(values(errors)) < 1e-6


def test_a_poor_basis_at_its_interfaces_is_a_warning() -> None:
    model = part(False, FREE, method="craig_bampton", modes=3, interfaces=PINS)
    errors = basis_errors(model)
    assert errors.code == "N161" and errors.severity == WARNING
    assert errors.data["count"] == 9


@pytest.mark.parametrize("modes", [2, 4])
def test_the_last_frequencies_of_a_good_basis_are_no_warning(modes: int) -> None:
    """The requested modes and the compliance are right; the remaining modes have
    errors.
    """
    interfaces = PINS[1:]
    errors = basis_errors(
        part(True, None, method="craig_bampton", modes=modes, interfaces=interfaces)
    )
    frequency, compliance = values(errors)
    assert frequency > 0.5 and compliance < 1e-6
    assert errors.code == "N160"


@pytest.mark.parametrize("plane", [True, False])
def test_compliance_that_is_missing_is_a_warning(plane: bool) -> None:
    """Three modes of bending do not stretch a rod, with interfaces named or without."""
    errors = basis_errors(part(plane, None, method="modal", modes=3))
    assert values(errors) == pytest.approx([0.0, 1.0], abs=1e-6)
    assert errors.code == "N161"


def test_the_command_prints_the_basis_error(tmp_path: Path) -> None:
    model = part(True, FREE, method="herting", modes=6, interfaces=PINS)
    errors = basis_errors(model)
    assert errors.code == "N160"
    (tmp_path / "rod.json").write_text(model.model_dump_json(), encoding="utf-8")
    command = ["convert", str(tmp_path / "rod.json"), "-o", str(tmp_path / "rod.h5")]
    done = CliRunner().invoke(cli, command)
    assert done.exit_code == 0, done.output
    printed = " ".join(done.output.split())
    assert errors.message_line in printed and errors.remedy in printed


def test_bases_with_masses_hidden_by_rounding_are_not_compared(
    tmp_path: Path,
) -> None:
    """A slip of ten digits: of a beam so slender other bases are dependent."""
    text = (EXAMPLES / "rod_in_space" / "rod_beam.toml").read_text(encoding="utf-8")
    assert "end = [1.0, 0.0, 0.0]" in text
    (tmp_path / "rod.toml").write_text(
        text.replace("end = [1.0,", "end = [1e10,"), encoding="utf-8"
    )
    errors = only(sid_from_model(tmp_path / "rod.toml"), "N161")
    assert not errors.data["better"]


def test_fixing_the_marker_has_the_modes_of_the_held_body() -> None:
    """As the note on modes of the free body advises, with its frequency."""
    frame = {"type": "tangent", "marker": "piston_pin"}
    free = sid_from_model(part(True, frame, method="modal", modes=3))
    held = only(free, "N162")
    assert held.data["marker"] == "piston_pin"
    assert 'fix = "piston_pin"' in held.remedy
    fixed = part(True, frame, method="modal", modes=3, fix="piston_pin")
    sid = sid_from_model(fixed)
    assert "N162" not in codes(sid)
    first = np.sqrt(eigh(sid.Ke.m0, sid.Me.m0, eigvals_only=True)[0]) / (2 * np.pi)
    assert first == pytest.approx(held.data["full"], rel=1e-9)


def slender_bar(length: float, frame: dict[str, Any]) -> ModelFile:
    """Two elements, of a section of 10 mm x 20 mm."""
    reduction = {"method": "craig_bampton", "modes": 1, "interfaces": ["tip"]}
    data = bar_data(height=0.01, elements=2, frame=frame, reduction=reduction)
    data["geometry"]["end"] = [length, 0.0, 0.0]
    return validate_data(data, ModelFile)


def test_a_mesh_too_small_for_other_methods_has_its_errors() -> None:
    """Those need up to 20 modes of a model with 6 free degrees of freedom."""
    model = slender_bar(1000.0, {"type": "tangent", "marker": "root", "clamp": "start"})
    body = finite_element_model(model)
    frame = FRAMES[model.frame.type](body, model.frame)
    shapes = REDUCTIONS[model.reduction.method](body, frame, model.reduction).shapes
    free = ~frame.held
    full, own = (
        eigh(
            ways.T @ body.stiffness @ ways, ways.T @ body.mass @ ways, eigvals_only=True
        )
        for ways in (np.eye(body.ndof)[:, free], shapes)
    )
    expected = np.abs(np.sqrt(own / full[: len(own)]) - 1).max()
    errors = basis_errors(model)
    assert errors.data["frequency"] == pytest.approx(expected, rel=1e-6)
    assert "N165" not in codes(sid_from_model(model))


def test_errors_that_rounding_hides_are_unknown() -> None:
    """A free bar of 10 million km: up to 100 000 km the processor decides."""
    sid = sid_from_model(slender_bar(1e10, {"type": "buckens"}))
    unknown = only(sid, "N165")
    assert unknown.severity == WARNING and unknown.remedy
    assert not {"N160", "N161"} & set(codes(sid))
