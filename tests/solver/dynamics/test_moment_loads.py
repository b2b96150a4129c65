"""Beams under moments: the stiffness that psi m1 of a converted body brings in."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

from sidtool.formats.base.sid import SID, Array, Taylor
from sidtool.formats.geometric_stiffening import load_stiffness
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, linearise as natural_modes, static_equilibrium
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import linearise
from tests.solver.scenes import Probe, scene

#: Bar of a rectangular section, free of Poisson's effect.
LENGTH, HEIGHT, WIDTH, YOUNG = 2.0, 0.1, 0.05, 2e6


def model(
    geometry: Any, mesh: Any, clamp: str, at: Any, **material: float
) -> ModelFile:
    """A stiffened body that is clamped at one edge and loaded at its opposite."""
    opposite = {"left": "right", "bottom": "top"}[clamp]
    data = {
        "format": "sidtool model",
        "version": 1,
        "title": "Beam",
        "material": {"poissons_ratio": 0.0, "density": 1e3, **material},
        "geometry": geometry,
        "discretisation": {"type": "iga", **mesh},
        "frame": {"type": "tangent", "marker": "root", "clamp": clamp},
        "markers": {
            "root": {"node": 1, "edge": clamp, "at": at},
            "tip": {"node": 2, "edge": opposite, "at": at},
        },
        "reduction": {"method": "attachment", "interfaces": ["tip"], "modes": 3},
        "stiffening": {},
    }
    return validate_data(data, ModelFile)


@cache
def arc() -> SID:
    """A thick quarter of a ring, radii 1 and 2, clamped at the foot."""
    w = np.sqrt(0.5)
    geometry = {
        "type": "nurbs",
        "degrees": [1, 2],
        "knots": [[0, 0, 1, 1], [0, 0, 0, 1, 1, 1]],
        "control_points": [[[r, 0.0], [r, r], [0.0, r]] for r in (1.0, 2.0)],
        "weights": [[1, w, 1], [1, w, 1]],
        "thickness": 0.1,
    }
    mesh = {"degrees": [3, 3], "elements": [3, 6]}
    return sid_from_model(model(geometry, mesh, "bottom", 0.5, youngs_modulus=1e3))


@cache
def bar(tie: str | None = None) -> SID:
    """A straight bar along x, higher (y) than wide (z), its tip a point or tied."""
    points = [
        [
            [[x, y, z] for z in (-WIDTH / 2, WIDTH / 2)]
            for y in (-HEIGHT / 2, HEIGHT / 2)
        ]
        for x in (0.0, LENGTH)
    ]
    geometry = {
        "type": "nurbs_volume",
        "degrees": [1, 1, 1],
        "knots": [[0, 0, 1, 1]] * 3,
        "control_points": points,
    }
    mesh = {"degrees": [3, 2, 2], "elements": [8, 2, 2]}
    body = model(geometry, mesh, "left", [0.5, 0.5], youngs_modulus=YOUNG)
    if tie is None:
        return sid_from_model(body)
    data = body.model_dump(mode="json", exclude_unset=True)
    data["markers"]["tip"] = {"node": 2, "tie": {"type": tie, "to": "right"}}
    data["reduction"]["modes"] = 10
    return sid_from_model(validate_data(data, ModelFile))


def held(sid: SID, torque: Any, dimension: str) -> System:
    """The body on the ground, a moment at its tip."""
    described = scene(
        {"beam": {"sid": "-", "markers": {"root": 1, "tip": 2}}},
        {"clamp": {"type": "fixed", "markers": ["ground", "beam.root"]}},
        forces={"twist": {"type": "force", "marker": "beam.tip", "torque": torque}},
        record=["beam.q*"],
        dimension=dimension,
    )
    return compile_scene(described, sids={"beam": sid}, keep_joints=True)


def test_a_moment_stiffens_a_planar_body() -> None:
    """Frequencies and deflection of Ke + the stiffness of the moment.

    The clamp bears the same moment, which does nothing: it cannot turn. For the
    frequencies initial stresses balance the moment, so that the undeformed body rests.
    """
    sid = arc()
    assert sid.node("1").psi.m1 is None
    unit = load_stiffness(sid, moments={"2": (0, 0, 1.0)})
    ratios = scipy.linalg.eigh(unit, sid.Ke.m0, eigvals_only=True)
    torque = -0.3 / ratios[0]
    system = held(sid, torque, "planar")
    stiffness = sid.Ke.m0 + torque * unit
    rest = np.zeros(system.n_velocities)
    start = np.zeros(system.n_positions)
    stressed = replace(sid, ksigma=Taylor(torque * sid.node("2").psi.m0[2][:, None]))
    modes = natural_modes(held(stressed, torque, "planar"), state=(start, rest))
    squares = scipy.linalg.eigh(stiffness, sid.Me.m0, eigvals_only=True)
    exact = np.sqrt(squares) / (2 * np.pi)
    assert modes.frequencies == pytest.approx(exact, rel=1e-6)
    without = scipy.linalg.eigh(sid.Ke.m0, sid.Me.m0, eigvals_only=True)
    assert np.abs(np.sqrt(squares / without) - 1).max() > 0.04
    found = static_equilibrium(system).result()
    q = np.linalg.solve(stiffness, torque * sid.node("2").psi.m0[2])
    assert_allclose(found.values[0], q, rtol=1e-8, atol=1e-12)


def tangent(system: System) -> tuple[Array, Array]:
    """Stiffness of the elastic coordinates at rest: by kernel, and by differences."""
    probe = Probe(system, 0.0, _origin(system), np.zeros(system.n_velocities))
    row, work = system.arrays.body[-1], probe.work
    rest = np.zeros(system.n_velocities)
    linearise(system, work, 0.0, probe.z, rest, rest, np.zeros(system.n_rows))
    kept = slice(row[at.VEL] + row[at.RD], row[at.VEL] + row[at.NV])
    kernel = probe.blocks(work.Rp)[kept, kept].copy()
    columns = []
    for k in range(kept.start, kept.stop):
        step = 1e-4 * np.eye(system.n_velocities)[k]
        ends = []
        for sign in (1.0, -1.0):
            probe.evaluate(probe.moved(sign * step), probe.v)
            ends.append(work.f[kept].copy())
        columns.append((ends[1] - ends[0]) / 2e-4)
    return kernel, np.column_stack(columns)


def _origin(system: System) -> Array:
    """The undeformed body in the ground's axes."""
    z = np.zeros(system.n_positions)
    z[3] = 1.0
    return z


