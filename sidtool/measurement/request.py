"""Requested accuracy: outputs and the error that each may have."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import diagnose
from sidtool.formats.motion_kinds import named_by_kind
from sidtool.formats.scene import (
    KIND,
    SceneFile,
    Tolerance,
    expand_names,
    parse_output,
    tolerance,
)

Wanted = float | Mapping[str, float | str]

#: Outputs that measure the run itself, or switch between two values.
_NO_QUANTITIES = ("constraint.position", "constraint.velocity", "energy.balance")


@dataclass(frozen=True)
class Request:
    """Outputs that count and the error that each may have.

    ignored : recorded outputs for which no error is defined
    """

    tolerances: Mapping[str, Tolerance]
    ignored: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.tolerances)

    def allowed(self, variation: Array) -> Array:
        """Return allowed errors (n,) in the units of the outputs, for their variation
        (n,).
        """
        pairs = zip(self.tolerances.values(), variation, strict=True)
        return np.array([t.value if t.absolute else t.value * v for t, v in pairs])


def refuse_accuracy(
    reason: str, expected: str = "a larger error, or other outputs"
) -> InputError:
    """Return the error that a requested accuracy cannot be reached (N617)."""
    problem = diagnose("N617", reason=reason).message_line
    return InputError(problem, place="accuracy.wanted", expected=expected)


def requested(
    scene: SceneFile,
    sids: Mapping[str, SID],
    wanted: Wanted,
) -> Request:
    """Return the requested outputs with expanded wildcards.

    Raises
    ------
    InputError : nothing is recorded, or a name or an amount is not valid.
    """
    if isinstance(wanted, Mapping):
        amounts = {}
        for text, amount in wanted.items():
            for name in _single_outputs(scene, sids, (text,), "accuracy.wanted"):
                amounts[name] = tolerance(name, amount, scene)
        return Request(amounts)
    names = _single_outputs(scene, sids, scene.outputs.record, "outputs.record")
    ignored = tuple(n for n in names if n in _NO_QUANTITIES or n.endswith(".sticking"))
    amounts = {n: Tolerance(wanted, False) for n in names if n not in ignored}
    if not amounts:
        raise InputError(
            "the scene records no quantity that could have an error",
            place="outputs.record",
            expected='names such as ["piston.x"]',
        )
    return Request(amounts, ignored)


def _single_outputs(
    scene: SceneFile,
    sids: Mapping[str, SID],
    texts: tuple[str, ...],
    place: str,
) -> list[str]:
    """Return single outputs; q* and vq* are expanded, too."""
    outputs: list[str] = []
    for name in expand_names(texts, scene, sids, place):
        parsed = parse_output(name)
        if KIND.fullmatch(parsed.quantity):
            outputs.append(_numbered_coordinate(scene, sids, name, place))
        elif not name.endswith("*"):
            outputs.append(name)
        else:
            sid = sids[parsed.owner]
            numbers = scene.bodies[parsed.owner].numbers(sid.nq)  # type: ignore[union-attr]
            outputs += [f"{name[:-1]}{k}" for k in numbers]
    return outputs


def _numbered_coordinate(
    scene: SceneFile, sids: Mapping[str, SID], name: str, place: str
) -> str:
    """Return BODY.qN for an elastic coordinate that is named by its kind."""
    owner, _, quantity = parse_output(name)
    kind, known = KIND.fullmatch(quantity), named_by_kind(sids[owner])
    assert kind is not None
    if kind[2] not in known:
        raise InputError(
            f"{owner} has no elastic coordinate {kind[2]}",
            place=place,
            expected=f"one of {', '.join(known)}" if known else "another output",
        )
    return f"{owner}.{kind[1]}q{known[kind[2]]}"
