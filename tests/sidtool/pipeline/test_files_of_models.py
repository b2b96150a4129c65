"""A model is converted again when one of the files that it reads has changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sidtool.formats.model import ModelFile
from sidtool.pipeline.model_cache import model_digest

HEAD = {
    "format": "sidtool model",
    "version": 1,
    "frame": {"type": "tangent", "marker": "a"},
    "markers": {"a": {"node": 1, "mesh_node": 1}},
    "reduction": {"method": "modal", "modes": 1},
}
FRAME: dict[str, Any] = {
    "geometry": {
        "type": "frame",
        "points": {"a": [0.0, 0.0, 0.0], "b": [1.0, 0.0, 0.0]},
        "members": {
            "ab": {"start": "a", "end": "b", "sections": {"file": "changed.csv"}}
        },
    },
    "discretisation": {"type": "beam", "elements": 1},
    "markers": {"a": {"node": 1, "point": "a"}},
}


def mesh(**geometry: Any) -> dict[str, Any]:
    table = {"type": "mesh", **geometry}
    return {"geometry": table, "discretisation": {"type": "mesh"}}


@pytest.mark.parametrize(
    ("tables", "deck", "changed"),
    [
        (mesh(file="deck.inp"), "*NODE, INPUT=changed.inp\n", "changed.inp"),
        (mesh(file="deck.inp"), "*include, input = middle.inp\n", "changed.inp"),
        (mesh(file="deck.bdf"), "INCLUDE 'changed.bdf'\n", "changed.bdf"),
        (
            mesh(file="deck.inp", morphs={"m": {"file": "changed.inp"}}),
            "",
            "changed.inp",
        ),
        (FRAME, "", "changed.csv"),
    ],
)
def test_files_that_are_read_count(
    tables: dict[str, Any],
    deck: str,
    changed: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """SIDs of decks stayed those of former included files."""
    monkeypatch.chdir(tmp_path)
    for name in ("deck.inp", "deck.bdf"):
        (tmp_path / name).write_text(deck, encoding="utf-8")
    middle = "*INCLUDE, INPUT=changed.inp\n"
    (tmp_path / "middle.inp").write_text(middle, encoding="utf-8")
    model = ModelFile.model_validate({**HEAD, **tables})
    digests = []
    for text in ("1, 0, 0\n", "1, 0, 1\n"):
        (tmp_path / changed).write_text(text, encoding="utf-8")
        digests.append(model_digest(model))
    assert digests[0] != digests[1]
    (tmp_path / changed).unlink()
    assert model_digest(model) != digests[0]