def test_a_moment_buckles_a_bar_sideways() -> None:
    """Under an end moment about z a cantilever swings out and twists.

    Of a moment whose axis halves the turning of the bar (semitangential), the symmetric
    part of any dead moment, the critical one is pi sqrt(EI GJ) / L.

    Source: J. H. Argyris et al., "On large displacement-small strain analysis of
    structures with rotational degrees of freedom", Comput. Methods Appl. Mech. Eng. 14
    (1978); GJ of a rectangle by Saint-Venant's series.
    """
    sid = bar()
    system = held(sid, [0.0, 0.0, 1.0], "spatial")
    kernel, exact = tangent(system)
    extra = kernel - sid.Ke.m0
    scale = np.abs(extra).max()
    assert_allclose(
        extra, load_stiffness(sid, moments={"2": (0, 0, 1.0)}), atol=1e-9 * scale
    )
    assert_allclose((exact + exact.T) / 2, kernel, atol=1e-6 * np.abs(kernel).max())
    critical = critical_moment()
    ratios = scipy.linalg.eigh(extra, sid.Ke.m0, eigvals_only=True)
    assert -1 / ratios[0] == pytest.approx(critical, rel=1e-2)
    assert 1 / ratios[-1] == pytest.approx(critical, rel=1e-2)


def critical_moment() -> float:
    """pi sqrt(EI GJ) / L of the bar [N m]."""
    a, b = HEIGHT, WIDTH
    series = sum(np.tanh(n * np.pi * a / (2 * b)) / n**5 for n in range(1, 20, 2))
    torsion = a * b**3 / 3 * (1 - 192 * b / (np.pi**5 * a) * series)
    return float(np.pi / LENGTH * YOUNG * np.sqrt(a * b**3 / 12 * torsion / 2))


@pytest.mark.parametrize("tie", ["rigid", "distributing"])
def test_a_moment_at_a_tie_buckles_a_bar_sideways(tie: str) -> None:
    """The same critical moment at an end that is tied.

    A little above: the clamp, and a rigid tie, keep their ends from warping.
    """
    sid = bar(tie)
    unit = load_stiffness(sid, moments={"2": (0, 0, 1.0)})
    ratios = scipy.linalg.eigh(unit, sid.Ke.m0, eigvals_only=True)
    assert -1 / ratios[0] == pytest.approx(critical_moment(), rel=1.5e-2)
    assert 1 / ratios[-1] == pytest.approx(critical_moment(), rel=1.5e-2)
