"""The same bar in plane and space: it moves the same, or the plane refuses it.

Straight and bent bars with turned sections. A bar may move in the plane where its axis
lies in it and its sections are square, or have their principal axes in and across it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, simulate
from tests.solver.dynamics.test_out_of_plane import slides

HEIGHT = 0.02
SEEDS = (3, 6, 7, 8, 13, 16, 17, 20)


def random_bar(seed: int) -> tuple[Any, bool]:
    """A model, and whether the bar is symmetric to the plane z = 0."""
    rng = np.random.default_rng([24, seed])
    turned = float(rng.choice([0.0, np.pi / 2, np.pi / 4, rng.uniform(0.0, np.pi)]))
    twist = float(rng.choice([0.0, np.pi, 0.3]))
    width = float(rng.choice([HEIGHT, 0.5 * HEIGHT, 2.0 * HEIGHT]))
    middle = [0.5, 0.1, float(rng.choice([0.0, 0.05]))]
    bent = seed % 3 == 2
    geometry = {
        "type": "beam",
        "start": [0.0, 0.0, 0.0],
        "end": [1.0, 0.0, 0.0],
        "y_axis": [0.0, float(np.cos(turned)), float(np.sin(turned))],
        "twist": twist,
        "section": {"shape": "rectangle", "height": HEIGHT, "width": width},
        "masses": [{"at": 0.6, "mass": 1.0}] if seed % 3 == 1 else [],
    }
    model = {
        "format": "sidtool model",
        "version": 1,
        "material": {"youngs_modulus": 2e11, "poissons_ratio": 0.3, "density": 7850.0},
        "geometry": geometry | ({"through": [middle]} if bent else {}),
        "discretisation": {"type": "beam", "elements": 8},
        "frame": {"type": "tangent", "marker": "a", "clamp": "start"},
        "markers": {
            "a": {"node": 1, "parameters": [0]},
            "b": {"node": 2, "parameters": [1]},
        },
        "reduction": {
            "method": ("attachment", "craig_bampton")[seed % 2],
            "interfaces": ["b"],
            "modes": 3,
        },
    }
    principal = abs(np.sin(2.0 * (turned + twist))) < 1e-9 or width == HEIGHT
    return model, principal and not (bent and middle[2])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_bar_moves_the_same_in_plane_and_space(seed: int) -> None:
    """Its end slides up and down with 5 kg, as `slides` says."""
    model, symmetric = random_bar(seed)
    sid = sid_from_model(validate_data(model, ModelFile))
    scenes = [
        slides(planar, time={"end": 0.05, "output_step": 0.01})
        for planar in (True, False)
    ]
    if not symmetric:
        with pytest.raises(InputError) as caught:
            compile_scene(scenes[0], sids={"bar": sid})
        assert caught.value.place == "bodies.bar.sid"
        return
    plane, space = (
        simulate(compile_scene(described, sids={"bar": sid}), rtol=1e-8)["slider.y"]
        for described in scenes
    )
    assert np.abs(plane - space).max() < 1e-8 * np.abs(space).max()


def test_some_are_symmetric_and_some_are_not() -> None:
    assert {random_bar(seed)[1] for seed in SEEDS} == {True, False}
