"""Laws that read lengths, deflections, forces and powers of other forces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.result import Result
from sidtool.solver import Law, compile_scene, simulate

from ..dynamics.joint_scenes import scene

MASS, K, D, REST, WALL = 2.0, 80.0, 3.0, 0.4, 3.0
TABLE = {"deflection": [-1.0, 0.1, 0.2, 1.0], "force": [-40.0, 4.0, 20.0, 90.0]}
SPRINGS: dict[str, dict[str, Any]] = {
    "linear": {"stiffness": K, "damping": D},
    "powers": {"stiffness": [K, 10.0, 300.0], "damping": [D, 0.5]},
    "table": {"table": TABLE, "damping": D},
}


def formula(value: str, **more: Any) -> dict[str, Any]:
    return {"type": "expression", "value": value, **more}


def two_slides(
    forces: dict[str, Any], record: list[str], dimension: str = "planar", **more: Any
) -> Result:
    """Two equal bodies on parallel rails, which no joint connects."""
    plane = dimension == "planar"

    def place(x: float, y: float) -> dict[str, Any]:
        return {"position": [x, y] if plane else [x, y, 0.0]}

    heights = {"a": 0.0, "b": 1.0}
    markers = {name: place(0.0, y) for name, y in heights.items()}
    inertia = 1.0 if plane else [1.0] * 3
    laws = more.pop("laws", {})
    content = scene(
        dimension,
        1.0,
        ground={"markers": {"wall": place(-WALL, 0.0), **markers}},
        bodies={
            n: {"mass": MASS, "inertia": inertia, "initial": place(1.0, y)}
            for n, y in heights.items()
        },
        joints={
            f"rail_{n}": {"type": "prismatic", "markers": [f"ground.{n}", n]}
            for n in heights
        },
        forces=forces,
        outputs={"record": record},
        **more,
    )
    system = compile_scene(content, forces=laws)
    return simulate(system, rtol=1e-9)


def spring(kind: str = "linear", where: str = "markers") -> dict[str, Any]:
    """From a wall behind the rail, or on the coordinate of that."""
    places: dict[str, Any] = {"markers": ["ground.wall", "a"], "rest": REST + WALL}
    if where == "joint":
        places = {"joint": "rail_a", "rest": REST}
    return {"type": "spring_damper", **places, **SPRINGS[kind]}


def push(function: dict[str, Any], body: str = "b") -> dict[str, Any]:
    return {"type": "actuator", "joint": f"rail_{body}", "function": function}


@pytest.mark.parametrize("kind", SPRINGS)
@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("where", ["markers", "joint"])
def test_a_body_pushed_by_the_force_of_another_moves_like_it(
    kind: str, dimension: str, where: str
) -> None:
    forces = {"spring": spring(kind, where), "copy": push(formula("spring.force"))}
    result = two_slides(forces, ["a.x", "b.x", "spring.force", "copy.force"], dimension)
    assert result["b.x"] == pytest.approx(result["a.x"], abs=1e-7)
    assert result["copy.force"] == pytest.approx(result["spring.force"], abs=1e-12)
    assert np.ptp(result["a.x"]) > 0.5


@pytest.mark.parametrize("kind", SPRINGS)
def test_newtons_matrix_holds_the_slopes_of_the_force(kind: str) -> None:
    """A copy of the spring's force on its own body is a second spring, to Newton's
    method as well: nothing that it counts differs."""
    function = formula("spring.force")
    copied = {"spring": spring(kind, "joint"), "copy": push(function, "a")}
    doubled = {name: spring(kind, "joint") for name in ("spring", "other")}
    one, two = (two_slides(forces, ["a.x"]) for forces in (copied, doubled))
    assert one["a.x"] == pytest.approx(two["a.x"], abs=1e-9)
    for counter in ("newton_iterations", "steps"):
        assert one.counters[counter] == two.counters[counter]


def test_length_deflection_and_rate_are_read() -> None:
    """The law of the spring, written out."""
    for position in ("spring.deflection", f"(spring.length - {REST + WALL})"):
        text = f"-{K}*{position} - {D}*spring.rate"
        forces = {"spring": spring(), "copy": push(formula(text))}
        result = two_slides(forces, ["a.x", "b.x"])
        assert result["b.x"] == pytest.approx(result["a.x"], abs=1e-7)
    control = {"type": "pid", "measured": "spring.deflection", "p": K, "d": D}
    forces = {"spring": spring(), "copy": push(control)}
    result = two_slides(forces, ["a.x", "b.x"])
    assert result["b.x"] == pytest.approx(result["a.x"], abs=1e-7)


def test_powers_add_up_to_energies() -> None:
    """What a law integrates of the powers of a damper and of a motor are the energies
    that the whole scene lost and was given."""
    meter = {
        "lost": {"initial": 0.0, "rate": "-damper.power"},
        "given": {"initial": 0.0, "rate": "motor.power"},
    }
    forces = {
        "damper": {"type": "spring_damper", "joint": "rail_a", "damping": D},
        "motor": push({"type": "harmonic", "amplitude": 5.0, "frequency": 1.0}, "a"),
        "meter": push(formula("0", states=meter)),
    }
    states = ["meter.state.lost", "meter.state.given"]
    energies = ["energy.dissipated", "energy.supplied"]
    result = two_slides(forces, [*states, *energies])
    for state, energy in zip(states, energies, strict=True):
        assert result[state] == pytest.approx(result[energy], abs=1e-7)
        assert np.abs(result[state]).max() > 0.1


def test_the_force_of_an_actuator_with_a_law_is_read() -> None:
    """Also one that keeps states, and one with samples."""
    lag = {"lag": {"initial": 0.0, "rate": "(-20*rail_a.displacement - lag)/0.1"}}
    held = formula("-20*rail_a.displacement", sample_time=0.1)
    for law in (formula("2*lag", states=lag), held):
        forces = {"motor": push(law, "a"), "copy": push(formula("motor.force"))}
        result = two_slides(forces, ["a.x", "b.x"])
        assert result["b.x"] == pytest.approx(result["a.x"], abs=1e-7)
        assert np.ptp(result["a.x"]) > 0.5


def test_a_python_law_reads_a_force() -> None:
    law = Law(lambda t, y: y[0], reads=["spring.force"])
    forces = {"spring": spring(), "copy": push({"type": "callable"})}
    result = two_slides(forces, ["a.x", "b.x"], laws={"copy": law})
    assert result["b.x"] == pytest.approx(result["a.x"], abs=1e-7)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("motor.force", "depends on itself"),
        ("load.power", "it is a force"),
        ("rail_a.force", "it is a force"),
        ("spring.torque", "it is a force"),
        ("given.force", "a program gives"),
    ],
)
def test_what_a_law_cannot_read_of_forces_is_refused(text: str, found: str) -> None:
    forces = {
        "spring": spring(),
        "motor": push(formula(text)),
        "given": push({"type": "callable"}),
        "load": {"type": "force", "marker": "a", "force": [1.0, 0.0]},
    }
    with pytest.raises(InputError, match=found):
        two_slides(forces, [], laws={"given": lambda t: 1.0})


def test_laws_that_read_each_other_are_refused() -> None:
    forces = {"one": push(formula("two.force")), "two": push(formula("-one.force"))}
    with pytest.raises(InputError, match="depends on itself"):
        two_slides(forces, [])
