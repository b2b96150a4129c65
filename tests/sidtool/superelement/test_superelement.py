"""Superelements against closed forms of a beam and against the SID they come from."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import sidtool
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array, Taylor
from sidtool.formats.sid_mass import free_modal_mass
from sidtool.superelement.craig_bampton import superelement_of_sid

from ..beams import beam

E, NU, RHO = 2.1e11, 0.3, 7850.0
LENGTH, HEIGHT, WIDTH = 1.0, 0.005, 0.008
AREA = HEIGHT * WIDTH
IZ, IY = WIDTH * HEIGHT**3 / 12, HEIGHT * WIDTH**3 / 12
FRAMES = [
    {"type": "buckens"},
    {"type": "chord", "markers": ["a", "b"]},
    {"type": "tangent", "marker": "a", "clamp": "start"},
]
CRAIG_BAMPTON = {"method": "craig_bampton", "interfaces": ["a", "b"], "modes": 8}


def rod(frame: dict[str, Any] = FRAMES[0], **changes: Any) -> sidtool.Model:
    """A slender beam in space between markers a and b, which cannot twist freely."""
    data = {
        "geometry": {
            "type": "beam",
            "start": [0, 0, 0],
            "end": [LENGTH, 0, 0],
            "section": {"shape": "rectangle", "height": HEIGHT, "width": WIDTH},
        },
        "material": {"youngs_modulus": E, "poissons_ratio": NU, "density": RHO},
        "markers": {"a": {"node": 1, "edge": "start"}, "b": {"node": 2, "edge": "end"}},
        "reduction": CRAIG_BAMPTON,
    }
    return beam({"type": "beam", "elements": 12}, frame=frame, **(data | changes))


@cache
def rod_sid(frame: int) -> sidtool.SID:
    return sidtool.convert(rod(FRAMES[frame]))


@pytest.fixture(params=range(3), ids=[frame["type"] for frame in FRAMES])
def sid(request: pytest.FixtureRequest) -> sidtool.SID:
    return rod_sid(request.param)


def bending_stiffness(ei: float) -> Array:
    """Force and moment at both ends of a beam by deflection and rotation of both."""
    length = LENGTH
    return (ei / length**3) * np.array(
        [
            [12, 6 * length, -12, 6 * length],
            [6 * length, 4 * length**2, -6 * length, 2 * length**2],
            [-12, -6 * length, 12, -6 * length],
            [6 * length, 2 * length**2, -6 * length, 4 * length**2],
        ]
    )


def test_static_stiffness_is_that_of_a_beam(sid: sidtool.SID) -> None:
    k = superelement_of_sid(sid, ["1", "2"]).stiffness[:12, :12]
    y, z = [1, 5, 7, 11], [2, 4, 8, 10]
    in_z = bending_stiffness(E * IY) * np.outer([1, -1, 1, -1], [1, -1, 1, -1])
    assert k[np.ix_(y, y)] == pytest.approx(bending_stiffness(E * IZ), rel=1e-8)
    assert k[np.ix_(z, z)] == pytest.approx(in_z, rel=1e-8)
    assert k[0, 6] == pytest.approx(-E * AREA / LENGTH, rel=1e-8)
    assert k[0, 0] == pytest.approx(E * AREA / LENGTH, rel=1e-8)


def test_frequencies_with_fixed_interfaces(sid: sidtool.SID) -> None:
    element = superelement_of_sid(sid, ["1", "2"])
    wave_numbers = np.array([4.730040744862704, 7.853204624095838])
    low, high = (
        wave_numbers**2 / (2 * np.pi) * np.sqrt(E * i / (RHO * AREA)) for i in (IZ, IY)
    )
    expected = np.sort([*low, *high])
    assert element.fixed_frequencies[:4] == pytest.approx(expected, rel=2e-4)


def test_free_frequencies_are_those_of_the_sid(sid: sidtool.SID) -> None:
    element = superelement_of_sid(sid, ["2", "1"])
    squares = scipy.linalg.eigh(sid.Ke.m0, free_modal_mass(sid), eigvals_only=True)
    assert element.frequencies[:6].max() < 1e-5 * element.frequencies[6]
    assert (2 * np.pi * element.frequencies[6:]) ** 2 == pytest.approx(
        squares, rel=1e-9
    )


def test_mass_and_inertia_of_a_slender_rod(sid: sidtool.SID) -> None:
    element = superelement_of_sid(sid, ["1", "2"])
    rigid = element.rigid_motions()
    middle = element.positions.mean(axis=0)
    shift = np.eye(6)
    shift[:3, 3:] = [
        [0, -middle[2], middle[1]],
        [middle[2], 0, -middle[0]],
        [-middle[1], middle[0], 0],
    ]
    found = shift.T @ (rigid.T @ element.mass @ rigid) @ shift
    mass = RHO * AREA * LENGTH
    across = [HEIGHT**2 + WIDTH**2, LENGTH**2 + WIDTH**2, LENGTH**2 + HEIGHT**2]
    expected = np.diag([mass, mass, mass, *(mass / 12 * np.array(across))])
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * mass)


def test_damping_proportional_to_stiffness_stays_so(sid: sidtool.SID) -> None:
    proportional = replace(sid, De=Taylor(1e-5 * sid.Ke.m0))
    element = superelement_of_sid(proportional, ["1", "2"])
    size = np.sqrt(np.outer(*2 * [np.diag(element.stiffness)]))
    deviation = np.abs(element.damping - 1e-5 * element.stiffness)
    assert (deviation / (1e-5 * size)).max() < 1e-9


def test_cantilever_after_fixing_an_interface() -> None:
    element = sidtool.superelement(rod(), fixed=["a"])
    assert element.interfaces == ("b",) and element.supports == ("a",)
    first = 1.875104068711961**2 / (2 * np.pi) * np.sqrt(E * IZ / (RHO * AREA))
    assert element.frequencies[0] == pytest.approx(first, rel=1e-4)
    with pytest.raises(InputError, match="fixed"):
        element.with_supports(["b"])


def test_order_of_interfaces_permutes_the_matrices() -> None:
    sid = rod_sid(0)
    one, other = (superelement_of_sid(sid, nodes) for nodes in ("12", "21"))
    order = [*range(6, 12), *range(6)]
    for name in ("mass", "stiffness", "damping"):
        a, b = getattr(one, name)[:12, :12], getattr(other, name)[:12, :12]
        assert b == pytest.approx(a[np.ix_(order, order)], abs=1e-9 * np.abs(a).max())


def test_default_interfaces_are_those_of_the_reduction_and_the_frame() -> None:
    one = {"method": "craig_bampton", "interfaces": ["b"], "modes": 2}
    middle = {"node": 3, "parameters": [0.5]}
    markers = {**rod_markers(), "middle": middle}
    model = rod(FRAMES[2], reduction=one, markers=markers)
    assert sidtool.superelement(model).interfaces == ("a", "b")
    with pytest.raises(InputError) as refused:
        sidtool.superelement(model, ["a", "b", "middle"])
    assert refused.value.place == "interfaces"
    assert "craig_bampton" in str(refused.value)


def rod_markers() -> dict[str, Any]:
    return {"a": {"node": 1, "edge": "start"}, "b": {"node": 2, "edge": "end"}}


def test_natural_modes_alone_are_refused_or_noted() -> None:
    few = rod(reduction={"method": "modal", "modes": 4})
    with pytest.raises(InputError) as refused:
        sidtool.superelement(few)
    assert refused.value.place == "interfaces"
    many = rod(reduction={"method": "modal", "modes": 60})
    with pytest.warns(sidtool.DiagnosticWarning) as warned:
        sidtool.superelement(many)
    assert "N172" in {each.message.code for each in warned}


def test_plane_bodies_are_refused() -> None:
    plane = beam(
        discretisation={"type": "q4", "elements": [10, 1]},
        markers={
            "a": {"node": 1, "edge": "left", "at": 0.5},
            "b": {"node": 2, "edge": "right", "at": 0.5},
        },
        frame={"type": "buckens"},
        reduction=CRAIG_BAMPTON,
    )
    with pytest.raises(InputError):
        sidtool.superelement(plane)


@pytest.mark.parametrize(
    ("block", "change", "place"),
    [
        ("Ke", lambda m: m + 0.1 * np.triu(m[::-1], 1), "stiffness"),
        ("Ke", lambda m: -m, "stiffness"),
        ("De", lambda m: m - np.eye(len(m)), "damping"),
        ("ksigma", lambda m: m + 1.0, "ksigma"),
        ("Me", lambda m: m / 1000, "mass"),
    ],
)
def test_matrices_that_no_body_has_are_refused(
    block: str, change: Any, place: str
) -> None:
    sid = rod_sid(1)
    wrong = replace(sid, **{block: Taylor(change(getattr(sid, block).m0))})
    with pytest.raises(InputError) as refused:
        superelement_of_sid(wrong, ["1", "2"])
    assert refused.value.place == place


def test_unknown_interfaces_are_refused() -> None:
    sid = rod_sid(0)
    for nodes in (["1", "7"], []):
        with pytest.raises(InputError):
            superelement_of_sid(sid, nodes)
