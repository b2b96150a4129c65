"""Damping laws as the command line says them."""

from __future__ import annotations

from typing import Any

from sidtool.formats.errors import InputError
from sidtool.formats.scene import (
    Damping,
    FrequencyDamping,
    ModalDamping,
    RayleighDamping,
)
from sidtool.formats.sid import SID
from sidtool.solver.system.bodies.damping import damped

_EXPECTED = (
    "none, rayleigh:ALPHA,BETA, modal:RATIO (or one for each mode) or frequency, "
    "with numbers from 0"
)


def damped_by(sid: SID, law: str) -> SID:
    """A SID with the damping matrix De that a law makes of its Me and Ke.

    Parameters
    ----------
    law : "none", "rayleigh:ALPHA,BETA" [1/s], [s], "modal:RATIO,..." or "frequency";
        the policies of a scene's bodies

    Raises
    ------
    InputError : the law is not one of these, or has the wrong number of values.
    """
    return damped(sid, _policy(law), "SID")


def _policy(law: str) -> Damping:
    kind, _, text = law.partition(":")
    try:
        values = tuple(float(value) for value in text.split(",")) if text else ()
        if min(values, default=0.0) >= 0.0:
            return _LAWS[kind](*values)
    except (KeyError, TypeError, ValueError):
        pass
    raise InputError(f"found {law!r}", place="damping", expected=_EXPECTED)


def _none() -> Damping:
    return RayleighDamping(type="rayleigh")


def _rayleigh(alpha: float, beta: float) -> Damping:
    return RayleighDamping(type="rayleigh", alpha=alpha, beta=beta)


def _modal(*ratios: float) -> Damping:
    return ModalDamping(type="modal", ratio=ratios)


def _frequency() -> Damping:
    return FrequencyDamping(type="frequency")


_LAWS: dict[str, Any] = {
    "none": _none,
    "rayleigh": _rayleigh,
    "modal": _modal,
    "frequency": _frequency,
}
