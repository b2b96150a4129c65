"""Scenes with inputs, and their units, linked once per session."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import sidtool
from sidtool.fmu import export as export_module
from sidtool.fmu.linking import link, own_platform
from tests.places import SLIDER_CRANK
from tests.sidtool.fmu.importer import Library

Export = Callable[..., Library]


def slider_crank(**changes: Any) -> sidtool.Scene:
    """The founding scene to 0.5 s, with the load on the piston as input.

    The speed of the crank ends to grow at 0.3 s: a break of its drive.
    """
    pieces = [
        {"from": 0.0, "to": 0.3, "start": [0, 0, 0, 0], "end": [3.0, 20.0, 0, 0]},
        {"from": 0.3, "coefficients": [3.0, 20.0]},
    ]
    load = {"marker": "piston", "force": [1.0, 0.0], "type": "force"}
    scene = sidtool.Scene.load(SLIDER_CRANK / "slider_crank.toml")
    return scene.with_(
        {
            "time.end": 0.5,
            "accuracy.integrator": "radau9",
            "accuracy.rtol": 1e-6,
            "inputs.load": {"initial": 5.0, "unit": "N"},
            "forces.load": load | {"function": {"type": "input", "name": "load"}},
            "drives.crank_angle.function": {"type": "polynomial", "pieces": pieces},
            "outputs.record": [
                *("piston.x", "piston.ax", "rod.q1", "rod.vq2", "crank.angle"),
                *(
                    "rod.piston_pin.y",
                    "rod.piston_pin.uy",
                    "piston_pin.fx",
                    "load.value",
                ),
                *("energy.kinetic", "energy.elastic", "inputs.load"),
                *("rod.piston_pin.rotation_z", "crank.quaternion_3"),
            ],
        }
        | changes
    )


@pytest.fixture(scope="session", autouse=True)
def linked_once() -> Iterator[None]:
    """Each library is linked once: that of both versions of FMI is the same."""
    libraries: dict[Any, bytes] = {}

    def cached(
        platform: str, headers: dict[str, str], objects: dict[str, bytes], *more: Any
    ) -> bytes:
        key = platform, *headers.items(), *objects.items(), *more
        if key not in libraries:
            libraries[key] = link(platform, headers, objects, *more)
        return libraries[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export_module, "link", cached)
        yield


@pytest.fixture
def without_library(monkeypatch: pytest.MonkeyPatch) -> None:
    """Units contain no library: a test looks at their descriptions alone."""
    monkeypatch.setattr(export_module, "link", lambda *arguments: b"")


@pytest.fixture(scope="session")
def export(tmp_path_factory: pytest.TempPathFactory) -> Export:
    """Exports a scene and loads its library."""

    if own_platform() != "linux64":
        pytest.skip("cc links libraries of Linux on x86-64 alone")

    def exported(scene: sidtool.Scene, **options: Any) -> Library:
        folder = tmp_path_factory.mktemp("fmu")
        scene.fmu(folder / "machine.fmu", **options)
        return Library(folder / "machine.fmu", folder / "unpacked")

    return exported


@pytest.fixture(scope="session", params=["2.0", "3.0"])
def slider(request: pytest.FixtureRequest, export: Export) -> Library:
    """The unit of the slider-crank, in both versions."""
    return export(slider_crank(), version=request.param)


@pytest.fixture
def file(slider: Library) -> Path:
    """The file of that unit."""
    return slider.path.parents[3] / "machine.fmu"
