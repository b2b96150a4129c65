"""``sidtool schema``: the JSON Schema of the files that people write."""

from __future__ import annotations

import json
from importlib import import_module

import click

KINDS = {
    "model": ("sidtool.formats.model", "ModelFile"),
    "scene": ("sidtool.formats.scene", "SceneFile"),
    "reference": ("sidtool.formats.reference", "ReferenceFile"),
}


@click.command()
@click.argument("kind", type=click.Choice(list(KINDS)))
def schema(kind: str) -> None:
    """Print the JSON Schema of a model, scene or reference file, for editors.

    \b
    Example:
      sidtool schema scene > scene.schema.json
    """
    module, name = KINDS[kind]
    file = getattr(import_module(module), name)
    click.echo(json.dumps(file.model_json_schema(), indent=2))
