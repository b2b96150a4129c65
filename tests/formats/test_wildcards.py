"""Names with wildcards stand for the outputs that a scene has."""

from __future__ import annotations

from pathlib import Path

import pytest

from sidtool.formats.errors import InputError
from sidtool.formats.scene import expanded, has_wildcard, known_outputs, read_scene
from sidtool.formats.sid_files import read_sid
from tests.places import SLIDER_CRANK


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("rod.q*", ["rod.q1", "rod.q2", "rod.q3", "rod.q4", "rod.q5"]),
        ("*k.ang*e", ["crank.angle"]),
        ("*_pin.angle", ["crank_pin.angle", "piston_pin.angle"]),
        ("*.pin.v*", ["crank.pin.vx", "crank.pin.vy"]),
        ("rod.*.ux", ["rod.crank_pin.ux", "rod.piston_pin.ux"]),
        ("slider.f*", ["slider.f*"]),
        ("piston.x", ["piston.x"]),
        ("bearing.f*", ["bearing.f*"]),
        ("energy.e*", ["energy.elastic"]),
    ],
)
def test_patterns(pattern: str, names: list[str]) -> None:
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    sids = {"rod": read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")}
    found = expanded([pattern, pattern], scene, sids)
    assert list(found) == names


def test_nothing_found_is_told() -> None:
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    with pytest.raises(InputError, match="stands for no output"):
        expanded(["rot.*"], scene, {})


def test_all_known_names_are_valid(tmp_path: Path) -> None:
    """Each is recorded by a scene file without complaint."""
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    names = list(
        known_outputs(scene, {"rod": read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")})
    )
    assert len(names) == len(set(names)) > 80
    assert not any(map(has_wildcard, names))
    listed = ", ".join(f'"{name}"' for name in names)
    text = (SLIDER_CRANK / "slider_crank.toml").read_text()
    head = text[: text.index("[outputs]")]
    file = tmp_path / "all.toml"
    file.write_text(f"{head}[outputs]\nrecord = [{listed}]\n")
    assert read_scene(file).outputs.record == tuple(names)
