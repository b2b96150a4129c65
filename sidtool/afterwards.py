"""Outputs of a result that were not recorded in its run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.progress import reached
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, expanded, has_wildcard, matching
from sidtool.formats.sid import Array
from sidtool.formats.toml.reading import validated

if TYPE_CHECKING:
    from sidtool.solver.afterwards import Replay

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
    drives, forces : callables that the run was made with, as for `simulate`; results
        keep what was seen of functions of time, so that only laws are missed

    Raises
    ------
    InputError : there is no such output, or the states do not tell it: it is an
        integral over the run, or depends on a law that only a program had; the result
        does not hold its scene.
    """
    listed = _listed(names)
    recorded = {name: result[name] for name in listed if name in result.names}
    if len(recorded) == len(listed):
        return recorded
    if "analysis" in result.settings:
        return _of_analysis(result, listed, drives, forces)
    from sidtool.solver.afterwards import replay, scene_of

    wanted = expanded(listed, scene_of(result), result.sids)
    missing = [name for name in wanted if name not in result.names]
    found = {name: result[name] for name in wanted if name in result.names}
    if missing:
        reached("evaluating outputs")
        found |= replay(result, missing, drives, forces).outputs()
    told = _ordered(wanted, found)
    for name in listed:
        if not (has_wildcard(name) and told) and not matching(name, told):
            raise InputError(
                f"the run does not tell {name}",
                expected="an output of what deforms: a body that was rigid has no "
                "elastic coordinates and no stress",
            )
    return told


def outputs_at(result: Result, names: Iterable[str], times: Array) -> dict[str, Array]:
    """Outputs at any times of a run, (nt,) each: from its states, interpolated between
    output times. Along straight lines what was recorded and states do not tell, and all
    of an analysis.

    Raises
    ------
    InputError : see `outputs`; what states do not tell was not recorded.
    """
    return played_outputs(result, names, times)[0]


def played_outputs(
    result: Result, names: Iterable[str], times: Array
) -> tuple[dict[str, Array], Replay | None]:
    """See `outputs_at`; and the run looked at again, but of an analysis."""
    names = list(names)
    if "analysis" in result.settings:
        found = outputs(result, names)
        return {name: np.interp(times, result.t, v) for name, v in found.items()}, None
    from sidtool.solver.afterwards import replay, scene_of
    from sidtool.solver.recording.untold import untold

    straight = untold(names, scene_of(result), result.laws, between=True)
    straight = {name: why for name, why in straight.items() if name in result.names}
    rest = [name for name in names if name not in straight]
    reached("evaluating outputs")
    again = replay(result, rest, between=True)
    found = again.outputs(times)
    found |= {n: np.interp(times, result.t, result[n]) for n in straight}
    return _ordered(names, found), again


def with_outputs(result: Result, found: Mapping[str, Array]) -> Result:
    """The result with these outputs beside those that it has."""
    new = [name for name in found if name not in result.names]
    values = np.column_stack([result.values, *(found[name] for name in new)])
    return replace(result, names=(*result.names, *new), values=values)


def _listed(names: str | Iterable[str]) -> list[str]:
    texts = names.split(",") if isinstance(names, str) else names
    return [text.strip() for text in texts if text.strip()]


def _ordered(names: Iterable[str], found: Mapping[str, Array]) -> dict[str, Array]:
    """As the names say."""
    places = [[name] if name in found else matching(name, found) for name in names]
    return {name: found[name] for names in places for name in names}


def _of_analysis(
    result: Result, listed: list[str], drives: Programs | None, forces: Programs | None
) -> dict[str, Array]:
    """What an analysis recorded, since its states alone do not tell accelerations; of a
    static equilibrium all outputs, from the analysis once more."""
    if result.settings["analysis"] == "static equilibrium" and result.scene:
        return _of_equilibrium(result, listed, drives, forces)
    found: dict[str, Array] = {}
    for name in listed:
        names = matching(name, result.names) if has_wildcard(name) else [name]
        found |= {one: Result.__getitem__(result, one) for one in names or [name]}
    return found


def _of_equilibrium(
    result: Result, listed: list[str], drives: Programs | None, forces: Programs | None
) -> dict[str, Array]:
    """Outputs of a static equilibrium by name.

    Raises
    ------
    InputError : there is no such output, or the analysis ends in another state now.
    """
    from sidtool.solver.afterwards import scene_of

    from .analysing import static_equilibrium

    scene = scene_of(result)
    wanted = expanded(listed, scene, result.sids)
    missing = [name for name in wanted if name not in result.names]
    found = {name: result[name] for name in wanted if name in result.names}
    if missing:
        laws = {**result.laws, **(drives or {}), **(forces or {})}
        content = json.loads(result.scene) | {"outputs": {"record": missing}}
        content.pop("events", None)
        again = static_equilibrium(
            validated(content, SceneFile, source="scene of the result"),
            sids=dict(result.sids),
            accept_defects=True,
            drives={n: law for n, law in laws.items() if n in scene.drives},
            forces={n: law for n, law in laws.items() if n in scene.forces},
        ).result()
        if not _same_state(again, result):
            raise InputError(
                "the analysis finds another equilibrium now",
                expected="a result of this version of sidtool",
            )
        found |= {name: Result.__getitem__(again, name) for name in missing}
    return _ordered(wanted, found)


def _same_state(one: Result, other: Result) -> bool:
    return one.positions.shape == other.positions.shape and np.allclose(
        one.positions, other.positions, rtol=1e-6, atol=1e-9
    )
