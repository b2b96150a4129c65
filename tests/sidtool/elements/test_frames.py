"""Frames of beams against closed forms, statics, single beams and decks."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sidtool
from sidtool.discretisation.registry import finite_element_model
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model import ModelFile
from tests.codes import only, with_code
from tests.sidtool.frames import (
    NU,
    RHO,
    STIFF,
    TUBE,
    E,
    frame,
    hinged_crane,
    section_forces,
)
from tests.sidtool.importers.bars.decks import bulk, grids, model as deck_model
from tests.sidtool.importers.decks import frequencies

G = E / (2 * (1 + NU))
CHANNEL = {"shape": "C", "height": 0.2, "width": 0.08, "web": 0.006, "flange": 0.011}


def displacements(
    model: ModelFile, held: list[str], loads: dict[str, list[float]]
) -> tuple[FiniteElementModel, dict[str, Array]]:
    """Motion (6,) of loaded points of a frame that is clamped at others."""
    body = finite_element_model(model)
    fixed = np.concatenate([body.dofs(body.node_sets[name]) for name in held])
    free = np.setdiff1d(np.arange(body.ndof), fixed)
    force = np.zeros(body.ndof)
    rows = {name: body.table[body.node_sets[name][0]] for name in loads}
    for name, values in loads.items():
        there = rows[name] >= 0
        force[rows[name][there]] = np.array(values)[there]
    u = np.zeros(body.ndof + 1)
    u[free] = np.linalg.solve(body.stiffness[free][:, free].toarray(), force[free])
    return body, {name: u[row] for name, row in rows.items()}


def test_a_portal_sways_by_slope_deflection() -> None:
    """H h^3 (2 + 3 k) / (12 E I (1 + 6 k)), k = h / L: clamped feet, stiff axes."""
    h, span, force = 2.0, 3.0, 1000.0
    points = {"a": [0, 0, 0], "b": [0, 0, h], "c": [span, 0, h], "d": [span, 0, 0]}
    legs = {"left": ("a", "b", {}), "top": ("b", "c", {}), "right": ("d", "c", {})}
    members = {n: (a, b, x | {"section": "s"}) for n, (a, b, x) in legs.items()}
    model = frame(points, members, geometry={"sections": {"s": STIFF}})
    _, u = displacements(model, ["a", "d"], {"b": [force, 0, 0, 0, 0, 0]})
    k = h / span
    sway = force * h**3 * (2 + 3 * k) / (12 * E * STIFF["iy"] * (1 + 6 * k))
    assert u["b"][0] == pytest.approx(sway, rel=1e-5)
    slope = 3 * sway / (h * (2 + 3 * k))
    assert u["b"][4] == pytest.approx(slope, rel=1e-5)


def test_a_truss_of_pinned_members_by_the_method_of_joints() -> None:
    """Two bars and a load between them: N = F / (2 sin a), and its energy."""
    a, b, force, area = 1.5, 2.0, 5000.0, math.pi * (0.03**2 - 0.026**2)
    pinned = {"section": TUBE, "releases": {"start": ["ry"], "end": ["ry"]}}
    members = {
        "left": ("l", "t", pinned),
        "right": ("r", "t", pinned),
        "base": ("l", "r", {"section": TUBE}),
    }
    points = {"l": [-a, 0, 0], "r": [a, 0, 0], "t": [0.0, 0, -b]}
    model = frame(
        points,
        members,
        discretisation={"type": "beam", "elements": 1},
        section_forces={"stations": [0.5], "members": ["left"]},
        markers={"p": {"node": 1, "point": "l"}, "t": {"node": 2, "point": "t"}},
        reduction={"method": "attachment", "interfaces": ["t"], "modes": 0},
    )
    body, u = displacements(model, ["l", "r"], {"t": [0, 0, -force, 0, 0, 0]})
    length = math.hypot(a, b)
    normal = force * length / (2 * b)
    assert u["t"][2] == pytest.approx(-2 * normal**2 * length / (E * area * force))
    assert body.cuts[0].name == "left.s1"


def test_a_marker_that_nothing_turns_is_named_and_right_in_a_hinge() -> None:
    """Released about z at a marker: q L^2 / 8 in the middle, and at the other clamp."""
    span, q = 2.0, RHO * 0.01 * np.array([0.3, 0.7])
    section = STIFF | {"area": 0.01}
    released = {"section": section, "y_axis": [0, 1, 0], "releases": {"start": ["rz"]}}
    model = frame(
        {"a": [0, 0, 0], "b": [span, 0, 0]},
        {"m": ("a", "b", released)},
        discretisation={"type": "beam", "elements": 2, "theory": "euler_bernoulli"},
        frame={"type": "buckens"},
        markers={"a": {"node": 1, "point": "a"}, "b": {"node": 2, "point": "b"}},
        reduction={"method": "attachment", "interfaces": ["a", "b"], "modes": 4},
        section_forces={"stations": [0.0, 0.5]},
    )
    sid = sidtool.convert(model)
    assert only(sid, "N147").data == {"markers": ("a",), "axes": ("z",)}
    hinge = {"type": "revolute", "axis": [0, 0, 1], "markers": ["ground", "c.a"]}
    scene = sidtool.Scene(
        dimension="spatial",
        time={"end": 1.0, "output_step": 1.0},
        gravity=[0.0, -0.3, -0.7],
        ground={"markers": {"wall": {"position": [span, 0, 0]}}},
        bodies={"c": {"sid": "c.h5", "markers": {"a": 1, "b": 2}}},
        joints={
            "hinge": hinge,
            "ball": {"type": "spherical", "markers": ["ground.wall", "c.b"]},
        },
    )
    found = sidtool.static_equilibrium(scene, sids={"c": sid})
    size = q * span**2 / 8
    assert found["c.m.s1.Mz"] == pytest.approx(0, abs=1e-6 * size[0])
    assert found["c.m.s2.Mz"] == pytest.approx(size[0], rel=1e-5)
    assert found["c.m.s1.My"] == pytest.approx(size[1], rel=1e-5)


def test_an_offset_is_a_rigid_arm() -> None:
    """The load acts L / 3 beyond the elastic part: Mohr's analogy."""
    length, arm, force = 2.0, 0.7, 300.0
    points = {"a": [0, 0, 0], "b": [length + arm, 0, 0]}
    held = {"section": STIFF, "offsets": {"end": [-arm, 0.0, 0.0]}}
    model = frame(points, {"m": ("a", "b", held)})
    _, u = displacements(model, ["a"], {"b": [0, 0, force, 0, 0, 0]})
    moment = force * arm
    bend = E * STIFF["iy"]
    end = force * length**3 / (3 * bend) + moment * length**2 / (2 * bend)
    slope = force * length**2 / (2 * bend) + moment * length / bend
    assert u["b"][2] == pytest.approx(end + slope * arm, rel=1e-12)
    assert u["b"][4] == pytest.approx(-slope, rel=1e-12)
    assert not with_code(finite_element_model(model), "N129")


