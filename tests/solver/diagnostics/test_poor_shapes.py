"""Shape functions that carry a part only of what loads do are told, by their share.

References: the compliance of a clamped bar by its modes, 8 / (pi (2 k - 1))^2 of
L / (E A) by the k-th of stretching, and dense algebra on the full mesh.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, parse_compliance_shares
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.model import ModelFile
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import simulate
from tests.codes import with_code
from tests.sidtool.models import rod_data
from tests.solver.scenes import compiled, scene
from tests.steel_bars import steel_bar

#: Numbers of the shape functions of `stout` that bend, and that stretch.
BENDING, STRETCHING = [1, 2, 3, 4, 7, 8, 10, 11], [6, 13]
#: Numbers of the shape functions of `afloat` that stretch it: sin (2 k - 1) pi x / L.
FREE_STRETCHING = [6, 18]
#: The frame of a free body at its end.
AT_END = {"type": "tangent", "marker": "root"}


@cache
def stout(**reduction: Any) -> SID:
    chosen = {"method": "modal", "modes": 14, **reduction}
    return steel_bar(width=0.1, height=0.1, elements=16, reduction=chosen)


def missing_compliance(
    sid: SID, force: list[float], numbers: list[int] | None = None
) -> list[Diagnostic]:
    """Of a clamped bar under a force at its tip, with some shape functions."""
    body: dict[str, Any] = {"sid": "-", "markers": {"a": 1, "tip": 2}}
    body["damping"] = {"type": "modal", "ratio": 1.0}
    if numbers is not None:
        body["shape_functions"] = numbers
    joints = {"wall": {"type": "fixed", "markers": ["ground", "rod.a"]}}
    pull = {"type": "force", "marker": "rod.tip", "force": force}
    described = scene(
        {"rod": body}, joints, forces={"pull": pull}, end=1e-4, steps=1,
        dimension="spatial",
    )  # fmt: skip
    result = simulate(compiled(described, rod=sid))
    assert not with_code(result, "N423")
    return with_code(result, "N420")


def share(k: int) -> float:
    """Of L / (E A), by the k-th mode of stretching."""
    return 8.0 / (np.pi * (2 * k - 1)) ** 2


def test_a_poor_axial_shape_beside_bending_modes_is_told() -> None:
    """The second mode of stretching alone carries 9 % of the pull at the tip."""
    (found,) = missing_compliance(stout(), [1e3, 0.0, 0.0], [*BENDING, STRETCHING[1]])
    assert found.subject == "rod"
    assert 1.0 - found.data["missing"] == pytest.approx(share(2), rel=0.02)
    assert found.data["directions"] == "along x" and found.data["marker"] == "tip"
    assert found.data["joints"] == ("pull",)
    assert found.data["shapes"] == "attachment or Craig-Bampton"


def test_what_the_first_axial_mode_lacks_is_small_beside_bending() -> None:
    """81 % of a stretch that is a four-hundredth of the bending that a load causes.

    A load that only stretches causes no bending: its displacement is 19 % too small.
    """
    known = stout().carried
    assert known is not None
    both = share(1) + share(2)
    assert known.shares["2"][0] == pytest.approx(both, rel=3e-3)
    first = [*BENDING, STRETCHING[0]]
    assert missing_compliance(stout(), [1e3, 1e3, 0.0], first) == []
    (found,) = missing_compliance(stout(), [1e3, 0.0, 0.0], first)
    assert 1.0 - found.data["missing"] == pytest.approx(share(1), rel=0.02)
    assert missing_compliance(stout(), [1e3, 0.0, 0.0]) == []


def test_only_what_is_loaded_is_told() -> None:
    """The first modes of bending are left out, which have 97 % of it."""
    numbers = [k for k in BENDING if k not in (1, 2)]
    along_x = missing_compliance(stout(), [1e3, 0.0, 0.0], [*numbers, *STRETCHING])
    assert along_x == []
    (across,) = missing_compliance(stout(), [0.0, 0.0, 1e3], [*numbers, *STRETCHING])
    assert across.data["directions"] == "along z" and across.data["marker"] == "tip"
    (both,) = missing_compliance(stout(), [0.0, 7e2, 7e2], [*numbers, *STRETCHING])
    assert both.data["directions"] == "along y and along z"


def test_attachment_shapes_carry_all() -> None:
    attached = steel_bar(
        width=0.1,
        height=0.1,
        reduction={"method": "attachment", "interfaces": ["tip"], "modes": 2},
    )
    for force in ([1e3, 0.0, 0.0], [0.0, 1e3, 1e3]):
        assert missing_compliance(attached, force) == []


@pytest.mark.parametrize("suffix", [".SID_FEM", ".h5"])
def test_files_carry_it(tmp_path: Any, suffix: str) -> None:
    path = tmp_path / f"rod{suffix}"
    write_sid(path, stout())
    (found,) = missing_compliance(
        read_sid(path), [1e3, 0.0, 0.0], [*BENDING, STRETCHING[1]]
    )
    assert found.data["directions"] == "along x" and found.data["marker"] == "tip"


# A free part -----------------------------------------------------------------------

PINS = ("crank_pin", "piston_pin")


def free_part(method: str, modes: int) -> SID:
    """A plate of 1 m x 0.4 m in mean axes, which joints load at both ends."""
    data = rod_data({"type": "q4", "elements": [12, 4], "state": "plane_stress"})
    data["geometry"] = {
        "type": "nurbs",
        "degrees": [1, 1],
        "knots": [[0, 0, 1, 1], [0, 0, 1, 1]],
        "control_points": [[[0, 0], [0, 0.4]], [[1, 0], [1, 0.4]]],
        "thickness": 0.01,
    }
    data["frame"] = {"type": "buckens"}
    data["reduction"] = {"method": method, "modes": modes, "interfaces": PINS}
    return sid_from_model(validate_data(data, ModelFile), lambda _: None)


def swung(sid: SID) -> list[Diagnostic]:
    """Hung at one pin, with a mass at the other."""
    body = {"sid": "-", "markers": {"a": sid.nodes[0].id, "b": sid.nodes[1].id}}
    first, last = (node.position for node in sid.nodes)
    body["initial"] = {"position": [-float(x) for x in first[:2]]}
    load = {
        "mass": 1.0,
        "initial": {"position": [float(x) for x in (last - first)[:2]]},
    }
    joints = {
        "hinge": {"type": "revolute", "markers": ["ground", "rod.a"]},
        "pin": {"type": "revolute", "markers": ["rod.b", "load"]},
    }
    described = scene({"rod": body, "load": load}, joints, end=1e-5, steps=1)
    return with_code(simulate(compiled(described, rod=sid)), "N420")


def test_craig_bampton_of_a_free_part() -> None:
    """Its static shapes are those of a part that is held at its pins."""
    poor = free_part("craig_bampton", 1)
    assert poor.carried is not None and poor.carried.free
    found = swung(poor)
    assert any("hinge" in each.data["joints"] for each in found), found
    assert all(each.data["shapes"] == "attachment or Herting" for each in found)
    assert swung(free_part("attachment", 1)) == []


# Inertia ---------------------------------------------------------------------------


def weighed(
    sid: SID,
    gravity: list[float],
    numbers: list[int] | None = None,
    turning: dict[str, Any] | None = None,
    code: str = "N422",
) -> list[Diagnostic]:
    body: dict[str, Any] = {"sid": "-", "markers": {"a": 1}}
    if numbers:
        body["shape_functions"] = numbers
    joint = {"type": "fixed", "markers": ["ground", "rod.a"]}
    drives = {}
    if turning:
        joint |= {"type": "revolute", "axis": [0.0, 0.0, 1.0]}
        drives = {"motor": {"joint": "wall", "function": turning}}
    described = scene(
        {"rod": body}, {"wall": joint}, gravity=gravity, drives=drives, end=1e-4,
        steps=1, dimension="spatial",
    )  # fmt: skip
    return with_code(simulate(compiled(described, rod=sid)), code)


def test_weight_that_no_shape_bends_under_is_told() -> None:
    """Without the first modes of bending next to nothing is left of its sagging."""
    assert weighed(stout(), [0.0, -9.81, 0.0], BENDING) == []
    lacking = [k for k in BENDING if k not in (1, 2)]
    (found,) = weighed(stout(), [0.0, -9.81, 0.0], lacking)
    assert found.subject == "rod"
    assert found.data["causes"] == "acceleration along y"
    assert 0.9 < found.data["missing"] < 1.0


def test_the_loads_of_a_scene_weigh_the_strain_energy_that_is_missing() -> None:
    """A hanging bar: its linear shape has (1/2)^2 of the energy 1/3, and bending none.

    Both were silent: the stress of the second was 0, that of the first 1/2 at the wall.
    """
    hung = [-9.81, 0.0, 0.0]
    (found,) = weighed(stressed(), hung, BENDING)
    assert found.data["missing"] == 1.0
    assert weighed(stressed(), [-9.81, -9.81, 0.0], BENDING) == []  # a thousandth
    assert weighed(stout(), hung, BENDING) == []  # without stress, inextensible
    first = 96 / np.pi**4
    assert first > 0.98 and weighed(stout(), hung, [*BENDING, STRETCHING[0]]) == []
    (found,) = weighed(linear(), hung)
    assert found.data["causes"] == "acceleration along x"
    assert found.data["missing"] == pytest.approx(0.25, rel=0.01)


@cache
def stressed() -> SID:
    reduction = {"method": "modal", "modes": 14}
    return steel_bar(width=0.1, height=0.1, elements=16, reduction=reduction, stress={})


@cache
def linear() -> SID:
    """A clamped bar whose only axial shape is linear."""
    reduction = {"method": "craig_bampton", "interfaces": ["tip"], "modes": 2}
    return steel_bar(width=0.1, height=0.1, elements=16, reduction=reduction)


def test_missing_stretch_by_rotation_is_reported(
    tmp_path: Any,
) -> None:
    """(1/3)^2 of the energy 2/15: the middle moved by 27 % too little, silently."""
    write_sid(tmp_path / "rod.SID_FEM", linear())
    for sid in (linear(), read_sid(tmp_path / "rod.SID_FEM")):
        (found,) = weighed(sid, [0.0, 0.0, 0.0], turning=polynomial(0.0, 20.0))
        assert found.data["causes"] == "rotation about z"
        assert found.data["missing"] == pytest.approx(1 / 6, rel=0.02)
    (found,) = weighed(stressed(), [0.0] * 3, BENDING, turning=polynomial(0.0, 20.0))
    assert found.data["missing"] == 1.0
    assert weighed(linear(), [0.0, -9.81, 0.0], turning=polynomial(0.0, 0.1)) == []


def test_files_with_nine_inertia_shares_keep_their_diagnostics() -> None:
    """Nine shares of the largest work, without products of angular velocities."""
    old = "held *=0.088,0.013,0.013,0.0013,0.047,0.047,0,0.07,0.07 2=100,100,100,-,-,-"
    sid = replace(linear(), carried=parse_compliance_shares(old))
    (found,) = weighed(sid, [-9.81, 0.0, 0.0])
    assert found.data["missing"] == pytest.approx(0.25, rel=0.03)
    (found,) = weighed(sid, [0.0, 0.0, 0.0], turning=polynomial(0.0, 20.0))
    assert found.data["causes"] == "rotation about z"
    assert found.data["missing"] == pytest.approx(1 / 6, rel=0.03)


def polynomial(*coefficients: float) -> dict[str, Any]:
    pieces = [{"from": 0.0, "coefficients": list(coefficients)}]
    return {"type": "polynomial", "pieces": pieces}


def test_missing_stretch_by_loads_at_a_free_frame_is_reported() -> None:
    """Free modes of bending in a frame at an end, which hangs there, do not stretch."""
    sid = steel_bar(
        width=0.1, height=0.1, frame={"type": "tangent", "marker": "root"},
        reduction={"method": "modal", "modes": 4},
    )  # fmt: skip
    found = weighed(sid, [-9.81, 0.0, 0.0], code="N420")
    (along,) = (each for each in found if "along x" in each.data["directions"])
    assert along.data["missing"] == 1.0


# Rotation of a free part ------------------------------------------------------------


@cache
def afloat() -> SID:
    """A bar in mean axes, of strain (a^2 - x^2) rho omega^2 / (2 E) when it spins."""
    reduction = {"method": "modal", "modes": 20}
    return steel_bar(
        width=0.1, height=0.1, elements=16, frame={"type": "buckens"}, stress={},
        reduction=reduction,
    )  # fmt: skip


def spun(
    sid: SID,
    omega: float | list[float],
    numbers: list[int] | None = None,
) -> list[Diagnostic]:
    """N422 of a bar that flies freely under gravity, in the plane or in space."""
    body: dict[str, Any] = {"sid": "-", "markers": {"a": 1}}
    body["initial"] = {"angular_velocity": omega}
    if numbers:
        body["shape_functions"] = numbers
    planar = isinstance(omega, float)
    described = scene(
        {"rod": body}, {}, gravity=[3.0, -9.81] if planar else [3.0, -9.81, 1.0],
        end=1e-5, steps=1, dimension="planar" if planar else "spatial",
    )  # fmt: skip
    return with_code(simulate(compiled(described, rod=sid)), "N422")


@pytest.mark.parametrize("planar", [False, True])
def test_a_free_bar_that_spins_lacks_the_stretch_by_rotation(planar: bool) -> None:
    """Exact 15.6e-6 m at 100 rad/s; bending modes had none and no word.

    Share of the strain energy of sin (2 k - 1) pi x / L: 960 / ((2 k - 1) pi)^6. What
    falls freely is not deformed.
    """
    omega: Any = 100.0 if planar else [0.0, 0.0, 100.0]
    first, third = FREE_STRETCHING
    (found,) = spun(afloat(), omega, BENDING)
    assert found.subject == "rod" and found.data["missing"] == pytest.approx(1.0)
    assert found.data["causes"] == "rotation about z"
    assert spun(afloat(), 0.0 if planar else [0.0] * 3, BENDING) == []
    assert spun(afloat(), omega, [*BENDING, first]) == []
    (found,) = spun(afloat(), omega, [*BENDING, third])
    share = 960 / (3 * np.pi) ** 6
    assert 1.0 - found.data["missing"] == pytest.approx(share, rel=0.05)


def test_a_free_bar_without_stress_stretches_by_rotation() -> None:
    """By 15.6e-6 of its length at 100 rad/s, and by 1.6e-9 at 1 rad/s."""
    sid = steel_bar(
        frame={"type": "buckens"}, reduction={"method": "modal", "modes": 8}
    )
    (found,) = spun(sid, [0.0, 0.0, 100.0])
    assert found.data["causes"] == "rotation about z"
    assert found.data["missing"] == pytest.approx(1.0)
    assert spun(sid, [0.0, 0.0, 1.0]) == []


def test_a_bar_along_the_axis_of_rotation_is_not_stretched() -> None:
    assert spun(afloat(), [100.0, 0.0, 0.0], [1, 2, 3, 4]) == []
    (found,) = spun(afloat(), [70.0, 70.0, 0.0], [1, 2, 3, 4])
    assert found.data["causes"] == "rotation about y"


@cache
def pulled(frame: str, centrifugal: bool) -> SID:
    """A free bar with the answers to forces at its tip."""
    reduction = {
        "method": "attachment", "interfaces": ["tip"], "modes": 2,
        "centrifugal": centrifugal,
    }  # fmt: skip
    table = {"type": "buckens"} if frame == "buckens" else AT_END
    return steel_bar(
        width=0.1, height=0.1, elements=16, frame=table, reduction=reduction, stress={}
    )


@pytest.mark.parametrize("frame", ["buckens", "tangent"])
@pytest.mark.parametrize("suffix", [".SID_FEM", ".h5"])
def test_centrifugal_shapes_of_a_free_bar(
    tmp_path: Any, frame: str, suffix: str
) -> None:
    """The answer to a force at the tip, of strain a + x, has 5/8 of the energy of
    a^2 - x^2, in mean axes and in those of an end.
    """
    for centrifugal in (True, False):
        path = tmp_path / f"rod{suffix}"
        write_sid(path, pulled(frame, centrifugal))
        found = spun(read_sid(path), [0.0, 0.0, 100.0])
        assert bool(found) != centrifugal
    assert found[0].data["missing"] == pytest.approx(3 / 8, rel=0.02)


def test_craig_bampton_in_mean_axes_stretches_linearly() -> None:
    """A uniform strain has 5/6 of the energy of a^2 - x^2."""
    reduction = {"method": "craig_bampton", "interfaces": ["root", "tip"], "modes": 2}
    sid = steel_bar(
        width=0.1, height=0.1, elements=16, frame={"type": "buckens"},
        reduction=reduction,
    )  # fmt: skip
    (found,) = spun(sid, [0.0, 0.0, 100.0])
    assert found.data["missing"] == pytest.approx(1 / 6, rel=0.02)


@pytest.mark.parametrize("frame", [{"type": "buckens"}, AT_END])
def test_products_of_angular_velocities_load_an_oblique_bar(frame: Any) -> None:
    """Along (c, s, 0), the loads of omega omega^T pull by s^2, c^2, 1 and 2 c s."""
    c, s = 0.6, 0.8
    line = {"type": "beam", "start": [0, 0, 0], "end": [c, s, 0]}
    section = {"shape": "rectangle", "width": 0.1, "height": 0.1}
    sid = steel_bar(
        width=0.1, height=0.1, frame=frame, stress={},
        reduction={"method": "modal", "modes": 4}, geometry=line | {"section": section},
    )  # fmt: skip
    assert sid.carried is not None
    pulls = np.array([s**2, c**2, 1.0, 2 * c * s, 0.0, 0.0])
    lost = np.array(sid.carried.lost)
    assert not lost[:6].any()
    assert lost[6:] / lost[8] == pytest.approx(pulls**2, abs=2e-5)
    (found,) = spun(sid, [50.0 * s, -50.0 * c, 0.0])
    assert found.data["causes"].endswith("rotation about both x and y")
    # the rotary inertia of its sections bends it a little
    assert found.data["missing"] == pytest.approx(1.0, abs=1e-3)
