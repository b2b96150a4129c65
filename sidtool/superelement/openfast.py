"""Superelement for OpenFAST's module ExtPtfm: the reduced file in the Flex 5 format.

Source: E. Branlard, M. Shields, B. Anderson, R. Damiani, F. Wendt, J. Jonkman, W.
Musial, B. Foley, "Superelement reduction of substructures for sequential load
calculations in OpenFAST", J. Phys. Conf. Ser. 1452, 2020; ExtPtfm user's guide, section
Reduced file.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.base.errors import InputError

from .craig_bampton import Superelement

#: End of the table of loads [s].
_END = 1e5


def extptfm_text(element: Superelement) -> str:
    """Return the reduced file of a structure with one interface, the platform.

    Coordinates are those of the platform, surge, sway, heave, roll, pitch and yaw along
    the axes of the body frame, and the modes with a fixed platform. Loads are zero.

    Raises
    ------
    InputError : there is more than one interface that can move.
    """
    if len(element.interfaces) != 1:
        raise InputError(
            f"{len(element.interfaces)} interfaces can move: "
            f"{', '.join(element.interfaces)}",
            place="interfaces",
            expected="one, the platform of ExtPtfm; fix the others to the ground with "
            "--fixed (fixed=[...] in Python)",
        )
    size = len(element.mass)
    lines = [
        "!Comment: superelement written by sidtool, SI units",
        "!Comment Flex 5 Format",
        f"!Dimension: {size}",
        f"!Time increment in simulation: {_END:g}",
        f"!Total simulation time in file: {_END:g}",
    ]
    for title, matrix in (
        ("Mass Matrix (kg, kg m, kg m^2)", element.mass),
        ("Stiffness Matrix (N/m, N, N m)", element.stiffness),
        ("Damping Matrix (N s/m, N s, N m s)", element.damping),
    ):
        lines += [f"!{title}", f"!Dimension: {size}"]
        lines += (" ".join(f"{value:.16e}" for value in row) for row in matrix)
    lines += ["!Loading", f"!Dimension: 1 time column, {size} force columns"]
    zeros = " ".join(f"{value:.1e}" for value in np.zeros(size))
    lines += [f"{time:.6e} {zeros}" for time in (0.0, _END)]
    return "\n".join(lines) + "\n"
