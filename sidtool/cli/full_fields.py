"""The option --field: full fields of flexible bodies."""

from __future__ import annotations

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


def field_files(texts: tuple[str, ...]) -> dict[str, str]:
    """BODY=FILE, several times.

    Raises
    ------
    InputError : one has another form.
    """
    found = {}
    for text in texts:
        body, _, file = text.partition("=")
        if not body or not file:
            expected = "BODY=FILE, as in rod=rod.field.h5"
            raise InputError(f"found {text!r}", place="--field", expected=expected)
        found[body] = file
    return found
