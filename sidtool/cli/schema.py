"""``sidtool schema``: the JSON Schema of the files that people write."""

from __future__ import annotations

import json

import click


@click.command()
@click.argument("kind", type=click.Choice(["model", "scene"]))
def schema(kind: str) -> None:
    """Print the JSON Schema of a model or scene file, for editors.

    \b
    Example:
      sidtool schema scene > scene.schema.json
    """
    if kind == "model":
        from formats.model import ModelFile as File
    else:
        from formats.scene import SceneFile as File
    click.echo(json.dumps(File.model_json_schema(), indent=2))
