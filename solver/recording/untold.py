"""Outputs that the states of a result do not tell, and why."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from sidtool.formats.scene import (
    FRICTION_QUANTITIES,
    Given,
    OutputName,
    SceneFile,
    parse_output,
)
from sidtool.formats.scene.outputs import is_of_joint

from .energy_history import INTEGRATED

_ACCELERATIONS = ("ax", "ay", "az")
#: What would tell them.
RECORDED = "to be recorded in the run: outputs.record of the scene"


def lost_laws(scene: SceneFile, known: Mapping[str, Any]) -> tuple[str, ...]:
    """Forces and drives whose law only the program of the run had.

    known : laws of forces and drives that are there again
    """
    return tuple(
        name
        for name, force in {**scene.drives, **scene.forces}.items()
        if isinstance(function := getattr(force, "function", None), Given)
        and not function.terms
        and name not in known
    )


def sampled_laws(scene: SceneFile, known: Mapping[str, Any]) -> tuple[str, ...]:
    """Forces and drives with a law that holds its value between samples."""
    owners = {**scene.drives, **scene.forces}
    laws = {n: getattr(f, "function", None) for n, f in owners.items()} | {**known}
    return tuple(n for n, law in laws.items() if getattr(law, "sample_time", None))


def untold(
    names: Iterable[str], scene: SceneFile, known: Mapping[str, Any], between: bool
) -> dict[str, tuple[str, str]]:
    """Of the names those that cannot be told afterwards: why, and what is expected.

    known : laws of forces and drives that are there again
    between : at times between those of the result
    """
    lost = lost_laws(scene, known)
    sampled = sampled_laws(scene, known) if between else ()
    found: dict[str, tuple[str, str]] = {}
    for text in names:
        name = parse_output(text)
        if name.owner == "energy" and name.quantity in INTEGRATED:
            why = "is an integral along the steps of the run, which are not kept"
            found[text] = why, RECORDED
        elif lost and _needs(name, scene, lost):
            why = f"depends on the law of {', '.join(lost)}, which a program gave"
            found[text] = (
                why,
                "it recorded in the run, or the law in `forces`, `drives`",
            )
        elif sampled and _needs(name, scene, sampled):
            laws = ", ".join(sampled)
            why = f"depends on what {laws} holds between samples, which is not kept"
            found[text] = why, "the output times of the result"
    return found


def _needs(name: OutputName, scene: SceneFile, forces: tuple[str, ...]) -> bool:
    """Whether an output depends on forces: on accelerations, or on one of theirs."""
    quantity = name.quantity
    own = name.owner in scene.forces and name.owner not in scene.joints
    of_joint = is_of_joint(quantity) or quantity in FRICTION_QUANTITIES
    return name.owner in forces or quantity in _ACCELERATIONS or (of_joint and not own)
