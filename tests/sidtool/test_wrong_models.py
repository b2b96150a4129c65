"""Every physical mistake gets a message that names what, where and what helps."""

from __future__ import annotations

import re

import pytest

from .wrong_models import MISTAKES, bodies, joints, loads, machines, units


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_gets_the_message_that_names_it(name: str) -> None:
    attempt, words = MISTAKES[name]
    messages = attempt()
    for pattern in words:
        assert re.search(pattern, messages), messages


@pytest.mark.parametrize("code", ["N101", "N103", "N104", "N107"])
def test_implausible_bodies_are_in_the_gallery(code: str) -> None:
    patterns = [pattern for _, words in MISTAKES.values() for pattern in words]
    assert any(pattern.startswith(code) for pattern in patterns)


def test_the_gallery_is_not_small() -> None:
    assert len(MISTAKES) >= 60
    rooms = [attempt.__module__ for attempt, _ in MISTAKES.values()]
    for room in (bodies, joints, loads, machines, units):
        assert rooms.count(room.__name__) >= 5