@pytest.mark.parametrize("theory", ["euler_bernoulli", "timoshenko"])
def test_a_beam_in_three_members_is_one_beam(theory: str) -> None:
    """A channel, whose shear centre is beside its centroid, with stress."""
    whole = {"type": "beam", "start": [0, 0, 0], "end": [0, 0, 3.0]}
    common = {
        "reduction": {"method": "craig_bampton", "interfaces": ["q"], "modes": 4},
        "discretisation": {"type": "beam", "elements": 6, "theory": theory},
        "stress": {},
        "stiffening": {"centrifugal": True},
    }
    points = {name: [0, 0, float(z)] for z, name in enumerate("abcd")}
    members = {
        a + b: (a, b, {"section": CHANNEL, "elements": 2})
        for a, b in zip("abc", "bcd", strict=True)
    }
    markers = {"p": {"node": 1, "point": "a"}, "q": {"node": 2, "point": "d"}}
    markers |= {"m": {"node": 3, "member": "bc", "at": 0.5}}
    parted = frame(points, members, **(common | {"markers": markers}))
    data = parted.file_data()
    data["frame"] = {"type": "tangent", "marker": "p", "clamp": "start"}
    data["geometry"] = whole | {"section": CHANNEL}
    data["markers"] = {
        "p": {"node": 1, "edge": "start"},
        "q": {"node": 2, "edge": "end"},
        "m": {"node": 3, "parameters": [0.5]},
    }
    single = ModelFile.checked(data, "single")
    one, other = sidtool.convert(single), sidtool.convert(parted)
    assert one.mass == pytest.approx(other.mass, rel=1e-12)
    for name, block in one.blocks.items():
        size = np.abs(block.m0).max(initial=0.0)
        for part in ("m0", "m1"):
            a, b = (getattr(x, part) for x in (block, other.blocks[name]))
            if a is not None and b is not None:
                assert_allclose(a, b, atol=1e-7 * max(size, np.abs(a).max()))
    phi = one.nodes[1].phi.m0
    for a, b in zip(one.nodes[:3], other.nodes[:3], strict=True):
        assert_allclose(a.phi.m0, b.phi.m0, atol=1e-7 * np.abs(phi).max())
    assert len(one.nodes) == len(other.nodes)


