"""Where tied markers stand, and how their forces spread, on graded meshes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from click.testing import CliRunner
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sidtool.cli.main import cli
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile, read_model
from sidtool.mesh.mesh import Mesh
from sidtool.pipeline.model_to_sid import finite_element_model
from tests.codes import only, with_code
from tests.metamorphic.parts.meshes import block

from .bores import DEPTH, PLANE, RADIUS, REFERENCE, SOLID, bored, pinned
from .test_weak_ties import box, model_of

Array = NDArray[np.float64]
BORE = {"type": "distributing", "to": "BORE"}


def at_bore(
    folder: Path, kind: str, around: int, turn: int | None = None, **place: Any
) -> tuple[FiniteElementModel, Array]:
    """A body whose marker is tied to the bore, and the exact middle of the bore."""
    mesh, bore = bored(kind, around)
    exact = np.array([0, 0, DEPTH / 2])[: mesh.dimension]
    if turn is not None:
        mesh, exact = carried(mesh, exact, turn)
    model = pinned(
        folder, mesh, {"BORE": bore}, {"pin": {"node": 1, "tie": BORE, **place}}
    )
    return finite_element_model(model), np.pad(exact, (0, 3 - len(exact)))


def carried(mesh: Mesh, point: Array, seed: int) -> tuple[Mesh, Array]:
    """A mesh and a point of it somewhere else."""
    d = mesh.dimension
    turn = Rotation.random(random_state=seed).as_matrix()
    if d == 2:
        turn = Rotation.from_rotvec([0, 0, seed]).as_matrix()[:2, :2]
    shift = np.random.default_rng(seed).uniform(-0.3, 0.3, d)
    moved = mesh.positions @ turn.T + shift
    return replace(mesh, positions=moved), turn @ point + shift


@pytest.mark.parametrize("turn", [None, 3])
@pytest.mark.parametrize("kind", [*PLANE, *SOLID])
def test_a_pin_finds_the_axis_of_its_bore(
    tmp_path: Path, kind: str, turn: int | None
) -> None:
    """However coarse and graded the mesh is; the mean of the nodes is far away."""
    body, exact = at_bore(tmp_path, kind, 9, turn, at="axis")
    assert_allclose(body.marker("pin").position, exact, atol=1e-9 * RADIUS)
    nodes = body.positions[body.node_sets["BORE"]]
    off = np.linalg.norm(nodes.mean(axis=0) - exact[: body.dimension])
    assert off > 0.1 * RADIUS
    place = only(body, "N136")
    assert place.subject == "marker pin"
    assert place.data["radius"] == pytest.approx(RADIUS, rel=1e-9)
    assert place.data["count"] == len(nodes)
    assert place.data["gap"] == pytest.approx(off, rel=1e-9)


@pytest.mark.parametrize(
    ("kind", "order"),
    [("quad4", 2), ("tri3", 2), ("quad8", 4), ("hex8", 2), ("tet10", 4)],
)
def test_the_centre_of_the_area_converges_to_the_axis(
    tmp_path: Path, kind: str, order: int
) -> None:
    """Facets cut corners: the error falls with the order of the element's geometry."""
    counts = {"hex8": (32, 64), "tet10": (12, 24)}.get(kind, (48, 96))
    errors = []
    for around in counts:
        body, exact = at_bore(tmp_path, kind, around, 2)
        gap = np.linalg.norm(body.marker("pin").position - exact) / RADIUS
        errors.append(gap)
        nodes = body.positions[body.node_sets["BORE"]]
        mean = np.linalg.norm(nodes.mean(axis=0) - exact[: body.dimension])
        assert mean > 0.3 * RADIUS
    rate = np.log2(errors[-2] / errors[-1])
    assert rate > order - 0.4
    assert errors[-1] < 1e-3


def test_the_units_of_the_file_do_not_matter(tmp_path: Path) -> None:
    mesh, bore = bored("hex20", 8)
    mesh = replace(mesh, positions=mesh.positions * 1e3 + 40.0)
    for at in ({"at": "axis"}, {}):
        marker = {"pin": {"node": 1, "tie": BORE, **at}}
        model = pinned(tmp_path, mesh, {"BORE": bore}, marker, unit="mm-t-s")
        found = finite_element_model(model).marker("pin").position
        error = np.linalg.norm(found - [0.04, 0.04, 0.04 + DEPTH / 2])
        assert error < (1e-9 if at else 1e-2) * RADIUS


