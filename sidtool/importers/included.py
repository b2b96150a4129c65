"""Files that a deck takes in: a circle or a cascade of them is refused."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from sidtool.formats.errors import InputError

#: Lines of INCLUDE that one deck may follow; ten files that name each other ten
#: times would be ten thousand million.
MOST = 1000


@dataclass
class Included:
    """The files that are open, and how many have been taken in."""

    open: list[Path] = field(default_factory=list)
    count: int = 0

    def enter(self, file: Path) -> None:
        """Begin a file; `open.pop()` ends it.

        Raises
        ------
        InputError : it takes in itself, or there are too many.
        """
        name = file.resolve()
        if name in self.open:
            raise InputError(
                "includes itself", source=file, expected="files that come to an end"
            )
        self.open.append(name)
        self.count += 1
        if self.count > MOST:
            raise InputError(
                f"takes in more than {MOST} files",
                source=file,
                expected="a deck with fewer lines of INCLUDE",
            )
