"""Shares of the static compliance of a body that its shape functions represent."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

#: The directions of loads: forces along the body axes, moments about them.
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
#: What stands for the loads by its own inertia, where nodes have their ids.
INERTIA_KEY = "*"

_ENTRY = re.compile(r"([^\s=\[\];]+)=([\d,-]+)", re.ASCII)

SixComponents = tuple[float | None, ...]


@dataclass(frozen=True)
class ComplianceShares:
    """Shares of the compliance of the full body.

    Attributes
    ----------
    free : loads were balanced by the inertia of a free body, whose displacements carry
        no momentum; else the body was fixed by its frame
    shares : node id -> (6,) by `DIRECTIONS`: share of the displacement (or rotation)
        along a unit load there that the shape functions represent; None if not known
    lost : (6,) missing compliance under its own inertia when its frame is accelerated
        along and about its axes; over the largest one of the body of the same kind,
        forces or moments; empty if not known
    """

    free: bool
    shares: Mapping[str, SixComponents] = field(default_factory=dict)
    lost: tuple[float, ...] = ()

    def text(self, room: int) -> str:
        """Return the shares in per cent, the poorest nodes first, limited to `room`
        characters.
        """
        text = "free" if self.free else "held"
        for entry in self._entries():
            if len(text) + 1 + len(entry) > room:
                break
            text += f" {entry}"
        return text

    def _entries(self) -> Iterator[str]:
        if self.lost:
            yield _entry(INERTIA_KEY, self.lost)
        for name, row in sorted(self._rows(), key=lambda named: _poorest(named[1])):
            yield _entry(name, row)

    def _rows(self) -> Iterator[tuple[str, SixComponents]]:
        for name, row in self.shares.items():
            if _ENTRY.fullmatch(_entry(name, row)) and name != INERTIA_KEY:
                yield name, row


def parse_compliance_shares(text: str) -> ComplianceShares | None:
    """Parse the text of `ComplianceShares.text`; None if it is something else."""
    kind, _, rest = text.partition(" ")
    if kind not in ("free", "held"):
        return None
    shares: dict[str, SixComponents] = {}
    lost: tuple[float, ...] = ()
    for entry in rest.split():
        match = _ENTRY.fullmatch(entry)
        row = None if match is None else _row(match[2])
        if match is None or row is None:
            return None
        if match[1] == INERTIA_KEY:
            lost = tuple(_is_known(row))
        else:
            shares[match[1]] = row
    return ComplianceShares(kind == "free", shares, lost if len(lost) == 6 else ())


def _is_known(row: SixComponents) -> list[float]:
    return [share for share in row if share is not None]


def _poorest(row: SixComponents) -> int:
    """The lowest known share in whole per cents; finer differences may be rounding."""
    return round(100.0 * min(_is_known(row), default=1.0))


def _entry(name: str, row: SixComponents) -> str:
    cells = ["-" if x is None else f"{100.0 * x:.0f}" for x in row]
    return f"{name}={','.join(cells)}"


def _row(text: str) -> SixComponents | None:
    cells = text.split(",")
    if len(cells) != 6 or not all(c == "-" or c.isdecimal() for c in cells):
        return None
    return tuple(None if c == "-" else float(c[:4]) / 100.0 for c in cells)