@pytest.mark.parametrize("kind", ["quad8", "tet4"])
@pytest.mark.parametrize("tie", ["rigid", "distributing"])
def test_a_tied_marker_may_be_anywhere(tmp_path: Path, kind: str, tie: str) -> None:
    """On the axis, where no element is, or far away: it moves as a rigid arm."""
    for far in (0.0, 0.5, 1000.0):
        mesh, bore = bored(kind, 12)
        place = np.array([far, -far, DEPTH / 2])[: mesh.dimension]
        settings = {"type": tie, "to": "BORE"}
        markers = {
            "near": {"node": 1, "tie": settings},
            "pin": {"node": 2, "tie": settings, "position": place.tolist()},
        }
        body = finite_element_model(pinned(tmp_path, mesh, {"BORE": bore}, markers))
        marker = body.marker("pin")
        assert_allclose(marker.position[: mesh.dimension], place, atol=1e-15)
        assert_moves_rigidly(body, "pin")


def assert_moves_rigidly(body: FiniteElementModel, name: str) -> None:
    marker = body.marker(name)
    which = [0, 1, 5] if body.dimension == 2 else list(range(6))
    rows = sp.vstack([marker.displacement, marker.rotation]).tocsr()[which]
    found = rows @ body.rigid_body_modes(marker.position)
    arm = np.abs(marker.position).max() + RADIUS
    assert_allclose(found, np.eye(len(which)), atol=1e-11 * max(1, (arm / RADIUS) ** 2))


@pytest.mark.parametrize("kind", ["tri6", "wedge15"])
def test_a_tied_marker_may_be_at_a_free_node(tmp_path: Path, kind: str) -> None:
    mesh, bore = bored(kind, 8)
    free = np.array([0.001, -0.002, 0.3])[: mesh.dimension]
    marker = {"pin": {"node": 1, "tie": BORE, "mesh_node": REFERENCE}}
    model = pinned(tmp_path, mesh, {"BORE": bore}, marker, reference=free)
    body = finite_element_model(model)
    assert_allclose(body.marker("pin").position[: mesh.dimension], free, atol=1e-15)
    assert_moves_rigidly(body, "pin")
    marker["pin"]["mesh_node"] += 1
    model = pinned(tmp_path, mesh, {"BORE": bore}, marker, reference=free)
    with pytest.raises(InputError, match="markers.pin.mesh_node: .*no node 900001"):
        finite_element_model(model)


BLOCKS: dict[str, tuple[int, ...]] = {
    **dict.fromkeys(PLANE, (3, 4)),
    **dict.fromkeys(SOLID, (2, 3, 2)),
}


@pytest.mark.parametrize("kind", BLOCKS)
def test_a_tied_side_pulls_uniformly(tmp_path: Path, kind: str) -> None:
    """A force at the marker is a uniform traction: the exact answer of the unequal
    elements is the uniaxial state u = (x, -nu y, -nu z) / E."""
    counts = BLOCKS[kind]
    size = (0.3, 0.1, 0.08)[: len(counts)]

    def graded(points: Array) -> Array:
        s = points / size
        return np.array(size) * (s + 0.25 * np.sin(np.pi * s) / np.pi)

    mesh = block(kind, counts, size, seed=5, bend=graded)
    x = mesh.positions[:, 0]
    sets = {"NEAR": np.flatnonzero(x < 1e-9), "FAR": np.flatnonzero(x > 0.3 - 1e-9)}
    markers = {
        name.lower(): {"node": i + 1, "tie": {"type": "distributing", "to": name}}
        for i, name in enumerate(sets)
    }
    body = finite_element_model(pinned(tmp_path, mesh, sets, markers))
    assert_pulls_uniformly(body, 0.1 * (DEPTH if len(size) == 2 else 0.08))


def assert_pulls_uniformly(
    body: FiniteElementModel, area: float, modulus: float = 2.1e11, ratio: float = 0.3
) -> None:
    d = body.dimension
    state = body.positions * np.array([1, -ratio, -ratio])[:d] / modulus
    force = body.stiffness @ state.ravel()
    far, near = body.marker("far"), body.marker("near")
    spread = area * (far.displacement[0] - near.displacement[0]).toarray().ravel()
    assert_allclose(force, spread, atol=1e-9 * np.abs(force).max())