def test_a_frame_is_that_of_a_deck(tmp_path: Path) -> None:
    """The same members, pins, offset, mass and spring as cards of Nastran."""
    section = STIFF | {"area": 4e-4, "shear_y": 0.8, "shear_z": 0.7}
    up = [0.2, -0.3, 0.9]
    points = {"a": [0, 0, 0], "b": [0.4, 0.1, 0], "c": [0.5, 0.6, 0.2]}
    points |= {"d": [0.1, 0.5, 0.7], "e": [0.0, 0.3, 0.1]}
    members = {
        "ab": ("a", "b", {"section": "s"}),
        "bc": ("b", "c", {"section": "s", "offsets": {"end": [0.01, 0.02, -0.03]}}),
        "cd": ("c", "d", {"section": "s", "releases": {"end": ["ry", "rz"]}}),
        "da": ("d", "a", {"section": "s", "releases": {"start": ["rz"]}}),
        "ae": ("a", "e", {"section": "s"}),
    }
    stiffness = [1e5, 2e5, 3e5, 1e3, 2e3, 3e3]
    model = frame(
        points,
        members,
        geometry={
            "y_axis": up,
            "sections": {"s": section},
            "masses": [
                {"point": "c", "mass": 2.0, "inertia": [0.01, 0.02, 0.03]}
                | {"offset": [0.1, 0.0, -0.05]}
            ],
            "springs": {"k": {"points": ["e", "d"], "stiffness": stiffness}},
        },
        discretisation={"type": "beam", "elements": 1, "theory": "timoshenko"},
        frame={"type": "buckens"},
        reduction={"method": "modal", "modes": 12},
    )
    number = {name: k for k, name in enumerate(points, 1)}
    cards = grids(list(points.values()))
    y = ",".join(map(repr, up))
    tails = {"bc": "\n,,,,,,0.01,0.02,-0.03", "cd": "\n,,56", "da": "\n,6"}
    for k, (name, (a, b, _)) in enumerate(members.items(), 1):
        ends = f"{number[a]},{number[b]}"
        cards.append(f"CBAR,{k},1,{ends},{y}{tails.get(name, '')}")
    area, iy, iz, torsion = (section[n] for n in ("area", "iy", "iz", "torsion"))
    cards += [
        f"PBAR,1,1,{area!r},{iz!r},{iy!r},{torsion!r}",
        ",",
        f",{section['shear_y']!r},{section['shear_z']!r}",
        f"MAT1,1,{E!r},,{NU!r},{RHO!r}",
        "CONM2,60,3,,2.,0.1,0.,-0.05\n,0.01,,0.02,,,0.03",
        f"PBUSH,7,K,{','.join(map(repr, stiffness))}",
        f"CBUSH,61,7,{number['e']},{number['d']},,,,0",
    ]
    own = frequencies(sidtool.convert(model))
    read = deck_model(tmp_path, bulk(*cards), frame={"type": "buckens"}, modes=12)
    assert_allclose(own, frequencies(sidtool.convert(read)), rtol=1e-8)


def sprung_ring(
    middle: list[float], released: list[str], turning: float, marked: bool
) -> ModelFile:
    """Three members in a ring, a spring between two of them, one released from it."""
    points = {"a": [0, 0, 0], "b": middle, "c": middle, "d": [2.0, 0.0, 0.0]}
    loose = {"section": STIFF, "releases": {"end": released}}
    members = {
        "ab": ("a", "b", loose),
        "cd": ("c", "d", {"section": STIFF}),
        "ad": ("a", "d", {"section": STIFF}),
    }
    spring = {"points": ["b", "c"], "stiffness": [1e6] * 3 + [turning] * 3}
    markers = {"p": {"node": 1, "point": "a"}}
    if marked:
        markers["b"] = {"node": 2, "point": "b"}
    return frame(points, members, geometry={"springs": {"s": spring}}, markers=markers)


