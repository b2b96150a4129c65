"""Cross-sections of the members of a frame, and what lies beyond them.

A cut that separates the frame has section forces by the equilibrium of the part beyond.
Where members form a ring, a cut leaves the frame connected: its section forces are what
the element at the cut exerts on the node there, by its displacements and its loads.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from sidtool.formats.base.complex_step import analytic_pinv
from sidtool.formats.base.taylor import Array

from ..beams.element import Indices, rows_without_rounding, scatter_rows
from ..elements.finite_element_model import BodyCut, MarkerRows
from .bar_elements import BarElement

#: Relative cut-off of singular values of the motion of an end by its node.
_INDEPENDENT = 1e-9


@dataclass(frozen=True, eq=False)
class Connectivity:
    """Nodes and elements as vertices of a graph, joined where an element has its end.

    Attributes
    ----------
    joints : (k, 2) element and node of every end; elements count after the nodes
    count : of vertices
    """

    joints: Indices
    count: int

    def beyond(
        self, element: int, node: int, *, of_element: bool
    ) -> NDArray[np.bool_] | None:
        """(count,) mask of what is connected with one side of a cut between an element
        and a node; None where the other side is, too.

        Parameters
        ----------
        of_element : True for the side of the element, False for that of the node
        """
        kept = ~((self.joints[:, 0] == element) & (self.joints[:, 1] == node))
        i, j = self.joints[kept].T
        graph = sp.csr_matrix((np.ones(len(i)), (i, j)), (self.count, self.count))
        _, part = connected_components(graph, directed=False)
        if part[element] == part[node]:
            return None
        mask: NDArray[np.bool_] = part == part[element if of_element else node]
        return mask


def member_cuts(
    member: str,
    fractions: Mapping[str, float],
    ends: Array,
    elements: Sequence[tuple[BarElement, Indices]],
    vertices: tuple[Sequence[int], Sequence[int]],
    graph: Connectivity,
    owners: Indices,
    markers: Mapping[str, int],
    ndof: int,
    end_motion: Callable[[int, int], tuple[Indices, Array]],
    continued: Mapping[int, Array],
) -> list[BodyCut]:
    """Return the cuts of a member, called MEMBER.SECTION.

    Parameters
    ----------
    fractions : name of a section -> fraction of the length
    ends : (n + 1,) fractions between elements
    vertices : of the n elements, and of the n + 1 nodes
    owners : (p,) vertices of the inertia points
    markers : name of a marker -> its vertex
    end_motion : of the vertex of an element and the number of an end, the rows of the
        element's degrees of freedom that are its node's there, and the motion (6, k) of
        the end by them
    continued : label of a node, its vertex plus 1 -> direction of all its members
    """
    of_elements, of_nodes = vertices
    cuts = []
    for name, at in fractions.items():
        k = int(np.abs(ends - at).argmin())
        before = max(k - 1, 0)
        mask = graph.beyond(of_elements[before], of_nodes[k], of_element=k == 0)
        element, dofs = elements[before]
        place = 0.0 if k == 0 else 1.0
        rows = element.rows(place)
        frames = element.frames(np.array([place]))
        axes = frames.section_axes[0]
        section = MarkerRows(
            name=f"{member}.{name}",
            node=0,
            position=frames.places[0],
            displacement=rows_without_rounding(rows.displacement, dofs, ndof),
            rotation=rows_without_rounding(rows.rotation, dofs, ndof),
            tangent=continued.get(of_nodes[k] + 1),
        )
        if mask is not None:
            points = mask[owners]
            beyond = tuple(marker for marker, v in markers.items() if mask[v])
            cuts.append(BodyCut(section.name, section, axes, points, beyond))
            continue
        own, motion = end_motion(of_elements[before], 0 if k == 0 else 1)
        jump = analytic_pinv(motion, _INDEPENDENT) @ np.kron(np.eye(2), axes.T)
        if k == 0:  # the node is before the section
            jump = -jump
        cuts.append(
            BodyCut(
                name=section.name,
                section=section,
                axes=axes,
                points=owners == of_elements[before],
                markers=(),
                resultants=scatter_rows(jump.T @ element.stiffness()[own], dofs, ndof),
                jump=sp.csr_matrix(scatter_rows(jump.T, dofs[own], ndof).T),
            )
        )
    return cuts
