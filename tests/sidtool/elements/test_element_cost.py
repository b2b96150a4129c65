"""Linear elements that bend too stiffly are reported with the right frequency."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sidtool.conversion import element_accuracy
from sidtool.formats.diagnostics import WARNING, Diagnostic
from sidtool.formats.model import ModelFile
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from tests.codes import only
from tests.metamorphic.parts.meshes import block, dimension

from .bores import pinned

#: Length, height and thickness of a free bar, E and density: first bending frequency.
LENGTH, HEIGHT, DEPTH = 0.4, 0.008, 0.02
FIRST = 22.3733 / (2 * np.pi) * np.sqrt(2.1e11 / 7850 / 12) * HEIGHT / LENGTH**2

#: Elements along and through a bar that bends about its least thickness; the larger
#: meshes are too large to be solved outright.
BARS = [
    ("tri3", (40, 1)),
    ("quad4", (40, 1)),
    ("quad4", (60, 20)),
    ("tri3", (120, 3)),
    ("tet4", (30, 1, 1)),
    ("tet4", (40, 2, 2)),
    ("hex8", (40, 1, 1)),
    ("hex8", (90, 2, 2)),
    ("wedge6", (40, 1, 2)),
]


def bar(
    folder: Path, kind: str, counts: tuple[int, ...], formulation: str | None = None
) -> ModelFile:
    mesh = block(kind, counts, (LENGTH, HEIGHT, DEPTH)[: dimension(kind)])
    marker = {"end": {"node": 1, "mesh_node": 1}}
    model = pinned(folder, mesh, {}, marker)
    state = "plane_stress" if dimension(kind) == 2 else None
    settings = model.discretisation.model_copy(
        update={"formulation": formulation, "state": state}
    )
    return model.model_copy(update={"discretisation": settings})


def notes(model: ModelFile) -> tuple[Diagnostic, ...]:
    return element_accuracy.element_notes(finite_element_model(model))


@pytest.mark.parametrize(("kind", "counts"), BARS)
def test_the_better_mesh_bends_as_a_beam(
    tmp_path: Path, kind: str, counts: tuple[int, ...]
) -> None:
    formulation = "full_integration" if kind in ("quad4", "hex8") else None
    (note,) = notes(bar(tmp_path, kind, counts, formulation))
    assert (note.code, note.data["kinds"]) == ("N141", kind)
    assert note.data["sense"] == "too stiff"
    own, excess = (np.array(note.data[name]) for name in ("own", "differences"))
    assert own[0] / (1 + excess[0]) == pytest.approx(FIRST, rel=0.02)


@pytest.mark.parametrize(
    ("kind", "counts"),
    [
        ("quad4", (40, 1)),
        ("hex8", (40, 1, 1)),
        ("tri6", (20, 1)),
        ("tet10", (10, 1, 1)),
        ("wedge15", (10, 1, 1)),
    ],
)
def test_elements_that_bend_have_no_note(
    tmp_path: Path, kind: str, counts: tuple[int, ...]
) -> None:
    formulation = "incompatible_modes" if kind in ("quad4", "hex8") else None
    assert not notes(bar(tmp_path, kind, counts, formulation))


@pytest.mark.parametrize(
    ("factors", "stiff", "soft"),
    [
        ((0.63, 0.64, 0.62), False, True),
        ((0.63, 1.06, 0.64), True, True),
        ((1.2, 0.995, 1.0), True, False),
        ((1.005, 0.995, 1.0), False, False),
    ],
)
def test_the_note_has_the_sign_of_the_difference(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    factors: tuple[float, ...],
    stiff: bool,
    soft: bool,
) -> None:
    """Elements that are too soft are reported, too, as too soft."""
    right = np.array([100.0, 200.0, 300.0])
    pair = right * factors, right
    monkeypatch.setattr(element_accuracy, "_frequencies", lambda *_: pair)
    found = notes(bar(tmp_path, "tet4", (20, 1, 1)))
    assert len(found) == (stiff or soft)
    for note in found:
        sense = str(note.data["sense"])
        assert ("stiff" in sense, "soft" in sense) == (stiff, soft)
        assert note.data["differences"] == pytest.approx(np.array(factors) - 1)


def test_a_fine_mesh_has_no_note(tmp_path: Path) -> None:
    coarse, fine = (
        notes(bar(tmp_path, "quad4", counts, "full_integration"))
        for counts in ((40, 4), (320, 8))
    )
    assert coarse and not fine


def test_point_masses_do_not_change_the_comparison(tmp_path: Path) -> None:
    """The better mesh has none: 50 kg on the bar would pass for its elements' cost."""
    model = bar(tmp_path, "tet4", (20, 1, 1))
    before = notes(model)
    with (tmp_path / "part.inp").open("a", encoding="utf-8") as deck:
        deck.write("*ELEMENT, TYPE=MASS, ELSET=TOOL\n90001, 5\n")
        deck.write("*MASS, ELSET=TOOL\n50.\n")
    body = finite_element_model(model)
    assert body.mass.diagonal().sum() > 100
    assert element_accuracy.element_notes(body) == before


def test_models_too_large_to_compare_are_noted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = bar(tmp_path, "tet4", (20, 1, 1))
    monkeypatch.setattr(element_accuracy, "_LARGEST_MESH", 100)
    (note,) = notes(model)
    assert note.code == "N142"
    assert f"{3 * 41 * 3 * 3} degrees of freedom" in note.message


def test_conversion_notes_stiff_elements(tmp_path: Path) -> None:
    model = bar(tmp_path, "tet4", (20, 1, 1))
    note = only(sid_from_model(model), "N141")
    assert note.severity == WARNING and note.data["kinds"] == "tet4"
