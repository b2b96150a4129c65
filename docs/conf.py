"""Sphinx: `make docs`. Pages that follow from the source are written first."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import docstrings  # noqa: E402
import gallery  # noqa: E402
import generate  # noqa: E402
import page_pictures  # noqa: E402

import sidtool  # noqa: E402

generate.write(HERE / "generated")
for pictures in (gallery.draw_pictures, page_pictures.draw):
    for picture in pictures(HERE / "generated"):
        print(f"drawn: {picture.name}")

project = "sidtool"
author = "the sidtool authors"
version = release = sidtool.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
suppress_warnings = ["myst.xref_missing"]  # links to files of the repository
exclude_patterns = ["formats", "_build"]
html_theme = "furo"
html_title = f"sidtool {release}"
autodoc_typehints = "description"
autodoc_type_aliases = {"Array": "Array"}
add_module_names = False


def setup(app):  # type: ignore[no-untyped-def]
    """Sections of docstrings become lists of names with types and meanings; pages show
    the pictures that their commands draw."""

    def rewrite(app, what, name, thing, options, lines):  # type: ignore[no-untyped-def]
        lines[:] = docstrings.as_fields("\n".join(lines)).splitlines() + [""]

    def show(app, name, source):  # type: ignore[no-untyped-def]
        page = HERE / f"{name}.md"
        if page.is_file():
            text = page_pictures.with_pictures(page, source[0], HERE / "generated")
            source[0] = text

    app.connect("autodoc-process-docstring", rewrite)
    app.connect("source-read", show)