@pytest.mark.parametrize(
    ("degree", "solid"),
    [(1, False), (2, False), (4, False), (1, True), (2, True)],
)
def test_a_tied_side_of_patches_pulls_uniformly(
    tmp_path: Path, degree: int, solid: bool
) -> None:
    """Two patches of unequal height, with graded knots, in plane and space."""
    pairs = {"low": box((0, 1), (0, 0.3)), "high": box((0, 1), (0.3, 0.4))}
    area = 0.04
    if solid:
        ends = ((0, 1), (0, 0.2))
        pairs = {
            "low": box(*ends, (0, 0.3)),
            "high": box(*ends, (0.3, 0.5)),
        }
        area = 0.1
    model = model_of(tmp_path, pairs, 3, ["low.left"], degree)
    data = model.model_dump(mode="json", exclude_none=True)
    data["geometry"]["edges"]["near"] = ["low.left", "high.left"]
    data["discretisation"] = graded_knots(degree, 3 if solid else 2)
    sides = {"near": "near", "far": ["low.right", "high.right"]}
    for i, name in enumerate(sides):
        tie = {"type": "distributing", "to": sides[name]}
        data["markers"][name] = {"node": 10 + i, "tie": tie}
    body = finite_element_model(ModelFile.model_validate_json(json.dumps(data)))
    middle = [1, 0.2, 0] if not solid else [1, 0.1, 0.25]
    assert_allclose(body.marker("far").position, middle, atol=1e-12)
    material = model.material
    assert material is not None
    assert_pulls_uniformly(body, area, material.youngs_modulus, material.poissons_ratio)


def graded_knots(degree: int, count: int) -> dict[str, Any]:
    inner = [0.05, 0.3]
    knots = [0.0] * (degree + 1) + inner + [1.0] * (degree + 1)
    return {"type": "iga", "degrees": [degree] * count, "knots": [knots] * count}


@pytest.mark.parametrize("kind", ["quad4", "hex20"])
def test_points_and_lines_of_nodes(tmp_path: Path, kind: str) -> None:
    """Nodes that span nothing weigh alike, and of a stray node it is said."""
    mesh, bore = bored(kind, 12)
    apart = bore[:: 3 if kind == "quad4" else 17]
    stray = np.append(bore, np.argmax(mesh.positions[:, 0]))
    markers = {
        "a": {"node": 1, "tie": {"type": "distributing", "to": "APART"}},
        "s": {"node": 2, "at": "axis", "tie": {"type": "distributing", "to": "STRAY"}},
    }
    model = pinned(tmp_path, mesh, {"APART": apart, "STRAY": stray}, markers)
    body = finite_element_model(model)
    expected = body.positions[apart].mean(axis=0)
    assert_allclose(body.marker("a").position[: mesh.dimension], expected, atol=1e-12)
    assert_allclose(body.marker("s").position[:2], 0, atol=1e-9 * RADIUS)
    assert only(body, "N137").subject == "marker a"
    idle = only(body, "N138")
    assert idle.subject == "marker s"
    assert idle.data == {"idle": 1, "count": len(stray)}


def test_the_rim_of_a_bore_weighs_by_length(tmp_path: Path) -> None:
    mesh, bore = bored("hex20", 16)
    rim = bore[mesh.positions[bore, 2] > DEPTH * (1 - 1e-9)]
    tie = {"type": "distributing", "to": "RIM"}
    markers = {
        "pin": {"node": 1, "tie": tie},
        "axis": {"node": 2, "at": "axis", "tie": tie},
    }
    body = finite_element_model(pinned(tmp_path, mesh, {"RIM": rim}, markers))
    gap = body.marker("pin").position - [0, 0, DEPTH]
    assert np.linalg.norm(gap) < 1e-3 * RADIUS
    assert_allclose(body.marker("axis").position, [0, 0, DEPTH], atol=1e-9 * RADIUS)
    (place,) = [d for d in with_code(body, "N136") if d.subject == "marker pin"]
    assert 'at = "axis"' in place.remedy


