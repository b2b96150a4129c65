"""Frames of steel beams as model files, for tests to vary."""

from __future__ import annotations

from typing import Any

import sidtool
from sidtool.formats.model import ModelFile

E, NU, RHO = 2.1e11, 0.3, 7850.0
STIFF = {"shape": "general", "area": 10.0, "iy": 1e-6, "iz": 2e-6, "torsion": 1e-6}
TUBE = {"shape": "tube", "diameter": 0.06, "thickness": 0.004}


def frame(points: dict[str, Any], members: dict[str, Any], **changes: Any) -> ModelFile:
    """A frame of steel; members as (start, end, entries)."""
    first = next(iter(points))
    geometry = {
        "type": "frame",
        "points": points,
        "members": {
            name: {"start": start, "end": end} | entries
            for name, (start, end, entries) in members.items()
        },
    }
    data = {
        "format": "sidtool model",
        "version": 1,
        "material": {"youngs_modulus": E, "poissons_ratio": NU, "density": RHO},
        "geometry": geometry | changes.pop("geometry", {}),
        "discretisation": {"type": "beam", "elements": 2},
        "frame": {"type": "tangent", "marker": "p", "clamp": first},
        "markers": {"p": {"node": 1, "point": first}},
        "reduction": {"method": "modal", "modes": 4},
    }
    return ModelFile.checked(data | changes, "frame")


def hinged_crane(**changes: Any) -> ModelFile:
    """A post, a boom with a pin at the post, and a pinned strut: a determinate ring."""
    points = {"foot": [0, 0, 0], "knee": [0, 0, 1.5], "head": [0, 0, 3.0]}
    points |= {"seat": [1.5, 0, 3.0], "tip": [3.0, 0, 3.0]}
    both = {"start": ["rx", "ry", "rz"], "end": ["ry", "rz"]}
    light = {"section": TUBE, "material": "light"}
    members = {
        "lower": ("foot", "knee", light),
        "upper": ("knee", "head", light),
        "inner": ("head", "seat", light | {"releases": {"start": ["ry"]}}),
        "outer": ("seat", "tip", light),
        "strut": ("knee", "seat", light | {"releases": both}),
    }
    light_steel = {"youngs_modulus": E, "poissons_ratio": NU, "density": 1e-3}
    markers = {"p": {"node": 1, "point": "foot"}, "tip": {"node": 2, "point": "tip"}}
    return frame(
        points,
        members,
        **{
            "geometry": {"materials": {"light": light_steel}},
            "markers": markers,
            "reduction": {"method": "attachment", "interfaces": ["tip"], "modes": 0},
            "section_forces": {"stations": 3},
        }
        | changes,
    )


def section_forces(
    sid: sidtool.SID, load: float, weight: float = 0.0
) -> dict[str, float]:
    """Section forces of a frame at rest with a load at its tip.

    Parameters
    ----------
    weight : acceleration of gravity
    """
    found = sidtool.static_equilibrium(
        sidtool.Scene(
            dimension="spatial",
            time={"end": 1.0, "output_step": 1.0},
            gravity=[0.0, 0.0, -weight],
            bodies={"c": {"sid": "c.h5", "markers": {"p": 1, "tip": 2}}},
            joints={"wall": {"type": "fixed", "markers": ["ground", "c.p"]}},
            forces={
                "load": {
                    "type": "force",
                    "marker": "c.tip",
                    "force": [0.0, 0.0, -load],
                }
            },
            outputs={"record": ["c.*.*.*", "wall.*"]},
        ),
        sids={"c": sid},
    )
    return {name: found[name] for name in found}
