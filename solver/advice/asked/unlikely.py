"""Questions about friction and controllers that are hardly meant as they are said."""

from __future__ import annotations

from collections.abc import Iterator

from sidtool.formats.scene import Actuator, Pid, SceneFile, SpringDamper

from ...system.scene import System
from .body_extents import mechanism_extent

#: No pair of materials rubs as much.
_ROUGHEST = 3.0
#: A pin thicker than this many times the mechanism.
_THICKEST = 1.0
#: Outputs that are lengths, and how many times the mechanism they hardly are.
_PLACES, _FAR = (".displacement", ".length", ".x", ".y", ".z"), 50.0


def unlikely(system: System) -> Iterator[str]:
    """One sentence each."""
    size = mechanism_extent(system)
    for name, joint in system.scene.joints.items():
        friction = getattr(joint, "friction", None)
        if friction is None:
            continue
        largest = max(friction.coefficient, friction.static or 0.0)
        if largest > _ROUGHEST:
            yield (
                f"the friction of {name} has a coefficient of {largest:g}, more than "
                "any pair of materials: is it in per cent?"
            )
        if (friction.radius or 0.0) > _THICKEST * size:
            yield (
                f"the pin of {name} has a radius of {friction.radius:g} m, in a "
                f"mechanism of {size:.3g} m: is it in mm?"
            )
    yield from _gains(system.scene)
    yield from _lengths(system, size)


def controllers(scene: SceneFile) -> Iterator[tuple[str, Pid]]:
    """Forces and drives that a controller decides, by their names."""
    for name, owner in (*scene.forces.items(), *scene.drives.items()):
        law = getattr(owner, "function", None)
        if isinstance(law, Pid):
            yield name, law


def _lengths(system: System, size: float) -> Iterator[str]:
    """What is to be reached far beyond the mechanism."""
    found = []
    for name, law in controllers(system.scene):
        if law.measured.endswith(_PLACES) and isinstance(law.reference, float):
            found.append((f"the reference of {name}", law.reference))
    for name, force in system.scene.forces.items():
        if isinstance(force, SpringDamper) and force.markers is not None:
            found.append((f"the rest length of {name}", force.rest))
    for what, length in found:
        if abs(length) > _FAR * size > 0.0:
            yield (
                f"{what} is {length:g} m, and the mechanism is {size:.3g} m "
                "large: is it in mm?"
            )


def _gains(scene: SceneFile) -> Iterator[str]:
    """Controllers that drive their own joint away from what they are to hold."""
    for name, force in scene.forces.items():
        law = getattr(force, "function", None)
        if not isinstance(force, Actuator) or not isinstance(law, Pid):
            continue
        if force.joint is None or law.measured.partition(".")[0] != force.joint:
            continue
        for key in ("p", "d"):
            gain = getattr(law, key)
            if gain < 0.0:
                yield (
                    f"{name} drives {law.measured} away from its reference: its gain "
                    f"{key} is {gain:g} and it acts on what it measures; is its sign "
                    "meant?"
                )