@pytest.mark.parametrize("middle", [[1.0, 0.0, 0.5], [1.0, 0.3, 0.2]])
@pytest.mark.parametrize("marked", [False, True])
def test_a_spring_carries_the_rotation_of_a_released_point(
    middle: list[float], marked: bool
) -> None:
    """R^T K R = 0; through a ball joint the spring passes on no moment."""
    load = {"d": [10.0, 20.0, 30.0, 4.0, 5.0, 6.0]}
    ball = ["rx", "ry", "rz"]
    body, soft = displacements(sprung_ring(middle, ball, 1e3, marked), ["a"], load)
    assert (body.dof_table[body.node_sets["b"][0]] >= 0).all()
    assert_rigid_motions_are_free(body)
    _, none = displacements(sprung_ring(middle, ball, 0.0, False), ["a"], load)
    assert_allclose(soft["d"], none["d"], rtol=1e-7)
    for released in (["ry"], ["ry", "rz"]):
        model = sprung_ring(middle, released, 1e3, marked)
        assert_rigid_motions_are_free(finite_element_model(model))


def assert_rigid_motions_are_free(body: FiniteElementModel) -> None:
    rigid = body.rigid_body_modes(np.zeros(3))
    energy = rigid.T @ (body.stiffness @ rigid)
    assert np.abs(energy).max() < 1e-13 * np.abs(body.stiffness.data).max()


@pytest.mark.parametrize("stiffened", [False, True])
def test_springs_are_named_where_stiffening_is_requested(stiffened: bool) -> None:
    points = {"a": [0, 0, 0], "b": [1.0, 0, 0], "c": [1.0, 1.0, 0]}
    spring = {"points": ["b", "c"], "stiffness": 1e6}
    held = {"section": STIFF}
    members = {"m": ("a", "b", held), "n": ("a", "c", held)}
    tables = {"stiffening": {"centrifugal": True}} if stiffened else {}
    model = frame(points, members, geometry={"springs": {"s": spring}}, **tables)
    found = with_code(finite_element_model(model), "N129")
    assert len(found) == stiffened and all(each.remedy for each in found)


def mass_on_springs(released: list[str]) -> ModelFile:
    """A heavy point d on three oblique springs to a ring of members."""
    points = {"a": [0, 0, 0], "b": [1.1, 0.3, 0.2], "c": [0.4, 0.9, 0.1]}
    first = {"section": STIFF, "releases": {"start": released}}
    members = {"ab": ("a", "b", first)} | {
        a + b: (a, b, {"section": STIFF}) for a, b in ("bc", "ca")
    }
    springs = {f"k{n}": {"points": [n, "d"], "stiffness": 1e6} for n in points}
    geometry = {"springs": springs, "masses": [{"point": "d", "mass": 1e7}]}
    points["d"] = [0.37, 0.23, 0.91]
    return frame(points, members, geometry=geometry, frame={"type": "buckens"})


@pytest.mark.parametrize("released", [[], ["ry"]])
def test_a_point_that_springs_alone_hold_does_not_turn(released: list[str]) -> None:
    """Its stiffness is k sum e e^T by the directions e of the springs."""
    model = mass_on_springs(released)
    body = finite_element_model(model)
    dofs = body.dof_table[body.node_sets["d"][0]]
    assert (dofs[3:] < 0).all()
    *others, place = model.geometry.points.values()
    along = np.array([np.subtract(place, other) for other in others])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    own = body.stiffness[dofs[:3]][:, dofs[:3]].toarray()
    assert_allclose(own, 1e6 * along.T @ along, rtol=1e-12)
    assert_rigid_motions_are_free(body)


