"""A run says when it passes a singular configuration, and how near.

Crank of 1 m and rod of 1 m + d: with the crank upright two motions cross if d is zero.
The piston is then at sqrt(2 d), where sin of the angle between the constraints' normals
is as large.
"""

from __future__ import annotations

import math

import pytest

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.solver import simulate
from sidtool.solver.initial_state import sparse_jacobian
from sidtool.solver.integrators.registry import INTEGRATORS
from tests.codes import with_code
from tests.solver.integrators.test_singular_positions import four_bar, slider_crank
from tests.solver.scenes import compiled, polynomial


def passages(result: Result) -> list[tuple[float, float]]:
    """Times and independences that diagnostics state."""
    found = with_code(result, "N329")
    assert all(each.data["count"] >= len(found) for each in found)
    return [(each.t or 0.0, float(each.data["independence"])) for each in found]


def crank(longer: float, rtol: float = 1e-6, integrator: str = "radau9") -> Result:
    """Turned at 1 rad/s from the level: upright at pi / 2."""
    rod = 1.0 + longer
    speeds = (1.0, -1.0 / rod)
    system = slider_crank(0.0, rod=rod, speeds=speeds, drive=polynomial(0.0, 1.0))
    return simulate(system, integrator=integrator, rtol=rtol)


@pytest.mark.parametrize("integrator", sorted(INTEGRATORS))
@pytest.mark.parametrize("longer", [0.0, 1e-9, 1e-6])
def test_a_dead_point_that_is_passed_or_missed_by_a_hair_is_told(
    longer: float, integrator: str
) -> None:
    result = crank(longer, integrator=integrator)
    (when, near) = passages(result)[0]
    assert when == pytest.approx(0.5 * math.pi, abs=1e-3)
    assert near < max(2e-3, 3.0 * math.sqrt(2.0 * longer))
    assert "guide" in with_code(result, "N329")[0].data["joints"]


@pytest.mark.parametrize("longer", [1e-7, 1e-6, 1e-5])
def test_how_near_it_was_grows_with_the_root_of_what_it_misses(longer: float) -> None:
    near = passages(crank(longer, rtol=1e-9))[0][1]
    assert 0.1 * math.sqrt(2.0 * longer) < near < 2.0 * math.sqrt(2.0 * longer)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("longer", [0.02, 0.5])
def test_a_rod_that_is_clearly_longer_passes_without_a_word(
    longer: float, rtol: float
) -> None:
    assert passages(crank(longer, rtol)) == []


@pytest.mark.parametrize("integrator", ["radau9", "radau5", "generalised_alpha"])
def test_a_change_point_is_told_on_the_way_there_and_back(integrator: str) -> None:
    """The crank is level there: its angle, recorded every 0.02 s, changes its sign."""
    result = simulate(four_bar(), integrator=integrator, rtol=1e-7)
    angle = result["crank.angle"]
    level = [
        float(result.t[k])
        for k in range(len(angle) - 1)
        if (angle[k] < 0.0) != (angle[k + 1] < 0.0)
    ]
    found = passages(result)
    assert len(found) == len(level) == 2
    for (when, near), before in zip(found, level, strict=True):
        assert before - 1e-3 < when < before + 0.021 and near < 1e-3


@pytest.mark.parametrize(
    ("longer", "guides"), [(0.0, 1), (0.0, 3), (1e-6, 3), (1e-4, 3), (0.02, 3)]
)
def test_sparse_matrices_tell_what_dense_ones_tell(
    longer: float, guides: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Further guides depend on the first one wherever the crank is."""
    rod = 1.0 + longer
    speeds = (1.0, -1.0 / rod)
    system = slider_crank(0.0, rod=rod, speeds=speeds, drive=polynomial(0.0, 1.0))
    table = system.scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    for k in range(1, guides):
        table["joints"][f"guide{k}"] = table["joints"]["guide"]
    system = compiled(SceneFile.model_validate(table))
    expected = simulate(system, rtol=1e-6)
    monkeypatch.setattr(sparse_jacobian, "LARGE_SCENE_ROWS", 1)
    found = simulate(system, rtol=1e-6)
    assert len(passages(found)) == len(passages(expected)) == (longer < 1e-3)
    for one, other in zip(passages(found), passages(expected), strict=True):
        assert one == pytest.approx(other, rel=0.2, abs=1e-6)
    names = [
        [each.data["joints"] for each in with_code(r, "N329")]
        for r in (found, expected)
    ]
    assert names[0] == names[1]
