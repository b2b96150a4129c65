"""Benchmarks that run for hours are refused where they could not keep anything."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmarks.__main__ import main
from benchmarks.decks import main as decks


@pytest.mark.parametrize("before", [[], ["slider_crank"]], ids=["decks", "all"])
def test_a_folder_that_cannot_be_is_refused_before_the_run(
    before: list[str], tmp_path: Path
) -> None:
    (tmp_path / "decks").mkdir()
    arguments = before or [str(tmp_path / "decks")]
    missing = tmp_path / "none" / "x"
    command = main if before else decks
    done = CliRunner().invoke(command, [*arguments, "-o", str(missing)])
    assert done.exit_code == 2
    assert "'-o'" in done.output and str(missing) in done.output
    assert not missing.parent.exists()
