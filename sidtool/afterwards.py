"""Outputs of a result that were not recorded in its run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sidtool.formats.result import Result
from sidtool.formats.scene import expanded, has_wildcard, matching
from sidtool.formats.sid import Array

Programs = Mapping[str, Any]


def outputs(
    result: Result,
    names: str | Iterable[str],
    *,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> dict[str, Array]:
    """Outputs of a result by name, (nt,) each, in the order asked for; no new run.

    What was recorded is taken from the result; all else is evaluated at its states.

    Parameters
    ----------
    names : as in `outputs.record` of a scene, `*` for any letters: "rod.tip.vx",
        "rod.q*"; several also as one text with commas
    drives, forces : callables that the run was made with, as for `simulate`

    Raises
    ------
    InputError : there is no such output, or it is an integral over the run; the
        result does not hold its scene.
    """
    listed = _listed(names)
    recorded = {name: result[name] for name in listed if name in result.names}
    if len(recorded) == len(listed):
        return recorded
    if "analysis" in result.settings:
        return _of_analysis(result, listed)
    from sidtool.solver.afterwards import replay, scene_of

    wanted = expanded(listed, scene_of(result), result.sids)
    missing = [name for name in wanted if name not in result.names]
    found = {name: result[name] for name in wanted if name in result.names}
    if missing:
        found |= replay(result, missing, drives, forces).outputs()
    places = [[n] if n in found else matching(n, found) for n in wanted]  # JOINT.f*
    return {name: found[name] for names in places for name in names}


def outputs_at(result: Result, names: Iterable[str], times: Array) -> dict[str, Array]:
    """Outputs at any times of a run, (nt,) each: from its states, interpolated between
    output times. Of an analysis what it recorded, along straight lines.

    Raises
    ------
    InputError : see `outputs`; an analysis did not record one.
    """
    if "analysis" in result.settings:
        found = outputs(result, names)
        return {name: np.interp(times, result.t, v) for name, v in found.items()}
    from sidtool.solver.afterwards import replay

    return replay(result, names).outputs(times)


def with_outputs(result: Result, found: Mapping[str, Array]) -> Result:
    """The result with these outputs beside those that it has."""
    new = [name for name in found if name not in result.names]
    values = np.column_stack([result.values, *(found[name] for name in new)])
    return replace(result, names=(*result.names, *new), values=values)


def _listed(names: str | Iterable[str]) -> list[str]:
    texts = names.split(",") if isinstance(names, str) else names
    return [text.strip() for text in texts if text.strip()]


def _of_analysis(result: Result, listed: list[str]) -> dict[str, Array]:
    """What an analysis recorded: its states alone do not tell accelerations."""
    found: dict[str, Array] = {}
    for name in listed:
        names = matching(name, result.names) if has_wildcard(name) else [name]
        found |= {one: Result.__getitem__(result, one) for one in names or [name]}
    return found