def test_node_sets_that_are_no_cylinder_are_refused(tmp_path: Path) -> None:
    mesh, _ = bored("hex8", 12)
    low = np.flatnonzero(mesh.positions[:, 2] < 1e-9)
    tie = {"type": "rigid", "to": "LOW"}
    marker: dict[str, Any] = {"pin": {"node": 1, "at": "axis", "tie": tie}}
    model = pinned(tmp_path, mesh, {"LOW": low}, marker)
    with pytest.raises(InputError, match=r"pin.at: .* do not determine a cylinder"):
        finite_element_model(model)
    few = np.flatnonzero(np.hypot(*mesh.positions[:, :2].T) < RADIUS * 1.001)
    few = few[mesh.positions[few, 0] > 0.95 * RADIUS]
    with pytest.raises(InputError, match="markers.pin.at: .* less than a sixth"):
        finite_element_model(pinned(tmp_path, mesh, {"LOW": few}, marker))
    del marker["pin"]["tie"]
    with pytest.raises(InputError, match="without a tie"):
        pinned(tmp_path, mesh, {"LOW": low}, marker)


def test_info_prints_where_every_marker_is(tmp_path: Path) -> None:
    mesh, bore = bored("quad8", 16)
    mesh = replace(mesh, positions=mesh.positions + [0.25, -0.125])
    markers = {
        "pin": {"node": 1, "at": "axis", "tie": BORE},
        "corner": {"node": 2, "mesh_node": 1},
    }
    pinned(tmp_path, mesh, {"BORE": bore}, markers)
    path = str(tmp_path / "model.json")
    printed = CliRunner().invoke(cli, ["info", path]).output
    assert "0.25, -0.125, 0" in printed
    x, y = read_nodes(tmp_path)[0]
    assert f"{x:.6g}, {y:.6g}, 0" in printed
    (tmp_path / "part.inp").unlink()
    printed = CliRunner().invoke(cli, ["info", path])
    assert printed.exit_code == 1
    assert "no such file" in str(printed.exception)


def read_nodes(folder: Path) -> Array:
    body = finite_element_model(read_model(folder / "model.json"))
    return body.positions


@pytest.mark.parametrize("kind", ["hex20", "tet4"])
def test_half_bores_rims_and_two_eyes_have_one_axis(tmp_path: Path, kind: str) -> None:
    """Half a turn, half the depth, one rim, and both rims of an eye on one pin."""
    mesh, bore = bored(kind, 12)
    x = mesh.positions[bore]
    half, low = x[:, 1] > -1e-9, x[:, 2] < 1e-9
    parts = {
        "half": ([half], DEPTH / 2),
        "lower": ([x[:, 2] < DEPTH / 2 + 1e-9], DEPTH / 4),
        "rim": ([low], 0.0),
        "eyes": ([low, x[:, 2] > DEPTH - 1e-9], DEPTH / 2),
    }
    for chosen, height in parts.values():
        sets = {f"S{i}": bore[own] for i, own in enumerate(chosen)}
        moved, exact = carried(mesh, np.array([0, 0, height]), 5)
        tie = {"type": "distributing", "to": list(sets)}
        model = pinned(
            tmp_path, moved, sets, {"pin": {"node": 1, "at": "axis", "tie": tie}}
        )
        body = finite_element_model(model)
        assert_allclose(body.marker("pin").position, exact, atol=1e-9 * RADIUS)


def test_a_nearly_round_bore_has_a_note(tmp_path: Path) -> None:
    """A cone, or a slot: its axis is found, and the deviation of the nodes is
    reported.
    """
    mesh, bore = bored("hex8", 12)
    widened = mesh.positions.copy()
    widened[:, :2] *= 1 + 0.01 * widened[:, 2:] / DEPTH
    slot = mesh.positions.copy()
    slot[:, 0] += 0.008 * RADIUS * np.sign(np.round(slot[:, 0], 9))
    for positions in (widened, slot):
        pin = {"pin": {"node": 1, "at": "axis", "tie": BORE}}
        model = pinned(
            tmp_path, replace(mesh, positions=positions), {"BORE": bore}, pin
        )
        body = finite_element_model(model)
        miss = only(body, "N136").data["deviation"]
        assert isinstance(miss, float) and 0.004 * RADIUS < miss < 0.01 * RADIUS
        assert np.abs(body.marker("pin").position - [0, 0, DEPTH / 2]).max() < 2e-5
