"""Geometric stiffening: R4's numbers, identities, prestress, the measure."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from sidtool.api.analyses import linearise
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.geometric_stiffening import (
    has_stiffening,
    load_stiffness,
    stiffening_ratio,
)
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, describe
from sidtool.validate import check

from ..beams import DISCRETISATIONS, IGA, beam
from ..models import rod
from ..reduction.test_reduction_methods import METHODS

#: Rotating cantilever, hub radius 0: speed -> frequency, R4.
FLAPPING = {2: 4.137320, 4: 5.585001, 8: 9.256838, 12: 13.170150}
LEAD_LAG = {2: 3.621797, 6: 4.263225}
CLAMP = {"type": "tangent", "marker": "root", "clamp": "left"}


@pytest.fixture(params=DISCRETISATIONS, scope="module")
def cantilever(request: pytest.FixtureRequest) -> SID:
    """One mode; its shape positive at the tip."""
    return sid_from_model(beam(DISCRETISATIONS[request.param], stiffening={}))


@pytest.fixture(params=DISCRETISATIONS, scope="module")
def rotor(request: pytest.FixtureRequest) -> SID:
    """Four modes."""
    reduction = {"method": "modal", "modes": 4}
    settings = DISCRETISATIONS[request.param]
    return sid_from_model(beam(settings, reduction=reduction, stiffening={}))


def test_cantilever_has_the_published_terms(cantilever: SID) -> None:
    """R4, uniform cantilever with L = m = EI = 1, first bending mode."""
    tip = cantilever.node(2)
    assert_allclose(tip.phi.m0[1, 0], 2.0, rtol=5e-3)
    assert_allclose(cantilever.Oe.m1[0, 0, 2], -1 + 1.19334, rtol=5e-3)
    assert_allclose(cantilever.Ct.m1[0, 0], [-1.57088, 0, 0], rtol=5e-3, atol=1e-6)
    assert_allclose(tip.phi.m1[0, :, 0], [-4.64778, 0, 0], rtol=5e-3, atol=1e-6)


def test_the_terms_converge_to_the_slender_beam() -> None:
    """Quadratic splines: at least order 3, down to the finite slenderness."""
    errors = []
    for elements in (8, 16, 32, 64):
        settings = {"type": "iga", "degrees": [2, 2], "elements": [elements, 1]}
        sid = sid_from_model(beam(settings, stiffening={}))
        errors.append(sid.Oe.m1[0, 0, 2] + 1 - 1.19334)
    assert (np.log2(np.array(errors[:-1]) / errors[1:]) > 3).all()
    assert abs(errors[-1]) < 2e-5


def test_the_terms_of_quadrilaterals_converge_quadratically() -> None:
    found = []
    for elements in (25, 50, 100):
        settings = {"type": "q4", "elements": [elements, 2]}
        settings["formulation"] = "incompatible_modes"
        sid = sid_from_model(beam(settings, stiffening={}))
        found.append(sid.Oe.m1[0, 0, 2] + 1)
    steps = np.diff(found)
    assert np.log2(steps[0] / steps[1]) == pytest.approx(2, abs=0.05)
    assert found[2] + steps[1] / 3 == pytest.approx(1.19334, abs=1e-5)


def spinning_frequency(sid: SID, omega: tuple[float, float, float]) -> float:
    stiffness = sid.Ke.m0 + load_stiffness(sid, angular_velocity=omega)
    return float(np.sqrt(scipy.linalg.eigvalsh(stiffness, sid.Me.m0)[0]))


@pytest.mark.parametrize("speed", FLAPPING)
def test_flapping_frequencies(rotor: SID, speed: float) -> None:
    """Spinning about the axis it bends along."""
    found = spinning_frequency(rotor, (0.0, speed, 0.0))
    assert found == pytest.approx(FLAPPING[speed], rel=5e-3)


@pytest.mark.parametrize("speed", LEAD_LAG)
def test_lead_lag_frequencies(rotor: SID, speed: float) -> None:
    """Spinning about the axis across the plane it bends in."""
    found = spinning_frequency(rotor, (0.0, 0.0, speed))
    assert found == pytest.approx(LEAD_LAG[speed], rel=5e-3)


def test_frequencies_converge_with_the_shape_functions() -> None:
    """Fast rotation needs more modes of the beam at rest."""
    errors = []
    for modes in (1, 2, 4):
        reduction = {"method": "modal", "modes": modes}
        sid = sid_from_model(beam(IGA, reduction=reduction, stiffening={}))
        errors.append(spinning_frequency(sid, (0.0, 12.0, 0.0)) / FLAPPING[12] - 1)
    assert errors[0] > 3 * errors[1] > 9 * errors[2] > 0


def test_without_stiffening_the_spinning_beam_grows_unstable() -> None:
    """Only the kinematic softening is left: w^2 = w0^2 - speed^2."""
    sid = sid_from_model(beam(IGA))
    stiffness = sid.Ke.m0 + load_stiffness(sid, angular_velocity=(0, 0, 6.0))
    assert stiffness[0, 0] == pytest.approx(sid.Ke.m0[0, 0] - 36, rel=1e-9)
    assert stiffness[0, 0] < 0


def test_terms_are_symmetric_and_kinematic_terms_untouched() -> None:
    """All stiffening is symmetric in the modes; Ge and the rest of Cr have none."""
    plain, sid = (sid_from_model(rod(**table)) for table in ({}, {"stiffening": {}}))
    for block in (sid.Ct.m1, sid.Oe.m1):
        assert_allclose(block, np.swapaxes(block, 0, 1), atol=1e-9 * abs(block).max())
    for entry in (sid.node(2).phi.m1, sid.node(2).psi.m1):
        assert_allclose(entry, np.swapaxes(entry, 0, 2), atol=1e-9 * abs(entry).max())
    antisymmetric = (sid.Cr.m1 - np.swapaxes(sid.Cr.m1, 0, 1)) / 2
    assert_allclose(antisymmetric, plain.Cr.m1, atol=1e-12 * abs(sid.Cr.m1).max())
    assert np.abs(sid.Cr.m1 + np.swapaxes(sid.Cr.m1, 0, 1)).max() > 0
    for name in ("mdCM", "J", "Me", "Gr", "Ge", "Ke", "ksigma"):
        assert_allclose(getattr(sid, name).m0, getattr(plain, name).m0)
    assert [c.id for c in check(sid) if c.failed] == []


def test_a_hub_adds_the_acceleration_of_the_root(rotor: SID) -> None:
    """On a hub of radius r the root is accelerated by -r w^2: stiffer still.

    Source: Southwell's coefficients; lead-lag, first mode, L = m = EI = 1:
    w^2 = w0^2 + (K0omega - 1 + 1.57088 r) speed^2.
    """
    speed, radius = 1.0, 0.5
    both = rotor.Ke.m0 + load_stiffness(
        rotor,
        angular_velocity=(0, 0, speed),
        acceleration=(-radius * speed**2, 0, 0),
    )
    found = scipy.linalg.eigvalsh(both, rotor.Me.m0)[0]
    slope = 1.19334 - 1 + 1.57088 * radius
    assert found == pytest.approx(3.516015**2 + slope, rel=1e-3)


def test_only_requested_terms_are_written() -> None:
    table = {"acceleration": False, "angular_acceleration": False, "markers": []}
    sid = sid_from_model(beam(IGA, stiffening=table))
    assert sid.Ct.m1 is None and sid.node(2).phi.m1 is None
    assert sid.Oe.m1[0, 0, 2] > 0
    assert has_stiffening(sid)
    assert not has_stiffening(sid_from_model(beam(IGA)))


@pytest.mark.parametrize("method", [m for m in METHODS if m != "user"])
@pytest.mark.parametrize(
    "frame",
    [
        CLAMP,
        {"type": "tangent", "marker": "tip"},
        {"type": "chord", "markers": ["root", "tip"]},
        {"type": "buckens"},
    ],
    ids=lambda frame: frame["type"] + ("" if "clamp" in frame else " free"),
)
def test_stiffened_sids_pass_every_check(method: str, frame: dict[str, Any]) -> None:
    """I1 to I17 with the exceptions of the format document."""
    settings = {"method": method, **METHODS[method]}
    if "interfaces" in settings:
        settings["interfaces"] = ["root", "tip"]
    if method == "krylov":
        settings["frequencies"] = [0.0, 1.7]
    coarse = {**IGA, "elements": [10, 1]}
    model = beam(coarse, frame=frame, reduction=settings, stiffening={})
    assert [(c.id, c.measured) for c in check(sid_from_model(model)) if c.failed] == []


def test_the_ratio_shows_whether_stiffening_matters(rotor: SID) -> None:
    """Near the first frequency it does; at a hundredth of it, it does not."""
    slow = stiffening_ratio(rotor, angular_velocity=(0, 0, 0.0352))
    fast = stiffening_ratio(rotor, angular_velocity=(0, 3.52, 0))
    assert abs(slow) < 1e-3 < 0.5 < fast < 2
    assert stiffening_ratio(rotor) == 0


def test_ratio_of_a_buckling_load_is_minus_one(rotor: SID) -> None:
    """Euler: a cantilever buckles under pi^2 EI / (4 L^2)."""
    load = (-(np.pi**2) / 4, 0.0, 0.0)
    found = stiffening_ratio(rotor, forces={"2": load})
    assert found == pytest.approx(-1, rel=5e-3)


def test_own_weight_buckling_of_a_column(rotor: SID) -> None:
    """Greenhill: a standing column buckles under its weight q L^3 = 7.8373 EI."""
    found = stiffening_ratio(rotor, acceleration=(7.8373, 0, 0))
    assert found == pytest.approx(-1, rel=5e-3)


def tension(value: float) -> dict[str, Any]:
    return {"prestress": {"forces": {"tip": [value, 0.0]}}}


#: Markers that stiffen: all, so that the force of a prestress does, or none.
CARRIERS: list[dict[str, Any]] = [{}, {"markers": ["root"]}, {"markers": []}]


@pytest.mark.parametrize("carriers", CARRIERS)
def test_the_force_of_a_prestress_stiffens_once(carriers: dict[str, Any]) -> None:
    """Pulled by F at the tip: Ke + F phi1 is that of the plain body under F."""
    reduction = {"method": "modal", "modes": 5}
    force = 5.0
    plain = sid_from_model(beam(IGA, reduction=reduction, stiffening={}))
    settings = {**tension(force), **carriers}
    pulled = sid_from_model(beam(IGA, reduction=reduction, stiffening=settings))
    tip = {"2": (force, 0.0, 0.0)}
    stretched = plain.Ke.m0 + load_stiffness(plain, forces=tip)
    expected = scipy.linalg.eigvalsh(stretched, plain.Me.m0)
    found = pulled.Ke.m0 + load_stiffness(pulled, forces=tip)
    assert_allclose(np.linalg.eigvalsh(found), expected, rtol=1e-9)
    in_ke = expected if carriers else np.diag(plain.Ke.m0)
    assert_allclose(np.diag(pulled.Ke.m0), in_ke, rtol=1e-9)
    load = pulled.node(2).phi.m0[0] * force
    assert_allclose(pulled.ksigma.m0[:, 0], load, rtol=1e-6, atol=1e-9)
    assert [c.id for c in check(pulled) if c.failed] == []


def pulled_rod(force: float) -> SceneFile:
    """A cantilever under a force at its tip."""
    table = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": 1.0, "output_step": 1.0},
        "bodies": {"rod": {"sid": "given", "markers": {"root": 1, "tip": 2}}},
        "joints": {"wall": {"type": "fixed", "markers": ["ground", "rod.root"]}},
        "forces": {"pull": {"type": "force", "marker": "rod.tip", "force": [force, 0]}},
    }
    return validate_data(table, SceneFile)


@pytest.mark.parametrize("force", [5.0, 8.0])
def test_a_scene_that_pulls_counts_the_pull_once(force: float) -> None:
    """The same motion with both SIDs, also where the scene pulls otherwise.

    The plain body is longer under the pull, by its modes along the axis; as force
    and stress are linear in them the rest is the same.
    """
    reduction = {"method": "modal", "modes": 5}
    scene = pulled_rod(force)
    found = []
    for stiffening in ({}, tension(5.0)):
        model = beam(IGA, reduction=reduction, stiffening=stiffening)
        modes = linearise(scene, sids={"rod": sid_from_model(model)})
        found.append(modes.frequencies)
    assert_allclose(found[1], found[0], rtol=1e-7)


def test_a_scene_notes_a_prestressed_body() -> None:
    sids = {"rod": sid_from_model(beam(IGA, stiffening=tension(5.0)))}
    system = compile_scene(pulled_rod(5.0), ".", sids)
    assert "body rod: prestressed (ksigma)" in "\n".join(describe(system))


@pytest.mark.parametrize("carriers", CARRIERS[::2])
def test_uniform_prestress_is_that_of_a_pulled_bar(carriers: dict[str, Any]) -> None:
    """Held by a force at the tip; none of it remains in the unloaded bar."""
    area, force = 1e-4, 5.0
    stress = {"prestress": {"stress": [force / area, 0.0, 0.0]}, **carriers}
    reduction = {"method": "modal", "modes": 3}
    plain = sid_from_model(beam(IGA, reduction=reduction, stiffening={}))
    uniform = sid_from_model(beam(IGA, reduction=reduction, stiffening=stress))
    settings = {**tension(force), **carriers}
    pulled = sid_from_model(beam(IGA, reduction=reduction, stiffening=settings))
    assert_allclose(np.diag(uniform.Ke.m0), np.diag(pulled.Ke.m0), rtol=2e-3)
    assert_allclose(uniform.ksigma.m0, pulled.ksigma.m0, rtol=2e-3, atol=1e-9)
    if not carriers:
        assert_allclose(np.diag(uniform.Ke.m0), np.diag(plain.Ke.m0), rtol=1e-9)


def test_a_stress_that_nothing_releases_stays_in_ke() -> None:
    """A beam that its frame clamps at both ends, in tension T: with a^2 - b^2 = T and
    ab the frequency, 2 - 2 cosh a cos b + (a / b - b / a) sinh a sin b = 0."""
    tension = 40.0

    def characteristic(b: float) -> float:
        a = np.sqrt(b * b + tension)
        slope = (a / b - b / a) * np.sinh(a) * np.sin(b)
        return float(2 - 2 * np.cosh(a) * np.cos(b) + slope)

    roots = [brentq(characteristic, *span) for span in ((3.5, 5.0), (6.5, 8.0))]
    expected = [b * b * (b * b + tension) for b in roots]
    string = sid_from_model(
        beam(
            IGA,
            frame={"type": "tangent", "marker": "root", "clamp": ["left", "right"]},
            reduction={"method": "modal", "modes": 6},
            stiffening={"prestress": {"stress": [tension / 1e-4, 0.0, 0.0]}},
        )
    )
    assert_allclose(np.diag(string.Ke.m0)[:2], expected, rtol=2e-3)
    assert_allclose(string.ksigma.m0, 0, atol=1e-9 * tension)


def test_a_prestress_that_buckles_is_refused() -> None:
    with pytest.raises(InputError, match="stiffening.prestress: the body buckles"):
        sid_from_model(beam(IGA, stiffening=tension(-3.0)))


def test_numbers_that_do_not_fit_are_refused() -> None:
    table = {"prestress": {"stress": [1.0, 2.0]}}
    with pytest.raises(InputError, match="prestress.stress: has 2 numbers; expected 3"):
        sid_from_model(beam(IGA, stiffening=table))
    with pytest.raises(InputError, match="stiffening: there is no marker 'hub'"):
        beam(IGA, stiffening={"markers": ["hub"]})


@pytest.mark.parametrize("coupling", ["RBE2", "RBE3"])
def test_weight_of_a_mass_stiffens_as_a_force_there(
    coupling: str, tmp_path: Path
) -> None:
    """Of a body with hardly any mass but one off its face: Ct m1 = m phi m1."""
    mass, count = 0.5, 3
    number = {at: k for k, at in enumerate(np.ndindex(count + 1, 2, 2), 1)}
    cards = [
        f"GRID,{k},,{0.2 * x!r},{0.1 * y!r},{0.1 * z!r}"
        for (x, y, z), k in number.items()
    ]
    for i in range(count):
        corners = [
            str(number[i + x, y, z])
            for z in (0, 1)
            for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))
        ]
        cards.append(
            f"CHEXA,{i + 1},1,{','.join(corners[:6])}\n,{','.join(corners[6:])}"
        )
    root, tip = (
        [str(number[x, y, z]) for y, z in np.ndindex(2, 2)] for x in (0, count)
    )
    cards += [
        "PSOLID,1,1",
        "MAT1,1,2.1+9,,0.3,1.-6",
        "GRID,90,,0.7,0.02,-0.3",
        f"SPC1,1,123,{','.join(root)}",
        f"RBE2,80,90,123456,{','.join(tip)}"
        if coupling == "RBE2"
        else f"RBE3,80,,90,123456,1.,123,{','.join(tip[:2])}\n,{','.join(tip[2:])}",
        f"CONM2,81,90,0,{mass!r}",
    ]
    text = "\n".join(["BEGIN BULK", *cards, "ENDDATA", ""])
    (tmp_path / "part.bdf").write_text(text, encoding="utf-8")
    data = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "mesh", "file": "part.bdf"},
        "discretisation": {"type": "mesh"},
        "frame": {"type": "tangent", "marker": "root", "clamp": "SPC1"},
        "markers": {
            "root": {"node": 1, "mesh_node": 1},
            "end": {"node": 2, "mesh_node": 90},
        },
        "reduction": {"method": "modal", "modes": 5},
        "stiffening": {},
    }
    (tmp_path / "model.json").write_text(json.dumps(data), encoding="utf-8")
    sid = sid_from_model(tmp_path / "model.json")
    expected = mass * np.moveaxis(sid.node(2).phi.m1, 1, 2)
    assert_allclose(sid.Ct.m1, expected, atol=1e-4 * np.abs(expected).max())
