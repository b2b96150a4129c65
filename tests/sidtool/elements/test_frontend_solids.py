"""Solid elements: exact fields, the founding rod, and meshes that must be refused."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.elements.markers import MeshPoints
from sidtool.elements.solid_elements import elasticity
from sidtool.elements.solid_mesh import mesh_matrices
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import Material, ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.geometry.nurbs_patch import patch_from_model
from sidtool.isogeometric.sampled_patch import sampled_volume
from sidtool.mesh.mesh import ElementBlock, Mesh, check_mesh, without_free_nodes
from sidtool.mesh.reference_elements import ELEMENT_KINDS, reference_element, shape_of
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.validate import check

from ..bodies import BEAMS, SOLIDS, beam, volume, volume_data

STEEL = Material(youngs_modulus=2.1e11, poissons_ratio=0.3, density=7850.0)


def single(kind: str, seed: int = 0) -> Mesh:
    """One slightly distorted element; edges stay straight."""
    element = reference_element(kind)
    random = np.random.default_rng(seed)
    corners = element.nodes[: element.corners]
    moved = corners + random.uniform(-0.1, 0.1, corners.shape)
    linear = next(k for k in ELEMENT_KINDS if shape_of(k) == shape_of(kind))
    values, _ = reference_element(linear).at(element.nodes)
    block = ElementBlock(kind, np.arange(len(element.nodes))[None], np.array([1]))
    return Mesh(values @ moved, (block,))


def state(kind: str) -> str:
    return "solid" if reference_element(kind).dimension == 3 else "plane_stress"


@pytest.mark.parametrize("kind", ELEMENT_KINDS)
def test_shape_functions(kind: str) -> None:
    element = reference_element(kind)
    values, gradients = element.at(element.nodes)
    assert_allclose(values, np.eye(len(element.nodes)), atol=1e-13)
    assert_allclose(gradients.sum(axis=1), 0, atol=1e-12)


@pytest.mark.parametrize("relieved", [False, True])
@pytest.mark.parametrize("kind", ELEMENT_KINDS)
def test_patch_test_of_one_distorted_element(kind: str, relieved: bool) -> None:
    """Energy of a linear field is exact; rigid motion costs nothing."""
    mesh = single(kind)
    d = mesh.dimension
    mass, k = mesh_matrices(
        mesh, {None: STEEL}, state(kind), incompatible_modes=relieved
    )
    slope = np.random.default_rng(1).normal(size=(d, d))
    u = (mesh.positions @ slope.T).ravel()
    pairs = ((0, 1),) if d == 2 else ((0, 1), (1, 2), (0, 2))
    strain = [slope[i, i] for i in range(d)]
    strain += [slope[i, j] + slope[j, i] for i, j in pairs]
    size = mass.sum() / STEEL.density
    energy = size * np.array(strain) @ elasticity(STEEL, state(kind)) @ strain
    assert u @ k @ u == pytest.approx(energy, rel=1e-11)
    spin = (mesh.positions @ (slope - slope.T)).ravel()
    assert abs(spin @ k @ spin) <= 1e-11 * energy
    rank = np.linalg.matrix_rank(k.toarray(), tol=1e-9 * k.max())
    assert rank == k.shape[0] - d * (d + 1) // 2


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet4", "tet10"])
def test_sampled_volumes_fill_the_rod(kind: str) -> None:
    patch = patch_from_model(volume(SOLIDS["hex20"]).geometry)
    errors = []
    for n in (4, 8):
        mesh = sampled_volume(patch, (n, 2, 1), kind)
        check_mesh(mesh)
        mass, _ = mesh_matrices(mesh, {None: STEEL}, "solid")
        errors.append(abs(mass.sum() / 3.14 - 1))
    if kind in ("hex20", "tet10"):
        assert max(errors) < 1e-12
    else:
        assert errors[0] / errors[1] == pytest.approx(4, rel=1e-6)


@pytest.fixture(scope="module")
def frequencies() -> dict[str, np.ndarray]:
    models = {name: volume(settings) for name, settings in SOLIDS.items()}
    models |= {name: beam(settings) for name, settings in BEAMS.items()}
    result = {}
    for name, model in models.items():
        sid = sid_from_model(model)
        failed = [
            c.id for c in check(sid) if c.verdict == "failed" and c.severity == "error"
        ]
        assert not failed, name
        result[name] = np.sqrt(np.diag(sid.Ke.m0)) / (2 * np.pi)
    return result


def test_the_rod_in_three_dimensions(frequencies: dict[str, np.ndarray]) -> None:
    """In-plane modes near plane stress; the others only a solid or a beam has."""
    inplane = {name: f[[1, 4]] for name, f in frequencies.items()}
    for name in ("hex8", "hex20", "tet10", "iga"):
        assert_allclose(inplane[name], [31.475, 199.12], rtol=4e-3, err_msg=name)
        assert (inplane[name] > [31.475, 199.12]).all() or name == "hex8"
    # Euler and Bernoulli leave shear out: too stiff, and more so at shorter waves.
    for name in ("timoshenko", "lumped"):
        assert_allclose(inplane[name], [31.475, 199.12], rtol=4e-3, err_msg=name)
    excess = inplane["beam"] / inplane["timoshenko"] - 1
    assert 0 < excess[0] < excess[1] < 0.01
    for name in ("hex20", "iga", "timoshenko"):
        assert_allclose(frequencies[name], frequencies["iga"], rtol=2.5e-2)


def test_conforming_refinement_lowers_the_frequencies() -> None:
    settings = [{"type": "hex20", "elements": [n, 1, 1]} for n in (4, 8, 16)]
    found = [np.diag(sid_from_model(volume(s, 3)).Ke.m0) for s in settings]
    for coarse, fine in pairwise(found):
        assert (fine < coarse).all()


@pytest.mark.parametrize("name", ["hex8", "tet10"])
def test_marker_rows_follow_a_turning_body(name: str) -> None:
    body = finite_element_model(volume(SOLIDS[name]))
    rigid = body.rigid_body_modes()
    for marker in body.markers:
        x, y, z = marker.position
        arm = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
        expected = np.hstack([np.eye(3), arm])
        assert_allclose(marker.displacement @ rigid, expected, atol=1e-12)
        turn = np.hstack([np.zeros((3, 3)), np.eye(3)])
        assert_allclose(marker.rotation @ rigid, turn, atol=1e-10)


def test_a_point_outside_the_mesh_is_named() -> None:
    with pytest.raises(InputError, match="lies in no element.*nearest node"):
        MeshPoints(single("hex8")).rows("far", 1, [3.0, 0.0, 0.0])


def bent(mesh: Mesh, **changes: Any) -> Mesh:
    return replace(mesh, **changes)


def test_bad_meshes_are_refused() -> None:
    good = single("hex8")
    (block,) = good.blocks
    upside = replace(block, nodes=block.nodes[:, [4, 5, 6, 7, 0, 1, 2, 3]])
    twice = replace(block, nodes=np.where(block.nodes == 3, 2, block.nodes))
    flat = good.positions * [1, 1, 0]
    folded = good.positions.copy()
    folded[6] = [0.2, 0.2, 0.2]
    shifted = replace(block, nodes=block.nodes + 8, labels=block.labels + 1)
    apart = np.vstack([good.positions, good.positions + 5])
    cases = {
        "is inverted": bent(good, blocks=(upside,)),
        "uses a node twice": bent(good, blocks=(twice,)),
        "has no volume": bent(good, positions=flat),
        "is folded": bent(good, positions=folded),
        "2 unconnected parts": bent(good, positions=apart, blocks=(block, shifted)),
        "belong to no element": bent(good, positions=apart),
    }
    for message, mesh in cases.items():
        with pytest.raises(InputError, match=message):
            check_mesh(mesh)
    check_mesh(without_free_nodes(cases["belong to no element"]))


@pytest.mark.parametrize("kind", ["hex8", "tet4"])
def test_locking_elements_are_refused(kind: str) -> None:
    settings: dict[str, Any] = {"type": kind, "elements": [4, 1, 1]}
    if kind == "hex8":
        settings["formulation"] = "full_integration"
    data = volume_data(settings)
    data["material"]["poissons_ratio"] = 0.4999
    with pytest.raises(InputError, match="makes .* elements lock") as caught:
        finite_element_model(validate_data(data, ModelFile))
    assert caught.value.place == "material.poissons_ratio"


@pytest.mark.parametrize("name", ["hex8", "hex20", "iga"])
def test_nearly_incompressible_rod(name: str) -> None:
    """Bending at constant volume: f1 changes by little from nu = 0.3 to 0.4999."""
    data = volume_data(SOLIDS[name], 2)
    data["material"]["poissons_ratio"] = 0.4999
    sid = sid_from_model(validate_data(data, ModelFile))
    first = np.sqrt(sid.Ke.m0[1, 1]) / (2 * np.pi)
    assert first == pytest.approx(31.5, rel=0.02)


def needles(aspect: float) -> dict[str, Any]:
    """A cantilever of eight hexahedra, each so many times longer than it is thick."""
    data = volume_data({**SOLIDS["hex8"], "elements": [8, 1, 1]}, 1)
    h = 0.125 / aspect
    data["geometry"] |= {
        "degrees": [1, 1, 1],
        "knots": [[0, 0, 1, 1]] * 3,
        "control_points": [
            [[[x, y, z] for z in (-h / 2, h / 2)] for y in (-h, h)] for x in (0.0, 1.0)
        ],
    }
    return data


def test_needles() -> None:
    """Needles bend freely (eight elements leave 2.5 %) until rounding is in the way."""
    sid = sid_from_model(validate_data(needles(100), ModelFile))
    h = 0.125 / 100
    wave = 3.516015**2 * 2.1e11 * h**2 / 12 / 7850.0
    assert wave < sid.Ke.m0[0, 0] < 1.03 * wave
    with pytest.raises(InputError, match="lost in the rounding"):
        sid_from_model(validate_data(needles(1000), ModelFile))
