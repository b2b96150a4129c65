"""What `info` calls modes and frames, against what they are by their frequencies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.report.sid import boundary_kind, natural_modes

from .elements.test_held_markers import DIRECTIONS, FRAMES, slender

E, G, RHO, LENGTH = 7.0e10, 7.0e10 / 2.6, 2700.0, 0.8
NAMES = {"chord": "chord", "back": "chord", "tangent": "held", "buckens": "free"}


def round_bar(direction: str, frame: str, iz: float = 0.7e-7) -> SID:
    """A bar whose torsion, stretch and bending have other frequencies."""
    data = slender(DIRECTIONS[direction], frame)
    section: dict[str, Any] = {"shape": "general", "area": 1e-3}
    section |= {"iy": 1.2e-7, "iz": iz, "torsion": 0.9e-7}
    data["geometry"]["section"] = section
    data["discretisation"]["elements"] = 16
    data["reduction"] = {"method": "modal", "modes": 9}
    if frame == "tangent":
        data["frame"]["clamp"] = "start"
    return sid_from_model(validate_data(data, ModelFile))


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_torsion_is_called_torsion(direction: str) -> None:
    """The clamped bar: pi c / (2 L) with c^2 = G It / (rho Ip), and E / rho."""
    sid = round_bar(direction, "tangent")
    kinds = {
        mode.kind.split()[0]: mode.frequency for mode in reversed(natural_modes(sid))
    }
    speeds = {"torsion": G * 0.9e-7 / (RHO * 1.9e-7), "axial": E / RHO}
    for kind, square in speeds.items():
        assert kinds[kind] == pytest.approx(np.sqrt(square) / (4 * LENGTH), rel=1e-2)
    assert {mode.kind.split()[0] for mode in natural_modes(sid)} == {
        "torsion",
        "axial",
        "bending",
    }


@pytest.mark.parametrize("rounding", [-1e-13, 1e-13])
def test_bending_of_equal_frequencies_is_along_the_axes(rounding: float) -> None:
    """Whichever of the two rounding makes the lower one, as another processor does."""
    sid = round_bar("x", "tangent", iz=1.2e-7)
    stiffness = sid.Ke.m0.copy()
    stiffness[0, 0] *= 1.0 + rounding
    stiffness[0, 1] = stiffness[1, 0] = 1e-14 * stiffness[0, 0]
    modes = natural_modes(replace(sid, Ke=Taylor(stiffness)))
    assert [mode.kind for mode in modes[:2]] == ["bending y", "bending z"]
    assert modes[0].effective_mass[2] < 1e-9 * modes[0].effective_mass[1]
    assert modes[1].effective_mass[1] < 1e-9 * modes[1].effective_mass[2]


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("direction", ["x", "z", "askew"])
def test_frames_are_named_correctly(direction: str, frame: str) -> None:
    sid = round_bar(direction, frame)
    assert boundary_kind(sid) == NAMES[frame]
    assert sum(mode.kind.startswith("torsion") for mode in natural_modes(sid)) >= 1


def test_a_chord_whose_nodes_have_no_rotation() -> None:
    """As in files of solid elements: psi is zero, the far node moves along only."""
    chord, tangent = (round_bar("y", frame) for frame in ("chord", "tangent"))
    for sid, boundary in ((chord, "chord"), (tangent, "held")):
        assert boundary_kind(without_rotation(sid)) == boundary


def without_rotation(sid: SID) -> SID:
    empty = Taylor(np.zeros((3, sid.nq)))
    nodes = [replace(n, psi=empty, AP=Taylor(np.eye(3))) for n in sid.nodes]
    return replace(sid, nodes=tuple(nodes))
