"""Fields of flexible bodies: their files, colour ranges, peak stresses."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.base.stress import von_mises
from sidtool.formats.diagnostics import diagnose
from sidtool.formats.diagnostics.record import warn_of
from sidtool.formats.field import Field, mismatch_text, read_field
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, SidBody
from sidtool.solver.output.energies import elastic_coordinates
from sidtool.solver.simulation.replay import Replay, replay

from ..field.body_surfaces import BodySurface
from ..pipeline.model_cache import FIELD_ENDING, BodyModel
from .motion import SampledMotion

Given = Mapping[str, Field | str | os.PathLike[str]]

#: Largest number of values for a range; with more, times are skipped evenly.
_MAX_VALUES = 200_000_000
_PREFIXES: tuple[tuple[str, float], ...] = (
    ("G", 1e9),
    ("M", 1e6),
    ("k", 1e3),
    ("", 1.0),
    ("m", 1e-3),
    ("\N{MICRO SIGN}", 1e-6),
    ("n", 1e-9),
)
#: Deformations below this fraction of the size of the mechanism are zero.
_ROUNDING = 1e-12
#: Number of intermediate times between output times; stresses per batch.
_INTERMEDIATE_TIMES, _STRESSES_PER_BATCH = 4, 20_000_000


def find_fields(
    scene: SceneFile, sids: Mapping[str, SID], given: Given, folders: list[Path]
) -> dict[str, Field]:
    """Return fields by body; warn of files that were found but do not fit (N822).

    given : fields, or files with one, by body
    folders : folders of relative paths of the scene

    Raises
    ------
    InputError : a given field is not that of its SID, or there is no such body.
    """
    fields: dict[str, Field] = {}
    for body, content in given.items():
        if body not in sids:
            raise InputError(
                f"there is no flexible body {body!r}",
                place="--field",
                expected=f"BODY=FILE with a BODY out of {', '.join(sids) or 'none'}",
            )
        field = content if isinstance(content, Field) else read_field(content)
        wrong = mismatch_text(field, sids[body])
        if wrong:
            raise InputError(
                f"the field {wrong}",
                place=f"--field {body}",
                expected="the field that was written with this SID",
            )
        fields[body] = with_selected_shapes(field, scene, body)
    for body, path, read in _field_files(scene, folders):
        if body in fields or body not in sids:
            continue
        field = read()
        wrong = mismatch_text(field, sids[body])
        if wrong:
            warn_of(diagnose("N822", body, file=path.name, reason=wrong))
        else:
            fields[body] = with_selected_shapes(field, scene, body)
    return fields


def with_selected_shapes(field: Field, scene: SceneFile, body: str) -> Field:
    """Return the field of the shape functions that the scene retains."""
    described = scene.bodies[body]
    if not isinstance(described, SidBody) or described.shape_functions is None:
        return field
    rows = [number - 1 for number in described.numbers(field.nq)]
    stress = None if field.stress is None else field.stress[..., rows]
    return replace(field, shapes=field.shapes[..., rows], stress=stress)


def _field_files(
    scene: SceneFile, folders: list[Path]
) -> Iterator[tuple[str, Path, Callable[[], Field]]]:
    """Return files NAME.field.h5 beside the SIDs of a scene, and models of its
    bodies.
    """
    for name, body in scene.sid_bodies.items():
        for folder in folders:
            path = (folder / body.sid).with_suffix(FIELD_ENDING)
            if path.is_file():
                yield name, path, partial(read_field, path)
                break
            if body.model and (folder / body.model).is_file():
                source = BodyModel(folder / body.model, folder)
                yield name, source.path, source.field
                break


@dataclass(frozen=True)
class ColourRange:
    """Range of a colour scale: 0 to `most` [SI], which is most / per in the unit."""

    title: str
    unit: str
    most: float
    per: float


def colour_ranges(
    motion: SampledMotion, bodies: Sequence[BodySurface], colour: str
) -> dict[str, ColourRange]:
    """Return the ranges of elastic displacement and von Mises stress of all bodies.

    Raises
    ------
    InputError : the quantity `colour` is requested, and no body has it.
    """
    ranges = {}
    moved = max((_largest_values(motion, body, False) for body in bodies), default=0.0)
    if moved > 0:
        unit, per = _prefixed_unit(moved, "m")
        ranges["displacement"] = ColourRange("elastic displacement", unit, moved, per)
    stressed = [body for body in bodies if body.stress is not None and body.nq]
    stress = max(
        (_largest_values(motion, body, True) for body in stressed), default=0.0
    )
    if stress > 0:
        unit, per = _prefixed_unit(stress, "Pa")
        ranges["stress"] = ColourRange("von Mises stress", unit, stress, per)
    if colour and colour not in ranges:
        raise InputError(
            f"there is no {colour} to colour by",
            place="--colour",
            expected=" or ".join(ranges) or "a flexible body",
        )
    return ranges


def _largest_values(motion: SampledMotion, body: BodySurface, stress: bool) -> float:
    if not body.nq:
        return 0.0
    q = motion.elastic[body.name]
    field = body.stress if stress else body.shapes
    assert field is not None
    rows = np.arange(len(q))
    wanted = max(1, _MAX_VALUES // field.size)
    if len(rows) > wanted:
        extremes = np.concatenate([q.argmax(axis=0), q.argmin(axis=0)])
        even = np.round(np.linspace(0, len(q) - 1, wanted)).astype(int)
        rows = np.unique(np.concatenate([even, extremes]))
    by_shape = np.ascontiguousarray(field.reshape(-1, field.shape[-1]))
    best = 0.0
    for k in rows:
        values = (by_shape @ q[k]).reshape(field.shape[:-1])
        if stress:
            size = von_mises(values + body.initial_stress)
        else:
            size = np.sqrt(np.einsum("pa,pa->p", values, values))
        best = max(best, float(size.max(initial=0.0)))
    return best


def _prefixed_unit(size: float, unit: str) -> tuple[str, float]:
    """Return a unit with a prefix that suits a size."""
    for prefix, per in _PREFIXES:
        if size >= per:
            return prefix + unit, per
    return unit, 1.0


def fitting_scale(motion: SampledMotion, bodies: Sequence[BodySurface]) -> float:
    """Return a round magnification that makes deformations visible.

    The largest becomes about a thirtieth of the mechanism. Rounding is not magnified.
    """
    moved = max((_largest_values(motion, body, False) for body in bodies), default=0.0)
    if moved <= _ROUNDING * motion.size:
        return 1.0
    wanted = motion.size / 30 / moved
    if wanted < 2:
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1, 2, 5) if step * power <= wanted))


@dataclass(frozen=True, eq=False)
class StressPeak:
    """stress [Pa] at a point of a body, (3,) in its undeformed body frame [m], at a
    time [s]; components xx, yy, zz, xy, yz, xz in body axes."""

    body: str
    stress: float
    place: Array
    time: float
    components: Array


def peak_stresses(
    result: Result, fields: Given | None = None, folder: Path | None = None
) -> dict[str, StressPeak]:
    """Return the peak stress of every flexible body whose full field has stresses.

    All points of the field are examined, at output times and four times between each
    two of them.

    Raises
    ------
    InputError : no field with stresses is known.
    """
    again = replay(result)
    folders = [folder or Path("."), Path(".")]
    known = find_fields(again.system.scene, result.sids, fields or {}, folders)
    peaks = _peaks_of_bodies(again, known)
    if not peaks:
        raise InputError(
            "there is no full field with stresses",
            place="--field",
            expected="BODY=FILE from `sidtool convert --field`, of solid elements",
        )
    return peaks


def _peaks_of_bodies(
    again: Replay, known: Mapping[str, Field]
) -> dict[str, StressPeak]:
    stressed = {name: f for name, f in known.items() if f.stress is not None}
    if not stressed:
        return {}
    t = again.t
    if len(t) > 1:
        shares = np.arange(_INTERMEDIATE_TIMES + 1) / (_INTERMEDIATE_TIMES + 1)
        inner = (t[:-1, None] + np.diff(t)[:, None] * shares).ravel()
        t = np.append(inner, t[-1])
    samples = again.samples(t)
    peaks = {}
    for b, data in enumerate(again.system.bodies):
        field = stressed.get(data.name)
        if field is not None and data.sid.nq:
            q, _ = elastic_coordinates(again.system, samples, b)
            peaks[data.name] = _peak_of_body(data.name, field, t, q)
    return peaks


def _peak_of_body(name: str, field: Field, t: Array, q: Array) -> StressPeak:
    assert field.stress is not None
    step = max(1, _STRESSES_PER_BATCH // field.stress[..., 0].size)
    best = (-1.0, 0, 0)
    for first in range(0, len(t), step):
        part = np.moveaxis(field.stress @ q[first : first + step].T, 2, 0)
        mises = von_mises(part + field.initial_stress)
        row, point = map(int, np.unravel_index(mises.argmax(), mises.shape))
        best = max(best, (float(mises[row, point]), first + row, point))
    stress, k, i = best
    components = field.initial_stress[i] + field.stress[i] @ q[k]
    return StressPeak(name, stress, field.positions[i], float(t[k]), components)
