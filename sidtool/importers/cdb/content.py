"""What an ANSYS archive says of a body, as its commands are read one by one."""

from __future__ import annotations

from dataclasses import dataclass, field

from sidtool.formats.errors import InputError


@dataclass
class Content:
    """The lines of an archive, and what was read of them."""

    lines: list[str]
    at: int = 0
    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    types: dict[int, int] = field(default_factory=dict)
    options: dict[tuple[int, int], int] = field(default_factory=dict)
    elements: list[tuple[list[int], str]] = field(default_factory=list)
    constants: dict[int, dict[str, float]] = field(default_factory=dict)
    tables: dict[tuple[int, str], list[float]] = field(default_factory=dict)
    sets: dict[str, list[int]] = field(default_factory=dict)
    parts: dict[str, list[int]] = field(default_factory=dict)
    current: dict[str, int] = field(default_factory=dict)
    said: dict[str, None] = field(default_factory=dict)
    branches: int = 0

    @property
    def place(self) -> str:
        """Where the reader is."""
        return f"line {self.at}"

    def next(self) -> str:
        """The next line.

        Raises
        ------
        InputError : the file ends.
        """
        if self.at >= len(self.lines):
            raise InputError("ends inside a block", expected="the rest of the block")
        self.at += 1
        return self.lines[self.at - 1]
