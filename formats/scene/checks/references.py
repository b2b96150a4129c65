"""Checks of names that refer to markers of bodies or of the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...errors import InputError
from ..bodies import SidBody
from ..outputs import marker_reference
from .failures import fail, known_names

if TYPE_CHECKING:
    from ..file import SceneFile


def check_reference(text: str, place: str, scene: SceneFile) -> None:
    """Raise a marker that does not exist, or that is no marker's name at all."""
    try:
        name, marker = marker_reference(text)
    except InputError as error:
        raise InputError(error.problem, place=place, expected=error.expected) from None
    body = scene.ground if name == "ground" else scene.bodies.get(name)
    if body is None:
        known = ["ground", *scene.bodies]
        fail(place, f"there is no body {name!r}", known_names(name, known, "body"))
    elif isinstance(body, SidBody):
        if not marker:
            fail(place, f"{name} is flexible", f"one of its nodes, as {name}.MARKER")
        _check_marker_of_sid(body, marker, name, place)
    elif marker and marker not in body.markers:
        expected = known_names(marker, body.markers, "marker")
        fail(place, f"{name} has no marker {marker!r}", expected)


def check_two_bodies(texts: tuple[str, str], place: str) -> None:
    """Raise two markers of one body, between which nothing can be prescribed."""
    first, second = (marker_reference(text)[0] for text in texts)
    if first == second:
        fail(place, f"both are on {first}", "markers of two bodies")


def _check_marker_of_sid(body: SidBody, marker: str, name: str, place: str) -> None:
    """A name that is no marker may still be a node; only numbers are let through."""
    if marker not in body.markers and not marker.isdigit():
        expected = known_names(marker, body.markers, "marker") + ", or a node's number"
        fail(place, f"{name} has no marker {marker!r}", expected)