def test_a_frame_on_mounts_is_a_beam_on_elastic_supports() -> None:
    """It settles by W / (2 k) and sags by 5 w L^4 / (384 E I), and M = w L^2 / 8."""
    length, k, g = 4.0, 2e6, 1e-3
    points = {"a": [0, 0, 0], "m": [length / 2, 0, 0], "b": [length, 0, 0]}
    held = {"section": STIFF}
    names = {"a": 1, "m": 2, "b": 3}
    model = frame(
        points,
        {"first": ("a", "m", held), "second": ("m", "b", held)},
        markers={name: {"node": n, "point": name} for name, n in names.items()},
        frame={"type": "buckens"},
        reduction={"method": "attachment", "interfaces": [*names], "modes": 2},
        section_forces={"stations": 3},
    )
    stiffness = [k, k, k, 1e3, 0.0, 0.0]
    mounts = {
        name: {
            "type": "bushing",
            "markers": [f"ground.{name}", f"c.{name}"],
            "stiffness": stiffness,
        }
        for name in "ab"
    }
    start = {"position": [length / 2, 0.0, 0.0]}  # the centre of mass
    scene = sidtool.Scene(
        dimension="spatial",
        gravity=[0.0, 0.0, -g],
        time={"end": 1.0, "output_step": 1.0},
        ground={"markers": {name: {"position": points[name]} for name in "ab"}},
        bodies={
            "c": {
                "sid": "c.h5",
                "markers": names,
                "initial": start,
            }
        },
        forces=mounts,
        outputs={"record": ["c.a.z", "c.m.z", "c.*.*.My"]},
    )
    found = sidtool.static_equilibrium(scene, sids={"c": sidtool.convert(model)})
    load = RHO * STIFF["area"] * g
    settled = load * length / (2 * k)
    sag = 5 * load * length**4 / (384 * E * STIFF["iy"])
    assert found["c.a.z"] == pytest.approx(-settled, rel=1e-6)
    assert found["c.m.z"] == pytest.approx(-settled - sag, rel=1e-5)
    moment = load * length**2 / 8
    assert abs(found["c.first.s3.My"]) == pytest.approx(moment, rel=1e-5)
    assert abs(found["c.first.s1.My"]) == pytest.approx(0.0, abs=1e-6 * moment)


def test_a_spring_to_the_ground_is_no_part_of_a_frame() -> None:
    spring = {"points": ["a", "ground"], "stiffness": 1e6}
    with pytest.raises(InputError, match="bushing") as caught:
        frame(
            {"a": [0, 0, 0], "b": [1, 0, 0]},
            {"m": ("a", "b", {"section": STIFF})},
            geometry={"springs": {"s": spring}},
        )
    assert caught.value.place == "geometry.springs.s.points"


@pytest.mark.parametrize("end", [{"point": "b"}, {"member": "m", "at": 1.0}])
def test_a_load_at_the_end_of_a_member_is_beyond_its_last_section(end: Any) -> None:
    """V = F along a cantilever, and M = F (L - x)."""
    model = frame(
        {"a": [0, 0, 0], "b": [1.0, 0, 0]},
        {"m": ("a", "b", {"section": STIFF})},
        markers={"p": {"node": 1, "point": "a"}, "tip": {"node": 2} | end},
        reduction={"method": "attachment", "interfaces": ["tip"], "modes": 0},
        section_forces={"stations": [0.0, 0.5, 1.0]},
    )
    found = section_forces(sidtool.convert(model), 0.1)
    shear = [abs(found[f"c.m.s{k}.Vz"]) for k in (1, 2, 3)]
    assert_allclose(shear, 0.1, rtol=1e-6)
    bending = [abs(found[f"c.m.s{k}.My"]) for k in (1, 2, 3)]
    assert_allclose(bending, [0.1, 0.05, 0.0], atol=1e-6)


@pytest.mark.parametrize(
    ("model", "point", "axis"),
    [
        (
            hinged_crane(
                section_forces=None, reduction={"method": "modal", "modes": 3}
            ),
            "knee",
            2,
        ),
        (mass_on_springs(["ry"]), "d", 1),
    ],
    ids=["crane", "springs"],
)
def test_derivatives_by_a_point_of_a_frame(
    model: ModelFile, point: str, axis: int
) -> None:
    """By differences of two conversions."""
    derivatives = sidtool.sid_derivatives(model, [f"geometry.points.{point}[{axis}]"])
    step = 1e-4
    changed = []
    for d in (step, -step):
        place = [*model.geometry.points[point]]
        place[axis] += d
        moved = model.with_({f"geometry.points.{point}": place})
        changed.append(frequencies(sidtool.convert(moved)))
    slope = (changed[0] - changed[1]) / (2 * step)
    (sid,) = derivatives.derivatives.values()
    own = frequencies(sidtool.convert(model))
    squares = (2 * np.pi * own) ** 2
    by_blocks = np.diag(sid.Ke.m0) - squares * np.diag(sid.Me.m0)
    found = by_blocks / np.diag(derivatives.sid.Me.m0) / (8 * np.pi**2 * own)
    assert_allclose(found, slope, rtol=1e-4, atol=1e-6 * np.abs(own).max())


