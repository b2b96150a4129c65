"""Evaluate outputs of a result that its run did not record."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import report_stage
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics.record import warn_of_each
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, expand_names, has_wildcard, matching_names
from sidtool.formats.toml.reading import validate_data

if TYPE_CHECKING:
    from sidtool.solver.simulation.replay import Replay

Programs = Mapping[str, Any]


def outputs(
    result: Result,
    names: str | Iterable[str],
    *,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> dict[str, Array]:
    """Return outputs of a result by name, (nt,) each, in the given order, without a new
    run.

    Recorded outputs are taken from the result; all others are evaluated at its states.

    Parameters
    ----------
    names : as in `outputs.record` of a scene, `*` for any letters: "rod.tip.vx",
        "rod.q*"; several also as one text with commas
    drives, forces : callables of the run, as for `simulate`; only those of type `Law`
        are needed, because results store functions of time as samples

    Raises
    ------
    InputError : there is no such output, the states do not determine it (an integral
        over the run, or a missing `Law`), or the result does not hold its scene.
    """
    texts = names.split(",") if isinstance(names, str) else names
    listed = [text.strip() for text in texts if text.strip()]
    recorded = {name: result[name] for name in listed if name in result.names}
    if len(recorded) == len(listed):
        return recorded
    if "analysis" in result.settings:
        return _analysis_outputs(result, listed, drives, forces)
    from sidtool.solver.simulation.replay import replay, scene_of

    wanted = expand_names(listed, scene_of(result), result.sids)
    missing = [name for name in wanted if name not in result.names]
    columns = {name: result[name] for name in wanted if name in result.names}
    if missing:
        report_stage("evaluating outputs")
        columns |= replay(result, missing, drives, forces).outputs()
    ordered = _order_outputs(wanted, columns)
    for name in listed:
        if not (has_wildcard(name) and ordered) and not matching_names(name, ordered):
            raise InputError(
                f"the run does not determine {name}",
                expected="an output of what deforms: a body that was rigid has no "
                "elastic coordinates and no stress",
            )
    return ordered


def outputs_at(result: Result, names: Iterable[str], times: Array) -> dict[str, Array]:
    """Return outputs (nt,) at any times of a run, from its interpolated states.

    Outputs that states do not determine, and all outputs of an analysis, are
    interpolated linearly between the recorded values.

    Raises
    ------
    InputError : see `outputs`; or such an output was not recorded.
    """
    return interpolated_outputs(result, names, times)[0]


def interpolated_outputs(
    result: Result, names: Iterable[str], times: Array
) -> tuple[dict[str, Array], Replay | None]:
    """Return outputs as `outputs_at` does, and the replay (None for an analysis)."""
    names = list(names)
    if "analysis" in result.settings:
        columns = outputs(result, names)
        return {
            name: np.interp(times, result.t, v) for name, v in columns.items()
        }, None
    from sidtool.solver.output.body_outputs import unavailable_outputs
    from sidtool.solver.simulation.replay import replay, scene_of

    straight = unavailable_outputs(names, scene_of(result), result.laws, between=True)
    straight = {name: why for name, why in straight.items() if name in result.names}
    rest = [name for name in names if name not in straight]
    report_stage("evaluating outputs")
    again = replay(result, rest, between=True)
    columns = again.outputs(times)
    columns |= {n: np.interp(times, result.t, result[n]) for n in straight}
    return _order_outputs(names, columns), again


def with_outputs(result: Result, columns: Mapping[str, Array]) -> Result:
    """Return the result with additional outputs."""
    new = [name for name in columns if name not in result.names]
    values = np.column_stack([result.values, *(columns[name] for name in new)])
    return replace(result, names=(*result.names, *new), values=values)


def _order_outputs(
    names: Iterable[str], columns: Mapping[str, Array]
) -> dict[str, Array]:
    """Return the outputs in the order of the names."""
    places = [
        [name] if name in columns else matching_names(name, columns) for name in names
    ]
    return {name: columns[name] for names in places for name in names}


def _analysis_outputs(
    result: Result, listed: list[str], drives: Programs | None, forces: Programs | None
) -> dict[str, Array]:
    """Return recorded outputs of an analysis, whose states do not determine
    accelerations.

    All outputs of a static equilibrium follow from a repetition of the analysis.
    """
    if result.settings["analysis"] == "static equilibrium" and result.scene:
        return _equilibrium_outputs(result, listed, drives, forces)
    columns: dict[str, Array] = {}
    for name in listed:
        names = matching_names(name, result.names) if has_wildcard(name) else [name]
        columns |= {one: Result.__getitem__(result, one) for one in names or [name]}
    return columns


def _equilibrium_outputs(
    result: Result, listed: list[str], drives: Programs | None, forces: Programs | None
) -> dict[str, Array]:
    """Return outputs of a static equilibrium by name.

    Raises
    ------
    InputError : there is no such output, or the repeated analysis ends in another
        state.
    """
    from sidtool.solver.analyses.static_equilibrium import static_equilibrium
    from sidtool.solver.simulation.replay import scene_of

    from .scene_changes import compiled_scene

    scene = scene_of(result)
    wanted = expand_names(listed, scene, result.sids)
    missing = [name for name in wanted if name not in result.names]
    columns = {name: result[name] for name in wanted if name in result.names}
    if missing:
        laws = {**result.laws, **(drives or {}), **(forces or {})}
        content = json.loads(result.scene) | {"outputs": {"record": missing}}
        content.pop("events", None)
        programs = (
            {n: law for n, law in laws.items() if n in scene.drives},
            {n: law for n, law in laws.items() if n in scene.forces},
        )
        changed = validate_data(content, SceneFile, source="scene of the result")
        with compiled_scene(changed, dict(result.sids), None, True, programs) as system:
            equilibrium = static_equilibrium(system)
        warn_of_each(equilibrium.diagnostics)
        again = equilibrium.result()
        if not _is_same_state(again, result):
            raise InputError(
                "the analysis finds another equilibrium now",
                expected="a result of this version of sidtool",
            )
        columns |= {name: Result.__getitem__(again, name) for name in missing}
    return _order_outputs(wanted, columns)


def _is_same_state(one: Result, other: Result) -> bool:
    return one.positions.shape == other.positions.shape and np.allclose(
        one.positions, other.positions, rtol=1e-6, atol=1e-9
    )
