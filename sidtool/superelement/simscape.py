"""Superelement for Simscape Multibody: variables of Reduced Order Flexible Solid.

Source: MathWorks, Simscape Multibody reference, block Reduced Order Flexible Solid:
coordinates of each boundary node in the order Tx, Ty, Tz, Rx, Ry, Rz, nodes in the
order of the interface frames, then modal coordinates.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .craig_bampton import Superelement

#: Description at the start of the file; MATLAB shows it and asks for nothing in it.
_DESCRIPTION = b"MATLAB 5.0 MAT-file, superelement written by sidtool".ljust(116)


def write_simscape(path: Path, element: Superelement) -> None:
    """Write a MATLAB file (version 5).

    Variables: M, K, C; P (n, 3) origins of the interface frames [m]; Q (n, 4) their
    unit quaternions, scalar first; names (n, 1) of the frames.
    """
    from scipy.io import savemat

    count = len(element.interfaces)
    names = np.empty((count, 1), object)
    names[:, 0] = element.interfaces
    with path.open("wb") as stream:
        savemat(
            stream,
            {
                "M": element.mass,
                "K": element.stiffness,
                "C": element.damping,
                "P": element.positions,
                "Q": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
                "names": names,
            },
            do_compression=True,
        )
        stream.seek(0)
        stream.write(_DESCRIPTION)
