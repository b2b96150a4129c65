"""Registry of identities, and the scales and deviations that they are measured by."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sidtool.formats.base.sid import SID, Array, by_mode, symmetric_3x3
from sidtool.formats.diagnostics import ERROR
from sidtool.formats.diagnostics.identities import IDENTITY_TEXTS

Severity = Literal["error", "warning"]

# A block whose largest entry is below this fraction of its natural size holds nothing
# but rounding errors of the writer's sums.
_NOISE = 1e-10


@dataclass(frozen=True)
class Finding:
    """Result of a check.

    Attributes
    ----------
    measured : the deviation, relative to the largest entry; None if not applicable
    detail : what the number refers to, or why there is none
    broken : failed whatever the deviation
    bound : replaces the registered bound when it depends on the data
    size : of the largest entry, and
    terms : how many printed entries meet in the difference: effect of their rounding,
        see `rounding`
    """

    measured: float | None
    detail: str = ""
    broken: bool = False
    bound: float | None = None
    size: float = 0.0
    terms: int = 0


@dataclass(frozen=True)
class Identity:
    """One registered check."""

    id: str
    bound: float
    measure: Callable[[SID], Finding]

    @property
    def title(self) -> str:
        """Both sides of the identity."""
        return IDENTITY_TEXTS[self.id].title

    @property
    def severity(self) -> Severity:
        """Severity of a failure."""
        return "error" if IDENTITY_TEXTS[self.id].severity == ERROR else "warning"

    @property
    def meaning(self) -> str:
        """What a failure means for a simulation."""
        return IDENTITY_TEXTS[self.id].meaning


IDENTITIES: dict[str, Identity] = {}


def identity(
    name: str, *, bound: float, of_shapes: bool = False
) -> Callable[[Callable[[SID], Finding]], Callable[[SID], Finding]]:
    """Register the decorated function as a check; its texts are in the catalogue of
    diagnostics.

    of_shapes : the check does not apply to a body without shape functions
    """

    def register(measure: Callable[[SID], Finding]) -> Callable[[SID], Finding]:
        def checked(sid: SID) -> Finding:
            if of_shapes and sid.nq == 0:
                return Finding(None, "rigid body")
            return measure(sid)

        IDENTITIES[name] = Identity(name, bound, checked)
        return measure

    return register


@dataclass(frozen=True)
class ModalBlocks:
    """Blocks of a SID with the mode index first.

    Attributes
    ----------
    J1 : (nq, 3, 3) first-order inertia tensors
    Gr, Cr1, Oe1 : (nq, 3, 3), (nq, nq, 3), (nq, nq, 6); Cr1[l, i], Oe1[l, i] belong
        to row i and the elastic coordinate l
    Ge : (nq, nq, 3) with Ge[l, i] likewise
    """

    J1: Array
    Gr: Array
    Ge: Array
    Cr1: Array
    Oe1: Array


def modal_blocks(sid: SID) -> ModalBlocks:
    """The velocity-dependent blocks of a SID, per mode."""
    nq = sid.nq
    return ModalBlocks(
        J1=symmetric_3x3(sid.J.first_order(nq)[:, :, 0]),
        Gr=by_mode(sid.Gr.m0, nq),
        Ge=by_mode(sid.Ge.m0, nq),
        Cr1=sid.Cr.first_order(nq),
        Oe1=sid.Oe.first_order(nq),
    )


def transpose_modes(pair: Array) -> Array:
    """Transpose over the two mode indices (the first two)."""
    return pair.swapaxes(0, 1)


def max_magnitude(*arrays: Array) -> float:
    """Largest magnitude among all entries; 0 for none."""
    return max((float(np.abs(a).max()) for a in arrays if a.size), default=0.0)


def relative_difference(difference: Array, *references: Array) -> float:
    """Largest difference relative to the largest entry of the references."""
    size = max_magnitude(*references)
    return max_magnitude(difference) / size if size else max_magnitude(difference)


def finding_of_difference(
    difference: Array,
    *references: Array,
    natural: float = 0.0,
    bound: float = 1e-11,
    detail: str = "",
    terms: int = 2,
) -> Finding:
    """A finding from a difference that should vanish.

    `natural` is the size that the entries could have; blocks far below it are noise
    and their difference is measured against it instead. `terms` printed entries
    (with their factors) meet in the difference.
    """
    size = max_magnitude(*references)
    if size == 0.0:
        return Finding(0.0, "both sides are zero")
    measured = max_magnitude(difference) / size
    if measured > bound and size < _NOISE * natural:
        text = f"rounding noise only (largest entry {size:.1e})"
        return Finding(max_magnitude(difference) / natural, text)
    return Finding(measured, detail, size=size, terms=terms)


def modal_scale(sid: SID) -> float:
    """Natural size of second-order blocks (Cr1, Ge, Oe1) [kg m2/[q]2]."""
    return max_magnitude(np.diag(sid.Me.m0))


def translation_scale(sid: SID) -> float:
    """Natural size of Ct and of the first-order mdCM [kg m/[q]]."""
    return float(np.sqrt(abs(sid.mass) * modal_scale(sid)))


def rotation_scale(sid: SID) -> float:
    """Natural size of Cr, Gr and of the first-order J [kg m2/[q]]."""
    return float(np.sqrt(max_magnitude(sid.J.m0) * modal_scale(sid)))
