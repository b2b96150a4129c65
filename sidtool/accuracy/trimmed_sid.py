"""SID with only the shape functions and nodes that a scene needs."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic, WithDiagnostics, without
from sidtool.formats.result import AccuracyReport
from sidtool.formats.scene import BODY_STRESSES, SceneFile
from sidtool.formats.sid_files import read_sid
from sidtool.formats.sid_subset import select_shape_functions

from ..pipeline.scene_models import convert_bodies
from .options import plan_for

#: Accuracy if neither the scene nor the command specifies one.
DEFAULT_ACCURACY = 1e-3


@dataclass(frozen=True)
class TrimmedSid(WithDiagnostics):
    """A reduced SID, and its cost for the scene.

    Attributes
    ----------
    bodies : bodies that have this SID
    numbers : numbers of the retained shape functions in the full SID
    sizes : number of shape functions and nodes of the full SID
    diagnostics : of the search, and of the run of the finest model
    """

    sid: SID
    bodies: tuple[str, ...]
    numbers: tuple[int, ...]
    sizes: tuple[int, int]
    report: AccuracyReport
    diagnostics: tuple[Diagnostic, ...]

    @property
    def errors(self) -> dict[str, float]:
        """Return the errors of outputs by the shape functions that were removed."""
        line = next(x for x in self.report.budget if x.part == "shape functions")
        return {o.name: line.errors[o.name] for o in self.report.outputs}

    def data(self) -> dict[str, Any]:
        """Return the data for JSON; numbers of shape functions are those of the full
        SID.
        """
        modes, nodes = self.sizes
        return {
            "bodies": list(self.bodies),
            "shape_functions": {"kept": list(self.numbers), "of": modes},
            "nodes": {"kept": [node.id for node in self.sid.nodes], "of": nodes},
            "errors": self.errors,
            "diagnostics": [each.as_data() for each in self.diagnostics],
            "accuracy": self.report.model_dump(mode="json"),
        }


def trim_sid(
    path: Path,
    scene: SceneFile,
    folder: Path,
    accuracy: Any = None,
) -> TrimmedSid:
    """Reduce a SID to the shape functions and nodes that a scene needs.

    Parameters
    ----------
    folder : folder of the relative paths of the scene
    accuracy : requested accuracy; default that of the scene, else 1e-3

    Raises
    ------
    InputError : no body of the scene has this SID, or see `plan_for`.
    """
    bodies = tuple(_with_file(scene, path, folder))
    if not bodies:
        raise InputError(
            f"no body of the scene has the SID {path}",
            place="bodies",
            expected=", ".join(_scene_files(scene)) or "a scene with flexible bodies",
        )
    if accuracy is None and scene.accuracy.wanted is None:
        accuracy = DEFAULT_ACCURACY
    sid = read_sid(path)
    scene, model_sids, _ = convert_bodies(scene, folder)
    plan = plan_for(scene, folder, model_sids, accuracy, {}, frames=False)
    assert plan is not None
    kept_numbers: set[int] = set()
    for name in bodies:
        kept_numbers |= set(plan.scene.sid_bodies[name].numbers(sid.nq))
    numbers = tuple(sorted(kept_numbers))
    small = select_shape_functions(sid, [k - 1 for k in numbers])
    used = used_nodes(scene, bodies, sid)
    small = replace(small, nodes=tuple(n for n in small.nodes if n.id in used))
    sizes = sid.nq, len(sid.nodes)
    found = (*plan.search_diagnostics, *plan.reference_diagnostics)
    kept = without(found, plan.scene.diagnostics.ignore)
    return TrimmedSid(small, bodies, numbers, sizes, plan.report, kept)


def used_nodes(scene: SceneFile, bodies: Iterable[str], sid: SID) -> set[str]:
    """Return the ids of nodes that the scene uses; all nodes if it uses a peak stress.

    These are all markers, also unused ones, and node ids in joints, forces, drives and
    outputs.
    """
    content = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    texts = set(_all_texts(content))
    ids: set[str] = set()
    for name in bodies:
        if any(_names_all_nodes(text, name) for text in texts):
            return {node.id for node in sid.nodes}
        ids |= set(scene.sid_bodies[name].markers.values())
        ids |= {
            node.id
            for node in sid.nodes
            if any(_names_node(text, name, node.id) for text in texts)
        }
    return ids


def _names_node(text: str, body: str, node: str) -> bool:
    start = f"{body}.{node}"
    return text == start or text.startswith(f"{start}.")


def _names_all_nodes(text: str, body: str) -> bool:
    """Return whether an output refers to all nodes of a body, or a pattern may match
    some.
    """
    owner, _, rest = text.partition(".")
    return text in [f"{body}.{quantity}" for quantity in BODY_STRESSES] or (
        "*" in owner + rest.partition(".")[0] and "." in rest
    )


def _all_texts(value: Any) -> Iterable[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for key, part in value.items():
            yield str(key)
            yield from _all_texts(part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _all_texts(part)


def _scene_files(scene: SceneFile) -> list[str]:
    return list(dict.fromkeys(body.sid for body in scene.sid_bodies.values()))


def _with_file(scene: SceneFile, path: Path, folder: Path) -> Iterable[str]:
    for name, body in scene.sid_bodies.items():
        try:
            if (folder / body.sid).samefile(path):
                yield name
        except OSError:
            continue
