"""Checks of single parts of a scene: dimensions, signs, order in time.

All raise `InputError` with the key of the value.
"""

from collections.abc import Iterable, Mapping
from typing import NoReturn

import numpy as np

from ..base.errors import InputError
from .base import Placement, Time
from .bodies import Initial, RigidBody


def check_time(time: Time) -> None:
    if not time.end > time.start:
        raise_failure(
            "time.end", f"found {time.end}", f"a time after the start, {time.start}"
        )
    if time.output_step is not None and time.output_times is not None:
        raise_failure("time", "both are given", "one of output_step and output_times")
    for earlier, later in zip(
        time.output_times or (), (time.output_times or ())[1:], strict=False
    ):
        if not later > earlier:
            raise_failure(
                "time.output_times", f"{later} follows {earlier}", "growing times"
            )
    for value in time.output_times or ():
        if not time.start <= value <= time.end:
            raise_failure(
                "time.output_times", f"found {value}", "times from start to end"
            )


def check_length(vector: tuple[float, ...] | None, place: str, dimension: str) -> None:
    length = 2 if dimension == "planar" else 3
    if vector is not None and len(vector) != length:
        raise_failure(
            place, f"found {len(vector)} components", f"{length} in a {dimension} scene"
        )


def _check_placement(placement: Placement, place: str, dimension: str) -> None:
    check_length(placement.position, f"{place}.position", dimension)
    given = [
        key
        for key in ("angle", "axis_angle", "quaternion", "matrix")
        if getattr(placement, key) is not None
    ]
    if len(given) > 1:
        raise_failure(
            f"{place}.{given[1]}", f"is given with {given[0]}", "one orientation"
        )
    for key in given:
        if (key == "angle") != (dimension == "planar"):
            expected = "angle" if dimension == "planar" else "axis_angle or quaternion"
            raise_failure(f"{place}.{key}", f"is not for a {dimension} scene", expected)
    quaternion = placement.quaternion
    if quaternion is not None and abs(np.linalg.norm(quaternion) - 1) > 1e-6:
        raise_failure(f"{place}.quaternion", "is not a unit quaternion", "length 1")
    if placement.matrix is not None:
        matrix = np.array(placement.matrix)
        proper = np.linalg.det(matrix) > 0
        if not (proper and np.allclose(matrix.T @ matrix, np.eye(3), atol=1e-6)):
            raise_failure(
                f"{place}.matrix", "is not a rotation", "orthonormal columns, det 1"
            )


def check_markers(markers: Mapping[str, Placement], place: str, dimension: str) -> None:
    for name, marker in markers.items():
        _check_placement(marker, f"{place}.{name}", dimension)


def check_rigid_body(body: RigidBody, place: str, dimension: str) -> None:
    check_length(body.centre_of_mass, f"{place}.centre_of_mass", dimension)
    check_markers(body.markers, f"{place}.markers", dimension)
    if body.inertia is None:
        return
    place = f"{place}.inertia"
    if isinstance(body.inertia, float | int) != (dimension == "planar"):
        expected = "a number" if dimension == "planar" else "[xx, yy, zz] or 3 x 3"
        raise_failure(place, f"does not fit a {dimension} scene", expected)
    inertia = np.array(body.inertia, float)
    principal = inertia
    if inertia.ndim == 2:
        if not np.allclose(inertia, inertia.T, rtol=1e-9, atol=0):
            raise_failure(place, "is not symmetric", "a symmetric 3 x 3 matrix")
        principal = np.linalg.eigvalsh(inertia)
    if principal.min() < -1e-12 * np.abs(inertia).max():
        raise_failure(place, "is negative", "inertia that is not negative")


def check_initial(initial: Initial, place: str, dimension: str) -> None:
    _check_placement(initial, place, dimension)
    check_length(initial.velocity, f"{place}.velocity", dimension)
    spin = initial.angular_velocity
    if spin is not None and isinstance(spin, tuple) == (dimension == "planar"):
        expected = "a number" if dimension == "planar" else "three numbers"
        place = f"{place}.angular_velocity"
        raise_failure(place, f"does not fit a {dimension} scene", expected)


def raise_failure(place: str, problem: str, expected: str | None = None) -> NoReturn:
    """Raise what was found wrong at a key."""
    raise InputError(problem, place=place, expected=expected)


def expected_names(name: str, known: Iterable[str], what: str) -> str:
    """Return the expectation instead of an unknown name: the nearest one, or
    the list.
    """
    from difflib import get_close_matches

    names = list(known)
    near = get_close_matches(name, names, n=1)
    if near:
        return f"an existing {what}, perhaps {near[0]}"
    listed = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
    return f"an existing {what}, one of {listed}" if names else f"an existing {what}"
