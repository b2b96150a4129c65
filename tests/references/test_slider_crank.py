"""The founding example: A. Held, A. Hildebrandt, planar flexible slider-crank.

Reference: independent computation in minimal coordinates (DOP853 at 1e-10 relative)
with the Q4 rod of 150 x 10 elements, five modes, J of first order.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.solver import compile_scene, simulate
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system.system import System
from tests.places import SLIDER_CRANK


def compiled(end: float = 3.0, **sids: object) -> System:
    """With the inertia of the reference, whose moments of inertia are linear in q."""
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    described = scene.model_dump(by_alias=True, exclude_none=True)
    described["time"]["end"] = end
    described["bodies"]["rod"]["quadratic_inertia"] = False
    return compile_scene(SceneFile.model_validate(described), SLIDER_CRANK, sids)


@pytest.fixture(scope="module")
def accurate() -> Result:
    return simulate(compiled(), integrator="radau9", rtol=1e-11)


def error(result: Result, reference: Result, name: str) -> float:
    """Largest error of an output relative to its largest value."""
    difference = result[name] - reference[name][: len(result.t)]
    return float(abs(difference).max() / abs(reference[name]).max())


@pytest.mark.parametrize(
    ("integrator", "rtol"),
    [("radau5", 1e-7), ("radau9", 1e-7), ("radau13", 1e-7)],
)
def test_the_motion_of_the_reference(integrator: str, rtol: float) -> None:
    result = simulate(compiled(1.5), integrator=integrator, rtol=rtol)
    x, q1 = result["piston.x"], result["rod.q1"]
    assert x[100] == pytest.approx(1.0916580040, abs=1e-8)
    assert x[150] == pytest.approx(1.0847993728, abs=1e-8)
    assert q1[150] == pytest.approx(-4.67999958e-4, rel=1e-6)


def test_the_largest_deformation(accurate: Result) -> None:
    assert abs(accurate["rod.q1"]).max() == pytest.approx(9.995e-4, rel=1e-3)


@pytest.mark.parametrize("integrator", sorted(INTEGRATORS))
@pytest.mark.parametrize("rtol", [1e-2, 1e-4])
def test_constraints_do_not_drift(integrator: str, rtol: float) -> None:
    """At loose tolerances: the error of the motion is far larger."""
    result = simulate(compiled(1.0), integrator=integrator, rtol=rtol)
    assert result.drift["position"] < 1e-12
    assert result.drift["velocity"] < 1e-12
    last = result.positions[-1]
    assert np.isfinite(last).all()


@pytest.mark.parametrize(
    ("integrator", "coarse"),
    [("radau5", 1.25e-3), ("trapezoidal", 6.25e-4), ("generalised_alpha", 1e-3)],
)
def test_fixed_steps_converge_with_the_order_of_the_method(
    integrator: str, coarse: float
) -> None:
    """Over a factor of 4 in the step, deformations measured together.

    The order is that of the method once its steps resolve the modes that move. A mode
    that is not resolved converges slower but is small: with steps of a period, Radau
    of order 5 was seen to reduce the error of the fourth mode with order 2 to 4.
    """
    system = compiled(0.6)
    reference = simulate(system, integrator="radau9", rtol=1e-12)
    errors = [
        deformation_error(simulate(system, integrator=integrator, step=h), reference)
        for h in (coarse, coarse / 4)
    ]
    rate = np.log(errors[0] / errors[1]) / np.log(4.0)
    assert rate == pytest.approx(INTEGRATORS[integrator].order, abs=0.2)


def deformation_error(result: Result, reference: Result) -> float:
    """Largest error of any elastic coordinate; modes are mass-normalised."""
    names = [f"rod.q{k}" for k in range(1, 6)]
    return max(float(abs(result[n] - reference[n]).max()) for n in names)


def test_a_sid_from_ascii_or_hdf5_moves_the_same(tmp_path: Path) -> None:
    """To the 12 digits of an ASCII file, and bit for bit from HDF5."""
    sid = read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")
    for name in ("rod.h5", "rod.SID_FEM"):
        write_sid(tmp_path / name, sid)
    direct, from_hdf5, from_ascii = (
        simulate(compiled(1.0, rod=body))
        for body in (sid, *(read_sid(tmp_path / n) for n in ("rod.h5", "rod.SID_FEM")))
    )
    assert np.array_equal(direct.values, from_hdf5.values)
    for k in range(1, 6):
        assert error(from_ascii, direct, f"rod.q{k}") < 1e-9
    assert error(from_ascii, direct, "piston.x") < 1e-9


def test_the_quadratic_term_of_the_inertia_is_small(accurate: Result) -> None:
    """Keeping q.Me.q in J changes q1 by 4e-6 relative and x by less than 1e-10 m."""
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    described = scene.model_dump(by_alias=True, exclude_none=True)
    described["bodies"]["rod"]["quadratic_inertia"] = True
    system = compile_scene(SceneFile.model_validate(described), SLIDER_CRANK)
    result = simulate(system, integrator="radau9", rtol=1e-11)
    assert error(result, accurate, "rod.q1") == pytest.approx(4e-6, rel=0.2)
    assert abs(result["piston.x"] - accurate["piston.x"]).max() < 1e-10
