"""Check of language: words that only this project would know, and long sentences.

`make lint` runs it over the pages of the documentation and over all comments,
docstrings and texts of the source. It is an aid for writers. A text without a finding
can still be hard to read.
"""

from __future__ import annotations

import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

from tests.places import EXAMPLES, PAGES, ROOT

#: Phrases that have a usual word: a number is printed, not told; a defect is removed,
#: not mended.
PHRASES = re.compile(
    r"\b((?:is|are|was|were|be|been|not) told|tells?|errs|say so"
    r"|says (?:what|which|how)|asked for|stands? (?:beside|in|on|at)|nobody"
    r"|thrown away|carried away|let go"
    r"|mend(?:s|ed)?|lapses?|rubbing|regripped|peeled|untold)\b",
    re.IGNORECASE,
)
#: Words of one sentence of a page.
MAX_WORDS = 45
SOURCES = ("formats", "solver", "sidtool")
_BLOCK = re.compile(r"^ *```.*?^ *```", re.DOTALL | re.MULTILINE)
_FORMULA = re.compile(r"\$\$.*?\$\$|\$[^$]*\$|`[^`]*`", re.DOTALL)
_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
_ROW = re.compile(r"^\|.*$", re.MULTILINE)
_PARAGRAPH = re.compile(r"\n\s*\n|\n\s*(?:[-*]|\d+\.) ")
_SENTENCE = re.compile(r"(?<=[.!?:;])\s+")


def pages() -> list[Path]:
    """All pages that people write; the page of the interface is a list of names."""
    found = [ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "CHANGELOG")]
    found += [page for page in PAGES if page.name != "interface.md"]
    return [*found, *sorted(EXAMPLES.rglob("*.md"))]


def long_sentences(text: str) -> Iterator[str]:
    """Sentences of a page with more than `MAX_WORDS` words; a formula is one word."""
    text = _ROW.sub("\n\n", _FORMULA.sub("x", _BLOCK.sub("", text)))
    text = _LINK.sub(r"\1", text)
    for paragraph in _PARAGRAPH.split(text):
        for sentence in _SENTENCE.split(" ".join(paragraph.split())):
            if len(sentence.split()) > MAX_WORDS:
                yield sentence


def texts_of_source(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of each comment and of each line of a string."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in (tokenize.COMMENT, tokenize.STRING):
            for k, line in enumerate(token.string.splitlines()):
                yield token.start[0] + k, line


def findings() -> Iterator[str]:
    """Each phrase and each long sentence with its place."""
    for page in pages():
        name, text = page.relative_to(ROOT), page.read_text(encoding="utf-8")
        for k, line in enumerate(text.splitlines(), start=1):
            for found in PHRASES.finditer(line):
                yield f"{name}:{k}: {found[0]!r}"
        for sentence in long_sentences(text):
            count = len(sentence.split())
            yield f"{name}: a sentence of {count} words: {sentence[:60]} ..."
    for folder in SOURCES:
        for path in sorted((ROOT / folder).rglob("*.py")):
            name = path.relative_to(ROOT)
            for k, line in texts_of_source(path.read_text(encoding="utf-8")):
                for found in PHRASES.finditer(line):
                    yield f"{name}:{k}: {found[0]!r}"


def main() -> int:
    """Print the findings; returns the exit status."""
    found = list(findings())
    print("\n".join(found) or "Language: no findings.")
    return int(bool(found))


if __name__ == "__main__":
    raise SystemExit(main())
