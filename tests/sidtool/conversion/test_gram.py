"""The Gram matrix against sums over particles and against quadrature by definition."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose

from sidtool.conversion.inertia_integrals import inertia_blocks, mass_moments
from sidtool.formats.base.sid import OE_INDICES, Taylor, by_mode, symmetric_3x3
from sidtool.formats.sid_mass import skew
from sidtool.geometry.nurbs_patch import patch_from_model, point_basis, refine_patch
from sidtool.isogeometric.iga import target_knots
from sidtool.pipeline.model_to_sid import assembled_sid, finite_element_model
from sidtool.reduction.body_frames import FRAMES
from sidtool.reduction.methods import REDUCTIONS

from ..models import rod


def definitions(weights: np.ndarray, c: np.ndarray, phi: np.ndarray) -> dict:
    """Every block as a sum over points; c (n, 3), phi (n, nq, 3)."""
    units = np.eye(3)
    cs, ps = skew(c), skew(phi)
    w = weights
    products = [np.outer(units[a], units[b]) for a, b in OE_INDICES]
    omega = [p - units for p in products[:3]] + [p + p.T for p in products[3:]]
    blocks = {
        "mdCM": (w @ c)[:, None],
        "J": -np.einsum("p,pab,pbc->ac", w, cs, cs),
        "Ct": np.einsum("p,pla->la", w, phi),
        "Cr": np.einsum("p,pla->la", w, np.cross(c[:, None], phi)),
        "Me": np.einsum("p,pia,pla->il", w, phi, phi),
        "Gr": -2 * np.einsum("p,pab,plbc->lac", w, cs, ps),
        "Ge": -2 * np.einsum("p,pia,plab->lib", w, phi, ps),
        "Oe": np.stack(
            [np.einsum("p,pia,ab,pb->i", w, phi, k, c) for k in omega], axis=1
        ),
    }
    first = {
        "mdCM": np.einsum("p,pla->la", w, phi)[:, :, None],
        "J": -np.einsum("p,pab,plbc->lac", w, cs, ps)
        - np.einsum("p,plab,pbc->lac", w, ps, cs),
        "Cr": np.einsum("p,plab,pib->lia", w, ps, phi),
        "Oe": np.stack(
            [np.einsum("p,pia,ab,plb->li", w, phi, k, phi) for k in omega], axis=2
        ),
    }
    return {name: (blocks[name], first.get(name)) for name in blocks}


def assert_defined(blocks: dict[str, Taylor], expected: dict, nq: int) -> None:
    for name, (m0, m1) in expected.items():
        found0, found1 = blocks[name].m0, blocks[name].m1
        if name == "J":
            found0 = symmetric_3x3(found0[:, 0])
            found1 = symmetric_3x3(found1[..., 0])
        if name in ("Gr", "Ge"):
            found0 = by_mode(found0, nq)
        scale = max(np.abs(m0).max(initial=0), 1e-1)
        assert_allclose(found0, m0, rtol=0, atol=1e-12 * scale, err_msg=name)
        assert (m1 is None) == (found1 is None), name
        if m1 is not None:
            scale = max(np.abs(m1).max(initial=0), 1e-1)
            assert_allclose(
                found1, m1, rtol=0, atol=1e-12 * scale, err_msg=f"{name} m1"
            )


@given(
    seed=st.integers(0, 10**6), nq=st.integers(0, 4), dimension=st.sampled_from([2, 3])
)
@settings(max_examples=30)
def test_particles(seed: int, nq: int, dimension: int) -> None:
    """A diagonal mass matrix is a cloud of particles: sums by definition."""
    random = np.random.default_rng(seed)
    w = random.uniform(0.1, 2, 30)
    c = random.normal(size=(30, dimension))
    phi = random.normal(size=(30, dimension, nq))
    blocks = inertia_blocks(mass_moments(sp.csr_matrix(sp.diags_array(w)), c, phi))
    pad = 3 - dimension
    c = np.pad(c, ((0, 0), (0, pad)))
    phi = np.pad(np.swapaxes(phi, 1, 2), ((0, 0), (0, 0), (0, pad)))
    assert_defined(blocks, definitions(w, c, phi), nq)


@pytest.fixture(scope="module")
def settings() -> dict:
    return {"type": "iga", "degrees": [3, 2], "elements": [6, 2]}


def test_rod_against_quadrature_of_the_definitions(settings: dict) -> None:
    """Shape functions evaluated point by point, integrated with more Gauss points."""
    model = rod(settings)
    body = finite_element_model(model)
    frame = FRAMES["tangent"](body, model.frame)
    basis = REDUCTIONS["modal"](body, frame, model.reduction)
    exact = patch_from_model(model.geometry)
    patch = refine_patch(exact, (3, 2), target_knots(model.discretisation, exact))
    x, g = np.polynomial.legendre.leggauss(8)
    u = ((np.arange(6)[:, None] + (x + 1) / 2) / 6).ravel()
    v = ((np.arange(2)[:, None] + (x + 1) / 2) / 2).ravel()
    weights, points, fields = [], [], []
    for ui, gu in zip(u, np.tile(g / 12, 6), strict=True):
        for vi, gv in zip(v, np.tile(g / 4, 2), strict=True):
            at = point_basis(patch, [ui, vi])
            jacobian = patch.points[at.nodes].T @ at.gradients
            weights.append(78.5 * gu * gv * np.linalg.det(jacobian))
            points.append(at.values @ patch.points[at.nodes])
            shapes = basis.shapes.reshape(-1, 2, 5)[at.nodes]
            fields.append(np.einsum("n,nal->la", at.values, shapes))
    c = np.pad(np.array(points), ((0, 0), (0, 1)))
    phi = np.pad(np.array(fields), ((0, 0), (0, 0), (0, 1)))
    sid = assembled_sid(body, frame, basis)
    assert sid.mass == pytest.approx(np.sum(weights), rel=1e-13)
    assert_defined(sid.blocks, definitions(np.array(weights), c, phi), 5)
