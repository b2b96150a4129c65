"""What the user hears of how far a basis is from the full mesh, and its SID keeps.

Both follow from the factors that the reduction made. Where the basis is poor, others
are measured as well, so that what is advised is known to do better.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from sidtool.formats.carried import DIRECTIONS, Carried, Six
from sidtool.formats.carried.compliance import lost_inertia
from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.model.reduction import (
    AttachmentReduction,
    CraigBamptonReduction,
    HertingReduction,
    ReductionSettings,
)

from ..frontends.finite_element_model import FiniteElementModel, MarkerRows
from .basis import ReducedBasis, hertz
from .frames import Frame, clamped_dofs
from .measured import Fidelity, Full, full_mesh, measured, turns
from .methods import REDUCTIONS
from .space import Space

Array = NDArray[np.float64]

#: The error above which other methods are tried.
_POOR = 0.01
#: Errors below this are alike: the fewer shape functions, the better.
_ALIKE = 1e-6
#: Per cents that rounding may be.
_ROUNDING = 1e-4
#: Entries of the loads at markers above which nothing is measured.
_LARGEST = 50_000_000
#: The same for markers that are not among the interfaces.
_LARGEST_BESIDE = 5_000_000
_UNKNOWN: Six = (None,) * 6
_TITLES = {
    "attachment": "attachment",
    "herting": "Herting",
    "craig_bampton": "Craig-Bampton",
}


@dataclass(frozen=True, eq=False)
class Judged:
    """What a basis errs by and what does better.

    Attributes
    ----------
    text : a sentence
    poor : whether compliance at markers, or frequencies that the basis is meant to
        have, err by per cents
    carried : what it has of the compliance at all markers, for its SID
    """

    text: str
    poor: bool = False
    carried: Carried | None = None


def judged(
    body: FiniteElementModel, frame: Frame, basis: ReducedBasis, model: ModelFile
) -> Judged | None:
    """How good a basis is.

    None where nothing can be measured: the method solved no equations, or the markers
    are too many.
    """
    settings, space = model.reduction, basis.space
    if space is None:
        return None
    markers = _loaded(body, frame, settings)
    if 6 * len(markers) * body.ndof > _LARGEST:
        return None
    try:
        full = full_mesh(body, space, markers, settings, len(basis.labels))
        own = measured(body, space, basis, full)
        carried = _carried(body, frame, space, basis, own, settings)
        text = _said(own)
        if own.worst <= _POOR:
            return Judged(text, carried=carried)
        better = _advice(body, frame, space, full, markers, settings, own.worst)
        return Judged(f"{text}; {better}", _is_poor(own, settings), carried)
    except InputError as error:
        return Judged(f"its errors cannot be measured: {error.problem}")
    except np.linalg.LinAlgError:
        return Judged("its errors cannot be measured: rounding hides its mass matrix")


def held_sentence(
    body: FiniteElementModel, frame: Frame, basis: ReducedBasis, model: ModelFile
) -> str | None:
    """What modes of the free body miss where a joint holds the marker of their frame.

    None where they do not, or the frame is clamped or of another kind.
    """
    if basis.space is None or frame.rows is None or model.frame.type != "tangent":
        return None
    stiffness, mass = (
        basis.shapes.T @ (a @ basis.shapes) for a in (body.stiffness, body.mass)
    )
    squares, _ = basis.space.with_constraints(frame.rows).modes(1)
    own = float(hertz(scipy.linalg.eigh(stiffness, mass, eigvals_only=True))[0])
    true = float(hertz(squares)[0])
    if abs(own / true - 1) <= _POOR:
        return None
    marker = model.frame.marker
    return (
        f"its modes are those of the free body, which a frame at {marker} does not "
        f"hold: held at {marker}, as a joint there may hold it, it has its first "
        f"frequency at {own:.5g} Hz instead of {true:.5g} Hz "
        f'({_percent(own / true - 1)}); fix = "{marker}" under [reduction], or '
        f"Craig-Bampton with {marker} among the interfaces, has the modes of the held "
        "body"
    )


def _loaded(
    body: FiniteElementModel,
    frame: Frame,
    settings: ReductionSettings,
    all_markers: bool = False,
) -> list[MarkerRows]:
    """The interfaces, or all markers that can move."""
    held = clamped_dofs(body, frame, settings.fixed_names)
    chosen = settings.interface_names
    if all_markers or not chosen:
        chosen = tuple(m.name for m in body.markers)
    return [
        marker
        for marker in map(body.marker, chosen)
        if not held[marker.displacement.indices].all()
        and marker.name not in settings.fixed_names
    ]


def _carried(
    body: FiniteElementModel,
    frame: Frame,
    space: Space,
    basis: ReducedBasis,
    own: Fidelity,
    settings: ReductionSettings,
) -> Carried:
    """The measured shares, those at the other markers and under its own inertia."""
    rows: dict[str, list[float | None]] = {}
    parts, known = [own], {marker.name for marker in _loaded(body, frame, settings)}
    everywhere = _loaded(body, frame, settings, all_markers=True)
    others = [marker for marker in everywhere if marker.name not in known]
    if 6 * len(others) * body.ndof <= _LARGEST_BESIDE:
        full = full_mesh(body, space, others, settings, 0)
        parts.append(measured(body, space, basis, full))
    for part in parts:
        for name, error in zip(part.names, part.compliances.tolist(), strict=True):
            marker, _, way = name.rpartition(" ")
            row = rows.setdefault(str(body.marker(marker).node), list(_UNKNOWN))
            row[DIRECTIONS.index(way)] = min(max(1.0 - error, 0.0), 1.0)
    free = bool(space.rigid.shape[1])
    lost = () if free else _lost_inertia(body, frame, space, basis)
    return Carried(free, {name: tuple(row) for name, row in rows.items()}, lost)


def _lost_inertia(
    body: FiniteElementModel, frame: Frame, space: Space, basis: ReducedBasis
) -> tuple[float, ...]:
    """See `Carried.lost`."""
    motions = body.rigid_body_modes(frame.origin)
    loads = body.mass @ motions
    stiffness = basis.shapes.T @ (body.stiffness @ basis.shapes)
    felt = basis.shapes.T @ loads
    ways = [0, 1, 5] if body.dimension == 2 else list(range(6))
    full, own = np.zeros(6), np.zeros(6)
    full[ways] = np.einsum("ij,ij->j", loads, space.static(loads))
    own[ways] = np.einsum("ij,ij->j", felt, scipy.linalg.solve(stiffness, felt))
    return lost_inertia(full, own)


def _is_poor(errors: Fidelity, settings: ReductionSettings) -> bool:
    """Whether compliances err, or as many frequencies as modes were asked for.

    The highest frequencies of a basis err always: its last shape functions are those
    that are left over. Without a number of modes the lower half counts.
    """
    count = getattr(settings, "modes", None) or (errors.count + 1) // 2
    meant = np.concatenate([errors.frequencies[:count], errors.compliances])
    return float(np.abs(meant).max(initial=0.0)) > _POOR


def _said(errors: Fidelity) -> str:
    i = int(np.abs(errors.frequencies).argmax())
    text = (
        f"its first {len(errors.frequencies)} frequencies err by "
        f"{_at_most(errors.frequencies[i])} (f{i + 1}, {errors.hertz[i]:.5g} Hz)"
    )
    if not len(errors.names):
        return text
    k = int(np.abs(errors.compliances).argmax())
    return (
        f"{text}, its compliance at the markers by {_percent(errors.compliances[k])} "
        f"({errors.names[k]})"
    )


def _at_most(share: float) -> str:
    text = _percent(share)
    return text if text.startswith("less") else f"at most {text}"


def _percent(share: float) -> str:
    size = 100 * abs(share)
    if size < _ROUNDING:
        return f"less than {_ROUNDING:g} %"
    return f"{size:.0f} %" if size >= 10 else f"{size:.2g} %"


def _advice(
    body: FiniteElementModel,
    frame: Frame,
    space: Space,
    full: Full,
    markers: list[MarkerRows],
    settings: ReductionSettings,
    worst: float,
) -> str:
    """The best of some other methods, measured; `worst` is what the chosen one has.

    Those with fewer shape functions come first, so that the first without an error is
    the best.
    """
    tried = []
    for other in _others(settings, markers, len(full.frequencies)):
        basis = REDUCTIONS[other.method](body, frame, other, space)
        with suppress(np.linalg.LinAlgError):  # shapes that rounding makes dependent
            found = measured(body, space, basis, full)
            if found.worst < worst:
                tried.append((found, other))
            if found.worst <= _ALIKE:
                break
    if not tried:
        return "no other method does better"
    best, other = min(
        tried, key=lambda pair: (max(pair[0].worst, _ALIKE), pair[0].count)
    )
    errors = _percent(np.abs(best.frequencies).max())
    if len(best.names):
        errors += f" and {_percent(np.abs(best.compliances).max())}"
    return (
        f"{_TITLES[other.method]} with {other.modes} modes, {best.count} shape "
        f"functions in all, by {errors}"
    )


def _others(
    settings: ReductionSettings, markers: list[MarkerRows], count: int
) -> Iterator[AttachmentReduction | HertingReduction | CraigBamptonReduction]:
    """Other methods, with modes for as many frequencies as are compared; the same
    method where it has fewer modes."""
    if not markers:
        return
    own = getattr(settings, "modes", 0)
    modes = max(own, count)
    common: dict[str, Any] = {
        "fix": settings.fix,
        "interfaces": tuple(marker.name for marker in markers),
        "rotations": all(turns(marker, settings) for marker in markers),
    }
    if settings.method != "attachment" or own < modes:
        yield AttachmentReduction(method="attachment", modes=modes, **common)
    if settings.method != "herting" or own < modes:
        yield HertingReduction(method="herting", modes=modes, **common)
    if settings.interface_names:
        more = CraigBamptonReduction(method="craig_bampton", modes=2 * modes, **common)
        yield more