POINTS = {"a": [0, 0, 0], "b": [1, 0, 0], "c": [1, 0, 1]}
TWO = {"ab": ("a", "b", {"section": TUBE}), "bc": ("b", "c", {"section": TUBE})}
SPRING = {"points": ["a", "c"], "stiffness": [1.0, 2.0]}
BETWEEN = {"points": ["c", "d"], "stiffness": [1e6] * 3 + [1e3] * 3}
FREE = {"releases": {"start": ["rx", "ry", "rz"]}}


@pytest.mark.parametrize(
    ("points", "members", "changes", "problem"),
    [
        ({}, {"bc": ("b", "x", {"section": TUBE})}, {}, "no point 'x'"),
        ({"d": [1, 0, 1]}, {}, {}, "points c and d are at one place"),
        ({"d": [1, 1, 1]}, {}, {}, "no member or spring holds point d"),
        (
            {"d": [1, 1, 1], "e": [2, 1, 1], "f": [2, 2, 2]},
            {"de": ("d", "e", {"section": TUBE}), "ef": ("e", "f", {"section": TUBE})},
            {},
            "2 parts that are not connected",
        ),
        ({}, {"bb": ("b", "b", {"section": TUBE})}, {}, "starts and ends at b"),
        ({}, {"bc": ("b", "c", {"section": "ipe"})}, {}, "no section 'ipe'"),
        ({}, {"bc": ("b", "c", {})}, {}, "members.bc: has no section"),
        (
            {},
            {"bc": ("b", "c", {"section": TUBE, "material": "alloy"})},
            {},
            "no material 'alloy'",
        ),
        (
            {},
            {"bc": ("b", "c", {"section": TUBE, "y_axis": [0, 0, 1]})},
            {},
            "members.bc.y_axis: is parallel",
        ),
        (
            {},
            {"bc": ("b", "c", {"section": TUBE, "offsets": {"end": [0, 0, -1]}})},
            {},
            "members.bc.end: start and end are the same",
        ),
        (
            {},
            {"bc": ("b", "c", {"section": TUBE} | FREE)},
            {"markers": {"p": {"node": 1, "point": "b"}}},
            "without deforming",
        ),
        (
            {},
            {
                "bc": (
                    "b",
                    "c",
                    {"section": TUBE, "elements": 1}
                    | {"releases": {"start": ["x"], "end": ["x"]}},
                )
            },
            {},
            "member bc moves freely between its pins",
        ),
        (
            {"d": [1, 0, 1], "e": [1, 0, 2]},
            {"bc": ("b", "c", {"section": TUBE, "releases": {"end": ["ry"]}})}
            | {"de": ("d", "e", {"section": TUBE})},
            {"geometry": {"springs": {"k": BETWEEN}}},
            "without deforming",
        ),
        (
            {},
            {},
            {"markers": {"p": {"node": 1, "edge": "a"}}},
            "gives edge",
        ),
        (
            {},
            {},
            {"markers": {"p": {"node": 1, "member": "ab"}}},
            "member and at do not come together",
        ),
        ({}, {}, {"material": None}, "material: is missing"),
        (
            {},
            {"bc": ("b", "c", {"section": STIFF})},
            {"stress": {}},
            r"without a shape \(member bc\)",
        ),
        (
            {},
            {},
            {"section_forces": {"stations": 2, "members": ["x"]}},
            "no member 'x'",
        ),
        (
            {},
            {},
            {"geometry": {"masses": [{"point": "x", "mass": 1.0}]}},
            r"masses\[0\].point: there is no point 'x'",
        ),
        (
            {},
            {},
            {"geometry": {"springs": {"k": SPRING}}},
            "has 2 numbers",
        ),
        (
            {},
            {},
            {"geometry": {"springs": {"k": {"points": ["a", "a"], "stiffness": 1.0}}}},
            "springs.k.points: starts and ends at a",
        ),
        ({}, {"b.c": TWO["bc"]}, {}, "geometry.members: 'b.c' cannot be a name"),
        ({"x.y": [2, 2, 2]}, {}, {}, "geometry.points: 'x.y' cannot be a name"),
        (
            {},
            {},
            {"geometry": {"sections": {"s.t": STIFF}}},
            "geometry.sections: 's.t' cannot be a name",
        ),
    ],
)
def test_what_is_wrong_with_a_frame_is_named(
    points: Any, members: Any, changes: Any, problem: str
) -> None:
    changes = dict(changes)
    with pytest.raises(InputError, match=problem):
        finite_element_model(frame(POINTS | points, TWO | members, **changes))
