"""A result played: as a page for a browser, or as a film."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from sidtool import __version__
from sidtool.formats.endings import check_ending, kind_by_ending
from sidtool.formats.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.scene import expanded
from sidtool.formats.sid import Array
from sidtool.formats.storage.atomic import atomic_path
from sidtool.solver.afterwards import scene_of

from ..afterwards import outputs_at
from ..plot.courses import errors_of
from .companions import Given, companions
from .drawn_bodies import Drawn, drawn_bodies
from .page import page
from .played import Played, played
from .ranges import fitting_scale

#: Outputs drawn beside the motion unless they are named, and at most.
_SOME, _MOST = 12, 40


@dataclass(frozen=True, eq=False)
class Shown:
    """What is to be seen of a result.

    told : sentences on what was left out, or what bodies are drawn from
    """

    motion: Played
    bodies: list[Drawn]
    told: list[str]


def shown(
    result: Result, fields: Given | None = None, folder: Path | None = None
) -> Shown:
    """Bodies and motion of a result.

    Parameters
    ----------
    fields : full fields of flexible bodies, or their files, by body
    folder : where the files of the scene may be, beside the working folder

    Raises
    ------
    InputError : the result does not hold its scene, or a field is not that of its SID.
    """
    folders = [folder or Path("."), Path(".")]
    motion = played(result, folders=folders)
    known, told = companions(motion.scene, result.sids, fields or {}, folders)
    bodies = drawn_bodies(
        motion.scene, motion.system.bodies, known, motion.size, folders
    )
    told = [*motion.told, *told]
    told += [f"{body.name} is drawn from {body.source}" for body in bodies if body.nq]
    return Shown(motion, bodies, told)


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
    outputs : drawn beside the motion of a page; default the first that were recorded
    colour : "" for a colour by body, "displacement" or "stress"
    scale : magnification of deformations; by default one that shows them
    fields, folder : see `shown`

    Returns
    -------
    sentences on what was drawn from what, and what was left out

    Raises
    ------
    InputError : a wrong ending, output, field or colour; something is not installed.
    """
    path = Path(path)
    check_ending(path, kind_by_ending(path, "page", "film"))
    seen = shown(result, fields, folder)
    scale = fitting_scale(seen.motion, seen.bodies) if scale is None else scale
    told = list(seen.told)
    if scale != 1:
        told.insert(0, f"deformations are drawn {scale:g} times as large")
    if path.suffix.lower() != ".html":
        from .film import film

        return [*told, *film(path, seen.motion, seen.bodies, colour, scale)]
    columns, more = _columns(result, seen.motion.t, outputs)
    text = page(
        seen.motion,
        seen.bodies,
        columns,
        errors=errors_of(result),
        title=result.title,
        colour=colour,
        scale=scale,
        told=seen.told,
        generator=f"sidtool {__version__}",
    )
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return [*told, *more]


def _columns(
    result: Result, t: Array, names: str | Iterable[str] | None
) -> tuple[dict[str, Array], list[str]]:
    """Outputs at the times of the pictures."""
    told = []
    if names is None:
        wanted = list(result.names)
        if len(wanted) > _SOME:
            told = [f"the first {_SOME} of {len(wanted)} outputs are drawn beside it"]
        wanted = wanted[:_SOME]
    else:
        listed = names.split(",") if isinstance(names, str) else list(names)
        listed = [name.strip() for name in listed if name.strip()]
        wanted = list(expanded(listed, scene_of(result), result.sids))
        if len(wanted) > _MOST:
            raise InputError(
                f"{len(wanted)} outputs are more than a page shows",
                place="--outputs",
                expected=f"at most {_MOST}",
            )
    if not wanted:
        return {}, told
    return outputs_at(result, wanted, t), told
