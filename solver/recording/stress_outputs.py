"""Stresses of flexible bodies among the recorded quantities."""

from __future__ import annotations

from sidtool.formats.errors import InputError
from sidtool.formats.scene import PEAK_STRESS, STRESSES, OutputName
from sidtool.formats.sid import Array
from sidtool.formats.stress import node_stress, peak_stress, stress_nodes, von_mises

from ..system.scene import System
from .energies import elastic_state
from .sampling import Samples


def stress_column(system: System, samples: Samples, name: OutputName) -> Array:
    """BODY.MARKER.sigma_xx to .von_mises, or BODY.peak_von_mises, (nt,) [Pa]."""
    b = system.index(name.owner)
    data = system.bodies[b]
    q, _ = elastic_state(system, samples, b)
    if name.quantity == PEAK_STRESS:
        return peak_stress(data.sid, q)
    stress = node_stress(data.sid, data.node(name.marker).id, q)
    if name.quantity == STRESSES[-1]:
        return von_mises(stress)
    return stress[:, STRESSES.index(name.quantity)]


def check_stress(system: System, name: OutputName) -> None:
    """Raises stresses that a SID does not tell.

    Raises
    ------
    InputError : the body, or the node, has no stress rows.
    """
    data = system.bodies[system.index(name.owner)]
    known = stress_nodes(data.sid)
    place = f"outputs.record, {'.'.join(part for part in name if part)}"
    if not known:
        raise InputError(
            f"the SID of {name.owner} tells no stress",
            place=place,
            expected="a body converted with a table [stress]",
        )
    if name.marker and data.node(name.marker).sigma is None:
        more = ", ..." if len(known) > 8 else ""
        raise InputError(
            f"node {data.node(name.marker).id} of {name.owner} carries no stress",
            place=place,
            expected=f"a marker on one of the nodes {', '.join(known[:8])}{more}",
        )
