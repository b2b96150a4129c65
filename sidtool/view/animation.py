"""Animation of a result: a page for a browser, or a film."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from sidtool import __version__
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.file_names import check_ending, kind_by_ending
from sidtool.formats.result import Result
from sidtool.formats.scene import expand_names
from sidtool.formats.storage.atomic import atomic_path
from sidtool.solver.simulation.replay import scene_of

from ..field.body_surfaces import BodySurface, body_surfaces
from ..pipeline.extra_outputs import outputs_at
from ..plot.curves import output_errors
from .body_fields import Given, find_fields, fitting_scale
from .html_player import player_page
from .motion import SampledMotion, sample_motion

#: Number of outputs drawn next to the motion: default and largest.
_DEFAULT_OUTPUTS, _MAX_OUTPUTS = 12, 40


@dataclass(frozen=True, eq=False)
class AnimationData:
    """Bodies and motion of a result.

    Attributes
    ----------
    notes : notes on omissions, and on the source of drawn bodies
    """

    motion: SampledMotion
    bodies: list[BodySurface]
    notes: list[str]


def animation_data(
    result: Result, fields: Given | None = None, folder: Path | None = None
) -> AnimationData:
    """Return the bodies and the motion of a result.

    Parameters
    ----------
    fields : full fields of flexible bodies, or their files, by body
    folder : folder of the files of the scene, searched before the working folder

    Raises
    ------
    InputError : the result does not hold its scene, or a field is not that of its SID.
    """
    folders = [folder or Path("."), Path(".")]
    motion = sample_motion(result, folders=folders)
    known = find_fields(motion.scene, result.sids, fields or {}, folders)
    bodies = body_surfaces(
        motion.scene, motion.system.bodies, known, motion.size, folders
    )
    notes = [*motion.notes]
    notes += [f"{body.name} is drawn from {body.source}" for body in bodies if body.nq]
    return AnimationData(motion, bodies, notes)


def animate(
    result: Result,
    path: str | Path,
    *,
    fields: Given | None = None,
    outputs: str | Iterable[str] | None = None,
    colour: str = "",
    scale: float | None = None,
    folder: Path | None = None,
) -> list[str]:
    """Write the motion of a result as a page (.html) or a film (.gif, .mp4).

    Parameters
    ----------
    outputs : outputs drawn next to the motion of a page; default the first recorded
        ones
    colour : "" for a colour by body, "displacement" or "stress"
    scale : magnification of deformations; by default one that makes them visible
    fields, folder : see `animation_data`

    Returns
    -------
    notes on the source of drawn bodies and on omissions

    Raises
    ------
    InputError : a wrong ending, output, field or colour; something is not installed.
    """
    path = Path(path)
    check_ending(path, kind_by_ending(path, "page", "film"))
    data = animation_data(result, fields, folder)
    scale = fitting_scale(data.motion, data.bodies) if scale is None else scale
    notes = list(data.notes)
    if scale != 1:
        notes.insert(0, f"deformations are drawn {scale:g} times as large")
    if path.suffix.lower() != ".html":
        from .film import write_film

        return [*notes, *write_film(path, data.motion, data.bodies, colour, scale)]
    columns, more = _output_columns(result, data.motion.t, outputs)
    text = player_page(
        data.motion,
        data.bodies,
        columns,
        errors=output_errors(result),
        title=result.title,
        colour=colour,
        scale=scale,
        notes=data.notes,
        generator=f"sidtool {__version__}",
    )
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return [*notes, *more]


def _output_columns(
    result: Result, t: Array, names: str | Iterable[str] | None
) -> tuple[dict[str, Array], list[str]]:
    """Return outputs at the times of the pictures."""
    notes = []
    if names is None:
        wanted = list(result.names)
        if len(wanted) > _DEFAULT_OUTPUTS:
            notes = [
                f"the first {_DEFAULT_OUTPUTS} of {len(wanted)} outputs are drawn "
                "beside it"
            ]
        wanted = wanted[:_DEFAULT_OUTPUTS]
    else:
        listed = names.split(",") if isinstance(names, str) else list(names)
        listed = [name.strip() for name in listed if name.strip()]
        wanted = list(expand_names(listed, scene_of(result), result.sids))
        if len(wanted) > _MAX_OUTPUTS:
            raise InputError(
                f"{len(wanted)} outputs are more than a page shows",
                place="--outputs",
                expected=f"at most {_MAX_OUTPUTS}",
            )
    if not wanted:
        return {}, notes
    return outputs_at(result, wanted, t), notes
