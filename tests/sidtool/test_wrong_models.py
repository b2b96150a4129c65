"""Every physical mistake gets a message that names what, where and what helps."""

from __future__ import annotations

import re

import pytest

from . import more_wrong_models
from .wrong_models import MISTAKES


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_gets_the_message_that_names_it(name: str) -> None:
    attempt, words = MISTAKES[name]
    said = attempt()
    for pattern in words:
        assert re.search(pattern, said), said


def test_the_gallery_is_not_small() -> None:
    assert len(MISTAKES) >= 60
    here = [
        a for a, _ in MISTAKES.values() if a.__module__ == more_wrong_models.__name__
    ]
    assert len(here) >= 10
