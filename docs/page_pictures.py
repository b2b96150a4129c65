"""Pictures that the commands of a page draw, shown below them.

A page says `sidtool plot result.h5 -o motion.png`. When the site is built, the blocks
of the page are run as its test runs them, and what they draw stands behind the block.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.commands import BLOCK, blocks, run_page

DOCS = Path(__file__).resolve().parent
_PICTURE = re.compile(r"sidtool .* -o ([\w.]+\.(?:png|svg|gif))")


def pages() -> list[Path]:
    """Pages whose commands draw pictures."""
    written = [*DOCS.glob("*.md"), *DOCS.glob("howto/*.md")]
    return sorted(p for p in written if drawn_by(p.read_text(encoding="utf-8")))


def drawn_by(text: str) -> list[str]:
    """Names of the pictures that the commands of a text draw."""
    codes = (code for language, code, _ in blocks(text) if language == "sh")
    return [name for code in codes for name in _PICTURE.findall(code)]


def draw(folder: Path) -> Iterator[Path]:
    """Run all pages that draw pictures and keep these; yields the files."""
    for page in pages():
        yield from draw_page(page, folder)


def draw_page(page: Path, folder: Path) -> Iterator[Path]:
    """Run a page with the examples beside it, in a folder of its own."""
    with tempfile.TemporaryDirectory() as name:
        shutil.copytree(DOCS.parent / "examples", Path(name) / "examples")
        run_page(page, Path(name))
        for picture in drawn_by(page.read_text(encoding="utf-8")):
            drawn = max(
                Path(name).rglob(picture), key=lambda path: path.stat().st_mtime
            )
            yield Path(shutil.copyfile(drawn, folder / f"{page.stem}_{picture}"))


def with_pictures(page: Path, text: str, folder: Path) -> str:
    """The text of a page with its pictures behind the blocks that draw them."""
    up = "../" * (len(page.relative_to(DOCS).parts) - 1)

    def shown(match: re.Match[str]) -> str:
        found = [f"{page.stem}_{name}" for name in drawn_by(match[0])]
        lines = (
            f"\n\n{match[1]}![{name}]({up}{folder.name}/{name})"
            for name in found
            if (folder / name).is_file()
        )
        return match[0] + "".join(lines)

    return BLOCK.sub(shown, text)
