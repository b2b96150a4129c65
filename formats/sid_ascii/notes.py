"""What a reader had to guess, collected so that a thousand blocks make one remark."""

from __future__ import annotations


class Notes:
    """Remarks by kind; each keeps its first place and how often it occurred."""

    def __init__(self) -> None:
        self._places: dict[str, list[str]] = {}

    def add(self, remark: str, place: str = "") -> None:
        """Note a remark, and where it applies."""
        self._places.setdefault(remark, []).append(place)

    def texts(self) -> tuple[str, ...]:
        """One text per remark."""
        return tuple(_text(remark, places) for remark, places in self._places.items())


def _text(remark: str, places: list[str]) -> str:
    if not places[0]:
        return remark
    more = f" and {len(places) - 1} more" if len(places) > 1 else ""
    return f"{places[0]}{more}: {remark}"
