"""Options of the form BODY=FILE: a file for a body of the scene."""

from __future__ import annotations

from collections.abc import Iterable

import click

from sidtool.formats.errors import InputError

full_fields = click.option(
    "--field",
    "fields",
    metavar="BODY=FILE",
    multiple=True,
    help="Full field of a flexible body, from `convert --field`; may be given several "
    "times. NAME.field.h5 beside the SID of a scene is found by itself.",
)


def files_by_body(
    option: str, texts: Iterable[str], bodies: Iterable[str] | None = None
) -> dict[str, str]:
    """Files by body, of an option that may be given several times.

    bodies : that may be named, where they are known

    Raises
    ------
    InputError : one has another form, or names no such body or one twice.
    """
    known = None if bodies is None else tuple(bodies)
    expected = "BODY=FILE" + (
        f" with a BODY out of {', '.join(known)}" if known else ", as in rod=rod.h5"
    )
    found: dict[str, str] = {}
    for text in texts:
        body, _, file = text.partition("=")
        if not body or not file or (known is not None and body not in known):
            raise InputError(f"found {text!r}", place=option, expected=expected)
        if body in found:
            raise InputError(
                f"{body} has two files, {found[body]} and {file}",
                place=option,
                expected="one file for each body",
            )
        found[body] = file
    return found
