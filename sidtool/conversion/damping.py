"""Damping laws of the command line."""

from typing import Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import real_of_text
from sidtool.formats.base.sid import SID
from sidtool.formats.scene import (
    Damping,
    FrequencyDamping,
    ModalDamping,
    RayleighDamping,
)
from sidtool.solver.system.body_data import sid_with_damping

_EXPECTED = (
    "none, rayleigh:ALPHA,BETA, modal:RATIO (or one for each mode) or frequency, "
    "with numbers from 0"
)


def with_damping_law(sid: SID, law: str) -> SID:
    """Return a SID with the damping matrix De that a damping law makes of its Me and
    Ke.

    Parameters
    ----------
    law : "none", "rayleigh:ALPHA,BETA" [1/s], [s], "modal:RATIO,..." or "frequency";
        the damping types of a scene's bodies

    Raises
    ------
    InputError : the law is not one of these, or has the wrong number of values.
    """
    return sid_with_damping(sid, _damping_table(law), "SID")


def _damping_table(law: str) -> Damping:
    kind, _, text = law.partition(":")
    try:
        values = tuple(real_of_text(word) for word in text.split(",")) if text else ()
        if min(values, default=0.0) >= 0.0:
            return _LAWS[kind](*values)
    except (KeyError, TypeError, ValueError):
        pass
    raise InputError(f"found {law!r}", place="damping", expected=_EXPECTED)


def _no_damping() -> Damping:
    return RayleighDamping(type="rayleigh")


def _rayleigh(alpha: float, beta: float) -> Damping:
    return RayleighDamping(type="rayleigh", alpha=alpha, beta=beta)


def _modal(*ratios: float) -> Damping:
    return ModalDamping(type="modal", ratio=ratios)


def _frequency() -> Damping:
    return FrequencyDamping(type="frequency")


_LAWS: dict[str, Any] = {
    "none": _no_damping,
    "rayleigh": _rayleigh,
    "modal": _modal,
    "frequency": _frequency,
}
