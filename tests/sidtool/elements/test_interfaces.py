"""Markers tied to edges: rigid (RBE2) and distributing (RBE3), plane and solid."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

from sidtool.discretisation.marker_couplings import add_rigid_couplings
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.stress import node_stress
from sidtool.formats.model import ModelFile
from sidtool.formats.model.reduction import Tie
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.validate import check

from ..models import DISCRETISATIONS, rod

RBE2 = {"type": "rigid", "to": "right"}
RBE3 = {"type": "distributing", "to": "right"}


def markers(tie: dict[str, Any], **place: Any) -> dict[str, Any]:
    return {
        "crank_pin": {"node": 1, "edge": "left", "at": 0.5},
        "piston_pin": {"node": 2, "tie": tie, **place},
    }


def block(discretisation: dict[str, Any], tie: dict[str, Any]) -> ModelFile:
    """A solid beam of 1 x 0.1 x 0.2 m."""
    corners = [[[[x, y, z] for z in (0, 0.2)] for y in (0, 0.1)] for x in (0, 1)]
    data = {
        "format": "sidtool model",
        "version": 1,
        "material": {"youngs_modulus": 2.1e11, "poissons_ratio": 0.3, "density": 7850},
        "geometry": {
            "type": "nurbs_volume",
            "degrees": [1, 1, 1],
            "knots": [[0, 0, 1, 1]] * 3,
            "control_points": corners,
        },
        "discretisation": discretisation,
        "frame": {"type": "tangent", "marker": "root", "clamp": "left"},
        "markers": {
            "root": {"node": 1, "edge": "left", "at": [0.5, 0.5]},
            "tip": {"node": 2, "tie": tie},
        },
        "reduction": {
            "method": "craig_bampton",
            "interfaces": ["tip"],
            "modes": 3,
        },
    }
    return validate_data(data, ModelFile)


SOLIDS = {
    "hex20": {"type": "hex20", "elements": [8, 1, 1]},
    "iga": {"type": "iga", "degrees": [2, 2, 2], "elements": [6, 1, 1]},
}


@cache
def bodies() -> dict[str, tuple[FiniteElementModel, str]]:
    found = {}
    for kind, tie in (("rbe2", RBE2), ("rbe3", RBE3)):
        for name, settings in DISCRETISATIONS.items():
            model = rod(settings, markers=markers(tie))
            found[f"{kind} {name}"] = (finite_element_model(model), "piston_pin")
        for name, settings in SOLIDS.items():
            found[f"{kind} solid {name}"] = (
                finite_element_model(block(settings, tie)),
                "tip",
            )
    return found


@pytest.mark.parametrize("name", bodies())
def test_a_rigid_motion_arrives_at_the_marker(name: str) -> None:
    """Displacement and rotation of the marker are those of the motion."""
    body, marker_name = bodies()[name]
    marker = body.marker(marker_name)
    rigid = body.rigid_body_modes(marker.position)
    rows = np.vstack([marker.displacement @ rigid, marker.rotation @ rigid])
    which = [0, 1, 5] if body.dimension == 2 else list(range(6))
    assert_allclose(rows[which], np.eye(len(which)), atol=1e-10)


@pytest.mark.parametrize("name", bodies())
def test_a_load_at_the_marker_keeps_its_resultant(name: str) -> None:
    """Spread over the nodes: the same force and moment about the marker."""
    body, marker_name = bodies()[name]
    marker = body.marker(marker_name)
    rigid = body.rigid_body_modes(marker.position)
    which = [0, 1, 5] if body.dimension == 2 else list(range(6))
    rows = sp.vstack([marker.displacement, marker.rotation]).tocsr()[which]
    assert_allclose(rigid.T @ rows.T.toarray(), np.eye(len(which)), atol=1e-10)


@pytest.mark.parametrize("name", DISCRETISATIONS)
def test_the_marker_sits_at_the_centre_of_its_edge(name: str) -> None:
    for tie in (RBE2, RBE3):
        body = finite_element_model(rod(DISCRETISATIONS[name], markers=markers(tie)))
        assert_allclose(body.marker("piston_pin").position, [1, 0, 0], atol=1e-12)
    placed = markers(RBE3, position=[1.0, 0.02])
    body = finite_element_model(rod(DISCRETISATIONS[name], markers=placed))
    assert_allclose(body.marker("piston_pin").position, [1, 0.02, 0], atol=1e-12)


@pytest.mark.parametrize("name", DISCRETISATIONS)
def test_the_mean_of_an_edge_is_that_of_its_length(name: str) -> None:
    """A displacement y^2 on an edge of height h: its mean is h^2 / 12."""
    body = finite_element_model(rod(DISCRETISATIONS[name], markers=markers(RBE3)))
    height = 0.06
    y = body.positions[:, 1]
    field = np.zeros((len(y), 2))
    surface = body.surface(("right",))
    assert surface is not None
    metric = surface.mass
    nodes = body.node_sets["right"]
    field[:, 0] = y**2
    mean = metric.sum(axis=0) @ field[:, 0] / metric.sum()
    found = body.marker("piston_pin").displacement @ field.ravel()
    assert_allclose(found[0], float(np.ravel(mean)[0]), rtol=1e-12)
    assert metric.sum() == pytest.approx(height)
    assert metric[nodes][:, nodes].nnz == metric.nnz


@pytest.mark.parametrize("name", DISCRETISATIONS)
def test_a_rigid_tie_keeps_its_edge_rigid(name: str) -> None:
    """Every shape function moves the edge as one piece; stiffer than a soft tie."""
    frequencies = []
    for tie in (RBE2, RBE3):
        model = rod(DISCRETISATIONS[name], markers=markers(tie))
        body = finite_element_model(model)
        sid = sid_from_model(model)
        assert [c.id for c in check(sid) if c.failed] == []
        frequencies.append(np.diag(sid.Ke.m0))
        if tie is RBE2:
            assert_rigid(body, model)
    assert (frequencies[0] >= frequencies[1] * (1 - 1e-9)).all()


def assert_rigid(body: FiniteElementModel, model: ModelFile) -> None:
    from sidtool.reduction.body_frames import FRAMES
    from sidtool.reduction.methods import REDUCTIONS

    frame = FRAMES["tangent"](body, model.frame)
    basis = REDUCTIONS["modal"](body, frame, model.reduction)
    dofs = body.dofs(body.node_sets["right"])
    marker = body.marker("piston_pin")
    rigid = body.rigid_body_modes(marker.position)[dofs]
    motion = np.vstack([marker.displacement[:2] @ basis.shapes])
    turning = marker.rotation[2:] @ basis.shapes
    expected = rigid @ np.vstack([motion, turning])
    assert_allclose(basis.shapes[dofs], expected, atol=1e-9 * abs(basis.shapes).max())


@pytest.mark.parametrize("tie", ["rigid", "distributing"])
@pytest.mark.parametrize("name", SOLIDS)
def test_solids_have_six_interface_coordinates(name: str, tie: str) -> None:
    """Craig-Bampton on a tied face: three displacements, three rotations, modes."""
    sid = sid_from_model(block(SOLIDS[name], {"type": tie, "to": "right"}))
    assert sid.nq == 9
    assert [(c.id, c.measured) for c in check(sid) if c.failed] == []
    tip = sid.node(2)
    motion = np.vstack([tip.phi.m0, tip.psi.m0])
    assert np.linalg.matrix_rank(motion, tol=1e-6) == 6
    compliance = motion @ np.linalg.solve(sid.Ke.m0, motion.T)
    inertia = 0.2 * 0.1**3 / 12
    assert compliance[1, 1] == pytest.approx(1 / (3 * 2.1e11 * inertia), rel=0.25)


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_have_stress_and_stiffening(name: str) -> None:
    """A lift F at the tip: F (L - x) h / (2 I) half-way on the upper face."""
    lift = {"method": "attachment", "interfaces": ["tip"], "modes": 2}
    model = block(SOLIDS[name], {"type": "distributing", "to": "right"})
    data: Any = model.file_data()
    data["markers"]["upper"] = {"node": 3, "edge": "top", "at": [0.5, 0.5]}
    data |= {"reduction": lift, "stress": {"peak_points": 3}, "stiffening": {}}
    sid = sid_from_model(validate_data(data, ModelFile))
    assert [(c.id, c.measured) for c in check(sid) if c.failed] == []
    q = np.linalg.solve(sid.Ke.m0, sid.node(2).phi.m0[1])
    upper = -0.5 * 0.05 / (0.2 * 0.1**3 / 12)
    assert node_stress(sid, 3, q)[0] == pytest.approx(upper, rel=0.05)
    assert sid.Oe.m1[0, 0, 2] > -1


def test_ties_that_do_not_work_are_refused() -> None:
    wrong = markers({"type": "rigid", "to": "nowhere"})
    with pytest.raises(InputError, match="tie.to: there is no edge 'nowhere'"):
        rod(DISCRETISATIONS["q4"], markers=wrong)
    body = finite_element_model(rod(DISCRETISATIONS["q4"]))
    point = FiniteElementModel(
        body.positions,
        body.scalar_mass,
        body.stiffness,
        {"dot": np.array([7])},
        body.markers,
    )
    model = rod(DISCRETISATIONS["q4"], markers=markers(RBE3))
    tie = Tie(type="distributing", to="dot")
    marker = model.markers["piston_pin"].model_copy(update={"tie": tie})
    both = {**model.markers, "piston_pin": marker}
    with pytest.raises(InputError, match="do not determine how the marker turns"):
        add_rigid_couplings(point, model.model_copy(update={"markers": both}))


def test_a_rigid_piece_that_is_clamped_in_part_is_refused() -> None:
    """The upper edge shares a corner with the clamped left one."""
    table = markers({"type": "rigid", "to": "top"})
    with pytest.raises(InputError, match="piston_pin is held or tied in part"):
        sid_from_model(rod(DISCRETISATIONS["q4"], markers=table))
