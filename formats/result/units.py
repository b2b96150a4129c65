"""Units of the outputs of a result, which its scene knows."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import lru_cache, partial

from ..errors import InputError
from ..scene import SceneFile, unit_of
from ..toml.reading import validated
from .data import Result


def units_in(result: Result) -> Callable[[str], str]:
    """The unit of an output of this result by its name, see `unit_of`."""
    return _units(result.scene)


@lru_cache(maxsize=8)
def _units(text: str) -> Callable[[str], str]:
    try:
        return partial(unit_of, scene=validated(json.loads(text), SceneFile))
    except (ValueError, InputError):
        return unit_of
