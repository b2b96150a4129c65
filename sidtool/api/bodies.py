"""Bodies for other programs: `superelement` and `export_body`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_label
from sidtool.formats.base.sid import SID
from sidtool.formats.base.stress import FIRST_PEAK_NODE
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.diagnostics.record import warn_of_each
from sidtool.formats.file_names import check_ending, path_of
from sidtool.formats.model import ModelFile
from sidtool.formats.model.reduction import BuckensFrame

from ..pipeline.files import expect_kind

if TYPE_CHECKING:
    from ..superelement.craig_bampton import Superelement

Source = SID | ModelFile | str | os.PathLike[str]


def superelement(
    source: Source, interfaces: Sequence[str] | None = None, fixed: Sequence[str] = ()
) -> Superelement:
    """Mass, stiffness and damping of a body with six coordinates for each interface.

        element = sidtool.superelement("rod.toml", interfaces=["a", "b"])
        element.mass, element.stiffness, element.frequencies

    Parameters
    ----------
    source : SID or model, or the path of a file with one
    interfaces : markers of a model, or nodes of a SID, in the order of the coordinates;
        default the interfaces of the reduction and the markers of the body frame, or
        all nodes of a SID
    fixed : interfaces that are fixed to the ground; their coordinates are removed

    Raises
    ------
    InputError : the shape functions cannot represent six motions of each interface, or
        a check of the matrices fails; the error names what fails.
    """
    from ..superelement.craig_bampton import superelement_of_sid

    body = _read_body(source)
    sid, nodes, names = body_with_interfaces(body, interfaces)
    element = superelement_of_sid(sid, nodes, names)
    if fixed:
        element = element.with_supports(fixed)
    warn_of_each([*sid.diagnostics, *missing_static_motions(body, nodes, names)])
    return element


def export_body(
    path: str | os.PathLike[str],
    source: Source,
    interfaces: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
) -> Superelement | None:
    """Write a body for another program; the ending determines which.

    Superelements: ``.mat`` (Simscape), ``.op4`` and ``.dmig`` or ``.bdf`` (Nastran),
    ``.dat`` (OpenFAST ExtPtfm). Bodies with a floating frame: ``.fem`` (MBDyn),
    ``.npz`` (Exudyn).

    Parameters
    ----------
    source, interfaces, fixed : as of `sidtool.superelement`

    Returns
    -------
    the superelement in the file, or None for bodies with a floating frame

    Raises
    ------
    InputError : the ending is unknown, or the body does not suit the program.
    """
    from ..superelement.body_files import write_body

    file = path_of(path, "path")
    check_ending(file, "body")
    body = _read_body(source)
    sid, nodes, names = body_with_interfaces(body, interfaces)
    element = write_body(file, sid, nodes, names=names, fixed=fixed)
    warn_of_each(sid.diagnostics)
    if element is not None:
        warn_of_each(missing_static_motions(body, nodes, names))
    return element


def _read_body(source: Source) -> SID | ModelFile:
    """Return the SID or model that is given, or that a file holds."""
    from sidtool.formats.sid_files import read_sid

    if isinstance(source, (SID, ModelFile)):
        return source
    file = path_of(source, "source", "a SID or a sidtool.Model")
    is_sid = expect_kind(file, "model", "sid") == "sid"
    return read_sid(file) if is_sid else ModelFile.load(file)


def body_with_interfaces(
    source: SID | ModelFile, interfaces: Sequence[str] | None
) -> tuple[SID, list[str], dict[str, str]]:
    """Return the SID of a body, node ids of its interfaces, and node id -> name.

    Geometric stiffening and stress of a model are left out: matrices and inertia
    integrals of other programs do not hold them.

    Raises
    ------
    InputError : there is no such marker, or the model cannot be converted.
    """
    if isinstance(source, SID):
        if interfaces is None:
            interfaces = [n.id for n in source.nodes if not _is_peak_node(n.id, source)]
        return source, list(map(str, interfaces)), {}
    return _converted_model(source, interfaces)


def _converted_model(
    model: ModelFile, interfaces: Sequence[str] | None
) -> tuple[SID, list[str], dict[str, str]]:
    from ..pipeline.model_to_sid import sid_from_model

    selected = _default_markers(model) if interfaces is None else list(interfaces)
    unknown = [name for name in selected if name not in model.markers]
    if unknown:
        raise InputError(
            f"there is no marker {unknown[0]!r}",
            place="interfaces",
            expected=f"some of {', '.join(model.markers)}",
        )
    without: dict[str, None] = {"stress": None}
    if model.stiffening is None or not model.stiffening.prestress:
        without["stiffening"] = None
    sid = sid_from_model(model.model_copy(update=without))
    nodes = [str(model.markers[name].node) for name in selected]
    return sid, nodes, dict(zip(nodes, selected, strict=True))


def _default_markers(model: ModelFile) -> list[str]:
    """Return the interfaces of the reduction and the markers that define the frame, or
    all markers, in the order of the model.
    """
    names = set(model.reduction.interface_names)
    if not names:
        return list(model.markers)
    if not isinstance(model.frame, BuckensFrame):
        names |= set(model.frame.marker_names)
    return [name for name in model.markers if name in names]


def _is_peak_node(node_id: str, sid: SID) -> bool:
    """Return whether a conversion added a node where the stress is largest."""
    added = bool(sid.has_peak_nodes) and is_label(node_id)
    return added and int(node_id) >= FIRST_PEAK_NODE


def missing_static_motions(
    source: SID | ModelFile, nodes: Sequence[str], names: Mapping[str, str]
) -> tuple[Diagnostic, ...]:
    """Return N172 if the shape functions are known to lack static interface motions.

    Static motions are exact where the reduction has the displacement and rotation of
    every interface among its shape functions. Of a SID only natural modes are known to
    have none.
    """
    if isinstance(source, SID):
        lacking = [n for n in nodes if all("Eigen Mode" in t for t in source.labels)]
    else:
        static = set(source.reduction.interface_names)
        if not getattr(source.reduction, "rotations", False):
            static.clear()
        if source.frame.clamped_edges:
            static |= set(source.frame.marker_names)
        lacking = [name for node in nodes if (name := names[node]) not in static]
    return (diagnose("N172", interfaces=lacking),) if lacking else ()
