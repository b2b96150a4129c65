"""Writes the gallery: a page with a picture of every example, and each example's text.

The pictures are drawn from the model files when the site is built.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
_ROW = re.compile(r"^\| \[(\w+)\]\(\w+\) \| (.+) \|$", re.MULTILINE)
_CONVERT = re.compile(r"sidtool convert (\w+\.toml)")
_SIMULATE = re.compile(r"sidtool (simulate .+)$", re.MULTILINE)
_IMAGE = re.compile(r"(!\[[^\]]*\]\()([\w.]+\))")
_SCRIPT = re.compile(r"^ *python (\w+\.py)$", re.MULTILINE)


@dataclass(frozen=True)
class Example:
    """An example of the repository.

    Attributes
    ----------
    name : its folder
    title : heading of its text
    shows : what is to be seen
    text : its README.md
    """

    name: str
    title: str
    shows: str
    text: str

    @property
    def model(self) -> str | None:
        """Name of the first model file that its commands convert, if they do."""
        return next(iter(_CONVERT.findall(self.text)), None)

    @property
    def simulation(self) -> list[str]:
        """The words of its last simulation."""
        return shlex.split(_SIMULATE.findall(self.text)[-1])


def examples() -> list[Example]:
    """All examples, in the order of their list."""
    rows = _ROW.findall((EXAMPLES / "README.md").read_text(encoding="utf-8"))
    found = []
    for name, shows in rows:
        text = (EXAMPLES / name / "README.md").read_text(encoding="utf-8")
        title = text.splitlines()[0].removeprefix("# ")
        found.append(Example(name, title, shows, text))
    return found


def pages() -> dict[str, str]:
    """Name and content of the gallery and of the page of each example."""
    found = examples()
    parts = [
        "# Gallery\n",
        "`sidtool new NAME --from EXAMPLE` copies an example. A test runs each of "
        "them.\n",
        "```{toctree}\n:hidden:\n\n"
        + "\n".join(f"example_{each.name}" for each in found)
        + "\n```\n",
    ]
    for each in found:
        page = f"example_{each.name}"
        parts += [
            f"## [{each.title}]({page}.md)\n",
            f"[![{each.name}]({each.name}.png)]({page}.md)\n",
            f"`{each.name}`: {each.shows}.\n",
        ]
    created = {"gallery.md": "\n".join(parts)}
    for each in found:
        heading, _, rest = each.text.partition("\n")
        picture = f"![{each.name}]({each.name}.png)"
        rest = _IMAGE.sub(rf"\1../../examples/{each.name}/\2", rest)
        created[f"example_{each.name}.md"] = f"{heading}\n\n{picture}\n{rest}"
    return created


def draw_pictures(folder: Path) -> Iterator[Path]:
    """Draw the model or the motion of each example into a folder; yields the files."""
    for each in examples():
        yield draw_picture(each, folder)


def draw_picture(example: Example, folder: Path) -> Path:
    """Draw the model of an example; its mesh is made by its own script, if it has one.

    Of an example without a model the motion is drawn. Its files are not changed.
    """
    from sidtool.cli.main import run

    target = folder / f"{example.name}.png"
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name) / example.name
        shutil.copytree(EXAMPLES / example.name, copy)
        for script in _SCRIPT.findall(example.text.partition("sidtool convert")[0]):
            subprocess.run([sys.executable, script], cwd=copy, check=True)
        drawn = example.model
        if drawn is None:
            command = [sys.executable, "-m", "sidtool", *example.simulation]
            subprocess.run(command, cwd=copy, check=True)
            drawn = example.simulation[-1]
        arguments = [str(copy / drawn), "-o", str(target), "--force", "--quiet"]
        status = run(["plot", *arguments])
    if status != 0:
        raise RuntimeError(f"no picture of {example.name}: exit status {status}")
    return target
