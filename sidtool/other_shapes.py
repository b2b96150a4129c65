"""What changes its meaning when a scene is run with another SID of a body."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from sidtool.formats.errors import InputError
from sidtool.formats.kinds_of_motion import kinds_of
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID

#: Elastic coordinates that are told of.
MOST = 3


def other_shapes(
    scene: SceneFile, sids: Mapping[str, SID], former_of: Callable[[str], SID]
) -> Iterator[str]:
    """A sentence for each body whose elastic coordinates name other shapes.

    Compared are the kinds of motion, such as bending in y, of the coordinates that both
    SIDs have. Where the file of the scene cannot be read there is nothing to compare.

    sids : SIDs that replace the files of the bodies with these names
    former_of : gives the SID of a body that the scene names, or raises an InputError
    """
    for name, sid in sids.items():
        body = scene.sid_bodies.get(name)
        if body is None or not body.sid:
            continue
        try:
            former = kinds_of(former_of(name))
        except InputError:
            continue
        pairs = enumerate(zip(kinds_of(sid), former, strict=False), 1)
        changed = [f"q{k} is {a}, was {b}" for k, (a, b) in pairs if a != b]
        if changed:
            more = len(changed) - MOST
            told = changed[:MOST] + ([f"{more} more"] if more > 0 else [])
            yield (
                f"elastic coordinates of {name} name other shapes than those of "
                f"{body.sid}: {', '.join(told)}"
            )
