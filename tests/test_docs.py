"""The pages of docs/: every block runs, every key of a format is explained."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from .commands import run_page

TOP = Path(__file__).parents[1]
DOCS = TOP / "docs"
PAGES = sorted(
    page
    for page in DOCS.rglob("*.md")
    if not {"generated", "_build"} & set(page.relative_to(DOCS).parts)
)


@pytest.fixture(scope="module")
def generate() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", [TOP / "README.md", *PAGES], ids=lambda p: p.stem)
def test_every_block_of_a_page_runs(page: Path, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(TOP / "examples")
    run_page(page, tmp_path)


def test_every_key_of_the_formats_has_an_example(generate: ModuleType) -> None:
    """Add one to a file of docs/formats; it only has to be read, not to move."""
    found = generate.examples()
    for root, _, _ in generate.ROOTS.values():
        keys = list(generate.keys(root))
        assert len(keys) > 10
        missing = [
            f"{table.__name__}.{name}"
            for table, name in keys
            if (table, name) not in found
        ]
        assert missing == []


def test_the_generated_pages_say_what_the_schema_says(generate: ModuleType) -> None:
    pages = generate.pages()
    scene = pages["scene.md"]
    assert "| `mass` | number | required | the mass [kg]" in scene
    assert "`friction = { coefficient = 0.1 }`" in scene
    assert '`type = "universal"`' in scene
    for command in ("simulate", "analyse modes", "new"):
        assert f"## sidtool {command}\n" in pages["commands.md"]
    assert "autofunction:: sidtool." in pages["names.md"]


def test_links_between_pages_lead_somewhere(generate: ModuleType) -> None:
    made = set(generate.pages())
    for page in [TOP / "README.md", *PAGES]:
        text = page.read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)#:]+?)(?:#[^)]*)?\)", text):
            if "generated/" in target:
                assert Path(target).name in made, (page.name, target)
            else:
                assert (page.parent / target).exists(), (page.name, target)


def test_every_page_is_in_the_contents() -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    for page in PAGES:
        name = page.relative_to(DOCS).with_suffix("").as_posix()
        assert name == "index" or f"\n{name}\n" in index, name


def test_the_site_is_built_without_warnings(tmp_path: Path) -> None:
    for package in ("sphinx", "myst_parser", "furo"):
        pytest.importorskip(package, reason="`make docs` installs what builds the site")
    command = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", DOCS, tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "theory.html").is_file()
