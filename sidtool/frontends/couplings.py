"""Nodes that a file ties together, and masses at points, for any discretisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Coupling:
    """Nodes that a reference point moves with.

    Attributes
    ----------
    rigid : whether the nodes are one rigid piece (RBE2); else the point takes their
        mean motion (RBE3)
    nodes : rows of the positions of the body
    weights : (n, n) by which its nodes weigh in the mean, alike if None
    position : (3,) of the reference point [m]; None for the centre of the nodes
    markers : those of the model file that stand at the reference point
    """

    name: str
    rigid: bool
    nodes: Indices
    position: Array | None
    markers: tuple[str, ...] = ()
    weights: sp.csr_matrix | None = None


@dataclass(frozen=True, eq=False)
class PointMass:
    """A mass at a node of the body, or at the reference point of a coupling.

    Attributes
    ----------
    node : row of the positions, None at a coupling
    coupling : name of the coupling
    mass : [kg]
    offset : (3,) from the node [m]
    inertia : (3, 3) about its centre, axes of the model [kg m^2]
    """

    node: int | None
    coupling: str | None
    mass: float
    offset: Array
    inertia: Array
