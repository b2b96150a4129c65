"""Benchmarks find what they use, and are refused where they could keep nothing."""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmarks.__main__ import main
from benchmarks.decks import main as decks
from tests.places import ROOT


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


PROBLEMS = sorted((ROOT / "benchmarks/problems").glob("[!_]*.py"))


@pytest.mark.parametrize("path", PROBLEMS, ids=lambda path: path.stem)
def test_the_reference_problems_name_what_their_tests_have(path: Path) -> None:
    """They take models from modules of the tests, in which names change."""
    module = import_module(f"benchmarks.problems.{path.stem}")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            owner = vars(module).get(node.value.id)
            if getattr(owner, "__name__", "").startswith("tests."):
                assert hasattr(owner, node.attr), f"{node.value.id}.{node.attr}"
