"""What came of a file that another program wrote."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.model.reduction import BuckensFrame

from ..frontends.finite_element_model import FiniteElementModel
from ..reduction.frames import buckens_frame
from ..reduction.space import admissible
from .tables import listed, named, table

Array = NDArray[np.float64]

#: Elastic frequencies that are told.
_FREQUENCIES = 10


def describe_import(body: FiniteElementModel) -> str:
    """Mass, centre, inertia, free frequencies and node sets of a body."""
    mass, centre, inertia = _inertia(body)
    rigid, elastic = _frequencies(body, centre)
    size = float(np.abs(body.positions).max())
    entries = [
        ("nodes", str(len(body.positions))),
        ("mass", f"{mass:.9g} kg"),
        ("centre", f"{listed(centre, size)} m"),
        ("inertia about it", f"{listed(inertia)} kg m2{_axes(body)}"),
        (
            f"{len(rigid)} rigid motions",
            f"at most {rigid.max():.2g} Hz, as the stiffness resists them",
        ),
        ("free frequencies", f"{listed(elastic)} Hz" if elastic.size else "(none)"),
    ]
    rows = [
        [name, str(len(nodes)), *_extent(body.positions[nodes], size)]
        for name, nodes in body.node_sets.items()
        if len(nodes)
    ]
    lines = named(entries)
    if not rows:
        return f"{lines}\n\nno node sets"
    return f"{lines}\n\n{table(['node set', 'nodes', 'from [m]', 'to [m]'], rows)}"


def _inertia(body: FiniteElementModel) -> tuple[float, Array, Array]:
    """Mass, centre (3,), and xx, yy, zz, xy, yz, xz about it; of a plane body zz."""
    rigid = body.rigid_body_modes()
    gram = rigid.T @ (body.mass @ rigid)
    mass = gram[0, 0]
    if body.dimension == 2:
        centre = np.array([gram[1, 2], -gram[0, 2], 0.0]) / mass
        about = body.rigid_body_modes(centre)[:, 2]
        return mass, centre, np.array([about @ (body.mass @ about)])
    centre = np.array([-gram[2, 4], gram[2, 3], -gram[1, 3]]) / mass
    about = body.rigid_body_modes(centre)[:, 3:]
    j = about.T @ (body.mass @ about)
    return mass, centre, np.array([*np.diag(j), j[0, 1], j[1, 2], j[0, 2]])


def _axes(body: FiniteElementModel) -> str:
    return " (zz)" if body.dimension == 2 else " (xx, yy, zz, xy, yz, xz)"


def _frequencies(body: FiniteElementModel, centre: Array) -> tuple[Array, Array]:
    """Those that the stiffness gives rigid motions, and the first elastic ones [Hz]."""
    rigid = body.rigid_body_modes(centre)
    energy = np.einsum("ik,ik->k", rigid, body.stiffness @ rigid)
    inertia = np.einsum("ik,ik->k", rigid, body.mass @ rigid)
    resisted = np.sqrt(np.abs(energy) / inertia) / (2 * np.pi)
    space = admissible(body, buckens_frame(body, BuckensFrame(type="buckens")))
    free = space.stiffness.shape[0] - rigid.shape[1]
    try:
        values, _ = space.modes(min(_FREQUENCIES, free))
    except InputError:
        return resisted, np.zeros(0)
    return resisted, np.sqrt(np.maximum(values, 0.0)) / (2 * np.pi)


def _extent(points: Array, size: float) -> list[str]:
    return [listed(points.min(axis=0), size), listed(points.max(axis=0), size)]
