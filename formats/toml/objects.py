"""Python objects in places where files name other files."""

from typing import Any

#: Objects by their texts, as long as the process runs: scenes hold texts alone.
_OBJECTS: dict[str, Any] = {}


def name_object(value: Any) -> str:
    """Return the text that refers to an object, the same one each time."""
    for text, known in _OBJECTS.items():
        if known is value:
            return text
    text = f"(object {len(_OBJECTS) + 1} of a program)"
    _OBJECTS[text] = value
    return text


def named_object(text: str | None) -> Any:
    """Return the object that a text refers to; None for the name of a file."""
    return None if text is None else _OBJECTS.get(text)
