"""One beam element reduced to its upper end, of the tests of E. Branlard's welib.

Bending in one plane; the lower end is free, or on a pin. One cubic element has closed
forms: pinned and with its upper end held sqrt(420 EI / (m L^4)) / 2 pi.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sidtool
from sidtool.formats.base.sid import SID

from .slender import AT_END, AT_START, BOTH_ENDS, beam, hertz, scene

LENGTH, STIFFNESS, MASS = 100.0, 1868211939147.334, 8828.201296825122  # m, N m^2, kg/m
#: Of the source [kg], [Hz].
WHOLE_MASS = 882820.12968
END_HELD = (0.817914, 8.058651)
PINNED = 5.304894
PINNED_END_HELD = 4.74484
pytestmark = pytest.mark.filterwarnings("ignore:Young's modulus")

#: So stiff [Pa] that the section is small: no rotary inertia, as in the source.
YOUNG = 2.1e17
CONSTRAINT_AND_MODES = {"method": "craig_bampton", "interfaces": ["start", "end"]}


def element(frame: dict[str, Any], reduction: dict[str, Any]) -> SID:
    second = STIFFNESS / YOUNG
    section = {"area": MASS / 7850.0, "iy": second, "iz": second}
    tables = {"frame": frame, "reduction": reduction}
    return beam(LENGTH, section, (YOUNG, 0.3, 7850.0), 1, tables)


def end_held() -> tuple[float, ...]:
    """Modes with the upper end held and the lower end free [Hz]."""
    frequencies = hertz(element(AT_END, {"method": "modal", "modes": 4}))
    return float(frequencies[0]), float(frequencies[2])


def static_mode(folder: Path) -> float:
    """The frequency of the constraint mode, with the lower end on a pin [Hz].

    Turning the upper end turns the lower one by half of it, backwards.
    """
    turned = np.zeros((12, 1))
    turned[5], turned[11] = -0.5, 1.0
    np.save(folder / "turned.npy", turned)
    shape = {"method": "user", "file": str(folder / "turned.npy")}
    return _lowest(element(BOTH_ENDS, shape), {"start": "revolute"})


def pinned_and_held() -> float:
    """A pin at the lower end, the upper end held [Hz]."""
    whole = element(AT_START, CONSTRAINT_AND_MODES)
    return _lowest(whole, {"start": "revolute", "end": "fixed"})


def _lowest(sid: SID, joints: dict[str, str]) -> float:
    """Other than that of a rigid motion."""
    held = {
        end: {"type": kind, "markers": [f"ground.{end}", f"beam.{end}"]}
        for end, kind in joints.items()
    }
    fixed = scene(LENGTH, joints=held)
    modes = sidtool.linearise(fixed, about="start", sids={"beam": sid}).frequencies
    return float(modes[modes > 1e-3][0])


def test_element_with_its_upper_end_held() -> None:
    found = element(AT_END, CONSTRAINT_AND_MODES)
    assert_allclose(found.mass, WHOLE_MASS, rtol=1e-10)
    assert_allclose(end_held(), END_HELD, rtol=1e-6)


def test_element_on_a_pin(tmp_path: Path) -> None:
    assert_allclose(static_mode(tmp_path), PINNED, rtol=1e-6)
    exact = np.sqrt(420 * STIFFNESS / (MASS * LENGTH**4)) / (2 * np.pi)
    assert_allclose(pinned_and_held(), [PINNED_END_HELD, exact], rtol=1e-6)
