"""The pages of docs/: every block runs, every key of a format is explained."""

from __future__ import annotations

import ast
import difflib
import importlib
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest

from benchmarks.validation import PROBLEMS
from sidtool.cli.main import cli
from tests.places import DOCS, PAGES, ROOT

from .commands import run_page
from .sidtool.view.browser import opened


def loaded(name: str) -> ModuleType:
    """A module of the folder docs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(DOCS)
        return importlib.import_module(name)


@pytest.fixture(scope="module")
def generate() -> ModuleType:
    return loaded("generate")


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda p: p.stem)
def test_every_block_of_a_page_runs(page: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    run_page(page, tmp_path)


def test_pictures_stand_behind_the_blocks_that_draw_them(tmp_path: Path) -> None:
    """Below a block of commands, as far from the margin as it, where they are drawn."""
    pictures = loaded("page_pictures")
    page = DOCS / "howto" / "rotors.md"
    assert page in pictures.pages()
    block = "  ```sh\n  sidtool plot a.h5 -o a.png\n  sidtool plot b.h5 -o b.png\n  ```"
    (tmp_path / "rotors_b.png").touch()
    shown = pictures.with_pictures(page, f"{block}\nmore", tmp_path)
    name = "rotors_b.png"
    assert shown == f"{block}\n\n  ![{name}](../{tmp_path.name}/{name})\nmore"


@pytest.mark.parametrize(
    ("page", "package"),
    [
        pytest.param(page, name, marks=pytest.mark.needs(name))
        for page, name in (
            ("plant", "gymnasium"),
            ("plant", "control"),
            ("state_space", "control"),
        )
    ],
)
def test_blocks_for_other_packages_run(page: str, package: str, tmp_path: Path) -> None:
    run_page(DOCS / "howto" / f"{page}.md", tmp_path, [package])


LINK = re.compile(r"\[`([\w.]+)`\]\s*\((\.\./[^)#]+\.py)\)")


def defined(tree: ast.AST) -> dict[str, ast.AST]:
    """Functions, classes and assigned names of a module or class, by name."""
    found: dict[str, ast.AST] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[node.name] = node
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AnnAssign):
            targets = [node.target]
        found |= {t.id: node for t in targets if isinstance(t, ast.Name)}
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_links_into_the_source_name_what_is_there(page: Path) -> None:
    for name, target in LINK.findall(page.read_text(encoding="utf-8")):
        node: ast.AST = ast.parse((page.parent / target).read_text(encoding="utf-8"))
        for part in name.split("."):
            assert part in defined(node), f"{name} in {target}"
            node = defined(node)[part]


def test_the_pages_on_the_flow_of_a_run_and_a_conversion_have_links() -> None:
    for name in ("how_a_simulation_runs", "how_a_model_becomes_a_sid"):
        assert len(LINK.findall((DOCS / f"{name}.md").read_text("utf-8"))) > 15


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


def test_the_generated_pages_agree_with_the_schema(generate: ModuleType) -> None:
    pages = generate.pages()
    scene = pages["scene.md"]
    assert "| `mass` | number | required | the mass [kg]" in scene
    assert "`friction = { coefficient = 0.1 }`" in scene
    assert '`type = "universal"`' in scene
    for command in ("simulate", "analyse modes", "new"):
        assert f"## sidtool {command}\n" in pages["commands.md"]
    assert "autofunction:: sidtool." in pages["names.md"]


def test_the_gallery_shows_every_example(tmp_path: Path) -> None:
    gallery = loaded("gallery")
    folders = {path.parent.name for path in (ROOT / "examples").glob("*/README.md")}
    assert {each.name for each in gallery.examples()} == folders
    drawn = {each.name: each for each in gallery.examples()}
    assert gallery.draw_picture(drawn["journal_bearing"], tmp_path).exists()
    picture = gallery.draw_picture(drawn["beam"], tmp_path)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert len(picture.read_bytes()) > 5000


#: What users of other programs look for.
WORDS = (
    "Campbell Guyan RBE2 RBE3 Simscape SIMPACK Abaqus ANSYS Nastran Exudyn MBSim MBDyn "
    "Modelica OpenFAST superelement substructure transfer co-simulation Hurty Rayleigh "
    "Craig-Bampton whirl Coleman clearance Coulomb Stribeck bushing motor PID notebook "
    "pandas ParaView restart servo gear FMU FRF Bode linmod"
)


def test_the_commands_that_pages_name_exist() -> None:
    pages = [ROOT / "README.md", *PAGES, *(ROOT / "examples").glob("*/README.md")]
    named = {
        (page.name, name)
        for page in pages
        for name in re.findall(r"`sidtool ([a-z]{2,})\b", page.read_text("utf-8"))
    }
    assert len(named) > 30
    assert {each for each in named if each[1] not in cli.commands} == set()


def test_the_site_has_the_words_that_engineers_search() -> None:
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES).lower()
    assert [word for word in WORDS.split() if word.lower() not in text] == []


def test_every_key_has_a_meaning_and_its_example_is_toml(generate: ModuleType) -> None:
    """`wanted = { rail.f* = 0.001 }` was none, and `peak_points` a number of modes."""
    pages = generate.pages()
    for page in ("scene.md", "model.md", "reference.md"):
        for line in pages[page].splitlines():
            if not line.startswith("| `"):
                continue
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            assert cells[3], (page, line)
            example = cells[4].strip("`").replace("\\|", "|")
            if "..." not in example:
                tomllib.loads(example)
    assert "nodes where the stress can be largest" in pages["model.md"]


def test_sections_of_docstrings_become_fields() -> None:
    """Names stand with what they mean; what is no list of names stays as it is."""
    fields = loaded("docstrings").as_fields(
        "Draw it : well, or\nnot at all.\n\nkind : of picture\npath : to\n    write"
        "\n\nParameters\n----------\na, b : sizes [m]\nc [kg] : mass\n\n"
        "Returns\n-------\nhow many\n\nRaises\n------\nsidtool.X : it: fails."
    )
    assert fields.split("\n\n") == [
        "Draw it : well, or\nnot at all.",
        ":param kind: of picture\n:param path: to write",
        ":param a: sizes [m]\n:param b: sizes [m]\n:param c: mass",
        ":returns: how many",
        ":raises sidtool.X: it: fails.",
    ]


def test_links_between_pages_lead_somewhere(generate: ModuleType) -> None:
    created = set(generate.pages())
    for page in [ROOT / "README.md", *PAGES]:
        text = page.read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)#:]+?)(?:#[^)]*)?\)", text):
            if "generated/" in target:
                assert Path(target).name in created, (page.name, target)
            else:
                assert (page.parent / target).exists(), (page.name, target)


def test_the_animated_picture_needs_no_other_files() -> None:
    """As an image of a page: no scripts, no other files, animated by SMIL."""
    text = (DOCS / "moving.svg").read_text(encoding="utf-8")
    tags = [tag.tag.rpartition("}")[2] for tag in ElementTree.fromstring(text).iter()]
    assert tags.count("animate") >= 5 and "script" not in tags
    assert not re.search(r"href|url\(|\bon\w+=", text)
    assert "![A crank turns" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.needs("chromium", "playwright")
def test_the_picture_moves_in_a_browser(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(f'<img src="{(DOCS / "moving.svg").as_uri()}">', encoding="utf-8")
    with opened(page) as shown:
        before = shown.page.screenshot()
        shown.page.wait_for_timeout(400)
        after = shown.page.screenshot()
        assert shown.messages == []
    assert before != after


def test_no_number_of_the_validation_page_is_that_of_another_quantity() -> None:
    """A planar scene has no flapping: its second mode was compared with it, 5.3 apart.

    The programs of the turbine differ by up to 17 %.
    """
    text = (DOCS / "validation.md").read_text(encoding="utf-8")
    deviations = re.findall(r"\| (\S+) relative \|$", text, re.MULTILINE)
    assert len(deviations) > 150
    assert max(abs(float(each)) for each in deviations) < 0.17


def test_the_validation_page_has_every_problem_with_its_words() -> None:
    """In order; each with a table of more than two rows, none without a deviation."""
    text = (DOCS / "validation.md").read_text(encoding="utf-8")
    parts = text.split("\n## ")[1:]
    for part, problem in zip(parts, PROBLEMS, strict=True):
        title, *words = (problem.__doc__ or "").split("\n\n")
        assert part.startswith(title.rstrip(".") + "\n")
        for paragraph in words:
            assert " ".join(paragraph.split()) in part
        rows = [row for row in part.splitlines() if row.startswith("| ")][1:]
        assert len(rows) > 2
        for row in rows:
            assert re.fullmatch(r"\| .* \| [-+]\d\.\de[-+]\d+( relative)? \|", row), row
            assert row.count("|") == 6, row


def test_the_stable_interface_is_that_of_the_page() -> None:
    """A public name, option, key or format has changed: `python docs/interface.py`.

    Within a major version it may be added to only; see the page.
    """
    written = (DOCS / "interface.md").read_text(encoding="utf-8").splitlines()
    changes = difflib.unified_diff(
        written, loaded("interface").page().splitlines(), "page", "source", n=0
    )
    assert list(changes) == [], "to renew the page: python docs/interface.py"


def test_every_page_is_in_the_contents() -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    for page in PAGES:
        name = page.relative_to(DOCS).with_suffix("").as_posix()
        assert name == "index" or f"\n{name}\n" in index, name


@pytest.mark.needs("sphinx")
def test_the_site_is_built_without_warnings(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", DOCS, tmp_path]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, encoding="utf-8"
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "theory.html").is_file()
