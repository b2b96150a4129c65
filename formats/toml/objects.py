"""Objects that a program gives where files name other files.

`SidBody(sid=SID)` and `SidBody(model=Model)` hold a text that stands for the object in
this process, so that scenes stay what a file may hold.
"""

from __future__ import annotations

from typing import Any

#: Objects by their texts, as long as the process runs: scenes hold texts alone.
_OBJECTS: dict[str, Any] = {}


def name_object(value: Any) -> str:
    """The text that stands for an object, the same one each time."""
    for text, known in _OBJECTS.items():
        if known is value:
            return text
    text = f"(object {len(_OBJECTS) + 1} of a program)"
    _OBJECTS[text] = value
    return text


def named_object(text: str | None) -> Any:
    """The object that a text stands for; None for a name of a file."""
    return None if text is None else _OBJECTS.get(text)
