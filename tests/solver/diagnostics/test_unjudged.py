"""Bodies whose compliance is not known, and free ones that lack shape functions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.solver import simulate
from tests.solver.scenes import compiled, scene
from tests.steel_bars import steel_bar

from .test_poor_shapes import BENDING, STRETCHING, share, stout

RELIEF = {"inertia_relief": False}


def told(
    sid: SID, force: list[float], numbers: list[int] | None = None, held: bool = True
) -> list[Diagnostic]:
    """What a run says of the shapes of a bar, clamped or free, pulled at its tip."""
    body: dict[str, Any] = {"sid": "-", "markers": {"a": 1, "tip": 2}}
    body["damping"] = {"type": "modal", "ratio": 1.0}
    if numbers is not None:
        body["shape_functions"] = numbers
    wall = {"wall": {"type": "fixed", "markers": ["ground", "rod.a"]}}
    pull = {"type": "force", "marker": "rod.tip", "force": force}
    described = scene(
        {"rod": body}, wall if held else {}, forces={"pull": pull}, end=1e-4, steps=1,
        dimension="spatial",
    )  # fmt: skip
    found = simulate(compiled(described, rod=sid)).diagnostics
    return [each for each in found if each.code in ("N420", "N422", "N423")]


def unknown_direction(found: list[Diagnostic]) -> str:
    """Direction at the tip of the one diagnostic N423, of which no share is known."""
    (diagnostic,) = found
    assert diagnostic.code == "N423" and diagnostic.subject == "rod"
    assert diagnostic.data["marker"] == "tip" and "missing" not in diagnostic.data
    assert diagnostic.data["joints"] == ("pull",)
    return str(diagnostic.data["direction"])


def older() -> SID:
    """The stout bar as an earlier version, or another program, has it."""
    return replace(stout(), carried=None)


def test_what_rests_on_the_upper_half_of_modes_cannot_be_judged() -> None:
    """Of a pull the second mode of stretching carries 9 %, but nobody knows."""
    found = told(older(), [1e3, 0.0, 0.0], [*BENDING, STRETCHING[1]])
    assert unknown_direction(found) == "along x"
    (known,) = told(stout(), [1e3, 0.0, 0.0], [*BENDING, STRETCHING[1]])
    assert known.code == "N420"
    assert known.data["missing"] == pytest.approx(1.0 - share(2), rel=2e-3)


@pytest.mark.parametrize("bending", [BENDING[:2], BENDING])
def test_modes_that_take_no_part_are_not_counted(bending: list[int]) -> None:
    """One mode of stretching has 8 / pi^2 of the pull, whatever bends beside it: no
    half of it says that 19 % are missing."""
    found = told(older(), [1e3, 0.0, 0.0], [*bending, STRETCHING[0]])
    assert unknown_direction(found) == "along x"
    assert found[0].data["modes"] == "modes of one frequency"


@pytest.mark.parametrize("force", [[0.0, 1e3, 0.0], [0.0, 5e2, -7e2]])
def test_what_the_lowest_modes_carry_needs_no_word(force: list[float]) -> None:
    """The first mode of bending has 97 % of the compliance at the tip."""
    assert told(older(), force) == []
    assert told(older(), force, BENDING) == []


def test_the_first_modes_of_bending_are_missed() -> None:
    """Without them the rest carries 3 %, and rests on its own lowest ones."""
    numbers = [k for k in BENDING if k not in (1, 2)]
    (known,) = told(stout(), [0.0, 1e3, 0.0], numbers)
    assert known.code == "N420" and known.data["directions"] == "along y"
    found = told(older(), [0.0, 1e3, 0.0], numbers[:2])
    assert unknown_direction(found) == "along y"


@pytest.mark.parametrize("turned", [0.0, 0.3, 0.8, 1.5])
def test_modes_of_one_frequency_may_be_any_of_their_plane(turned: float) -> None:
    """Both bend the square bar: what is said does not depend on their directions."""
    sid, c, s = older(), np.cos(turned), np.sin(turned)
    turn = np.eye(sid.nq)
    turn[2:4, 2:4] = [[c, -s], [s, c]]
    nodes = tuple(
        replace(
            node,
            phi=replace(node.phi, m0=node.phi.m0 @ turn),
            psi=replace(node.psi, m0=node.psi.m0 @ turn),
        )
        for node in sid.nodes
    )
    found = told(replace(sid, nodes=nodes), [0.0, 1e3, 0.0], [3, 4])
    assert unknown_direction(found) == "along y"


@pytest.mark.parametrize("force", [[1e3, 0.0, 0.0], [0.0, 1e3, 1e3]])
def test_labels_tell_static_shapes(force: list[float]) -> None:
    """The stretch of an attachment mode is all that there is, in the highest one."""
    reduction = {"method": "attachment", "interfaces": ["tip"], "modes": 1}
    sid = steel_bar(width=0.1, height=0.1, reduction=reduction | RELIEF)
    assert told(replace(sid, carried=None), force) == []
    labels = tuple(f"Eigen Mode {k + 1}" for k in range(sid.nq))
    foreign = replace(sid, carried=None, labels=labels)
    assert bool(told(foreign, force)) == bool(force[0])


def test_files_of_others(tmp_path: Any) -> None:
    write_sid(tmp_path / "rod.SID_FEM", older())
    sid = read_sid(tmp_path / "rod.SID_FEM")
    found = told(sid, [1e3, 0.0, 0.0], [*BENDING, STRETCHING[1]])
    assert unknown_direction(found) == "along x"


# Free bodies -------------------------------------------------------------------------


def floating(method: str, modes: int) -> SID:
    reduction: dict[str, Any] = {"method": method, "modes": modes}
    if method != "modal":
        reduction["interfaces"] = ["tip"]
    return steel_bar(
        width=0.1, height=0.1, frame={"type": "buckens"}, reduction=reduction
    )


PULL = [1e3, 0.0, 0.0]


def test_a_free_part_is_told_what_helps_it() -> None:
    """One marker among the interfaces of Craig-Bampton holds the part there only: its
    modes stand for the answer, as those of the free part do."""
    free = floating("modal", 2)
    for sid, shapes in (
        (free, "attachment or Herting"),
        (replace(free, carried=None), "attachment"),
    ):
        (lacking,) = told(sid, PULL, held=False)
        assert lacking.code == "N420" and lacking.data["missing"] == 1.0
        assert lacking.data["directions"] == "along x"
        assert lacking.data["marker"] == "tip" and lacking.data["shapes"] == shapes
    assert any(
        each.data["directions"] == "along x" and each.data["marker"] == "tip"
        for each in told(floating("craig_bampton", 2), PULL, held=False)
        if each.code == "N420"
    )


@pytest.mark.parametrize("method", ["attachment", "herting"])
def test_and_that_helps(method: str) -> None:
    sid = floating(method, 2)
    assert sid.carried is not None and sid.carried.free
    assert sid.carried.shares["2"][0] == pytest.approx(1.0, abs=1e-6)
    assert told(sid, PULL, held=False) == []


def test_a_held_part_is_told_craig_bampton() -> None:
    held = steel_bar(width=0.1, height=0.1, reduction={"method": "modal", "modes": 2})
    (lacking,) = told(held, PULL)
    assert lacking.data["shapes"] == "attachment or Craig-Bampton"
