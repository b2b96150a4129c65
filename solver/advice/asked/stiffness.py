"""Questions about springs and dampers that are stiffer than anything that is built, or
than a run can follow in a short time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...space import layout as at
from ...system.forces.elements import Element
from ...system.forces.force_laws import Polynomials
from ...system.scene import System
from .body_extents import mechanism_extent

#: Of steel [Pa], and faster than sound in any solid [m/s].
_STEEL, _FASTEST = 2.1e11, 2e4
#: Dampers stop the whole mechanism so many times faster than sound crosses it.
_STOPS = 10.0
#: Vibrations of a spring that a run follows for minutes, and steps for each of them.
_MANY, _STEPS = 1e5, 10.0
#: Measures that are angles.
ANGLES = (at.TWIST, at.TILT, at.LEAN)


def too_stiff(system: System) -> Iterator[str]:
    """One sentence for each spring and damper whose physics shows a slip of units.

    A spring is stiffer than a solid block of steel of the size of the mechanism, and
    would swing the whole mechanism faster than sound crosses it: both.
    """
    size = mechanism_extent(system)
    mass = sum(data.sid.mass for data in system.bodies if data.of_scene)
    for element in system.forces:
        if not element.acts or element.kind == at.COMBINED:
            continue
        turns = element.kind in ANGLES
        block = _STEEL * (size**3 if turns else size)
        inertia = mass * (size**2 if turns else 1.0)
        fastest = 2.0 * np.pi * _FASTEST / size
        spring, damper = linear(element.law.stiffness), linear(element.law.damping)
        unit = " m/rad" if turns else "/m"
        if spring > max(block, inertia * fastest**2) and inertia > 0.0:
            yield (
                f"{element.name} has a stiffness of {spring:.3g} N{unit}, "
                f"{spring / block:.2g} times that of a solid block of steel as large "
                f"as the mechanism ({size:.3g} m): is it in these units?"
            )
        if damper > _STOPS * inertia * fastest and inertia > 0.0:
            yield (
                f"{element.name} has a damping of {damper:.3g} {_rate_unit(element)}, "
                f"which would stop all bodies together ({mass:.3g} kg) within "
                f"{inertia / damper:.1g} s, {damper / inertia / fastest:.2g} times "
                "faster than sound crosses them: is it in these units?"
            )


def too_fast(system: System) -> Iterator[str]:
    """One sentence for each spring whose vibration would make a run long.

    Counted with the mass of all bodies, which is more than the spring moves, and, where
    it is damped, as long as it rings.
    """
    mass = sum(data.sid.mass for data in system.bodies if data.of_scene)
    time = system.scene.time
    for element in system.forces:
        spring = linear(element.law.stiffness)
        if (
            not element.acts
            or element.kind in (*ANGLES, at.COMBINED)
            or min(spring, mass) <= 0.0
        ):
            continue
        omega = np.sqrt(spring / mass)
        periods = omega * (time.end - time.start) / (2.0 * np.pi)
        damping = linear(element.law.damping)
        if damping > 0.0:
            periods = min(periods, np.sqrt(spring * mass) / damping)
        if periods > _MANY:
            yield (
                f"{element.name} ({spring:.3g} N/m) lets {mass:.3g} kg vibrate at "
                f"{omega / (2.0 * np.pi):.3g} Hz or more, {periods:.2g} times in this "
                f"run: where that is excited the run takes {_STEPS * periods:.1g} "
                "steps or more; a joint in the place of the spring, or a damper beside "
                "it, would take few"
            )


def _rate_unit(element: Element) -> str:
    return "N m s/rad" if element.kind in ANGLES else "N s/m"


def linear(curve: Polynomials) -> float:
    """The coefficient of the first power; 0 of tables."""
    whole = len(curve.starts) == 1 and curve.terms.shape[1] > 1
    return float(curve.terms[0, 1]) if whole else 0.0
