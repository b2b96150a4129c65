"""What constructors take and results give, to checkers of types; see `static_checks`.

Lines that must be refused are marked; `--strict` refuses unused ignores.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import sidtool

plain = sidtool.RigidBody(
    mass=1, inertia=np.eye(3), markers={"p": sidtool.Marker(position=(0.0, 1.0))}
)
formula = sidtool.RigidBody(mass="2*pi", inertia=[1, 2, 3])
drive = sidtool.Drive(joint="j", function={"type": "constant", "value": 3})
spring = sidtool.SpringDamper(markers=["a", "b"], stiffness=1e3, damping=[2.0, 0.1])
model = sidtool.Model.load("rod.toml")
of_sid = sidtool.SidBody(sid=model.convert(), markers={"tip": 2})
of_model = sidtool.SidBody(model=model)
bodies = {"a": plain, "b": formula}
scene = sidtool.Scene(
    dimension="spatial", time={"end": 1.0}, bodies=bodies, forces={"spring": spring}
)
mass: float = formula.mass
markers: tuple[str, str] | None = spring.markers

result = scene.simulate()
column: NDArray[np.float64] = result["a.x"]
names: list[str] = [name.upper() for name in result]
count: int = len(result) + len(result.keys())
known: bool = "a.x" in result
value: float = scene.static_equilibrium()["a.x"]

sidtool.RigidBody(mas=1)  # type: ignore[call-arg]
sidtool.RigidBody(mass=[1])  # type: ignore[arg-type]
sidtool.Scene(dimension="flat")  # type: ignore[arg-type, call-arg]
print(result.course)  # type: ignore[attr-defined]
