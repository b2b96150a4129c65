"""Numbers beyond those that matrices can hold end in a message, by every command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from sidtool.cli.main import run
from tests.codes import unwrapped

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")

FLANGES = {"shape": "I", "height": 10.0, "width": 1e60, "web": 2.7, "flange": 1e-3}
STATIONS = {
    "position": [0.0, 1.0],
    **{k: [1e9, 1e9] for k in ("EA", "EI_y", "EI_z", "GJ")},
    "mass_per_length": [1.0, 1.0],
    "tension_y": [0.0, 0.0],
    "tension_z": [0.0, 1e300],
}


@pytest.mark.parametrize(
    ("section", "command"),
    [
        ({"section": FLANGES}, ["convert", "-o", "made.h5"]),
        ({"sections": STATIONS}, ["convert", "-o", "made.h5"]),
        ({"sections": STATIONS}, ["info"]),
    ],
)
def test_sections_beyond_all_matrices_are_refused(
    section: dict[str, Any],
    command: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    material = {"youngs_modulus": 2.1e11, "poissons_ratio": 0.3, "density": 7850.0}
    data = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "beam", "start": [0, 0, 0], "end": [1, 0, 0], **section},
        "discretisation": {"type": "beam", "elements": 3},
        "frame": {"type": "tangent", "marker": "a"},
        "markers": {"a": {"node": 1, "parameters": [0]}},
        "reduction": {"method": "modal", "modes": 2},
        **({"material": material} if "section" in section else {}),
    }
    monkeypatch.chdir(tmp_path)
    Path("part.json").write_text(json.dumps(data), encoding="utf-8")
    assert run([command[0], "part.json", *command[1:]]) == 2
    assert "Traceback" not in unwrapped(capfd.readouterr().err)
